"""Controls that make vehicles follow the poses that SUMO gives them, with the same vehicle model as all others.

SUMO moves a rigid rod with both bumpers on the lane's polyline. Its heading jumps, and its course differs from its
heading. The reference is therefore a car whose footprint centre takes SUMO's path. Its yaw is that of a trailer pulled
by the centre (a tractrix). Its front axle gives point and course for a Stanley law (Hoffmann et al., "Autonomous
Automobile Trajectory Tracking for Off-Road Driving", ACC 2007) with feed-forward of the front slip angle. Along the
path, SUMO's speed is fed forward and the distance is fed back. The actuators lag less than a driver's; tyres, steering
range and steering rate are the vehicle's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.dynamics.parameters import ParameterTable
from siren_ros.dynamics.tracker_loops import TrackerGains, follow
from siren_ros.dynamics.vehicle_model import BodyState, Controls
from siren_ros.numerics.arrays import Floats


@dataclass(frozen=True)
class Reference:
    """SUMO's vehicles at one step, ``map`` frame, each array of shape ``(N,)``; positions are footprint centres."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    speed_mps: Floats
    accel_mps2: Floats

    @property
    def columns(self) -> Floats:
        """All fields in declaration order, shape ``(5, N)``, as compiled loops take them."""
        return np.array((self.x_m, self.y_m, self.yaw_rad, self.speed_mps, self.accel_mps2))


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

    @property
    def columns(self) -> Floats:
        """All fields in declaration order, shape ``(5, N)``, as compiled loops take them."""
        return np.array((self.x_m, self.y_m, self.yaw_rad, self.pace, self.accel_mps2))

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
    n = len(state)
    out = np.empty((6, n))
    follow(state.columns, tracker.columns, reference.columns, table.records, dt_s, gains, out)
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
