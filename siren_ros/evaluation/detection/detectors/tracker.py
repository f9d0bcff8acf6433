"""A tracker of detected vehicles, whose velocities come from the places of several sweeps."""

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


@dataclass
class Tracker:
    """An alpha-beta filter for each vehicle, in the ``map`` frame."""

    place_m: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    velocity_mps: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    sweeps: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Number of sweeps that each track has been seen in."""
    last_step: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    step: int = 0

    def follow(
        self, step: int, place_m: Floats, step_s: float, velocity_mps: Floats | None = None
    ) -> tuple[Floats, Rows]:
        """Takes the boxes of a step's sweep by their centres, shape ``(N, 2)``.

        A new track begins with the velocity that its detector states, ``(N, 2)``, or standing. Returns velocities,
        shape ``(N, 2)``, and the number of sweeps that each vehicle has been seen in, ``(N,)``.
        """
        passed_s = (step - self.step) * step_s
        self.step = step
        kept = step - self.last_step <= _FORGET_STEPS
        self.velocity_mps = self.velocity_mps[kept]
        self.place_m = self.place_m[kept] + self.velocity_mps * passed_s
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
        begin = np.zeros((len(place_m), 2)) if velocity_mps is None else velocity_mps
        self.velocity_mps = np.vstack((self.velocity_mps, begin[new]))
        self.sweeps = np.r_[self.sweeps, np.ones(len(new), dtype=np.intp)]
        self.last_step = np.r_[self.last_step, np.full(len(new), step, dtype=np.intp)]
        return self.velocity_mps[rows], self.sweeps[rows]

    def _pairs(self, place_m: Floats) -> tuple[Rows, Rows, Floats]:
        way = place_m[None] - self.place_m[:, None]
        distance = np.hypot(way[..., 0], way[..., 1])
        track, box = linear_sum_assignment(np.minimum(distance, _GATE_M))
        near = distance[track, box] < _GATE_M
        return track[near], box[near], way[track[near], box[near]]
