"""Interrupts that wait until what is under way has reached a place to stop, and processes that they do not reach."""

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
    """Notes SIGINT and SIGTERM in place of acting on them; the second one acts at once. Ignored ones stay ignored.

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
    """Processes that begin within it do not get SIGINT, which a terminal sends to them too: their program ends them.

    A process that unblocks the signal, or whose program does, gets it from then on.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_PR_SET_PDEATHSIG: Final = 1
"""``prctl(2)``: the signal that the kernel sends to this process when its parent ends."""


def signal_at_end_of_parent(number: int) -> None:
    """Asks the kernel, if it is Linux, for a signal to this process when its parent ends; 0: for none."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)


ENDS_S: Final = 5.0
"""Wall time that a program has to end before it is killed."""


def end_program(program: "subprocess.Popen[Any]") -> None:
    """Ends the leader of a session and what it has started: asks first, because a killed program leaves things behind.

    DDS's shared memory and temporary folders are such things.
    """
    for number in (signal.SIGCONT, signal.SIGTERM, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(program.pid, number)
        if number is signal.SIGTERM:
            with suppress(subprocess.TimeoutExpired):
                program.wait(ENDS_S)
    program.wait()
