"""The carrier, a vehicle with sensors, at one step: labels, odometry, predicted paths, frames (REP 105), measurements.

Pictures and point clouds are elsewhere; the intrinsics of cameras are here. A measurement's ``frame_id`` is the
sensor's name; messages put the carrier's prefix before it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Brief, Codes, Flags, Floats, Ids, Matrix, dtypes_of

LABEL_PERIOD_STEPS: Final = 2
"""Labels are made at 10 Hz, the rate of the paper's log."""


@dataclass(frozen=True)
class GroundTruth(Brief):
    """Boxes of all actors but the carrier within sensor range; rows sorted by ``actor_id``.

    Poses and velocities are in the frame ``frame_id`` of the carrier (x forward, y left, z up); centres are
    volume centres. Velocities are over ground, expressed in the axes of that frame.
    """

    step: int
    carrier_id: int
    actor_id: Ids
    actor_class: Codes
    is_emv: Flags
    x_m: Floats
    y_m: Floats
    z_m: Floats
    yaw_rad: Floats
    length_m: Floats
    width_m: Floats
    height_m: Floats
    vx_mps: Floats
    vy_mps: Floats
    accel_mps2: Floats
    lidar_points: Ids
    """Number of LiDAR returns on the actor in the sweep of this step."""
    frame_id: str = "lidar"
    """Frame of the boxes: the carrier's first LiDAR, or ``base_link`` for a suite without one."""

    def __len__(self) -> int:
        return len(self.actor_id)


GROUND_TRUTH_DTYPES: Final = dtypes_of(GroundTruth)
"""Array fields of GroundTruth and their element types, in declaration order."""


@dataclass(frozen=True)
class CameraTruth(Brief):
    """Vehicles that a camera could see at one step; rows sorted by ``actor_id``.

    Image coordinates are those of ``sensor_msgs/CameraInfo``: (0, 0) is the centre of the top left pixel. Boxes
    bound the pixels that show the vehicle, outer edges; all zero for one that is wholly hidden.
    """

    step: int
    actor_id: Ids
    actor_class: Codes
    is_emv: Flags
    u_min_px: Floats
    v_min_px: Floats
    u_max_px: Floats
    v_max_px: Floats
    visible_px: Ids
    """Number of pixels that show the vehicle."""
    visible_fraction: Floats
    """Visible share of the vehicle's outline within the picture."""
    truncation: Floats
    """Share of the vehicle's outline that lies outside the picture."""

    def __len__(self) -> int:
        return len(self.actor_id)


CAMERA_TRUTH_DTYPES: Final = dtypes_of(CameraTruth)
"""Array fields of CameraTruth and their element types, in declaration order."""


@dataclass(frozen=True, eq=False)
class Odometry:
    """Pose of ``base_link`` in the ``odom`` frame, and velocity in ``base_link``, each with its covariance."""

    x_m: float
    y_m: float
    yaw_rad: float
    forward_mps: float
    left_mps: float
    yaw_rate_radps: float
    pose_covariance: Floats
    """Covariance of x, y and yaw in the ``odom`` frame, shape ``(3, 3)``."""
    twist_covariance: Floats
    """Covariance of the forward velocity, the left velocity and the yaw rate, shape ``(3, 3)``."""


@dataclass(frozen=True)
class PredictedPaths:
    """R paths of vehicles, several for each, in the ``map`` frame."""

    step: int
    """The step from which the paths start."""
    actor_id: Ids
    """Vehicle of each path, shape ``(R,)``."""
    probability: Floats
    """Probability of each path; the probabilities of a vehicle's paths add up to 1."""
    xy_m: Floats
    """Predicted centres of the footprint, shape ``(R, L, 2)``."""

    def __len__(self) -> int:
        return len(self.actor_id)


MAP_FRAME: Final = "map"
ODOM_FRAME: Final = "odom"
"""A vehicle's odometry is continuous in this frame, which drifts against ``map``."""
BASE_FRAME: Final = "base_link"
STATION_FRAME: Final = "station"
"""Frame whose origin is the place on the ground at which a roadside unit stands."""


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
