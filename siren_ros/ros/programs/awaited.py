"""What the lockstep waits for, in words."""

from collections.abc import Collection, Sequence
from typing import Final

from siren_ros.interfaces.topics import AV_CONTROL, STEP_DONE
from siren_ros.lockstep.lockstep import LockstepConfig, LockstepState, Stage, first_late
from siren_ros.ros.participants.hang_watch import Work
from siren_ros.world.commands import AV_SOURCE

_MOST_NAMES: Final = 3


def awaited_by(
    state: LockstepState, config: LockstepConfig, own: Collection[str], works: Collection[Work | None] = ()
) -> str:
    """Who has to act before the lockstep goes on, and how; of those that wait for one another, the first.

    Args:
        state: The lockstep now.
        config: Its participants and time limits.
        own: Participants that the program has started itself.
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
        by_act.setdefault(_act_of(name, state, own), []).append(config.display_names.get(name, name))
    told = [f"{_listed(shown)} {act}" for act, shown in by_act.items()]
    limit_s = {
        Stage.GATHERING: config.start_timeout_s,
        Stage.STEPPING: config.step_timeout_s,
        Stage.CLOSING: config.close_timeout_s,
    }[state.stage]
    return f"{', '.join(told)}, at most {limit_s:g} s"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more


def _act_of(name: str, state: LockstepState, own: Collection[str]) -> str:
    if state.stage is Stage.STEPPING:
        return f"to finish step {state.step - bool(state.owing)}"
    if state.stage is Stage.CLOSING:
        return "to close"
    if name == AV_SOURCE:
        return f"to publish {AV_CONTROL.name}"
    return "to be ready" if name in own else f"to report READY on {STEP_DONE.name}"
