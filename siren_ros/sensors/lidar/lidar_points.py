"""The record of one LiDAR return."""

from typing import Final

import numpy as np

LIDAR_POINT_DTYPE: Final = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("intensity", "<f4"),
        ("time", "<f4"),
        ("ring", "<u2"),
        ("instance", "<u2"),
    ]
)
"""One LiDAR return, 24 bytes: metres in the sensor frame, intensity 0–1, seconds since the stamp, beam, actor id."""
