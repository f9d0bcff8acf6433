"""Detects callbacks that do not return, and tells what the lockstep waits for.

The executor cannot notice it: it waits for that callback.
"""

import threading
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Final, NamedTuple

from siren_ros.data.interfaces.episode_conversions import Phase
from siren_ros.data.interfaces.topics import AV_CONTROL, STEP_DONE
from siren_ros.data.lockstep import LockstepConfig, LockstepState, Stage, first_late
from siren_ros.simulation.world.commands import AV_SOURCE

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
