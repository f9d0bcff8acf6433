"""Calls a function in a process of its own, so that a crash, a hang or a kill costs this call and nothing else.

The processes are forked from one that has loaded the library already (multiprocessing's fork server): a start costs
some hundredths of a second.
"""

import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from siren_ros.errors import EpisodeError, InputError, SirenError

_PRELOADED: Final = "siren_ros.studies.recorded_attempt"
_TERMINATE_S: Final = 5.0
_SERVER_GONE: Final = 255
"""What multiprocessing gives as the exit code of a process whose fork server was killed."""
_SERVER_ENDS_S: Final = 0.5
"""Wall time after which a killed fork server is gone; before that the next process would be asked of it again."""
Result = TypeVar("Result")


@dataclass(frozen=True)
class Returned(Generic[Result]):
    """What the function returned."""

    value: Result


@dataclass(frozen=True)
class Refused:
    """The function raised an error of the project's own domain: another attempt would raise it again."""

    reason: str
    exit_code: int
    """As a program would end with it: 2 for input that cannot be used."""


@dataclass(frozen=True)
class Died:
    """The process ended without an answer."""

    reason: str


def call_in_own_process(
    function: Callable[..., Result], *arguments: Any, timeout_s: float, started: Callable[[int], None] = lambda _: None
) -> Returned[Result] | Refused | Died:
    """Calls a function in a new process and waits for its answer.

    Args:
        function: Of a module, so that the process finds it.
        arguments: Its arguments; they can be pickled.
        timeout_s: Wall time after which the process is killed.
        started: Told the process's id.

    Raises:
        InputError: This process must not have children.
    """
    if multiprocessing.current_process().daemon:
        allowed = (
            "a worker that may start processes: set DASK_DISTRIBUTED__WORKER__DAEMON=False, or start it --no-nanny"
        )
        raise InputError("worker", multiprocessing.current_process().name, allowed)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([_PRELOADED])
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(there, function, arguments), name="episode")
    with here:
        try:
            with there:
                process.start()
        except (EOFError, OSError) as error:
            time.sleep(_SERVER_ENDS_S)
            return Died(f"the server of new processes is gone ({type(error).__name__})")
        try:
            started(process.pid or 0)
            return _wait(process, here, timeout_s)
        finally:
            if process.is_alive():
                process.terminate()
                process.join(_TERMINATE_S)
                process.kill()
            process.join()
            if process.exitcode == _SERVER_GONE:  # then nobody watches the process any more
                with suppress(ProcessLookupError):
                    os.kill(process.pid or 0, signal.SIGKILL)


def _answer(there: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    # Ctrl-C reaches the whole group of processes; the one that started us ends us. Where it is gone, we end ourselves.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        answer: Returned[Any] | Refused | Died = Returned(function(*arguments))
    except SirenError as error:
        answer = Refused(str(error), error.exit_code)
    except Exception as error:  # noqa: BLE001 - the caller is told, whatever it is
        last = traceback.extract_tb(error.__traceback__)[-1]
        answer = Died(f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})")
    there.send(answer)


def _end_with_parent() -> None:
    """The kernel's signal at a parent's death is of no use: our parent is the fork server, which lives on with us."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGKILL)


def _wait(process: Any, here: Connection, timeout_s: float) -> Returned[Any] | Refused | Died:
    wait([here, process.sentinel], timeout_s)
    if here.poll():
        with suppress(EOFError):
            answer: Returned[Any] | Refused | Died = here.recv()
            return answer
    process.join(_TERMINATE_S)
    if process.exitcode is None:
        return Died(f"its process gave no answer for {timeout_s:g} s")
    if process.exitcode == _SERVER_GONE:
        return Died("the server of its process was killed")
    if process.exitcode < 0:
        return Died(f"its process was killed by {signal.Signals(-process.exitcode).name}")
    return Died(f"its process ended with exit code {process.exitcode}")


_TIMEOUT_S: Final = 900.0


def in_own_process(retries: int, function: Callable[..., Result], *arguments: Any) -> Result:
    """Calls a function in a process of its own, again where that process dies.

    Raises:
        InputError: The function refuses its input.
        EpisodeError: It fails, or its process died more often than may be.
    """
    reasons: list[str] = []
    while True:
        answer = call_in_own_process(function, *arguments, timeout_s=_TIMEOUT_S)
        if isinstance(answer, Refused):
            if answer.exit_code == InputError.exit_code:
                raise InputError(function.__name__, answer.reason, "input that can be used")
            raise EpisodeError(answer.reason)
        if not isinstance(answer, Died):
            return answer.value
        reasons.append(answer.reason)
        if len(reasons) > retries:
            raise EpisodeError(f"{function.__name__}: {'; '.join(reasons)}")
