"""Ctrl-C, SIGTERM and a closed terminal: the first asks for an orderly end, one that comes later forces it."""

import os
import signal
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from siren_ros.errors import SirenError

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SAME_S: Final = 1.0
"""Signals that come within this time of the first count as one: a second press, or a shell that passes Ctrl-C on."""
_OUTPUTS: Final = (1, 2)


class PreparationInterruptedError(SirenError):
    """A signal came while something was prepared that has no step at which it could end in order."""


class Interrupt:
    """Remembers the first signal, so that a loop can end in order; true when there was one."""

    def __init__(self, program: str) -> None:
        """Handle the signals from now on; SIGHUP stays ignored where it was (``nohup``).

        Args:
            program: Name in the line that a forced end prints.
        """
        self.signal_name = ""
        self._program = program
        self._since_s = 0.0
        self._at_once = False
        for number in SIGNALS:
            if number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._take)

    @contextmanager
    def ending_at_once(self) -> Iterator[None]:
        """Within it, and where it begins after one, a signal raises: a map may take minutes to compile.

        Raises:
            PreparationInterruptedError: A signal came.
        """
        self._at_once = True
        try:
            if self.signal_name:
                raise self._early()
            yield
        finally:
            self._at_once = False

    def _take(self, number: int, _frame: object) -> None:
        now_s = time.monotonic()
        if number == signal.SIGHUP:
            _leave_terminal()
        if not self.signal_name:
            self.signal_name, self._since_s = signal.Signals(number).name, now_s
            if self._at_once:
                raise self._early()
        elif now_s - self._since_s > SAME_S:
            line = f"{self._program}: ended at once by a second signal; `siren recover` completes a bag\n"
            os.write(_OUTPUTS[-1], line.encode())
            signal.signal(number, signal.SIG_DFL)  # the kernel ends this process, wherever it is
            os.kill(os.getpid(), number)

    def _early(self) -> SirenError:
        return PreparationInterruptedError(f"stopped by {self.signal_name}")

    def __bool__(self) -> bool:
        return bool(self.signal_name)


def _leave_terminal() -> None:
    """Discard output from now on, except to files: writing to a terminal or a program that is gone is an error."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    for output in _OUTPUTS:
        if not stat.S_ISREG(os.fstat(output).st_mode):
            os.dup2(nothing, output)
    os.close(nothing)
