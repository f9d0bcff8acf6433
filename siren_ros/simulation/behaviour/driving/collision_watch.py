"""Collision handling: limits a driver's speed for vehicles ahead on its path and for those whose paths meet it."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Points, Rows
from siren_ros.base.numerics.braking import braking_distance_m, safe_following_mps
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled
from siren_ros.simulation.behaviour.driving.navigator import SpeedLimit
from siren_ros.simulation.behaviour.driving.step_view import (
    SEEN_COS,
    SEEN_HALF_LENGTH,
    SEEN_HALF_WIDTH,
    SEEN_SIN,
    SEEN_SPEED,
    SEEN_SQUARE,
    Surroundings,
)
from siren_ros.simulation.behaviour.driving.tracked_path import Curve, Navigation, TrackedPath, nearest_point
from siren_ros.simulation.conflicts.course import SPACING_M, Course, Rights, limit_at_mps, rank_at
from siren_ros.simulation.conflicts.yielding import Approach, Bends, Margins, least_wait, stop_brake_mps2
from siren_ros.simulation.conflicts.zones import (
    CUT,
    OTHER,
    REACH,
    SAME_DIRECTION,
    Way,
    Ways,
    Zone,
    follows_course,
    zones_of,
)


def stricter(first: SpeedLimit | None, second: SpeedLimit | None) -> SpeedLimit | None:
    """Combine two limits: the lower speed with its actor, and the harder braking."""
    if first is None or second is None:
        return first or second
    worse = first if first.speed_mps <= second.speed_mps else second
    return worse._replace(brake_mps2=max(first.brake_mps2, second.brake_mps2))


_WATCH_MIN_M: Final = 20.0
"""Least distance that drivers watch ahead."""
_WATCH_MAX_M: Final = 70.0
"""Largest distance that drivers watch ahead, if they can stop within it."""
_CROSSING_COSINE: Final = 0.9
"""Vehicles at more than about 25° to the path cross it; others move along it."""
MOVING_MPS: Final = 1.0
"""Slower vehicles count as leaders in any direction."""
DRIFT_SINE: Final = 0.035
"""Lateral drift below about 2° is noise of lane keeping."""
_DRIFT_TIME_S: Final = 1.5
"""Time for which lateral drift is extrapolated."""
_TURNING_SINE: Final = 0.17
"""Oncoming vehicles at more than about 10° to the path turn across it."""
_OTHERS_TIME_S: Final = 6.0
"""Time for which others are predicted at their present speed."""
_OTHERS_MORE_M: Final = 10.0
"""Distance added to that prediction."""
_OTHERS_MOST_M: Final = 60.0
"""Largest distance of that prediction."""
ROLLING_MPS: Final = 0.3
"""Slower vehicles stop without further braking."""


class _Driver(NamedTuple):
    """The driver as compiled code takes it: fields of ``CollisionWatch``, then of its ``Navigation``."""

    row: int
    progress_m: float
    target_mps: float
    reach_m: float
    side_margin_m: float
    standstill_gap_m: float
    comfort_brake_mps2: float
    headway_s: float
    own_accel_mps2: float


@dataclass(frozen=True, eq=False)
class CollisionWatch:
    """View of one driver on the others at one step."""

    path: TrackedPath
    progress_m: float
    """Position of the driver's vehicle on the path."""
    row: int
    """The driver's row in ``seen``."""
    target_mps: float
    """Speed on a free path."""
    seen: Surroundings
    config: Navigation

    @property
    def reach_m(self) -> float:
        """Distance ahead of its centre that the vehicle watches."""
        speed, config = float(self.seen.speed_mps[self.row]), self.config
        braking = braking_distance_m(speed * speed, config.comfort_brake_mps2)
        most_m = max(_WATCH_MAX_M, braking + _WATCH_MIN_M)
        return min(max(braking + 1.5 * max(speed, self.target_mps) + 10.0, _WATCH_MIN_M), most_m)

    def leaders(self) -> SpeedLimit | None:
        """Limit for the most restrictive actor ahead in the corridor that the vehicle sweeps; None on a free path.

        Actors that stand or move along the path are leaders at constant speed along it, also those that drift into it;
        those that cross it belong to ``meetings``. The safe speed is Krauss's (``safe_following_mps``).
        """
        seen = self.seen
        ways = _UNKNOWN if seen.outlook is None else seen.outlook.ways
        return self._limit(_strictest_leader(seen.bodies, self.path.curve, self._driver, ways))

    def meetings(self, *, leaders: bool = True) -> SpeedLimit | None:
        """Limit for the most restrictive vehicle that the driver must let pass; None if there is none.

        With ``leaders``, vehicles that lead on the path count too: one whose rear is beside the driver's front already
        is no leader on the path, but may turn into it.
        """
        seen, path = self.seen, self.path
        ways, rights = _straight_on(seen) if seen.outlook is None else (seen.outlook.ways, seen.outlook.rights)
        bends, margins = Bends(path.times_s, path.curve.spacing_m, self.progress_m), self.config.conflicts
        who = seen.bodies, seen.is_emv
        return self._limit(
            _strictest_wait(*who, ways, rights, path.curve.points, bends, self._driver, leaders, margins)
        )

    @property
    def _driver(self) -> _Driver:
        own, keeps = (self.row, self.progress_m, self.target_mps, self.reach_m), self.config
        gaps = keeps.side_margin_m, keeps.standstill_gap_m
        return _Driver(*own, *gaps, keeps.comfort_brake_mps2, keeps.headway_s, keeps.own_accel_mps2)

    def _limit(self, found: SpeedLimit) -> SpeedLimit | None:
        """A limit with the actor's id in place of its row; None without one."""
        row = found.blocker_id
        return None if row < 0 else found._replace(blocker_id=int(self.seen.actor_id[row]))


def _straight_on(seen: Surroundings) -> tuple[Ways, Rights]:
    """Paths of all vehicles if no courses are known: straight ahead."""
    poses = zip(seen.x_m.tolist(), seen.y_m.tolist(), seen.yaw_rad.tolist(), strict=True)
    bodies = zip(poses, seen.half_length_m.tolist(), seen.half_width_m.tolist(), strict=True)
    ways = Ways.of(
        [Way(Course.straight(*pose).points, SPACING_M, 0.0, 0.0, pose, 0.0, *size) for pose, *size in bodies]
    )
    none, never = np.zeros(len(seen.x_m), np.intp), np.empty(0)
    return ways, Rights(np.repeat(seen.speed_mps, ways.last - ways.first), none, none, never, never.astype(np.intp))


_PART_HALF_LENGTH_M: Final = 2.5
"""Half the length of a car; longer vehicles are checked in parts of this size."""
_UNKNOWN: Final = Ways(np.empty((0, 2)), np.empty(0, np.intp), np.empty(0, np.intp), np.empty((0, CUT + 1)))
"""Paths if no courses are known."""


@compiled
def _leads(
    bodies: Floats,
    other: int,
    from_middle_m: float,
    curve: Curve,
    first: int,
    end: int,
    driver: _Driver,
    ways: Ways,
) -> tuple[bool, float, float, bool]:
    """Whether a vehicle leads, its gap and speed along the path, and whether it meets what the driver sweeps.

    A vehicle leads that is ahead in the corridor of the driver.

    ``from_middle_m`` says which part of the vehicle is looked at, as a vehicle of its own, by the part's middle: the
    path turns along a long vehicle. The path is looked at from its point ``first`` until ``end``.
    """
    own_length, own_width = bodies[SEEN_HALF_LENGTH, driver.row], bodies[SEEN_HALF_WIDTH, driver.row]
    x_m = bodies[X, other] + from_middle_m * bodies[SEEN_COS, other]
    y_m = bodies[Y, other] + from_middle_m * bodies[SEEN_SIN, other]
    s_m, left_m, nearest = nearest_point(curve, x_m, y_m, first, end)
    if s_m <= driver.progress_m:
        return False, 0.0, 0.0, False
    speed, half_width = bodies[SEEN_SPEED, other], bodies[SEEN_HALF_WIDTH, other]
    half_length = min(bodies[SEEN_HALF_LENGTH, other], _PART_HALF_LENGTH_M)
    turned = bodies[YAW, other] - curve.heading_rad[nearest]
    along, across = np.cos(turned), np.sin(turned)
    extent = abs(along) * half_length + abs(across) * half_width
    side = abs(across) * half_length + abs(along) * half_width
    swept = own_width + 0.5 * abs(curve.curvature_1pm[nearest]) * own_length**2
    corridor = swept + driver.side_margin_m
    gap = s_m - extent - (driver.progress_m + own_length)
    beside = abs(left_m) - side
    drifted = abs(left_m + _DRIFT_TIME_S * speed * across) - side
    inside = beside < corridor and (gap > -0.5 or beside < own_width)
    moving = speed > MOVING_MPS
    crossing = abs(along) < _CROSSING_COSINE and moving
    # An oncoming vehicle at an angle turns out of the way or into it, as does one that turns along its course; its
    # predicted course decides.
    turning = abs(across) > _TURNING_SINE and moving and len(ways.first) > 0
    drifting = drifted < corridor and abs(across) > DRIFT_SINE and gap > 0.0 and along > 0.0
    drifting = drifting and not (turning and follows_course(ways, other))
    known = turning and along < 0.0
    leads = not (crossing or known) and (inside or drifting)
    return leads, gap, speed * along, drifting or beside < swept


@compiled
def _strictest_leader(bodies: Floats, curve: Curve, driver: _Driver, ways: Ways) -> SpeedLimit:
    """The limit for the most restrictive leader on a path; its row, −1 without one, stands for its id.

    ``ways`` are the vehicles' ways, row by row, where their courses are known.
    """
    row, brake_mps2, own_speed = driver.row, driver.comfort_brake_mps2, bodies[SEEN_SPEED, driver.row]
    first = min(max(int(driver.progress_m / curve.spacing_m) - 2, 0), len(curve.points) - 2)
    end = min(first + int(driver.reach_m / curve.spacing_m) + 12, len(curve.points))
    around_m = driver.reach_m + 8.0
    worst, least, least_gap, needed = -1, np.inf, np.inf, 0.0
    for other in range(bodies.shape[1]):
        dx, dy = bodies[X, other] - bodies[X, row], bodies[Y, other] - bodies[Y, row]
        if other == row or dx * dx + dy * dy >= around_m * around_m:
            continue
        beyond = max(bodies[SEEN_HALF_LENGTH, other] - _PART_HALF_LENGTH_M, 0.0)
        parts = int(np.ceil(beyond / _PART_HALF_LENGTH_M))
        gap, approaching, meets = np.inf, 0.0, False
        for part in range(parts + 1):
            at_m = beyond * (2.0 * part / parts - 1.0) if parts else 0.0
            leads, part_m, along_mps, touches = _leads(bodies, other, at_m, curve, first, end, driver, ways)
            if leads:
                meets = meets or touches
                if part_m < gap:
                    gap, approaching = part_m, along_mps
        if gap == np.inf:
            continue
        gap, lead = max(gap + _DRIFT_TIME_S * min(approaching, 0.0), 0.0), max(approaching, 0.0)
        safe = safe_following_mps(lead, max(gap - driver.standstill_gap_m, 0.0), brake_mps2, driver.headway_s)
        if safe < least:
            worst, least, least_gap = other, safe, gap
        if meets:
            closing = max(own_speed - lead, 0.0)
            needed = max(needed, closing * closing / (2.0 * max(gap - 1.0, 0.3)))
    if least >= driver.target_mps:
        worst = -1
    brake = needed if worst >= 0 and needed > brake_mps2 and own_speed > 0.3 else 0.0
    return SpeedLimit(least, brake, worst, least_gap)


@compiled
def _approaching(bodies: Floats, driver: _Driver, reach_m: Floats) -> Rows:
    """Pairs of the driver and vehicles that may reach the path, without those that only follow, or stand along it.

    Fills in ``reach_m``: how far ahead each one is looked at.
    """
    row = driver.row
    around_m, cos, sin = driver.reach_m + _OTHERS_MOST_M, bodies[SEEN_COS, row], bodies[SEEN_SIN, row]
    pairs, count = np.zeros((bodies.shape[1], 2), np.intp), 0
    for other in range(bodies.shape[1]):
        dx, dy, speed = bodies[X, other] - bodies[X, row], bodies[Y, other] - bodies[Y, row], bodies[SEEN_SPEED, other]
        along = cos * bodies[SEEN_COS, other] + sin * bodies[SEEN_SIN, other]
        stands = speed <= MOVING_MPS and abs(along) > SAME_DIRECTION
        if other == row or dx * dx + dy * dy >= around_m * around_m or stands:
            continue
        reach_m[other] = min(_OTHERS_TIME_S * speed + _OTHERS_MORE_M, _OTHERS_MOST_M)
        behind = cos * dx + sin * dy < 0.0 and along > _CROSSING_COSINE
        if np.hypot(dx, dy) <= driver.reach_m + reach_m[other] and not behind:
            pairs[count, OTHER] = other
            count += 1
    return pairs[:count]


@compiled
def _clear_of(own_in_m: float, blocked_m: float, own_mps: float, margins: Margins) -> tuple[float, float, float]:
    """The wait for a vehicle that stands across the path: a stop before its way, while its body blocks the path."""
    free_m = max(own_in_m - margins.standoff_m, 0.0)
    if blocked_m == np.inf or own_in_m <= 0.0 or stop_brake_mps2(own_mps, own_in_m) > margins.commit_mps2:
        return np.inf, 0.0, free_m
    return np.sqrt(2.0 * margins.brake_mps2 * free_m), 0.0, free_m


@compiled
def _strictest_wait(
    seen: Floats,
    is_emv: Flags,
    ways: Ways,
    rights: Rights,
    points: Points,
    bends: Bends,
    driver: _Driver,
    leaders: bool,
    margins: Margins,
) -> SpeedLimit:
    """The limit for the vehicle that makes a driver wait most; its row, −1 without one, stands for its id.

    The hardest braking is that for any vehicle. ``points`` and ``bends`` are of the driver's path.

    No red light makes an EMV wait: of two with the same right of way the one in the first row goes first. For a vehicle
    that stands across the path, so that its body is in the way, the driver leaves free what that vehicle sweeps when it
    goes on: behind its body alone both would wait for each other.
    """
    row, worst, least, hardest, free_m = driver.row, -1, np.inf, 0.0, np.inf
    bodies = ways.bodies.copy()
    pairs = _approaching(seen, driver, bodies[:, REACH])
    if len(pairs) == 0:
        return SpeedLimit(least, hardest, worst, free_m)
    x_m, y_m, yaw_rad, own_mps = seen[X, row], seen[Y, row], seen[YAW, row], seen[SEEN_SPEED, row]
    half_length_m, half_width_m = seen[SEEN_HALF_LENGTH, row], seen[SEEN_HALF_WIDTH, row] + driver.side_margin_m
    spacing_m, place_m, reach_m = bends.spacing_m, bends.place_m, driver.reach_m
    body = np.array([[x_m, y_m, yaw_rad, spacing_m, place_m, 0.0, reach_m, half_length_m, half_width_m, 0.0]])
    path = Ways(points, np.zeros(1, np.intp), np.full(1, len(points)), body)
    zones = zones_of(path, Ways(ways.points, ways.first, ways.last, bodies), pairs, leaders)
    for p in range(len(pairs)):
        other = pairs[p, OTHER]
        met, own_in, own_out, other_in, other_out, along, blocked, blocked_along = zones[p]
        leads, merges = blocked_along > SAME_DIRECTION, along > SAME_DIRECTION
        if met == 0.0 or (leads and not (leaders and merges)):
            continue
        if seen[SEEN_SPEED, other] <= MOVING_MPS:
            speed, brake, free = _clear_of(own_in, blocked if leaders else np.inf, own_mps, margins)
        else:
            zone = Zone(own_in, own_out, other_in, other_out, along, blocked, blocked_along)
            top = max(limit_at_mps(ways, rights, other, other_in), ROLLING_MPS)
            no_bends = Bends(np.empty(0), 1.0, 0.0)
            own_rank, rank = rank_at(ways, rights, row, own_in), rank_at(ways, rights, other, other_in)
            if is_emv[row] and is_emv[other]:
                own_rank, rank = 2 * own_rank + (row < other), 2 * rank + (other < row)
            comes = Approach(own_mps, driver.target_mps, driver.own_accel_mps2, own_rank, bends, 2.0 * half_length_m)
            approach = Approach(
                seen[SEEN_SPEED, other], top, margins.early_mps2, rank, no_bends, 2.0 * seen[SEEN_HALF_LENGTH, other]
            )
            speed, brake, free = least_wait(zone, comes, approach, seen[SEEN_SQUARE, other], margins)
        if speed == np.inf:
            continue
        if worst < 0 or speed < least:
            worst, least, free_m = other, speed, free
        if brake > driver.comfort_brake_mps2 and own_mps > ROLLING_MPS:
            hardest = max(hardest, brake)
    return SpeedLimit(least, hardest, worst, free_m)
