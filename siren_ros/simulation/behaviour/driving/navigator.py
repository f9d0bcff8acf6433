"""The waypoint navigator: the controller of every vehicle that SUMO does not drive.

It steers along a path with curvature feed-forward and feedback of offset and heading, and presses the pedals by
proportional-integral control over the vehicle's own force limits.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.braking import braking_distance_m
from siren_ros.base.numerics.units import GRAVITY_MPS2, STEP_S
from siren_ros.simulation.behaviour.driving.free_space import FreeWay, Obstacles, SpeedLimit
from siren_ros.simulation.behaviour.driving.step_view import STEER_RATE_SHARE, Ego
from siren_ros.simulation.behaviour.paths.tracked_path import Navigation, TrackedPath
from siren_ros.simulation.dynamics.parameters import AIR_DENSITY_KGPM3, VehicleParameters
from siren_ros.simulation.roads.road_network import NO_LANE

PREVIEW_TIME_S: Final = 0.6
"""Time constant of the lateral feedback: its length is this time multiplied by the speed."""
PREVIEW_MIN_M: Final = 3.0
"""Least length of the lateral feedback."""
DAMPING: Final = 1.0
"""Damping ratio of the lateral feedback."""
_LATERAL_ERROR_MAX_M: Final = 1.0
"""Lateral errors beyond this are corrected with the same angle."""


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
    *_, heading, curvature = path.curve.place(progress_m)
    *_, ahead = path.curve.place(progress_m + speed_mps * vehicle.steer_lag_s)
    slip_per_accel = (
        vehicle.mass_kg * vehicle.cg_to_front_axle_m / (vehicle.wheelbase_m * vehicle.cornering_stiffness_rear_npr)
    )
    sideslip = math.atan(vehicle.centre_ahead_of_rear_axle_m * curvature) - slip_per_accel * curvature * speed_mps**2
    course_error = math.remainder(yaw_rad + sideslip - heading, 2.0 * math.pi)
    offset = max(-_LATERAL_ERROR_MAX_M, min(_LATERAL_ERROR_MAX_M, left_m))
    turn = 2.0 * DAMPING * math.sin(course_error)
    length = max(PREVIEW_MIN_M, PREVIEW_TIME_S * speed_mps)
    rate_1pms = vehicle.curvature_rate_1pms(STEER_RATE_SHARE)
    length = max(length, (speed_mps * abs(offset + turn * length) / rate_1pms) ** (1.0 / 3.0))
    bend = ahead - offset / length**2 - turn / length
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

    def following(self, path: TrackedPath, x_m: float, y_m: float) -> "NavigatorState":
        """State after ``SetWaypoints``: a new path, entered at the position nearest to a point."""
        progress, left = path.curve.project_one(x_m, y_m)
        return NavigatorState(path, progress, left, self.integral_mps2)

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
    pose, rear = (progress, left, ego.pose[2]), ego.vehicle.centre_ahead_of_rear_axle_m
    return FreeWay.along(state.path, pose, rear, reach_m, ego.body, obstacles, credit_m)


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
    and vehicles at the side that come on, are seen here.
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
    obstacles = Obstacles.swept(seen, rows, np.where(leads | (speed < STILL_MPS), 0.0, _SIDE_WATCH_S))
    credit = np.where(leads, braking_distance_m(speed**2, LEADER_BRAKE_MPS2), 0.0)
    way = free_way_of(state, ego, NARROW_REACH_M, obstacles, credit)
    return way.limit(ego.speed_mps, config.squeezes, NARROW_STOP_SHORT_M, config.brake_mps2, config.clearance_m)
