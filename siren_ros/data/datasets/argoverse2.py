"""Exports Argoverse 2 motion forecasting: scenarios and the vector map.

Format: https://github.com/argoverse/av2-api, ``src/av2/map``. The map's coordinates are those of the ``map`` frame:
right-handed.
"""

import io
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from shapely.ops import unary_union

from siren_ros.base.numerics.arrays import Points
from siren_ros.data.datasets.files import FileWriter, link
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.data.datasets.lane_graph import GraphLane, driven_shapes, lane_graph, without_holes
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.tracks import FRAME_S, Track, tracks_of, whole_windows
from siren_ros.errors import InputError
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import ActorClass, by_class

_SEGMENT_POINTS: Final = 10
"""Number of points of boundaries and centre lines in Argoverse 2; longer lanes get one more every five metres."""
_SPACING_M: Final = 5.0
_SIMPLE_M: Final = 0.05
_SMALLEST_M2: Final = 0.05
STEPS: Final = 110
"""Frames of a scenario: 11 s at 10 Hz, of which 5 s are observed and 6 s are to predict."""
OBSERVED: Final = 50
FOCAL, SCORED, UNSCORED, FRAGMENT = 3, 2, 1, 0
"""Track categories of Argoverse 2: to be predicted, complete, present at the current frame, other."""
AV: Final = "AV"
"""Track id of the vehicle with the sensors."""
_TYPE_OF_CLASS: Final = by_class(
    {
        ActorClass.BUS: "bus",
        ActorClass.MOTORCYCLE: "motorcyclist",
        ActorClass.BICYCLE: "cyclist",
        ActorClass.PEDESTRIAN: "pedestrian",
    }
)
"""Object types of av2; all others are ``vehicle``."""
_MAP_FILE: Final = "log_map_archive_{}.json"
_NS_PER_S: Final = 1_000_000_000


def map_json(network: RoadNetwork) -> dict[str, Any]:
    """The archive of a map as JSON types."""
    graph = lane_graph(network)
    crossings = [(index, outline) for index, outline in enumerate(network.crossings) if len(outline) > 3]
    areas = [{"id": index, "area_boundary": _points(area)} for index, area in enumerate(drivable_areas(network, graph))]
    return {
        "pedestrian_crossings": {str(index): _crossing(index, outline) for index, outline in crossings},
        "lane_segments": {str(index): _segment(index, lane, graph) for index, lane in graph.items()},
        "drivable_areas": {str(area["id"]): area for area in areas},
    }


def _segment(index: int, lane: GraphLane, graph: dict[int, GraphLane]) -> dict[str, Any]:
    count = max(_SEGMENT_POINTS, int(lane.lane.length_m / _SPACING_M) + 1)
    left, right = lane.left_neighbour, lane.right_neighbour
    edges = ("SOLID_WHITE", "SOLID_YELLOW") if lane.left_hand else ("SOLID_YELLOW", "SOLID_WHITE")
    inside = lane.in_junction
    return {
        "id": index,
        "is_intersection": inside,
        "lane_type": "BUS" if lane.lane.kind is LaneKind.SHOULDER else "VEHICLE",
        "centerline": _points(resampled(lane.lane.centre.points, count)),
        "left_lane_boundary": _points(resampled(lane.left, count)),
        "right_lane_boundary": _points(resampled(lane.right, count)),
        "left_lane_mark_type": "NONE" if inside else edges[0] if left is None else "DASHED_WHITE",
        "right_lane_mark_type": "NONE" if inside else edges[1] if right is None else "DASHED_WHITE",
        "successors": [other for other in lane.successors if other in graph],
        "predecessors": [other for other in lane.predecessors if other in graph],
        "left_neighbor_id": left,
        "right_neighbor_id": right,
    }


def resampled(points: Points, count: int) -> Points:
    """Resample a line at equal distances; shape ``(count, 2)``."""
    step = np.hypot(*np.diff(points, axis=0).T)
    arc = np.concatenate(([0.0], np.cumsum(step)))
    places = np.linspace(0.0, arc[-1], count)
    return np.stack([np.interp(places, arc, points[:, axis]) for axis in (0, 1)], axis=-1)


def drivable_areas(network: RoadNetwork, graph: dict[int, GraphLane]) -> list[Points]:
    """Outlines of lanes and junctions as one area. Holes are left out of it, since Argoverse 2 has none."""
    shapes = [shape.buffer(_SIMPLE_M) for shape in driven_shapes(network, graph) if not shape.is_empty]
    joined = unary_union(shapes).simplify(_SIMPLE_M)
    pieces = [piece for part in getattr(joined, "geoms", [joined]) for piece in without_holes(part, _SMALLEST_M2)]
    return [np.array(piece.exterior.coords) for piece in pieces]


def _crossing(index: int, outline: Points) -> dict[str, Any]:
    """A pedestrian crossing by its two long edges, which run in the same direction."""
    a, b, c, d = outline[:4]
    edges = ((a, b), (d, c)) if np.hypot(*(b - a)) >= np.hypot(*(c - b)) else ((b, c), (a, d))
    return {"id": index, "edge1": _points(np.array(edges[0])), "edge2": _points(np.array(edges[1]))}


def _points(points: Points) -> list[dict[str, float]]:
    return [{"x": round(float(x), 3), "y": round(float(y), 3), "z": 0.0} for x, y in points]


class Argoverse2Exporter:
    """Writes one folder per scenario. The map of an episode is stored once and linked."""

    def __init__(self, population: str, stride: str) -> None:
        try:
            self._stride = int(stride)
        except ValueError:
            self._stride = 0
        if self._stride < 1:
            raise InputError("stride", stride, "a whole number of frames, 1 or more")
        self._population = population

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Write scenarios and the map; all tracks of the episode are in memory."""
        record = source.record()
        tracks = tracks_of(record)
        emv = min(record.emv_ids, default=0)
        files.write("map.json", json.dumps(map_json(record.network)).encode())
        classes: Counter[str] = Counter()
        for focal in tracks:
            for first in whole_windows(focal, STEPS, self._population)[:: self._stride].tolist():
                present = first + OBSERVED - 1
                name = scenario_id(episode_id, focal.actor.actor_id, present)
                windows = [window for track in tracks if len(window := track.window(first, STEPS))]
                table = scenario_table(windows, focal.actor.actor_id, emv, first, name, source.description.map_name)
                files.write(f"scenarios/{name}.parquet", lambda table=table: parquet_bytes(table))  # type: ignore[misc] # bound
                classes[focal.actor.actor_class.name.lower()] += 1
                files.progress(focal.actor.actor_id / max(track.actor.actor_id for track in tracks))
        return EpisodeReport({"scenarios": classes.total()}, dict(classes))

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Give each scenario its folder below its split."""
        for split in ("train", "val", "test"):
            (folder / split).mkdir()
        for part in parts:
            for path in sorted((part.folder / "scenarios").glob("*.parquet")):
                home = folder / part.subset / path.stem
                link(path, home / f"scenario_{path.name}")
                link(part.folder / "map.json", home / _MAP_FILE.format(path.stem))


def scenario_id(episode_id: str, actor_id: int, frame: int) -> str:
    """Name of a scenario, such as ``S2-L2-seed0-town-v12-f000049``; the frame is the present.

    It has no underscores, because readers split names there.
    """
    return f"{episode_id.replace('_', '-')}-v{actor_id}-f{frame:06d}"


def scenario_table(
    windows: Sequence[Track], focal_id: int, emv_id: int, first: int, name: str, city: str
) -> dict[str, Any]:
    """Columns of a scenario's file: tracks of the vehicles present at one of its frames, cut to its frames."""
    counts = [len(track) for track in windows]
    ids = [AV if track.actor.actor_id == emv_id else str(track.actor.actor_id) for track in windows]
    kinds = [_TYPE_OF_CLASS.get(track.actor.actor_class, "vehicle") for track in windows]
    categories = [_category(track, focal_id, first) for track in windows]
    timestep = np.concatenate([track.frame for track in windows]) - first
    total = len(timestep)
    start_ns = round(first * FRAME_S * _NS_PER_S)

    def joined(column: str) -> Any:
        return np.concatenate([getattr(track, column) for track in windows])

    def repeated(values: Sequence[object]) -> Any:
        return np.repeat(np.array(values, dtype=object), counts)

    return {
        "observed": timestep < OBSERVED,
        "track_id": repeated(ids),
        "object_type": repeated(kinds),
        "object_category": np.repeat(np.array(categories, dtype=np.int64), counts),
        "timestep": timestep.astype(np.int64),
        "position_x": joined("x_m"),
        "position_y": joined("y_m"),
        "heading": joined("yaw_rad"),
        "velocity_x": joined("vx_mps"),
        "velocity_y": joined("vy_mps"),
        "scenario_id": [name] * total,
        "start_timestamp": np.full(total, start_ns, dtype=np.int64),
        "end_timestamp": np.full(total, start_ns + round((STEPS - 1) * FRAME_S * _NS_PER_S), dtype=np.int64),
        "num_timestamps": np.full(total, STEPS, dtype=np.int64),
        "focal_track_id": [AV if focal_id == emv_id else str(focal_id)] * total,
        "city": [city] * total,
    }


def _category(track: Track, focal_id: int, first: int) -> int:
    if track.actor.actor_id == focal_id:
        return FOCAL
    if len(track) == STEPS:
        return SCORED
    return UNSCORED if first + OBSERVED - 1 in track.frame else FRAGMENT


def parquet_bytes(columns: dict[str, Any]) -> bytes:
    """A table's columns as a Parquet file."""
    buffer = io.BytesIO()
    pq.write_table(pa.table(columns), buffer, compression="zstd")
    return buffer.getvalue()
