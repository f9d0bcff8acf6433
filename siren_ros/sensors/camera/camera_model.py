"""The pinhole camera (intrinsics, projection, the matrix for OpenGL), and a drawn picture."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats, Matrix
from siren_ros.sensors.suite import OPTICAL_FROM_BODY, CameraSpec, inverse, transform


@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera with square pixels and no distortion.

    Image coordinates are those of sensor_msgs/CameraInfo and OpenCV: (0, 0) is the *centre* of the top left pixel, so
    the picture spans −0.5 … width − 0.5 and the principal point is ((width − 1) / 2, (height − 1) / 2).
    """

    width: int
    height: int
    focal_px: float

    @classmethod
    def of(cls, spec: CameraSpec) -> "Pinhole":
        """The camera of a suite: the horizontal field of view spans the picture's outer edges."""
        return cls(spec.width, spec.height, spec.width / 2.0 / float(np.tan(spec.horizontal_fov_rad / 2.0)))

    @property
    def k(self) -> Matrix:
        """Intrinsic matrix, shape ``(3, 3)``."""
        centre_u, centre_v = (self.width - 1) / 2.0, (self.height - 1) / 2.0
        return np.array([[self.focal_px, 0.0, centre_u], [0.0, self.focal_px, centre_v], [0.0, 0.0, 1.0]])

    def project(self, points_optical: Floats) -> tuple[Floats, Floats]:
        """Image coordinates ``(..., 2)`` and depths ``(...)`` of points in the optical frame, shape ``(..., 3)``.

        Points with depth ≤ 0 are behind the camera; their image coordinates mean nothing.
        """
        depth = points_optical[..., 2]
        safe = np.where(depth > 0.0, depth, 1.0)
        uv = points_optical[..., :2] / safe[..., None] * self.focal_px
        return uv + np.array([(self.width - 1) / 2.0, (self.height - 1) / 2.0]), depth

    def pixel_rays(self) -> npt.NDArray[np.float32]:
        """Directions through all pixel centres in the optical frame with depth 1, shape ``(height, width, 3)``."""
        u = (np.arange(self.width) - (self.width - 1) / 2.0) / self.focal_px
        v = (np.arange(self.height) - (self.height - 1) / 2.0) / self.focal_px
        x, y = np.meshgrid(u, v)
        return np.stack((x, y, np.ones_like(x)), axis=-1).astype(np.float32)

    def clip_from_optical(self, near_m: float, far_m: float) -> Matrix:
        """OpenGL's clip matrix for the optical frame, shape ``(4, 4)``.

        The picture's top row becomes OpenGL's row 0, so that the pixels that are read back need no flip.
        """
        span = far_m - near_m
        return np.array(
            [
                [2.0 * self.focal_px / self.width, 0.0, 0.0, 0.0],
                [0.0, 2.0 * self.focal_px / self.height, 0.0, 0.0],
                [0.0, 0.0, (far_m + near_m) / span, -2.0 * far_m * near_m / span],
                [0.0, 0.0, 1.0, 0.0],
            ]
        )


def optical_from_map(map_from_camera: Matrix) -> Matrix:
    """Transform into a camera's optical frame, given the pose of its body frame (x forward), ``(4, 4)``."""
    return transform(OPTICAL_FROM_BODY, np.zeros(3)) @ inverse(map_from_camera)


@dataclass(frozen=True, eq=False)
class RenderedImage:
    """One picture and, where asked for, its labels, all from one draw; row 0 is the top."""

    rgba: npt.NDArray[np.uint8]
    """Colour, and the semantic class (CARLA's numbers) in the fourth channel, shape ``(height, width, 4)``."""
    instance: npt.NDArray[np.uint32] | None
    """Actor id, 0 off vehicles, shape ``(height, width)``."""
    depth_m: npt.NDArray[np.float32] | None
    """Along the optical axis, 0 where there is sky, shape ``(height, width)``."""

    @property
    def semantic(self) -> npt.NDArray[np.uint8]:
        """Semantic classes, shape ``(height, width)``."""
        return self.rgba[..., 3]
