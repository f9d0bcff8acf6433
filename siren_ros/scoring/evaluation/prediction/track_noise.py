"""Simulates a tracker in place of logged states: errors of position, velocity and heading, gaps, exchanged ids.

The errors of a vehicle are correlated in time, and are the same in all windows that hold the same frame. The truth, and
which samples there are, do not change.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats, Rows, random_stream
from siren_ros.data.record.tracks import FRAME_S
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows

SPEED_CHANGE_FRAMES: Final = 5
"""Frames (0.5 s) over which acceleration is computed from noisy speed, because a tracker does not measure it."""
_SWAPS_APART_FRAMES: Final = 80
"""Least number of frames between two swaps of a vehicle, so that a window of 8 s has at most one."""


@dataclass(frozen=True)
class TrackNoise:
    """Magnitudes of the errors. Standard deviations are of normal errors with the correlation time ``correlation_s``.

    Positions and velocities: a detector's mean errors (nuScenes' ATE and AVE, the length of a two-dimensional error)
    are 1.25 standard deviations of one axis. The shipped detector has an ATE of 0.29 m, the shipped tracker an AVE of
    0.30 m/s (``docs/detection.md``); the first detectors of nuScenes' leaderboard are near to both. Headings: an AOE of
    0.08 rad is 0.8 standard deviations; a tracker halves the detector's. Swaps: CenterPoint (Yin, Zhou, Krähenbühl,
    CVPR 2021) has some hundred on the 150 scenes of 20 s of nuScenes' test set, about one in 100 s of a vehicle in
    traffic. Dropouts are an assumption: one in 20 s, half a second long.
    """

    position_m: float = 0.23
    """Standard deviation of the position on each axis."""
    velocity_mps: float = 0.24
    """Standard deviation of the velocity on each axis."""
    yaw_rad: float = 0.1
    """Standard deviation of the heading."""
    correlation_s: float = 0.5
    """Time in which the correlation of the errors falls to 1/e, as behind a Kalman filter."""
    dropouts_per_s: float = 0.05
    """Rate of gaps, in which the tracker continues with the last velocity."""
    dropout_s: float = 0.5
    """Mean duration of a gap."""
    swaps_per_s: float = 0.01
    """Rate at which two vehicles exchange their ids; from then on each has the other's history."""
    swap_reach_m: float = 5.0
    """Largest distance of two vehicles that exchange ids."""
    draw: int = 0
    """Number of the random draw; other numbers give other errors of the same size."""

    def scaled(self, factor: float, draw: int) -> "TrackNoise":
        """A better or worse tracker: all magnitudes and rates multiplied by a factor."""
        scaled = ("position_m", "velocity_mps", "yaw_rad", "dropouts_per_s", "swaps_per_s")
        return replace(self, draw=draw, **{name: factor * getattr(self, name) for name in scaled})


NOISES: Final = MappingProxyType(
    {
        "tracker": TrackNoise(),
        "velocity": TrackNoise(position_m=0.0, yaw_rad=0.0, velocity_mps=0.3, dropouts_per_s=0.0, swaps_per_s=0.0),
    }
)
"""Noise by name: a tracker's errors, and errors of the velocity alone."""


class ReportedRows(Protocol):
    """Rows that replace a record's rows, and which of them are the points of a history."""

    @property
    def rows(self) -> StateRows:
        """The reported rows."""

    def points(self, points: Rows, table: Rows, actor: Rows, frame: Rows, offsets: npt.NDArray[np.int64]) -> Rows:
        """Rows of the points of a history, as in ``TrackedRows``; −1 at the present of actors that are not reported."""


Reporter = Callable[[EpisodeRecord, StateRows, Rows], ReportedRows]
"""Makes the reported rows of an episode from its logged rows and their table by actor and frame (−1: absent)."""


@dataclass(frozen=True)
class TrackedRows:
    """The rows of a record as a tracker reports them, in the record's order."""

    rows: StateRows
    swaps: tuple[tuple[int, int, int], ...]
    """Exchanges of ids: the frame from which on they hold, and the two columns in the table of rows."""

    def points(self, points: Rows, table: Rows, actor: Rows, frame: Rows, offsets: npt.NDArray[np.int64]) -> Rows:
        """Rows of the points of a history after the exchanges of ids.

        Args:
            points: Rows of the points without exchanges, −1 where nothing is logged, shape ``(M, H)``.
            table: Row of each actor at each frame, −1 where it is not there; shape ``(A, F)``.
            actor: Column of the table of each of M histories.
            frame: Its present.
            offsets: Frames of the points relative to the present, shape ``(H,)``.
        """
        points = points.copy()
        at = frame[:, None] + offsets
        for since, *pair in self.swaps:
            for own, other in (pair, pair[::-1]):
                of_other = np.where(at >= 0, table[other, np.maximum(at, 0)], -1)
                moved = ((actor == own) & (frame >= since))[:, None] & (at < since) & (of_other >= 0) & (points >= 0)
                points[moved] = of_other[moved]
        return points


def with_noise(noise: TrackNoise) -> Reporter:
    """Reporter that adds errors; the episode's seed decides them."""

    def report(record: EpisodeRecord, rows: StateRows, table: Rows) -> ReportedRows:
        about = record.description
        random = random_stream(about.seed, f"track_noise/{about.template}/{about.level.name}", noise.draw)
        return tracked(rows, table, noise, random)

    return report


def tracked(rows: StateRows, table: Rows, noise: TrackNoise, random: np.random.Generator) -> TrackedRows:
    """Simulate a tracker on rows; ``table`` has the row of each actor at each frame, as in ``TrackedRows``."""
    there = table >= 0
    xy_m = _on_grid(rows.xy_m, table) + noise.position_m * _errors(table.shape, noise, random)
    velocity = _on_grid(np.stack((rows.vx_mps, rows.vy_mps), axis=-1), table)
    velocity += noise.velocity_mps * _errors(table.shape, noise, random)
    yaw = _on_grid(rows.yaw_rad[:, None], table)[..., 0] + noise.yaw_rad * _errors(table.shape, noise, random)[..., 0]
    lost = _dropouts(there, noise, random)
    for frame in range(1, table.shape[1]):
        coasting = lost[:, frame]
        xy_m[coasting, frame] = xy_m[coasting, frame - 1] + FRAME_S * velocity[coasting, frame - 1]
        velocity[coasting, frame], yaw[coasting, frame] = velocity[coasting, frame - 1], yaw[coasting, frame - 1]
    speed = velocity[..., 0] * np.cos(yaw) + velocity[..., 1] * np.sin(yaw)
    back = np.arange(table.shape[1]) - SPEED_CHANGE_FRAMES
    known = there & there[:, np.maximum(back, 0)] & (back >= 0)
    gained = np.where(known, (speed - speed[:, np.maximum(back, 0)]) / (SPEED_CHANGE_FRAMES * FRAME_S), 0.0)
    columns = {"x_m": xy_m[..., 0], "y_m": xy_m[..., 1], "vx_mps": velocity[..., 0], "vy_mps": velocity[..., 1]}
    columns |= {"yaw_rad": yaw, "accel_mps2": gained}
    changed = {name: getattr(rows, name).copy() for name in columns}
    for name, values in columns.items():
        changed[name][table[there]] = values[there]
    return TrackedRows(replace(rows, **changed), _swaps(_on_grid(rows.xy_m, table), there, noise, random))


def _on_grid(values: Floats, table: Rows) -> Floats:
    """Rearrange values of rows, ``(M, C)``, by actor and frame, ``(A, F, C)``; 0 where there is no row."""
    if not len(values):
        return np.zeros((*table.shape, values.shape[1]))
    return np.where((table >= 0)[..., None], values[table], 0.0)


def _errors(shape: tuple[int, ...], noise: TrackNoise, random: np.random.Generator) -> Floats:
    """Normal errors with standard deviation 1 on two axes, correlated over the frames; shape ``(A, F, 2)``."""
    kept = float(np.exp(-FRAME_S / noise.correlation_s))
    errors = random.normal(size=(*shape, 2))
    for frame in range(1, shape[1]):
        errors[:, frame] = kept * errors[:, frame - 1] + np.sqrt(1.0 - kept**2) * errors[:, frame]
    return errors


def _dropouts(there: Flags, noise: TrackNoise, random: np.random.Generator) -> Flags:
    """Where the tracker loses a vehicle that it saw in the frame before, shape ``(A, F)``."""
    begins = random.random(there.shape) < noise.dropouts_per_s * FRAME_S
    goes_on = random.random(there.shape) < np.exp(-FRAME_S / noise.dropout_s)
    lost = np.zeros(there.shape, dtype=np.bool_)
    for frame in range(1, there.shape[1]):
        lost[:, frame] = (
            there[:, frame] & there[:, frame - 1] & (begins[:, frame] | lost[:, frame - 1] & goes_on[:, frame])
        )
    return lost


def _swaps(
    xy_m: Floats, there: Flags, noise: TrackNoise, random: np.random.Generator
) -> tuple[tuple[int, int, int], ...]:
    draws = random.random(there.shape) < noise.swaps_per_s * FRAME_S
    last = np.full(len(there), -_SWAPS_APART_FRAMES)
    swaps = []
    for actor, frame in zip(*np.nonzero((draws & there).T)[::-1], strict=True):
        others = np.flatnonzero(there[:, frame] & (np.arange(len(there)) != actor))
        away_m = np.hypot(*(xy_m[others, frame] - xy_m[actor, frame]).T)
        if not len(others) or away_m.min() > noise.swap_reach_m:
            continue
        other = others[away_m.argmin()]
        if frame - max(last[actor], last[other]) >= _SWAPS_APART_FRAMES:
            last[[actor, other]] = frame
            swaps.append((int(frame), int(actor), int(other)))
    return tuple(swaps)
