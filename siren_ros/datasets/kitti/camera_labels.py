"""KITTI's own labels: in the camera's frame, with the centre of the bottom face and boxes in the picture.

Source: the development kit of the object benchmark (Geiger, Lenz, Urtasun 2012), ``readme.txt``.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.datasets.kitti.calibration import KittiCamera
from siren_ros.datasets.kitti.paper_labels import number_text
from siren_ros.datasets.sources.visibility import box_corners, image_boxes, lidar_visibility
from siren_ros.numerics.arrays import Codes, Floats, Rows
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.world.actors import ActorClass
from siren_ros.world.ground_truth import GroundTruth

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
}
"""KITTI has no class for buses: its ``Misc`` is what has none."""
UNKNOWN: Final = 3
"""KITTI's occlusion state of a box that nobody could see; here: no LiDAR point lies on it."""
_FULLY_VISIBLE: Final = 0.8
_PARTLY_VISIBLE: Final = 0.4


@dataclass(frozen=True)
class CameraLabels:
    """Labels of one frame, those of vehicles in the picture; arrays of shape ``(N,)`` where nothing else is said."""

    rows: Rows
    """Rows of the ground truth."""
    actor_class: Codes
    truncated: Floats
    occluded: Codes
    """0 fully visible, 1 partly, 2 largely hidden, 3 without a LiDAR point."""
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
    """The labels of a frame.

    Args:
        truth: Boxes in the LiDAR's frame.
        points: Sweep in the same frame, with the field ``instance``.
        camera: The camera of ``image_2``.
    """
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
