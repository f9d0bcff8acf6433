"""Vertices as the graphics card gets them, and culling: only the triangles that a camera can see are drawn.

In a street most triangles of a scene stand behind the first row of houses. A horizon holds, for each direction of the
compass and each distance, the slope up to which a wall that stands nearer hides what lies behind it. The test errs on
the side of drawing: pictures are the same with and without it.

Normal, material and colour belong to triangles. OpenGL takes such "flat" values from a triangle's last vertex, so
triangles can share vertices as long as each has a last vertex with its own values. That needs about
one vertex per triangle instead of three, and a software rasteriser's time goes by vertices. For the same reason
invisible triangles are left out before OpenGL gets them.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

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


VERTEX: Final = np.dtype([("position", "<f4", 3), ("normal_material", "<f2", 4), ("colour", "u1", 4)])
"""Record of a vertex, 24 bytes. The colour's fourth byte is the semantic class; half floats hold material codes
exactly."""

_FIRST, _SECOND, _LAST = range(3)
"""Corners of a triangle."""
_OFFSET: Final = 3
"""Column of planes, after the normal."""


@dataclass(frozen=True, eq=False)
class IndexedMesh:
    """Triangles for ``glDrawElements``."""

    vertices: npt.NDArray[np.void]
    """Records of dtype ``VERTEX``, shape ``(V,)``."""
    triangles: npt.NDArray[np.uint32]
    """Rows of ``vertices``, shape ``(T, 3)``, in the mesh's order; the last corner holds the triangle's values."""


def index_mesh(mesh: Mesh, semantic_of_material: npt.NDArray[np.uint8]) -> IndexedMesh:
    """Index a mesh with few vertices: a greedy rule chooses which corner of each triangle comes last."""
    values = np.zeros(len(mesh), VERTEX)
    values["normal_material"][:, :3] = mesh.normals
    values["normal_material"][:, 3] = mesh.material
    values["colour"][:, :3] = mesh.colour_rgb
    values["colour"][:, 3] = semantic_of_material[mesh.material]
    look = values.view(np.uint8).reshape(len(mesh), VERTEX.itemsize)[:, 12:]
    key = _distinct(look)[1]
    first, welded = _distinct(mesh.vertices_m + np.float32(0.0))
    points = mesh.vertices_m[first]
    triangles = welded[mesh.triangles]
    source = np.empty(len(points) + len(mesh), np.int64)
    owner = np.empty(len(points) + len(mesh), np.int64)
    count = _share(triangles, key, source, owner, len(points))
    vertices = np.zeros(count, VERTEX)
    owned = owner[:count] >= 0
    vertices[owned] = values[owner[:count][owned]]
    vertices["position"] = points[source[:count]]
    return IndexedMesh(vertices, triangles.astype(np.uint32))


def _distinct(rows: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Group equal rows by their bytes: the index of one row of each group, and the group of each row."""
    whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).reshape(-1)
    _, first, kind = np.unique(whole, return_index=True, return_inverse=True)
    return first.astype(np.int64), kind.astype(np.int64).reshape(-1)


@compiled
def _share(triangles: Array, key: Array, source: Array, owner: Array, points: int) -> int:
    """Reorder or copy corners so that no two triangles share a last corner; returns the number of vertices.

    ``owner`` becomes the triangle whose values a vertex holds (−1 for none), ``source`` the point that it stands for.

    """
    for v in range(points):
        source[v] = v
        owner[v] = -1
    count = points
    for t in range(triangles.shape[0]):
        chosen = -1
        for k in range(3):
            o = owner[triangles[t, k]]
            if o >= 0 and key[o] == key[t]:
                chosen = k
                break
            if o < 0 and chosen < 0:
                chosen = k
        a, b, c = triangles[t, _FIRST], triangles[t, _SECOND], triangles[t, _LAST]
        if chosen < 0:
            source[count] = source[c]
            triangles[t, _LAST] = count
            owner[count] = t
            count += 1
        else:
            if chosen == 0:
                triangles[t, _FIRST], triangles[t, _SECOND], triangles[t, _LAST] = b, c, a
            elif chosen == 1:
                triangles[t, _FIRST], triangles[t, _SECOND], triangles[t, _LAST] = c, a, b
            if owner[triangles[t, _LAST]] < 0:
                owner[triangles[t, _LAST]] = t
    return count


@compiled
def chunks_in_view(low: Array, high: Array, reach: Array, planes: Array, eye: Array, distance: Array) -> None:
    """Set the distance of every box from the eye, infinite where it is out of reach or outside the view.

    ``low`` and ``high`` are the boxes' corners (K, 3) and ``reach`` the distance up to which each is drawn (K,);
    ``planes`` are ``(a, b, c, d)`` with the visible side positive (P, 4); ``eye`` (3,); ``distance`` is the result
    (K,); all float64.
    """
    for k in range(low.shape[0]):
        square = 0.0
        for axis in range(3):
            gap = max(low[k, axis] - eye[axis], 0.0, eye[axis] - high[k, axis])
            square += gap * gap
        far = np.sqrt(square)
        inside = far < reach[k]
        for p in range(planes.shape[0]):
            most = planes[p, _OFFSET]
            for axis in range(3):
                n = planes[p, axis]
                most += n * (high[k, axis] if n > 0.0 else low[k, axis])
            inside = inside and most > 0.0
        distance[k] = far if inside else np.inf


@compiled
def visible_triangles(
    chunks: Array,
    draws: Array,
    first: Array,
    distance: Array,
    planes: Array,
    area: Array,
    triangles: Array,
    circles: Array,
    chunk_circles: Array,
    slopes: Array,
    eye: Array,
    smallest: float,
    out: Array,
    counts: Array,
) -> int:
    """Copy the triangles that turn their front to the eye, are large enough and not hidden; returns how many.

    The triangles of a draw stand together, in the order of the draws, and ``counts`` (D,) becomes how many each has.

    A triangle of area A whose plane lies h below the eye shows A h / d³ steradians at distance d; ``smallest`` is the
    least that is drawn. The chunk's distance stands for the triangle's, so that what is dropped is smaller than that.
    ``chunks`` (C,) are rows of ``first`` (int64), which holds the first triangle of each chunk and the end (K + 1,);
    ``draws`` (C,) are what draws them; ``distance`` from the eye to each chunk is float64 (K,). Of the triangles,
    ``planes`` are the outward normal and its product with a corner, float32 (T, 4), ``area`` is float32 (T,), and
    ``triangles`` are vertices, uint32 (T, 3), as in the result ``out``, which has room for all triangles of the chunks.
    ``circles`` bound the triangles and ``chunk_circles`` the chunks, and ``slopes`` are those of the horizon around the
    eye (``occlusion``).
    """
    x, y, z = np.float32(eye[X]), np.float32(eye[Y]), np.float32(eye[Z])
    count = 0
    for d in range(counts.shape[0]):
        before = count
        for c in range(chunks.shape[0]):
            chunk = chunks[c]
            if draws[c] != d or is_hidden(slopes, eye, chunk_circles[chunk]):
                continue
            least = np.float32(smallest * distance[chunk] ** 3)
            for t in range(first[chunk], first[chunk + 1]):
                above = planes[t, X] * x + planes[t, Y] * y + planes[t, Z] * z - planes[t, _OFFSET]
                large = above > np.float32(-0.01) and area[t] * above >= least
                if large and not is_hidden(slopes, eye, circles[t]):
                    out[count, _FIRST] = triangles[t, _FIRST]
                    out[count, _SECOND] = triangles[t, _SECOND]
                    out[count, _LAST] = triangles[t, _LAST]
                    count += 1
        counts[d] = count - before
    return count
