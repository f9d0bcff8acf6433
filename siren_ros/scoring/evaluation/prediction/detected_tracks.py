"""Replaces logged states by a detector's tracks: its boxes, followed by the common tracker.

A track belongs to the vehicle that it is nearest to at a frame; what it was before is that vehicle's reported past,
also where it followed another one. Class, size, lamps and signals are the record's.
"""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from siren_ros.base.numerics.arrays import Floats, Rows
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.record.bag_survey import Need, survey_bag
from siren_ros.data.record.tracks import FRAME_S, LOG_PERIOD_STEPS
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.scoring.evaluation.detection.detectors.table import run_detector
from siren_ros.scoring.evaluation.detection.frames import frames_of, read_frames
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES
from siren_ros.scoring.evaluation.detection.tracking import tracks_of
from siren_ros.scoring.evaluation.prediction.track_noise import SPEED_CHANGE_FRAMES, Reporter

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
