"""After a yield: the navigator leads the vehicle back to its lane before SUMO takes over."""

from dataclasses import replace

from siren_ros.behaviour.civilians.unit import Outcome, YieldUnit, aligned_within_rad, lane_of, standing, yield_event
from siren_ros.behaviour.driving.lane_change import offset_in_lane
from siren_ros.behaviour.driving.navigator import NavigatorState, Situation, navigate
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.paths.lane_path import lanes_along, path_on_lanes
from siren_ros.behaviour.paths.nearest_on_lane import lane_foot
from siren_ros.behaviour.paths.path_blend import blend_length_m, path_onto
from siren_ros.numerics.units import steps_from_s
from siren_ros.roads.road_network import NO_LANE
from siren_ros.world.actors import Mode
from siren_ros.world.events import EventKind

_AHEAD_M = 60.0


def start_rejoin(unit: YieldUnit, row: int, view: StepView) -> Outcome:
    """Releases the vehicle at once where it is in its lane, else gives it a path back to the lane's centre."""
    lane = lane_of(unit, row, view)
    if lane == NO_LANE or _in_lane(row, lane, view):
        return _released(unit, row, view)
    world = view.world
    x, y, yaw = view.pose(row)
    position = lane_foot(world.network.lanes[lane].centre, x, y)[0]
    route = view.traffic.route_of_row(row)
    lanes, end = lanes_along(world.network, lane, position, route, _AHEAD_M, civilian=True, through_junctions=False)
    reference = path_on_lanes(world.network, lanes, end, position - 2.0, _AHEAD_M)
    _, left = reference.curve.project_one(x, y)
    config = world.config.pull_over
    navigator_config = view.navigator_config(row)
    speed = 0.5 * (float(view.seen.speed_mps[row]) + world.config.yielding.rejoin_speed_mps)
    merge = blend_length_m(left, speed, config.duration_s, config.length_min_m, navigator_config)
    half_length = float(view.seen.half_length_m[row])
    room = reference.curve.length_m - 2.0 - half_length - 1.0
    # Too near the stop line to come straight in the middle of the lane: straight where it is.
    offset = 0.0 if merge + half_length <= room else left
    path = path_onto(
        reference,
        (x, y, yaw),
        min(merge, max(room, 2.0)),
        navigator_config,
        offset_m=offset,
        shorten_m=half_length + 1.0,
    )
    navigator = NavigatorState().following(path, x, y)
    side = 1 if left < 0.0 else -1
    return rejoin(replace(unit, phase=Mode.REJOIN, navigator=navigator, stopped_steps=0, side=side), row, view)


def rejoin(unit: YieldUnit, row: int, view: StepView) -> Outcome:
    """One step back to the lane; SUMO takes over in the lane, at the path's end, or where the way stays blocked."""
    config = view.world.config.yielding
    stopped = unit.stopped_steps + 1 if standing(view, row) else 0
    lane = lane_of(unit, row, view)
    blocked = stopped >= steps_from_s(config.rejoin_blocked_s) and (lane == NO_LANE or _straight(row, lane, view))
    if blocked or unit.navigator.done or lane == NO_LANE or _in_lane(row, lane, view):
        return _released(unit, row, view)
    situation = Situation(view.seen, row, view.vehicle(row), config.rejoin_speed_mps)
    navigator, command, _ = navigate(unit.navigator, situation, view.world.config.civilian_navigator)
    return Outcome(replace(unit, navigator=navigator, stopped_steps=stopped), command)


def _in_lane(row: int, lane: int, view: StepView) -> bool:
    offset, _ = offset_in_lane(view, row, lane)
    return abs(offset) <= view.world.config.yielding.rejoin_offset_m and _straight(row, lane, view)


def _straight(row: int, lane: int, view: StepView) -> bool:
    """Whether SUMO, whose standing vehicles point along their lanes, can take over without a jump."""
    _, turned = offset_in_lane(view, row, lane)
    return abs(turned) <= aligned_within_rad(row, view)


def _released(unit: YieldUnit, row: int, view: StepView) -> Outcome:
    return Outcome(None, None, (yield_event(unit, row, view, EventKind.YIELD_RELEASED),))
