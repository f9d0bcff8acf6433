"""Work of a node beside its callbacks: one thread, one piece after the other, in the order in which it was given."""

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Final, TypeVar

from siren_ros.world.errors import EpisodeError

Value = TypeVar("Value")
FINISH_S: Final = 1.5
"""Shorter than the lockstep's patience with a participant that was late already."""
_POLL_S: Final = 0.005


class SideThread:
    """A thread that belongs to one node. It never keeps the program from ending."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._pieces: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._given = 0
        self._done = 0
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def _run(self) -> None:
        while True:
            self._pieces.get()()
            self._done += 1

    def put(self, piece: Callable[[], object]) -> None:
        """Hand over a piece of work, which must not raise."""
        self._given += 1
        self._pieces.put(piece)

    def call(self, piece: Callable[[], Value]) -> Value:
        """Do a piece of work in the thread and wait for what it gives or raises."""
        answer: Future[Any] = Future()

        def answering() -> None:
            try:
                answer.set_result(piece())
            except BaseException as error:  # noqa: BLE001 - raised again where it is waited for
                answer.set_exception(error)

        self.put(answering)
        value: Value = answer.result()
        return value

    def finish(self, timeout_s: float = FINISH_S) -> None:
        """Wait until everything is done.

        Raises:
            EpisodeError: It is not, in time.
        """
        deadline_s = time.monotonic() + timeout_s
        while self._done < self._given:
            if time.monotonic() > deadline_s:
                raise EpisodeError(f"{self._name} still works on a step after {timeout_s:g} s")
            time.sleep(_POLL_S)
