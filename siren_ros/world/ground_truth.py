"""Labelled boxes around a sensor carrier at one step, as a structure of arrays."""

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Codes, Floats, Ids

LABEL_PERIOD_STEPS: Final = 2
"""Labels are made at 10 Hz, the rate of the paper's log."""


@dataclass(frozen=True)
class GroundTruth:
    """Boxes of all actors but the carrier within sensor range; rows sorted by ``actor_id``.

    Poses and velocities are in the frame ``frame_id`` of the carrier (x forward, y left, z up); centres are
    volume centres. Velocities are over ground, expressed in the axes of that frame.
    """

    step: int
    carrier_id: int
    actor_id: Ids
    actor_class: Codes
    is_emv: npt.NDArray[np.bool_]
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
    """The carrier's first LiDAR, or ``base_link`` for a suite without one."""

    def __len__(self) -> int:
        return len(self.actor_id)


_DTYPES: Final[dict[str, type[np.generic]]] = {
    "actor_id": np.uint32,
    "actor_class": np.uint8,
    "is_emv": np.bool_,
    "lidar_points": np.uint32,
}
GROUND_TRUTH_DTYPES: Final[dict[str, type[np.generic]]] = {
    field.name: _DTYPES.get(field.name, np.float64)
    for field in fields(GroundTruth)
    if field.name not in {"step", "carrier_id", "frame_id"}
}
"""Array fields of GroundTruth and their element types, in declaration order."""
