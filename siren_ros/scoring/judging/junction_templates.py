"""Templates S3 to S7 at junctions: passing a red signal or a stop sign, and turning off from the shoulder."""

from collections.abc import Mapping
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.scoring.judging.traversals import RED, Traversal, find_traversals, signal_letter
from siren_ros.scoring.judging.verdict import (
    Moment,
    Part,
    Verdict,
    at_least,
    closest_of,
    first_reaching,
    listed,
    more_than,
    verdict_of,
)
from siren_ros.simulation.roads.road_network import Connection, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import crossing_connections, has_right_of_way, movement_path
from siren_ros.simulation.roads.sites import Control

APPROACH_M: Final = 15.0
"""Distance before the stop line in which a driver who obeys the sign stops: two to three car lengths."""
_UNSIGNED: Final = frozenset({Control.GIVE_WAY, Control.UNCONTROLLED})
SAME_DIRECTION_RAD: Final = np.pi / 6.0
"""Largest difference of heading, at entry and at exit, between movements that count as the same direction."""
RIGHT_TURNS: Final = frozenset({"r", "R"})
"""SUMO's letters of right turns and of slight right turns."""
TURN_MIN_DEG: Final = 45.0
"""Smallest heading change to the right that counts as a turn."""
NEAR_M: Final = 50.0
"""Largest distance before and after the junction at which the approach and the exit still belong to the turn."""


def least_free_speed_mps(record: EpisodeRecord, traversal: Traversal) -> float:
    """Smallest speed on the last 15 m before a stop line and at the line, while no vehicle is ahead in the lane.

    A vehicle that stands behind another one at the line does not count as stopping for the sign; from the moment
    at which the way to the line is free it does.
    """
    return min([traversal.enter_speed_mps, *_free_speeds_mps(record, traversal, range(traversal.enter_step), None)])


def _free_speeds_mps(record: EpisodeRecord, traversal: Traversal, steps: range, over: Polyline | None) -> list[float]:
    """Speeds at these steps on the last 15 m before a stop line, while no vehicle is ahead in the lane.

    With the way ``over`` the junction those between line and exit instead, while nobody except EMVs is ahead.
    """
    track = record.track(traversal.actor_id)
    enter, leave = np.searchsorted(track.step, (traversal.enter_step, traversal.leave_step)).tolist()
    driven = track.driven_m
    first = int(np.searchsorted(driven, driven[min(enter, len(driven) - 1)] - APPROACH_M))
    rows = [row for row in (range(first, enter) if over is None else range(enter, leave)) if track.step[row] in steps]
    taken = [row for row in rows if not _is_blocked(record, traversal, int(track.step[row]), over)]
    return [float(track.speed_mps[row]) for row in taken]


def _is_blocked(record: EpisodeRecord, traversal: Traversal, step: int, over: Polyline | None) -> bool:
    """Whether another vehicle is ahead in its approach lane at a step; on its way ``over`` the junction no EMV is."""
    states = record.states[step - record.states[0].step]
    lane = record.network.lanes[record.network.connections[traversal.connection].from_lane]
    way, end_m = (lane.centre, lane.length_m) if over is None else (over, over.length_m)
    s_m, left_m = way.project(np.column_stack((states.x_m, states.y_m)))
    row = int(np.searchsorted(states.actor_id, traversal.actor_id))
    half_m = np.array([0.5 * record.actors[int(actor)].length_m for actor in states.actor_id])
    ahead = (s_m > s_m[row]) & (s_m - half_m < end_m) & (np.abs(left_m) < 0.5 * lane.width_m)
    ahead[row] = False
    return bool(ahead.any() if over is None else ahead[~np.isin(states.actor_id, record.emv_ids)].any())


def red_same_direction(record: EpisodeRecord, _thresholds: Mapping[str, float]) -> Verdict:
    """S3: the EMV enters at red while a vehicle of its direction is inside."""
    return _judge(record, None, "same_direction_inside")


def red_crossing(record: EpisodeRecord, _thresholds: Mapping[str, float]) -> Verdict:
    """S4: the EMV enters at red while a vehicle on a crossing path is inside."""
    return _judge(record, None, "crossing_inside")


def stop_same_direction(record: EpisodeRecord, thresholds: Mapping[str, float]) -> Verdict:
    """S5: the EMV passes a stop line faster than ``speed_min_mps`` while a vehicle of its direction is inside."""
    return _judge(record, thresholds["speed_min_mps"], "same_direction_inside")


def stop_crossing(record: EpisodeRecord, thresholds: Mapping[str, float]) -> Verdict:
    """S6: the EMV passes a stop line faster than ``speed_min_mps`` while a vehicle on a crossing path is inside."""
    return _judge(record, thresholds["speed_min_mps"], "crossing_inside")


def _judge(record: EpisodeRecord, speed_min_mps: float | None, others: str) -> Verdict:
    """Verdict on the traversal of the first EMV that comes closest to the predicate.

    The least speed is that at a stop line, None for a junction with a signal; ``others`` names the part that counts the
    other vehicles inside.
    """
    network = record.network
    traversals = find_traversals(record)
    civilians = [traversal for traversal in traversals if traversal.actor_id not in record.emv_ids]
    verdicts = []
    for traversal in traversals:
        connection = network.connections[traversal.connection]
        applies = connection.signal_id is not None if speed_min_mps is None else _binds(record, connection)
        if traversal.actor_id in record.emv_ids[:1] and applies:
            inside = _inside(network, traversal, civilians, crossing=others == "crossing_inside")
            line = _at_the_line(record, traversal, speed_min_mps)
            parts = (line, _count(others, traversal, inside), *_precedence(record, traversal, civilians, speed_min_mps))
            through = _through(record, traversal)
            verdicts.append(verdict_of((*parts, through), _sentence(record, parts, traversal)))
    where = "a junction with a signal" if speed_min_mps is None else "a line at which it has to wait"
    nowhere = f"the EMV crosses {where} nowhere"
    line_part = (
        at_least("against_red", 0, 1, nowhere)
        if speed_min_mps is None
        else more_than("stop_line_mps", 0, speed_min_mps, nowhere)
    )
    return closest_of(verdicts) or verdict_of((line_part, at_least(others, 0, 1)), nowhere)


def _binds(record: EpisodeRecord, connection: Connection) -> bool:
    """Whether the EMV has to wait at a line: at any stop sign, and at the site where that has another control."""
    site = record.description.site
    return connection.must_stop or (
        connection.gives_way and site.get("control") in _UNSIGNED and site.get("junction") == connection.junction
    )


def _precedence(
    record: EpisodeRecord, traversal: Traversal, civilians: list[Traversal], speed_min_mps: float | None
) -> tuple[Part, ...]:
    """Condition where no sign makes the EMV stop: somebody with the right of way stops for it and goes later.

    A driver who gives way holds up nobody. Those count who are slower than the threshold on the last 15 m before their
    line with nobody ahead in the lane, or inside with nobody else ahead, while the EMV is inside, and who leave later.
    """
    network, movement = record.network, record.network.connections[traversal.connection]
    if speed_min_mps is None or movement.must_stop:
        return ()
    crossing = frozenset(crossing_connections(network, movement))
    inside = range(traversal.enter_step, traversal.leave_step)
    held = [
        other
        for other in civilians
        if other.connection in crossing
        if other.enter_step > traversal.enter_step and other.leave_step > traversal.leave_step
        if has_right_of_way(network, movement, network.connections[other.connection])
        if any(
            speed_mps <= speed_min_mps
            for way in (None, _way_over(network, other))
            for speed_mps in _free_speeds_mps(record, other, inside, way)
        )
    ]
    return (_count("went_before", traversal, held),)


def _way_over(network: RoadNetwork, traversal: Traversal) -> Polyline:
    """The approach lane, the way over the junction, and 15 m of the exit lane."""
    movement = network.connections[traversal.connection]
    approach, out = (network.lanes[lane].centre for lane in (movement.from_lane, movement.to_lane))
    return Polyline.joined([approach, movement_path(network, movement), out.cut(0.0, min(APPROACH_M, out.length_m))])


def _at_the_line(record: EpisodeRecord, traversal: Traversal, speed_min_mps: float | None) -> Part:
    """Condition at the line: a red signal (1 or 0) as the front passed, or the smallest free speed at a stop line.

    A driver who obeys a stop sign stops on the approach or at the line.
    """
    junction = record.network.connections[traversal.connection].junction
    enter_s, leave_s = traversal.enter_step * STEP_S, traversal.leave_step * STEP_S
    entry = Moment(traversal.enter_step, traversal.actor_id)
    where = f"EMV {traversal.actor_id} in junction {junction} from {enter_s:.1f} s to {leave_s:.1f} s"
    if speed_min_mps is None:
        letter = signal_letter(record, traversal)
        return at_least("against_red", letter in RED, 1, f"{where} on {letter or 'no signal'}", entry)
    return more_than("stop_line_mps", least_free_speed_mps(record, traversal), speed_min_mps, where, entry)


def _through(record: EpisodeRecord, traversal: Traversal) -> Part:
    """Whether the EMV's rear is on the exit lane, or it is past it, before the record ends."""
    out = [Moment(traversal.leave_step, traversal.actor_id)] if traversal.leave_step <= record.states[-1].step else []
    return at_least("through", len(out), 1, listed(out), *out)


def _inside(network: RoadNetwork, traversal: Traversal, civilians: list[Traversal], crossing: bool) -> list[Traversal]:
    """Civilians' traversals that overlap in time with the EMV's: on crossing paths, or in its direction."""
    movement = network.connections[traversal.connection]
    meeting = [
        other
        for other in civilians
        if network.connections[other.connection].junction == movement.junction and traversal.meets(other)
    ]
    if crossing:
        crossing_it = frozenset(crossing_connections(network, movement))
        return [other for other in meeting if other.connection in crossing_it]
    return [other for other in meeting if is_same_direction(network, traversal.connection, other.connection)]


def is_same_direction(network: RoadNetwork, first: int, second: int) -> bool:
    """Whether two movements (connection indices) have the same approach edge, or equal headings at both ends."""
    movements = [network.connections[index] for index in (first, second)]
    if network.lanes[movements[0].from_lane].edge == network.lanes[movements[1].from_lane].edge:
        return True
    paths = [movement_path(network, movement) for movement in movements]
    ends = np.array([path.heading_rad([0.0, path.length_m]) for path in paths])
    return bool(np.all(np.abs(wrap_angle(ends[1] - ends[0])) <= SAME_DIRECTION_RAD))


def _count(name: str, traversal: Traversal, inside: list[Traversal]) -> Part:
    """Count the vehicles inside; each counts from the step at which it and the EMV are both there."""
    spans = [(other.actor_id, *(step * STEP_S for step in other.centre_steps)) for other in inside]
    detail = ", ".join(f"{actor_id} from {first_s:.1f} s to {last_s:.1f} s" for actor_id, first_s, last_s in spans)
    came = sorted(Moment(max(other.centre_steps[0], traversal.enter_step), other.actor_id) for other in inside)
    first = {moment.actor_id: moment for moment in reversed(came)}
    return at_least(name, len(first), 1, detail, *sorted(first.values()))


def _sentence(record: EpisodeRecord, parts: tuple[Part, ...], traversal: Traversal) -> str:
    line, others, *precedence = parts
    if line.name == "against_red":
        how = "against red" if line.holds else "not against red"
    else:
        how = f"over the {'give-way' if precedence else 'stop'} line, never slower than {line.value:.1f} m/s,"
    junction = record.network.connections[traversal.connection].junction
    kind = "of its direction" if others.name == "same_direction_inside" else "on crossing paths"
    text = f"the EMV entered junction {junction} {how} with {others.value:.0f} vehicles {kind} inside"
    return text + "".join(f"; {part.value:.0f} with the right of way stopped for it" for part in precedence)


def shoulder_turn(record: EpisodeRecord, thresholds: Mapping[str, float]) -> Verdict:
    """The EMV's centre is on a shoulder for at least ``shoulder_min_s`` while it turns right at a junction.

    The turn lasts from the approach edge to the exit edge, at most 50 m before and after the junction.
    """
    needed_s = thresholds["shoulder_min_s"]
    verdicts = []
    for traversal in find_traversals(record):
        connection = record.network.connections[traversal.connection]
        if traversal.actor_id in record.emv_ids[:1] and connection.direction in RIGHT_TURNS:
            verdicts.append(_of_turn(record, traversal, needed_s))
    turn_part = at_least("right_turn_deg", 0, TURN_MIN_DEG, "the EMV turns right nowhere")
    nowhere = (turn_part, at_least("shoulder_s", 0, needed_s))
    return closest_of(verdicts) or verdict_of(nowhere, "the EMV turned right nowhere")


def _of_turn(record: EpisodeRecord, traversal: Traversal, needed_s: float) -> Verdict:
    rows = _turn_rows(record, traversal)
    course_deg = np.degrees(turned_right_rad(rows.yaw_rad))
    turned_deg = float(course_deg[-1])
    on_shoulder = on_shoulder_area(record.network, rows)
    so_far_s = np.cumsum(on_shoulder) * STEP_S
    shoulder_s = float(so_far_s[-1])
    reached = partial(first_reaching, rows.step, traversal.actor_id)
    junction = record.network.connections[traversal.connection].junction
    first_s, last_s = rows.step[0] * STEP_S, rows.step[-1] * STEP_S
    where = f"EMV {traversal.actor_id} at junction {junction} from {first_s:.1f} s to {last_s:.1f} s"
    parts = (
        at_least("right_turn_deg", turned_deg, TURN_MIN_DEG, where, *reached(course_deg, TURN_MIN_DEG)),
        at_least("shoulder_s", shoulder_s, needed_s, times_text(rows, on_shoulder), *reached(so_far_s, needed_s)),
        _through(record, traversal),
    )
    space = str(record.description.site.get("map_variant", "shoulder")).replace("_", " ")
    text = f"the EMV was on the {space} for {shoulder_s:.1f} s of its turn by {turned_deg:.0f}° to the right"
    return verdict_of(parts, text)


def turned_right_rad(yaw_rad: Floats) -> Floats:
    """Largest turn to the right so far, at each element of a series of headings.

    Earlier bends to the left do not count.
    """
    turned = np.concatenate(([0.0], np.cumsum(wrap_angle(np.diff(yaw_rad)))))
    return np.maximum.accumulate(np.maximum.accumulate(turned) - turned)


def _turn_rows(record: EpisodeRecord, traversal: Traversal) -> StateRows:
    """States of the EMV from the approach edge to the exit edge, within ``NEAR_M`` of the junction."""
    track = record.track(traversal.actor_id)
    driven = track.driven_m
    enter, leave = np.searchsorted(track.step, [traversal.enter_step, traversal.leave_step])
    leave = min(leave, len(track) - 1)
    on_edges = (track.step >= traversal.approach_step) & (track.step < traversal.exit_step)
    near = (driven >= driven[enter] - NEAR_M) & (driven <= driven[leave] + NEAR_M)
    return track.select(np.flatnonzero(on_edges & near))


def on_shoulder_area(network: RoadNetwork, rows: StateRows) -> npt.NDArray[np.bool_]:
    """Whether each centre is on a shoulder, or on a shoulder's path across a junction, in its direction (±90°)."""
    on_shoulder = np.zeros(len(rows), dtype=bool)
    shoulders = [lane.index for lane in network.lanes if lane.kind is LaneKind.SHOULDER]
    across = [via for connection in network.connections if connection.from_lane in shoulders for via in connection.via]
    for index in dict.fromkeys([*shoulders, *across]):
        lane = network.lanes[index]
        s, left = lane.centre.project(rows.xy_m)
        turned = np.abs(wrap_angle(lane.centre.heading_rad(s) - rows.yaw_rad))
        inside = (s >= 0.0) & (s <= lane.length_m) & (np.abs(left) <= lane.width_m / 2.0)
        on_shoulder |= inside & (turned < np.pi / 2.0)
    return on_shoulder


def times_text(rows: StateRows, holds: npt.NDArray[np.bool_]) -> str:
    """Time intervals in which a condition holds, as text."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], holds, [False])).astype(np.int8)))
    times = [
        f"{rows.step[first] * STEP_S:.1f} s to {(rows.step[last - 1] + 1) * STEP_S:.1f} s"
        for first, last in zip(edges[::2], edges[1::2], strict=True)
    ]
    return ", ".join(times)
