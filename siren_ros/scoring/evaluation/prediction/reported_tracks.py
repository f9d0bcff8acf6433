"""What a tracker reports in place of logged states: simulated errors, or the tracks of a detector.

Simulated are errors of position, velocity and heading, gaps, exchanged ids. The errors of a vehicle are correlated in
time, and are the same in all windows that hold the same frame. The truth, and which samples there are, do not change.

A detector's boxes are followed by the common tracker. A track belongs to the vehicle that it is nearest to at a frame;
what it was before is that vehicle's reported past, also where it followed another one. Class, size, lamps and signals
are the record's.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from siren_ros.base.numerics.arrays import Flags, Floats, Rows, random_stream
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.episode_source import Need, survey_bag
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.data.tracks import FRAME_S, LOG_PERIOD_STEPS
from siren_ros.scoring.evaluation.detection.detectors import run_detector
from siren_ros.scoring.evaluation.detection.frames import frames_of, read_frames
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES
from siren_ros.scoring.evaluation.detection.tracking import tracks_of

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


_GATE_M: Final = 2.5
"""A vehicle farther than this from every track is not reported (the tracker's own gate)."""
_OWN_M: Final = 1.0
"""An actor nearer than this to the LiDAR's carrier, as stated, is the carrier itself."""
_GOES_ON_FRAMES: Final = 10
"""Number of frames (1 s) for which a track continues without boxes, as in the tracker."""
_PAST_FRAMES: Final = 50
"""Number of frames for which a new track's past is extrapolated backwards from its motion."""
_HEADS_MPS: Final = 1.0
"""Above this speed a vehicle's heading is its direction of motion; a box does not tell front from rear."""


@dataclass(frozen=True)
class BoxTracks:
    """The boxes of an episode with their tracks, in the order of time; arrays have one row per box."""

    step: Rows
    track: Rows
    xy_m: Floats
    """Position in the ``map`` frame, shape ``(N, 2)``."""
    yaw_rad: Floats
    velocity_mps: Floats
    """Velocity of the track, shape ``(N, 2)``."""


@dataclass(frozen=True)
class DetectedRows:
    """Rows of the tracks: one for each track and each frame at which it exists."""

    rows: StateRows
    of_track: Rows
    """Row of each track at each frame, −1 where it does not exist; shape ``(T, F)``."""
    track_of: Rows
    """Track of each actor at each frame, −1 for none; shape ``(A, F)``."""

    def points(self, _points: Rows, _table: Rows, actor: Rows, frame: Rows, offsets: npt.NDArray[np.int64]) -> Rows:
        """Rows of the points of a history, as ``ReportedRows.points``."""
        track, at = self.track_of[actor, frame], frame[:, None] + offsets
        inside = (track[:, None] >= 0) & (at >= 0)
        return np.where(inside, self.of_track[track[:, None], np.maximum(at, 0)], -1)


def detected_by(detector: str, bag: Path) -> Reporter:
    """Reporter of a detector's tracks in a bag with LiDAR.

    Raises:
        BagError: The bag is damaged or has no LiDAR.
        InputError: The detector cannot run here.
    """
    with TemporaryDirectory(prefix="siren_tracks_") as scratch:
        survey = survey_bag(bag, "detection", (Need.LIDAR, Need.MAP), Path(scratch))
        frames = read_frames(survey, survey.name)
        boxes, _ = run_detector(detector, frames, None)
    found = tracks_of(frames_of([frames]), boxes.at(np.isin(boxes.label, sorted(VEHICLE_NAMES))))
    tracks = BoxTracks(
        frames.step[found.boxes.frame],
        found.track,
        found.boxes.centre_m[:, :2],
        found.boxes.yaw_rad,
        found.velocity_mps,
    )

    def report(_record: EpisodeRecord, rows: StateRows, table: Rows) -> DetectedRows:
        return reported_by(with_own(tracks, rows, frames.step, frames.vehicle_m), rows, table)

    return report


def with_own(tracks: BoxTracks, rows: StateRows, step: Rows, vehicle_m: Floats) -> BoxTracks:
    """Add the track of the vehicle with the LiDAR, which knows its own motion.

    Args:
        tracks: Tracks of its detector.
        rows: The logged rows.
        step: Steps of the sweeps, shape ``(F,)``.
        vehicle_m: Its places then, in the ``map`` frame, shape ``(F, 2)``.
    """
    at = np.minimum(np.searchsorted(step, rows.step), len(step) - 1)
    away = rows.xy_m - vehicle_m[at]
    there = (step[at] == rows.step) & (np.hypot(away[:, 0], away[:, 1]) < _OWN_M)
    if not there.any():
        return tracks
    ids, counts = np.unique(rows.actor_id[there], return_counts=True)
    own = rows.select(np.flatnonzero(rows.actor_id == ids[counts.argmax()]))
    own = own.select(np.argsort(own.step, kind="stable"))
    number = np.full(len(own.step), tracks.track.max(initial=-1) + 1)
    velocity = np.stack((own.vx_mps, own.vy_mps), axis=-1)
    columns = (own.step, number, own.xy_m, own.yaw_rad, velocity)
    return BoxTracks(
        *(
            np.concatenate((getattr(tracks, column.name), more))
            for column, more in zip(fields(tracks), columns, strict=True)
        )
    )


def reported_by(tracks: BoxTracks, rows: StateRows, table: Rows) -> DetectedRows:
    """Replace the logged rows by the rows of tracks.

    Args:
        tracks: Tracks of the episode.
        rows: The logged rows.
        table: Row of each actor at each frame, −1 where it is not there; shape ``(A, F)``.
    """
    frames = table.shape[1]
    numbers = np.unique(tracks.track)
    of_track = np.full((len(numbers), frames), -1, dtype=np.intp)
    seen, motions, count = np.zeros(of_track.shape, dtype=np.bool_), [], 0
    for number, track in enumerate(numbers.tolist()):
        boxes = np.flatnonzero(tracks.track == track)
        lasts = _lasting(tracks.step[boxes], frames)
        seen[number, lasts] = True
        first = max(lasts.start - _PAST_FRAMES, 0)
        motion = _motion(tracks, boxes, np.arange(first, lasts.stop))
        of_track[number, first : first + len(motion)] = count + np.arange(len(motion))
        motions.append(motion)
        count += len(motion)
    motion = np.concatenate(motions) if motions else np.zeros((0, 6))
    track_of, actor_row = np.full(table.shape, -1, dtype=np.intp), np.zeros(len(motion), dtype=np.intp)
    for frame in range(frames):
        actors, lasting = np.flatnonzero(table[:, frame] >= 0), np.flatnonzero(seen[:, frame])
        way = rows.xy_m[table[actors, frame]][:, None] - motion[of_track[lasting, frame], :2]
        away_m = np.hypot(way[..., 0], way[..., 1])
        one, other = linear_sum_assignment(np.minimum(away_m, _GATE_M))
        near = away_m[one, other] < _GATE_M
        track_of[actors[one[near]], frame] = lasting[other[near]]
        actor_row[of_track[lasting[other[near]], frame]] = table[actors[one[near]], frame]
    names = ("x_m", "y_m", "vx_mps", "vy_mps", "yaw_rad", "accel_mps2")
    columns = {name: motion[:, column] for column, name in enumerate(names)}
    reported: StateRows = replace(rows.select(actor_row), **columns)  # type: ignore[arg-type] # its own columns
    return DetectedRows(reported, of_track, track_of)


def _lasting(step: Rows, frames: int) -> slice:
    """The frames at which a track is reported: from its first box until 1 s after its last one."""
    first, last = -(-int(step[0]) // LOG_PERIOD_STEPS), int(step[-1]) // LOG_PERIOD_STEPS
    return slice(first, min(last + 1 + _GOES_ON_FRAMES, frames))


def _motion(tracks: BoxTracks, boxes: Rows, frames: Rows) -> Floats:
    """Position, velocity, heading and acceleration of a track at some frames, shape ``(K, 6)``."""
    step, at = tracks.step[boxes], frames * LOG_PERIOD_STEPS
    box = np.maximum(np.searchsorted(step, at, side="right") - 1, 0)  # the latest box so far, or the very first one
    velocity = tracks.velocity_mps[boxes][box]
    place = tracks.xy_m[boxes][box] + ((at - step[box]) * STEP_S)[:, None] * velocity
    yaw = _headings(tracks.yaw_rad[boxes], tracks.velocity_mps[boxes])[box]
    speed = velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw)
    back = np.maximum(np.arange(len(at)) - SPEED_CHANGE_FRAMES, 0)
    gained = (speed - speed[back]) / (SPEED_CHANGE_FRAMES * FRAME_S)
    return np.column_stack((place, velocity, yaw, gained))


def _headings(yaw_rad: Floats, velocity_mps: Floats) -> Floats:
    """Headings of a track's boxes, turned around where they oppose its motion or the previous heading."""
    headings = yaw_rad.copy()
    for row, (vx_mps, vy_mps) in enumerate(velocity_mps.tolist()):
        known = np.arctan2(vy_mps, vx_mps) if np.hypot(vx_mps, vy_mps) > _HEADS_MPS else headings[max(row - 1, 0)]
        if abs(float(wrap_angle(headings[row] - known))) > 0.5 * np.pi:
            headings[row] += np.pi
    return wrap_angle(headings)
