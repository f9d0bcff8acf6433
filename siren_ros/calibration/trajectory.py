"""Trajectories that parameters are fitted to: an EMV's places over time."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Floats
from siren_ros.recording.episode_record import EpisodeRecord

_COLUMNS = ("time_s", "x_m", "y_m")


@dataclass(frozen=True)
class Trajectory:
    """An EMV's way in the ``map`` frame, times rising; shapes ``(T,)`` and ``(T, 2)``."""

    time_s: Floats
    xy_m: Floats

    @classmethod
    def of_record(cls, record: EpisodeRecord) -> Self:
        """That of an episode's first EMV.

        Raises:
            InputError: The episode has none.
        """
        track = record.track(record.emv_ids[0]) if record.emv_ids else None
        if track is None or not len(track):
            raise InputError("bag", record.description.template, "an episode with an EMV")
        return cls(track.time_s, track.xy_m)

    @classmethod
    def read(cls, file: Path) -> Self:
        """From a CSV file with the columns ``time_s``, ``x_m`` and ``y_m``, times from the episode's beginning.

        Raises:
            InputError: No such file, columns or numbers, or times that do not rise.
        """
        try:
            with file.open(encoding="utf-8", newline="") as opened:
                rows = [[float(row[name]) for name in _COLUMNS] for row in csv.DictReader(opened)]
        except (OSError, KeyError, TypeError, ValueError) as error:
            allowed = f"a CSV file with the columns {', '.join(_COLUMNS)} ({error!r})"
            raise InputError("trajectory", str(file), allowed) from error
        values = np.array(rows, dtype=np.float64).reshape(-1, len(_COLUMNS))
        if len(values) < 2 or not np.isfinite(values).all() or not (np.diff(values[:, 0]) > 0.0).all():
            raise InputError("trajectory", str(file), "two or more rows of finite numbers with rising times")
        return cls(values[:, 0], values[:, 1:])

    @property
    def end_s(self) -> float:
        """Its last time."""
        return float(self.time_s[-1])

    @property
    def length_s(self) -> float:
        """From its first time to its last one."""
        return float(self.time_s[-1] - self.time_s[0])

    def until(self, length_s: float) -> "Trajectory":
        """Its first seconds, two places at least."""
        places = max(2, int(np.searchsorted(self.time_s, self.time_s[0] + length_s + 1e-9)))
        return Trajectory(self.time_s[:places], self.xy_m[:places])

    def residuals_m(self, other: "Trajectory") -> Floats:
        """Differences of x and y at this trajectory's times over the root of their number, shape ``(2T,)``.

        The Euclidean norm is the root mean square of the distance: the error whose minimum is the most likely way where
        all places have the same noise. Times before the other one begins count nothing. Where the other one ends before
        this one, its last place counts: an EMV that left the map earlier is far ahead.

        Raises:
            InputError: The other one covers no time of this one.
        """
        there = self.time_s >= other.time_s[0] - 1e-9
        if not there.any():
            raise InputError("trajectory", f"from {self.time_s[0]:g} to {self.end_s:g} s", "times of the episode")
        apart = [np.interp(self.time_s, other.time_s, other.xy_m[:, axis]) - self.xy_m[:, axis] for axis in (0, 1)]
        return np.concatenate(apart) * np.tile(there, 2) / np.sqrt(there.sum())

    def distance_m(self, other: "Trajectory") -> float:
        """Root mean square of the distance, as ``residuals_m`` has it."""
        return float(np.linalg.norm(self.residuals_m(other)))
