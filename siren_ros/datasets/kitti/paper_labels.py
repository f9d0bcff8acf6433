"""The paper's label lines (supplement, "Data Formats and Coordinate Conventions").

Lines ``type trunc occl alpha x1 y1 x2 y2 h w l lx ly lz heading`` in the LiDAR frame. That frame is right-handed with
y to the left: CARLA's lateral axis negated, and headings negated with it, which is this project's own ``lidar`` frame.
Positions are volume centres. The words are KITTI's and their meaning is not: a KITTI reader takes these places for
places in the camera's frame.
"""

from typing import Final

import numpy as np

from siren_ros.numerics.geometry import wrap_angle
from siren_ros.world.ground_truth import GroundTruth

RANGE_M: Final = 50.0
"""Objects farther from the sensor are dropped (paper: the nuScenes evaluation range)."""
OBJECT_TYPE: Final = "Car"
"""The one class of the paper's labels."""
PAPER_README: Final = """# The paper's layout, which is not KITTI's

`velodyne/NNNNNN.bin` holds float32 `x y z intensity` in the LiDAR frame (x forward, y left, z up).
`label_2/NNNNNN.txt` holds lines `type trunc occl alpha x1 y1 x2 y2 h w l lx ly lz heading` **in the LiDAR frame**:
metres, volume centre, heading counter-clockwise from the x axis. Truncation, occlusion and the image box are 0. Every
vehicle is a `Car`, the emergency vehicle too; vehicles beyond 50 m are left out.

A KITTI reader opens these files without an error and puts every box in a wrong place, because KITTI's labels are in
the camera's frame with the centre of the bottom face. `siren export kitti` without `--layout paper` writes what such
a reader expects, with these lines in `label_lidar/`.
"""


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
        lines.append(f"{OBJECT_TYPE} 0.00 0 " + " ".join(number_text(float(value), 4) for value in numbers) + "\n")
    return "".join(lines)


def number_text(value: float, decimals: int) -> str:
    """A number as KITTI writes it, without a negative zero."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"
