"""L2: a driver who finds no gap for the yield makes one, by falling back or drawing ahead in the present lane."""

from dataclasses import replace
from enum import IntEnum
from typing import Final

from siren_ros.behaviour.civilians.unit import Outcome, YieldUnit, lane_of
from siren_ros.behaviour.config import YieldConfig
from siren_ros.behaviour.driving.lane_change import LaneGaps, Refusal, gaps_in_lane
from siren_ros.behaviour.driving.navigator import NavigatorState, Situation, navigate
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.paths.lane_path import lanes_along, neighbour_lane, path_on_lanes
from siren_ros.behaviour.paths.nearest_on_lane import nearest_on_lane
from siren_ros.behaviour.paths.path_blend import on_reference
from siren_ros.numerics.units import steps_from_s
from siren_ros.roads.movements import road_lane_of
from siren_ros.roads.road_network import NO_LANE

GAP_REFUSALS: Final = frozenset({Refusal.BESIDE, Refusal.GAP_FRONT, Refusal.GAP_REAR})
_AHEAD_M: Final = 80.0


class Seek(IntEnum):
    """How a gap is sought."""

    FALL_BACK = -1
    NOT = 0
    DRAW_AHEAD = 1


def seek_gap(unit: YieldUnit, view: StepView, row: int, refusal: Refusal) -> Outcome:
    """One step of a deferred vehicle in its own lane, towards a gap in the lane next to it.

    The vehicle must still be able to stop and change lanes before the next junction; elsewhere SUMO keeps driving.

    Args:
        unit: A deferred civilian whose ``side`` says where it wants to go.
        view: The step.
        row: Its row.
        refusal: Why the lane change is not feasible now.
    """
    unit = _with_path(unit, view, row)
    config = view.world.config
    speed = float(view.seen.speed_mps[row])
    stop = speed * speed / (2.0 * config.civilian_navigator.comfort_brake_mps2)
    if unit.navigator.remaining_m < max(stop, config.yielding.seek_room_m):
        return Outcome(replace(unit, navigator=NavigatorState(), seek=Seek.NOT))
    lane = lane_of(unit, view, row)
    target = neighbour_lane(view.world.network, lane, unit.side)
    if target == NO_LANE:
        return Outcome(replace(unit, navigator=NavigatorState(), seek=Seek.NOT))
    gaps = gaps_in_lane(view, row, target)
    limit = view.world.network.lanes[lane].speed_limit_mps
    again = (view.step - unit.deferred_step) % steps_from_s(config.yielding.seek_again_s) == 0
    if unit.seek == Seek.NOT or again:
        seek = choose_seek(gaps, gaps_in_lane(view, row, lane), refusal, config.yielding, limit)
        unit = replace(unit, seek=seek, deferred=refusal.value)
    wanted = seek_speed_mps(Seek(unit.seek), gaps, config.yielding, limit)
    situation = Situation(view.seen, row, view.vehicle(row), wanted)
    navigator, command, _ = navigate(unit.navigator, situation, config.civilian_navigator)
    return Outcome(replace(unit, navigator=navigator), command)


def choose_seek(gaps: LaneGaps, own: LaneGaps, refusal: Refusal, config: YieldConfig, limit_mps: float) -> Seek:
    """Whether to fall back or to draw ahead.

    The driver draws ahead of a vehicle that is behind, or alongside and further back, if the own lane is free and the
    speed limit lets the driver gain on that vehicle. In all other cases the driver falls back and lets the others pass.

    Args:
        gaps: In the adjacent lane.
        own: In the own lane.
        refusal: Why the gap cannot be entered.
        config: Free way and gain of speed that drawing ahead needs.
        limit_mps: Speed limit.
    """
    behind = refusal is Refusal.GAP_REAR or (refusal is Refusal.BESIDE and gaps.front_m > 0.0)
    gains = limit_mps - gaps.rear_mps >= config.seek_gain_mps
    return Seek.DRAW_AHEAD if behind and gains and own.front_m > config.seek_free_m else Seek.FALL_BACK


def seek_speed_mps(seek: Seek, gaps: LaneGaps, config: YieldConfig, limit_mps: float) -> float:
    """Speed while seeking: faster or slower than the vehicle in the way, between a least speed and the limit."""
    other = gaps.front_mps if gaps.front_m < gaps.rear_m else gaps.rear_mps
    if seek is Seek.DRAW_AHEAD:
        return min(other + config.seek_speed_mps, limit_mps)
    return min(max(other - config.seek_speed_mps, config.seek_least_mps), limit_mps)


def soon_free(seek: Seek, gaps: LaneGaps, speed_mps: float, margin_m: float, soon_s: float) -> bool:
    """Whether the driver has left the vehicle in the way behind, or let it pass, within a time at the present speeds.

    Args:
        seek: How the gap is sought.
        gaps: In the adjacent lane.
        speed_mps: Of the driver.
        margin_m: Free way that is needed to that vehicle.
        soon_s: The time.
    """
    if seek is Seek.FALL_BACK:
        gap, gain, others = gaps.front_m, gaps.front_mps - speed_mps, gaps.rear_m
    else:
        gap, gain, others = gaps.rear_m, speed_mps - gaps.rear_mps, gaps.front_m
    return seek is not Seek.NOT and gap < margin_m <= gap + soon_s * gain and others > 0.0


def _with_path(unit: YieldUnit, view: StepView, row: int) -> YieldUnit:
    if unit.navigator.path is not None:
        return unit
    world, lane = view.world, int(view.traffic.lane[row])
    if road_lane_of(world.network, lane) == NO_LANE:
        return unit
    x, y, _ = view.pose(row)
    position = nearest_on_lane(world.network.lanes[lane].centre, x, y)[0]
    route = view.traffic.route_of_row(row)
    lanes, end = lanes_along(world.network, lane, position, route, _AHEAD_M, civilian=True, through_junctions=False)
    reference = path_on_lanes(world.network, lanes, end, position - 2.0, _AHEAD_M)
    shorten = float(view.seen.half_length_m[row]) + 1.0
    path = on_reference(reference, view.navigator_config(row), stop_at_end=True, shorten_m=shorten)
    return replace(unit, navigator=NavigatorState().following(path, x, y))
