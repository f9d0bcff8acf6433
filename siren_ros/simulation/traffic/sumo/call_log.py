"""Records the calls of libsumo that a simulation makes, so that a benchmark can repeat them and measure SUMO alone."""

import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from libsumo import TraCIException
from libsumo import libsumo as wrapper

_STEP: Final = "simulation_step"
_START: Final = frozenset({"simulation_start", "simulation_load"})


class CallLog:
    """Notes every call that reaches SUMO's compiled library while it is open (``with``), with its arguments.

    Calls are noted below libsumo's Python functions, whose own work therefore counts as the caller's. The log starts
    with an episode: SUMO answers the same calls in the same order with the same results.
    """

    def __init__(self, folder: Path) -> None:
        """Takes the folder for copies of the files with which SUMO is started, because they may be temporary."""
        self._folder = folder
        self._library: Any = wrapper._libsumo  # noqa: SLF001 - the compiled library, which its functions call by name
        self._calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []

    def __enter__(self) -> Self:
        wrapper._libsumo = self  # noqa: SLF001 - as above
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        wrapper._libsumo = self._library  # noqa: SLF001 - as above

    def __getattr__(self, name: str) -> Any:
        function = getattr(self._library, name)
        if not callable(function) or isinstance(function, type):
            return function

        def noted(*arguments: Any, **named: Any) -> Any:
            self._calls.append((name, self._kept(arguments) if name in _START else arguments, named))
            return function(*arguments, **named)

        return noted

    def _kept(self, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
        """The arguments of a start, with files of the log's folder."""
        kept = []
        for word in arguments[0]:
            file = Path(word)
            kept.append(str(shutil.copy(file, self._folder / file.name)) if file.is_file() else word)
        return (kept, *arguments[1:])

    def replay(self, clock_s: Callable[[], float] = time.process_time) -> list[float]:
        """Makes all calls again and returns what the clock said after each step of SUMO; a last value is the end."""
        calls = [(getattr(self._library, name), *given, name == _STEP) for name, *given in self._calls]
        marks_s = []
        for function, arguments, named, is_step in calls:
            with suppress(TraCIException):  # SUMO raised this error in the simulation, too
                function(*arguments, **named)
            if is_step:
                marks_s.append(clock_s())
        return [*marks_s, clock_s()]
