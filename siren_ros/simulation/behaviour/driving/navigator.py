"""The waypoint navigator: the controller of every vehicle that SUMO does not drive, and the space that is free for it.

It steers along a path with curvature feed-forward and feedback of offset and heading, and presses the pedals by
proportional-integral control over the vehicle's own force limits. Space is free where the vehicle's footprint keeps its
distance from others at the poses that it may take.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Columns, Floats, Ids, Points
from siren_ros.base.numerics.braking import braking_distance_m, needed_brake_mps2, speed_before_mps
from siren_ros.base.numerics.compiled import COS, SIN, X, Y, box_gap_m, compiled
from siren_ros.base.numerics.units import GRAVITY_MPS2, STEP_S
from siren_ros.simulation.behaviour.driving.step_view import STEER_RATE_SHARE, Body, Ego, Surroundings
from siren_ros.simulation.behaviour.driving.tracked_path import Navigation, TrackedPath, curve_place
from siren_ros.simulation.dynamics.vehicle_model import AIR_DENSITY_KGPM3, VehicleParameters
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.world.actors import NO_ACTOR

Moving: TypeAlias = tuple[float, float, float, float, float]
"""Arc length and offset (left positive) of a body on a path, its yaw and speed, and the curvature to which its wheels
are turned, NaN where that is not known."""
# These are no parameters: compiled loops contain these resolutions and tolerances as constants.
_PATH_STEP_M: Final = 0.25
_LEAST_WAY_M: Final = 0.2
_RESERVE_M: Final = 1.0
"""Distance kept to an impassable place by braking in any case."""
_TOUCH_M: Final = 0.03
"""Bodies nearer than this count as touching."""
_TOLERANCE_M: Final = 0.01
"""Amount by which a vehicle inside the clearance may still come nearer: the noise of tracking."""
_HALF_LENGTH, _HALF_WIDTH = 4, 5
"""Rows of boxes after those of a pose."""


@dataclass(frozen=True, eq=False)
class Obstacles(Columns):
    """Oriented boxes of actors, each array of shape ``(M,)``; frame ``map``."""

    actor_id: Ids
    x_m: Floats
    y_m: Floats
    cos: Floats
    sin: Floats
    half_length_m: Floats
    half_width_m: Floats

    @classmethod
    def swept(cls, seen: Surroundings, rows: npt.NDArray[np.intp], time_s: Floats) -> "Obstacles":
        """Footprints of vehicles, extended ahead by the distance that each drives in its ``time_s``."""
        half_sweep = 0.5 * time_s * seen.speed_mps[rows]
        cos, sin = seen.cos[rows], seen.sin[rows]
        x_m, y_m = seen.x_m[rows] + cos * half_sweep, seen.y_m[rows] + sin * half_sweep
        half_length_m = seen.half_length_m[rows] + half_sweep
        return cls(seen.actor_id[rows], x_m, y_m, cos, sin, half_length_m, seen.half_width_m[rows])


def separations_m(x_m: Floats, y_m: Floats, yaw_rad: Floats, body: Body, obstacles: Obstacles) -> Floats:
    """Largest gap along a separating axis between a body at some poses and each obstacle.

    It is a lower bound of the distance, and negative where the boxes overlap (separating axis theorem). The result has
    the shape to which the poses of the body's centre broadcast, with an axis for the obstacles added.
    """
    x, y, yaw = np.broadcast_arrays(x_m, y_m, yaw_rad)
    poses = np.array((x.ravel(), y.ravel(), np.cos(yaw).ravel(), np.sin(yaw).ravel()))
    return _gaps_m(poses, body, obstacles).reshape(*x.shape, len(obstacles))


def _gaps_m(poses: Floats, body: Body, obstacles: Obstacles) -> Floats:
    """``separations_m`` for poses as x, y, cosine and sine, shape ``(4, P)``; the result has shape ``(P, M)``."""
    boxes = np.array(
        (obstacles.x_m, obstacles.y_m, obstacles.cos, obstacles.sin, obstacles.half_length_m, obstacles.half_width_m)
    )
    gap = np.empty((poses.shape[1], boxes.shape[1]))
    _separate(poses, boxes, body.half_length_m, body.half_width_m, gap)
    return gap


@compiled
def _separate(poses: Floats, boxes: Floats, half_length: float, half_width: float, gap: Floats) -> None:
    """Compute the gap of a body in each pose (x, y, cosine, sine; ``(4, P)``) from each box ``(6, M)``."""
    for n in range(poses.shape[1]):
        pose = poses[X, n], poses[Y, n], poses[COS, n], poses[SIN, n]
        for m in range(boxes.shape[1]):
            box = boxes[X, m], boxes[Y, m], boxes[COS, m], boxes[SIN, m]
            gap[n, m] = box_gap_m(pose, box, half_length, half_width, boxes[_HALF_LENGTH, m], boxes[_HALF_WIDTH, m])


def clearances_m(
    x_m: Floats, y_m: Floats, yaw_rad: Floats, body: Body, obstacles: Obstacles, present_m: Floats
) -> Floats:
    """Smallest distance of a body from all obstacles, at poses as for ``separations_m``; infinite without obstacles.

    ``present_m`` is the distance from each obstacle at present, shape ``(M,)``: an obstacle does not count at poses
    that are no nearer to it.
    """
    gap = separations_m(x_m, y_m, yaw_rad, body, obstacles)
    gap = np.where(gap >= present_m - _TOLERANCE_M, np.inf, gap)
    return np.asarray(gap.min(axis=-1, initial=np.inf), dtype=np.float64)


class SpeedLimit(NamedTuple):
    """Limit of speed, required braking, and the actor that causes them."""

    speed_mps: float = math.inf
    brake_mps2: float = 0.0
    """Least required deceleration."""
    blocker_id: int = NO_ACTOR
    """Actor that blocks the way."""
    free_m: float = math.inf
    """Distance to that actor."""


@dataclass(frozen=True, eq=False)
class FreeWay:
    """Distances of a body from obstacles along a path."""

    way_m: Floats
    """Distances driven from the body's present place, shape ``(K,)``."""
    gap_m: Floats
    """Distance from each obstacle at each place, shape ``(K, M)``."""
    credit_m: Floats
    """Distance that each obstacle will have moved before it can stand, shape ``(M,)``."""
    actor_id: Ids
    """Ids of the obstacles."""

    @classmethod
    def along(
        cls,
        path: TrackedPath,
        pose: Moving,
        wheels: "Wheels",
        reach_m: float,
        body: Body,
        obstacles: Obstacles,
        credit_m: Floats,
    ) -> "FreeWay":
        """Compute the distances for a body on a path of its centre.

        Args:
            path: Path of the body's centre.
            pose: Where the body is on the path, and how it moves.
            wheels: How the body follows them. In bends it is not along its path.
            reach_m: How far to look.
            body: Size of the body.
            obstacles: Vehicles that may be in the way.
            credit_m: Way that each obstacle will have gone before it can stand, shape ``(M,)``.
        """
        progress = pose[0]
        end = min(progress + reach_m, path.length_m)
        way = _PATH_STEP_M * np.arange(max(math.ceil((end - progress) / _PATH_STEP_M), 0) + 1)
        poses, curve = np.empty((4, len(way))), path.curve
        line = curve.points, curve.heading_rad, curve.curvature_1pm, curve.spacing_m
        poses_ahead(*line, pose, wheels, way, poses)
        return cls(way, _gaps_m(poses, body, obstacles), credit_m, obstacles.actor_id)

    def until_m(self, clearance_m: float) -> float:
        """Distance that the body drives before it is nearer than a clearance to an obstacle.

        Infinite if it never is.
        """
        return float(self._first_m(np.full(len(self.credit_m), clearance_m)).min(initial=np.inf))

    @property
    def free_m(self) -> float:
        """Distance until the body touches an obstacle, or comes nearer to one that it already touches."""
        return float(self._stopping_m(_TOUCH_M).min(initial=np.inf))

    def _stopping_m(self, clearance_m: float) -> Floats:
        """Distance to each obstacle that is too near; there is no tolerance at contact, or small steps would add up."""
        present = self.gap_m[0]
        nearer = np.maximum(present - _TOLERANCE_M, np.minimum(present, _TOUCH_M))
        return self._first_m(np.minimum(clearance_m, nearer))

    def _first_m(self, clearance_m: Floats) -> Floats:
        """Distance to the first place nearer to each obstacle than its clearance ``(M,)``; infinite without one."""
        first = np.empty(len(self.credit_m))
        _first_nearer(self.way_m, self.gap_m, clearance_m, first)
        return first + self.credit_m

    def limit(
        self,
        speed_mps: float,
        squeezes: tuple[tuple[float, float], ...],
        stop_short_m: float,
        brake_mps2: float,
        clearance_m: float = _TOUCH_M,
    ) -> SpeedLimit:
        """Speed from which the body can slow down for tight places and stop before impassable ones.

        The needed deceleration is that of a stop before contact. Places that are only too tight are braked for gently,
        with ``brake_mps2``; nearer to contact than ``stop_short_m`` the body brakes so until it stands.
        ``squeezes`` are margins, the wider first, and the speeds that they allow. A place with less than
        ``clearance_m`` is impassable; the body stops ``stop_short_m`` before it.
        """
        narrow = [(self.until_m(wide), tight) for (wide, _), (_, tight) in pairwise(squeezes)]
        stopping = self._stopping_m(clearance_m)
        free = float(stopping.min(initial=np.inf))
        narrow.append((free - stop_short_m, 0.0))
        limit = math.inf
        for way, slow in narrow:
            if way < math.inf:
                limit = min(limit, speed_before_mps(slow * slow, brake_mps2, max(way, 0.0)))
        if free == math.inf:
            return SpeedLimit(limit)
        contact = self.free_m
        brake = needed_brake_mps2(speed_mps**2, max(contact - min(stop_short_m, _RESERVE_M), _LEAST_WAY_M))
        blocker = int(self.actor_id[np.argmin(stopping)])
        must = brake > brake_mps2 or contact <= stop_short_m
        return SpeedLimit(limit, max(brake, brake_mps2) if must else 0.0, blocker, free)


@compiled
def _first_nearer(way_m: Floats, gap_m: Floats, clearance_m: Floats, first_m: Floats) -> None:
    """Find for each clearance ``(M,)`` the first distance ``(K,)`` at which the gap ``(K, M)`` is smaller."""
    for m in range(gap_m.shape[1]):
        first_m[m] = np.inf
        for k in range(gap_m.shape[0]):
            if gap_m[k, m] < clearance_m[m]:
                first_m[m] = way_m[k]
                break


PREVIEW_TIME_S: Final = 0.6
"""Time constant of the lateral feedback: its length is this time multiplied by the speed."""
PREVIEW_MIN_M: Final = 3.0
"""Least length of the lateral feedback."""
DAMPING: Final = 1.0
"""Damping ratio of the lateral feedback."""
_LATERAL_ERROR_MAX_M: Final = 1.0
"""Lateral errors beyond this are corrected with the same angle."""


_CREEPS_MPS: Final = 0.1
"""A slower vehicle is taken to drive at this speed."""


class Wheels(NamedTuple):
    """What decides how a body follows its wheels, as compiled code takes it."""

    centre_ahead_m: float
    """Distance from the rear axle to the body's centre."""
    slip_s2pm: float
    """Sideslip of the rear axle per lateral acceleration."""
    sharpest_1pm: float
    """Curvature to which the wheels can be turned."""
    rate_1pms: float
    """How fast a driver changes it."""

    @classmethod
    def of(cls, vehicle: VehicleParameters) -> "Wheels":
        """The wheels of a vehicle."""
        slip = vehicle.mass_kg * vehicle.cg_to_front_axle_m
        slip /= vehicle.wheelbase_m * vehicle.cornering_stiffness_rear_npr
        sharpest_1pm = math.tan(vehicle.max_steer_rad) / vehicle.wheelbase_m
        rate_1pms = vehicle.curvature_rate_1pms(STEER_RATE_SHARE)
        return cls(vehicle.centre_ahead_of_rear_axle_m, slip, sharpest_1pm, rate_1pms)


@compiled
def _sideslip_rad(wheels: Wheels, bend_1pm: float, speed_mps: float) -> float:
    """Angle between a body and the course of its centre in steady cornering."""
    return np.arctan(wheels.centre_ahead_m * bend_1pm) - wheels.slip_s2pm * bend_1pm * speed_mps * speed_mps


@compiled
def _wanted_bend_1pm(bend_1pm: float, left_m: float, course_error: float, speed_mps: float, rate_1pms: float) -> float:
    """The curvature that ``steer_along`` commands; ``bend_1pm`` is that of the path."""
    offset = max(-_LATERAL_ERROR_MAX_M, min(_LATERAL_ERROR_MAX_M, left_m))
    turn = 2.0 * DAMPING * np.sin(course_error)
    length = max(PREVIEW_MIN_M, PREVIEW_TIME_S * speed_mps)
    length = max(length, (speed_mps * abs(offset + turn * length) / rate_1pms) ** (1.0 / 3.0))
    return bend_1pm - offset / (length * length) - turn / length


@compiled
def poses_ahead(
    points: Points, heading_rad: Floats, curvature_1pm: Floats, spacing_m: float,
    pose: Moving, wheels: Wheels, way_m: Floats, poses: Floats,
) -> None:  # fmt: skip
    """Compute x, y, cosine and sine of a body after each distance ``(K,)``, as it will steer along a path.

    The rear axle rolls where it points. A long body whose yaw is not yet that of its path swings over before it comes
    into line. The wheels turn no faster than they can.
    """
    progress_m, left_m, yaw, speed_mps, steered_1pm = pose
    turns_1pm2 = wheels.rate_1pms / STEER_RATE_SHARE / max(speed_mps, _CREEPS_MPS)
    for k in range(way_m.shape[0]):
        x, y, heading, bend_1pm = curve_place(points, heading_rad, curvature_1pm, spacing_m, progress_m)
        poses[X, k], poses[Y, k] = x - left_m * np.sin(heading), y + left_m * np.cos(heading)
        poses[COS, k], poses[SIN, k] = np.cos(yaw), np.sin(yaw)
        step_m = way_m[min(k + 1, way_m.shape[0] - 1)] - way_m[k]
        course_error = yaw + _sideslip_rad(wheels, bend_1pm, speed_mps) - heading
        bend_1pm = _wanted_bend_1pm(bend_1pm, left_m, course_error, speed_mps, wheels.rate_1pms)
        bend_1pm = max(-wheels.sharpest_1pm, min(wheels.sharpest_1pm, bend_1pm))
        if not np.isnan(steered_1pm):
            bend_1pm = max(steered_1pm - step_m * turns_1pm2, min(steered_1pm + step_m * turns_1pm2, bend_1pm))
        steered_1pm = bend_1pm
        course = yaw + _sideslip_rad(wheels, bend_1pm, speed_mps) - heading
        progress_m, left_m = progress_m + step_m * np.cos(course), left_m + step_m * np.sin(course)
        yaw += step_m * bend_1pm * np.cos(np.arctan(wheels.centre_ahead_m * bend_1pm))


def steer_along(
    path: TrackedPath,
    progress_m: float,
    left_m: float,
    yaw_rad: float,
    speed_mps: float,
    vehicle: VehicleParameters,
) -> float:
    """Road-wheel angle that leads the footprint's centre along a path.

    The commanded curvature is ``κ − e/l² − 2ζ·sin(ψ)/l``, with the offset e, the course error ψ, the damping ratio ζ
    and a length l that grows with the speed, and with errors for which the wheels turn too slowly: they have to turn by
    about ``L·v·(e + 2ζ·sin(ψ)·l)/l³`` per time, and a long vehicle whose wheels cannot would swing about its path. The
    course is the yaw plus the sideslip of steady cornering. The wheel angle is that of steady cornering,
    ``atan(L·κ) + K·κ·v²`` (Rajamani, "Vehicle Dynamics and Control", 2012, ch. 3).
    ``progress_m`` and ``left_m`` (left positive) are the place of the centre on the path.

    Returns:
        Angle in radians, left positive, within the vehicle's limit.
    """
    wheels = Wheels.of(vehicle)
    *_, heading, curvature = path.curve.place(progress_m)
    *_, ahead = path.curve.place(progress_m + speed_mps * vehicle.steer_lag_s)
    course_error = yaw_rad + _sideslip_rad(wheels, curvature, speed_mps) - heading
    bend = _wanted_bend_1pm(ahead, left_m, course_error, speed_mps, wheels.rate_1pms)
    steer = math.atan(vehicle.wheelbase_m * bend) + vehicle.understeer_gradient_s2pm * bend * speed_mps**2
    return max(-vehicle.max_steer_rad, min(vehicle.max_steer_rad, steer))


@dataclass(frozen=True)
class Pedals:
    """Throttle and brake, 0–1 each, and the integral of the speed control for the next step, in m/s²."""

    throttle: float
    brake: float
    integral_mps2: float


SPEED_GAIN_1PS: Final = 2.0
"""Acceleration per m/s of speed error."""
_SPEED_INTEGRAL_1PS2: Final = 0.3
"""Growth of the integral per m/s of speed error."""
_STANDSTILL_MPS: Final = 0.3
"""A vehicle that should stop and is slower than this is held by the brake."""
_STOP_TARGET_MPS: Final = 0.05
"""A lower target speed means a stop."""
_HOLD_BRAKE: Final = 0.6
"""Brake pedal of a held vehicle, 0–1."""
_INTEGRAL_LIMIT_MPS2: Final = 0.8
"""Limit of the integral of the speed control."""
_INTEGRAL_BAND_MPS: Final = 1.0
"""Speed error within which the integral grows."""
_FIRM_BRAKING: Final = 1.3
"""Braking towards a lower speed, relative to the comfortable deceleration of the path's speed profile."""
_COAST_MPS2: Final = 0.05
"""Smaller decelerations come from rolling alone."""


def press_pedals(
    speed_mps: float,
    target_mps: float,
    must_brake_mps2: float,
    integral_mps2: float,
    vehicle: VehicleParameters,
    config: Navigation,
    steer_rad: float = 0.0,
) -> Pedals:
    """Pedals for a target speed; the brakes add what a bend with steered wheels does not slow down by itself.

    ``must_brake_mps2`` is the deceleration that is needed at least (0: none), so as not to hit what is ahead. The
    integral comes from the step before; it stands still outside a band around the target speed and while a limit is
    hit, so that it does not wind up.
    """
    if target_mps <= _STOP_TARGET_MPS and speed_mps <= _STANDSTILL_MPS:
        return Pedals(0.0, _HOLD_BRAKE, 0.0)
    error = target_mps - speed_mps
    asked = SPEED_GAIN_1PS * error + integral_mps2
    accel = max(-_FIRM_BRAKING * config.comfort_brake_mps2, min(config.comfort_accel_mps2, asked))
    free = accel == asked
    if must_brake_mps2 > 0.0:
        accel, free = min(accel, -must_brake_mps2), False
    resistance = (
        0.5 * AIR_DENSITY_KGPM3 * vehicle.drag_area_m2 * speed_mps**2 / vehicle.mass_kg
        + vehicle.rolling_resistance * GRAVITY_MPS2
    )
    force = accel + resistance
    most = min(vehicle.max_drive_accel_mps2, vehicle.drive_power_w / (vehicle.mass_kg * max(speed_mps, 1.0)))
    throttle = min(max(force, 0.0) / most, 1.0)
    braking = -force - _cornering_mps2(speed_mps, steer_rad, vehicle)
    brake = min(braking / vehicle.max_brake_decel_mps2, 1.0) if braking > _COAST_MPS2 else 0.0
    integral = 0.0
    if abs(error) < _INTEGRAL_BAND_MPS:
        grown = integral_mps2 + _SPEED_INTEGRAL_1PS2 * error * STEP_S if free else integral_mps2
        integral = max(-_INTEGRAL_LIMIT_MPS2, min(_INTEGRAL_LIMIT_MPS2, grown))
    return Pedals(throttle, brake, integral)


def _cornering_mps2(speed_mps: float, steer_rad: float, vehicle: VehicleParameters) -> float:
    """Deceleration by the side force of steered front wheels in steady cornering."""
    curvature = steer_rad / (vehicle.wheelbase_m + vehicle.understeer_gradient_s2pm * speed_mps**2)
    front_share = 1.0 - vehicle.cg_to_front_axle_m / vehicle.wheelbase_m
    return front_share * speed_mps**2 * curvature * math.tan(steer_rad)


# This is no parameter: half the distance between points of a path.
DONE_M: Final = 0.5
"""Distance to the path's end at which the path counts as completed."""


class DriveCommand(NamedTuple):
    """Pedals and wheel angle for one step."""

    throttle: float
    brake: float
    steer_rad: float
    hand_brake: bool


FULL_BRAKE: Final = DriveCommand(throttle=0.0, brake=1.0, steer_rad=0.0, hand_brake=True)
"""Stationary hold (paper, Algorithm 2)."""


@dataclass(frozen=True, eq=False)
class NavigatorState:
    """The followed path and the progress on it."""

    path: TrackedPath | None = None
    progress_m: float = 0.0
    left_m: float = 0.0
    """Offset from the path at the last step."""
    integral_mps2: float = 0.0
    target_mps: float = 0.0
    """Target speed of the mode at the last step."""
    limits: tuple[SpeedLimit, ...] = ()
    """Limits of all mechanisms at the last step, in their order."""
    steered_1pm: float = math.nan
    """Curvature to which the wheels were turned at the last step; NaN if somebody else did it."""

    def following(self, path: TrackedPath, x_m: float, y_m: float) -> "NavigatorState":
        """State after ``SetWaypoints``: a new path, entered at the position nearest to a point."""
        progress, left = path.curve.project_one(x_m, y_m)
        return NavigatorState(path, progress, left, self.integral_mps2, steered_1pm=self.steered_1pm)

    @property
    def lane(self) -> int:
        """Lane at the present position on the path; ``NO_LANE`` without one."""
        return NO_LANE if self.path is None else self.path.lane_at(self.progress_m)

    @property
    def remaining_m(self) -> float:
        """Remaining length of the path, 0 without one."""
        return self.path.length_m - self.progress_m if self.path is not None else 0.0

    @property
    def done(self) -> bool:
        """Whether the path has been driven to its end."""
        return self.path is None or self.remaining_m < DONE_M


def free_way_of(state: NavigatorState, ego: Ego, reach_m: float, obstacles: Obstacles, credit_m: Floats) -> FreeWay:
    """Distances of a vehicle's body from obstacles along its path; arguments as for ``FreeWay.along``."""
    if state.path is None:
        raise ValueError("no path is followed")
    progress, left = state.path.curve.nearest_to(state.progress_m, *ego.place)
    pose = progress, left, ego.pose[2], ego.speed_mps, state.steered_1pm
    return FreeWay.along(state.path, pose, Wheels.of(ego.vehicle), reach_m, ego.body, obstacles, credit_m)


NARROW_STOP_SHORT_M: Final = 0.3
"""Distance kept to a place that is too narrow."""
LEADER_BRAKE_MPS2: Final = 4.0
"""Braking that is expected of vehicles ahead."""
_SIDE_WATCH_S: Final = 1.0
"""Time for which approaching vehicles at the side are extrapolated."""
_SIDE_WATCH_M: Final = 8.0
"""Distance to the side and behind within which vehicles are seen."""
NARROW_REACH_M: Final = 8.0
"""Distance ahead that a driver at walking pace watches."""
ALONG_COSINE: Final = 0.7
"""Vehicles with a larger cosine to the own direction count as the same direction."""
STILL_MPS: Final = 0.3
"""Slower vehicles count as standing."""


def manoeuvring_limit(state: NavigatorState, ego: Ego, *, emvs_only: bool = False) -> SpeedLimit:
    """Speed limit for a driver that moves sideways between others (or only EMVs), so that the body touches none.

    The collision handling watches the strip ahead of the vehicle. Ends that swing out towards a vehicle at the side,
    and vehicles at the side that come on, are seen here. A civilian stops before a place at which the margin to an EMV
    that comes on would be one for creeping.
    """
    seen, config = ego.seen, ego.civilian_driver.manoeuvring
    rows = ego.near(NARROW_REACH_M + 2.0 * ego.half_length_m + _SIDE_WATCH_M)
    rows = rows[seen.is_emv[rows]] if emvs_only else rows
    if state.path is None or len(rows) == 0:
        return SpeedLimit()
    speed = seen.speed_mps[rows]
    (x, y), (cos, sin) = ego.place, ego.direction
    along = cos * seen.cos[rows] + sin * seen.sin[rows] > ALONG_COSINE
    ahead = cos * (seen.x_m[rows] - x) + sin * (seen.y_m[rows] - y) - seen.half_length_m[rows] > ego.half_length_m
    leads = along & ahead
    comes = ~leads & (speed >= STILL_MPS)
    clears = comes & seen.is_emv[rows] & (not emvs_only)
    watch_s = _SIDE_WATCH_S + np.where(clears, ego.speed_mps / config.brake_mps2, 0.0)
    obstacles = Obstacles.swept(seen, rows, np.where(comes, watch_s, 0.0))
    margin_m = np.where(clears, config.narrow_gap_m - config.clearance_m, 0.0)
    obstacles = replace(obstacles, half_width_m=obstacles.half_width_m + margin_m)
    credit = np.where(leads, braking_distance_m(speed**2, LEADER_BRAKE_MPS2), 0.0)
    way = free_way_of(state, ego, NARROW_REACH_M, obstacles, credit)
    return way.limit(ego.speed_mps, config.squeezes, NARROW_STOP_SHORT_M, config.brake_mps2, config.clearance_m)
