"""Monitors of ordinary traffic, and of sirens from other directions than from behind.

Rules of the road bind a driver whether or not an emergency vehicle comes: the limit, the road, stop lines, the right
of way, junctions, progress. A siren that comes across, from ahead or to the junction on which a driver stands asks for
the way as one from behind does.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
import shapely

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S, steps_from_s
from siren_ros.base.tables import Measure
from siren_ros.data.recording.episode_record import StateRows
from siren_ros.data.tracks import ALIGNED_RAD, ahead_and_left_m
from siren_ros.reports.exam.examinee import (
    LASTING_S,
    Crossing,
    Examinee,
    Movement,
    held_for,
    lasting_deceleration_mps2,
    movements_of,
    once,
    stretches,
)
from siren_ros.reports.exam.finding import (
    MPS,
    STANDS_MPS,
    Finding,
    M,
    Monitor,
    Numbers,
    S,
    first_step,
    greatest,
    least_of_last,
    longest,
)
from siren_ros.scoring.judging.surrogate_safety import Encroachment
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind
from siren_ros.simulation.roads.routing import has_right_of_way
from siren_ros.simulation.world.actors import TURN_LIGHTS, EventKind, Lights

_AT_LINE_M: Final = 10.0
"""A driver stops at a line where it stands within this way before it: a car's length, and one in front of it."""
_LATER_S: Final = 60.0
"""Stands for a post-encroachment time where somebody with the right of way went first."""
_RANKS: Final[Mapping[str, int]] = {"G": 2, "y": 2, "Y": 2, "g": 1}
"""Right of way by SUMO's letters of signals; who enters at yellow clears the junction before others."""


def speeding(examinee: Examinee, numbers: Numbers) -> Finding:
    """Greatest speed above the limit of the lane that lasts for ``lasting_s``; junctions do not count."""
    limit = _limit_mps(examinee)
    over = least_of_last(examinee.track.speed_mps - limit, steps := steps_from_s(numbers["lasting_s"]))
    over[:steps] = 0.0  # it has not lasted
    on_road = np.isfinite(limit) & ~examinee.in_junction
    return greatest(examinee, np.maximum(over, 0.0), on_road, "the driver was on no lane")


def _limit_mps(examinee: Examinee) -> Floats:
    """Limit of the driver's lane; infinite off the lanes."""
    lanes = examinee.record.network.lanes
    return np.array([np.inf if lane == NO_LANE else lanes[lane].speed_limit_mps for lane in examinee.places.lane])


def passes_standing(examinee: Examinee, numbers: Numbers) -> Finding:
    """Greatest speed above the prudent one next to an EMV that has stood for ``stands_s`` with lamps but no siren.

    The prudent speed is ``below_mps`` under the limit, and at least ``least_mps``. The EMV is next to the driver while
    the bodies overlap along the road and the centres are at most ``aside_m`` apart across it.
    """
    passes = np.zeros(len(examinee.track), np.bool_)
    for emv_id in examinee.record.emv_ids:
        there, own, emv = examinee.with_emv(emv_id)
        ahead, left = ahead_and_left_m(own, emv)
        reach_m = 0.5 * (examinee.actor.length_m + examinee.record.actors[emv_id].length_m)
        lit = (emv.lights & (Lights.BEACON | Lights.SIREN)) == Lights.BEACON
        stands = held_for(lit & (emv.speed_mps < STANDS_MPS), steps_from_s(numbers["stands_s"]))
        passes[there] |= stands & (np.abs(ahead) < reach_m) & (np.abs(left) < numbers["aside_m"])
    prudent = np.maximum(_limit_mps(examinee) - numbers["below_mps"], numbers["least_mps"])
    over = np.maximum(examinee.track.speed_mps - prudent, 0.0)
    return greatest(examinee, over, passes, "it passed no emergency vehicle that stood with its lamps")


def reserved_lane(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Longest time, after that to respond, on a lane closed to ordinary vehicles while an EMV calls."""
    lanes = [None if lane == NO_LANE else examinee.record.network.lanes[lane] for lane in examinee.places.lane.tolist()]
    closed = [lane is not None and lane.kind is LaneKind.DRIVING and not lane.civilian_allowed for lane in lanes]
    there = np.array(closed, np.bool_) & examinee.called
    if not there.any():
        return Finding(Measure.lacking("no emergency vehicle called on a lane for some vehicles only"))
    late = held_for(there, examinee.reaction_steps)
    return longest(examinee, late)


def turn_signal(examinee: Examinee, numbers: Numbers) -> Finding:
    """Greatest way, of the last ``before_m`` before a turn at a junction, without the indicator of its side.

    Turns within ``after_s`` of an EMV's call do not count: making way has signals of its own.
    """
    track, worst = examinee.track, Finding(Measure.lacking("the driver turned nowhere"))
    way_m = np.diff(track.driven_m, append=track.driven_m[-1:])
    asked = once(examinee.called, steps_from_s(numbers["after_s"]))
    for row, _, own in movements_of(examinee.record, track, examinee.places):
        before = (track.driven_m >= track.driven_m[row] - numbers["before_m"]) & (np.arange(len(track)) < row)
        if own.direction not in TURN_LIGHTS or asked[before].any():
            continue
        dark = before & ((track.lights & TURN_LIGHTS[own.direction]) == 0)
        dark_m = float(way_m[dark].sum())
        if not worst.measure.valid or dark_m > worst.measure.value:
            worst = Finding(Measure(dark_m), first_step(examinee, dark))
    return worst


def off_road(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Longest time for which the driver's centre is on no lane of its direction and on no junction."""
    off = examinee.places.lane == NO_LANE
    if off.any():
        outlines = [one.outline for one in examinee.record.network.junctions.values() if len(one.outline) > 2]
        junctions = shapely.union_all([shapely.Polygon(outline).buffer(0.0) for outline in outlines])
        off[off] = ~shapely.contains_xy(junctions, examinee.track.x_m[off], examinee.track.y_m[off])
    return longest(examinee, off)


def past_stop_sign(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Greatest of the least speeds with which the driver came to lines with a stop sign."""
    track, worst = examinee.track, Finding(Measure.lacking("the driver crossed no line with a stop sign"))
    for event in examinee.record.events_of(EventKind.STOP_LINE_CROSSED):
        if event.actor_id == examinee.actor.actor_id and event.detail.get("must_stop"):
            row = min(int(np.searchsorted(track.step, event.step)), len(track) - 1)
            near = (track.driven_m >= track.driven_m[row] - _AT_LINE_M) & (track.step <= event.step)
            least = float(track.speed_mps[near].min())
            if not worst.measure.valid or least > worst.measure.value:
                worst = Finding(Measure(least), event.step)
    return worst


def _goes_first(examinee: Examinee, crossing: Crossing) -> bool:
    """Whether the other one has the right of way: an EMV with its siren, or by signal, sign or side."""
    actor_id, _, track, (row, _, own), (its_row, _, other) = crossing
    if examinee.record.actors[actor_id].is_emv and track.lights[its_row] & Lights.SIREN:
        return True
    if own.signal_id is None:
        return has_right_of_way(examinee.record.network, own, other)
    states = examinee.record.signal_states(own.signal_id)
    letters = (
        own.letter_in(states.get(int(examinee.track.step[row]), "")),
        other.letter_in(states.get(int(track.step[its_row]), "")),
    )
    return _RANKS.get(letters[0], 0) < _RANKS.get(letters[1], 0)


_NOBODY_FIRST: Final = "nobody with the right of way crossed its way"


def right_of_way(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Least time before somebody with the right of way that the driver had left the place where both ways cross.

    An EMV with its siren has it; others have it by the signal, by signs, or as they come from the right.
    """
    others = [crossing for crossing in examinee.crossings if _goes_first(examinee, crossing)]
    if not others:
        return Finding(Measure.lacking(_NOBODY_FIRST))
    times = [one.time_s if one.subject_first else _LATER_S for _, one, *_ in others]
    worst = int(np.argmin(times))
    return Finding(Measure(times[worst]), others[worst][1].step, examinee.named(others[worst][0]))


def forced_braking(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Hardest lasting deceleration of somebody with the right of way while the driver crosses its way before it."""
    worst = Finding(Measure.lacking(_NOBODY_FIRST))
    for crossing in examinee.crossings:
        actor_id, encounter, track, (begin, end, _), _ = crossing
        if not _goes_first(examinee, crossing):
            continue
        braked = lasting_deceleration_mps2(track, LASTING_S)
        steps = track.step[: len(braked)]
        crossed = (steps >= examinee.track.step[begin]) & (steps <= examinee.track.step[end - 1])
        hardest = float(braked[crossed].max(initial=0.0)) if encounter.subject_first else 0.0
        if not worst.measure.valid or hardest > worst.measure.value:
            worst = Finding(Measure(hardest), int(examinee.track.step[begin]), examinee.named(actor_id))
    return worst


def _waits(examinee: Examinee, movement: Movement) -> bool:
    """Whether a movement waits for others on the junction, as one to the left at a green signal does.

    Others wait before a sign's line.
    """
    row, _, own = movement
    if own.signal_id is None:
        return own.gives_way and not own.must_stop
    return own.letter_in(examinee.record.signal_states(own.signal_id).get(int(examinee.track.step[row]), "")) == "g"


def blocks_junction(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Longest time for which the driver stands on a junction that it entered; there to give way does not count."""
    crossed = movements_of(examinee.record, examinee.track, examinee.places)
    if not crossed:
        return Finding(Measure.lacking("the driver crossed no junction"))
    inside = np.zeros(len(examinee.track), np.bool_)
    for movement in crossed:
        inside[movement[0] : movement[1]] = not _waits(examinee, movement)
    stands = inside & (examinee.track.speed_mps < STANDS_MPS)
    return longest(examinee, stands)


def stands_in_junction(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Longest time for which the driver stands in a junction while an EMV is heard that drives towards it.

    The EMV may come from any direction.
    """
    comes = np.zeros(len(examinee.track), np.bool_)
    for emv_id in examinee.record.emv_ids:
        there, own, emv = examinee.with_emv(emv_id)
        ahead, left = ahead_and_left_m(emv, own)
        heard = examinee.distance_m(emv_id) <= examinee.heard_m
        comes[there] |= heard[there] & (ahead > 0.0) & (np.abs(left) < ahead)
    if not comes.any():
        return Finding(Measure.lacking("no emergency vehicle with a siren came towards the driver"))
    stands = comes & examinee.in_junction & (examinee.track.speed_mps < STANDS_MPS)
    return longest(examinee, stands)


def enters_before_siren(examinee: Examinee, numbers: Numbers) -> Finding:
    """Greatest way that the driver had left to stop when it noticed an EMV, and then entered the junction before it.

    The EMV comes from another road, and crosses the driver's way at most ``soon_s`` after it, or would have done so had
    it kept its speed. The way to stop is that of the time to respond and of braking with ``brakes_mps2``.
    """
    track, worst = examinee.track, Finding(Measure.lacking("no emergency vehicle with a siren came across"))
    for actor_id, encounter, other, (row, _, _), _ in examinee.crossings:
        distance = examinee.distance_m(actor_id) if examinee.record.actors[actor_id].is_emv else None
        if distance is None or not np.isfinite(distance).any():
            continue
        heard, spare = distance[: row + 1] <= examinee.heard_m, 0.0
        after_s = min(encounter.time_s, _unhindered_s(encounter, other, int(track.step[row])))
        if heard[-1] and encounter.subject_first and after_s <= numbers["soon_s"]:
            noticed = stretches(heard)[-1][0]
            speed = float(track.speed_mps[noticed])
            stop_m = speed * examinee.reaction_steps * STEP_S + 0.5 * speed**2 / numbers["brakes_mps2"]
            spare = max(float(track.driven_m[row] - track.driven_m[noticed]) - stop_m, 0.0)
        if not worst.measure.valid or spare > worst.measure.value:
            worst = Finding(Measure(spare), int(track.step[row]), examinee.named(actor_id))
    return worst


def _unhindered_s(encounter: Encroachment, other: StateRows, entered: int) -> float:
    """Post-encroachment time to somebody who keeps the speed of the step at which the driver entered the junction."""
    here, there = np.searchsorted(other.step, (entered, encounter.step)).clip(max=len(other) - 1).tolist()
    way_m, speed_mps = float(other.driven_m[there] - other.driven_m[here]), float(other.speed_mps[here])
    arrives_s = way_m / speed_mps if speed_mps > STANDS_MPS else np.inf
    return arrives_s - (encounter.step - entered) * STEP_S + encounter.time_s


def before_oncoming(examinee: Examinee, numbers: Numbers) -> Finding:
    """Greatest speed of the driver before an EMV that comes from ahead, after the time to respond and to stop.

    It counts while the EMV is within ``gap_m`` and its centre at most ``aside_m`` to the side, and where the driver is
    not at the right edge of the road.
    """
    counts, came = np.zeros(len(examinee.track), np.bool_), np.zeros(len(examinee.track), np.bool_)
    for emv_id in examinee.record.emv_ids:
        there, own, emv = examinee.with_emv(emv_id)
        ahead, left = ahead_and_left_m(own, emv)
        against = np.abs(wrap_angle(emv.yaw_rad - own.yaw_rad)) > np.pi - ALIGNED_RAD
        near = np.zeros(len(examinee.track), np.bool_)
        near[there] = against & (ahead > 0.0) & (np.abs(left) < numbers["aside_m"])
        near &= examinee.distance_m(emv_id) <= numbers["seen_m"]
        came |= near
        settled = held_for(near, examinee.reaction_steps + steps_from_s(numbers["stop_s"]))
        counts |= settled & (examinee.distance_m(emv_id) <= numbers["gap_m"])
    counts &= ~examinee.in_junction
    lack = "it came too briefly" if came.any() else "no emergency vehicle with a siren came from ahead"
    speed = np.where(examinee.room.right_m <= numbers["edge_m"], 0.0, examinee.track.speed_mps)
    return greatest(examinee, speed, counts, lack)


def progress(examinee: Examinee, numbers: Numbers) -> Finding:
    """The driver's way as a share of that of the paper's driver in its place, in the time without an EMV.

    Time in which an EMV with its siren calls the driver or is within ``near_m`` does not count, nor that close behind
    somebody or before a line where its signal is not green, nor the ``after_s`` after it.
    """
    if examinee.paper is None:
        return Finding(Measure.lacking("there is no episode with the paper's driver"))
    near = [examinee.distance_m(emv_id) <= numbers["near_m"] for emv_id in examinee.record.emv_ids]
    busy = examinee.track.step[np.any([*near, examinee.called, _has_to_wait(examinee)], axis=0)]
    steps = range(examinee.track.step[0], min(one.record.states[-1].step for one in (examinee, examinee.paper)) + 1)
    free = np.full(len(steps), True)
    for later in range(steps_from_s(numbers["after_s"]) + 1):
        free[np.minimum(busy - steps.start + later, len(free) - 1)] = False
    ways = []
    for track in (examinee.track, examinee.paper.track):
        rows = np.isin(track.step, steps)
        way = np.zeros(len(steps))
        way[track.step[rows] - steps.start] = track.speed_mps[rows] * STEP_S
        ways.append(float(way[free].sum()))
    if ways[1] < numbers["least_m"]:
        return Finding(Measure.lacking("an emergency vehicle was near, or the paper's driver did not get on, either"))
    return Finding(Measure(ways[0] / ways[1]))


_FOLLOWS_M: Final = 20.0
"""Gap up to which a driver follows somebody: a headway of 1.4 s at 50 km/h."""
_STOPS_M: Final = 50.0
"""Way before a line on which a driver slows down for it: that from 50 km/h with 2 m/s²."""
_NOT_GREEN: Final = frozenset("rRyYuU")


def _has_to_wait(examinee: Examinee) -> Flags:
    """Whether the driver follows somebody closely, or comes to a line at which a signal is not green."""
    network, room = examinee.record.network, examinee.room
    waits = np.isfinite(room.ahead_mps) & (room.ahead_m < _FOLLOWS_M)
    for row in np.flatnonzero(~waits & (room.ahead_m < _STOPS_M)).tolist():
        for way in network.connections_from.get(int(examinee.places.lane[row]), ()):
            if way.signal_id is not None:
                state = examinee.record.signal_states(way.signal_id).get(int(examinee.track.step[row]), "")
                waits[row] |= way.letter_in(state) in _NOT_GREEN
    return np.asarray(waits, np.bool_)


def evades(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Time for which EMVs called the paper's driver in the driver's place, where none came near the driver.

    A driver that flees, leaves its route or parks elsewhere has not been asked. One that waits for a siren from across
    may not be called from behind afterwards, but hears it.
    """
    paper = examinee.paper
    if paper is None or not paper.called.any():
        return Finding(Measure.lacking("no emergency vehicle called the paper's driver, or it did not drive"))
    heard = any((examinee.distance_m(one) <= examinee.heard_m).any() for one in examinee.record.emv_ids)
    return Finding(Measure(0.0 if heard or examinee.called.any() else float(paper.called.sum()) * STEP_S))


RULES: Final[Mapping[str, Monitor]] = {
    "speeding": Monitor(speeding, "m/s", "speed above the limit", {"lasting_s": S}),
    "passes_standing": Monitor(
        passes_standing,
        "m/s",
        "speed above the prudent one next to a standing EMV",
        {"stands_s": S, "below_mps": MPS, "least_mps": MPS, "aside_m": M},
    ),
    "reserved_lane": Monitor(reserved_lane, "s", "time on a reserved lane before the EMV", {}, asks_to_act=True),
    "turn_signal": Monitor(turn_signal, "m", "way before a turn without the indicator", {"before_m": M, "after_s": S}),
    "off_road": Monitor(off_road, "s", "time off the road", {}),
    "stop_sign": Monitor(past_stop_sign, "m/s", "least speed at a stop sign", {}),
    "right_of_way": Monitor(right_of_way, "s", "time before somebody with the right of way", {}),
    "forced_braking": Monitor(forced_braking, "m/s²", "braking of somebody with the right of way", {}),
    "blocks_junction": Monitor(blocks_junction, "s", "time standing on a junction", {}),
    "stands_in_junction": Monitor(stands_in_junction, "s", "time standing in a junction before the EMV", {}),
    "enters_before_siren": Monitor(
        enters_before_siren,
        "m",
        "way left to stop as it noticed the EMV",
        {"soon_s": S, "brakes_mps2": (0.5, 10.0)},
        asks_to_act=True,
    ),
    "before_oncoming": Monitor(
        before_oncoming,
        "m/s",
        "greatest speed before an EMV from ahead",
        {"gap_m": M, "aside_m": M, "edge_m": M, "seen_m": (0.0, 500.0), "stop_s": S},
        asks_to_act=True,
    ),
    "progress": Monitor(
        progress,
        "of the way",
        "way compared with the paper's driver",
        {"near_m": (0.0, 500.0), "after_s": S, "least_m": M},
    ),
    "evades": Monitor(evades, "s", "time for which only the paper's driver was called", {}),
}
"""The monitors of this file by the names that rulebooks use."""
