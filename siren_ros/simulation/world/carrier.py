"""What is known of a vehicle with sensors at one step: labels, odometry, predicted paths, its frames (REP 105)."""

from dataclasses import dataclass
from typing import Final

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, dtypes_of
from siren_ros.base.tables.brief import Brief

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
