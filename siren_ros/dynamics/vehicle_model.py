"""Dynamic single-track (bicycle) model of many vehicles at once, stable from standstill to top speed.

The lateral equations are solved implicitly and multiplied by the speed, as in Ge et al., "Numerically Stable
Dynamic Bicycle Model for Discrete-time Control" (IEEE IV Workshops, 2021), so that they turn into the kinematic
model towards standstill. Tyre forces follow Fiala's brush model (Rajamani, "Vehicle Dynamics and Control", 2012,
ch. 13) with what the longitudinal force leaves of the friction circle; its secant stiffness enters the implicit
solution. There is no reverse gear, and the road is level.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.dynamics.body_loops import Axles, Forces, integrate
from siren_ros.dynamics.parameters import AIR_DENSITY_KGPM3, ParameterTable
from siren_ros.world.actors import Floats
from siren_ros.world.units import GRAVITY_MPS2

SUBSTEP_S: Final = 0.01
_LONGITUDINAL_SHARE: Final = 0.95
"""Anti-lock and traction control keep the longitudinal force below this part of an axle's grip."""
_REAR_BRAKE_SHARE: Final = 0.7
"""Brake force distribution follows the axle loads and keeps the rear axle to this part of its share."""
_POWER_FROM_MPS: Final = 0.1


@dataclass(frozen=True)
class BodyState:
    """Motion and actuators of N vehicles, arrays of shape ``(N,)``; positions are footprint centres, ``map`` frame."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    forward_mps: Floats
    """Velocity of the centre of gravity along the vehicle; negative only after a spin."""
    lateral_mps: Floats
    """Velocity of the centre of gravity to the left of the vehicle."""
    yaw_rate_radps: Floats
    accel_mps2: Floats
    """Acceleration of the centre of gravity along the vehicle, mean over the step."""
    lateral_accel_mps2: Floats
    """Acceleration of the centre of gravity to the left, mean over the step."""
    steer_rad: Floats
    throttle: Floats
    brake: Floats

    def __len__(self) -> int:
        return len(self.x_m)

    @classmethod
    def moving(cls, x_m: Floats, y_m: Floats, yaw_rad: Floats, speed_mps: Floats) -> "BodyState":
        """Vehicles that roll straight ahead, no pedal pressed."""
        zero = np.zeros(len(x_m))
        return cls(x_m, y_m, yaw_rad, speed_mps, *([zero] * 7))

    def select(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> "BodyState":
        """The vehicles of the given rows."""
        return type(self)(*(getattr(self, field.name)[rows] for field in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence["BodyState"]) -> "BodyState":
        """The vehicles of all parts, in order."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    @classmethod
    def where(cls, mask: npt.NDArray[np.bool_], chosen: "BodyState", other: "BodyState") -> "BodyState":
        """Rows of ``chosen`` where the mask holds, of ``other`` elsewhere."""
        pairs = ((getattr(chosen, field.name), getattr(other, field.name)) for field in fields(cls))
        return cls(*(np.where(mask, a, b) for a, b in pairs))

    def velocity_mps(self, table: ParameterTable) -> tuple[Floats, Floats]:
        """Velocity of the footprint's centre in the ``map`` frame, x and y."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        left = self.lateral_mps + table.centre_ahead_of_cg_m * self.yaw_rate_radps
        return self.forward_mps * cos - left * sin, self.forward_mps * sin + left * cos


@dataclass(frozen=True)
class Controls:
    """What the drivers ask of the actuators during one step, each array of shape ``(N,)``."""

    throttle: Floats
    """0–1."""
    brake: Floats
    """0–1."""
    steer_rad: Floats
    hand_brake: npt.NDArray[np.bool_]
    quickness: Floats
    """1 for a driver; more divides the lags of pedals and steering and multiplies the steering rate's limit."""
    drive_factor: Floats
    """1 for a driver; more raises what full throttle gives, within the tyres' grip."""


def step_bodies(state: BodyState, controls: Controls, table: ParameterTable, dt_s: float) -> BodyState:
    """Vehicles one step later under constant controls.

    Args:
        state: Vehicles at the start of the step.
        controls: Pedals and wanted road-wheel angles; values beyond the actuators' ranges saturate.
        table: Parameters, row by row those of ``state``.
        dt_s: Step, cut into equal substeps of at most ``SUBSTEP_S``.

    Returns:
        Vehicles at the end of the step. A vehicle at rest without throttle stays where it is to the last bit;
        brakes never move a vehicle backwards.
    """
    count = max(1, math.ceil(dt_s / SUBSTEP_S - 1e-9))
    h = dt_s / count
    throttle, brake, steer = _actuate(state, controls, table, count, h)
    forces = _forces(state, controls, table, (throttle, brake, steer))
    forward, lateral, rate = _integrate(state, table, forces, count, h)
    yaw = state.yaw_rad + h * np.cumsum(rate, axis=0)
    middle = yaw - (0.5 * h) * rate
    left = lateral + table.centre_ahead_of_cg_m * rate
    cos, sin = np.cos(middle), np.sin(middle)
    end = yaw[-1]
    turn = 0.5 * (state.lateral_mps * state.yaw_rate_radps + lateral[-1] * rate[-1])
    swing = 0.5 * (state.forward_mps * state.yaw_rate_radps + forward[-1] * rate[-1])
    return BodyState(
        x_m=state.x_m + h * (forward * cos - left * sin).sum(axis=0),
        y_m=state.y_m + h * (forward * sin + left * cos).sum(axis=0),
        yaw_rad=end - 2.0 * np.pi * np.rint(end / (2.0 * np.pi)),
        forward_mps=forward[-1],
        lateral_mps=lateral[-1],
        yaw_rate_radps=rate[-1],
        accel_mps2=(forward[-1] - state.forward_mps) / dt_s - turn,
        lateral_accel_mps2=(lateral[-1] - state.lateral_mps) / dt_s + swing,
        steer_rad=steer[-1],
        throttle=throttle[-1],
        brake=brake[-1],
    )


def _actuate(
    state: BodyState, controls: Controls, table: ParameterTable, count: int, h: float
) -> tuple[Floats, Floats, Floats]:
    """Throttle, brake and road-wheel angle at the end of each substep, shapes ``(count, N)``."""
    elapsed = h * np.arange(1, count + 1)[:, None] * controls.quickness
    wanted_throttle = np.clip(controls.throttle, 0.0, 1.0)
    wanted_brake = np.clip(controls.brake, 0.0, 1.0)
    throttle = wanted_throttle + (state.throttle - wanted_throttle) * np.exp(-elapsed / table.throttle_lag_s)
    brake = wanted_brake + (state.brake - wanted_brake) * np.exp(-elapsed / table.brake_lag_s)
    wanted = np.clip(controls.steer_rad, -table.max_steer_rad, table.max_steer_rad)
    share = -np.expm1(-h * controls.quickness / table.steer_lag_s)
    most = h * controls.quickness * table.max_steer_rate_radps
    steer = np.empty((count, len(state)))
    angle = state.steer_rad
    for i in range(count):
        change = (wanted - angle) * share
        angle = angle + np.minimum(np.maximum(change, -most), most)
        steer[i] = angle
    return throttle, brake, steer


def _forces(
    state: BodyState, controls: Controls, table: ParameterTable, actuators: tuple[Floats, Floats, Floats]
) -> Forces:
    throttle, brake, steer = actuators
    speed, mass = state.forward_mps, table.mass_kg
    full = np.minimum(mass * table.max_drive_accel_mps2, table.drive_power_w / np.maximum(speed, _POWER_FROM_MPS))
    drive = throttle * controls.drive_factor * full
    braking = brake * (mass * table.max_brake_decel_mps2)
    hand = np.where(controls.hand_brake, mass * table.hand_brake_decel_mps2, 0.0)
    shift = mass * state.accel_mps2 * table.cg_height_m
    load = np.stack(
        (
            mass * GRAVITY_MPS2 * table.cg_to_rear_axle_m - shift,
            mass * GRAVITY_MPS2 * table.cg_to_front_axle_m + shift,
        )
    )
    load = np.maximum(load / table.wheelbase_m, 0.1 * mass)
    rear_braking = braking * (_REAR_BRAKE_SHARE * load[1] / (load[0] + load[1]))
    wanted = np.stack(
        (
            drive * table.drive_front_share - (braking - rear_braking),
            drive * (1.0 - table.drive_front_share) - rear_braking - hand,
        ),
        axis=1,
    )
    grip = table.friction_coefficient * load
    most = _LONGITUDINAL_SHARE * grip
    tyre = np.minimum(np.maximum(wanted, -most), most)
    cos, sin = np.cos(steer), np.sin(steer)
    resistance = (
        0.5 * AIR_DENSITY_KGPM3 * table.drag_area_m2 * speed * speed + table.rolling_resistance * GRAVITY_MPS2 * mass
    )
    along = tyre[:, 0] * cos + tyre[:, 1]
    return Forces(
        tan_steer=sin / cos,
        cos_steer=cos,
        sin_steer=sin,
        lateral_limit_n=np.sqrt(grip * grip - tyre * tyre),
        push_n=np.maximum(along, 0.0),
        resist_n=resistance - np.minimum(along, 0.0),
        left_n=tyre[:, 0] * sin,
    )


def _integrate(
    state: BodyState, table: ParameterTable, forces: Forces, count: int, h: float
) -> tuple[Floats, Floats, Floats]:
    """Forward and lateral velocity and yaw rate at the end of each substep, shapes ``(count, N)``."""
    motion = np.stack((state.forward_mps, state.lateral_mps, state.yaw_rate_radps))
    axles = Axles(
        mass_rate=table.mass_kg / h,
        inertia_rate=table.yaw_inertia_kgm2 / h,
        front_arm_m=table.cg_to_front_axle_m,
        rear_arm_m=-table.cg_to_rear_axle_m,
        front_stiffness=table.cornering_stiffness_front_npr,
        rear_stiffness=table.cornering_stiffness_rear_npr,
    )
    course = np.empty((3, count, len(state)))
    integrate(motion, axles, forces, h, course)
    return course[0], course[1], course[2]
