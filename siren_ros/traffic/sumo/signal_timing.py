"""Shifts a signal's programme so that a movement's red begins at a wanted time."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import libsumo

from siren_ros.errors import MapError
from siren_ros.traffic.demand.plan import SignalTiming

_USUAL_CLEARANCE_S: Final = 1.5
"""From the end of one movement's yellow to the green of the next."""
_LONGEST_CLEARANCE_S: Final = 4.0


@dataclass(frozen=True)
class SignalPhase:
    """One phase of a programme: SUMO's ``rygGsuoO`` state string, and how long it lasts."""

    duration_s: float
    state: str


def red_interval_s(phases: Sequence[SignalPhase], link: int) -> tuple[float, float] | None:
    """Begin and length of a link's longest red in a programme's cycle; None where it is never or always red."""
    red = [phase.state[link].lower() == "r" for phase in phases]
    if all(red) or not any(red):
        return None
    begins = [sum(phase.duration_s for phase in phases[:number]) for number in range(len(phases))]
    best = (0.0, 0.0)
    for number, begin in enumerate(begins):
        if not red[number] or red[number - 1]:
            continue
        length, at = 0.0, number
        while red[at % len(phases)]:
            length, at = length + phases[at % len(phases)].duration_s, at + 1
        best = max(best, (length, begin))
    return best[1], best[0]


def crossing_begin_s(phases: Sequence[SignalPhase], link: int, crossing: Collection[int]) -> float | None:
    """When in the cycle traffic begins to cross a link's movement: the begin of the red, or soon before the green.

    Where one approach after the other is green, the crossing movements may have to wait for long after the link's red
    has begun. Their green then counts, less the usual time between a red and the next green.

    Args:
        phases: The programme.
        link: The link that is red.
        crossing: Links that cross it; where there are none or all stay red, the begin of the red counts.

    Returns:
        Seconds from the beginning of the cycle; None where the link is never or always red.
    """
    red = red_interval_s(phases, link)
    if red is None:
        return None
    cycle_s = sum(phase.duration_s for phase in phases)
    begins = [sum(phase.duration_s for phase in phases[:number]) for number in range(len(phases))]
    waits = [
        (begin - red[0]) % cycle_s
        for number, begin in enumerate(begins)
        if any(_is_green(phases[number], one) and not _is_green(phases[number - 1], one) for one in crossing)
    ]
    wait_s = min((wait for wait in waits if wait < red[1]), default=0.0)
    return red[0] if wait_s <= _LONGEST_CLEARANCE_S else (red[0] + wait_s - _USUAL_CLEARANCE_S) % cycle_s


def _is_green(phase: SignalPhase, link: int) -> bool:
    return phase.state[link].lower() == "g"


def place_in_cycle(phases: Sequence[SignalPhase], begin_s: float, in_s: float) -> tuple[int, float]:
    """Phase and its remaining time at the moment from which a place in the cycle is reached in ``in_s``."""
    cycle_s = sum(phase.duration_s for phase in phases)
    left_s = (begin_s - in_s) % cycle_s
    for number, phase in enumerate(phases):
        if left_s < phase.duration_s:
            return number, phase.duration_s - left_s
        left_s -= phase.duration_s
    return 0, phases[0].duration_s


def time_signal(timing: SignalTiming, warm_up_s: float) -> None:
    """Put a signal of the running simulation where the timing wants it.

    Args:
        timing: Signal, link and beginning of the red, from step 0 on.
        warm_up_s: Time from now to step 0.

    Raises:
        MapError: the link is never red, or always.
    """
    signal = timing.signal_id
    program = libsumo.trafficlight.getProgram(signal)
    logic = next(one for one in libsumo.trafficlight.getAllProgramLogics(signal) if one.programID == program)
    phases = [SignalPhase(float(phase.duration), str(phase.state)) for phase in logic.phases]
    begin_s = crossing_begin_s(phases, timing.link, timing.crossing)
    if begin_s is None:
        raise MapError(f"signal {signal}", "a programme in which the EMV's movement has both green and red")
    place = place_in_cycle(phases, begin_s, warm_up_s + timing.red_from_s)
    libsumo.trafficlight.setPhase(signal, place[0])
    libsumo.trafficlight.setPhaseDuration(signal, place[1])
