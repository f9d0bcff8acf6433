"""KITTI files in the paper's layout, frame by frame (supplement, "Data Formats and Coordinate Conventions").

``velodyne/NNNNNN.bin`` holds float32 ``x y z intensity``; ``label_2/NNNNNN.txt`` holds lines
``type trunc occl alpha x1 y1 x2 y2 h w l lx ly lz heading`` in the LiDAR frame. That frame is
right-handed with y to the left: CARLA's lateral axis negated, and headings negated with it, which is
this project's own ``lidar`` frame. Box positions are volume centres. Where a front camera was recorded,
``image_2/NNNNNN.jpg`` and ``calib/NNNNNN.txt`` come with it.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from numpy.lib.recfunctions import structured_to_unstructured

from siren_ros.datasets.output_folder import new_folder
from siren_ros.errors import InputError
from siren_ros.interfaces.images import CameraIntrinsics
from siren_ros.interfaces.transforms import Transform, matrix_of_quaternion
from siren_ros.numerics.arrays import Matrix
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.numerics.units import STEP_S
from siren_ros.world.ground_truth import GroundTruth

RANGE_M: Final = 50.0
"""Objects farther from the sensor are dropped (paper: the nuScenes evaluation range)."""
OBJECT_TYPE: Final = "Car"
"""The one class of the paper's labels."""
POINT_FIELDS: Final = ("x", "y", "z", "intensity")
INDEX_FILE: Final = "frames.csv"


@dataclass(frozen=True)
class KittiCamera:
    """The camera of ``image_2``, and how it stands to the LiDAR."""

    model: CameraIntrinsics
    camera_from_lidar: Matrix
    """Points in the optical frame from points in the ``lidar`` frame, shape ``(4, 4)``."""


@dataclass(frozen=True)
class KittiFrame:
    """Everything of one frame."""

    step: int
    points: npt.NDArray[np.void]
    """Sweep with at least the fields x, y, z (metres, ``lidar`` frame) and intensity (0–1)."""
    truth: GroundTruth
    jpeg: bytes | None = None


class KittiWriter:
    """Writes frames as they come; the same frames give the same bytes, live or from a bag."""

    def __init__(self, folder: Path, camera: KittiCamera | None = None) -> None:
        """Makes the folders; raises InputError where the folder is not new or empty."""
        self.folder = new_folder(folder)
        self._camera = camera
        self._frames = 0
        names = ["velodyne", "label_2", *(["image_2", "calib"] if camera else [])]
        for name in names:
            (self.folder / name).mkdir()
        self._write(INDEX_FILE, b"frame,step,timestamp\n")

    @property
    def frames(self) -> int:
        """Number of frames written."""
        return self._frames

    def write(self, frame: KittiFrame) -> str:
        """Writes one frame and returns its number as the files carry it, ``000042``.

        Raises:
            InputError: The sweep lacks a field, or a file cannot be written.
        """
        number = f"{self._frames:06d}"
        self._write(f"velodyne/{number}.bin", velodyne_bytes(frame.points))
        self._write(f"label_2/{number}.txt", label_text(frame.truth).encode())
        if self._camera is not None and frame.jpeg is not None:
            self._write(f"image_2/{number}.jpg", frame.jpeg)
            self._write(f"calib/{number}.txt", calibration_text(self._camera).encode())
        self._frames += 1
        line = f"{number},{frame.step},{frame.step * STEP_S:.2f}\n"
        self._write(INDEX_FILE, line.encode(), mode="ab")
        return number

    def _write(self, name: str, data: bytes, mode: str = "wb") -> None:
        path = self.folder / name
        try:
            with path.open(mode) as file:
                file.write(data)
        except OSError as error:
            raise InputError("out", str(path), f"a place that can be written ({error.strerror or error})") from error


def velodyne_bytes(points: npt.NDArray[np.void]) -> bytes:
    """``x y z intensity`` of every point as little-endian float32; InputError where a field is missing."""
    names = points.dtype.names or ()
    lacking = [name for name in POINT_FIELDS if name not in names]
    if lacking:
        raise InputError("points", ", ".join(names), f"points with the fields {', '.join(POINT_FIELDS)}")
    return structured_to_unstructured(points[list(POINT_FIELDS)], dtype=np.dtype("<f4")).tobytes()


def label_text(truth: GroundTruth) -> str:
    """Label lines of all boxes within range, in the order of actor ids; empty where there are none.

    Truncation and occlusion are 0 and the image box is all zeros: these labels are the LiDAR's. ``alpha``
    is the heading as seen along the line of sight.
    """
    near = np.flatnonzero(np.hypot(truth.x_m, truth.y_m) <= RANGE_M)
    heading = wrap_angle(truth.yaw_rad)
    alpha = wrap_angle(heading - np.arctan2(truth.y_m, truth.x_m))
    lines = []
    for row in near.tolist():
        size = (truth.height_m[row], truth.width_m[row], truth.length_m[row])
        place = (truth.x_m[row], truth.y_m[row], truth.z_m[row])
        numbers = (alpha[row], 0.0, 0.0, 0.0, 0.0, *size, *place, heading[row])
        lines.append(f"{OBJECT_TYPE} 0.00 0 " + " ".join(_text(float(value), 4) for value in numbers) + "\n")
    return "".join(lines)


def calibration_text(camera: KittiCamera) -> str:
    """A KITTI calibration file: projection of the one camera, and ``Tr_velo_to_cam``."""
    projection = np.hstack((camera.model.matrix, np.zeros((3, 1))))
    lines = [f"P{index}: {_row(projection)}" for index in range(4)]
    lines.append(f"R0_rect: {_row(np.eye(3))}")
    lines.append(f"Tr_velo_to_cam: {_row(camera.camera_from_lidar[:3])}")
    lines.append(f"Tr_imu_to_velo: {_row(np.eye(4)[:3])}")
    return "\n".join(lines) + "\n"


def _row(matrix: Matrix) -> str:
    return " ".join(_text(float(value), 6) for value in matrix.reshape(-1))


def _text(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def camera_from_lidar(transforms: tuple[Transform, ...], lidar_frame: str, camera_frame: str) -> Matrix:
    """Transform between two sensors that are mounted on the same parent, shape ``(4, 4)``.

    Raises:
        InputError: A frame is not among the transforms, or the two have different parents.
    """
    by_child = {transform.child: transform for transform in transforms}
    for frame in (lidar_frame, camera_frame):
        if frame not in by_child:
            raise InputError("frame", frame, f"one of {', '.join(sorted(by_child))}")
    lidar, camera = by_child[lidar_frame], by_child[camera_frame]
    if lidar.parent != camera.parent:
        raise InputError("frame", camera.parent, f"the parent of {lidar_frame}, {lidar.parent}")
    matrix: Matrix = np.linalg.inv(_matrix(camera)) @ _matrix(lidar)
    return matrix


def _matrix(transform: Transform) -> Matrix:
    """Points in the parent from points in the child."""
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_of_quaternion(transform.rotation_xyzw)
    matrix[:3, 3] = transform.translation_m
    return matrix
