"""Exports recorded episodes as nuScenes scenes."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.datasets.files import FileWriter, link_tree
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.data.datasets.nuscenes.episode_tables import (
    LIDAR,
    EpisodeTables,
    calibrated_sensors,
    channels,
    fixed_tables,
    token,
)
from siren_ros.data.datasets.nuscenes.map_expansion import map_corners, map_json, mask_png
from siren_ros.data.datasets.visibility import lidar_visibility, points_in_boxes
from siren_ros.data.record.episode_source import EpisodeSource, LidarFrame, lidar_frames, lidar_of
from siren_ros.errors import BagError

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
