"""Exports ScenarioNet databases: tracks, map features and dynamic map states, as Python and numpy objects.

Format: https://github.com/metadriverse/metadrive, ``metadrive/scenario/scenario_description.py``.
"""

import pickle
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Points
from siren_ros.data.datasets.files import FileWriter, link
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.data.datasets.lane_graph import lane_graph
from siren_ros.data.record.episode_source import EpisodeSource
from siren_ros.data.record.tracks import FRAME_S, LOG_PERIOD_STEPS, Track, tracks_of
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import TWO_WHEELED, ActorClass

VERSION: Final = "1.0"
VEHICLE: Final = "VEHICLE"
PEDESTRIAN: Final = "PEDESTRIAN"
CYCLIST: Final = "CYCLIST"
"""ScenarioNet's type for riders of two-wheelers."""
_LIGHT: Final = {
    "r": "LANE_STATE_STOP",
    "u": "LANE_STATE_STOP",
    "y": "LANE_STATE_CAUTION",
    "g": "LANE_STATE_GO",
    "s": "LANE_STATE_ARROW_GO",
    "o": "LANE_STATE_FLASHING_CAUTION",
}
"""ScenarioNet's state for each of SUMO's letters, in either case."""
_FILE: Final = "sd_siren_1.0_{}.pkl"
"""File name of a scenario. MetaDrive expects the prefix ``sd_`` and the scenario's id at the end."""
_SUMMARY: Final = "dataset_summary.pkl"
_MAPPING: Final = "dataset_mapping.pkl"
_PROTOCOL: Final = 4


def description(record: EpisodeRecord, tracks: Sequence[Track], scenario_id: str, emv_id: int) -> dict[str, Any]:
    """The scenario description; MetaDrive's agent drives the vehicle ``emv_id``."""
    length = max(int(track.frame[-1]) for track in tracks) + 1
    request = record.description
    return {
        "id": scenario_id,
        "version": VERSION,
        "length": length,
        "tracks": {str(track.actor.actor_id): _track(track, length) for track in tracks},
        "dynamic_map_states": _lights(record, length),
        "map_features": map_features(record.network),
        "metadata": {
            "dataset": "siren",
            "scenario_id": scenario_id,
            "coordinate": "right-handed",
            "metadrive_processed": False,
            "sdc_id": str(emv_id),
            "ts": np.arange(length) * FRAME_S,
            "sample_rate": FRAME_S,
            "map": request.map_name,
            "template": request.template,
            "level": request.level.name,
            "seed": request.seed,
        },
    }


def _track(track: Track, length: int) -> dict[str, Any]:
    """Arrays of a track over the whole scenario; 0 where the vehicle is not present."""

    def spread(values: npt.ArrayLike, dtype: type = np.float32) -> Any:
        column = np.asarray(values)
        whole: npt.NDArray[Any] = np.zeros((length, *column.shape[1:]), dtype=dtype)
        whole[track.frame] = column
        return whole

    actor, there = track.actor, np.ones(len(track))
    state = {
        "position": spread(np.stack((track.x_m, track.y_m, track.z_m), axis=-1)),
        "heading": spread(track.yaw_rad),
        "velocity": spread(np.stack((track.vx_mps, track.vy_mps), axis=-1)),
        "length": spread(there * actor.length_m),
        "width": spread(there * actor.width_m),
        "height": spread(there * actor.height_m),
        "valid": spread(there, np.bool_),
    }
    name = str(actor.actor_id)
    ridden, walks = actor.actor_class in TWO_WHEELED, actor.actor_class is ActorClass.PEDESTRIAN
    kind = PEDESTRIAN if walks else CYCLIST if ridden else VEHICLE
    metadata = {
        "type": kind,
        "track_length": length,
        "object_id": name,
        "class": actor.actor_class.name.lower(),
        "is_emv": actor.is_emv,
    }
    return {"type": kind, "state": state, "metadata": metadata}


def _lights(record: EpisodeRecord, length: int) -> dict[str, Any]:
    """States of the lights over time, one light per lane that a signal controls."""
    letters: dict[int, list[str]] = {}
    for traffic in record.traffic:
        frame, odd = divmod(traffic.step, LOG_PERIOD_STEPS)
        if odd or frame >= length:
            continue
        states = {signal.signal_id: signal.state for signal in traffic.signals}
        for connection in record.network.connections:
            state = states.get(str(connection.signal_id), "")
            if connection.signal_link < len(state) and connection.signal_link >= 0:
                seen = letters.setdefault(connection.from_lane, [""] * length)
                # A lane shows the most permissive state among its movements.
                seen[frame] = max(seen[frame], state[connection.signal_link].lower(), key="ouryg".find)
    lights = {}
    for lane, seen in letters.items():
        name, stop = str(lane), record.network.lanes[lane].centre.points[-1]
        lights[name] = {
            "type": "TRAFFIC_LIGHT",
            "state": {"object_state": [_LIGHT.get(letter, "LANE_STATE_UNKNOWN") for letter in seen]},
            "lane": name,
            "stop_point": np.array([*stop, 0.0], dtype=np.float32),
            "metadata": {"type": "TRAFFIC_LIGHT", "track_length": length, "object_id": name, "dataset": "siren"},
        }
    return lights


def map_features(network: RoadNetwork) -> dict[str, Any]:
    """Map features: lanes with their areas, the lines between and beside them, crossings."""
    graph = lane_graph(network)
    features: dict[str, Any] = {}
    for index, lane in graph.items():
        left, right = lane.left_neighbour, lane.right_neighbour
        features[str(index)] = {
            "type": "LANE_SURFACE_UNSTRUCTURE" if lane.in_junction else "LANE_SURFACE_STREET",
            "polyline": _with_height(lane.lane.centre.points),
            "polygon": lane.outline.astype(np.float32),
            "entry_lanes": [str(other) for other in lane.predecessors],
            "exit_lanes": [str(other) for other in lane.successors],
            "left_neighbor": [] if left is None else [str(left)],
            "right_neighbor": [] if right is None else [str(right)],
            "speed_limit_kmh": lane.lane.speed_limit_mps * 3.6,
        }
        if lane.in_junction:
            continue
        sides = [("left", left, lane.left), ("right", right, lane.right)]
        (inner, next_inner, inner_line), (outer, next_outer, outer_line) = sides[::-1] if lane.left_hand else sides
        drawn = "ROAD_LINE_SOLID_SINGLE_YELLOW" if next_inner is None else "ROAD_LINE_BROKEN_SINGLE_WHITE"
        features[f"{index}_{inner}"] = {"type": drawn, "polyline": _with_height(inner_line)}
        if next_outer is None:
            features[f"{index}_{outer}"] = {"type": "ROAD_EDGE_BOUNDARY", "polyline": _with_height(outer_line)}
    for number, outline in enumerate(network.crossings):
        features[f"crossing_{number}"] = {"type": "CROSSWALK", "polygon": outline.astype(np.float32)}
    return features


def _with_height(points: Points) -> npt.NDArray[np.float32]:
    return np.hstack((points, np.zeros((len(points), 1)))).astype(np.float32)


def summary_of(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """Entry of a scenario in the dataset's summary: plain numbers and text."""
    tracks = scenario["tracks"]
    objects = {}
    for name, track in tracks.items():
        valid = track["state"]["valid"]
        moved = float(np.hypot(*np.diff(track["state"]["position"][valid, :2], axis=0).T).sum())
        count = int(valid.sum())
        lengths = {"moving_distance": moved, "valid_length": count, "continuous_valid_length": count}
        objects[name] = {"type": track["type"], "object_id": name, "track_length": scenario["length"], **lengths}
    kinds = Counter(summary["type"] for summary in objects.values())
    moving = Counter(summary["type"] for summary in objects.values() if summary["moving_distance"] > 1.0)
    metadata = {key: value for key, value in scenario["metadata"].items() if key != "ts"}
    return {
        **metadata,
        "ts": scenario["metadata"]["ts"].tolist(),
        "object_summary": objects,
        "number_summary": {
            "num_objects": len(tracks),
            "object_types": [*kinds],
            "num_objects_each_type": dict(kinds),
            "num_moving_objects": moving.total(),
            "num_moving_objects_each_type": {kind: moving[kind] for kind in kinds},
            "num_traffic_lights": len(scenario["dynamic_map_states"]),
            "num_map_features": len(scenario["map_features"]),
            "map_height_diff": 0.0,
        },
    }


class ScenarioNetExporter:
    """Writes one pickled description per episode, and one database per split."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Write the description; all tracks of the episode are in memory."""
        record = source.record()
        tracks = [track for track in tracks_of(record) if len(track) > 1]
        scenario = description(record, tracks, episode_id, min(record.emv_ids))
        files.write(_FILE.format(episode_id), pickle.dumps(scenario, _PROTOCOL))
        files.write("summary.pkl", pickle.dumps(summary_of(scenario), _PROTOCOL))
        classes = Counter(track.actor.actor_class.name.lower() for track in tracks)
        return EpisodeReport({"scenarios": 1, "tracks": len(tracks)}, dict(classes))

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Write the summary and the mapping of each split."""
        for split in sorted({part.subset for part in parts}):
            summary: dict[str, Any] = {}
            for part in [part for part in parts if part.subset == split]:
                name = _FILE.format(part.episode_id)
                link(part.folder / name, folder / split / name)
                summary[name] = pickle.loads((part.folder / "summary.pkl").read_bytes())  # noqa: S301 - written by this export
            (folder / split / _SUMMARY).write_bytes(pickle.dumps(summary, _PROTOCOL))
            (folder / split / _MAPPING).write_bytes(pickle.dumps(dict.fromkeys(summary, ""), _PROTOCOL))
