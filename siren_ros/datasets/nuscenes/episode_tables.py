"""The rows of nuScenes' tables for one episode, written as they come."""

import json
from collections import Counter
from typing import Any, Final

import numpy as np

from siren_ros.datasets.exporting.file_writer import FileWriter
from siren_ros.datasets.nuscenes.rig import rotation_wxyz
from siren_ros.datasets.nuscenes.taxonomy import attribute_of, category_of, token, visibility_of
from siren_ros.numerics.arrays import Floats, Ids, Matrix
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.world.actors import ActorClass
from siren_ros.world.ground_truth import GroundTruth

LARGE_TABLES: Final = ("sample", "sample_data", "ego_pose", "sample_annotation")
"""Tables that grow with the episode: rows go to a file of JSON lines at once."""


def microseconds(step: int) -> int:
    """NuScenes' time stamps, of simulated time."""
    return time_ns_of_step(step) // 1000


class EpisodeTables:
    """Rows that name the row after them wait until it is there."""

    def __init__(self, files: FileWriter, episode_id: str, categories: tuple[str, str]) -> None:
        self._files = files
        self._id = episode_id
        self._categories = categories
        self._waiting: dict[tuple[str, object], dict[str, Any]] = {}
        self._instances: dict[int, dict[str, Any]] = {}
        self.classes: Counter[str] = Counter()
        self.samples: list[str] = []
        self.counts: Counter[str] = Counter()

    def _row(self, table: str, row: dict[str, Any]) -> None:
        self.counts[table] += 1
        self._files.append(f"tables/{table}.jsonl", json.dumps(row) + "\n")

    def _linked(self, table: str, chain: object, row: dict[str, Any]) -> None:
        """A row of a chain: the one before it now knows what comes next."""
        before = self._waiting.get((table, chain))
        if before is not None:
            before["next"], row["prev"] = row["token"], before["token"]
            self._row(table, before)
        self._waiting[table, chain] = row

    def sample(self, step: int) -> None:
        """Begins a keyframe."""
        self.samples.append(token("sample", self._id, step))
        row = {
            "token": self.samples[-1],
            "timestamp": microseconds(step),
            "prev": "",
            "next": "",
            "scene_token": token("scene", self._id),
        }
        self._linked("sample", 0, row)

    def data(
        self, channel: str, step: int, file_name: str, key: bool, size: tuple[int, int], map_from_base: Matrix
    ) -> None:
        """A sweep or a picture of the current keyframe, with the vehicle's pose in nuScenes' global frame."""
        name = token("sample_data", self._id, channel, step)
        pose = {
            "token": name,
            "timestamp": microseconds(step),
            "rotation": rotation_wxyz(map_from_base),
            "translation": map_from_base[:3, 3].tolist(),
        }
        self._row("ego_pose", pose)
        row = {
            "token": name,
            "sample_token": self.samples[-1],
            "ego_pose_token": name,
            "calibrated_sensor_token": token("calibrated_sensor", self._id, channel),
            "timestamp": microseconds(step),
            "fileformat": file_name.rsplit(".", 1)[-1].replace("bin", "pcd"),
            "is_key_frame": key,
            "width": size[0],
            "height": size[1],
            "filename": file_name,
            "prev": "",
            "next": "",
        }
        self._linked("sample_data", channel, row)

    def annotations(self, step: int, truth: GroundTruth, map_from_truth: Matrix, visible: Floats, inside: Ids) -> None:
        """The boxes of the current keyframe.

        nuScenes has no velocities: its devkit takes them from the boxes before and after, and gives NaN to a box
        without either, which is that of a vehicle within range at one keyframe alone.

        Args:
            step: Of the keyframe.
            truth: Labels.
            map_from_truth: Places in nuScenes' global frame from places in the labels' frame.
            visible: Visible fraction of each box, shape ``(N,)``.
            inside: Number of the sweep's points in each box, shape ``(N,)``.
        """
        for row, actor_id in enumerate(truth.actor_id.tolist()):
            category = category_of(ActorClass(int(truth.actor_class[row])), *self._categories)
            self.classes[category] += 1
            centre = map_from_truth @ [truth.x_m[row], truth.y_m[row], truth.z_m[row], 1.0]
            cos, sin = np.cos(truth.yaw_rad[row]), np.sin(truth.yaw_rad[row])
            turned = map_from_truth[:3, :3] @ [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
            name = token("sample_annotation", self._id, actor_id, step)
            found = {
                "token": name,
                "sample_token": self.samples[-1],
                "instance_token": token("instance", self._id, actor_id),
                "visibility_token": visibility_of(float(visible[row])),
                "attribute_tokens": [
                    token("attribute", attribute_of(float(np.hypot(truth.vx_mps[row], truth.vy_mps[row]))))
                ],
                "translation": centre[:3].tolist(),
                "size": [float(values[row]) for values in (truth.width_m, truth.length_m, truth.height_m)],
                "rotation": rotation_wxyz(turned),
                "prev": "",
                "next": "",
                "num_lidar_pts": int(inside[row]),
                "num_radar_pts": 0,
            }
            self._linked("sample_annotation", actor_id, found)
            instance = self._instances.setdefault(
                actor_id,
                {
                    "token": found["instance_token"],
                    "category_token": token("category", category),
                    "nbr_annotations": 0,
                    "first_annotation_token": name,
                },
            )
            instance["nbr_annotations"] += 1
            instance["last_annotation_token"] = name

    def finish(self, small: dict[str, list[dict[str, Any]]]) -> None:
        """Writes the rows that still wait, the instances and the tables that do not grow."""
        for (table, _), row in self._waiting.items():
            self._row(table, row)
        for table, rows in {**small, "instance": list(self._instances.values())}.items():
            for row in rows:
                self._row(table, row)
