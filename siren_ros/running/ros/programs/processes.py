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
"""Signals within this time of the first count as one: repeated Ctrl-C, or a shell that forwards it."""
_OUTPUTS: Final = (1, 2)


class PreparationInterruptedError(SirenError):
    """Raised by a signal during preparation, when there is no step at which the program could end."""


class Interrupt:
    """Remembers the first signal, so that a loop can end properly; its truth value tells whether one came."""

    def __init__(self, program: str) -> None:
        """Start to handle signals; an ignored SIGHUP stays ignored (``nohup``).

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
        """Context in which a signal raises at once, even one that came before: a map may take minutes to compile.

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
            signal.signal(number, signal.SIG_DFL)  # the kernel then ends this process at any point
            os.kill(os.getpid(), number)

    def _early(self) -> SirenError:
        return PreparationInterruptedError(f"stopped by {self.signal_name}")

    def __bool__(self) -> bool:
        return bool(self.signal_name)


def _leave_terminal() -> None:
    """Discard further output, except to files, because writes to a closed terminal or pipe are errors."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    for output in _OUTPUTS:
        if not stat.S_ISREG(os.fstat(output).st_mode):
            os.dup2(nothing, output)
    os.close(nothing)


PARENT_CHECK_S: Final = 0.5
CLOSE_S: Final = 10.0
"""Time in which a running participant closes everything."""


class Parent:
    """The process that started this one."""

    def __init__(self, number: int) -> None:
        """Prepare for the parent's end, in any form.

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
        """Whether there was a parent and it has ended."""
        return bool(self._number) and os.getppid() != self._number

    def _watch(self) -> None:
        while not self.is_gone:
            time.sleep(PARENT_CHECK_S)
        time.sleep(CLOSE_S)
        os.kill(os.getpid(), signal.SIGKILL)


LOOK_S: Final = 0.25
FIRST_S: Final = 3.0
"""Time without messages at the start, because most waits are over by then."""
AGAIN_S: Final = 5.0
"""Least time between two lines. It doubles with each repeated line."""


class Awaited(NamedTuple):
    """What a program is waiting for."""

    what: str
    """Text about the wait; if empty, nothing is printed."""
    progress: Hashable = None
    """A changed value shows that the program makes progress; the silence then starts again."""
    note: str = ""
    """Additional text."""


class Silence(NamedTuple):
    """How long a program has been waiting, and what was printed about it."""

    awaited: Awaited
    since_s: float
    """Time at which this wait began."""
    other_s: float
    """Earliest time for a line that differs from the last one."""
    same_s: float
    """Earliest time to repeat the last line."""
    said: str = ""
    pause_s: float = AGAIN_S


def begin_silence(awaited: Awaited, now_s: float) -> Silence:
    """State before anything was printed."""
    return Silence(awaited, now_s, now_s + FIRST_S, now_s + FIRST_S)


def keep_silence(silence: Silence, awaited: Awaited, now_s: float) -> tuple[Silence, str]:
    """New state of the silence, and a line that is due; empty if none is.

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
    """A thread that checks every 0.25 s what a program waits for. It starts before modules are loaded."""

    def __init__(self, program: str, what: str, stream: TextIO | None = None) -> None:
        """Start the thread.

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
        """Set what the program waits for."""
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
