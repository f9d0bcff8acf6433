"""nuScenes' tables of one episode: categories, attributes, sensors with mounts, and rows written step by step.

The LiDAR frame of nuScenes has x to the right and y ahead. Source: https://github.com/nutonomy/nuscenes-devkit,
``docs/instructions_nuscenes.md`` and ``docs/schema_nuscenes.md``.
"""

import hashlib
import json
from collections import Counter
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Ids, Matrix
from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.datasets.files import FileWriter
from siren_ros.data.episode_source import EpisodeSource, MountedCamera
from siren_ros.data.interfaces.measurements import quaternion_of_matrix
from siren_ros.simulation.world.actors import EMERGENCY_CLASSES, FIRST_PARKED_ID, TWO_WHEELED, ActorClass, by_class
from siren_ros.simulation.world.carrier import GroundTruth

CAR: Final = "vehicle.car"
EMERGENCY: Final = "vehicle.emergency"
"""Option value that gives emergency vehicles categories of their own."""
CATEGORY_OF_CLASS: Final = by_class(
    {
        ActorClass.SEDAN: "vehicle.car",
        ActorClass.VAN: "vehicle.car",
        ActorClass.BUS: "vehicle.bus.rigid",
        ActorClass.TRUCK: "vehicle.truck",
        ActorClass.AMBULANCE: "vehicle.emergency.ambulance",
        ActorClass.FIRE_TRUCK: "vehicle.emergency.fire_truck",
        ActorClass.POLICE: "vehicle.emergency.police",
        ActorClass.MOTORCYCLE: "vehicle.motorcycle",
        ActorClass.BICYCLE: "vehicle.bicycle",
        ActorClass.PEDESTRIAN: "human.pedestrian.adult",
    }
)
"""nuScenes' category of each class; vans and pickups count as cars, and there are no fire trucks."""
ATTRIBUTES: Final = (
    "vehicle.moving",
    "vehicle.stopped",
    "vehicle.parked",
    "cycle.with_rider",
    "pedestrian.moving",
    "pedestrian.standing",
)
_PARKED: Final = ATTRIBUTES[2]
VISIBILITIES: Final = {"1": "v0-40", "2": "v40-60", "3": "v60-80", "4": "v80-100"}
_STOPPED_MPS: Final = 0.3
LIDAR: Final = "LIDAR_TOP"
NUSCENES_FROM_LIDAR: Final = np.array([[0.0, -1.0, 0, 0], [1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]])
"""Transform from the LiDAR's frame (x ahead, y left) to nuScenes' (x right, y ahead)."""
_SECTORS: Final = ((30.0, "CAM_FRONT"), (85.0, "CAM_FRONT_{side}"), (150.0, "CAM_BACK_{side}"), (181.0, "CAM_BACK"))
"""Largest angle from straight ahead in degrees, and the channel's name; nuScenes' cameras look at 0, 55, 110 and
180."""


def category_of(actor_class: ActorClass, emergency: str, others: str = "nuscenes") -> str:
    """Category of a class; emergency vehicles are ``vehicle.car``, as in the paper, unless they have their own.

    All others have nuScenes' own categories, or the paper's: ``vehicle.car``.
    """
    if actor_class in EMERGENCY_CLASSES and emergency != EMERGENCY:
        return CAR
    if actor_class not in {*EMERGENCY_CLASSES, ActorClass.PEDESTRIAN} and others == CAR:
        return CAR
    return CATEGORY_OF_CLASS[actor_class]


def attribute_of(actor_class: ActorClass, speed_mps: float) -> str:
    """Attribute of an actor: moving or not; for two-wheelers, that they have a rider."""
    if actor_class in TWO_WHEELED:
        return ATTRIBUTES[3]
    moving, standing = ATTRIBUTES[4:] if actor_class is ActorClass.PEDESTRIAN else ATTRIBUTES[:2]
    return moving if speed_mps > _STOPPED_MPS else standing


def visibility_of(fraction: float) -> str:
    """Token of the visibility level of a visible fraction."""
    return str(1 + int(np.searchsorted([0.4, 0.6, 0.8], fraction, side="right")))


def token(*parts: object) -> str:
    """A token of 32 hexadecimal digits, the same for the same parts."""
    return hashlib.md5("/".join(map(str, parts)).encode(), usedforsecurity=False).hexdigest()


def fixed_tables() -> dict[str, list[dict[str, Any]]]:
    """The tables that are the same in every dataset."""
    names = sorted(set(CATEGORY_OF_CLASS.values()))
    return {
        "category": [
            {"token": token("category", name), "name": name, "description": f"{name}, simulated", "index": index}
            for index, name in enumerate(names, start=1)
        ],
        "attribute": [
            {"token": token("attribute", name), "name": name, "description": name.replace(".", " ")}
            for name in ATTRIBUTES
        ],
        "visibility": [
            {"token": key, "level": level, "description": f"visible fraction {level[1:]} %"}
            for key, level in VISIBILITIES.items()
        ],
    }


def channels(cameras: tuple[MountedCamera, ...]) -> dict[str, str]:
    """NuScenes' channel of each camera by its name, from its viewing direction; further cameras there get a number."""
    names: dict[str, str] = {}
    for camera in cameras:
        ahead = camera.base_from_sensor[:3, 2]
        angle_deg = float(np.degrees(np.arctan2(ahead[1], ahead[0])))
        name = next(name for limit, name in _SECTORS if abs(angle_deg) < limit)
        name = name.format(side="LEFT" if angle_deg > 0.0 else "RIGHT")
        number = sum(name_taken.rstrip("_0123456789") == name for name_taken in names.values())
        names[camera.name] = name if number == 0 else f"{name}_{number + 1}"
    return names


def rotation_wxyz(matrix: Matrix) -> list[float]:
    """Rotation of a transform as nuScenes' quaternion (w, x, y, z)."""
    x, y, z, w = quaternion_of_matrix(matrix[:3, :3])
    return [w, x, y, z]


def calibrated_sensors(source: EpisodeSource, episode_id: str) -> list[dict[str, Any]]:
    """Rows of the table ``calibrated_sensor`` of one episode."""
    lidar = source.lidar
    mounts: list[tuple[str, Matrix, list[list[float]]]] = []
    if lidar is not None:
        mounts.append((LIDAR, lidar.base_from_sensor @ np.linalg.inv(NUSCENES_FROM_LIDAR), []))
    names = channels(source.cameras)
    mounts += [(names[camera.name], camera.base_from_sensor, camera.model.matrix.tolist()) for camera in source.cameras]
    return [
        {
            "token": token("calibrated_sensor", episode_id, channel),
            "sensor_token": token("sensor", channel),
            "translation": mount[:3, 3].tolist(),
            "rotation": rotation_wxyz(mount),
            "camera_intrinsic": intrinsic,
        }
        for channel, mount, intrinsic in mounts
    ]


def microseconds(step: int) -> int:
    """Simulated time of a step as nuScenes' time stamp in microseconds."""
    return time_ns_of_step(step) // 1000


class EpisodeTables:
    """Builds the tables. A row that names its successor waits until that exists."""

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
        """Add a row to a chain, and link it with the row before."""
        before = self._waiting.get((table, chain))
        if before is not None:
            before["next"], row["prev"] = row["token"], before["token"]
            self._row(table, before)
        self._waiting[table, chain] = row

    def sample(self, step: int) -> None:
        """Begin a keyframe."""
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
        """Add a sweep or a picture to the current keyframe, with the vehicle's pose in nuScenes' global frame."""
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
        """Add the boxes of the current keyframe, with visible fraction and number of points of each, shape ``(N,)``.

        nuScenes has no velocities: its devkit takes them from the boxes before and after, and gives NaN to a box
        without either, which is that of a vehicle within range at one keyframe alone. ``map_from_truth`` leads to
        nuScenes' global frame.
        """
        for row, actor_id in enumerate(truth.actor_id.tolist()):
            kind = ActorClass(int(truth.actor_class[row]))
            category = category_of(kind, *self._categories)
            self.classes[category] += 1
            centre = map_from_truth @ [truth.x_m[row], truth.y_m[row], truth.z_m[row], 1.0]
            cos, sin = np.cos(truth.yaw_rad[row]), np.sin(truth.yaw_rad[row])
            turned = map_from_truth[:3, :3] @ [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
            name = token("sample_annotation", self._id, actor_id, step)
            attribute = attribute_of(kind, float(np.hypot(truth.vx_mps[row], truth.vy_mps[row])))
            annotation = {
                "token": name,
                "sample_token": self.samples[-1],
                "instance_token": token("instance", self._id, actor_id),
                "visibility_token": visibility_of(float(visible[row])),
                "attribute_tokens": [token("attribute", _PARKED if actor_id >= FIRST_PARKED_ID else attribute)],
                "translation": centre[:3].tolist(),
                "size": [float(values[row]) for values in (truth.width_m, truth.length_m, truth.height_m)],
                "rotation": rotation_wxyz(turned),
                "prev": "",
                "next": "",
                "num_lidar_pts": int(inside[row]),
                "num_radar_pts": 0,
            }
            self._linked("sample_annotation", actor_id, annotation)
            instance = self._instances.setdefault(
                actor_id,
                {
                    "token": annotation["instance_token"],
                    "category_token": token("category", category),
                    "nbr_annotations": 0,
                    "first_annotation_token": name,
                },
            )
            instance["nbr_annotations"] += 1
            instance["last_annotation_token"] = name

    def finish(self, small: dict[str, list[dict[str, Any]]]) -> None:
        """Write the rows that still wait, the instances, and the tables that do not grow."""
        for (table, _), row in self._waiting.items():
            self._row(table, row)
        for table, rows in {**small, "instance": list(self._instances.values())}.items():
            for row in rows:
                self._row(table, row)
