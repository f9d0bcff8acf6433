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

from siren_ros.dynamics.body_loops import advance
from siren_ros.dynamics.parameters import ParameterTable
from siren_ros.numerics.arrays import Floats

SUBSTEP_S: Final = 0.01


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

    @property
    def columns(self) -> Floats:
        """All fields in declaration order, shape ``(11, N)``, as compiled loops take them."""
        return np.array([getattr(self, name) for name in _BODY_FIELDS])

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

    @property
    def columns(self) -> Floats:
        """All fields in declaration order, shape ``(6, N)``, as compiled loops take them."""
        return np.array([getattr(self, name) for name in _CONTROL_FIELDS], dtype=np.float64)


_BODY_FIELDS: Final = tuple(field.name for field in fields(BodyState))
_CONTROL_FIELDS: Final = tuple(field.name for field in fields(Controls))


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
    after = np.empty((len(_BODY_FIELDS), len(state)))
    advance(state.columns, controls.columns, table.records, count, dt_s / count, after)
    return BodyState(*after)
