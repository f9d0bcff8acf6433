"""Follows boxes from sweep to sweep: velocities, and which end of a box is its front."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from siren_ros.numerics.arrays import Floats, Rows

_GATE_M: Final = 2.5
"""A box farther from where a track is expected belongs to another one."""
_FORGET_STEPS: Final = 20
_GAIN_PLACE: Final = 0.5
_GAIN_VELOCITY: Final = 0.15
_TURNING_MPS: Final = 1.0
"""From this speed on a vehicle's front is where it moves."""


@dataclass
class Tracker:
    """An alpha-beta filter for each vehicle, in the ``map`` frame."""

    place_m: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    velocity_mps: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    sweeps: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """How many sweeps each track has been seen in."""
    last_step: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    step: int = 0

    def follow(self, step: int, place_m: Floats, step_s: float) -> tuple[Floats, Rows]:
        """Takes the boxes of a sweep.

        Args:
            step: Of the sweep.
            place_m: Centres, shape ``(N, 2)``.
            step_s: Duration of a step.

        Returns:
            Velocities, shape ``(N, 2)``, and in how many sweeps each vehicle has been seen, shape ``(N,)``.
        """
        passed_s = (step - self.step) * step_s
        self.step = step
        kept = step - self.last_step <= _FORGET_STEPS
        self.place_m, self.velocity_mps = (
            self.place_m[kept] + self.velocity_mps[kept] * passed_s,
            self.velocity_mps[kept],
        )
        self.sweeps, self.last_step = self.sweeps[kept], self.last_step[kept]
        track, box, away = self._pairs(place_m)
        if passed_s > 0.0:
            self.place_m[track] += _GAIN_PLACE * away
            self.velocity_mps[track] += _GAIN_VELOCITY * away / passed_s
        self.sweeps[track] += 1
        self.last_step[track] = step
        new = np.setdiff1d(np.arange(len(place_m)), box)
        rows = np.zeros(len(place_m), dtype=np.intp)
        rows[box], rows[new] = track, len(self.sweeps) + np.arange(len(new))
        self.place_m = np.vstack((self.place_m, place_m[new]))
        self.velocity_mps = np.vstack((self.velocity_mps, np.zeros((len(new), 2))))
        self.sweeps = np.r_[self.sweeps, np.ones(len(new), dtype=np.intp)]
        self.last_step = np.r_[self.last_step, np.full(len(new), step, dtype=np.intp)]
        return self.velocity_mps[rows], self.sweeps[rows]

    def _pairs(self, place_m: Floats) -> tuple[Rows, Rows, Floats]:
        way = place_m[None] - self.place_m[:, None]
        distance = np.hypot(way[..., 0], way[..., 1])
        track, box = linear_sum_assignment(np.minimum(distance, _GATE_M))
        near = distance[track, box] < _GATE_M
        return track[near], box[near], way[track[near], box[near]]


def directed_yaw(yaw_rad: Floats, velocity_mps: Floats) -> Floats:
    """Headings turned round where a vehicle moves backwards along them, shape ``(N,)``."""
    forward = np.cos(yaw_rad) * velocity_mps[:, 0] + np.sin(yaw_rad) * velocity_mps[:, 1]
    return np.where(forward < -_TURNING_MPS, yaw_rad + np.pi, yaw_rad)
