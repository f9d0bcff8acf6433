"""Notices a callback that does not return. The executor cannot: it waits for that callback."""

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple

from siren_ros.interfaces.lockstep_reports import Phase
from siren_ros.lockstep.lockstep import LockstepConfig

WATCH_S: Final = 0.25
GRACE_S: Final = 1.0
"""Added to the lockstep's own limit, so that the lockstep itself reports a callback that is only slow."""


class Work(NamedTuple):
    """What a participant is doing now."""

    participant: str
    phase: Phase
    step: int
    since_s: float
    """Wall time at which it began."""


def limits_s(config: LockstepConfig) -> dict[Phase, float]:
    """How long work of each phase may take."""
    return {
        Phase.READY: config.start_timeout_s,
        Phase.STEP: config.step_timeout_s,
        Phase.FINAL: config.close_timeout_s,
    }


def overdue(works: Iterable[Work | None], limits: Mapping[Phase, float], now_s: float) -> str:
    """Which participant did not return in time, in the lockstep's words; empty: none."""
    for work in works:
        if work is not None and now_s - work.since_s > limits[work.phase] + GRACE_S:
            what = {
                Phase.READY: "was not ready",
                Phase.STEP: f"did not finish step {work.step}",
                Phase.FINAL: "did not close",
            }
            return f"{work.participant}: {what[work.phase]} within {limits[work.phase]:g} s"
    return ""


class HangWatch:
    """A thread that asks every 0.25 s whether something hangs, and reports the first reason."""

    def __init__(self, ask: Callable[[], str], on_hang: Callable[[str], None]) -> None:
        """Starts watching.

        Args:
            ask: Gives the reason where something hangs, else an empty text.
            on_hang: Called with the reason, in the watching thread.
        """
        self._ask = ask
        self._on_hang = on_hang
        self._stopped = threading.Event()
        threading.Thread(target=self._run, name="hang watch", daemon=True).start()

    def _run(self) -> None:
        while not self._stopped.wait(WATCH_S):
            if reason := self._ask():
                self._on_hang(reason)
                return

    def stop(self) -> None:
        """Ends the thread."""
        self._stopped.set()


def begin_work(participant: str, phase: Phase, step: int) -> Work:
    """Work that a participant begins now."""
    return Work(participant, phase, step, time.monotonic())
