"""Guard 1 of the EMV: ``gap_escape``, a path through free space around a blocker."""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from siren_ros.behaviour.driving.lane_change import gaps_in_lane
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.emv.escape_plan import reference_line, search_gap
from siren_ros.behaviour.emv.escape_search import FoundPath
from siren_ros.behaviour.emv.forced_lane_change import cancel_lane_change
from siren_ros.behaviour.emv.guard import Outcome
from siren_ros.behaviour.emv.passage import free_way
from siren_ros.behaviour.emv.route import present_lane
from siren_ros.behaviour.emv.unit import EmvUnit, advice_of, event_of
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.behaviour.paths.lane_path import LanePath
from siren_ros.behaviour.paths.path_blend import along_reference
from siren_ros.numerics.units import NEVER, STEP_S, steps_from_s
from siren_ros.roads.road_network import NO_LANE
from siren_ros.world.actors import NO_ACTOR
from siren_ros.world.events import EventKind

_SAME_OFFSET_M: Final = 0.5
_SMOOTHING_M: Final = 0.7
"""Standard deviation of the Gaussian that rounds the steps in a path's curvature."""


def gap_escape_mode(unit: EmvUnit, view: StepView, row: int) -> Outcome:
    """Latches the gap escape: begun after a sustained stop behind a blocker, ended some time after the last one."""
    constants = view.world.constants.gap_escape
    stopped = float(view.seen.speed_mps[row]) <= constants.blocked_speed_mps
    blocker = blocker_of(unit, view, row)
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
    unit, cancelled = cancel_lane_change(unit, view, row, "gap_escape")
    unit = replace(unit, gap_escape_active=True, escape_offset_m=None, escape_planned_step=NEVER)
    return unit, (*cancelled, event_of(view, row, EventKind.GAP_ESCAPE_ENTERED, blocker))


def blocker_of(unit: EmvUnit, view: StepView, row: int) -> int:
    """The actor that blocks the EMV: SUMO's leader within the query range, else the navigator's snapshot.

    A leader that drives faster than the escape's own target speed does not block. While the escape is active, the
    navigator's collision handling is off: the blocker is then the vehicle ahead in the EMV's lane, or one that closes
    its path. A vehicle that a moving EMV would pass sideways does not block.
    """
    advice, lane, passed = advice_of(view, unit.actor_id), NO_LANE, NO_ACTOR
    stopped = float(view.seen.speed_mps[row]) <= view.world.constants.gap_escape.blocked_speed_mps
    if unit.gap_escape_active:
        lane = present_lane(view, row, unit.navigator)
    if advice is not None and advice.leader_id != NO_ACTOR:
        rows = np.flatnonzero(view.seen.actor_id == advice.leader_id)
        slow = len(rows) == 0 or view.seen.speed_mps[rows[0]] < view.world.speeds.emv_gap_escape_mps
        near = advice.leader_gap_m <= view.world.constants.leader_query_m
        unknown = lane == NO_LANE or len(rows) == 0
        if slow and near:
            if unknown or stopped or in_the_way(view, row, int(rows[0]), lane):
                return advice.leader_id
            passed = advice.leader_id
    if lane != NO_LANE:
        gaps = gaps_in_lane(view, row, lane)
        if gaps.front_m < view.world.config.gap_escape.blocker_range_m and gaps.front_id != passed:
            other = int(np.flatnonzero(view.seen.actor_id == gaps.front_id)[0])
            if stopped or in_the_way(view, row, other, lane):
                return gaps.front_id
    return unit.snapshot.actor_id if unit.snapshot is not None else NO_ACTOR


def in_the_way(view: StepView, row: int, other: int, lane: int) -> bool:
    """Whether the EMV would meet another vehicle if it kept its present lateral offset on the road."""
    seen, both = view.seen, np.array([row, other])
    curve = reference_line(view, row, lane).curve
    _, left, nearest = curve.project(seen.x_m[both], seen.y_m[both])
    turned = seen.yaw_rad[both] - curve.heading_rad[nearest]
    half = np.abs(np.cos(turned)) * seen.half_width_m[both] + np.abs(np.sin(turned)) * seen.half_length_m[both]
    return bool(abs(left[1] - left[0]) < half.sum() + view.world.config.corridor.clearance_m)


def escape_path(unit: EmvUnit, view: StepView, row: int) -> Outcome:
    """``BuildGapEscapeWaypoints``: the EMV with a path through free space, planned again from time to time.

    A path that is free to its end and still long enough is kept. If no other path is found, the present one is driven
    as far as it is free.
    """
    config = view.world.config.gap_escape
    lane = present_lane(view, row, unit.navigator)
    if lane == NO_LANE or view.step - unit.escape_planned_step < steps_from_s(config.replan_s):
        return unit, ()
    first, driving = unit.escape_planned_step < 0, unit.escape_offset_m is not None
    unit = replace(unit, escape_planned_step=view.step, plan=None)
    way = free_way(unit, view, row)
    ahead = min(way.free_m if way is not None else 0.0, unit.navigator.remaining_m)
    on_path = abs(unit.navigator.left_m) < config.off_path_m
    if driving and on_path and ahead >= max(unit.navigator.remaining_m, config.replan_below_m):
        return unit, ()
    reference = reference_line(view, row, lane)
    found = search_gap(reference, view, row)
    if found is not None:
        return _following(unit, found, reference, view, row)
    if driving and ahead > config.usable_m:
        return unit, ()
    waiting = (event_of(view, row, EventKind.GAP_ESCAPE_WAITING),) if first or driving else ()
    return replace(unit, escape_offset_m=None), waiting


def _following(unit: EmvUnit, found: FoundPath, reference: LanePath, view: StepView, row: int) -> Outcome:
    x, y, _ = view.pose(row)
    ahead = view.vehicle(row).centre_ahead_of_rear_axle_m
    curve = Curve.through(found.centre_line(reference.curve, ahead), _SMOOTHING_M)
    config, base = view.world.config.gap_escape, view.navigator_config(row)
    slowly = replace(
        base,
        lateral_accel_mps2=config.bend_accel_mps2,
        curvature_rate_1pms=config.steer_share * base.curvature_rate_1pms,
    )
    path = along_reference(curve, reference, found.s_m + ahead, slowly, found.length_m, stop_at_end=True)
    before, left = unit.escape_offset_m, float(found.left_m[-1])
    navigator = unit.navigator.following(path, x, y)
    unit = replace(unit, navigator=navigator, escape_offset_m=left, escape_clearance_m=found.clearance_m)
    if before is not None and abs(left - before) < _SAME_OFFSET_M:
        return unit, ()
    return unit, (
        event_of(
            view,
            row,
            EventKind.GAP_ESCAPE_REPLANNED,
            left_m=left,
            free_m=found.length_m,
            clearance_m=found.clearance_m,
        ),
    )


def escape_speed_mps(unit: EmvUnit, view: StepView) -> float:
    """Target speed of the gap escape: the paper's, less in a tight gap, and 0 while there is no path."""
    if unit.escape_offset_m is None:
        return 0.0
    squeeze = dict(view.world.config.gap_escape.squeezes).get(unit.escape_clearance_m, math.inf)
    return min(view.world.speeds.emv_gap_escape_mps, squeeze)
