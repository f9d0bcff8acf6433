"""How a program waits and ends.

* Ctrl-C, SIGTERM or a closed terminal: the first asks for an orderly end, one that comes later forces it.
* A participant's process ends when the program that started it is gone.
* A program says what it waits for where nothing else has been said for a while.
"""

import os
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Final, NamedTuple, Self, TextIO

from siren_ros.base.processes.interrupts import signal_at_end_of_parent
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


PARENT_CHECK_S: Final = 0.5
CLOSE_S: Final = 10.0
"""A participant that runs has closed everything by then."""


class Parent:
    """Who started this process."""

    def __init__(self, number: int) -> None:
        """Prepare for the parent's end, however it comes.

        A stopped process (SIGSTOP) would not notice it, so the kernel continues it then. If a node does not return
        from a callback, a thread kills the process after ``CLOSE_S``.

        Args:
            number: Process id of the parent; 0: this process does not depend on one.
        """
        self._number = number
        if not self._number:
            return
        signal_at_end_of_parent(signal.SIGCONT)
        threading.Thread(target=self._watch, name="parent watch", daemon=True).start()

    @property
    def is_gone(self) -> bool:
        """Whether there was one, and it has ended."""
        return bool(self._number) and os.getppid() != self._number

    def _watch(self) -> None:
        while not self.is_gone:
            time.sleep(PARENT_CHECK_S)
        time.sleep(CLOSE_S)
        os.kill(os.getpid(), signal.SIGKILL)


LOOK_S: Final = 0.25
FIRST_S: Final = 3.0
"""So long nothing is said: most waits are over by then."""
AGAIN_S: Final = 5.0
"""The least time between two lines. It doubles with each line that says the same."""


class Awaited(NamedTuple):
    """What a program waits for now."""

    what: str
    """Nothing is said where it is empty."""
    progress: Hashable = None
    """When it changes, the program goes on, and the silence begins anew."""
    note: str = ""
    """What is said besides."""


class Silence(NamedTuple):
    """How long a program has been waiting, and what was said of it."""

    awaited: Awaited
    since_s: float
    """When this wait began."""
    other_s: float
    """Earliest time of a line that says something else than the last one."""
    same_s: float
    """Earliest time of the last line again."""
    said: str = ""
    pause_s: float = AGAIN_S


def begin_silence(awaited: Awaited, now_s: float) -> Silence:
    """Before anything was said."""
    return Silence(awaited, now_s, now_s + FIRST_S, now_s + FIRST_S)


def keep_silence(silence: Silence, awaited: Awaited, now_s: float) -> tuple[Silence, str]:
    """The silence now, and a line that breaks it; empty: none is due.

    Args:
        silence: What was before.
        awaited: What is waited for now.
        now_s: Wall time.
    """
    if not awaited.what or awaited.progress != silence.awaited.progress:
        return begin_silence(awaited, now_s), ""
    if awaited.what != silence.awaited.what:
        silence = silence._replace(since_s=now_s)
    silence = silence._replace(awaited=awaited)
    same = awaited.what == silence.said
    if now_s < (silence.same_s if same else silence.other_s):
        return silence, ""
    pause_s = 2.0 * silence.pause_s if same else AGAIN_S
    so_far_s = round(now_s - silence.since_s)
    more = [*([f"{so_far_s} s so far"] if so_far_s else []), *([awaited.note] if awaited.note else [])]
    line = f"waiting for {awaited.what}" + (f" ({'; '.join(more)})" if more else "")
    silence = silence._replace(said=awaited.what, pause_s=pause_s)
    return silence._replace(other_s=now_s + AGAIN_S, same_s=now_s + pause_s), line


class Waiting:
    """A thread that looks every 0.25 s what a program waits for. It begins before anything is loaded."""

    def __init__(self, program: str, what: str, stream: TextIO | None = None) -> None:
        """Begin to look.

        Args:
            program: Name that begins each line.
            what: What is waited for first.
            stream: Gets the lines; by default standard error.
        """
        self._program = program
        self.ask: Callable[[], Awaited] = lambda: Awaited(what)
        self.say: Callable[[str], None] = partial(print, file=stream or sys.stderr, flush=True)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="waiting", daemon=True)
        self._thread.start()

    def expect(self, what: str) -> None:
        """From now on the program waits for this."""
        self.ask = lambda: Awaited(what)

    def _run(self) -> None:
        silence = begin_silence(self.ask(), time.monotonic())
        while not self._stopped.wait(LOOK_S):
            silence, line = keep_silence(silence, self.ask(), time.monotonic())
            if line:
                with suppress(OSError, ValueError):  # the terminal is closed
                    self.say(f"{self._program}: {line}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join(LOOK_S)
