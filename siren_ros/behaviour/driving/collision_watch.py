"""Collision handling: who is ahead on the path, whose way meets it, and how fast a driver may go towards them."""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.free_space import SpeedLimit
from siren_ros.behaviour.driving.step_view import Surroundings
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.conflicts.course import Course
from siren_ros.conflicts.yielding import Approach, Rank, wait_for
from siren_ros.conflicts.zones import Way, Ways, Zone, meeting_zones
from siren_ros.numerics.arrays import Floats, Rows
from siren_ros.numerics.braking import braking_distance_m, needed_brake_mps2, safe_following_mps
from siren_ros.numerics.compiled import compiled


def stricter(first: SpeedLimit | None, second: SpeedLimit | None) -> SpeedLimit | None:
    """Both limits as one: the lower speed with its actor, and the harder braking."""
    if first is None or second is None:
        return first or second
    worse = first if first.speed_mps <= second.speed_mps else second
    return replace(worse, brake_mps2=max(first.brake_mps2, second.brake_mps2))


@dataclass(frozen=True, eq=False)
class CollisionWatch:
    """What one driver sees of the others at one step."""

    path: TrackedPath
    progress_m: float
    """Place of the driver's vehicle on the path."""
    row: int
    """The driver's row in ``seen``."""
    target_mps: float
    """Speed that would be driven on a free path."""
    seen: Surroundings
    config: NavigatorConfig

    @cached_property
    def speed_mps(self) -> float:
        """Speed of the driver's vehicle."""
        return float(self.seen.speed_mps[self.row])

    @cached_property
    def reach_m(self) -> float:
        """How far ahead of its centre the vehicle looks."""
        speed, config = self.speed_mps, self.config
        braking = braking_distance_m(speed * speed, config.comfort_brake_mps2)
        return min(max(braking + 1.5 * max(speed, self.target_mps) + 10.0, config.watch_min_m), config.watch_max_m)

    def leaders(self) -> SpeedLimit | None:
        """Limit by the most restrictive actor ahead on the corridor that the vehicle sweeps; None on a free path.

        Actors that stand or move along the path are leaders at constant speed along it, also those that drift into it;
        those that cross it belong to ``meetings``. The safe speed is Krauss's (``safe_following_mps``).
        """
        seen, config, curve, own_speed = self.seen, self.config, self.path.curve, self.speed_mps
        rows = seen.near(float(seen.x_m[self.row]), float(seen.y_m[self.row]), self.reach_m + 8.0, but=self.row)
        if len(rows) == 0:
            return None
        first = min(max(int(self.progress_m / curve.spacing_m) - 2, 0), len(curve.points) - 2)
        last = first + int(self.reach_m / curve.spacing_m) + 12
        s, left, nearest = curve.project(seen.x_m[rows], seen.y_m[rows], first, last)
        own = self.progress_m, float(seen.half_length_m[self.row]), float(seen.half_width_m[self.row])
        bodies = seen.yaw_rad, seen.speed_mps, seen.half_length_m, seen.half_width_m
        angles = config.crossing_cosine, config.drift_sine, config.turning_sine
        limits = config.side_margin_m, config.drift_time_s, config.moving_mps, *angles
        places = s, left, curve.heading_rad[nearest], curve.curvature_1pm[nearest]
        leaders, gap, approaching, met = _leaders(rows, places, bodies, own, seen.outlook is not None, limits)
        if len(leaders) == 0:
            return None
        gap = np.maximum(gap + config.drift_time_s * np.minimum(approaching, 0.0), 0.0)
        lead, brake = np.maximum(approaching, 0.0), config.comfort_brake_mps2
        safe = safe_following_mps(lead, np.maximum(gap - config.standstill_gap_m, 0.0), brake, config.headway_s)
        worst = int(np.argmin(safe))
        if safe[worst] >= self.target_mps:
            return None
        closing = np.where(met, np.maximum(own_speed - lead, 0.0), 0.0)
        needed = float(np.max(needed_brake_mps2(closing * closing, np.maximum(gap - 1.0, 0.3))))
        hard_mps2 = needed if needed > brake and own_speed > 0.3 else 0.0
        return SpeedLimit(float(safe[worst]), hard_mps2, int(seen.actor_id[leaders[worst]]), float(gap[worst]))

    def meetings(self, *, leaders: bool = True) -> SpeedLimit | None:
        """Limit by the most restrictive of the vehicles that the driver lets pass first; None without one.

        With ``leaders``, vehicles that lead on the path count too: one whose rear is beside the driver's front already
        is no leader on the path, but may turn into it.
        """
        seen, rows = self.seen, self._approaching()
        if len(rows) == 0:
            return None
        reach_m = self._reach_of_others_m(seen.speed_mps[rows])
        if seen.outlook is None:
            reaches = zip(rows.tolist(), reach_m.tolist(), strict=True)
            others = Ways.of([self._straight_way(*other) for other in reaches])
        else:
            others = seen.outlook.ways_of(rows, reach_m)
        pairs = np.stack((np.zeros_like(rows), np.arange(len(rows))), axis=-1)
        worst: SpeedLimit | None = None
        for other, zone in zip(rows.tolist(), meeting_zones(self._own_way(), others, pairs), strict=True):
            if zone is not None and (not zone.leads or (leaders and zone.merges)):
                worst = stricter(worst, self._limit_at(zone, other))
        return worst

    def _approaching(self) -> Rows:
        """Rows of moving vehicles that may come to the path, without those that merely follow."""
        seen, config, row = self.seen, self.config, self.row
        x, y = float(seen.x_m[row]), float(seen.y_m[row])
        rows = seen.near(x, y, self.reach_m + config.others_most_m, but=row)
        rows = rows[seen.speed_mps[rows] > config.moving_mps]
        cos, sin = float(seen.cos[row]), float(seen.sin[row])
        dx, dy = seen.x_m[rows] - x, seen.y_m[rows] - y
        ahead = cos * dx + sin * dy
        along = cos * seen.cos[rows] + sin * seen.sin[rows]
        far = np.hypot(dx, dy) > self.reach_m + self._reach_of_others_m(seen.speed_mps[rows])
        behind = (ahead < 0.0) & (along > config.crossing_cosine)
        return np.asarray(rows[~far & ~behind])

    def _reach_of_others_m(self, speed_mps: Floats) -> Floats:
        config = self.config
        return np.minimum(config.others_time_s * speed_mps + config.others_more_m, config.others_most_m)

    def _own_way(self) -> Ways:
        """The own path, with the margin that is kept beside the body."""
        seen, row, curve = self.seen, self.row, self.path.curve
        pose, place = (seen.x_m[row], seen.y_m[row], seen.yaw_rad[row]), (curve.spacing_m, self.progress_m, 0.0)
        size = seen.half_length_m[row], seen.half_width_m[row] + self.config.side_margin_m
        ends = np.array([0, len(curve.points)])
        return Ways(curve.points, ends[:1], ends[1:], np.array([(*pose, *place, self.reach_m, *size, 0.0)]))

    def _straight_way(self, row: int, reach_m: float) -> Way:
        seen = self.seen
        pose = float(seen.x_m[row]), float(seen.y_m[row]), float(seen.yaw_rad[row])
        course = Course.straight(*pose)
        half_length, half_width = float(seen.half_length_m[row]), float(seen.half_width_m[row])
        return Way(course.points, course.spacing_m, 0.0, 0.0, pose, reach_m, half_length, half_width)

    def _limit_at(self, zone: Zone, other: int) -> SpeedLimit | None:
        seen, config, outlook = self.seen, self.config, self.seen.outlook
        speed = top = float(seen.speed_mps[other])
        own_rank = rank = Rank.PRIORITY
        if outlook is not None:
            own_rank, rank = outlook.rank(self.row, zone.own_in_m), outlook.rank(other, zone.other_in_m)
            top = max(outlook.limit_mps(other, zone.other_in_m), config.rolling_mps)
        bend_time_s = partial(self.path.least_time_s, self.progress_m)
        own = Approach(self.speed_mps, self.target_mps, config.own_accel_mps2, own_rank, bend_time_s)
        wait = wait_for(zone, own, Approach(speed, top, config.conflicts.early_mps2, rank), config.conflicts)
        if wait is None:
            return None
        hard = wait.brake_mps2 > config.comfort_brake_mps2 and self.speed_mps > config.rolling_mps
        return SpeedLimit(wait.speed_mps, wait.brake_mps2 if hard else 0.0, int(seen.actor_id[other]), wait.free_m)


@compiled
def _leaders(rows: Any, places: Any, bodies: Any, own: Any, outlook: bool, limits: Any) -> tuple[Any, Any, Any, Any]:
    """The vehicles that lead on a path, of those in some rows; ``limits`` are fields of ``NavigatorConfig``.

    ``places`` are arc length, offset, and the path's heading and curvature at the nearest place of each; ``bodies`` are
    yaw, speed, half length and half width of all vehicles; ``own`` is the driver's place on the path, half length and
    half width; ``outlook`` says whether it is known where everybody will go.

    Returns:
        Of those that lead: row, gap between the bumpers along the path, speed along it, and whether the driver's
        vehicle would touch them, not only its margin.
    """
    s_m, left_m, heading_rad, curvature_1pm = places
    yaw_rad, speed_mps, half_length_m, half_width_m = bodies
    progress_m, own_length, own_width = own
    side_margin_m, drift_time_s, moving_mps, crossing_cosine, drift_sine, turning_sine = limits
    leaders, met = np.empty(len(rows), np.intp), np.empty(len(rows), np.bool_)
    gaps, speeds = np.empty(len(rows)), np.empty(len(rows))
    count = 0
    for n in range(len(rows)):
        row = rows[n]
        if s_m[n] <= progress_m:
            continue
        turned = yaw_rad[row] - heading_rad[n]
        along, across, speed = np.cos(turned), np.sin(turned), speed_mps[row]
        extent = abs(along) * half_length_m[row] + abs(across) * half_width_m[row]
        side = abs(across) * half_length_m[row] + abs(along) * half_width_m[row]
        swept = own_width + 0.5 * abs(curvature_1pm[n]) * own_length**2
        corridor = swept + side_margin_m
        gap = s_m[n] - extent - (progress_m + own_length)
        beside = abs(left_m[n]) - side
        drifted = abs(left_m[n] + drift_time_s * speed * across) - side
        inside = beside < corridor and (gap > -0.5 or beside < own_width)
        moving = speed > moving_mps
        crossing = abs(along) < crossing_cosine and moving
        # A vehicle that comes on at an angle turns out of the way or into it: the outlook knows which.
        drifting = drifted < corridor and abs(across) > drift_sine and gap > 0.0 and along > 0.0
        known = along < 0.0 and abs(across) > turning_sine and moving and outlook
        if not crossing and not known and (inside or drifting):
            leaders[count], gaps[count], speeds[count] = row, gap, speed * along
            met[count] = drifting or beside < swept
            count += 1
    return leaders[:count], gaps[:count], speeds[:count], met[:count]
