"""Collision handling where the ways of others meet the path: who waits, and how fast one may drive meanwhile."""

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.collision_watch import (
    CROSSING_COSINE,
    MOVING_MPS,
    CollisionSnapshot,
    Threat,
    stricter,
    watch_reach_m,
)
from siren_ros.behaviour.driving.surroundings import Surroundings
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.conflicts.course import Course
from siren_ros.conflicts.right_of_way import Rank
from siren_ros.conflicts.yielding import Approach, wait_for
from siren_ros.conflicts.zones import Way, Zone, meeting_zones
from siren_ros.numerics.arrays import Floats, Rows

_OWN_ACCEL_MPS2: Final = 1.5
_OTHERS_TIME_S: Final = 6.0
"""How far ahead others are followed, at their present speed."""
_OTHERS_MORE_M: Final = 10.0
_OTHERS_MOST_M: Final = 60.0
_ROLLING_MPS: Final = 0.3


def watch_conflicts(
    path: TrackedPath,
    progress_m: float,
    row: int,
    target_mps: float,
    seen: Surroundings,
    config: NavigatorConfig,
    *,
    leaders: bool = True,
) -> Threat | None:
    """The most restrictive of the vehicles that one lets pass first.

    Arguments as for ``watch_path``. Who leads on the path counts here too where ``leaders`` is set: one whose rear is
    beside the own front already is no leader on the path, but may turn into it.
    """
    speed = float(seen.speed_mps[row])
    reach = watch_reach_m(speed, target_mps, config)
    rows = _meeting(seen, row, reach)
    if len(rows) == 0:
        return None
    half_length, half_width = float(seen.half_length_m[row]), float(seen.half_width_m[row])
    pose = float(seen.x_m[row]), float(seen.y_m[row]), float(seen.yaw_rad[row])
    own = Way(path.curve.points, path.curve.spacing_m, progress_m, 0.0, pose, reach, half_length, half_width, cut_m=0.0)
    reaches = _reach_m(seen.speed_mps[rows]).tolist()
    others = [_way(seen, other, far) for other, far in zip(rows.tolist(), reaches, strict=True)]
    bend_time_s = partial(path.least_time_s, progress_m)
    worst: Threat | None = None
    for other, zone in zip(rows.tolist(), meeting_zones(own, others, config.side_margin_m), strict=True):
        if zone is not None and (not zone.leads or (leaders and zone.merges)):
            worst = stricter(worst, _threat(zone, (row, other), bend_time_s, target_mps, seen, config))
    return worst


def _meeting(seen: Surroundings, row: int, reach_m: float) -> Rows:
    """Rows of moving vehicles that may come to the path, without those that merely follow."""
    x, y = float(seen.x_m[row]), float(seen.y_m[row])
    rows = seen.near(x, y, reach_m + _OTHERS_MOST_M, but=row)
    rows = rows[seen.speed_mps[rows] > MOVING_MPS]
    cos, sin = float(seen.cos[row]), float(seen.sin[row])
    dx, dy = seen.x_m[rows] - x, seen.y_m[rows] - y
    ahead = cos * dx + sin * dy
    along = cos * seen.cos[rows] + sin * seen.sin[rows]
    far = np.hypot(dx, dy) > reach_m + _reach_m(seen.speed_mps[rows])
    behind = (ahead < 0.0) & (along > CROSSING_COSINE)
    return np.asarray(rows[~far & ~behind])


def _reach_m(speed_mps: Floats) -> Floats:
    return np.minimum(_OTHERS_TIME_S * speed_mps + _OTHERS_MORE_M, _OTHERS_MOST_M)


def _way(seen: Surroundings, row: int, reach_m: float) -> Way:
    if seen.outlook is not None:
        return seen.outlook.way(row, reach_m)
    pose = float(seen.x_m[row]), float(seen.y_m[row]), float(seen.yaw_rad[row])
    course = Course.straight(*pose)
    half_length, half_width = float(seen.half_length_m[row]), float(seen.half_width_m[row])
    return Way(course.points, course.spacing_m, 0.0, 0.0, pose, reach_m, half_length, half_width)


def _threat(
    zone: Zone,
    rows: tuple[int, int],
    bend_time_s: Callable[[float], float],
    target_mps: float,
    seen: Surroundings,
    config: NavigatorConfig,
) -> Threat | None:
    row, other = rows
    outlook = seen.outlook
    own_speed, speed = float(seen.speed_mps[row]), float(seen.speed_mps[other])
    own_rank = rank = Rank.PRIORITY
    top = speed
    if outlook is not None:
        own_rank, rank = outlook.rank(row, zone.own_in_m), outlook.rank(other, zone.other_in_m)
        top = max(outlook.limit_mps(other, zone.other_in_m), _ROLLING_MPS)
    own = Approach(own_speed, target_mps, _OWN_ACCEL_MPS2, own_rank, bend_time_s)
    wait = wait_for(zone, own, Approach(speed, top, config.conflicts.early_mps2, rank), config.conflicts)
    if wait is None:
        return None
    hard = wait.brake_mps2 > config.comfort_brake_mps2 and own_speed > _ROLLING_MPS
    return Threat(
        snapshot=CollisionSnapshot(int(seen.actor_id[other]), wait.free_m, speed if zone.merges else 0.0),
        safe_speed_mps=wait.speed_mps,
        must_brake_mps2=wait.brake_mps2 if hard else 0.0,
    )
