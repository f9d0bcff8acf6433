"""Shifts a signal's programme so that a movement's red begins at a wanted time."""

from collections.abc import Sequence
from dataclasses import dataclass

import libsumo

from siren_ros.errors import MapError
from siren_ros.traffic.demand.plan import SignalTiming


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


def place_in_cycle(phases: Sequence[SignalPhase], link: int, red_in_s: float) -> tuple[int, float] | None:
    """Phase and its remaining time at the moment from which a link's red begins in ``red_in_s``."""
    red = red_interval_s(phases, link)
    if red is None:
        return None
    cycle_s = sum(phase.duration_s for phase in phases)
    left_s = (red[0] - red_in_s) % cycle_s
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
    place = place_in_cycle(phases, timing.link, warm_up_s + timing.red_from_s)
    if place is None:
        raise MapError(f"signal {signal}", "a programme in which the EMV's movement has both green and red")
    libsumo.trafficlight.setPhase(signal, place[0])
    libsumo.trafficlight.setPhaseDuration(signal, place[1])
