"""Guard 2 of the EMV: ``copy_sumo``, the rescue corridor between the leftmost lane and its right neighbour."""

import math
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Points, Rows, changed
from siren_ros.base.numerics.braking import stops_within
from siren_ros.base.numerics.units import NEVER, steps_from_s
from siren_ros.simulation.behaviour.driving.driver_states import (
    EmvUnit,
    GuardResult,
    advice_of,
    best_lane,
    event_of,
    present_lane,
)
from siren_ros.simulation.behaviour.driving.lane_change import cancel_lane_change
from siren_ros.simulation.behaviour.driving.lane_path import (
    SHOULDER_REACH_M,
    connection_of_internal,
    road_limits,
    shoulder_into_turn,
)
from siren_ros.simulation.behaviour.driving.speed_mechanisms import free_way
from siren_ros.simulation.behaviour.driving.step_view import Ego
from siren_ros.simulation.behaviour.driving.tracked_path import (
    Curve,
    LaneEnd,
    LanePath,
    along_reference,
    blend_length_m,
    quintic_offsets,
)
from siren_ros.simulation.conflicts.junction_approach import ID
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import TOWN_LIMIT_MPS, rescue_boundary_m
from siren_ros.simulation.world.actors import EventKind, Indices, Lights, Owner


def corridor_mode(unit: EmvUnit, ego: Ego) -> GuardResult:
    """Set the flag ``copy_sumo``: it begins when vehicles form a rescue lane or brake ahead of the EMV.

    It ends when neither has been the case for a while. Entering cancels a forced lane change. Traffic that flows out of
    town forms no rescue lane.
    """
    advice = advice_of(ego, unit.actor_id)
    forming = advice is not None and advice.rescue_count > 0 and not _flows(ego)
    if forming or braking_ahead(unit, ego):
        unit = changed(unit, corridor_seen_step=ego.step)
        if unit.corridor:
            return unit, ()
        unit, cancelled = cancel_lane_change(unit, ego, "corridor")
        return changed(unit, corridor=True), (*cancelled, event_of(ego, EventKind.CORRIDOR_ENTERED))
    patience = steps_from_s(ego.emv_driver.corridor.leave_after_s)
    if unit.corridor and ego.step - unit.corridor_seen_step >= patience:
        left = changed(unit, corridor=False, plan=None, corridor_planned_step=NEVER)
        return left, (event_of(ego, EventKind.CORRIDOR_LEFT),)
    return unit, ()


_CORRIDOR_M: Final = 80.0
"""Length of the corridor ahead of the EMV."""
_ALONG_COSINE: Final = 0.5
"""Vehicles with a larger cosine to the EMV's direction count as the same direction."""


def _flows(ego: Ego) -> bool:
    """Whether the EMV is on a road out of town and is fast, or has no slow vehicle near ahead."""
    if ego.lane == NO_LANE or ego.world.rescue_sides[ego.lane] == 0:
        return False
    if ego.speed_mps > TOWN_LIMIT_MPS:
        return True
    rows, (cos, sin), (x, y) = ego.near(_CORRIDOR_M), ego.direction, ego.place
    ahead_m = cos * (ego.seen.x_m[rows] - x) + sin * (ego.seen.y_m[rows] - y)
    along = np.cos(ego.seen.yaw_rad[rows] - ego.pose[2]) > _ALONG_COSINE
    return not np.any(along & (ahead_m > 0.0) & (ego.seen.speed_mps[rows] < ego.civilian_driver.pull_over.flows_mps))


_STANDING_MPS: Final = 0.5
"""Slower vehicles count as standing."""
_ROAD_HALF_WIDTH_M: Final = 8.0
"""Vehicles farther than this from the reference line are on another road."""


def braking_ahead(unit: EmvUnit, ego: Ego) -> bool:
    """The paper's ``brakingAhead``: a yielding civilian brakes or holds on the road ahead, within the corridor.

    Civilians that yield are those that ROS drives. Vehicles that brake for a red light or for a vehicle ahead leave no
    corridor, so they do not count.
    """
    rows = _yielding_ahead(unit, ego)
    brakes = ((ego.traffic.lights[rows] & Lights.BRAKE) != 0) | (ego.seen.speed_mps[rows] < _STANDING_MPS)
    return bool(brakes.any())


def way_opens(unit: EmvUnit, ego: Ego) -> bool:
    """Whether an EMV in the corridor waits behind drivers of whom some still move aside, or up to let others do so."""
    return unit.corridor and bool(np.any(ego.seen.speed_mps[_yielding_ahead(unit, ego)] >= _STANDING_MPS))


def _yielding_ahead(unit: EmvUnit, ego: Ego) -> Rows:
    path, seen = unit.navigator.path, ego.seen
    rows = ego.near(_CORRIDOR_M)
    if path is None or len(rows) == 0:
        return rows[:0]
    yields = (ego.traffic.owner[rows] == Owner.ROS) & ~seen.is_emv[rows] & (seen.actor_id[rows] != ego.world.av_id)
    rows = rows[yields]
    s, left, nearest = path.curve.project(seen.x_m[rows], seen.y_m[rows])
    same = np.cos(seen.yaw_rad[rows] - path.curve.heading_rad[nearest]) > _ALONG_COSINE
    ahead = (s > unit.navigator.progress_m) & (s < path.length_m)
    return rows[same & ahead & (np.abs(left) < _ROAD_HALF_WIDTH_M)]


_REPLAN_S: Final = 0.4
"""Time between two plans."""
_STRAIGHT_BELOW_M: Final = 25.0
"""With less free distance along the corridor, the EMV also considers its present path and going straight on."""
_KEEP_GAIN_M: Final = 3.0
"""Free distance that keeping the present path must gain, because a new path turns into the corridor later."""
_KEEP_ABOVE_MPS: Final = 1.0
"""Below this speed a new path is always taken, since stopping for it needs no hard braking."""
_STRAIGHT_GAIN_M: Final = 8.0
"""Free distance that going straight on must gain."""


def corridor_path(unit: EmvUnit, ego: Ego) -> EmvUnit:
    """Give the EMV the copied corridor as path, planned again as neighbouring vehicles move.

    A present path that stays free for longer than a new one is kept: each new one begins to turn into the corridor
    where the EMV is now. So is one that gets farther without a touch, where the EMV cannot stop. Where a lane begins on
    the left, the corridor moves to its line. If a vehicle closes that way, the EMV goes straight on between the lanes
    that it is between.
    """
    if ego.step - unit.corridor_planned_step < steps_from_s(_REPLAN_S) and unit.navigator.path is not None:
        return unit
    network, lane = ego.network, present_lane(ego, unit.navigator)
    if lane == NO_LANE:
        return unit
    lane = corridor_lane(network, lane, ego.route, SHOULDER_REACH_M)
    planned = along_corridor(unit, ego, lane, straight_on=False)
    open_m = _open_m(planned, ego)
    if open_m < _STRAIGHT_BELOW_M:
        driven = unit.navigator.path is not None and ego.speed_mps > _KEEP_ABOVE_MPS
        stops = stops_within(ego.speed_mps * ego.speed_mps, ego.emv_driver.gap_escape.brake_mps2, open_m)
        gain_m = _KEEP_GAIN_M if stops else 0.0
        if driven and (
            _open_m(unit, ego) > open_m + gain_m or (not stops and _touches_m(unit, ego) > _touches_m(planned, ego))
        ):
            return changed(unit, corridor_planned_step=ego.step)
        other = along_corridor(unit, ego, lane, straight_on=True)
        if _open_m(other, ego) > open_m + _STRAIGHT_GAIN_M:
            return other
    return planned


def _open_m(unit: EmvUnit, ego: Ego) -> float:
    """Distance that the EMV's footprint can drive on its path, at most to the path's end."""
    way, config = free_way(unit, ego), ego.emv_driver.corridor
    free = math.inf if way is None else way.limit(0.0, config.squeezes, 0.0, 1.0, config.clearance_m).free_m
    return min(free, unit.navigator.remaining_m)


def _touches_m(unit: EmvUnit, ego: Ego) -> float:
    """Distance that the EMV can drive on its path before it touches another actor."""
    way = free_way(unit, ego)
    return math.inf if way is None else way.free_m


_MERGE_MIN_M: Final = 8.0
"""Least length of the lateral move into the corridor."""
_SAME_OFFSET_M: Final = 0.5
"""Corridors nearer to each other than this lead to the same place."""


_ON_PATH_M: Final = 0.3
"""Distance from the present path within which tracking brings the EMV back to it."""


_BEHIND_M: Final = np.array([2.0, 1.0])
"""Distances behind the EMV of the points with which a new path repeats the present one: a bend takes three points."""


def _begin(unit: EmvUnit, ego: Ego) -> tuple[float, float, float, float | None, Points]:
    """Place, heading and curvature with which a new path begins, and points before, a metre apart, shape ``(K, 2)``.

    They are those of the present path, where the EMV is on it. Plans that begin at the EMV itself, one after the other,
    forget how far it lags behind, and it drifts out of bends. At the first point of a path no bend can be told: an EMV
    whose paths all begin where it is would steer straight on at each new one.
    """
    path, place = unit.navigator.path, ego.place
    if path is not None and unit.corridor_planned_step >= 0:
        progress_m, left_m = path.curve.nearest_to(unit.navigator.progress_m, *place)
        if abs(left_m) < _ON_PATH_M:
            return *path.curve.place(progress_m), path.curve.at(progress_m - _BEHIND_M)
    return *place, ego.pose[2], None, np.empty((0, 2))


def along_corridor(unit: EmvUnit, ego: Ego, lane: int, *, straight_on: bool) -> EmvUnit:
    """Give the EMV the corridor relative to a lane as path."""
    config = ego.emv_driver.corridor
    reference = ego.line_along(lane, _CORRIDOR_M, 2.0, length_m=_CORRIDOR_M + 2.0)
    x, y, yaw, bend_1pm, behind = _begin(unit, ego)
    s0, d0 = reference.curve.project_one(x, y)
    count = max(3, math.ceil(reference.curve.length_m - s0) + 1)
    s = np.linspace(s0, max(reference.curve.length_m, s0 + 2.0), count)
    target = corridor_offsets(reference, s, ego, straight_on_m=d0 if straight_on else None)
    _, _, heading, curvature_1pm = reference.curve.place(s0)
    slope = math.tan(max(-0.5, min(0.5, math.remainder(yaw - heading, 2.0 * math.pi))))
    leans, bends_1pm = _derivatives(target, float(s[1] - s[0]))
    slope -= leans
    # A vehicle that points elsewhere must turn back, too; this counts like a lateral distance.
    aside = abs(d0 - float(target[0])) + _MERGE_MIN_M * abs(slope)
    blend = blend_length_m(aside, ego.speed_mps, config.merge_s, 0.0, ego.navigator_config)
    merge = max(_MERGE_MIN_M, min(blend, _merging_m(unit, reference, s, target, _SAME_OFFSET_M)))
    bend = (bend_1pm - curvature_1pm - bends_1pm) * merge**2 if bend_1pm is not None else 0.0
    offsets = target + quintic_offsets((s - s0) / merge, d0 - float(target[0]), slope * merge, 0.0, bend)
    curve = Curve.through(np.concatenate((behind, reference.curve.offset_at(s, offsets))))
    s, merge = np.append(s0 - _BEHIND_M[: len(behind)], s), merge + len(behind)
    stop = reference.end in {LaneEnd.ROUTE, LaneEnd.ASTRAY}
    path = along_reference(curve, reference, s, ego.navigator_config, merge, stop)
    navigator = unit.navigator.following(path, *ego.place)
    return changed(unit, navigator=navigator, plan=None, corridor_planned_step=ego.step)


def _derivatives(values: Floats, step: float) -> tuple[float, float]:
    """First and second derivative at the start of evenly spaced values, exact for a parabola."""
    rises = np.diff(values[:3]) / step
    bend = float(rises[1] - rises[0]) / step
    return float(rises[0]) - 0.5 * bend * step, bend


def _merging_m(unit: EmvUnit, reference: LanePath, s_m: Floats, target_m: Floats, same_m: float) -> float:
    """Remaining length of the present path's lateral move; infinite if it leads elsewhere than the new path."""
    path = unit.navigator.path
    if path is None or unit.corridor_planned_step < 0:
        return math.inf
    x, y = path.curve.at(np.array([min(path.settled_m, path.length_m)]))[0]
    end_m, left_m = reference.curve.project_one(float(x), float(y))
    same = abs(left_m - float(np.interp(end_m, s_m, target_m))) < same_m
    return path.settled_m - unit.navigator.progress_m if same else math.inf


def corridor_lane(network: RoadNetwork, lane: int, route: Indices, reach_m: float) -> int:
    """Lane whose line the corridor is relative to.

    If a shoulder leads into the next right turn, here or along the next edges, the corridor is that shoulder, because
    the other vehicles stand in the driving lanes. Otherwise it is the lane that serves the route best. The right turn
    is at most ``reach_m`` beyond the present edge.
    """
    shoulder = shoulder_into_turn(network, route, reach_m)
    # On a junction, the edge is the one from which the path comes.
    before = [movement.from_lane for movement in network.connections_over.get(lane, ())] or [lane]
    if shoulder is None or int(route[0]) not in {network.lanes[item].edge for item in before}:
        return best_lane(network, lane, route)
    if not network.edges[network.lanes[lane].edge].internal:
        return shoulder.lane
    return shoulder.onward.via[0] if shoulder.onward.via else shoulder.onward.to_lane


_INFLUENCE_M: Final = 6.0
"""Distance along the road over which a vehicle shapes the corridor in front of and behind itself."""
_AGAINST_COSINE: Final = -0.9
"""Vehicles with a smaller cosine to the line come towards the EMV. Those that cross it will be gone."""
_AMPLE_M: Final = 1.0
"""Distance to the vehicles on both sides, as courts ask of those who pass, with which the line needs no move."""
_AMID_M: Final = 0.5
"""A vehicle whose centre is nearer than this to the corridor's line stands in its middle."""


def corridor_offsets(reference: LanePath, s_m: Floats, ego: Ego, *, straight_on_m: float | None = None) -> Floats:
    """Offsets of the corridor's middle from a reference line.

    It starts from the line between the leftmost lane and its right neighbour (SUMO's rescue lane). From there it moves
    into the space between the vehicles on both sides, to its middle where that is narrow, or away from vehicles on one
    side. On a road of one lane it moves to the free side. The EMV passes a vehicle in its middle on the side that has
    more room. It follows another EMV ahead, and does not pass it. It keeps clear of riders on cycle lanes and of
    vehicles that come towards it without moving to the middle of the space up to them. Whatever crosses has other
    rules.

    ``s_m`` are increasing arc lengths on the reference line, shape ``(K,)``; ``straight_on_m`` is an offset to start
    from instead of that line.

    Returns:
        Offsets, left positive, shape ``(K,)``.
    """
    config, seen = ego.emv_driver.corridor, ego.seen
    straight = None if straight_on_m is None else np.full(len(s_m), straight_on_m)
    base = _boundary_offsets(reference, s_m, ego) if straight is None else straight
    rows = ego.near(_CORRIDOR_M + 10.0)
    rows = rows[~np.isin(seen.actor_id[rows], seen.people[ID])]
    if len(rows) == 0:
        return base
    curve = reference.curve
    place, left, nearest = curve.project(seen.x_m[rows], seen.y_m[rows])
    turned = seen.yaw_rad[rows] - curve.heading_rad[nearest]
    cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    same = np.cos(turned) > _ALONG_COSINE
    shapes = (same & ~seen.is_emv[rows]) | (np.cos(turned) < _AGAINST_COSINE)
    near = (np.abs(left) < _ROAD_HALF_WIDTH_M) & (place > s_m[0]) & (place < s_m[-1]) & shapes
    place, left = place[near], left[near]
    extent = (cos * seen.half_length_m[rows] + sin * seen.half_width_m[rows])[near] + _INFLUENCE_M
    side = (sin * seen.half_length_m[rows] + cos * seen.half_width_m[rows])[near]
    beside = np.abs(s_m[:, None] - place) < extent
    road, half_width = road_limits(ego.network, reference.lanes[0]), ego.half_width_m
    line = np.interp(place, s_m, base)
    wider_on_right = left - side - road.right_m > road.left_m + road.opposite_m - left - side
    on_left = np.where(np.abs(left - line) < _AMID_M, wider_on_right, left > line)
    room = half_width + config.side_clearance_m
    high = np.min(np.where(beside & on_left, left - side, np.inf), axis=1, initial=np.inf) - room
    low = np.max(np.where(beside & ~on_left, left + side, -np.inf), axis=1, initial=-np.inf) + room
    lined = beside & (same & ~np.isin(rows, _on_cycle_lanes(ego)))[near]
    both = (np.any(lined & on_left, axis=1) & np.any(lined & ~on_left, axis=1)) | (low > high)
    ample = np.where(both, np.minimum(0.5 * (high - low), max(_AMPLE_M - config.side_clearance_m, 0.0)), 0.0)
    target = np.minimum(np.maximum(base, low + ample), high - ample)
    target = np.clip(target, road.right_m + half_width, road.left_m + max(road.opposite_m, half_width) - half_width)
    return smoothed(target, int(_INFLUENCE_M))


def _on_cycle_lanes(ego: Ego) -> list[int]:
    """Rows of the riders on cycle lanes."""
    lanes, lane_of = ego.network.lanes, ego.traffic.lane
    known = [row for row in ego.seen.riders.tolist() if lane_of[row] != NO_LANE]
    return [row for row in known if lanes[lane_of[row]].kind is LaneKind.CYCLE]


_LINE_SMOOTHING_M: Final = 5.0
"""Least distance before and after the beginning of a lane over which the corridor's line moves sideways."""


def _boundary_offsets(reference: LanePath, s_m: Floats, ego: Ego) -> Floats:
    """Offset of the line between the two leftmost lanes, interpolated across junctions; 0 on roads with one lane.

    Where a lane begins or ends, the line moves aside over as long a way as a move into the corridor takes.
    """
    lane_of, network, config = reference.lane_at(s_m), ego.network, ego.emv_driver.corridor
    offset = np.full(len(s_m), np.nan)
    for lane in dict.fromkeys(lane_of.tolist()):
        if network.lanes[lane].kind is not LaneKind.INTERNAL:
            offset[lane_of == lane] = rescue_boundary_m(network, lane)
    known = np.isfinite(offset)
    if not known.any():
        return np.zeros(len(s_m))
    at_m, line_m, first = s_m[known], offset[known], reference.lanes[0]
    movement = connection_of_internal(network, first, ego.route)
    if movement is not None and first in movement.via:  # the line comes from the lanes before the junction
        before_m = reference.start_m[0] - network.length_m(movement.via[: movement.via.index(first)])
        at_m = np.append(before_m, at_m)
        line_m = np.append(rescue_boundary_m(network, movement.from_lane), line_m)
    radius = max(_LINE_SMOOTHING_M, config.merge_s * ego.speed_mps) / float(s_m[1] - s_m[0])
    return smoothed(np.interp(s_m, at_m, line_m), min(round(radius), (len(s_m) - 1) // 2))


def smoothed(values: Floats, radius: int) -> Floats:
    """Mean of each value and its neighbours, ``radius`` on each side, weighted by a Hann window; the ends repeat.

    Lines that are no longer than the window are left as they are.
    """
    if radius < 1 or len(values) <= 2 * radius:
        return values
    taps = np.hanning(2 * radius + 3)[1:-1]
    return np.convolve(np.pad(values, radius, mode="edge"), taps / taps.sum(), mode="valid")
