"""Says what a program waits for, where nothing else has been said for a while."""

import sys
import threading
import time
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import Final, NamedTuple, Self, TextIO

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
        self._stream = stream or sys.stderr
        self.ask: Callable[[], Awaited] = lambda: Awaited(what)
        self.say: Callable[[str], None] = self._print
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

    def _print(self, line: str) -> None:
        print(line, file=self._stream, flush=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join(LOOK_S)
