"""Where one vehicle stands on a lane: the fast scalar counterpart of ``Polyline.project``."""

import math

import numpy as np

from siren_ros.numerics.polyline import Polyline


def nearest_on_lane(centre: Polyline, x_m: float, y_m: float) -> tuple[float, float, float]:
    """Arc length, offset (left positive) and heading at the place of a centre line nearest to a point.

    The first and last segments are extended straight on, as by ``Polyline.project``.
    """
    points, arc = centre.points, centre.arc_m
    start = points[:-1]
    length = arc[1:] - arc[:-1]
    along_x, along_y = (points[1:, 0] - start[:, 0]) / length, (points[1:, 1] - start[:, 1]) / length
    dx, dy = x_m - start[:, 0], y_m - start[:, 1]
    along = dx * along_x + dy * along_y
    inside = np.minimum(np.maximum(along, 0.0), length)
    inside[0] = min(along[0], inside[0])
    inside[-1] = max(along[-1], inside[-1])
    miss_x, miss_y = dx - inside * along_x, dy - inside * along_y
    i = int((miss_x * miss_x + miss_y * miss_y).argmin())
    tangent_x, tangent_y = float(along_x[i]), float(along_y[i])
    left = tangent_x * float(miss_y[i]) - tangent_y * float(miss_x[i])
    return float(arc[i] + inside[i]), left, math.atan2(tangent_y, tangent_x)


def lane_heading(centre: Polyline, s_m: float) -> float:
    """Direction of a centre line at an arc length."""
    i = min(max(int(centre.arc_m.searchsorted(s_m, side="right")) - 1, 0), len(centre.points) - 2)
    (x0, y0), (x1, y1) = centre.points[i : i + 2].tolist()
    return math.atan2(y1 - y0, x1 - x0)
