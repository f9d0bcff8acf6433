"""Controls that make vehicles follow the poses that SUMO gives them, with the same vehicle model as all others.

SUMO moves a rigid rod whose bumpers both stay on the lane's polyline, so its heading jumps and its course and
heading differ. The reference is therefore what a car would do whose footprint centre takes SUMO's path: its yaw
follows from the path as the yaw of a trailer pulled by the centre (a tractrix), and its front axle gives point and
course for a Stanley law (Hoffmann et al., "Autonomous Automobile Trajectory Tracking for Off-Road Driving", ACC 2007)
with feed-forward of the front slip angle. Along the path, SUMO's speed is fed forward and the distance along the
path is fed back. Lags of the actuators are shorter than a driver's; tyres, steering range and rate are the vehicle's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.dynamics.parameters import AIR_DENSITY_KGPM3, ParameterTable
from siren_ros.dynamics.vehicle_model import BodyState, Controls
from siren_ros.world.actors import Floats
from siren_ros.world.geometry import wrap_angle
from siren_ros.world.units import GRAVITY_MPS2


@dataclass(frozen=True)
class TrackerGains:
    """Tuning of the tracker."""

    lateral_per_s: float = 3.5
    """Stanley gain: lateral error is worked off with this rate."""
    lateral_soft_mps: float = 1.0
    """Added to the speed in the Stanley law, so that steering stays calm near standstill."""
    along_per_s: float = 2.0
    """Speed correction per metre of distance along the path."""
    along_most_mps: float = 3.0
    """Largest speed correction."""
    speed_time_s: float = 0.2
    """Time in which a difference of speeds is to be closed."""
    quickness: float = 3.0
    """How much quicker than a driver's the pedals and the steering are: SUMO's path is not known ahead."""
    drive_factor: float = 1.5
    """How much more than full throttle the drive may give: SUMO's acceleration knows no engine power."""
    pace_time_s: float = 0.2
    """Time constant of the ratio between the centre's speed and SUMO's speed of the front bumper."""
    accel_time_s: float = 0.2
    """Time constant by which SUMO's acceleration is smoothed before it is fed forward."""
    grip_share: float = 0.8
    """Part of the tyres' grip that steering and speed may ask for in a turn."""
    standing_mps: float = 0.05
    """Wanted speeds below this mean: hold the vehicle with the brake."""
    holding_brake: float = 0.3


@dataclass(frozen=True)
class Reference:
    """SUMO's vehicles at one step, ``map`` frame, each array of shape ``(N,)``; positions are footprint centres."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    speed_mps: Floats
    accel_mps2: Floats


@dataclass(frozen=True)
class TrackerState:
    """Reference of the step before: SUMO's centre, and the yaw of a car whose centre takes SUMO's path."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    pace: Floats
    """Speed of the centre over SUMO's speed, which is the front bumper's: below 1 in turns."""
    accel_mps2: Floats
    """SUMO's acceleration, smoothed."""

    @classmethod
    def at(cls, x_m: Floats, y_m: Floats, yaw_rad: Floats) -> "TrackerState":
        """Actors whose tracking begins, or begins anew, at these poses."""
        return cls(x_m, y_m, yaw_rad, np.ones(len(x_m)), np.zeros(len(x_m)))

    def select(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> "TrackerState":
        """The actors of the given rows."""
        return type(self)(*(getattr(self, field.name)[rows] for field in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence["TrackerState"]) -> "TrackerState":
        """The actors of all parts, in order."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    @classmethod
    def where(cls, mask: npt.NDArray[np.bool_], chosen: "TrackerState", other: "TrackerState") -> "TrackerState":
        """Rows of ``chosen`` where the mask holds, of ``other`` elsewhere."""
        pairs = ((getattr(chosen, field.name), getattr(other, field.name)) for field in fields(cls))
        return cls(*(np.where(mask, a, b) for a, b in pairs))


_SLOWEST_STEP_M: Final = 0.01
"""A centre that moved less than this in one step has no course of its own."""
_SLOWEST_MPS: Final = 0.1
_PACES: Final = (0.85, 1.1)
"""Ratios of the centre's and the front bumper's speed that a vehicle can drive; beyond, SUMO's rod swings or jumps."""
_STRAIGHT_PM: Final = 1e-3
"""Curvatures below this, in 1/m, limit no speed."""
_FULL_LOCK_RAD: Final = 1.4
"""Beyond any steering angle, and below the right angle at which the tangent ends."""
DEFAULT_GAINS: Final = TrackerGains()


def track(
    state: BodyState,
    tracker: TrackerState,
    reference: Reference,
    table: ParameterTable,
    dt_s: float,
    gains: TrackerGains = DEFAULT_GAINS,
) -> tuple[Controls, TrackerState]:
    """Controls for the step that ends when SUMO's vehicles are at ``reference``.

    Args:
        state: Vehicles at the start of the step.
        tracker: Reference at the start of the step.
        reference: Reference at the end of the step.
        table: Parameters, row by row those of ``state``.
        dt_s: Step.
        gains: Tuning.

    Returns:
        The controls, and the tracker's state at the end of the step.
    """
    dx, dy = reference.x_m - tracker.x_m, reference.y_m - tracker.y_m
    moved = np.hypot(dx, dy)
    pull, wheelbase = table.centre_ahead_of_rear_axle_m, table.wheelbase_m
    course = np.where(moved > _SLOWEST_STEP_M, np.arctan2(dy, dx), reference.yaw_rad)
    most = np.arctan(pull / wheelbase * np.tan(table.max_steer_rad))
    swerve = np.minimum(np.maximum(wrap_angle(course - tracker.yaw_rad), -most), most)
    curvature = np.tan(swerve) / pull
    steer, steered_curvature = _steer(state, tracker, table, curvature, gains)
    ratio = np.clip(moved / (dt_s * np.maximum(reference.speed_mps, _SLOWEST_STEP_M / dt_s)), *_PACES)
    pace = tracker.pace + (ratio - tracker.pace) * -np.expm1(-dt_s / gains.pace_time_s)
    course = tracker.yaw_rad + swerve
    gap = (tracker.x_m - state.x_m) * np.cos(course) + (tracker.y_m - state.y_m) * np.sin(course)
    correction = np.minimum(np.maximum(gains.along_per_s * gap, -gains.along_most_mps), gains.along_most_mps)
    grip = gains.grip_share * GRAVITY_MPS2 * table.friction_coefficient
    fastest = np.sqrt(grip / np.maximum(np.abs(steered_curvature), _STRAIGHT_PM))
    wanted = np.minimum(np.maximum(pace * reference.speed_mps + correction, 0.0), fastest)
    accel = tracker.accel_mps2 + (reference.accel_mps2 - tracker.accel_mps2) * -np.expm1(-dt_s / gains.accel_time_s)
    throttle, brake = _pedals(state, wanted, accel, table, dt_s, gains)
    n = len(state)
    following = TrackerState(reference.x_m, reference.y_m, tracker.yaw_rad + moved * np.sin(swerve) / pull, pace, accel)
    controls = Controls(
        throttle=throttle,
        brake=brake,
        steer_rad=steer,
        hand_brake=np.zeros(n, dtype=bool),
        quickness=np.full(n, gains.quickness),
        drive_factor=np.full(n, gains.drive_factor),
    )
    return controls, following


def _steer(
    state: BodyState, tracker: TrackerState, table: ParameterTable, curvature: Floats, gains: TrackerGains
) -> tuple[Floats, Floats]:
    """Wanted road-wheel angle, and the curvature that it steers, from the reference's curvature."""
    reach = table.wheelbase_m - table.centre_ahead_of_rear_axle_m
    heading = tracker.yaw_rad + np.arctan(table.wheelbase_m * curvature)
    gap_x = tracker.x_m - state.x_m + reach * (np.cos(tracker.yaw_rad) - np.cos(state.yaw_rad))
    gap_y = tracker.y_m - state.y_m + reach * (np.sin(tracker.yaw_rad) - np.sin(state.yaw_rad))
    offset = gap_y * np.cos(heading) - gap_x * np.sin(heading)
    speed = state.forward_mps
    correction = np.arctan2(gains.lateral_per_s * offset, np.abs(speed) + gains.lateral_soft_mps)
    grip = gains.grip_share * GRAVITY_MPS2 * table.friction_coefficient
    tightest = np.minimum(
        np.tan(table.max_steer_rad) / table.wheelbase_m, grip / np.maximum(speed * speed, _SLOWEST_MPS**2)
    )
    turn = np.clip(wrap_angle(heading - state.yaw_rad) + correction, -_FULL_LOCK_RAD, _FULL_LOCK_RAD)
    steered = np.minimum(np.maximum(np.tan(turn) / table.wheelbase_m, -tightest), tightest)
    rear_share = table.cg_to_rear_axle_m / table.wheelbase_m
    front_slip = table.mass_kg * rear_share / table.cornering_stiffness_front_npr * speed * speed * curvature
    return np.arctan(steered * table.wheelbase_m) + front_slip, steered


def _pedals(
    state: BodyState, wanted: Floats, accel: Floats, table: ParameterTable, dt_s: float, gains: TrackerGains
) -> tuple[Floats, Floats]:
    """Pedals that reach the wanted speed within ``speed_time_s`` while it changes; the brake holds who waits."""
    speed = state.forward_mps
    drag = 0.5 * AIR_DENSITY_KGPM3 * table.drag_area_m2 / table.mass_kg * speed * speed
    force = (
        accel + (wanted - accel * dt_s - speed) / gains.speed_time_s + drag + table.rolling_resistance * GRAVITY_MPS2
    )
    drive = np.minimum(table.max_drive_accel_mps2, table.drive_power_w / (table.mass_kg * np.maximum(speed, 0.1)))
    throttle = _before_lag(
        force / (gains.drive_factor * drive), state.throttle, table.throttle_lag_s / gains.quickness, dt_s
    )
    brake = _before_lag(-force / table.max_brake_decel_mps2, state.brake, table.brake_lag_s / gains.quickness, dt_s)
    standing = wanted < gains.standing_mps
    return np.where(standing, 0.0, throttle), np.where(standing, np.maximum(brake, gains.holding_brake), brake)


def _before_lag(wanted: Floats, present: Floats, lag_s: Floats, dt_s: float) -> Floats:
    """Command whose mean response over a step, behind a first-order lag, is the wanted value; within 0–1."""
    kept = lag_s / dt_s * -np.expm1(-dt_s / lag_s)
    return np.clip((np.clip(wanted, 0.0, 1.0) - kept * present) / (1.0 - kept), 0.0, 1.0)
