"""Guard 1 of the EMV: ``gap_escape``, a search for free space around what blocks the way."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from siren_ros.behaviour.config import GapEscapeConfig
from siren_ros.behaviour.curve import Curve
from siren_ros.behaviour.emv_lane_change import Outcome, cancel_lane_change
from siren_ros.behaviour.emv_route import best_lane, present_lane
from siren_ros.behaviour.emv_unit import NEVER, EmvUnit, advice_of, event_of
from siren_ros.behaviour.lane_change import gaps_in_lane
from siren_ros.behaviour.lane_foot import lane_foot
from siren_ros.behaviour.lane_path import LanePath, lanes_along, path_on_lanes, road_limits
from siren_ros.behaviour.path_blend import PEAK_CURVATURE, along_reference, quintic_offsets
from siren_ros.behaviour.world import StepView
from siren_ros.world.actors import NO_ACTOR, Floats
from siren_ros.world.events import EventKind
from siren_ros.world.road_network import NO_LANE, RoadNetwork
from siren_ros.world.units import STEP_S, steps_from_s

_SWEEP_S: Final = 1.5
"""Time over which moving vehicles are swept ahead in the search."""
_ROAD_SIDE_M: Final = 15.0
"""Vehicles further beside the road are out of the way."""
_SAME_OFFSET_M: Final = 0.5
_STEER_SHARE: Final = 0.75
"""Part of the steering range that an escape path may use."""
_BODY_PIECES: Final = np.array([-2.0 / 3.0, 0.0, 2.0 / 3.0])
"""Centres of the three pieces that the body is cut into, as shares of half its length."""


def gap_escape_mode(unit: EmvUnit, row: int, view: StepView) -> Outcome:
    """Latches the gap escape: entered after a sustained stop behind a blocker, left when none is there for a while."""
    constants = view.world.constants.gap_escape
    stopped = float(view.seen.speed_mps[row]) <= constants.blocked_speed_mps
    blocker = blocker_of(unit, row, view)
    unit = replace(
        unit,
        stopped_s=unit.stopped_s + STEP_S if stopped else 0.0,
        blocker_free_s=0.0 if blocker != NO_ACTOR else unit.blocker_free_s + STEP_S,
    )
    if unit.gap_escape_active and unit.blocker_free_s >= constants.blocker_grace_s - 0.5 * STEP_S:
        unit = replace(unit, gap_escape_active=False, escape_offset_m=None, plan=None, corridor_planned_step=NEVER)
        return unit, (event_of(view, row, EventKind.GAP_ESCAPE_LEFT),)
    long_enough = unit.stopped_s >= constants.stop_before_entry_s - 0.5 * STEP_S
    if blocker == NO_ACTOR or not long_enough or unit.gap_escape_active:
        return unit, ()
    unit, cancelled = cancel_lane_change(unit, row, view, "gap_escape")
    unit = replace(unit, gap_escape_active=True, escape_offset_m=None, escape_planned_step=NEVER)
    return unit, (*cancelled, event_of(view, row, EventKind.GAP_ESCAPE_ENTERED, blocker))


def blocker_of(unit: EmvUnit, row: int, view: StepView) -> int:
    """The actor that blocks the EMV: SUMO's leader within the query range, else the navigator's snapshot.

    A leader that drives faster than the escape's own target speed blocks nobody. While the escape is active the
    navigator does not watch; the vehicle ahead or beside in the EMV's lane takes the snapshot's place.
    """
    advice = advice_of(view, unit.actor_id)
    if advice is not None and advice.leader_id != NO_ACTOR:
        rows = np.flatnonzero(view.seen.actor_id == advice.leader_id)
        slow = len(rows) == 0 or view.seen.speed_mps[rows[0]] < view.world.speeds.emv_gap_escape_mps
        if slow and advice.leader_gap_m <= view.world.constants.leader_query_m:
            return advice.leader_id
    if unit.gap_escape_active:
        lane = present_lane(view, row, unit.navigator)
        gaps = gaps_in_lane(view, row, lane) if lane != NO_LANE else None
        near = gaps is not None and gaps.front_m < view.world.config.gap_escape.blocker_range_m
        return gaps.front_id if gaps is not None and near else NO_ACTOR
    return unit.snapshot.actor_id if unit.snapshot is not None else NO_ACTOR


def escape_path(unit: EmvUnit, row: int, view: StepView) -> Outcome:
    """``BuildGapEscapeWaypoints``: the EMV with a path through free space, planned anew from time to time."""
    config = view.world.config.gap_escape
    if view.step - unit.escape_planned_step < steps_from_s(config.replan_s):
        return unit, ()
    lane = present_lane(view, row, unit.navigator)
    if lane == NO_LANE:
        return unit, ()
    network, route = view.world.network, view.traffic.route_of_row(row)
    lane = best_lane(network, lane, route)
    x, y, _ = view.pose(row)
    position = lane_foot(network.lanes[lane].centre, x, y)[0]
    length = config.horizon_m + 10.0
    lanes, end = lanes_along(network, lane, position, route, length)
    reference = path_on_lanes(network, lanes, end, position - 2.0, length)
    found = search_gap(reference, row, view)
    first = unit.escape_planned_step < 0
    before = unit.escape_offset_m
    unit = replace(unit, escape_planned_step=view.step, escape_offset_m=None, plan=None)
    if found is None:
        quiet = before is None and not first
        return unit, () if quiet else (event_of(view, row, EventKind.GAP_ESCAPE_WAITING),)
    s = np.linspace(found.start_m, found.start_m + found.free_m, max(3, math.ceil(found.free_m) + 1))
    offsets = quintic_offsets(
        (s - found.start_m) / found.merge_m, found.from_left_m, found.slope * found.merge_m, found.left_m
    )
    curve = Curve.through(reference.curve.offset_at(s, offsets))
    path = along_reference(curve, reference, s, view.navigator_config(row), found.merge_m, stop_at_end=True)
    unit = replace(unit, navigator=unit.navigator.following(path, x, y), escape_offset_m=found.left_m)
    if before is not None and abs(found.left_m - before) < _SAME_OFFSET_M:
        return unit, ()
    return unit, (event_of(view, row, EventKind.GAP_ESCAPE_REPLANNED, left_m=found.left_m, free_m=found.free_m),)


@dataclass(frozen=True)
class EscapePath:
    """A lateral move beside a reference line, then straight on along it."""

    start_m: float
    from_left_m: float
    slope: float
    left_m: float
    merge_m: float
    free_m: float
    """Length along the reference line that the footprint clears."""


def search_gap(reference: LanePath, row: int, view: StepView) -> EscapePath | None:
    """The best of the paths to all offsets across the road that the footprint clears with a margin.

    Long free paths are preferred, near offsets to far ones, the own road to the shoulder and this to the opposite
    lane. Footprints are compared in the frame of the reference line, the own one in three pieces along the body;
    moving vehicles are swept along their motion.

    Returns:
        The path, or None where no path is long enough to be worth driving.
    """
    config, seen = view.world.config.gap_escape, view.seen
    x, y, yaw = view.pose(row)
    curve = reference.curve
    s0, d0 = curve.project_one(x, y)
    heading = float(curve.heading_at(np.array([s0]))[0])
    slope = math.tan(max(-0.5, min(0.5, math.remainder(yaw - heading, 2.0 * math.pi))))
    half_length, half_width = float(seen.half_length_m[row]), float(seen.half_width_m[row])
    lefts, costs = _candidate_offsets(view.world.network, reference.lanes[0], half_width, config)
    vehicle = view.vehicle(row)
    sharpest = math.tan(_STEER_SHARE * vehicle.max_steer_rad) / vehicle.wheelbase_m
    merges = np.repeat(np.array(config.merge_lengths_m), len(lefts))
    lefts, costs = np.tile(lefts, len(config.merge_lengths_m)), np.tile(costs, len(config.merge_lengths_m))
    bends = PEAK_CURVATURE * np.abs(lefts - d0) / merges**2
    keep = bends <= sharpest
    lefts, costs, merges = lefts[keep], costs[keep], merges[keep]
    if len(lefts) == 0:
        return None
    way = np.arange(0.0, config.horizon_m + 0.5, 1.0)
    offsets = np.stack(
        [quintic_offsets(way / merge, d0, slope * merge, left) for left, merge in zip(lefts, merges, strict=True)]
    )
    free = _free_length(reference, s0 + way, offsets, (half_length, half_width), row, view)
    score = np.minimum(free, config.horizon_m) - costs - np.abs(lefts - d0) - 0.1 * merges
    score = np.where(free >= config.progress_min_m, score, -np.inf)
    best = int(np.argmax(score))
    if not np.isfinite(score[best]):
        return None
    return EscapePath(s0, d0, slope, float(lefts[best]), float(merges[best]), float(free[best]))


def _free_length(
    reference: LanePath,
    s_m: Floats,
    offsets: Floats,
    body: tuple[float, float],
    row: int,
    view: StepView,
) -> Floats:
    """Length of each candidate (``offsets`` of shape ``(C, K)`` at ``s_m`` of shape ``(K,)``) before it touches."""
    config, seen = view.world.config.gap_escape, view.seen
    x, y, _ = view.pose(row)
    rows = seen.near(x, y, config.horizon_m + 15.0, but=row)
    place, left, _ = reference.curve.project(seen.x_m[rows], seen.y_m[rows])
    rows = rows[(place > s_m[0] - 10.0) & (np.abs(left) < _ROAD_SIDE_M)]
    place, left, nearest = reference.curve.project(seen.x_m[rows], seen.y_m[rows])
    turned = seen.yaw_rad[rows] - reference.curve.heading_rad[nearest]
    cos, sin = np.cos(turned), np.sin(turned)
    extent = np.abs(cos) * seen.half_length_m[rows] + np.abs(sin) * seen.half_width_m[rows]
    side = np.abs(sin) * seen.half_length_m[rows] + np.abs(cos) * seen.half_width_m[rows]
    sweep = 0.5 * _SWEEP_S * seen.speed_mps[rows]
    place, left = place + cos * sweep, left + sin * sweep
    extent, side = extent + np.abs(cos) * sweep, side + np.abs(sin) * sweep
    slope = np.gradient(offsets, s_m, axis=1)
    half_length, half_width = body
    touches = np.zeros(offsets.shape, dtype=np.bool_)
    for piece in _BODY_PIECES * half_length:
        along = s_m + piece
        aside = offsets + piece * slope
        near = np.abs(along[:, None] - place) < extent + half_length / 3.0 + config.clearance_m
        wide = side + half_width + config.clearance_m
        touches |= np.any(near & (np.abs(aside[:, :, None] - left) < wide), axis=2)
    touches[:, 0] = False
    hit = np.argmax(touches, axis=1)
    free = np.where(touches.any(axis=1), s_m[hit] - s_m[0] - 1.0, s_m[-1] - s_m[0])
    return np.asarray(free, dtype=np.float64)


def _candidate_offsets(
    network: RoadNetwork, lane: int, half_width_m: float, config: GapEscapeConfig
) -> tuple[Floats, Floats]:
    """Offsets across the road from the shoulder to the opposite lane, and what each costs in metres of free way."""
    road = road_limits(network, lane)
    low, high = road.right_m + half_width_m, road.left_m + road.opposite_m - half_width_m
    steps = np.arange(math.ceil(low / config.offset_step_m), math.floor(high / config.offset_step_m) + 1)
    offsets = steps.astype(np.float64) * config.offset_step_m
    beyond = np.clip(offsets + half_width_m - road.left_m, 0.0, None)
    costs = np.where(offsets - half_width_m < road.driving_right_m - 1e-6, config.shoulder_cost_m, 0.0)
    costs = costs + np.where(beyond > 0.0, config.opposite_cost_m * np.clip(beyond / 1.0, 0.2, 1.0), 0.0)
    return offsets, costs
