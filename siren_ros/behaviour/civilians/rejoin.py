"""After a yield: the navigator leads the vehicle back to its lane before SUMO takes over."""

from dataclasses import replace

from siren_ros.behaviour.civilians.unit import YieldStep, YieldUnit, aligned_within_rad, lane_of, standing, yield_event
from siren_ros.behaviour.driving.lane_change import offset_in_lane
from siren_ros.behaviour.driving.navigator import FULL_BRAKE, DriveInputs, NavigatorState, manoeuvring_limit, navigate
from siren_ros.behaviour.driving.step_view import StepView
from siren_ros.behaviour.paths.lane_path import lanes_along, nearest_on_lane, path_on_lanes
from siren_ros.behaviour.paths.tracked_path import blend_length_m, path_onto
from siren_ros.conflicts.yielding import Rank, rank_of
from siren_ros.numerics.units import steps_from_s
from siren_ros.roads.road_network import NO_LANE
from siren_ros.world.actors import Mode
from siren_ros.world.traffic_state import EventKind

_AHEAD_M = 60.0


def start_rejoin(unit: YieldUnit, view: StepView, row: int) -> YieldStep:
    """Hands the vehicle back to SUMO if it is in its lane. Otherwise gives it a path back to the lane's centre.

    A driver who stands over the stop line of a red light waits for green first.
    """
    if stands_over_red_line(view, row):
        return YieldStep(replace(unit, phase=Mode.REJOIN, navigator=NavigatorState(), stopped_steps=0), FULL_BRAKE)
    lane = lane_of(unit, view, row)
    if lane == NO_LANE or _in_lane(view, row, lane):
        return _hand_back(unit, view, row)
    world = view.world
    x, y, yaw = view.pose(row)
    position = nearest_on_lane(world.network.lanes[lane].centre, x, y)[0]
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
    return rejoin(replace(unit, phase=Mode.REJOIN, navigator=navigator, stopped_steps=0, side=side), view, row)


def rejoin(unit: YieldUnit, view: StepView, row: int) -> YieldStep:
    """One step back to the lane. SUMO takes over in the lane, at the path's end, or if the path stays blocked."""
    if unit.navigator.path is None:
        return start_rejoin(unit, view, row)
    config = view.world.config.yielding
    stopped = unit.stopped_steps + 1 if standing(view, row) else 0
    lane = lane_of(unit, view, row)
    blocked = stopped >= steps_from_s(config.rejoin_blocked_s) and (lane == NO_LANE or _straight(view, row, lane))
    if blocked or unit.navigator.done or lane == NO_LANE or _in_lane(view, row, lane):
        return _hand_back(unit, view, row)
    limit = manoeuvring_limit(unit.navigator, view, row)
    situation = DriveInputs(view.seen, row, view.vehicle(row), config.rejoin_speed_mps, limit=limit)
    navigator, command, _ = navigate(unit.navigator, situation, view.world.config.civilian_navigator)
    return YieldStep(replace(unit, navigator=navigator, stopped_steps=stopped), command)


def stands_over_red_line(view: StepView, row: int) -> bool:
    """Whether a vehicle stands across a stop line whose light is red for its movement: SUMO would let it go on."""
    outlook = view.seen.outlook
    if outlook is None or not standing(view, row):
        return False
    front = outlook.front_m(row)
    entry = outlook.course(row).entry_at(front)
    if entry is None or front - entry.start_m > 2.0 * float(view.seen.half_length_m[row]):
        return False
    return rank_of(entry.connection, outlook.signals) is Rank.RED


def _in_lane(view: StepView, row: int, lane: int) -> bool:
    offset, _ = offset_in_lane(view, row, lane)
    return abs(offset) <= view.world.config.yielding.rejoin_offset_m and _straight(view, row, lane)


def _straight(view: StepView, row: int, lane: int) -> bool:
    """Whether SUMO can take over without a jump: its standing vehicles always point along their lanes."""
    _, turned = offset_in_lane(view, row, lane)
    return abs(turned) <= aligned_within_rad(view, row)


def _hand_back(unit: YieldUnit, view: StepView, row: int) -> YieldStep:
    return YieldStep(None, None, (yield_event(unit, view, row, EventKind.YIELD_RELEASED),))
