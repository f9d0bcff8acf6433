"""Time limits of an episode: callbacks that do not return, and the participant that the lockstep waits for.

The executor cannot notice such a callback, because it waits for it. Limits run by wall time that stops while this
process compiles loops: a program that compiles does not hang, and later runs have the loops from the cache.
"""

import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final, NamedTuple

from numba.core import event

from siren_ros.data.interfaces.conversions import Phase
from siren_ros.data.interfaces.topics import AV_CONTROL, STEP_DONE
from siren_ros.data.lockstep import LockstepConfig, LockstepState, Stage, first_late
from siren_ros.simulation.world.commands import AV_SOURCE


class _Compilations(event.Listener):
    """Compilations in progress in any thread, and their total time; cached loops do not count."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._under_way = 0
        self._began_s = 0.0
        self._total_s = 0.0

    def on_start(self, _: event.Event) -> None:
        with self._lock:
            if self._under_way == 0:
                self._began_s = time.monotonic()
            self._under_way += 1

    def on_end(self, _: event.Event) -> None:
        with self._lock:
            self._under_way -= 1
            if self._under_way == 0:
                self._total_s += time.monotonic() - self._began_s

    def is_compiling(self) -> bool:
        """Whether any thread of this process is compiling a loop."""
        return self._under_way > 0

    def working_s(self) -> float:
        """Seconds of wall time from an arbitrary origin, without compilations."""
        with self._lock:
            now_s = self._began_s if self._under_way else time.monotonic()
            return now_s - self._total_s


_COMPILATIONS: Final = _Compilations()
event.register("numba:compile", _COMPILATIONS)  # type: ignore[no-untyped-call] # numba's own
is_compiling: Final = _COMPILATIONS.is_compiling
working_s: Final = _COMPILATIONS.working_s
ANNOUNCE_S: Final = 1.0


@contextmanager
def announcing(announce: Callable[[], None]) -> Iterator[None]:
    """Call ``announce`` every second while a loop is compiled, in a separate thread.

    The lockstep runs in another process, whose clock does not stand still meanwhile.
    """
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(ANNOUNCE_S):
            if is_compiling():
                announce()

    thread = threading.Thread(target=run, name="compiling", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


WATCH_S: Final = 0.25
GRACE_S: Final = 1.0
"""Time added to the lockstep's own limit, so that slow callbacks are reported by the lockstep itself."""


class Work(NamedTuple):
    """The current activity of a participant."""

    participant: str
    phase: Phase
    step: int
    since_s: float
    """Time of the working clock at which the activity began."""


def overdue(works: Iterable[Work | None], config: LockstepConfig, now_s: float) -> str:
    """Text about a participant that did not return in time, in the lockstep's words; empty if there is none."""
    for work in works:
        if work is None:
            continue
        what, limit_s = {
            Phase.READY: ("was not ready", config.start_timeout_s),
            Phase.STEP: (f"did not finish step {work.step}", config.step_limit_s(work.step)),
            Phase.FINAL: ("did not close", config.close_timeout_s),
        }[work.phase]
        if now_s - work.since_s > limit_s + GRACE_S:
            return f"{work.participant}: {what} within {limit_s:g} s"
    return ""


class HangWatch:
    """A thread that checks every 0.25 s whether something hangs, and reports the first reason."""

    def __init__(self, ask: Callable[[], str], on_hang: Callable[[str], None]) -> None:
        """Start the thread.

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
        """End the thread."""
        self._stopped.set()


_MOST_NAMES: Final = 3


def awaited_by(
    state: LockstepState, config: LockstepConfig, started: Collection[str], works: Collection[Work | None] = ()
) -> str:
    """Text about the participant that must act before the lockstep continues.

    Of several that wait for one another, the first.

    Args:
        state: The lockstep now.
        config: Its participants and time limits.
        started: Participants that the program has started itself.
        works: What the participants of this process are doing.
    """
    if state.stage is Stage.CLOSED:
        return ""
    waiting = state.owing or state.waiting
    late = waiting if state.stage is Stage.CLOSING else first_late(waiting, state.stage is Stage.GATHERING)
    at_work = frozenset(work.participant for work in works if work is not None) & waiting
    names = sorted(at_work or late)
    if not names:
        return ""
    by_act: dict[str, list[str]] = {}
    for name in names:
        by_act.setdefault(_act_of(name, state, started), []).append(config.display_names.get(name, name))
    acts = [f"{_listed(shown)} {act}" for act, shown in by_act.items()]
    limit_s = {
        Stage.GATHERING: config.start_timeout_s,
        Stage.STEPPING: config.step_limit_s(state.late_step),
        Stage.CLOSING: config.close_timeout_s,
    }[state.stage]
    return f"{', '.join(acts)}, at most {limit_s:g} s"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more


def _act_of(name: str, state: LockstepState, started: Collection[str]) -> str:
    if state.stage is Stage.STEPPING:
        return f"to finish step {state.late_step}"
    if state.stage is Stage.CLOSING:
        return "to close"
    if name == AV_SOURCE:
        return f"to publish {AV_CONTROL.name}"
    return "to be ready" if name in started else f"to report READY on {STEP_DONE.name}"
