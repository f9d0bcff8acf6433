"""NGSIM files out of recorded episodes, as the published loaders of CSP, STDAN and BAT read them.

``traj`` has a row for each sample, ``tracks`` a cell for each data set and vehicle, shape ``(D, V)``. NGSIM's two roads
are straight; to keep what the loaders assume, every sample is a data set of its own, turned so that the target's lane
at the present points to +y. Vehicle 1 is the target, vehicles 2 … are its neighbours.

Columns, by ``utils.py`` of https://github.com/nachiket92/conv-social-pooling and ``loader2.py`` of
https://github.com/xbchen82/stdan:
``csp/``: data set, vehicle, frame, x, y, lane, lateral class, longitudinal class, 39 cells; tracks: frame, x, y.
``stdan/`` (BAT reads the same): data set, vehicle, frame, x, y, speed, acceleration, lane, class, lateral class,
longitudinal class, 39 cells; tracks: frame, x, y, speed, acceleration, lane, class. Feet and seconds.
"""

import io
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.io import savemat

from siren_ros.datasets.files import FileWriter
from siren_ros.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.datasets.ngsim_frame import (
    ACCELERATE,
    BRAKE,
    CELLS,
    FOOT_M,
    FUTURE_FRAMES,
    HISTORY_FRAMES,
    KEEP,
    LEFT,
    NORMAL,
    OUTSIDE,
    RIGHT,
    Numbers,
    RoadPlaces,
    across_and_ahead,
    lane_widths_m,
    lanes_to_the_right,
    lateral_class,
    longitudinal_class,
    neighbour_cells,
    road_places,
    vehicle_class,
)
from siren_ros.numerics.arrays import Floats
from siren_ros.record.episode_source import EpisodeSource
from siren_ros.record.tracks import LOG_PERIOD_STEPS, REGION, Track, tracks_of, whole_windows
from siren_ros.record.vehicle_location import sumo_lanes
from siren_ros.recording.episode_record import EpisodeRecord

_HEADER_BYTES: Final = 116
_HEADER: Final = b"MATLAB 5.0 MAT-file, written by SIREN"
"""scipy writes the time there."""
_WINDOW: Final = HISTORY_FRAMES + 1 + FUTURE_FRAMES
_SETS: Final = {"train": "TrainSet.mat", "val": "ValSet.mat", "test": "TestSet.mat"}
_LATERAL: Final = {KEEP: "keep", LEFT: "left", RIGHT: "right"}
_LONGITUDINAL: Final = {NORMAL: "normal", BRAKE: "brake", ACCELERATE: "accelerate"}


def mat_bytes(content: dict[str, Any]) -> bytes:
    """A MATLAB 5 file."""
    buffer = io.BytesIO()
    savemat(buffer, content, do_compression=True)
    data = bytearray(buffer.getvalue())
    data[:_HEADER_BYTES] = _HEADER.ljust(_HEADER_BYTES)
    return bytes(data)


@dataclass(frozen=True)
class _RoadTrack:
    """A track with its road."""

    track: Track
    road: RoadPlaces
    right: Numbers
    travelled_ft: Floats

    def index(self, frame: int) -> int | None:
        """Position of a frame, None where the vehicle is not there."""
        place = int(np.searchsorted(self.track.frame, frame))
        return place if place < len(self.track) and self.track.frame[place] == frame else None

    def pose(self, frame: int) -> tuple[float, float, float]:
        """x, y and heading at a frame at which the vehicle is there."""
        index = self.index(frame) or 0
        return float(self.track.x_m[index]), float(self.track.y_m[index]), float(self.track.yaw_rad[index])


@dataclass(frozen=True)
class _Sample:
    """One sample: its row without the number of the data set, and the tracks of its vehicles."""

    row: Floats
    """Vehicle, frame, x, y, speed, acceleration, lane, class, lateral, longitudinal, 39 cells; shape ``(49,)``."""
    tracks: list[Floats]
    """Target first, each of shape ``(7, K)``."""


class NgsimExporter:
    """Writes a set for each split, in both layouts."""

    def __init__(self, population: str) -> None:
        self._population = population

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:  # noqa: ARG002 - the interface of all formats
        """Writes the samples of one episode; all of its tracks are in memory."""
        record = source.record()
        roads = [_on_road(record, track) for track in tracks_of(record)]
        samples = list(self._samples(record, roads))
        rows = np.array([sample.row for sample in samples]).reshape(-1, 10 + CELLS)
        buffer = io.BytesIO()
        tracks = {f"{n:06d}_{v:03d}": t for n, sample in enumerate(samples) for v, t in enumerate(sample.tracks)}
        np.savez(buffer, rows=rows, **tracks)
        files.write("samples.npz", buffer.getvalue())
        lateral = Counter(_LATERAL[int(code)] for code in rows[:, 8].tolist())
        longitudinal = Counter(_LONGITUDINAL[int(code)] for code in rows[:, 9].tolist())
        return EpisodeReport({"samples": len(samples)}, {**lateral, **longitudinal})

    def _samples(self, record: EpisodeRecord, roads: Sequence[_RoadTrack]) -> Iterator[_Sample]:
        for target in roads:
            for first in whole_windows(target.track, _WINDOW, self._population).tolist():
                yield self._sample(record, roads, target, first + HISTORY_FRAMES)

    def _sample(self, record: EpisodeRecord, roads: Sequence[_RoadTrack], target: _RoadTrack, present: int) -> _Sample:
        now = target.index(present) or 0
        tangent = float(target.road.tangent_rad[now])
        first, last = present - HISTORY_FRAMES, present + FUTURE_FRAMES
        others = [road for road in roads if road is not target and self._counts(road, present)]
        x_m, y_m, yaw_rad = np.array([road.pose(present) for road in [target, *others]]).T
        right_m, ahead_m = across_and_ahead(x_m[1:] - x_m[0], y_m[1:] - y_m[0], tangent)
        width_m = lane_widths_m(record.network, target.road.lane[now])
        cells, tracks = np.zeros(CELLS), [_turned(target, target, now, tangent, first, last)]
        taken = neighbour_cells(right_m, ahead_m, yaw_rad[1:] - tangent, width_m)
        for other, cell in zip(others, taken.tolist(), strict=True):
            if cell != OUTSIDE:
                tracks.append(_turned(other, target, now, tangent, first, last))
                cells[cell] = len(tracks)
        target_row = tracks[0][:, HISTORY_FRAMES]
        classes = (lateral_class(target.right, now), longitudinal_class(target.travelled_ft, now))
        return _Sample(np.concatenate(([1.0], target_row, classes, cells)), tracks)

    def _counts(self, other: _RoadTrack, present: int) -> bool:
        """Whether a neighbour was there for the whole history, and in the population."""
        index = other.index(present)
        if index is None or index < HISTORY_FRAMES:
            return False
        if other.track.frame[index - HISTORY_FRAMES] != present - HISTORY_FRAMES:
            return False
        inside = other.track.in_region[index - HISTORY_FRAMES : index + 1]
        return self._population != REGION or bool(inside.all())

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Joins the samples of each split; they are in memory then."""
        for layout in ("csp", "stdan"):
            (folder / layout).mkdir()
        for split, name in _SETS.items():
            rows, tracks = _joined([part for part in parts if part.split == split])
            numbers = np.arange(1, len(rows) + 1, dtype=np.float64)[:, None]
            stdan = np.hstack((numbers, rows))
            csp = np.delete(stdan, [5, 6, 8], axis=1)
            csp[:, 7] = np.where(csp[:, 7] == BRAKE, BRAKE, NORMAL)
            (folder / "stdan" / name).write_bytes(mat_bytes({"traj": stdan, "tracks": _cells(tracks, 7)}))
            (folder / "csp" / name).write_bytes(mat_bytes({"traj": csp, "tracks": _cells(tracks, 3)}))


def _joined(parts: Sequence[EpisodePart]) -> tuple[Floats, list[list[Floats]]]:
    rows, tracks = [np.empty((0, 10 + CELLS))], []
    for part in parts:
        with np.load(part.folder / "samples.npz") as samples:
            rows.append(samples["rows"])
            grouped: dict[str, list[Floats]] = {}
            for key in sorted(samples.files):
                if key != "rows":
                    grouped.setdefault(key.split("_")[0], []).append(samples[key])
            tracks += list(grouped.values())
    return np.concatenate(rows), tracks


def _cells(tracks: list[list[Floats]], height: int) -> np.ndarray[tuple[int, int], np.dtype[np.object_]]:
    """MATLAB's cell array of tracks; vehicles that a data set does not have are empty."""
    cells = np.empty((len(tracks), max((len(row) for row in tracks), default=0)), dtype=object)
    cells.fill(np.empty((0, 0)))
    for number, row in enumerate(tracks):
        for vehicle, track in enumerate(row):
            cells[number, vehicle] = track[:height]
    return cells


def _on_road(record: EpisodeRecord, track: Track) -> _RoadTrack:
    rows = record.track(track.actor.actor_id)
    rows = rows.select(rows.step % LOG_PERIOD_STEPS == 0)
    road = road_places(record.network, rows.xy_m, rows.yaw_rad, sumo_lanes(record, rows))
    step_ft = np.hypot(np.diff(track.x_m), np.diff(track.y_m)) / FOOT_M
    right = lanes_to_the_right(record.network, road.lane, road.lane_number)
    return _RoadTrack(track, road, right, np.concatenate(([0.0], np.cumsum(step_ft))))


def _turned(road: _RoadTrack, target: _RoadTrack, now: int, tangent: float, first: int, last: int) -> Floats:
    """Frame, x, y, speed, acceleration, lane, class of a vehicle around the target's present; shape ``(7, K)``."""
    start, end = np.searchsorted(road.track.frame, [first, last + 1])
    track = road.track
    x_m, y_m = track.x_m[start:end] - target.track.x_m[now], track.y_m[start:end] - target.track.y_m[now]
    right, ahead = across_and_ahead(x_m, y_m, tangent)
    count = end - start
    return np.stack(
        (
            track.frame[start:end].astype(np.float64),
            right / FOOT_M,
            ahead / FOOT_M,
            track.speed_mps[start:end] / FOOT_M,
            track.accel_mps2[start:end] / FOOT_M,
            road.road.lane_number[start:end].astype(np.float64),
            np.full(count, float(vehicle_class(track.actor.actor_class))),
        )
    )
