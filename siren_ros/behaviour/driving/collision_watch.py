"""Collision handling: who is ahead on the path, whose way meets it, and how fast a driver may go towards them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.step_view import Surroundings
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.conflicts.course import Course
from siren_ros.conflicts.yielding import Approach, Rank, wait_for
from siren_ros.conflicts.zones import Way, Zone, meeting_zones
from siren_ros.numerics.arrays import Floats, Rows
from siren_ros.numerics.braking import braking_distance_m, needed_brake_mps2, safe_following_mps


@dataclass(frozen=True)
class CollisionSnapshot:
    """The actor that blocks the path."""

    actor_id: int
    gap_m: float
    """Free way of the front bumper along the path."""
    speed_mps: float
    """Of the blocker along the path."""


@dataclass(frozen=True)
class Threat:
    """What the collision handling asks of the speed control."""

    snapshot: CollisionSnapshot
    safe_speed_mps: float
    must_brake_mps2: float
    """Deceleration needed to avoid contact with who keeps its speed, 0 while comfortable braking is enough."""


@dataclass(frozen=True)
class _Candidates:
    """Actors that limit the speed, one row each."""

    row: Rows
    gap_m: Floats
    lead_mps: Floats
    met: npt.NDArray[np.bool_]
    """Whether the own body would touch them, not only its margin."""


def watch_path(
    path: TrackedPath,
    progress_m: float,
    row: int,
    target_mps: float,
    seen: Surroundings,
    config: NavigatorConfig,
) -> Threat | None:
    """The most restrictive actor ahead on the corridor that the vehicle sweeps along its path.

    Actors that stand or move along the path are leaders at constant speed along it, also those that drift into it;
    those that cross it are ``conflict_watch``'s. The safe speed is Krauss's (1998):
    ``−bτ + sqrt((bτ)² + v_l² + 2b·gap)``.

    Args:
        path: Own path.
        progress_m: Own place on it.
        row: Own row in ``seen``.
        target_mps: Speed that would be driven on a free path.
        seen: All actors.
        config: Margins, headway and horizons.

    Returns:
        The threat, or None on a free path.
    """
    speed = float(seen.speed_mps[row])
    reach = watch_reach_m(speed, target_mps, config)
    rows = seen.near(float(seen.x_m[row]), float(seen.y_m[row]), reach + 8.0, but=row)
    if len(rows) == 0:
        return None
    curve = path.curve
    first = min(max(int(progress_m / curve.spacing_m) - 2, 0), len(curve.points) - 2)
    last = first + int(reach / curve.spacing_m) + 12
    s, left, nearest = curve.project(seen.x_m[rows], seen.y_m[rows], first, last)
    turned = seen.yaw_rad[rows] - curve.heading_rad[nearest]
    along_share, left_share = np.cos(turned), np.sin(turned)
    crossing = (np.abs(along_share) < config.crossing_cosine) & (seen.speed_mps[rows] > config.moving_mps)
    leaders = _leaders(
        _PathFrame(rows, s, left, along_share, left_share, np.abs(curve.curvature_1pm[nearest]), progress_m, row),
        crossing,
        seen,
        config,
    )
    return _worst(leaders, speed, target_mps, seen, config)


def watch_reach_m(speed_mps: float, target_mps: float, config: NavigatorConfig) -> float:
    """How far ahead of its centre a vehicle looks."""
    reach = (
        braking_distance_m(speed_mps * speed_mps, config.comfort_brake_mps2) + 1.5 * max(speed_mps, target_mps) + 10.0
    )
    return min(max(reach, config.watch_min_m), config.watch_max_m)


def stricter(first: Threat | None, second: Threat | None) -> Threat | None:
    """Both threats as one: the lower safe speed with its actor, and the harder braking."""
    if first is None or second is None:
        return first or second
    worse = first if first.safe_speed_mps <= second.safe_speed_mps else second
    return replace(worse, must_brake_mps2=max(first.must_brake_mps2, second.must_brake_mps2))


@dataclass(frozen=True, eq=False)
class _PathFrame:
    rows: Rows
    s_m: Floats
    left_m: Floats
    along_share: Floats
    left_share: Floats
    bend_1pm: Floats
    progress_m: float
    own_row: int


def _leaders(
    frame: _PathFrame, crossing: npt.NDArray[np.bool_], seen: Surroundings, config: NavigatorConfig
) -> _Candidates:
    half_length, half_width = seen.half_length_m[frame.rows], seen.half_width_m[frame.rows]
    own_length, own_width = float(seen.half_length_m[frame.own_row]), float(seen.half_width_m[frame.own_row])
    along_cos, along_sin = np.abs(frame.along_share), np.abs(frame.left_share)
    extent = along_cos * half_length + along_sin * half_width
    side = along_sin * half_length + along_cos * half_width
    swept = own_width + 0.5 * frame.bend_1pm * own_length**2
    corridor = swept + config.side_margin_m
    speed = seen.speed_mps[frame.rows]
    gap = frame.s_m - extent - (frame.progress_m + own_length)
    beside = np.abs(frame.left_m) - side
    drifted = np.abs(frame.left_m + config.drift_time_s * speed * frame.left_share) - side
    inside = (beside < corridor) & ((gap > -0.5) | (beside < own_width))
    # Who comes on at an angle is turning out of the way or into it: the outlook knows, a straight line does not.
    drifting = (drifted < corridor) & (along_sin > config.drift_sine) & (gap > 0.0) & (frame.along_share > 0.0)
    oncoming = (frame.along_share < 0.0) & (along_sin > config.turning_sine) & (speed > config.moving_mps)
    known = oncoming & (seen.outlook is not None)
    picked = (frame.s_m > frame.progress_m) & ~crossing & ~known & (inside | drifting)
    lead = speed[picked] * frame.along_share[picked]
    return _Candidates(
        row=frame.rows[picked],
        gap_m=np.maximum(gap[picked] + config.drift_time_s * np.minimum(lead, 0.0), 0.0),
        lead_mps=np.maximum(lead, 0.0),
        met=(drifting | (beside < swept))[picked],
    )


def _worst(
    leaders: _Candidates,
    speed_mps: float,
    target_mps: float,
    seen: Surroundings,
    config: NavigatorConfig,
) -> Threat | None:
    rows, gap, lead = leaders.row, leaders.gap_m, leaders.lead_mps
    if len(rows) == 0:
        return None
    brake = config.comfort_brake_mps2
    free = np.maximum(gap - config.standstill_gap_m, 0.0)
    safe = safe_following_mps(lead, free, brake, config.headway_s)
    worst = int(np.argmin(safe))
    if safe[worst] >= target_mps:
        return None
    closing = np.where(leaders.met, np.maximum(speed_mps - lead, 0.0), 0.0)
    needed = float(np.max(needed_brake_mps2(closing * closing, np.maximum(gap - 1.0, 0.3))))
    return Threat(
        snapshot=CollisionSnapshot(int(seen.actor_id[rows[worst]]), float(gap[worst]), float(lead[worst])),
        safe_speed_mps=float(safe[worst]),
        must_brake_mps2=needed if needed > brake and speed_mps > 0.3 else 0.0,
    )


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
    rows = _meeting(seen, row, reach, config)
    if len(rows) == 0:
        return None
    half_length, half_width = float(seen.half_length_m[row]), float(seen.half_width_m[row])
    pose = float(seen.x_m[row]), float(seen.y_m[row]), float(seen.yaw_rad[row])
    own = Way(path.curve.points, path.curve.spacing_m, progress_m, 0.0, pose, reach, half_length, half_width, cut_m=0.0)
    reaches = _reach_of_others_m(seen.speed_mps[rows], config).tolist()
    others = [_way(seen, other, far) for other, far in zip(rows.tolist(), reaches, strict=True)]
    bend_time_s = partial(path.least_time_s, progress_m)
    worst: Threat | None = None
    for other, zone in zip(rows.tolist(), meeting_zones(own, others, config.side_margin_m), strict=True):
        if zone is not None and (not zone.leads or (leaders and zone.merges)):
            worst = stricter(worst, _threat(zone, (row, other), bend_time_s, target_mps, seen, config))
    return worst


def _meeting(seen: Surroundings, row: int, reach_m: float, config: NavigatorConfig) -> Rows:
    """Rows of moving vehicles that may come to the path, without those that merely follow."""
    x, y = float(seen.x_m[row]), float(seen.y_m[row])
    rows = seen.near(x, y, reach_m + config.others_most_m, but=row)
    rows = rows[seen.speed_mps[rows] > config.moving_mps]
    cos, sin = float(seen.cos[row]), float(seen.sin[row])
    dx, dy = seen.x_m[rows] - x, seen.y_m[rows] - y
    ahead = cos * dx + sin * dy
    along = cos * seen.cos[rows] + sin * seen.sin[rows]
    far = np.hypot(dx, dy) > reach_m + _reach_of_others_m(seen.speed_mps[rows], config)
    behind = (ahead < 0.0) & (along > config.crossing_cosine)
    return np.asarray(rows[~far & ~behind])


def _reach_of_others_m(speed_mps: Floats, config: NavigatorConfig) -> Floats:
    return np.minimum(config.others_time_s * speed_mps + config.others_more_m, config.others_most_m)


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
        top = max(outlook.limit_mps(other, zone.other_in_m), config.rolling_mps)
    own = Approach(own_speed, target_mps, config.own_accel_mps2, own_rank, bend_time_s)
    wait = wait_for(zone, own, Approach(speed, top, config.conflicts.early_mps2, rank), config.conflicts)
    if wait is None:
        return None
    hard = wait.brake_mps2 > config.comfort_brake_mps2 and own_speed > config.rolling_mps
    return Threat(
        snapshot=CollisionSnapshot(int(seen.actor_id[other]), wait.free_m, speed if zone.merges else 0.0),
        safe_speed_mps=wait.speed_mps,
        must_brake_mps2=wait.brake_mps2 if hard else 0.0,
    )
