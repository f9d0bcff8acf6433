"""The waypoint navigator: the one controller that drives every vehicle that SUMO does not drive.

It steers along a path with curvature feed-forward and feedback of offset and heading, and presses the pedals by
proportional-integral control over the vehicle's own force limits.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.collision_watch import CollisionSnapshot, stricter, watch_conflicts, watch_path
from siren_ros.behaviour.driving.free_space import Body, FreeWay, Obstacles, SpeedLimit
from siren_ros.behaviour.driving.step_view import StepView, Surroundings
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.dynamics.parameters import AIR_DENSITY_KGPM3, VehicleParameters
from siren_ros.numerics.units import GRAVITY_MPS2, STEP_S


def steer_along(
    path: TrackedPath,
    progress_m: float,
    left_m: float,
    yaw_rad: float,
    speed_mps: float,
    vehicle: VehicleParameters,
    config: NavigatorConfig,
) -> float:
    """Road-wheel angle that leads the footprint's centre along a path.

    The commanded curvature is ``κ − e/l² − 2ζ·sin(ψ)/l``, with the offset e, the course error ψ, the damping ratio ζ
    and a length l that grows with the speed. The course is the yaw plus the sideslip of steady cornering. The wheel
    angle is that of steady cornering, ``atan(L·κ) + K·κ·v²`` (Rajamani, "Vehicle Dynamics and Control", 2012, ch. 3).

    Args:
        path: Path of the footprint's centre.
        progress_m: Arc length of the place on the path that is nearest to the centre.
        left_m: Offset of the centre from the path, left positive.
        yaw_rad: Of the vehicle.
        speed_mps: Over ground.
        vehicle: For wheelbase, steering limit, lag and understeer.
        config: Preview and damping.

    Returns:
        Angle in radians, left positive, within the vehicle's limit.
    """
    lag_m = speed_mps * vehicle.steer_lag_s
    _, _, heading, curvature = path.curve.place(progress_m)
    _, _, _, ahead = path.curve.place(progress_m + lag_m)
    rear = vehicle.centre_ahead_of_rear_axle_m
    slip_per_accel = (
        vehicle.mass_kg * vehicle.cg_to_front_axle_m / (vehicle.wheelbase_m * vehicle.cornering_stiffness_rear_npr)
    )
    sideslip = math.atan(rear * curvature) - slip_per_accel * curvature * speed_mps**2
    course_error = _wrapped(yaw_rad + sideslip - heading)
    length = max(config.preview_min_m, config.preview_time_s * speed_mps)
    offset = max(-config.lateral_error_max_m, min(config.lateral_error_max_m, left_m))
    wanted = ahead - offset / length**2 - 2.0 * config.damping * math.sin(course_error) / length
    steer = math.atan(vehicle.wheelbase_m * wanted) + vehicle.understeer_gradient_s2pm * wanted * speed_mps**2
    return max(-vehicle.max_steer_rad, min(vehicle.max_steer_rad, steer))


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2.0 * math.pi)


_STANDSTILL_MPS: Final = 0.3
_STOP_TARGET_MPS: Final = 0.05
_HOLD_BRAKE: Final = 0.6
_INTEGRAL_LIMIT_MPS2: Final = 0.8
_INTEGRAL_BAND_MPS: Final = 1.0
_FIRM_BRAKING: Final = 1.3
"""Braking towards a lower speed, relative to the comfortable deceleration of the path's speed profile."""
_COAST_MPS2: Final = 0.05
"""Decelerations below it come from rolling alone."""


@dataclass(frozen=True)
class Pedals:
    """Throttle and brake, 0–1 each, and the integral to carry on, in m/s²."""

    throttle: float
    brake: float
    integral_mps2: float


def press_pedals(
    speed_mps: float,
    wanted_mps: float,
    must_brake_mps2: float,
    integral_mps2: float,
    vehicle: VehicleParameters,
    config: NavigatorConfig,
) -> Pedals:
    """Pedals for a wanted speed.

    Args:
        speed_mps: Present speed.
        wanted_mps: Speed to reach.
        must_brake_mps2: Deceleration that is needed at least (0: none), so as not to hit what is ahead.
        integral_mps2: Integral from the step before; it stands still outside a band around the wanted speed and
            while a limit is hit, so that it does not wind up.
        vehicle: For traction, power, drag, rolling resistance and brakes.
        config: Gains and the comfortable acceleration.
    """
    if wanted_mps <= _STOP_TARGET_MPS and speed_mps <= _STANDSTILL_MPS:
        return Pedals(0.0, _HOLD_BRAKE, 0.0)
    error = wanted_mps - speed_mps
    asked = config.speed_gain_1ps * error + integral_mps2
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
    brake = min(-force / vehicle.max_brake_decel_mps2, 1.0) if force < -_COAST_MPS2 else 0.0
    integral = 0.0
    if abs(error) < _INTEGRAL_BAND_MPS:
        grown = integral_mps2 + config.speed_integral_1ps2 * error * STEP_S if free else integral_mps2
        integral = max(-_INTEGRAL_LIMIT_MPS2, min(_INTEGRAL_LIMIT_MPS2, grown))
    return Pedals(throttle, brake, integral)


_ROLLING_MPS: Final = 0.3
"""Slower vehicles come to a stand without more braking."""
DONE_M: Final = 0.5
"""Distance from the path's end at which the path counts as driven."""


@dataclass(frozen=True)
class DriveCommand:
    """Pedals and wheel angle for one step."""

    throttle: float
    brake: float
    steer_rad: float
    hand_brake: bool


FULL_BRAKE: Final = DriveCommand(throttle=0.0, brake=1.0, steer_rad=0.0, hand_brake=True)
"""Stationary hold (paper, Algorithm 2)."""


@dataclass(frozen=True, eq=False)
class NavigatorState:
    """The path that is followed, and how far."""

    path: TrackedPath | None = None
    progress_m: float = 0.0
    left_m: float = 0.0
    """Offset from the path at the last step."""
    integral_mps2: float = 0.0

    def following(self, path: TrackedPath, x_m: float, y_m: float) -> "NavigatorState":
        """The state after ``SetWaypoints``: a new path, entered at the place nearest to a point."""
        progress, left = path.curve.project_one(x_m, y_m)
        return NavigatorState(path, progress, left, self.integral_mps2)

    @property
    def remaining_m(self) -> float:
        """Path left, 0 without one."""
        return self.path.length_m - self.progress_m if self.path is not None else 0.0

    @property
    def done(self) -> bool:
        """Whether the path has been driven to its end."""
        return self.path is None or self.remaining_m < DONE_M


@dataclass(frozen=True, eq=False)
class DriveInputs:
    """What one vehicle drives in at one step."""

    seen: Surroundings
    row: int
    """Of the vehicle in ``seen``."""
    vehicle: VehicleParameters
    target_mps: float
    watch: bool = True
    """Whether the collision handling is on."""
    watch_leaders: bool = True
    """Whether it watches vehicles ahead on the path; else ``limit`` stands for them."""
    limit: SpeedLimit = field(default_factory=SpeedLimit)
    """Besides the target and the path's own limits."""


def navigate(
    state: NavigatorState, situation: DriveInputs, config: NavigatorConfig
) -> tuple[NavigatorState, DriveCommand, CollisionSnapshot | None]:
    """One step along the path: steering, pedals and the actor that blocks the way.

    Without a path the vehicle brakes to a standstill and keeps its wheels straight.
    """
    seen, row, path = situation.seen, situation.row, state.path
    speed = float(seen.speed_mps[row])
    if path is None:
        pedals = press_pedals(speed, 0.0, 0.0, 0.0, situation.vehicle, config)
        return replace(state, integral_mps2=0.0), DriveCommand(0.0, pedals.brake, 0.0, False), None
    progress, left = path.curve.nearest_to(state.progress_m, float(seen.x_m[row]), float(seen.y_m[row]))
    cap = min(path.speed_cap_mps(progress), path.speed_cap_mps(progress + speed * config.reaction_s))
    wanted = min(max(situation.target_mps, speed - config.ease_off_mps2 / config.speed_gain_1ps), cap)
    threat, must_brake = None, 0.0
    if situation.watch:
        target = situation.target_mps
        leaders = situation.watch_leaders
        led = watch_path(path, progress, row, target, seen, config) if leaders else None
        met = watch_conflicts(path, progress, row, target, seen, config, leaders=leaders)
        threat = stricter(led, met)
    if threat is not None:
        wanted, must_brake = min(wanted, threat.safe_speed_mps), threat.must_brake_mps2
    wanted = min(wanted, situation.limit.speed_mps)
    if speed > _ROLLING_MPS:
        must_brake = max(must_brake, situation.limit.brake_mps2)
    pedals = press_pedals(speed, wanted, must_brake, state.integral_mps2, situation.vehicle, config)
    steer = steer_along(path, progress, left, float(seen.yaw_rad[row]), speed, situation.vehicle, config)
    return (
        NavigatorState(path, progress, left, pedals.integral_mps2),
        DriveCommand(pedals.throttle, pedals.brake, steer, False),
        threat.snapshot if threat is not None else None,
    )


_REACH_M: Final = 8.0
"""How far ahead a driver at walking pace looks."""
_ALONG: Final = 0.7
"""Cosine above which a vehicle counts as one of the same direction."""
_STILL_MPS: Final = 0.3


def manoeuvring_limit(state: NavigatorState, view: StepView, row: int) -> SpeedLimit:
    """How fast a driver may go sideways between others so that the body touches nobody.

    The collision handling watches the strip ahead of the vehicle. Ends that swing out towards a vehicle at the side,
    and vehicles at the side that come on, are seen here.
    """
    path, config = state.path, view.world.config.manoeuvring
    if path is None:
        return SpeedLimit()
    seen = view.seen
    x, y, yaw = view.pose(row)
    body = Body.of(seen, row)
    rows = seen.near(x, y, _REACH_M + 2.0 * body.half_length_m + config.watch_m, but=row)
    if len(rows) == 0:
        return SpeedLimit()
    speed = seen.speed_mps[rows]
    cos, sin = float(seen.cos[row]), float(seen.sin[row])
    along = cos * seen.cos[rows] + sin * seen.sin[rows] > _ALONG
    ahead = cos * (seen.x_m[rows] - x) + sin * (seen.y_m[rows] - y) - seen.half_length_m[rows] > body.half_length_m
    leads = along & ahead
    obstacles = Obstacles.swept(seen, rows, np.where(leads | (speed < _STILL_MPS), 0.0, config.watch_s))
    credit = np.where(leads, speed**2 / (2.0 * config.leader_brake_mps2), 0.0)
    progress, left = path.curve.nearest_to(state.progress_m, x, y)
    rear = view.vehicle(row).centre_ahead_of_rear_axle_m
    way = FreeWay.along(path, (progress, left, yaw), rear, _REACH_M, body, obstacles, credit)
    own = float(seen.speed_mps[row])
    return way.limit(own, config.squeezes, config.stop_short_m, config.brake_mps2, config.clearance_m)
