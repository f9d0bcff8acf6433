"""Finds what walls hide from a camera, so that OpenGL need not draw it.

In a street most triangles of a scene stand behind the first row of houses. A horizon holds, for each direction of the
compass and each distance, the slope up to which a wall that stands nearer hides what lies behind it. The test errs
on the side of drawing: pictures are the same with and without it.
"""

from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.base.numerics.compiled import Array, X, Y, Z, compiled
from siren_ros.sensing.meshes.mesh import Material, Mesh

GROUND_M: Final = 0.0
"""A wall that reaches down to this height hides everything behind it up to its slope."""
_BINS: Final = 512
"""Number of directions around the eye, a power of two. They divide the way around a square, not the angle."""
_RING_M: Final = 4.0
_RINGS: Final = 112
"""Number of distance steps; walls beyond the last one hide nothing."""
_MARGIN: Final = 1e-4
"""Safety margin on slopes, for the rounding of coordinates."""
_SLACK_M: Final = 1e-3
_FIRST_X, _FIRST_Y, _LAST_X, _LAST_Y, _NORMAL_X, _NORMAL_Y, _TOP, _AREA = range(8)
"""Columns of walls."""
_REACH, _LOW, _HIGH = range(2, 5)
"""Columns of bounding circles after ``X`` and ``Y``."""


def standing_walls(mesh: Mesh) -> Floats:
    """Rectangular walls that stand on the ground: two end points, outward normal, top and area; shape ``(W, 8)``.

    Two triangles in a row of one plane make a rectangle where their areas add up to its own.
    """
    found = [np.empty((0, 8))]
    wall = mesh.material == Material.BUILDING_WALL
    pairs = np.flatnonzero(wall[:-1] & wall[1:])
    corners = mesh.vertices_m[np.hstack((mesh.triangles[pairs], mesh.triangles[pairs + 1]))].astype(np.float64)
    normals = mesh.normals[pairs].astype(np.float64)
    upright = (np.abs(normals[:, 2]) < 1e-6) & (
        np.abs(normals - mesh.normals[pairs + 1]).max(axis=1, initial=0.0) < 1e-6
    )
    for points, normal in zip(corners[upright], normals[upright], strict=True):
        along = points[:, 0] * -normal[1] + points[:, 1] * normal[0]
        low, high = points[:, 2].min(), points[:, 2].max()
        first, last = points[along.argmin()], points[along.argmax()]
        area = sum(0.5 * np.linalg.norm(np.cross(t[1] - t[0], t[2] - t[0])) for t in (points[:3], points[3:]))
        if low <= GROUND_M and abs(area - (along.max() - along.min()) * (high - low)) < 1e-3 * area:
            found.append(np.array([[*first[:2], *last[:2], *normal[:2], high, area]]))
    return np.concatenate(found)


def bounding_circles(low_m: Floats, high_m: Floats) -> Floats32:
    """Circles on the ground that enclose boxes, and the boxes' heights: x, y, radius, low, high; shape ``(N, 5)``."""
    middle, reach = (low_m + high_m) / 2.0, np.linalg.norm((high_m - low_m)[:, :2], axis=1) / 2.0 + _SLACK_M
    return np.column_stack((middle[:, :2], reach, low_m[:, 2], high_m[:, 2])).astype(np.float32)


@compiled
def _way_around(x: float, y: float) -> float:
    """Direction as a position on the perimeter of a square, 0 to 4. It replaces atan2 and grows at most as fast."""
    way = y / (abs(x) + abs(y))
    if x < 0.0:
        return 2.0 - way
    return way if way >= 0.0 else 4.0 + way


def _directions() -> Floats:
    """Unit vectors at the borders of the bins, shape ``(_BINS + 1, 2)``."""
    way = np.arange(_BINS + 1) * (4.0 / _BINS)
    y = np.where(way <= 1.0, way, np.where(way <= 3.0, 2.0 - way, way - 4.0))
    x = (1.0 - np.abs(y)) * np.where((way > 1.0) & (way < 3.0), -1.0, 1.0)
    return np.column_stack((x, y)) / np.hypot(x, y)[:, None]


_DIRECTIONS: Final = _directions()


class Horizon:
    """The slopes up to which walls hide what is behind them, around one eye at a time."""

    def __init__(self, mesh: Mesh) -> None:
        """Find the walls of the static scene."""
        self._walls = standing_walls(mesh)
        self.slopes = np.empty((_RINGS, _BINS), np.float32)
        """Tangent of the elevation, by distance and direction; what ``is_hidden`` reads."""

    def look_from(self, eye_m: Floats, smallest: float, reach_m: float) -> None:
        """Compute the slopes for one eye position.

        Walls beyond the reach and walls of less than ``smallest`` steradians are not drawn, and hide nothing.
        """
        self.slopes.fill(-np.inf)
        _raise_horizon(self._walls, _DIRECTIONS, eye_m, smallest, reach_m, self.slopes)

    def visible(self, eye_m: Floats, circles: Floats32) -> Array:
        """Which of the bounding circles ``(N, 5)`` are not wholly hidden, shape ``(N,)``."""
        return _visible(self.slopes, eye_m, circles)


@compiled
def _raise_horizon(walls: Array, directions: Array, eye: Array, smallest: float, reach: float, slopes: Array) -> None:
    bins, rings = slopes.shape[1], slopes.shape[0]
    for w in range(walls.shape[0]):
        ax, ay, bx, by = (
            walls[w, _FIRST_X] - eye[X],
            walls[w, _FIRST_Y] - eye[Y],
            walls[w, _LAST_X] - eye[X],
            walls[w, _LAST_Y] - eye[Y],
        )
        nx, ny, up = walls[w, _NORMAL_X], walls[w, _NORMAL_Y], walls[w, _TOP] - eye[Z]
        before = -(nx * ax + ny * ay)
        farthest = np.sqrt(max(ax * ax + ay * ay, bx * bx + by * by) + max(up * up, eye[Z] * eye[Z]))
        # A wall is two triangles; each has half of its area.
        if before <= 0.0 or farthest >= reach or 0.5 * walls[w, _AREA] * before < smallest * farthest**3:
            continue
        first, last = _way_around(ax, ay), _way_around(bx, by)
        if ax * by - ay * bx < 0.0:
            first, last = last, first
        if last < first:
            last += 4.0
        begin, end = int(np.ceil(first * (bins / 4) + 1e-6)), int(np.floor(last * (bins / 4) - 1e-6))
        for k in range(begin, end):
            low, high = directions[k % bins], directions[k % bins + 1]
            this, that = -before / (nx * low[0] + ny * low[1]), -before / (nx * high[0] + ny * high[1])
            away = max(this, that)
            ring = int(away / _RING_M) + 1
            if ring < rings:
                slope = np.float32(up / away if up > 0.0 else up / min(this, that))
                slopes[ring, k % bins] = max(slopes[ring, k % bins], slope)
    for r in range(1, rings):
        for k in range(bins):
            slopes[r, k] = max(slopes[r, k], slopes[r - 1, k])


@compiled
def is_hidden(slopes: Array, eye: Array, circle: Array) -> bool:
    """Whether walls hide all within a bounding circle (x, y, radius, low, high) from the eye whose slopes these are."""
    bins = slopes.shape[1]
    x, y, reach = circle[X] - eye[X], circle[Y] - eye[Y], float(circle[_REACH])
    away = np.sqrt(x * x + y * y)
    near = away - reach
    if near < _RING_M or reach > 0.5 * away or circle[_LOW] < GROUND_M:
        return False
    ring = min(int(near / _RING_M), slopes.shape[0] - 1)
    up = circle[_HIGH] - eye[Z]
    slope = (up / near if up > 0.0 else up / (away + reach)) + _MARGIN
    # An upper bound that is cheaper than asin: asin(a) <= a π / 2.
    middle, half = _way_around(x, y), 0.5 * np.pi * reach / away
    begin, end = int((middle - half + 4.0) * (bins / 4)), int((middle + half + 4.0) * (bins / 4))
    for k in range(begin, end + 1):  # noqa: SIM110 # a compiled loop
        if slopes[ring, k & (bins - 1)] <= slope:
            return False
    return True


@compiled
def _visible(slopes: Array, eye: Array, circles: Array) -> Array:
    found = np.empty(circles.shape[0], np.bool_)
    for k in range(circles.shape[0]):
        found[k] = not is_hidden(slopes, eye, circles[k])
    return found
