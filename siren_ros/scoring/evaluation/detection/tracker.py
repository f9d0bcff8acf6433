"""The tracker for all detectors: it finds which boxes of successive sweeps are the same vehicle, and its velocity."""

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from siren_ros.base.numerics.arrays import Floats, Rows

_GATE_M: Final = 2.5
"""A box farther than this from a track's predicted place belongs to another track."""
_FORGET_STEPS: Final = 20
_GAIN_PLACE: Final = 0.5
_GAIN_VELOCITY: Final = 0.15


class Followed(NamedTuple):
    """The tracker's result for the boxes of one sweep, in their order."""

    velocity_mps: Floats
    """Velocity over ground, shape ``(N, 2)``."""
    sweeps: Rows
    """Number of sweeps in which each vehicle has been seen, shape ``(N,)``."""
    track: Rows
    """Number of the track of each box, shape ``(N,)``; each occurs once in a sweep."""


@dataclass
class Tracker:
    """An alpha-beta filter for each vehicle, in the ``map`` frame."""

    place_m: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    velocity_mps: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    sweeps: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Number of sweeps in which each track has been seen."""
    last_step: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    track: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Numbers of the tracks; a number is never used again."""
    step: int = 0
    tracks: int = 0
    """Number of tracks so far."""

    def follow(self, step: int, place_m: Floats, step_s: float, stated_mps: Floats | None = None) -> Followed:
        """Add the boxes of a step's sweep, given by their centres, shape ``(N, 2)``.

        A new track begins with the velocity that the detector states for its box, shape ``(N, 2)``; without one, or
        where it is NaN, at rest.
        """
        passed_s = (step - self.step) * step_s
        self.step = step
        kept = step - self.last_step <= _FORGET_STEPS
        self.velocity_mps = self.velocity_mps[kept]
        self.place_m = self.place_m[kept] + self.velocity_mps * passed_s
        self.sweeps, self.last_step, self.track = self.sweeps[kept], self.last_step[kept], self.track[kept]
        track, box, away = self._pairs(place_m)
        self.sweeps[track] += 1
        if passed_s > 0.0:
            place, velocity = _gains(self.sweeps[track])
            self.place_m[track] += place[:, None] * away
            self.velocity_mps[track] += velocity[:, None] * away / passed_s
        self.last_step[track] = step
        new = np.setdiff1d(np.arange(len(place_m)), box)
        rows = np.zeros(len(place_m), dtype=np.intp)
        rows[box], rows[new] = track, len(self.sweeps) + np.arange(len(new))
        begin_mps = np.zeros((len(new), 2)) if stated_mps is None else np.nan_to_num(stated_mps[new])
        self.place_m = np.vstack((self.place_m, place_m[new]))
        self.velocity_mps = np.vstack((self.velocity_mps, begin_mps))
        self.sweeps = np.r_[self.sweeps, np.ones(len(new), dtype=np.intp)]
        self.last_step = np.r_[self.last_step, np.full(len(new), step, dtype=np.intp)]
        self.track = np.r_[self.track, self.tracks + np.arange(len(new))]
        self.tracks += len(new)
        return Followed(self.velocity_mps[rows], self.sweeps[rows], self.track[rows])

    def _pairs(self, place_m: Floats) -> tuple[Rows, Rows, Floats]:
        way = place_m[None] - self.place_m[:, None]
        distance = np.hypot(way[..., 0], way[..., 1])
        track, box = linear_sum_assignment(np.minimum(distance, _GATE_M))
        near = distance[track, box] < _GATE_M
        return track[near], box[near], way[track[near], box[near]]


def _gains(sweeps: Rows) -> tuple[Floats, Floats]:
    """Gains for position and velocity: a straight line through all boxes of a short track, then constant values.

    Source: E. Brookner, "Tracking and Kalman Filtering Made Easy", 1998, section 1.2.10, the growing-memory filter. The
    numbers of sweeps, shape ``(N,)``, are at least 2.
    """
    pairs = sweeps * (sweeps + 1.0)
    return np.maximum(2.0 * (2.0 * sweeps - 1.0) / pairs, _GAIN_PLACE), np.maximum(6.0 / pairs, _GAIN_VELOCITY)
