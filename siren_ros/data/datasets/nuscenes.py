"""Exports recorded episodes as nuScenes scenes with their map.

The map is a picture of the drivable area, and the vector map (nuScenes' "map expansion", version 1.3). The picture has
0.1 m a pixel; its lower left corner is the frame's origin. ``NuScenesMap`` of ``nuscenes.map_expansion.map_api`` reads
the vector map, in which edge lines, polygons and neighbours name the same node where they meet. Source:
https://github.com/nutonomy/nuscenes-devkit, ``python-sdk/nuscenes/map_expansion``.
"""

import io
import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw
from shapely.geometry import LineString, Polygon

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.datasets.files import FileWriter, link_tree
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.data.datasets.lane_graph import GraphLane, driven_shapes, lane_graph, offset_line
from siren_ros.data.datasets.nuscenes_tables import (
    LIDAR,
    EpisodeTables,
    calibrated_sensors,
    channels,
    fixed_tables,
    token,
)
from siren_ros.data.datasets.visibility import lidar_visibility, points_in_boxes
from siren_ros.data.episode_source import EpisodeSource, LidarFrame, lidar_frames, lidar_of
from siren_ros.data.tracks import DRIVEN_KINDS
from siren_ros.errors import BagError
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork

RESOLUTION_M: Final = 0.1
_MARGIN_M: Final = 60.0
_LAYERS: Final = (
    *("node", "line", "polygon", "drivable_area", "road_segment", "road_block", "lane", "lane_connector"),
    *("ped_crossing", "walkway", "stop_line", "carpark_area", "road_divider", "lane_divider", "traffic_light"),
)
_GRID_M: Final = 0.001
"""Points nearer than this are one node."""
_STOP_LINE_M: Final = 0.5
_ARC_RADIUS_M: Final = 1000.0
"""Radius of the two arcs in an arc-line path. They have no length here, since centre lines are polylines."""
_COLOURS: Final = {"RED": 1, "YELLOW": 0, "GREEN": -1}
"""Lamp colours with their position on the light, counted from below."""
_LIGHT_M: Final = 5.0
"""Height of a light above the road."""
_POSE: Final = {"tx": 0.0, "ty": 0.0, "tz": 0.0, "rx": 0.0, "ry": 0.0, "rz": 0.0}


def map_corners(network: RoadNetwork) -> tuple[Floats, Floats]:
    """Lower left and upper right corner of a map with a margin, whole metres in the ``map`` frame, shape ``(2,)``.

    The lower left corner is the origin of nuScenes' global frame, which has no negative places.
    """
    points = np.concatenate([lane.centre.points for lane in network.lanes])
    low: Floats = np.floor(points.min(axis=0) - _MARGIN_M)
    high: Floats = np.ceil(points.max(axis=0) + _MARGIN_M)
    return low, high


def mask_png(network: RoadNetwork) -> bytes:
    """Drivable area as PNG: 255 on lanes, shoulders and junctions."""
    low, high = map_corners(network)
    width, height = np.round((high - low) / RESOLUTION_M).astype(int).tolist()
    image = Image.new("L", (width, height), 0)
    draw = ImageDraw.Draw(image)

    def pixels(xy: Floats) -> list[tuple[float, float]]:
        place = (np.asarray(xy) - low) / RESOLUTION_M
        return [(float(x), float(height - y)) for x, y in place]

    for lane in network.lanes:
        if lane.kind in DRIVEN_KINDS:
            body = LineString(lane.centre.points).buffer(lane.width_m / 2.0, cap_style="flat")
            for polygon in getattr(body, "geoms", [body]):
                if not polygon.is_empty:
                    draw.polygon(pixels(np.array(polygon.exterior.coords)), fill=255)
    for junction in network.junctions.values():
        if len(junction.outline) >= 3:
            draw.polygon(pixels(junction.outline), fill=255)
    packed = io.BytesIO()
    image.save(packed, "PNG")
    return packed.getvalue()


def map_json(network: RoadNetwork, name: str) -> bytes:
    """The file ``maps/expansion/NAME.json``, in the global frame: the ``map`` frame from ``map_corners`` on."""
    layers = _Map(network, name)
    layers.areas()
    layers.lanes()
    low, high = map_corners(network)
    tables = {**layers.tables, "arcline_path_3": layers.paths, "connectivity": layers.connectivity}
    return json.dumps({"version": "1.3", "canvas_edge": (high - low).tolist(), **tables}).encode() + b"\n"


class _Map:
    """Collects the layers of the vector map."""

    def __init__(self, network: RoadNetwork, name: str) -> None:
        self._network, self._name = network, name
        self._low, _ = map_corners(network)
        self._drivable = token(name, "drivable_area")
        self._graph = lane_graph(network)
        self._nodes: set[str] = set()
        self.tables: dict[str, list[dict[str, Any]]] = {layer: [] for layer in _LAYERS}
        self.paths: dict[str, list[dict[str, Any]]] = {}
        self.connectivity: dict[str, dict[str, list[str]]] = {}

    def _add(self, layer: str, row: dict[str, Any], *key: object) -> str:
        name = token(self._name, layer, *key)
        self.tables[layer].append({"token": name, **row})
        return name

    def _node(self, place: Points) -> str:
        x, y = (np.round((place - self._low) / _GRID_M) * _GRID_M).round(3).tolist()
        name = token(self._name, "node", x, y)
        if name not in self._nodes:
            self._nodes.add(name)
            self.tables["node"].append({"token": name, "x": x, "y": y})
        return name

    def _chain(self, places: Iterable[Points]) -> list[str]:
        """Nodes of a line, without repeated neighbours."""
        nodes = [self._node(place) for place in places]
        return [node for number, node in enumerate(nodes) if number == 0 or node != nodes[number - 1]]

    def _line(self, places: Points, *key: object) -> str:
        return self._add("line", {"node_tokens": self._chain(places)}, *key)

    def _polygon(self, outline: Points, *key: object, holes: Iterable[Points] = ()) -> str:
        rings = [{"node_tokens": self._chain(hole)} for hole in holes]
        return self._add("polygon", {"exterior_node_tokens": self._chain(outline), "holes": rings}, *key)

    def areas(self) -> None:
        """Add drivable area, junctions, crossings and sidewalks."""
        network = self._network
        area = shapely.union_all(driven_shapes(network, self._graph), grid_size=_GRID_M)
        pieces = [
            self._polygon(_ring(part.exterior), "drivable_area", number, holes=map(_ring, part.interiors))
            for number, part in enumerate(shapely.get_parts(area))
        ]
        self._add("drivable_area", {"polygon_tokens": pieces})
        junctions = {key: junction.outline for key, junction in network.junctions.items() if len(junction.outline) > 2}
        for key, outline in junctions.items():
            polygon = self._polygon(outline, "junction", key)
            row = {"polygon_token": polygon, "is_intersection": True, "drivable_area_token": self._drivable}
            self._add("road_segment", row, "junction", key)
        for number, outline in enumerate(network.crossings):
            if len(outline) > 2:
                middle = shapely.Point(outline.mean(axis=0))
                nearest = min(junctions, key=lambda key: middle.distance(Polygon(junctions[key])))
                segment = token(self._name, "road_segment", "junction", nearest)
                polygon = self._polygon(outline, "ped_crossing", number)
                self._add("ped_crossing", {"polygon_token": polygon, "road_segment_token": segment}, number)
        for lane in network.lanes:
            if lane.kind is LaneKind.SIDEWALK:
                sides = (offset_line(lane.centre.points, side * lane.width_m / 2.0) for side in (1.0, -1.0))
                polygon = self._polygon(_outline(*sides), "walkway", lane.index)
                self._add("walkway", {"polygon_token": polygon}, lane.index)

    def lanes(self) -> None:
        """Add roads, lanes and paths across junctions, the lines between them, stop lines and lights."""
        blocks: dict[int, list[GraphLane]] = {}
        for index, lane in self._graph.items():
            self._lane(index, lane)
            if not lane.in_junction:
                blocks.setdefault(lane.lane.edge, []).append(lane)
        for edge, lanes in blocks.items():
            leftmost, rightmost = (lanes[0], lanes[-1]) if lanes[0].left_hand else (lanes[-1], lanes[0])
            outline = _outline(leftmost.left, rightmost.right)
            ends = [np.array([leftmost.left[row], rightmost.right[row]]) for row in (0, -1)]
            row = {"polygon_token": self._polygon(outline, "edge", edge), "drivable_area_token": self._drivable}
            segment = self._add("road_segment", {**row, "is_intersection": False}, "edge", edge)
            edges = {
                f"{name}_edge_line_token": self._line(end, "road_block", edge, name)
                for name, end in zip(("from", "to"), ends, strict=True)
            }
            block = {"polygon_token": row["polygon_token"], **edges, "road_segment_token": segment}
            self._add("road_block", block, edge)
            divider = {"line_token": self._line(lanes[-1].inner, "road_divider", edge), "road_segment_token": segment}
            self._add("road_divider", divider, edge)
        self._lights()

    def _name_of(self, index: int) -> str:
        layer = "lane_connector" if self._graph[index].in_junction else "lane"
        return token(self._name, layer, index)

    def _lane(self, index: int, lane: GraphLane) -> None:
        polygon = self._polygon(lane.outline, "lane", index)
        if lane.in_junction:
            name = self._add("lane_connector", {"polygon_token": polygon}, index)
        else:
            ends = {
                f"{name}_edge_line_token": self._line(np.array([lane.left[row], lane.right[row]]), "lane", index, name)
                for name, row in (("from", 0), ("to", -1))
            }
            sides = {
                f"{name}_lane_divider_segments": self._divider(line, inner=neighbour is not None)
                for name, line, neighbour in (
                    ("left", lane.left, lane.left_neighbour),
                    ("right", lane.right, lane.right_neighbour),
                )
            }
            name = self._add("lane", {"polygon_token": polygon, "lane_type": "CAR", **ends, **sides}, index)
            if lane.left_neighbour is not None:
                line = self._line(lane.left, "lane_divider", index)
                row = {"line_token": line, "lane_divider_segments": sides["left_lane_divider_segments"]}
                self._add("lane_divider", row, index)
        self.paths[name] = _arc_line_path(lane.lane.centre.points - self._low)
        self.connectivity[name] = {
            "incoming": [self._name_of(other) for other in lane.predecessors],
            "outgoing": [self._name_of(other) for other in lane.successors],
        }

    def _divider(self, line: Points, *, inner: bool) -> list[dict[str, str]]:
        kind = "SINGLE_SOLID_WHITE" if not inner else "DOUBLE_DASHED_WHITE"
        return [{"node_token": node, "segment_type": kind} for node in self._chain(line)]

    def _lights(self) -> None:
        """Add a stop line with its lights at the end of each lane that has a signal or must stop."""
        behind: dict[int, list[Any]] = {}
        for connection in self._network.connections:
            lane = self._graph.get(connection.from_lane)
            if lane is not None and not lane.in_junction and connection.has_stop_line:
                behind.setdefault(connection.from_lane, []).append(connection)
        for index, connections in behind.items():
            lane = self._graph[index]
            block = token(self._name, "road_block", lane.lane.edge)
            lights = []
            if connections[0].signal_id is not None:
                end = np.array([lane.left[-1], lane.right[-1]])
                x, y = (end.mean(axis=0) - self._low).tolist()
                heading = float(lane.lane.centre.heading_rad(lane.lane.length_m))
                blocks = sorted({self._network.lanes[connection.to_lane].edge for connection in connections})
                targets = [token(self._name, "road_block", edge) for edge in blocks]
                bulbs = [(colour, _POSE | {"tz": 0.3 * place}) for colour, place in _COLOURS.items()]
                items = [
                    {"color": colour, "shape": "CIRCLE", "rel_pos": pose, "to_road_block_tokens": targets}
                    for colour, pose in bulbs
                ]
                row = {
                    "line_token": self._line(end, "traffic_light", index),
                    "traffic_light_type": "VERTICAL",
                    "from_road_block_token": block,
                    "items": items,
                    "pose": _POSE | {"tx": x, "ty": y, "tz": _LIGHT_M, "rz": heading},
                }
                lights.append(self._add("traffic_light", row, index))
            length_m = lane.lane.length_m
            last, before = lane.lane.centre.at(np.array([length_m, max(length_m - _STOP_LINE_M, 0.0)]))
            along = last - before
            corners = np.array([lane.left[-1], lane.left[-1] - along, lane.right[-1] - along, lane.right[-1]])
            row = {
                "polygon_token": self._polygon(corners, "stop_line", index),
                "stop_line_type": "TRAFFIC_LIGHT" if lights else "STOP_SIGN",
                "ped_crossing_tokens": [],
                "traffic_light_tokens": lights,
                "road_block_token": block,
            }
            self._add("stop_line", row, index)


def _outline(left: Points, right: Points) -> Points:
    outline: Points = np.concatenate((left, right[::-1]))
    return outline


def _ring(ring: shapely.LinearRing) -> Points:
    """Corners of a ring without the repeated last one."""
    corners: Points = shapely.get_coordinates(ring)[:-1]
    return corners


def _arc_line_path(centre: Floats) -> list[dict[str, Any]]:
    """Arc-line path of a centre line: one straight piece per segment."""
    pieces = []
    for start, end in pairwise(centre):
        length_m, yaw = float(np.hypot(*(end - start))), float(np.arctan2(*(end - start)[::-1]))
        if length_m > _GRID_M:
            poses = {"start_pose": [*start.tolist(), yaw], "end_pose": [*end.tolist(), yaw]}
            pieces.append({**poses, "shape": "LSR", "radius": _ARC_RADIUS_M, "segment_length": [0.0, length_m, 0.0]})
    return pieces


VERSION: Final = "v1.0-siren"
KEYFRAME_STEPS: Final = 10
"""Steps between keyframes, which nuScenes has at 2 Hz."""
_TABLES: Final = (
    "sample",
    "sample_data",
    "ego_pose",
    "sample_annotation",
    "instance",
    "scene",
    "log",
    "calibrated_sensor",
)
_INTENSITY: Final = 255.0
_SPLIT: Final = "siren_{split}"
"""Name of a split; the devkit reserves ``train``, ``val`` and ``test`` for nuScenes' own scenes."""


class NuscenesExporter:
    """Writes one scene per episode: keyframes at 2 Hz, with every sweep and every picture."""

    def __init__(self, emv_category: str, vehicle_category: str) -> None:
        self._categories = (emv_category, vehicle_category)

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Write the files and the rows."""
        lidar, names = lidar_of(source), channels(source.cameras)
        models = {camera.name: camera.model for camera in source.cameras}
        low, _ = map_corners(source.network)
        tables = EpisodeTables(files, episode_id, self._categories)
        for frame in lidar_frames(source, cameras=source.cameras, pose=True):
            if frame.map_from_base is None:
                raise BagError(str(source.path), "an episode with the EMV's odometry")
            pose = frame.map_from_base.copy()
            pose[:2, 3] -= low
            key = frame.step % KEYFRAME_STEPS == 0 and frame.points is not None and frame.truth is not None
            if key:
                tables.sample(frame.step)
            if not tables.samples:
                continue
            kind = "samples" if key else "sweeps"
            if frame.points is not None:
                name = f"{kind}/{LIDAR}/{episode_id}__{LIDAR}__{frame.step:08d}.pcd.bin"
                files.write(name, sweep_bytes(frame.points))
                tables.data(LIDAR, frame.step, name, key, (0, 0), pose)
            for camera, jpeg in frame.jpegs.items():
                channel = names[camera]
                name = f"{kind}/{channel}/{episode_id}__{channel}__{frame.step:08d}.jpg"
                files.write(name, jpeg)
                tables.data(channel, frame.step, name, key, (models[camera].width, models[camera].height), pose)
            if key and frame.truth is not None and frame.points is not None:
                place, inside = pose @ lidar.base_from_sensor, points_in_boxes(frame.points, frame.truth)
                tables.annotations(frame.step, frame.truth, place, visible_fractions(frame), inside)
            files.progress(frame.step * STEP_S)
        if not tables.samples:
            raise BagError(str(source.path), "an episode with at least one sweep with its ground truth")
        map_name = f"maps/{token('map', source.description.map_sha256)}.png"
        files.write(map_name, mask_png(source.network))
        files.write(f"maps/expansion/{source.map_label}.json", map_json(source.network, source.map_label))
        tables.finish(self._small_tables(source, episode_id, tables.samples, low, map_name))
        counts = {name: tables.counts[table] for name, table in (("keyframes", "sample"), ("files", "sample_data"))}
        return EpisodeReport({**counts, "labels": tables.classes.total()}, dict(tables.classes))

    def _small_tables(
        self, source: EpisodeSource, episode_id: str, samples: list[str], low: Floats, map_name: str
    ) -> dict[str, list[dict[str, Any]]]:
        description = source.description
        request = f"template {description.template}, level {description.level.name}, seed {description.seed}"
        scene = {
            "token": token("scene", episode_id),
            "name": episode_id,
            "description": f"{request}; global frame = map frame − ({low[0]:.0f}, {low[1]:.0f}) m",
            "log_token": token("log", episode_id),
            "nbr_samples": len(samples),
            "first_sample_token": samples[0],
            "last_sample_token": samples[-1],
        }
        log = {
            "token": token("log", episode_id),
            "logfile": episode_id,
            "vehicle": "emv",
            "date_captured": "1970-01-01",
            "location": source.map_label,
            "map_file": map_name,
        }
        return {"scene": [scene], "log": [log], "calibrated_sensor": calibrated_sensors(source, episode_id)}

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Join the tables of all episodes."""
        home = folder / VERSION
        home.mkdir()
        for part in parts:
            for kind in ("samples", "sweeps", "maps"):
                link_tree(part.folder / kind, folder / kind)
        for table in _TABLES:
            _write_table(home / f"{table}.json", _rows(parts, table))
        for table, rows in fixed_tables().items():
            _write_table(home / f"{table}.json", iter(rows))
        logs = list(_rows(parts, "log"))
        maps = [
            {
                "token": token("map", name),
                "category": "semantic_prior",
                "filename": name,
                "log_tokens": [log["token"] for log in logs if log["map_file"] == name],
            }
            for name in sorted({log["map_file"] for log in logs})
        ]
        _write_table(home / "map.json", iter(maps))
        _write_table(home / "sensor.json", iter(_sensors(folder)))
        splits = {
            _SPLIT.format(split=split): [part.episode_id for part in parts if part.subset == split]
            for split in ("train", "val", "test")
        }
        (home / "splits.json").write_text(json.dumps(splits, indent=2) + "\n", encoding="utf-8")


def visible_fractions(frame: LidarFrame) -> Floats:
    """Visible fraction of each box: the largest of all cameras with image labels, or else that of the LiDAR."""
    truth, points = frame.truth, frame.points
    if truth is None or points is None:
        return np.zeros(0)
    if not frame.image_truths:
        return lidar_visibility(points, truth, np.arange(len(truth)))
    seen = np.zeros(len(truth))
    for labels in frame.image_truths.values():
        shown = labels.visible_fraction * (1.0 - labels.truncation)
        share = dict(zip(labels.actor_id.tolist(), shown.tolist(), strict=True))
        seen = np.maximum(seen, [share.get(actor_id, 0.0) for actor_id in truth.actor_id.tolist()])
    return seen


def sweep_bytes(points: npt.NDArray[np.void]) -> bytes:
    """Points as float32 x, y, z, intensity (0–255), ring, with x to the right and y ahead."""
    rows = np.empty((len(points), 5), dtype="<f4")
    rows[:, 0], rows[:, 1] = -points["y"], points["x"]
    rows[:, 2], rows[:, 3], rows[:, 4] = points["z"], points["intensity"] * _INTENSITY, points["ring"]
    return rows.tobytes()


def _rows(parts: Sequence[EpisodePart], table: str) -> Iterator[dict[str, Any]]:
    for part in parts:
        file = part.folder / "tables" / f"{table}.jsonl"
        if file.exists():
            with file.open(encoding="utf-8") as lines:
                yield from map(json.loads, lines)


def _write_table(path: Path, rows: Iterator[dict[str, Any]]) -> None:
    with path.open("w", encoding="utf-8") as file:
        file.write("[")
        for number, row in enumerate(rows):
            file.write(",\n" if number else "\n")
            file.write(json.dumps(row))
        file.write("\n]\n")


def _sensors(folder: Path) -> list[dict[str, Any]]:
    names = sorted({path.name for kind in ("samples", "sweeps") for path in (folder / kind).iterdir()})
    return [
        {"token": token("sensor", name), "channel": name, "modality": "lidar" if name == LIDAR else "camera"}
        for name in names
    ]
