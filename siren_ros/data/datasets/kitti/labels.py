"""Makes KITTI's calibration file, KITTI's labels and the paper's labels.

KITTI's labels are in the camera's frame, with the centre of the bottom face and boxes in the picture. Source: the
development kit of the object benchmark (Geiger, Lenz, Urtasun 2012), ``readme.txt``.

The paper's label lines (supplement, "Data Formats and Coordinate Conventions") are
``type trunc occl alpha x1 y1 x2 y2 h w l lx ly lz heading`` in the LiDAR frame. That frame is right-handed with y to
the left: CARLA's lateral axis and headings are negated, which gives this project's own ``lidar`` frame. Positions are
volume centres. The words are KITTI's but their meaning is not: a KITTI reader takes these positions for positions in
the camera's frame.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Floats, Matrix, Rows
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.data.datasets.files import number_text
from siren_ros.data.datasets.visibility import box_corners, image_boxes, lidar_visibility
from siren_ros.data.interfaces.transforms import Transform, matrix_of_transform
from siren_ros.errors import InputError
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import GroundTruth
from siren_ros.simulation.world.measurements import CameraIntrinsics

RANGE_M: Final = 50.0
"""Objects farther from the sensor are dropped (paper: the nuScenes evaluation range)."""
OBJECT_TYPE: Final = "Car"
"""The only class of the paper's labels."""
PAPER_README: Final = """# The paper's layout, which is not KITTI's

`velodyne/NNNNNN.bin` holds float32 `x y z intensity` in the LiDAR frame (x forward, y left, z up).
`label_2/NNNNNN.txt` holds lines `type trunc occl alpha x1 y1 x2 y2 h w l lx ly lz heading` **in the LiDAR frame**:
metres, volume centre, heading counter-clockwise from the x axis. Truncation, occlusion and the image box are 0. Every
vehicle is a `Car`, the emergency vehicle too; vehicles beyond 50 m are left out.

A KITTI reader opens these files without an error and puts every box in a wrong place, because KITTI's labels are in
the camera's frame with the centre of the bottom face. `siren export kitti` without `--layout paper` writes what such
a reader expects, with these lines in `label_lidar/`.
"""
TYPE_OF_CLASS: Final = {
    ActorClass.HATCHBACK: "Car",
    ActorClass.SEDAN: "Car",
    ActorClass.ESTATE: "Car",
    ActorClass.SUV: "Car",
    ActorClass.PICKUP: "Car",
    ActorClass.POLICE: "Car",
    ActorClass.VAN: "Van",
    ActorClass.AMBULANCE: "Van",
    ActorClass.TRUCK: "Truck",
    ActorClass.FIRE_TRUCK: "Truck",
    ActorClass.BUS: "Misc",
    ActorClass.MOTORCYCLE: "Misc",
    ActorClass.BICYCLE: "Cyclist",
    ActorClass.PEDESTRIAN: "Pedestrian",
}
"""KITTI's type for each class; KITTI has no type for buses and motorcycles, so they become ``Misc``."""
UNKNOWN: Final = 3
"""KITTI's occlusion state "unknown": here, no LiDAR point lies on the vehicle."""
_FULLY_VISIBLE: Final = 0.8
_PARTLY_VISIBLE: Final = 0.4


def label_text(truth: GroundTruth) -> str:
    """The paper's label lines of all vehicles within range, in the order of actor ids; empty without vehicles.

    Truncation and occlusion are 0 and the image box is all zeros: these labels are the LiDAR's. ``alpha``
    is the heading as seen along the line of sight.
    """
    vehicles = truth.actor_class != ActorClass.PEDESTRIAN
    near = np.flatnonzero(vehicles & (np.hypot(truth.x_m, truth.y_m) <= RANGE_M))
    heading = wrap_angle(truth.yaw_rad)
    alpha = wrap_angle(heading - np.arctan2(truth.y_m, truth.x_m))
    lines = []
    for row in near.tolist():
        size = (truth.height_m[row], truth.width_m[row], truth.length_m[row])
        place = (truth.x_m[row], truth.y_m[row], truth.z_m[row])
        numbers = (alpha[row], 0.0, 0.0, 0.0, 0.0, *size, *place, heading[row])
        lines.append(f"{OBJECT_TYPE} 0.00 0 " + " ".join(number_text(float(value), 4) for value in numbers) + "\n")
    return "".join(lines)


@dataclass(frozen=True)
class KittiCamera:
    """The camera of ``image_2``, with its pose relative to the LiDAR."""

    model: CameraIntrinsics
    camera_from_lidar: Matrix
    """Transform from the ``lidar`` frame to the camera's optical frame, shape ``(4, 4)``."""


def calibration_text(camera: KittiCamera) -> str:
    """A calibration file: one camera takes the place of all four, without rectification."""
    projection = np.hstack((camera.model.matrix, np.zeros((3, 1))))
    lines = [f"P{index}: {_row(projection)}" for index in range(4)]
    lines.append(f"R0_rect: {_row(np.eye(3))}")
    lines.append(f"Tr_velo_to_cam: {_row(camera.camera_from_lidar[:3])}")
    lines.append(f"Tr_imu_to_velo: {_row(np.eye(4)[:3])}")
    return "\n".join(lines) + "\n"


def _row(matrix: Matrix) -> str:
    return " ".join(number_text(float(value), 8) for value in matrix.reshape(-1))


def camera_from_lidar(transforms: tuple[Transform, ...], lidar_frame: str, camera_frame: str) -> Matrix:
    """Transform between two sensors that are mounted on the same parent, shape ``(4, 4)``.

    Raises InputError: a frame is not among the transforms, or the two have different parents.
    """
    by_child = {transform.child: transform for transform in transforms}
    for frame in (lidar_frame, camera_frame):
        if frame not in by_child:
            raise InputError("frame", frame, f"one of {', '.join(sorted(by_child))}")
    lidar, camera = by_child[lidar_frame], by_child[camera_frame]
    if lidar.parent != camera.parent:
        raise InputError("frame", camera.parent, f"the parent of {lidar_frame}, {lidar.parent}")
    matrix: Matrix = np.linalg.inv(matrix_of_transform(camera)) @ matrix_of_transform(lidar)
    return matrix


@dataclass(frozen=True)
class CameraLabels:
    """KITTI labels of the vehicles in the picture of one frame; arrays have shape ``(N,)`` unless stated otherwise."""

    rows: Rows
    """Rows of the ground truth."""
    actor_class: Codes
    truncated: Floats
    occluded: Codes
    """Occlusion: 0 fully visible, 1 partly, 2 largely hidden, 3 without a LiDAR point."""
    box_px: Floats
    """Left, top, right, bottom in the picture, shape ``(N, 4)``."""
    size_m: Floats
    """Height, width, length, shape ``(N, 3)``."""
    bottom_m: Floats
    """Centre of the bottom face in the camera's frame, shape ``(N, 3)``."""
    rotation_rad: Floats
    """``rotation_y``: around the camera's y axis, 0 towards its x axis."""
    visible: Floats
    """Share of the box that the LiDAR sees."""

    def __len__(self) -> int:
        return len(self.rows)

    def types(self) -> list[str]:
        """KITTI's names of the classes."""
        return [TYPE_OF_CLASS[ActorClass(code)] for code in self.actor_class.tolist()]


def camera_labels(truth: GroundTruth, points: npt.NDArray[np.void], camera: KittiCamera) -> CameraLabels:
    """KITTI labels of a frame; boxes and points (with the field ``instance``) are in the LiDAR's frame."""
    corners = box_corners(truth)
    boxes, truncated = image_boxes(corners, camera.camera_from_lidar, camera.model)
    rows = np.flatnonzero(truncated < 1.0)
    visible = lidar_visibility(points, truth, rows)
    occluded = np.select([visible >= _FULLY_VISIBLE, visible >= _PARTLY_VISIBLE, visible > 0.0], [0, 1, 2], UNKNOWN)
    rotation, shift = camera.camera_from_lidar[:3, :3], camera.camera_from_lidar[:3, 3]
    bottom = corners[rows, :4].mean(axis=1) @ rotation.T + shift
    yaw = truth.yaw_rad[rows]
    ahead = np.stack((np.cos(yaw), np.sin(yaw), np.zeros(len(rows))), axis=-1) @ rotation.T
    return CameraLabels(
        rows=rows,
        actor_class=truth.actor_class[rows],
        truncated=truncated[rows],
        occluded=occluded.astype(np.uint8),
        box_px=boxes[rows],
        size_m=np.stack((truth.height_m, truth.width_m, truth.length_m), axis=-1)[rows],
        bottom_m=bottom,
        rotation_rad=wrap_angle(np.arctan2(-ahead[:, 2], ahead[:, 0])),
        visible=visible,
    )


def label_lines(labels: CameraLabels) -> str:
    """Lines of a file of ``label_2``, in the order of actor ids."""
    alpha = wrap_angle(labels.rotation_rad - np.arctan2(labels.bottom_m[:, 0], labels.bottom_m[:, 2]))
    lines = []
    for row, kind in enumerate(labels.types()):
        box = " ".join(number_text(value, 2) for value in labels.box_px[row].tolist())
        numbers = (*labels.size_m[row].tolist(), *labels.bottom_m[row].tolist(), float(labels.rotation_rad[row]))
        rest = " ".join(number_text(value, 4) for value in numbers)
        truncated, turned = number_text(float(labels.truncated[row]), 2), number_text(float(alpha[row]), 4)
        lines.append(f"{kind} {truncated} {labels.occluded[row]} {turned} {box} {rest}\n")
    return "".join(lines)
