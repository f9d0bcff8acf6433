"""Controls vehicles so that they follow SUMO's poses, with the same vehicle model as all others.

The law runs for one vehicle after the other in a compiled loop.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from siren_ros.base.numerics.arrays import Columns, Flags, Floats
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled, within, wrapped_rad
from siren_ros.base.numerics.units import GRAVITY_MPS2
from siren_ros.simulation.dynamics.parameters import AIR_DENSITY_KGPM3, ParameterTable
from siren_ros.simulation.dynamics.vehicle_model import (
    ASKED_BRAKE,
    ASKED_STEER,
    ASKED_THROTTLE,
    BRAKE,
    FORWARD,
    STEER,
    THROTTLE,
    BodyState,
    Controls,
    Record,
    Records,
)

_SLOWEST_STEP_M: Final = 0.01
"""A centre that moved less than this in a step has no direction of motion."""
_SLOWEST_MPS: Final = 0.1
_LEAST_PACE: Final = 0.85
_MOST_PACE: Final = 1.1
"""Largest ratio of the centre's and the front bumper's speed that a vehicle can drive; above it SUMO's pose jumps."""
_STRAIGHT_PM: Final = 1e-3
"""Smaller curvatures, in 1/m, do not limit the speed."""
_FULL_LOCK_RAD: Final = 1.4
"""Larger than any steering angle, but below 90°, where the tangent ends."""
SPEED, SUMO_ACCEL = 3, 4
"""Rows of ``Reference.columns`` after ``X``, ``Y`` and ``YAW``."""
PACE, SMOOTH_ACCEL = 3, 4
"""Further columns, those of ``TrackerState.columns``."""
NEXT_YAW, NEXT_PACE, NEXT_ACCEL = range(3, 6)
"""Rows of what ``follow`` gives, after the pedals and the steering angle: the tracker's state then."""


class TrackerGains(NamedTuple):
    """Gains of the tracker."""

    lateral_per_s: float = 3.5
    """Stanley gain: rate of lateral correction. Above town speeds it is lower, because long vehicles respond late to
    steering."""
    lateral_soft_mps: float = 1.0
    """Speed added in the Stanley law, so that steering stays calm near standstill."""
    along_per_s: float = 2.0
    """Speed correction per metre of distance along the path."""
    along_most_mps: float = 3.0
    """Largest speed correction."""
    speed_time_s: float = 0.2
    """Time in which a speed difference is corrected."""
    quickness: float = 2.0
    """Factor on the quickness of pedals and steering compared with a driver, because SUMO's path is not known ahead."""
    drive_factor: float = 1.5
    """Factor on full throttle, because SUMO's acceleration ignores engine power."""
    pace_time_s: float = 0.2
    """Time constant of the ratio between the centre's speed and SUMO's front bumper speed."""
    accel_time_s: float = 0.2
    """Time constant of smoothing SUMO's acceleration before it is fed forward."""
    grip_share: float = 0.8
    """Share of the tyres' grip that steering and speed may use in a turn."""
    swerve_share: float = 0.4
    """Share of grip for steering up to town speeds, where SUMO's path can turn suddenly: drivers swerve with less than
    half of the grip."""
    town_mps: float = 14.0
    """Town speed, 50 km/h."""
    standing_mps: float = 0.05
    """Below this wanted speed the brake holds the vehicle."""
    holding_brake: float = 0.3


@compiled
def _quickest_turn_in(vehicle: Record, speed: float, curvature: float, grip: float) -> float:
    """Largest growth of curvature, 1/(m s), for which the centre of gravity stays within ``grip`` in m/s².

    Rolling without slip it has v² κ + v l_r dκ/dt: it goes aside already while the wheels are turning.
    """
    return max((grip - speed * speed * curvature) / (max(speed, _SLOWEST_MPS) * vehicle.cg_to_rear_axle_m), 0.0)


@compiled
def _steer(
    vehicle: Record,
    pose: tuple[float, float, float, float, float],
    goal: tuple[float, float, float, float],
    dt_s: float,
    gains: TrackerGains,
) -> tuple[float, float]:
    """Steering angle to command, and the resulting curvature.

    ``pose`` holds x, y, yaw, forward speed and road-wheel angle, ``goal`` x, y, yaw and curvature of the reference.
    """
    x_m, y_m, yaw, speed, present = pose
    goal_x, goal_y, goal_yaw, curvature = goal
    wheelbase = vehicle.wheelbase_m
    reach = wheelbase - vehicle.centre_ahead_of_rear_axle_m
    heading = goal_yaw + np.arctan(wheelbase * curvature)
    gap_x = goal_x - x_m + reach * (np.cos(goal_yaw) - np.cos(yaw))
    gap_y = goal_y - y_m + reach * (np.sin(goal_yaw) - np.sin(yaw))
    offset = gap_y * np.cos(heading) - gap_x * np.sin(heading)
    rate = gains.lateral_per_s * min(gains.town_mps / max(abs(speed), _SLOWEST_MPS), 1.0)
    correction = np.arctan2(rate * offset, abs(speed) + gains.lateral_soft_mps)
    share = gains.swerve_share if speed <= gains.town_mps else gains.grip_share
    grip = share * GRAVITY_MPS2 * vehicle.friction_coefficient
    tightest = min(np.tan(vehicle.max_steer_rad) / wheelbase, grip / max(speed * speed, _SLOWEST_MPS * _SLOWEST_MPS))
    turn = within(wrapped_rad(heading - yaw) + correction, -_FULL_LOCK_RAD, _FULL_LOCK_RAD)
    held, answer = np.tan(present) / wheelbase, -np.expm1(-dt_s * gains.quickness / vehicle.steer_lag_s)
    left = _quickest_turn_in(vehicle, speed, held, grip) * dt_s / answer
    right = _quickest_turn_in(vehicle, speed, -held, grip) * dt_s / answer
    steered = within(np.tan(turn) / wheelbase, max(-tightest, held - right), min(tightest, held + left))
    rear_share = vehicle.cg_to_rear_axle_m / wheelbase
    front_slip = vehicle.mass_kg * rear_share / vehicle.cornering_stiffness_front_npr * speed * speed * curvature
    return np.arctan(steered * wheelbase) + front_slip, steered


@compiled
def _before_lag(wanted: float, present: float, lag_s: float, dt_s: float) -> float:
    """Command whose mean response over a step, behind a first-order lag, is the wanted value; within 0–1."""
    kept = lag_s / dt_s * -np.expm1(-dt_s / lag_s)
    return within((within(wanted, 0.0, 1.0) - kept * present) / (1.0 - kept), 0.0, 1.0)


@compiled
def _pedals(
    vehicle: Record,
    motion: tuple[float, float, float],
    wanted_mps: float,
    accel_mps2: float,
    dt_s: float,
    gains: TrackerGains,
) -> tuple[float, float]:
    """Pedals that reach the wanted speed within ``speed_time_s`` while it changes; the brake holds a waiting vehicle.

    ``motion`` holds forward speed, throttle and brake; ``wanted_mps`` is the speed at the end of the step.
    """
    speed, throttle, brake = motion
    drag = 0.5 * AIR_DENSITY_KGPM3 * vehicle.drag_area_m2 / vehicle.mass_kg * speed * speed
    closing = (wanted_mps - accel_mps2 * dt_s - speed) / gains.speed_time_s
    push = accel_mps2 + closing + drag + vehicle.rolling_resistance * GRAVITY_MPS2
    drive = min(vehicle.max_drive_accel_mps2, vehicle.drive_power_w / (vehicle.mass_kg * max(speed, 0.1)))
    braking = _before_lag(-push / vehicle.max_brake_decel_mps2, brake, vehicle.brake_lag_s / gains.quickness, dt_s)
    if wanted_mps < gains.standing_mps:
        return 0.0, max(braking, gains.holding_brake)
    lag_s = vehicle.throttle_lag_s / gains.quickness
    return _before_lag(push / (gains.drive_factor * drive), throttle, lag_s, dt_s), braking


@compiled
def follow(
    bodies: Floats,
    tracker: Floats,
    reference: Floats,
    records: Records,
    walks: Flags,
    dt_s: float,
    gains: TrackerGains,
    out: Floats,
) -> None:
    """Controls of all vehicles for one step; pedestrians have none.

    They follow from the columns of ``BodyState``, ``TrackerState`` and ``Reference``. Result in ``out``, shape
    ``(6, N)``: the first three rows of ``Controls.columns``, then ``NEXT_YAW``, ``NEXT_PACE`` and ``NEXT_ACCEL``.
    """
    pace_share, accel_share = -np.expm1(-dt_s / gains.pace_time_s), -np.expm1(-dt_s / gains.accel_time_s)
    for n in range(records.shape[0]):
        if walks[n]:
            continue
        vehicle = records[n]
        x_m, y_m, yaw, speed = bodies[X, n], bodies[Y, n], bodies[YAW, n], bodies[FORWARD, n]
        last_x, last_y, last_yaw = tracker[X, n], tracker[Y, n], tracker[YAW, n]
        last_pace, last_accel = tracker[PACE, n], tracker[SMOOTH_ACCEL, n]
        dx, dy, sumo_mps = reference[X, n] - last_x, reference[Y, n] - last_y, reference[SPEED, n]
        moved = np.sqrt(dx * dx + dy * dy)
        pull = vehicle.centre_ahead_of_rear_axle_m
        course = np.arctan2(dy, dx) if moved > _SLOWEST_STEP_M else reference[YAW, n]
        most = np.arctan(pull / vehicle.wheelbase_m * np.tan(vehicle.max_steer_rad))
        swerve = within(wrapped_rad(course - last_yaw), -most, most)
        goal = last_x, last_y, last_yaw, np.tan(swerve) / pull
        steer, steered = _steer(vehicle, (x_m, y_m, yaw, speed, bodies[STEER, n]), goal, dt_s, gains)
        ratio = within(moved / (dt_s * max(sumo_mps, _SLOWEST_STEP_M / dt_s)), _LEAST_PACE, _MOST_PACE)
        pace = last_pace + (ratio - last_pace) * pace_share
        accel = last_accel + (reference[SUMO_ACCEL, n] - last_accel) * accel_share
        course = last_yaw + swerve
        gap = (last_x - x_m) * np.cos(course) + (last_y - y_m) * np.sin(course)
        correction = within(gains.along_per_s * gap, -gains.along_most_mps, gains.along_most_mps)
        grip = gains.grip_share * GRAVITY_MPS2 * vehicle.friction_coefficient
        fastest = np.sqrt(grip / max(abs(steered), _STRAIGHT_PM))
        wanted = min(max(pace * sumo_mps + correction, 0.0), fastest)
        motion = speed, bodies[THROTTLE, n], bodies[BRAKE, n]
        out[ASKED_THROTTLE, n], out[ASKED_BRAKE, n] = _pedals(vehicle, motion, wanted, accel, dt_s, gains)
        out[ASKED_STEER, n] = steer
        out[NEXT_YAW, n], out[NEXT_PACE, n], out[NEXT_ACCEL, n] = last_yaw + moved * np.sin(swerve) / pull, pace, accel


@dataclass(frozen=True)
class Reference(Columns):
    """SUMO's vehicles at one step, ``map`` frame; arrays of shape ``(N,)``; positions are footprint centres."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    speed_mps: Floats
    accel_mps2: Floats


@dataclass(frozen=True)
class TrackerState(Columns):
    """Reference of the last step: SUMO's centre, and the yaw of a car whose centre follows SUMO's path."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    pace: Floats
    """Speed of the centre divided by SUMO's (front bumper) speed; below 1 in turns."""
    accel_mps2: Floats
    """SUMO's acceleration, smoothed."""

    @classmethod
    def at(cls, x_m: Floats, y_m: Floats, yaw_rad: Floats) -> "TrackerState":
        """State of actors whose tracking begins, or begins again, at these poses."""
        return cls(x_m, y_m, yaw_rad, np.ones(len(x_m)), np.zeros(len(x_m)))


DEFAULT_GAINS: Final = TrackerGains()


def track(
    state: BodyState,
    tracker: TrackerState,
    reference: Reference,
    table: ParameterTable,
    dt_s: float,
    gains: TrackerGains = DEFAULT_GAINS,
) -> tuple[Controls, TrackerState]:
    """Controls for the step that ends with SUMO's vehicles at ``reference``, and the tracker's state then.

    ``state`` and ``tracker`` are of the step's start; rows of ``table`` are those of ``state``.
    """
    n = len(state)
    out = np.empty((6, n))
    walks = np.zeros(n, np.bool_)
    follow(state.columns, tracker.columns, reference.columns, table.records, walks, dt_s, gains, out)
    throttle, brake, steer, yaw, pace, accel = out
    controls = Controls(
        throttle=throttle,
        brake=brake,
        steer_rad=steer,
        hand_brake=np.zeros(n, dtype=bool),
        quickness=np.full(n, gains.quickness),
        drive_factor=np.full(n, gains.drive_factor),
    )
    return controls, TrackerState(reference.x_m, reference.y_m, yaw, pace, accel)
