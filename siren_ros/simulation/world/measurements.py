"""What sensors measure, apart from pictures and point clouds, and the intrinsics of cameras.

A measurement's ``frame_id`` is the sensor's name; messages put the carrier's prefix before it.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Matrix


@dataclass(frozen=True, eq=False)
class GnssFix:
    """A WGS 84 position of a satellite receiver."""

    step: int
    frame_id: str
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    """Height above the WGS 84 ellipsoid."""
    variance_m2: Floats
    """Variances east, north and up: white noise plus the bias walk so far, shape ``(3,)``."""


@dataclass(frozen=True, eq=False)
class ImuSample:
    """One measurement of an inertial unit, in the sensor's axes."""

    step: int
    frame_id: str
    specific_force_mps2: Floats
    """What accelerometers measure, shape ``(3,)``: acceleration minus gravity, so (0, 0, 9.81) at rest and level."""
    angular_rate_radps: Floats
    """Rate of turn about each axis, shape ``(3,)``."""
    force_variance: float
    rate_variance: float


@dataclass(frozen=True, eq=False)
class AudioChunk:
    """The sound between the step before and this one."""

    step: int
    frame_id: str
    sample_rate_hz: int
    samples: npt.NDArray[np.int16]


@dataclass(frozen=True)
class CameraIntrinsics:
    """Intrinsics of an ideal camera, without distortion.

    Image coordinates are those of sensor_msgs/CameraInfo and OpenCV: (0, 0) is the *centre* of the top left pixel, so
    the picture spans −0.5 … width − 0.5.
    """

    width: int
    height: int
    focal_x_px: float
    focal_y_px: float
    centre_x_px: float
    centre_y_px: float

    @classmethod
    def centred(cls, width: int, height: int, focal_px: float) -> "CameraIntrinsics":
        """A camera with square pixels and its principal point in the middle, at ((width − 1) / 2, (height − 1) / 2)."""
        return cls(width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0)

    @property
    def matrix(self) -> Matrix:
        """``pixels = matrix @ point`` for points in the optical frame, shape ``(3, 3)``."""
        return np.array(
            [[self.focal_x_px, 0.0, self.centre_x_px], [0.0, self.focal_y_px, self.centre_y_px], [0.0, 0.0, 1.0]]
        )

    def project(self, points_optical: Floats) -> tuple[Floats, Floats]:
        """Image coordinates ``(..., 2)`` and depths ``(...)`` of points in the optical frame, shape ``(..., 3)``.

        Points with depth ≤ 0 are behind the camera; their image coordinates mean nothing.
        """
        depth = points_optical[..., 2]
        safe = np.where(depth > 0.0, depth, 1.0)
        focals = np.array([self.focal_x_px, self.focal_y_px])
        centre = np.array([self.centre_x_px, self.centre_y_px])
        return points_optical[..., :2] / safe[..., None] * focals + centre, depth

    def pixel_rays(self) -> npt.NDArray[np.float32]:
        """Directions through all pixel centres in the optical frame with depth 1, shape ``(height, width, 3)``."""
        u = (np.arange(self.width) - self.centre_x_px) / self.focal_x_px
        v = (np.arange(self.height) - self.centre_y_px) / self.focal_y_px
        x, y = np.meshgrid(u, v)
        return np.stack((x, y, np.ones_like(x)), axis=-1).astype(np.float32)

    def clip_from_optical(self, near_m: float, far_m: float) -> Matrix:
        """OpenGL's clip matrix of a centred camera for the optical frame, shape ``(4, 4)``.

        The picture's top row becomes OpenGL's row 0, so that the pixels that are read back need no flip.
        """
        span = far_m - near_m
        return np.array(
            [
                [2.0 * self.focal_x_px / self.width, 0.0, 0.0, 0.0],
                [0.0, 2.0 * self.focal_y_px / self.height, 0.0, 0.0],
                [0.0, 0.0, (far_m + near_m) / span, -2.0 * far_m * near_m / span],
                [0.0, 0.0, 1.0, 0.0],
            ]
        )
