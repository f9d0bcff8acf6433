"""Orders to signals and to single vehicles in SUMO.

* A signal's programme is shifted so that a movement's red begins at a given time, or behind a platoon. A programme that
  follows its traffic (actuated, delay-based, NEMA) becomes a fixed cycle of its phases first; those of other signals
  stay.
* EMVs that SUMO drives stop where their route ends, as those do that are driven from outside: SUMO takes a vehicle out
  of traffic at the end of its route, and an EMV's sensors would go with it.
* The head of a jam blocks traffic. What causes a jam is beyond the map: SUMO's foremost drivers would go on.
* Drivers on a junction go who would wait for a vehicle from outside that waits there, too. SUMO lets a driver wait for
  a vehicle that comes to the same lane on the junction, whoever is ahead. An EMV waits for the body ahead of it, and
  civilians who make room for an EMV stay on the junction: they and those who wait for them would then stand for good.
  Once such a driver goes, the rule for vehicles that are driven from outside (``caution``) alone says when to wait.
"""

import math
from bisect import bisect_right
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise, zip_longest
from pathlib import Path
from typing import Any, Final

import libsumo
from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.braking import braking_distance_m
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import MapError
from siren_ros.simulation.conflicts.yielding import time_to_go_s
from siren_ros.simulation.traffic.demand.plan import (
    BEFORE_EMV_S,
    RED_BEHIND_S,
    YELLOW_DRIVEN_S,
    JamHead,
    PlannedVehicle,
    SignalTiming,
)
from siren_ros.simulation.traffic.sumo.mirror import DEFAULT_LANE_CHANGE_MODE, KEEP_LANE_CHANGE_MODE
from siren_ros.simulation.world.actors import Owner, TrafficFlags, TrafficState

# These are no parameters: they are usual times of signal programmes, by which a template's time of the red is reached.
_USUAL_CLEARANCE_S: Final = 1.5
"""Time from the end of one movement's yellow to the green of the next."""
_LONGEST_CLEARANCE_S: Final = 4.0
_CROSS_S: Final = 4.0
"""Time from a red until others are inside: the clearance, 1 s to react, and the way over the line from standstill."""
_LONGEST_GREEN_S: Final = 10.0
"""Longest extension of a green."""
_EMV_MPS2: Final = 2.0
"""Acceleration of an ambulance where others leave its lane before the line."""
_CREEP_MPS: Final = 1.0
_STATIC, _NEMA = 0, 4
"""SUMO's numbers of kinds of programmes."""
_NEMA_KEYS: Final = ("ring1", "ring2", "barrierPhases", "barrier2Phases", "coordinatePhases")
"""Parameters of a NEMA programme: the rings and the phases at whose ends they wait for each other."""
_NEMA_TIMES_S: Final = (3.0, 2.0)
"""Yellow and red of a phase that does not state them: an assumption."""
_LETTERS: Final = "ruyoOsgG"
"""SUMO's letters of a link, from closed to open."""


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
    best = (0.0, 0.0)
    for number, begin in enumerate(_begins_s(phases)):
        if not red[number] or red[number - 1]:
            continue
        length, at = 0.0, number
        while red[at % len(phases)]:
            length, at = length + phases[at % len(phases)].duration_s, at + 1
        best = max(best, (length, begin))
    return best[1], best[0]


def _begins_s(phases: Sequence[SignalPhase]) -> list[float]:
    return [sum(phase.duration_s for phase in phases[:number]) for number in range(len(phases))]


def crossing_first(phases: Sequence[SignalPhase], link: int, crossing: Collection[int]) -> list[SignalPhase]:
    """A programme with the phases after a link's red began reordered, so that others cross soon after it began.

    Where one approach after the other is green, the crossing movements may have to wait for long. The phases until then
    come after theirs, as with a protected turn that lags instead of leading. Unchanged where no link crosses, all stay
    red, or they begin within the usual time anyway.
    """
    red = red_interval_s(phases, link)
    if red is None:
        return list(phases)
    first = _begins_s(phases).index(red[0])
    cycle = [*phases[first:], *phases[:first]]
    ends = next((at for at, phase in enumerate(cycle) if phase.state[link].lower() != "r"), len(cycle))
    begins = [
        at
        for at in range(ends)
        if any(_is_green(cycle[at], way) and not _is_green(cycle[at - 1], way) for way in crossing)
    ]
    waiting = cycle[: min(begins, default=0)]
    if _length_s(waiting) <= _LONGEST_CLEARANCE_S:
        return list(phases)
    clear = SignalPhase(_USUAL_CLEARANCE_S, "r" * len(phases[0].state))
    before = replace(cycle[-1], state="".join("y" if letter in "gG" else letter for letter in cycle[-1].state))
    return [clear, *cycle[len(waiting) : ends], *waiting, *cycle[ends:-1], before]


def _is_green(phase: SignalPhase, link: int) -> bool:
    return phase.state[link].lower() == "g"


def place_in_cycle(phases: Sequence[SignalPhase], begin_s: float, in_s: float) -> tuple[int, float]:
    """Phase and remaining time with which a programme has to start to reach a place in its cycle in ``in_s``."""
    cycle_s = sum(phase.duration_s for phase in phases)
    left_s = (begin_s - in_s) % cycle_s
    for number, phase in enumerate(phases):
        if left_s < phase.duration_s:
            return number, phase.duration_s - left_s
        left_s -= phase.duration_s
    return 0, phases[0].duration_s


def time_signal(timing: SignalTiming, warm_up_s: float) -> None:
    """Sets a signal of the running simulation so that it follows the timing; step 0 is ``warm_up_s`` from now.

    Raises:
        MapError: the link is never red, or always.
    """
    signal = timing.signal_id
    _fix_cycle(signal)
    fixed = _programme(signal)
    phases = crossing_first(fixed, timing.link, timing.crossing)
    red = red_interval_s(phases, timing.link)
    if red is None:
        raise MapError(f"signal {signal}", "a programme in which the EMV's movement has both green and red")
    if phases != fixed:
        _set_cycle(signal, phases)
    phase, left_s = place_in_cycle(phases, red[0], warm_up_s + timing.red_from_s)
    libsumo.trafficlight.setPhase(signal, phase)
    libsumo.trafficlight.setPhaseDuration(signal, left_s)


def _programme(signal: str) -> list[SignalPhase]:
    return [SignalPhase(float(phase.duration), str(phase.state)) for phase in _logic(signal).phases]


def _logic(signal: str) -> Any:
    program = libsumo.trafficlight.getProgram(signal)
    return next(logic for logic in libsumo.trafficlight.getAllProgramLogics(signal) if logic.programID == program)


def _fix_cycle(signal: str) -> None:
    """Gives a signal whose programme follows its traffic one with a fixed cycle of the same phases."""
    logic = _logic(signal)
    if logic.type == _STATIC or not logic.phases:
        return
    greens = [min(max(phase.duration, phase.minDur), phase.maxDur) for phase in logic.phases]
    phases = [SignalPhase(float(s), str(phase.state)) for s, phase in zip(greens, logic.phases, strict=True)]
    if logic.type == _NEMA:
        times = _nema_times_s(signal, logic)
        named = zip((phase.name for phase in logic.phases), phases, strict=True)
        parts = {name: parts_of_nema_phase(phase, *times.get(name, _NEMA_TIMES_S)) for name, phase in named}
        ring1, ring2, ends, others, coordinated = (logic.subParameter.get(key, "").split(",") for key in _NEMA_KEYS)
        phases = nema_cycle(parts, (ring1, ring2), (*ends, *(others if any(others) else coordinated)))
    else:
        phases = [phases[number] for number in _first_round([phase.next for phase in logic.phases])]
    _set_cycle(signal, phases)


def _set_cycle(signal: str, phases: Sequence[SignalPhase]) -> None:
    fixed = [libsumo.trafficlight.Phase(phase.duration_s, phase.state) for phase in phases]
    libsumo.trafficlight.setProgramLogic(signal, libsumo.trafficlight.Logic("fixed", _STATIC, 0, fixed))


def _first_round(following: Sequence[Sequence[int]]) -> list[int]:
    """The phases of a programme from the first one until one comes again; ``following`` are those that may follow."""
    order = [0]
    while (then := (*following[order[-1]], (order[-1] + 1) % len(following))[0]) not in order:
        order.append(then)
    return order


def _nema_times_s(signal: str, logic: Any) -> dict[str, tuple[float, float]]:
    """Yellow and red times of the phases of a NEMA programme, by their names; only the net tells them."""
    net = fromstring(Path(libsumo.simulation.getOption("net-file")).read_bytes())
    yellow_s, red_s = _NEMA_TIMES_S
    return {
        phase.get("name", ""): (float(phase.get("yellow", yellow_s)), float(phase.get("red", red_s)))
        for programme in net.iterfind("tlLogic")
        if (programme.get("id"), programme.get("programID")) == (signal, logic.programID)
        for phase in programme.iterfind("phase")
    }


def parts_of_nema_phase(green: SignalPhase, yellow_s: float, red_s: float) -> tuple[SignalPhase, ...]:
    """The green, yellow and red of a phase that states the last two as times alone."""
    yellow = "".join("y" if letter in "Gg" else letter for letter in green.state)
    return green, SignalPhase(yellow_s, yellow), SignalPhase(red_s, "r" * len(green.state))


def nema_cycle(
    parts: Mapping[str, Sequence[SignalPhase]], rings: Sequence[Sequence[str]], barriers: Collection[str]
) -> list[SignalPhase]:
    """The fixed cycle of a NEMA programme: the phases of a ring one after the other, both rings at once.

    Args:
        parts: Green, yellow and red of each phase, by its name.
        rings: Names of the phases of each ring in their order; others are left out.
        barriers: Names of phases at whose ends the rings wait for each other. Between two barriers the last green of
            the shorter ring is longer.

    Source: National Electrical Manufacturers Association, Standard TS 2: dual-ring control; SUMO, "NEMA".
    """
    groups = [_between_barriers([name for name in ring if name in parts], barriers) for ring in rings]
    cycle: list[SignalPhase] = []
    for stretches in zip_longest(*groups, fillvalue=[]):
        lines = [[part for name in names for part in parts[name]] for names in stretches if names]
        longest_s = max(map(_length_s, lines), default=0.0)
        for line in lines:
            line[-3] = replace(line[-3], duration_s=line[-3].duration_s + longest_s - _length_s(line))
        cycle += _at_once(lines)
    return cycle


def _between_barriers(ring: Sequence[str], barriers: Collection[str]) -> list[list[str]]:
    """The phases of a ring by the barriers at which they end."""
    groups: list[list[str]] = [[]]
    for name in ring:
        groups[-1].append(name)
        if name in barriers:
            groups.append([])
    across_the_end = groups.pop()
    return [across_the_end + (groups[0] if groups else []), *groups[1:]]


def _length_s(phases: Sequence[SignalPhase]) -> float:
    return sum(phase.duration_s for phase in phases)


def _at_once(lines: Sequence[Sequence[SignalPhase]]) -> Iterator[SignalPhase]:
    """Programmes of one length that run at once, as one; a link has the letter that lets most vehicles drive."""
    ends = [list(accumulate(phase.duration_s for phase in line)) for line in lines]
    moments = sorted({round(end, 3) for line in ends for end in line})
    for begin, end in pairwise([0.0, *moments]):
        shown = [line[bisect_right(times, (begin + end) / 2.0)].state for line, times in zip(lines, ends, strict=True)]
        if end > begin:
            yield SignalPhase(
                end - begin, "".join(max(letters, key=_LETTERS.find) for letters in zip(*shown, strict=True))
            )


def yellow_after(phases: Sequence[SignalPhase], present: int, link: int) -> tuple[int, float] | None:
    """The next phase in which a link is yellow, and how long that lasts; None where it has none."""
    for step in range(len(phases)):
        number = (present + step) % len(phases)
        if phases[number].state[link].lower() == "y":
            return number, phases[number].duration_s
    return None


def detector_s(yellow_s: float) -> float:
    """Time before the stop line at which a vehicle that is the last of a platoon ends the green.

    It then drives on, as drivers do who see the yellow so late, and the red follows soon behind it.
    """
    return min(max(yellow_s - RED_BEHIND_S, 0.0), YELLOW_DRIVEN_S)


class GapOut:
    """Ends a link's green behind a platoon, as a signal with detectors does: neither before nor long after it.

    The vehicles of the platoon arrive earlier or later than planned: bends and others delay them. The green waits for
    the last of them for ``_LONGEST_GREEN_S`` at most, and not until the EMV is there.
    """

    def __init__(self, timing: SignalTiming) -> None:
        self._timing = timing
        self._waiting = bool(timing.platoon)
        self._least_red_s = BEFORE_EMV_S + (_CROSS_S if timing.crossing else 0.0)
        self._in_lane: dict[str, bool] = dict.fromkeys((*timing.platoon, *timing.beside), False)
        """Vehicles before the line, and whether each has been told to keep its lane."""
        self._steps = 0

    def apply(self, present: Collection[str]) -> None:
        """Acts on the signal before a step; ``present`` are the vehicles in SUMO."""
        self._keep_lanes(present)
        if not self._waiting:
            return
        signal, link = self._timing.signal_id, self._timing.link
        self._steps += 1
        arrivals = [time for name in self._timing.platoon if name in present for time in self._arrivals_s(name)]
        overdue = self._steps * STEP_S > self._timing.red_from_s + _LONGEST_GREEN_S
        state = str(libsumo.trafficlight.getRedYellowGreenState(signal))
        if not arrivals or overdue:
            self._waiting = False
        elif state[link].lower() == "g":
            phases, number = _programme(signal), int(libsumo.trafficlight.getPhase(signal))
            yellow = yellow_after(phases, number, link)
            if yellow is None:
                self._waiting = False
            elif self._is_over(max(arrivals), yellow[1], *self._emv_s(present)):
                libsumo.trafficlight.setPhase(signal, yellow[0])
                self._waiting = False
            elif libsumo.trafficlight.getNextSwitch(signal) - libsumo.simulation.getTime() <= STEP_S:
                libsumo.trafficlight.setPhaseDuration(signal, 2.0 * STEP_S)

    def _keep_lanes(self, present: Collection[str]) -> None:
        """Lets vehicles keep their lanes up to the line: on the way to others they would drive in front of the EMV."""
        for name in [name for name in self._in_lane if name in present]:
            before = bool(self._gaps_m(name))
            if before != self._in_lane[name]:
                libsumo.vehicle.setLaneChangeMode(name, KEEP_LANE_CHANGE_MODE if before else DEFAULT_LANE_CHANGE_MODE)
                self._in_lane[name] = before
            if not before:
                del self._in_lane[name]

    def _is_over(self, last_s: float, yellow_s: float, emv_s: float, leader: str) -> bool:
        """Whether the green ends: the last one is at its detector, or the EMV comes.

        The EMV slows down before a red. Where it follows the platoon in its lane, an early red would part them.
        """
        comes = emv_s <= yellow_s + self._least_red_s
        return comes or (leader not in self._timing.platoon and last_s <= detector_s(yellow_s))

    def _emv_s(self, present: Collection[str]) -> tuple[float, str]:
        """Least time in which the EMV reaches the signal, behind its leader at its speed, and the leader's name.

        Infinite once it has passed.
        """
        name = self._timing.emv
        gaps_m = self._gaps_m(name) if name in present else []
        if not gaps_m:
            return math.inf, ""
        mps = max(float(libsumo.vehicle.getSpeed(name)), _CREEP_MPS)
        leads = libsumo.vehicle.getLeader(name, gaps_m[0])
        if leads and leads[0] and leads[1] < gaps_m[0]:
            return gaps_m[0] / mps, str(leads[0])
        most_mps = float(libsumo.vehicle.getAllowedSpeed(name))
        soonest_s = self._timing.emv_from_s - self._steps * STEP_S
        return max(float(time_to_go_s(gaps_m[0], mps, most_mps, _EMV_MPS2)), soonest_s), ""

    def _arrivals_s(self, name: str) -> list[float]:
        """Time in which a vehicle reaches the signal at its present speed; empty once it has passed."""
        speed = max(float(libsumo.vehicle.getSpeed(name)), _CREEP_MPS)
        return [gap_m / speed for gap_m in self._gaps_m(name)]

    def _gaps_m(self, name: str) -> list[float]:
        signal, links = self._timing.signal_id, self._timing.approach
        ahead = libsumo.vehicle.getNextTLS(name)[:1]
        return [float(gap_m) for one, link, gap_m, _ in ahead if one == signal and (not links or link in links)]


# This is no parameter: it decides where a driver begins to stop at the end of the road.
_BRAKE_MPS2: Final = 1.5
_EARLIER_M: Final = 20.0
_END_M: Final = 1.0
"""Length of road that is left in front of the bumper at the end of a route."""
_FOR_GOOD_S: Final = 1e6


class RouteEnds:
    """Tells each EMV to stop at the end of its route once the end is near.

    An earlier order would influence its choice of lanes.
    """

    def __init__(self, emvs: Sequence[PlannedVehicle]) -> None:
        self._driving = {emv.name: emv.route for emv in emvs}

    def apply(self, present: Collection[str]) -> None:
        """Gives the orders for SUMO's next step; ``present`` are the vehicles in SUMO."""
        for name in [name for name in self._driving if name in present]:
            route = self._driving[name]
            if libsumo.vehicle.getRouteIndex(name) < len(route) - 1:
                continue
            end_m = libsumo.lane.getLength(libsumo.vehicle.getLaneID(name)) - _END_M
            speed_mps = libsumo.vehicle.getSpeed(name)
            left_m = end_m - libsumo.vehicle.getLanePosition(name)
            if left_m < braking_distance_m(speed_mps * speed_mps, _BRAKE_MPS2) + _EARLIER_M:
                libsumo.vehicle.setStop(name, route[-1], end_m, libsumo.vehicle.getLaneIndex(name), _FOR_GOOD_S)
                del self._driving[name]


class JamOrders:
    """Tells the head of a jam how fast to go."""

    def __init__(self, jam: JamHead) -> None:
        self._jam = jam

    def apply(self, step: int, present: Collection[str]) -> None:
        """Orders speeds for SUMO's next step, and withdraws the last order once the jam is over.

        ``step`` is the one that SUMO comes to next, ``present`` are the vehicles that SUMO drives; those that are moved
        from outside are left alone.
        """
        if step > 0 and self._jam.speed_mps(step - 1) < 0.0:
            return
        for name in self._jam.names:
            if name in present:
                libsumo.vehicle.setSpeed(name, self._jam.speed_mps(step))


_IGNORED: Final = "junctionModel.ignoreIDs"
"""SUMO's parameter for ignored vehicles; stand-offs and people at kerbs both add to it."""
_STANDING_MPS: Final = 0.1
_ON_JUNCTION: Final = int(TrafficFlags.ON_JUNCTION)
_BY_SUMO: Final = int(Owner.SUMO)

Passed = Mapping[str, frozenset[str]]
"""For each driver, the vehicles for which the driver need not wait any more, by SUMO's names."""


def drivers_who_go(
    before: Passed, traffic: TrafficState, vehicles: Mapping[int, PlannedVehicle], emvs: frozenset[str]
) -> Passed:
    """The drivers who go, for the next step. A driver who has begun goes on until the junction lies behind.

    ``traffic`` is the state before SUMO's next step, ``vehicles`` are those in it.
    """
    inside = (traffic.flags & _ON_JUNCTION) != 0
    stands, by_sumo = traffic.speed_mps < _STANDING_MPS, traffic.owner == _BY_SUMO
    still = frozenset(vehicles[actor_id].name for actor_id in traffic.actor_id[inside & stands & ~by_sumo].tolist())
    passed = still | emvs if still else still
    mine = inside & by_sumo
    going = {}
    for actor_id, waits in zip(traffic.actor_id[mine].tolist(), stands[mine].tolist(), strict=True):
        name = vehicles[actor_id].name
        if earlier := before.get(name, passed if waits else None):
            going[name] = earlier | passed
    return going


class IgnoredFoes:
    """Tells SUMO which vehicles and people its drivers ignore on junctions."""

    def __init__(self) -> None:
        self._told: dict[str, str] = {}

    def apply(self, drivers: Sequence[str], by_all: Sequence[str], by_driver: Mapping[str, frozenset[str]]) -> None:
        """Tells SUMO the changes since the last call.

        ``drivers`` are SUMO's names of all vehicles, ``by_all`` those for whom none of them waits, ``by_driver`` those
        for whom single drivers do not wait either.
        """
        if not (by_all or by_driver or self._told):
            return
        everybody, told = " ".join(by_all), {}
        for driver in drivers:
            own = by_driver.get(driver)
            names = " ".join((*by_all, *sorted(own))) if own else everybody
            if names != self._told.get(driver, ""):
                libsumo.vehicle.setParameter(driver, _IGNORED, names)
            if names:
                told[driver] = names
        self._told = told


class StandOffs:
    """Tells SUMO's drivers for whom they need not wait: those in a stand-off, and all for people at kerbs."""

    def __init__(self, emvs: frozenset[str] | None) -> None:
        """Takes the EMVs that run red lights; with None no stand-off is looked for."""
        self._emvs = emvs
        self._going: Passed = {}
        self._foes = IgnoredFoes()

    def apply(
        self,
        last: TrafficState | None,
        vehicles: Mapping[int, PlannedVehicle],
        drivers: Sequence[str],
        at_kerbs: Sequence[str],
    ) -> None:
        """Gives the orders for SUMO's next step.

        ``last`` is the state before it, with ``vehicles``; ``drivers`` are all in SUMO.
        """
        if self._emvs is not None and last is not None:
            self._going = drivers_who_go(self._going, last, vehicles, self._emvs)
        self._foes.apply(drivers, at_kerbs, self._going)
