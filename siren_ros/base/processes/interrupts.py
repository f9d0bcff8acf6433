"""Delays interrupts to a safe point, shields processes from them, and ends child processes."""

import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, Final

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def deferred_interrupts() -> Iterator[Callable[[], bool]]:
    """Delay SIGINT and SIGTERM; a second signal acts at once. Ignored signals stay ignored.

    Gives a function that says whether one has come. A noted signal acts when the context ends. Outside the main thread,
    which gets no signals, the function always says no.
    """
    noted: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    handlers = {number: signal.getsignal(number) for number in _SIGNALS}
    before = {number: handler for number, handler in handlers.items() if handler is not signal.SIG_IGN}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def note(number: int, _frame: FrameType | None) -> None:
        noted.append(number)
        restore()

    for number in before:
        signal.signal(number, note)
    try:
        yield lambda: bool(noted)
    finally:
        restore()
    if noted:
        signal.raise_signal(noted[0])


@contextmanager
def children_without_ctrl_c() -> Iterator[None]:
    """Start child processes that ignore SIGINT, which a terminal also sends to them; their program ends them.

    A process that unblocks the signal, or whose program does, gets it from then on.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_PR_SET_PDEATHSIG: Final = 1
"""Option of ``prctl(2)``: the signal that the kernel sends to this process when its parent ends."""


def signal_at_end_of_parent(number: int) -> None:
    """Ask the kernel (on Linux) for a signal to this process when its parent ends; 0 means no signal."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)


def leave(*_: object) -> None:
    """A handler of SIGTERM that ends the process as an exception does: contexts close, temporary folders go."""
    raise SystemExit


ENDS_S: Final = 5.0
"""Wall time in which a program must end before it is killed."""


def end_program(program: "subprocess.Popen[Any]") -> None:
    """End a session's leader and everything that it started. It asks first, since killed programs leave files behind.

    DDS's shared memory and temporary folders are such things.
    """
    for number in (signal.SIGCONT, signal.SIGTERM, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(program.pid, number)
        if number is signal.SIGTERM:
            with suppress(subprocess.TimeoutExpired):
                program.wait(ENDS_S)
    program.wait()
