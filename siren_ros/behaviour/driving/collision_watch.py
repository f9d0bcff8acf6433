"""Collision handling: who is ahead on the swept path, and how fast one may drive towards them."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.surroundings import Surroundings
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.numerics.arrays import Floats, Rows

_CROSSING_COSINE: Final = 0.9
"""Vehicles that move at more than about 25° to the path cross it; the others move along it."""
_MOVING_MPS: Final = 1.0
_DRIFT_SINE: Final = 0.035
"""Sideways drift of less than about 2° is noise of lane keeping."""
_DRIFT_TIME_S: Final = 1.5
_TIME_STEP_S: Final = 0.4
_OWN_ACCEL_MPS2: Final = 1.5
_SPREAD: Final = 0.1
"""Growth of a crossing vehicle's predicted extent with the way it has gone."""


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
    """Deceleration needed to avoid contact, 0 while comfortable braking is enough."""


@dataclass(frozen=True)
class _Candidates:
    """Actors that limit the speed, one row each."""

    row: Rows
    gap_m: Floats
    lead_mps: Floats


def watch_path(
    path: TrackedPath,
    progress_m: float,
    row: int,
    target_mps: float,
    seen: Surroundings,
    config: NavigatorConfig,
) -> Threat | None:
    """The most restrictive actor ahead on the corridor that the vehicle sweeps along its path.

    Actors that move along the path, or drift into it, are leaders at constant speed. Actors that cross the path count
    if the prediction at constant velocity puts both vehicles at the same place at the same time. The safe speed is
    Krauss's (1998): ``−bτ + sqrt((bτ)² + v_l² + 2b·gap)``.

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
    reach = speed * speed / (2.0 * config.comfort_brake_mps2) + 1.5 * max(speed, target_mps) + 10.0
    reach = min(max(reach, config.watch_min_m), config.watch_max_m)
    rows = seen.near(float(seen.x_m[row]), float(seen.y_m[row]), reach + 8.0, but=row)
    if len(rows) == 0:
        return None
    curve = path.curve
    first = min(max(int(progress_m / curve.spacing_m) - 2, 0), len(curve.points) - 2)
    last = first + int(reach / curve.spacing_m) + 12
    s, left, nearest = curve.project(seen.x_m[rows], seen.y_m[rows], first, last)
    turned = seen.yaw_rad[rows] - curve.heading_rad[nearest]
    along_share, left_share = np.cos(turned), np.sin(turned)
    crossing = (np.abs(along_share) < _CROSSING_COSINE) & (seen.speed_mps[rows] > _MOVING_MPS)
    leaders = _leaders(
        _PathFrame(rows, s, left, along_share, left_share, np.abs(curve.curvature_1pm[nearest]), progress_m, row),
        crossing,
        seen,
        config,
    )
    crossers = _crossers(path, progress_m, row, target_mps, rows[crossing], seen, config)
    return _worst((leaders, crossers), speed, target_mps, seen, config)


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
    corridor = own_width + config.side_margin_m + 0.5 * frame.bend_1pm * own_length**2
    speed = seen.speed_mps[frame.rows]
    gap = frame.s_m - extent - (frame.progress_m + own_length)
    beside = np.abs(frame.left_m) - side
    drifted = np.abs(frame.left_m + _DRIFT_TIME_S * speed * frame.left_share) - side
    inside = (beside < corridor) & ((gap > -0.5) | (beside < own_width))
    drifting = (drifted < corridor) & (along_sin > _DRIFT_SINE) & (gap > 0.0)
    picked = (frame.s_m > frame.progress_m) & ~crossing & (inside | drifting)
    lead = speed[picked] * frame.along_share[picked]
    return _Candidates(
        row=frame.rows[picked],
        gap_m=np.maximum(gap[picked] + _DRIFT_TIME_S * np.minimum(lead, 0.0), 0.0),
        lead_mps=np.maximum(lead, 0.0),
    )


def _crossers(
    path: TrackedPath,
    progress_m: float,
    row: int,
    target_mps: float,
    rows: Rows,
    seen: Surroundings,
    config: NavigatorConfig,
) -> _Candidates:
    if len(rows) == 0:
        return _Candidates(rows, np.empty(0), np.empty(0))
    t = np.arange(0.0, config.watch_time_s, _TIME_STEP_S)
    speed = float(seen.speed_mps[row])
    way = np.minimum(speed * t + 0.5 * _OWN_ACCEL_MPS2 * t * t, max(speed, target_mps) * t)
    place = np.minimum(progress_m + way, path.length_m)
    own = path.curve.at(place)
    heading = path.curve.heading_at(place)
    cos, sin = np.cos(heading), np.sin(heading)
    other_speed = seen.speed_mps[rows]
    gone = other_speed[:, None] * t
    dx = seen.x_m[rows][:, None] + seen.cos[rows][:, None] * gone - own[:, 0]
    dy = seen.y_m[rows][:, None] + seen.sin[rows][:, None] * gone - own[:, 1]
    ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
    turned = seen.yaw_rad[rows][:, None] - heading
    turn_cos, turn_sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    half_length = seen.half_length_m[rows][:, None] + _SPREAD * gone
    half_width = seen.half_width_m[rows][:, None]
    extent = turn_cos * half_length + turn_sin * half_width
    side = turn_sin * half_length + turn_cos * half_width
    own_length, own_width = float(seen.half_length_m[row]), float(seen.half_width_m[row])
    meets = (
        (np.abs(aside) < side + own_width + config.side_margin_m)
        & (np.abs(ahead) < extent + own_length + config.crossing_margin_m)
        & (ahead > -0.5 * own_length)
    )
    hit = meets.any(axis=1)
    when = np.argmax(meets[hit], axis=1)
    gap = way[when] + ahead[hit, when] - extent[hit, when] - own_length
    return _Candidates(row=rows[hit], gap_m=np.maximum(gap, 0.0), lead_mps=np.zeros(len(when)))


def _worst(
    groups: tuple[_Candidates, ...],
    speed_mps: float,
    target_mps: float,
    seen: Surroundings,
    config: NavigatorConfig,
) -> Threat | None:
    rows = np.concatenate([group.row for group in groups])
    if len(rows) == 0:
        return None
    gap = np.concatenate([group.gap_m for group in groups])
    lead = np.concatenate([group.lead_mps for group in groups])
    brake, reaction = config.comfort_brake_mps2, config.headway_s
    free = np.maximum(gap - config.standstill_gap_m, 0.0)
    safe = np.sqrt((brake * reaction) ** 2 + lead * lead + 2.0 * brake * free) - brake * reaction
    worst = int(np.argmin(safe))
    if safe[worst] >= target_mps:
        return None
    closing = np.maximum(speed_mps * speed_mps - lead * lead, 0.0)
    needed = float(np.max(closing / (2.0 * np.maximum(gap - 1.0, 0.3))))
    return Threat(
        snapshot=CollisionSnapshot(int(seen.actor_id[rows[worst]]), float(gap[worst]), float(lead[worst])),
        safe_speed_mps=float(safe[worst]),
        must_brake_mps2=needed if needed > brake and speed_mps > 0.3 else 0.0,
    )
