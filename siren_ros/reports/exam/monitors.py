"""The monitors: one number of a driver's conduct for each clause of a rulebook, with the moment that decides it.

A monitor takes the driver and the clause's numbers, and gives a value or the reason why the clause does not apply.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from siren_ros.base.numerics.braking import safe_following_mps
from siren_ros.base.numerics.units import STEP_S, steps_from_s
from siren_ros.base.tables import Measure
from siren_ros.data.tracks import ahead_and_left_m
from siren_ros.reports.exam.examinee import Examinee, held_for, lasting_deceleration_mps2, once, rises, since, stretches
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
from siren_ros.reports.exam.rules import RULES
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, LaneKind
from siren_ros.simulation.roads.routing import is_out_of_town, rescue_boundary_m, rescue_sides
from siren_ros.simulation.world.actors import Event, EventKind, Lights

_NOBODY_CALLED: Final = "no emergency vehicle with a siren came from behind"
_AT_EDGE_M: Final = 1.0
"""A driver with less space than this on its right is at the edge of the road."""
_RED: Final = frozenset("rR")
_OWN_DOING_MPS: Final = 0.5
_IDLES_MPS2: Final = 0.2
_STAYS_S: Final = 1.0
"""A driver that is slower by this than it could follow and accelerates less, for this time, does not only follow."""
_DISTANCE_S: Final = 1.5
_DISTANCE_M: Final = 3.0
"""Distance in time and at a standstill, and braking, of somebody who follows."""
_GENTLE_MPS2: Final = 2.0
_GO_ON_M: Final = 6.0
_RIGHT_AHEAD_M: Final = 40.0
"""Distance from a driver's rear to the front of an EMV that has passed it, within which the EMV keeps it from driving
on."""
_MOVES_MPS: Final = 0.15
_MOVED_S: Final = 1.0
"""Speed to the side, and how lately, of a driver that moves there."""
_GOES_M: Final = 0.1
"""Way to the right in a second of a driver that goes to the edge, also where a queue lets it roll slowly only."""
_SETTLES_S: Final = 1.5
"""Time that a driver has to stop once it has reached the edge."""


def contact(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Greatest speed with which the driver and somebody else touched; below 0 where nobody did."""
    own = examinee.actor.actor_id
    events = [
        event for event in examinee.record.events_of(EventKind.COLLISION) if own in {event.actor_id, event.other_id}
    ]
    hardest = max(events, key=_impact_mps, default=None)
    if hardest is None:
        return Finding(Measure(-1.0))
    other = hardest.other_id if hardest.actor_id == own else hardest.actor_id
    return Finding(Measure(_impact_mps(hardest)), hardest.step, examinee.named(other))


def _impact_mps(event: Event) -> float:
    return float(event.detail["impact_speed_mps"])


def response(examinee: Examinee, numbers: Numbers) -> Finding:
    """Longest time from an EMV's call to the driver's first response: slower, or to the side; or until it has passed.

    To follow somebody who slows down is no response: a driver that responds is slower than the safe speed behind the
    vehicle ahead (Krauß 1998), and does not get faster. Only time in which the EMV calls counts. Time in which a driver
    can go neither slower than somebody close ahead nor aside does not count, nor time in a junction, which it clears
    first. Nobody has to respond while it stands or almost does, whose way the EMV does not need (``aside_m``), or
    whom another EMV calls already.
    """
    track, room, worst = examinee.track, examinee.room, Finding(Measure.lacking(_NOBODY_CALLED))
    free = (room.ahead_mps == np.inf) | (room.ahead_m > track.speed_mps * _DISTANCE_S + _DISTANCE_M)
    ahead = zip(room.ahead_mps.tolist(), np.maximum(room.ahead_m - _DISTANCE_M, 0.0).tolist(), strict=True)
    safe_mps = np.array([safe_following_mps(speed, spare_m, _GENTLE_MPS2, _DISTANCE_S) for speed, spare_m in ahead])
    below = (track.speed_mps <= safe_mps - _OWN_DOING_MPS) & (track.accel_mps2 < _IDLES_MPS2)
    for call in examinee.calls:
        begin, drives = int(np.argmax(call.calls)), call.calls & (track.speed_mps >= numbers["slower_mps"])
        if any(begin and other.calls[begin - 1] for other in examinee.calls if other is not call):
            continue  # # another EMV called before, so the driver makes way already
        if not drives.any() or abs(call.left_m[begin]) > numbers["aside_m"]:
            if not worst.measure.valid:
                worst = Finding(Measure.lacking("the driver stood, or the way was free"))
            continue
        asked = int(np.argmax(drives))
        until = slice(asked, begin + int(np.argmax(call.passed[begin:])) if call.passed.any() else None)
        shift = np.abs(examinee.offsets.lateral_m[until] - examinee.offsets.lateral_m[begin])
        stays = held_for(below | (call.gap_m <= 0.0), steps_from_s(_STAYS_S))
        by_itself = np.concatenate((stays, np.zeros(steps_from_s(_STAYS_S), np.bool_)))[-len(track) :]
        slower = by_itself[until] & (track.speed_mps[until] <= track.speed_mps[asked] - numbers["slower_mps"])
        responded = (shift >= numbers["shift_m"]) | slower | (track.speed_mps[until] < STANDS_MPS)
        first = int(np.argmax(responded)) if responded.any() else len(responded)
        able = ((free | (room.right_m > _AT_EDGE_M)) & ~examinee.in_junction & call.calls)[until]
        rows = int(able[:first].sum())
        if not worst.measure.valid or rows * STEP_S > worst.measure.value:
            worst = Finding(Measure(rows * STEP_S), int(track.step[asked]))
    return worst


def obstruction(examinee: Examinee, numbers: Numbers) -> Finding:
    """Time for which an EMV stood or crept closely behind the driver, who was in its way.

    A driver at the edge of the road has done its part, also one in the leftmost of several lanes at most
    ``left_line_m`` from its left line. One between others can do none: there has to be space on the right or ahead for
    the time to respond, since those who follow each other leave space for a moment.
    """
    if not examinee.calls:
        return Finding(Measure.lacking(_NOBODY_CALLED))
    held = np.zeros(len(examinee.track), np.bool_)
    for call in examinee.calls:
        apart = 0.5 * (examinee.actor.width_m + examinee.record.actors[call.emv_id].width_m)
        close = call.calls & (call.gap_m <= numbers["gap_m"]) & (call.gap_m > 0.0)
        held |= close & (np.abs(call.left_m) < apart) & (call.speed_mps < numbers["slow_mps"])
    ahead_m = least_of_last(examinee.room.ahead_m, examinee.reaction_steps)
    held &= (examinee.to_right_edge_m > _AT_EDGE_M) & (examinee.to_left_line_m > numbers["left_line_m"])
    held &= (least_of_last(examinee.room.right_m, examinee.reaction_steps) > _AT_EDGE_M) | (ahead_m > _GO_ON_M)
    return Finding(Measure(float(held.sum()) * STEP_S), first_step(examinee, held))


def right_edge(examinee: Examinee, numbers: Numbers) -> Finding:
    """Greatest space that the driver leaves on its right for ``move_s`` while an EMV passes it.

    The space ends at the edge of the road or at a vehicle in between. The time to respond does not count, nor time in
    which the driver still goes there, or in which a queue hems it in.
    """
    beside = np.any([call.beside for call in examinee.calls], axis=0) if examinee.calls else np.zeros(0, np.bool_)
    if not beside.any():
        return Finding(
            Measure.lacking("no emergency vehicle with a siren passed" if examinee.calls else _NOBODY_CALLED)
        )
    steps = steps_from_s(numbers["move_s"])
    lateral, second = examinee.offsets.lateral_m, steps_from_s(1.0)
    before = np.concatenate((np.full(second, lateral[0]), lateral))[: len(lateral)]
    goes_there = before - lateral >= _GOES_M
    settled = held_for(examinee.called, examinee.reaction_steps + steps)
    counts = beside & settled & ~(examinee.in_junction | goes_there | examinee.room.hemmed)
    return greatest(examinee, least_of_last(examinee.room.right_m, steps), counts, "it came at once, or in a junction")


def stands_until_passed(examinee: Examinee, numbers: Numbers) -> Finding:
    """Greatest speed while an EMV is near behind the driver or next to it, after the time to respond and to stop.

    In a junction, and where it has just left one, a driver clears it first. One that moves to the right, or that
    others keep from the edge, drives on until it is there.
    """
    if not examinee.calls:
        return Finding(Measure.lacking(_NOBODY_CALLED))
    near = examinee.called & (examinee.nearest_gap_m <= numbers["gap_m"])
    stop = steps_from_s(numbers["stop_s"])
    settled = held_for(examinee.called, examinee.reaction_steps + stop)
    clear = ~once(examinee.in_junction, stop)
    moves = once(examinee.aside_mps < -_MOVES_MPS, steps_from_s(_MOVED_S))
    at_edge = examinee.to_right_edge_m <= _AT_EDGE_M
    could = least_of_last(examinee.room.right_m - examinee.to_right_edge_m, stop) > -_AT_EDGE_M
    there = held_for((at_edge | could) & ~moves, steps_from_s(_SETTLES_S))
    counts = near & settled & clear & there
    return greatest(
        examinee, examinee.track.speed_mps, counts, "the siren sounded too briefly, or the way was not free"
    )


def moves_off_before_the_last(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Way that the driver drives after an EMV has passed it while another one calls."""
    passed = [call.passed for call in examinee.calls]
    if not passed or not np.any(passed):
        return Finding(Measure.lacking("no emergency vehicle with a siren passed" if passed else _NOBODY_CALLED))
    between = np.any(passed, axis=0) & examinee.called & ~examinee.in_junction
    if not between.any():
        return Finding(Measure.lacking("no other one followed"))
    moved = np.diff(examinee.track.driven_m, append=examinee.track.driven_m[-1:])
    # Way that the driver needs to stop again does not count.
    counts = between & held_for(examinee.called, examinee.reaction_steps)
    return Finding(Measure(float(moved[counts].sum())), first_step(examinee, counts & (moved > STANDS_MPS * STEP_S)))


def beyond_red_line(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Greatest way that the driver's front goes beyond a stop line while the signal is red for its movement."""
    own = [e for e in examinee.record.events_of(EventKind.STOP_LINE_CROSSED) if e.actor_id == examinee.actor.actor_id]
    signalled = [(event, connection) for event in own if (connection := _movement(examinee, event)) is not None]
    if not signalled:
        return Finding(Measure.lacking("the driver crossed no line with a signal"))
    worst = Finding(Measure(0.0))
    for event, connection in signalled:
        states = examinee.record.signal_states(str(connection.signal_id))
        first = int(np.searchsorted(examinee.track.step, event.step))
        row = first
        while row < len(examinee.track) and connection.letter_in(states.get(int(examinee.track.step[row]), "")) in _RED:
            row += 1
        way = examinee.track.driven_m[min(row, len(examinee.track) - 1)] - examinee.track.driven_m[first]
        if row > first and way > worst.measure.value:
            worst = Finding(Measure(float(way)), event.step)
    return worst


def _movement(examinee: Examinee, event: Event) -> Connection | None:
    """The signalled movement of the driver that an event is about; None without a signal."""
    asked = str(event.detail.get("junction", "")), str(event.detail.get("direction", ""))
    row = min(int(np.searchsorted(examinee.track.step, event.step)), len(examinee.track) - 1)
    lanes = set(examinee.places.lane[max(row - 20, 0) : row + 1].tolist())
    found = [
        connection
        for _, connection in examinee.record.network.connections_at.get(asked[0], ())
        if connection.direction == asked[1] and connection.signal_id is not None
    ]
    return max(found, key=lambda connection: connection.from_lane in lanes, default=None)


def without_indicator(examinee: Examinee, numbers: Numbers) -> Finding:
    """Number of moves to the side, on the road, without the indicator of that side before or as they began."""
    lateral, rate = examinee.offsets.lateral_m, examinee.aside_mps
    missed, first, seen = 0, None, False
    for side, light in ((1.0, Lights.INDICATOR_LEFT), (-1.0, Lights.INDICATOR_RIGHT)):
        moves = (side * rate > numbers["least_mps"]) & ~examinee.in_junction
        shown = once((examinee.track.lights & light) != 0, steps_from_s(numbers["before_s"]))
        for begin, end in stretches(moves):
            if side * (lateral[end - 1] - lateral[begin]) < numbers["least_m"]:
                continue
            seen, late = True, min(end, begin + steps_from_s(numbers["late_s"]))
            if not shown[begin : late + 1].any():
                missed += 1
                first = (
                    int(examinee.track.step[begin]) if first is None else min(first, int(examinee.track.step[begin]))
                )
    return Finding(Measure(float(missed)), first) if seen else Finding(Measure.lacking("the driver did not move aside"))


def braking(examinee: Examinee, numbers: Numbers) -> Finding:
    """Hardest deceleration that lasts for ``lasting_s``; of the whole drive."""
    lasting = lasting_deceleration_mps2(examinee.track, numbers["lasting_s"])
    if not len(lasting):
        return Finding(Measure.lacking("the drive was too short"))
    worst = int(np.argmax(lasting))
    return Finding(Measure(max(float(lasting[worst]), 0.0)), int(examinee.track.step[worst]))


def time_to_collision(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Least time to collision with anybody, within the horizon of 3 s.

    A driver that drives answers for whoever is ahead of it; for others next to and behind it only while it moves to the
    side, and not for those from whom it moves away.
    """
    pairs, contacts = examinee.conflict_series
    ahead_m, left_m = ahead_and_left_m(pairs.subject, pairs.other)
    rows = np.searchsorted(examinee.track.step, pairs.step)
    drives, aside_mps = examinee.track.speed_mps >= STANDS_MPS, examinee.aside_mps[rows]
    apart_m = 0.5 * (pairs.subject_size_m[1] + pairs.other_size_m[:, 1])
    away = (left_m * aside_mps < 0.0) & (np.abs(left_m) > apart_m)
    moves = (np.abs(aside_mps) > _MOVES_MPS) & ~away
    times = np.where((drives[rows] & (ahead_m > 0.0)) | moves, contacts.time_s, np.inf)
    if not np.isfinite(times).any():
        return Finding(Measure.lacking("nobody was near"))
    worst = int(np.argmin(times))
    return Finding(Measure(float(times[worst])), int(pairs.step[worst]))


def encroachment(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Least time for which somebody else had left the place that the driver then came to (post-encroachment time)."""
    found = [
        pair.encroachment
        for pair in examinee.conflicts
        if pair.encroachment is not None and not pair.encroachment.subject_first
    ]
    least = min(found, key=lambda one: one.time_s, default=None)
    if least is None:
        return Finding(Measure.lacking("nobody crossed its way before it"))
    return Finding(Measure(least.time_s), least.step)


def return_to_lane(examinee: Examinee, numbers: Numbers) -> Finding:
    """Time from the last EMV's passing until the driver is in the middle of a lane and drives.

    One that stands behind others or at the end of its lane drives on as it can; there, to the side of the middle, it
    cannot turn back, and that time does not count. Nor does time in which the EMV stands right ahead, or sounds its
    siren within ``near_m``. Where the record ends before, the time until there, if
    that is longer than ``waits_s``.
    """
    if not any(call.passed.any() for call in examinee.calls):
        return Finding(
            Measure.lacking("no emergency vehicle with a siren passed" if examinee.calls else _NOBODY_CALLED)
        )
    last = max(int(np.argmax(call.passed)) for call in examinee.calls if call.passed.any())
    aside = np.abs(examinee.offsets.offset_m) > numbers["offset_m"]
    stands, blocked = examinee.track.speed_mps < STANDS_MPS, examinee.room.ahead_m <= _GO_ON_M
    back = ~(aside | (stands & ~blocked))[last:]
    back &= ~examinee.called[last:]
    ahead = [one.passed & (abs(one.gap_m) < _RIGHT_AHEAD_M) & (one.speed_mps < STANDS_MPS) for one in examinee.calls]
    for call in examinee.calls:  # from the driver's front to the EMV's rear
        lengths_m = examinee.actor.length_m + examinee.record.actors[call.emv_id].length_m
        ahead.append(call.passed & call.siren & (-call.gap_m - lengths_m < numbers["near_m"]))
    counts = ~np.any([*ahead, stands & blocked], axis=0)[last:]
    if back.any():
        return Finding(Measure(float(counts[: np.argmax(back)].sum()) * STEP_S), int(examinee.track.step[last]))
    left_s = float(counts.sum()) * STEP_S
    if left_s < numbers["waits_s"]:
        return Finding(Measure.lacking("the episode ended before"))
    return Finding(Measure(left_s, at_least=True), int(examinee.track.step[last]))


def following(examinee: Examinee, numbers: Numbers) -> Finding:
    """Longest time for which the driver drives close behind an EMV with a siren that has passed it.

    How far behind is the difference of the ways that both have driven since then: a bend does not shorten it. In a
    junction, and where it has just left one, a driver clears it first.
    """
    passed = [call for call in examinee.calls if call.passed.any()]
    if not passed:
        return Finding(
            Measure.lacking("no emergency vehicle with a siren passed" if examinee.calls else _NOBODY_CALLED)
        )
    follows = np.zeros(len(examinee.track), np.bool_)
    for call in passed:
        apart = np.cumsum(call.speed_mps - examinee.track.speed_mps) * STEP_S
        behind = apart - apart[int(np.argmax(call.passed))]
        near = call.siren & (behind > 0.0) & (behind < numbers["gap_m"]) & (np.abs(call.left_m) < numbers["aside_m"])
        follows |= call.passed & near & (examinee.track.speed_mps > numbers["faster_mps"])
    follows &= ~once(examinee.in_junction, examinee.reaction_steps)
    return longest(examinee, follows)


def wrong_side(examinee: Examinee, numbers: Numbers) -> Finding:
    """Greatest move to the wrong side while an EMV calls.

    With ``by_lane`` 0 all move right, and to go back to where the driver came from is no such move. With 1, drivers in
    the leftmost lane move left and all others right, on the roads where a rescue lane is opened; other roads do not
    count. There they may have moved before the EMV came: what counts is the place that they keep for the time to
    respond, to the wrong side of the middle of their lane.
    """
    if not examinee.calls:
        return Finding(Measure.lacking(_NOBODY_CALLED))
    lateral, counts = examinee.offsets.lateral_m, examinee.called & ~examinee.in_junction
    begin = np.maximum.accumulate(np.where(rises(counts), np.arange(len(lateral)), 0))
    if numbers["by_lane"] > 0.0:
        lanes = examinee.places.lane[begin]
        side = np.where(lanes == NO_LANE, 0, rescue_sides(examinee.record.network)[lanes])
        middle = (lateral - examinee.offsets.offset_m)[begin]
        wrong = least_of_last(-side * (lateral - middle), examinee.reaction_steps)
    else:
        leftmost = np.maximum.accumulate(np.where(once(counts), lateral, -np.inf))
        side, wrong = np.full(len(lateral), -1), lateral - leftmost[begin]
    lack = "the siren sounded in junctions or on roads without a rescue lane only"
    return greatest(examinee, np.maximum(wrong, 0.0), counts & (side != 0), lack)


def closed_corridor(examinee: Examinee, numbers: Numbers) -> Finding:
    """Share of the time at walking pace, out of town on several lanes, at which the driver's body closes the corridor.

    The corridor is the strip of ``width_m`` around the line between the leftmost lane and its right neighbour. The
    first ``settle_s`` at that pace do not count.
    """
    network, places = examinee.record.network, examinee.places
    gap = np.full(len(examinee.track), np.nan)
    duty = rescue_sides(network) != 0
    for row in np.flatnonzero((places.lane != NO_LANE) & ~examinee.in_junction).tolist():
        lane = int(places.lane[row])
        if duty[lane]:
            line_m = rescue_boundary_m(network, lane)
            gap[row] = abs(places.offset_m[row] - line_m) - 0.5 * examinee.actor.width_m
    slow = held_for(examinee.track.speed_mps < numbers["pace_mps"], steps_from_s(numbers["settle_s"]))
    counts = slow & np.isfinite(gap)
    if not counts.any():
        return Finding(Measure.lacking("no traffic at walking pace on several lanes out of town"))
    closes = counts & (gap < 0.5 * numbers["width_m"])
    return Finding(Measure(float(closes.sum() / counts.sum())), first_step(examinee, closes))


def on_shoulder(examinee: Examinee, _numbers: Numbers) -> Finding:
    """Longest time for which the driver's centre is on the shoulder of a road out of town with several lanes."""
    network = examinee.record.network
    places = examinee.places.lane.tolist()
    fast = [lane != NO_LANE and is_out_of_town(network, network.lanes[lane].edge) for lane in places]
    there = np.asarray((examinee.lane_kinds == LaneKind.SHOULDER) & np.array(fast, np.bool_))
    return longest(examinee, there)


def back_in_the_way(examinee: Examinee, numbers: Numbers) -> Finding:
    """Longest time for which the driver is back in the way of an EMV that calls, after it had left it.

    It has left it, for this EMV or for one before, and is back, where it has itself moved to the EMV's side by
    ``moved_m``: an EMV may change its way.
    """
    if not examinee.calls:
        return Finding(Measure.lacking(_NOBODY_CALLED))
    worst = np.zeros(len(examinee.track), np.bool_)
    begun_m = examinee.offsets.lateral_m[int(np.argmax(examinee.called))]
    left_it = np.abs(examinee.offsets.lateral_m - begun_m) > numbers["moved_m"]
    for call in examinee.calls:
        apart = 0.5 * (examinee.actor.width_m + examinee.record.actors[call.emv_id].width_m) + numbers["margin_m"]
        aside = call.calls & (np.abs(call.left_m) > apart) & left_it
        left_at = np.maximum.accumulate(np.where(aside, np.arange(len(aside)), 0))
        moved_m = examinee.offsets.lateral_m - examinee.offsets.lateral_m[left_at]
        moved = np.sign(call.left_m[left_at]) * moved_m > numbers["moved_m"]
        worst |= since(call.calls, aside) & call.calls & ~aside & moved & (call.gap_m > 0.0)
    return longest(examinee, worst)


MONITORS: Final[Mapping[str, Monitor]] = {
    **RULES,
    "contact": Monitor(contact, "m/s", "speed of the hardest contact", {}),
    "response": Monitor(
        response, "s", "time to the first response", {"shift_m": M, "slower_mps": MPS, "aside_m": M}, asks_to_act=True
    ),
    "obstruction": Monitor(
        obstruction,
        "s",
        "time for which the EMV was stuck behind",
        {"gap_m": M, "slow_mps": MPS, "left_line_m": (-1.0, 5.0)},
    ),
    "right_edge": Monitor(right_edge, "m", "room left on the right as the EMV passes", {"move_s": S}, asks_to_act=True),
    "stands_until_passed": Monitor(
        stands_until_passed,
        "m/s",
        "greatest speed while the EMV is near",
        {"gap_m": M, "stop_s": S},
        asks_to_act=True,
    ),
    "moves_off": Monitor(moves_off_before_the_last, "m", "way driven between two EMVs", {}),
    "red_line": Monitor(beyond_red_line, "m", "way beyond a stop line at red", {}),
    "indicator": Monitor(
        without_indicator,
        "moves",
        "moves to the side without an indicator",
        {"least_m": M, "least_mps": MPS, "before_s": S, "late_s": S},
    ),
    "braking": Monitor(braking, "m/s²", "hardest deceleration", {"lasting_s": (0.05, 10.0)}),
    "time_to_collision": Monitor(time_to_collision, "s", "least time to collision", {}),
    "encroachment": Monitor(encroachment, "s", "least time behind somebody who crossed", {}),
    "return_to_lane": Monitor(
        return_to_lane,
        "s",
        "time until it drives on in its lane",
        {"offset_m": M, "waits_s": S, "near_m": (0.0, 500.0)},
    ),
    "following": Monitor(
        following, "s", "time close behind the EMV", {"gap_m": (0.0, 500.0), "aside_m": M, "faster_mps": MPS}
    ),
    "wrong_side": Monitor(wrong_side, "m", "move to the wrong side", {"by_lane": (0.0, 1.0)}),
    "closed_corridor": Monitor(
        closed_corridor,
        "of the time",
        "body in the corridor at walking pace",
        {"width_m": M, "pace_mps": MPS, "settle_s": S},
    ),
    "on_shoulder": Monitor(on_shoulder, "s", "time on a shoulder", {}),
    "back_in_the_way": Monitor(back_in_the_way, "s", "time back in the EMV's way", {"margin_m": M, "moved_m": M}),
}
"""The monitors by the names that rulebooks use."""
