"""Exports tables of trajectories: the paper's ``trajectory.csv``, and NGSIM's files that CSP, STDAN and BAT read.

``trajectory.csv`` has the paper's layout (supplement, "Data Formats and Coordinate Conventions"): one row per actor per
logged frame at 10 Hz, in CARLA's world frame: left-handed, x forward, y right, z up, yaw in degrees increasing
clockwise, so ``y = −y_map``, ``vy = −vy_map`` and ``yaw = −yaw_map``.

``traj`` has a row for each sample, ``tracks`` a cell for each data set and vehicle, shape ``(D, V)``. NGSIM's two roads
are straight with one frame each: x lateral and positive to the right, y forward. To keep what the loaders assume, each
sample is a data set of its own, turned so that the target's lane at the present, or its heading off the road, points to
+y. Vehicle 1 is the target, vehicles 2 … are its neighbours.

Columns, by ``utils.py`` of https://github.com/nachiket92/conv-social-pooling and ``loader2.py`` of
https://github.com/xbchen82/stdan:
``csp/``: data set, vehicle, frame, x, y, lane, lateral class, longitudinal class, 39 cells; tracks: frame, x, y.
``stdan/`` (BAT reads the same): data set, vehicle, frame, x, y, speed, acceleration, lane, class, lateral class,
longitudinal class, 39 cells; tracks: frame, x, y, speed, acceleration, lane, class. Feet and seconds.

Grid and manoeuvres: Deo and Trivedi 2018, ``preprocess_data.m`` of the published loaders.
"""

import io
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.io import savemat

from siren_ros.base.numerics.arrays import Floats, Ids, Rows
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.datasets.files import FileWriter, link
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.interfaces.conversions import from_actor_states, from_traffic_state
from siren_ros.data.interfaces.topics import ACTORS, TRAFFIC
from siren_ros.data.recording.bag_reader import damage_refused
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import (
    DRIVEN_KINDS,
    LOG_PERIOD_STEPS,
    REGION,
    Track,
    locate,
    sumo_lanes,
    tracks_of,
    whole_windows,
)
from siren_ros.errors import BagError
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.scenario.scenario import region_members
from siren_ros.simulation.world.actors import TWO_WHEELED, ActorClass, ActorDescription, ActorStates, Indices

CSV_COLUMNS: Final = (
    "step",
    "timestamp",
    "actor_id",
    "type_id",
    "x",
    "y",
    "z",
    "yaw",
    "vx",
    "vy",
    "speed_mps",
    "is_emv",
)
_DECIMALS: Final = 4
CSV_HEAD: Final = ",".join(CSV_COLUMNS) + "\n"
CSV_FILE: Final = "trajectory.csv"


def type_id_of(actor_class: ActorClass) -> str:
    """Type id in the form of CARLA's blueprint ids: ``vehicle.siren.ambulance``, ``walker.siren.pedestrian``.

    CARLA's ids name car models; these actors are none of them.
    """
    kind = "walker" if actor_class is ActorClass.PEDESTRIAN else "vehicle"
    return f"{kind}.siren.{actor_class.name.lower()}"


def lines_of_step(states: ActorStates, actors: Mapping[int, ActorDescription]) -> str:
    """The rows of one step. Raises BagError: an actor is not described."""
    time_s = f"{states.step * STEP_S:.2f}"
    # The angle is rounded first and then wrapped to (−180, 180], as in CARLA.
    yaw_deg = np.round(-np.degrees(states.yaw_rad), _DECIMALS)
    yaw_deg = 180.0 - np.mod(180.0 - yaw_deg, 360.0)
    columns = (states.x_m, -states.y_m, states.z_m, yaw_deg, states.vx_mps, -states.vy_mps, states.speed_mps)
    numbers = zip(*(_texts(column) for column in columns), strict=True)
    lines = []
    for actor_id, values in zip(states.actor_id.tolist(), numbers, strict=True):
        actor = actors.get(actor_id)
        if actor is None:
            raise BagError(f"step {states.step}", f"an episode that describes its actors; {actor_id} is not")
        head = (str(states.step), time_s, str(actor_id), type_id_of(actor.actor_class))
        lines.append(",".join((*head, *values, str(int(actor.is_emv)))) + "\n")
    return "".join(lines)


def _texts(column: Floats) -> list[str]:
    # Rounding can give −0.0; adding zero turns it into 0.0.
    return [f"{value:.{_DECIMALS}f}" for value in (np.round(column, _DECIMALS) + 0.0).tolist()]


class CsvExporter:
    """Writes ``trajectory.csv``; several episodes get one folder each."""

    def __init__(self, region: str) -> None:
        self._region = region == "yes"

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:  # noqa: ARG002 - the interface of all formats
        """Write row by row; only one step is in memory."""
        files.append(CSV_FILE, CSV_HEAD)
        actors: dict[int, ActorDescription] = {}
        members: Ids = np.empty(0, dtype=np.uint32)
        rows, seen = 0, set()
        for step, held in source.messages_by_step({ACTORS.name, TRAFFIC.name}):
            with damage_refused(source.path):
                if TRAFFIC.name in held:
                    spawned = from_traffic_state(held[TRAFFIC.name].read()).spawned
                    actors.update({actor.actor_id: actor for actor in spawned})
                if ACTORS.name not in held:
                    continue
                states = from_actor_states(held[ACTORS.name].read())
            if self._region:
                members = region_members(members, states, source.description.emv_ids)
                states = states.select(np.isin(states.actor_id, members))
            if step % LOG_PERIOD_STEPS == 0:
                files.append(CSV_FILE, lines_of_step(states, actors))
                rows += len(states)
                seen.update(states.actor_id.tolist())
                files.progress(step * STEP_S)
        classes = Counter(actors[actor_id].actor_class.name.lower() for actor_id in sorted(seen))
        return EpisodeReport({"rows": rows, "vehicles": len(seen)}, classes)

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Assemble one file, or one folder per episode."""
        for part in parts:
            link(part.folder / CSV_FILE, (folder if len(parts) == 1 else folder / part.episode_id) / CSV_FILE)


FOOT_M: Final = 0.3048
LANE_WIDTH_M: Final = 3.5
"""Lane width for vehicles off the road."""
_MOTORCYCLE, _CAR, _TRUCK = 1, 2, 3
_TRUCKS: Final = frozenset({ActorClass.TRUCK, ActorClass.BUS})
Numbers = npt.NDArray[np.int64]
GRID_COLUMNS: Final = 3
CELLS_ALONG: Final = 13
CELLS: Final = GRID_COLUMNS * CELLS_ALONG
_CELL_FT: Final = 15.0
_REACH_FT: Final = 90.0
OUTSIDE: Final = -1
"""Marks a vehicle outside the grid."""
LATERAL_WINDOW_FRAMES: Final = 40
"""A lane change within this many frames (4 s) before or after the present counts as a manoeuvre."""
HISTORY_FRAMES: Final = 30
FUTURE_FRAMES: Final = 50
_BRAKE: Final = 0.8
_ACCELERATE: Final = 1.25
KEEP, LEFT, RIGHT = 1, 2, 3
NORMAL, BRAKE, ACCELERATE = 1, 2, 3
_HEADER_BYTES: Final = 116
_HEADER: Final = b"MATLAB 5.0 MAT-file, written by SIREN"
"""Header of the file; scipy would write the current time here."""
_WINDOW: Final = HISTORY_FRAMES + 1 + FUTURE_FRAMES
_SETS: Final = {"train": "TrainSet.mat", "val": "ValSet.mat", "test": "TestSet.mat"}
_LATERAL: Final = {KEEP: "keep", LEFT: "left", RIGHT: "right"}
_LONGITUDINAL: Final = {NORMAL: "normal", BRAKE: "brake", ACCELERATE: "accelerate"}


def vehicle_class(actor_class: ActorClass) -> int:
    """NGSIM's class of a vehicle: 1 a motorcycle or bicycle, 2 a car, 3 a truck."""
    if actor_class in TWO_WHEELED:
        return _MOTORCYCLE
    return _TRUCK if actor_class.body in _TRUCKS else _CAR


@dataclass(frozen=True)
class RoadPlaces:
    """The place on the road of M poses; arrays of shape ``(M,)``."""

    tangent_rad: Floats
    lane_number: Numbers
    """1 for the leftmost lane of a road, growing to the right; 0 off the road."""
    lane: Indices
    """Index into ``RoadNetwork.lanes``; NO_LANE off the road."""


def road_places(network: RoadNetwork, xy_m: Floats, yaw_rad: Floats, sumo_lane: Indices) -> RoadPlaces:
    """Find the road at poses, shapes ``(M, 2)`` and ``(M,)``; where lanes overlap, SUMO's lane decides (or NO_LANE)."""
    places = locate(network, xy_m, yaw_rad, sumo_lane)
    tangent, number = yaw_rad.copy(), np.zeros(len(yaw_rad), dtype=np.int64)
    numbers = lane_numbers(network)
    for lane in np.unique(places.lane[places.lane != NO_LANE]).tolist():
        there = places.lane == lane
        tangent[there] = network.lanes[lane].centre.heading_rad(places.arc_m[there])
        number[there] = numbers[lane]
    return RoadPlaces(tangent, number, places.lane)


def lane_widths_m(network: RoadNetwork, lane: Indices) -> Floats:
    """Widths of lanes, shape ``(M,)``; NGSIM's lane width where there is no lane."""
    # NO_LANE is −1, so it selects the last width.
    return np.array([*(known.width_m for known in network.lanes), LANE_WIDTH_M])[lane]


def lane_numbers(network: RoadNetwork) -> dict[int, int]:
    """Number of each lane on its edge, from 1 at the left."""
    numbers = {}
    for edge in network.edges:
        lanes = [index for index in edge.lanes if network.lanes[index].kind in DRIVEN_KINDS]
        from_left = lanes if network.left_hand else reversed(lanes)
        numbers.update({index: number for number, index in enumerate(from_left, start=1)})
    return numbers


def lanes_to_the_right(network: RoadNetwork, lanes: Indices, numbers: Numbers) -> Numbers:
    """How many lanes a vehicle has moved to the right since the first frame of its track.

    Only changes between lanes of one edge count: where a road ends, its lanes are numbered anew.
    """
    moved = np.zeros(len(lanes), dtype=np.int64)
    for index in np.flatnonzero(np.diff(lanes)).tolist():
        before, after = int(lanes[index]), int(lanes[index + 1])
        if NO_LANE not in (before, after) and network.lanes[before].edge == network.lanes[after].edge:
            moved[index + 1] = numbers[index + 1] - numbers[index]
    return np.cumsum(moved)


def across_and_ahead(x_m: Any, y_m: Any, tangent_rad: Any) -> tuple[Any, Any]:
    """Convert offsets in the ``map`` frame to (right, ahead) relative to a direction."""
    cos, sin = np.cos(tangent_rad), np.sin(tangent_rad)
    return x_m * sin - y_m * cos, x_m * cos + y_m * sin


def from_across_and_ahead(right_m: Any, ahead_m: Any, tangent_rad: Any) -> tuple[Any, Any]:
    """Reads the message that ``across_and_ahead`` makes: offsets in the ``map`` frame."""
    cos, sin = np.cos(tangent_rad), np.sin(tangent_rad)
    return right_m * sin + ahead_m * cos, ahead_m * sin - right_m * cos


def grid_cells(lane_offset: Floats, ahead_ft: Floats) -> Rows:
    """Grid cells of neighbours, 0 to 38, or ``OUTSIDE``; all arrays of shape ``(P,)``.

    The lane's offset is −1 in the lane to the left, 0 in the target's lane and +1 in the lane to the right.
    """
    # Halves are rounded away from zero, as in the published loader.
    along = np.minimum(np.floor((ahead_ft + _REACH_FT) / _CELL_FT + 0.5), CELLS_ALONG - 1)
    outside = (np.abs(lane_offset) > 1.0) | (np.abs(ahead_ft) >= _REACH_FT) | ((lane_offset == 0.0) & (ahead_ft == 0.0))
    return np.where(outside, OUTSIDE, (lane_offset + 1.0) * CELLS_ALONG + along).astype(np.intp)


def neighbour_cells(right_m: Floats, ahead_m: Floats, turned_rad: Floats, width_m: Floats) -> Rows:
    """Grid cells of vehicles around a target, or ``OUTSIDE``, along the target's lane; all arrays of shape ``(P,)``.

    ``turned_rad`` is their heading against that lane's, ``width_m`` its width. Vehicles of another direction are no
    neighbours: NGSIM's roads have one.
    """
    cells = grid_cells(np.round(right_m / width_m), ahead_m / FOOT_M)
    return np.where(np.cos(turned_rad) > 0.0, cells, OUTSIDE)


def lateral_class(lane_number: Numbers, present: int) -> int:
    """Lateral manoeuvre around the present (an index): keep the lane, change to the left or to the right.

    Lanes are counted to the right.
    """
    first = lane_number[max(0, present - LATERAL_WINDOW_FRAMES)]
    last = lane_number[min(len(lane_number) - 1, present + LATERAL_WINDOW_FRAMES)]
    now = lane_number[present]
    if last > now or now > first:
        return RIGHT
    return LEFT if last < now or now < first else KEEP


def longitudinal_class(ahead_ft: Floats, present: int) -> int:
    """Longitudinal manoeuvre: brake, accelerate or neither, from the mean speeds of the next 5 s and the last 3 s.

    ``ahead_ft`` is the distance travelled along its track, and the present an index into it.
    """
    first, last = max(0, present - HISTORY_FRAMES), min(len(ahead_ft) - 1, present + FUTURE_FRAMES)
    if present in {first, last}:
        return NORMAL
    past = (ahead_ft[present] - ahead_ft[first]) / (present - first)
    coming = (ahead_ft[last] - ahead_ft[present]) / (last - present)
    if past < 1e-6:
        return ACCELERATE if coming > 1e-3 else NORMAL
    ratio = coming / past
    return BRAKE if ratio < _BRAKE else ACCELERATE if ratio > _ACCELERATE else NORMAL


def mat_bytes(content: dict[str, Any]) -> bytes:
    """Variables as a MATLAB 5 file."""
    buffer = io.BytesIO()
    savemat(buffer, content, do_compression=True)
    data = bytearray(buffer.getvalue())
    data[:_HEADER_BYTES] = _HEADER.ljust(_HEADER_BYTES)
    return bytes(data)


@dataclass(frozen=True)
class _RoadTrack:
    """A track with its lanes."""

    track: Track
    road: RoadPlaces
    right: Numbers
    travelled_ft: Floats

    def index(self, frame: int) -> int | None:
        """Index of a frame in the track; None where the vehicle is not present."""
        place = int(np.searchsorted(self.track.frame, frame))
        return place if place < len(self.track) and self.track.frame[place] == frame else None

    def pose(self, frame: int) -> tuple[float, float, float]:
        """x, y and heading at a frame of the track."""
        index = self.index(frame) or 0
        return float(self.track.x_m[index]), float(self.track.y_m[index]), float(self.track.yaw_rad[index])


class NgsimExporter:
    """Writes one data set per split, in both layouts."""

    def __init__(self, population: str) -> None:
        self._population = population

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:  # noqa: ARG002 - the interface of all formats
        """Write the samples of one episode; all of its tracks are in memory."""
        record = source.record()
        vehicles = (track for track in tracks_of(record) if track.actor.actor_class is not ActorClass.PEDESTRIAN)
        roads = [_on_road(record, track) for track in vehicles]
        samples = list(self._samples(record, roads))
        rows = np.array([row for row, _ in samples]).reshape(-1, 10 + CELLS)
        buffer = io.BytesIO()
        tracks = {f"{n:06d}_{v:03d}": t for n, (_, vehicles) in enumerate(samples) for v, t in enumerate(vehicles)}
        np.savez(buffer, rows=rows, **tracks)
        files.write("samples.npz", buffer.getvalue())
        lateral = Counter(_LATERAL[int(code)] for code in rows[:, 8].tolist())
        longitudinal = Counter(_LONGITUDINAL[int(code)] for code in rows[:, 9].tolist())
        return EpisodeReport({"samples": len(samples)}, {**lateral, **longitudinal})

    def _samples(self, record: EpisodeRecord, roads: Sequence[_RoadTrack]) -> Iterator[tuple[Floats, list[Floats]]]:
        """Row of each sample without the number of its data set, shape ``(49,)``, and its vehicles' tracks.

        A row holds vehicle, frame, x, y, speed, acceleration, lane, class, lateral, longitudinal and 39 cells; tracks
        have the shape ``(7, K)``, the target's first.
        """
        for target in roads:
            for first in whole_windows(target.track, _WINDOW, self._population).tolist():
                yield self._sample(record, roads, target, first + HISTORY_FRAMES)

    def _sample(
        self, record: EpisodeRecord, roads: Sequence[_RoadTrack], target: _RoadTrack, present: int
    ) -> tuple[Floats, list[Floats]]:
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
        classes = (lateral_class(target.right, now), longitudinal_class(target.travelled_ft, now))
        return np.concatenate(([1.0], tracks[0][:, HISTORY_FRAMES], classes, cells)), tracks

    def _counts(self, other: _RoadTrack, present: int) -> bool:
        """Whether a neighbour was present for the whole history and belongs to the population."""
        index = other.index(present)
        if index is None or index < HISTORY_FRAMES:
            return False
        if other.track.frame[index - HISTORY_FRAMES] != present - HISTORY_FRAMES:
            return False
        inside = other.track.in_region[index - HISTORY_FRAMES : index + 1]
        return self._population != REGION or bool(inside.all())

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Join the samples of each split, which are then in memory."""
        for layout in ("csp", "stdan"):
            (folder / layout).mkdir()
        for split, name in _SETS.items():
            rows, tracks = _joined([part for part in parts if part.subset == split])
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
    """MATLAB's cell array of tracks; cells of vehicles that a data set lacks are empty."""
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
    """Frame, x, y, speed, acceleration, lane, class of a vehicle relative to the target's present; shape ``(7, K)``."""
    start, end = np.searchsorted(road.track.frame, [first, last + 1])
    track = road.track.window(first, last + 1 - first)
    right, ahead = across_and_ahead(track.x_m - target.track.x_m[now], track.y_m - target.track.y_m[now], tangent)
    kind = np.full(len(track), vehicle_class(track.actor.actor_class))
    in_feet = (right / FOOT_M, ahead / FOOT_M, track.speed_mps / FOOT_M, track.accel_mps2 / FOOT_M)
    return np.stack((track.frame, *in_feet, road.road.lane_number[start:end], kind)).astype(np.float64)
