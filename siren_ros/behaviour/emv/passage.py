"""Driving between other vehicles: how near the EMV's footprint comes to them, and how fast it may go."""

from typing import Final

import numpy as np

from siren_ros.behaviour.driving.collision_watch import CollisionSnapshot
from siren_ros.behaviour.driving.free_space import Body, FreeWay, Obstacles, SpeedLimit
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.emv.unit import EmvUnit
from siren_ros.numerics.arrays import Flags, Rows
from siren_ros.world.actors import NO_ACTOR

UNLIMITED: Final = SpeedLimit()
_ALONG: Final = 0.7
"""Cosine above which a vehicle counts as one of the EMV's own direction."""
_CROSSING_MPS: Final = 1.0
"""Faster vehicles that cross the EMV's path are the collision handling's, where that is on."""
_BESIDE_M: Final = 30.0


def rows_around(view: StepView, row: int) -> tuple[Rows, Flags]:
    """Rows of the vehicles around the EMV, and which of them point in its direction."""
    seen = view.seen
    x, y, yaw = view.pose(row)
    rows = seen.near(x, y, view.world.config.gap_escape.horizon_m + _BESIDE_M, but=row)
    return rows, np.cos(seen.yaw_rad[rows] - yaw) > _ALONG


def free_way(unit: EmvUnit, view: StepView, row: int) -> FreeWay | None:
    """How near the EMV's footprint comes to others along its path; None without a path.

    In the corridor, vehicles ahead are expected to keep moving. During a gap escape they may stop at once.
    """
    navigator, config = unit.navigator, view.world.config.gap_escape
    if navigator.path is None:
        return None
    rows, along = rows_around(view, row)
    speed = view.seen.speed_mps[rows]
    counts = along | (speed < _CROSSING_MPS) | unit.gap_escape_active
    rows, along, speed = rows[counts], along[counts], speed[counts]
    time_s = np.where(along, 0.0, config.watch_s)
    credit = np.where(along & (not unit.gap_escape_active), speed**2 / (2.0 * config.leader_brake_mps2), 0.0)
    obstacles, body = Obstacles.swept(view.seen, rows, time_s), Body.of(view.seen, row)
    x, y, yaw = view.pose(row)
    progress, left = navigator.path.curve.nearest_to(navigator.progress_m, x, y)
    rear = view.vehicle(row).centre_ahead_of_rear_axle_m
    return FreeWay.along(navigator.path, (progress, left, yaw), rear, config.horizon_m, body, obstacles, credit)


def passage_blocker(snapshot: CollisionSnapshot | None, limit: SpeedLimit) -> CollisionSnapshot | None:
    """The navigator's snapshot, or else the actor whom the EMV cannot pass."""
    if snapshot is None and limit.blocker_id != NO_ACTOR:
        return CollisionSnapshot(limit.blocker_id, limit.free_m, 0.0)
    return snapshot


def passage_limit(unit: EmvUnit, view: StepView, row: int) -> SpeedLimit:
    """How fast the EMV may go between others in the corridor and during a gap escape.

    The collision handling would keep too much distance from vehicles that the EMV squeezes past, or is off. This limit
    follows from the footprint itself along the path.
    """
    if not (unit.gap_escape_active or unit.corridor):
        return UNLIMITED
    way, config = free_way(unit, view, row), view.world.config
    if way is None:
        return UNLIMITED
    speed, brake = float(view.seen.speed_mps[row]), config.gap_escape.brake_mps2
    if unit.gap_escape_active:
        escape = config.gap_escape
        return way.limit(speed, escape.squeezes, escape.stop_short_m, brake, escape.touch_m)
    corridor = config.corridor
    return way.limit(speed, corridor.squeezes, corridor.stop_short_m, brake, corridor.clearance_m)
