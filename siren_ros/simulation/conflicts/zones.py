"""Finds where the paths of two bodies meet, by a compiled search along both courses."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.compiled import box_gap_m, compiled, wrapped_rad

# No parameters: compiled code contains the resolution as constants.
STEP_M: Final = 1.0
"""Distance between checked places."""
SAME_DIRECTION: Final = 0.9
"""Bodies with a larger cosine (less than about 25° apart) move in the same direction."""
_ALONG_COURSE: Final = 0.9945
_COLUMNS: Final = 8
_BISECTIONS: Final = 3
"""Number of bisections: the entry into a zone is exact to an eighth of a step."""
_STRAIGHT_AFTER_M: Final = 6.0
"""Distance after which a vehicle that points elsewhere follows its course."""
TRACK_M: Final = 2.5
"""Half the distance between the two points of a course that give a body's heading."""
_CLOSE_M: Final = 1e-6
"""Tolerance for rounding when bounds of bodies are compared."""
_STRAIGHT_STEP_M: Final = 0.25
"""Distance between checked places straight ahead."""
_REAR_M: Final = 1.25
"""Distance from a body's centre back to the middle of these points, because bodies turn later than their centre."""


class Way(NamedTuple):
    """A body on its course."""

    points: npt.NDArray[np.float64]
    """Points of the course, shape ``(K, 2)``."""
    spacing_m: float
    centre_m: float
    """Arc length of the body's centre."""
    left_m: float
    """Offset from the course that the body keeps."""
    pose: tuple[float, float, float]
    """Present x, y and yaw; a body off its course, or at an angle, turns onto it."""
    reach_m: float
    """Distance to look ahead."""
    half_length_m: float
    half_width_m: float
    cut_m: float = TRACK_M
    """The centre is in the middle between two points of the course, this far before and behind it: in bends it cuts the
    corner, as SUMO's vehicles do. 0 for a vehicle that keeps the centre on the course."""


class Zone(NamedTuple):
    """Zone where two paths meet; distances are those that a body's centre drives from now."""

    own_in_m: float
    """Distance until the own body touches the other one's swept area."""
    own_out_m: float
    """Distance until it has left that area; infinite if it does not within reach."""
    other_in_m: float
    other_out_m: float
    along: float
    """Cosine between both courses at the end of the zone, or at the end of the search."""
    blocked_m: float
    """Distance until the own body touches the other where it is now; infinite if it does not."""
    blocked_along: float = 0.0
    """Cosine between both bodies there."""

    @property
    def merges(self) -> bool:
        """Whether both continue in one direction on the same path."""
        return self.along > SAME_DIRECTION

    @property
    def leads(self) -> bool:
        """Whether the other body is already ahead on the same path."""
        return self.blocked_along > SAME_DIRECTION


class Ways(NamedTuple):
    """Several bodies on their courses, as arrays for the compiled search."""

    points: npt.NDArray[np.float64]
    """Points of all courses, one course after the other, shape ``(K, 2)``."""
    first: npt.NDArray[np.intp]
    """Where the course of each body begins in ``points``, shape ``(W,)``."""
    last: npt.NDArray[np.intp]
    """End of each body's course in ``points``, shape ``(W,)``."""
    bodies: npt.NDArray[np.float64]
    """Shape ``(W, 10)``: x, y, yaw, spacing, place, offset, reach, half length, half width and cut, as in ``Way``."""

    @classmethod
    def of(cls, ways: Sequence[Way]) -> "Ways":
        """Some ways together."""
        ends = np.cumsum([0, *(len(way.points) for way in ways)])
        bodies = np.array([(*way.pose, *way[1:4], *way[5:]) for way in ways])
        return cls(np.concatenate([way.points for way in ways]), ends[:-1], ends[1:], bodies)


@compiled
def way_point(points: Any, first: int, last: int, place: float) -> tuple[float, float]:
    """X and y at a position of ``points[first:last]``, counted in point distances; straight at both ends."""
    i = min(max(int(place), 0), last - first - 2) + first
    f = place - (i - first)
    x, y = points[i, 0], points[i, 1]
    return x + f * (points[i + 1, 0] - x), y + f * (points[i + 1, 1] - y)


@compiled
def _pose(
    points: Any, first: int, last: int, spacing: float, s_m: float, left_m: float, cut_m: float
) -> tuple[float, float, float, float]:
    """x, y and the direction's cosine and sine of a body whose centre is at an arc length of ``points[first:last]``."""
    xs, ys = way_point(points, first, last, (s_m - _REAR_M - TRACK_M) / spacing)
    xe, ye = way_point(points, first, last, (s_m - _REAR_M + TRACK_M) / spacing)
    dx, dy = xe - xs, ye - ys
    norm = np.sqrt(dx * dx + dy * dy) + 1e-9
    cos, sin = dx / norm, dy / norm
    x, y = way_point(points, first, last, (s_m - cut_m) / spacing)
    if cut_m > 0.0:
        ahead_x, ahead_y = way_point(points, first, last, (s_m + cut_m) / spacing)
        x, y = 0.5 * (x + ahead_x), 0.5 * (y + ahead_y)
    return x - sin * left_m, y + cos * left_m, cos, sin


@compiled
def follows_course(ways: Any, row: int) -> bool:
    """Whether a body points along its course, within 6°."""
    yaw_rad, spacing_m, centre_m, left_m = ways.bodies[row, 2:6]
    first, last = ways.first[row], ways.last[row]
    _, _, cos, sin = _pose(ways.points, first, last, spacing_m, centre_m, left_m, ways.bodies[row, 9])
    return np.cos(yaw_rad) * cos + np.sin(yaw_rad) * sin > _ALONG_COURSE


@compiled
def straight_to_m(ways: Any, own: int, other: int, reach_m: float) -> float:
    """Distance that a body drives straight ahead until it touches another one; infinite if it does not."""
    x, y, yaw_rad = ways.bodies[own, :3]
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    theirs = ways.bodies[other]
    pose = theirs[0], theirs[1], np.cos(theirs[2]), np.sin(theirs[2])
    for k in range(1, int(reach_m / _STRAIGHT_STEP_M) + 1):
        way_m = k * _STRAIGHT_STEP_M
        ahead = x + way_m * cos, y + way_m * sin, cos, sin
        if box_gap_m(ahead, pose, ways.bodies[own, 7], ways.bodies[own, 8], theirs[7], theirs[8]) <= 0.0:
            return way_m - _STRAIGHT_STEP_M
    return np.inf


@compiled
def _poses(ways: Any, used: Any) -> tuple[Any, Any]:
    """Poses of the used bodies along their courses, ``STEP_M`` apart, in one array, and where each body's begin."""
    begins = np.zeros(ways.first.shape[0] + 1, np.intp)
    for n in used:
        begins[n + 1] = int(ways.bodies[n, 6] / STEP_M) + 1
    for n in range(ways.first.shape[0]):
        begins[n + 1] += begins[n]
    poses = np.empty((begins[-1], 4))
    for n in range(ways.first.shape[0]):
        off = _off_course(ways, n) if begins[n] < begins[n + 1] else (0.0, 0.0)
        for k in range(begins[n + 1] - begins[n]):
            pose = _pose_after(ways, n, off, k * STEP_M)
            at = begins[n] + k
            poses[at, 0], poses[at, 1], poses[at, 2], poses[at, 3] = pose
    return poses, begins


@compiled
def _off_course(ways: Any, n: int) -> tuple[float, float]:
    """Difference between a body's pose and its course: to the left, and in yaw."""
    body = ways.bodies[n]
    x, y, cos, sin = _pose(ways.points, ways.first[n], ways.last[n], body[3], body[4], body[5], body[9])
    return cos * (body[1] - y) - sin * (body[0] - x), wrapped_rad(body[2] - np.arctan2(sin, cos))


@compiled
def _pose_after(ways: Any, n: int, off: tuple[float, float], way_m: float) -> tuple[float, float, float, float]:
    """Pose of a body after a distance; its present difference from the course decreases to zero."""
    body = ways.bodies[n]
    x, y, cos, sin = _pose(ways.points, ways.first[n], ways.last[n], body[3], body[4] + way_m, body[5], body[9])
    if way_m > _STRAIGHT_AFTER_M:
        return x, y, cos, sin
    left = 1.0 - way_m / _STRAIGHT_AFTER_M
    aside, turned = left * off[0], left * off[1]
    c, s = np.cos(turned), np.sin(turned)
    return x - aside * sin, y + aside * cos, cos * c - sin * s, sin * c + cos * s


@compiled
def _next_touch(own: tuple[float, float, float, float], theirs: Any, sizes: Any, j: int) -> int:
    """First position on another path, from ``j`` on, that touches a body in a pose; the path's length if there is none.

    Places that are too far away to matter are stepped over: the distance changes by no more than the way does.
    """
    half_length, half_width, length, width = sizes
    around = np.sqrt(half_length**2 + half_width**2) + np.sqrt(length**2 + width**2)
    while j < theirs.shape[0]:
        dx, dy = theirs[j, 0] - own[0], theirs[j, 1] - own[1]
        gap = np.sqrt(dx * dx + dy * dy) - around
        if gap <= 0.0:
            pose = theirs[j, 0], theirs[j, 1], theirs[j, 2], theirs[j, 3]
            gap = box_gap_m(own, pose, half_length, half_width, length, width)
            if gap <= 0.0:
                return j
        j += max(int(gap / STEP_M), 1)
    return theirs.shape[0]


@compiled
def _entry_m(ways: Any, n: int, k: int, theirs: Any, sizes: tuple[float, float, float, float]) -> float:
    """Distance of a body until just before contact, between positions k − 1 and k, by bisection."""
    low, high, off = max(k - 1, 0) * STEP_M, k * STEP_M, _off_course(ways, n)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if _next_touch(_pose_after(ways, n, off, middle), theirs, sizes, 0) == theirs.shape[0]:
            low = middle
        else:
            high = middle
    return low


@compiled
def _around(poses: Any, begins: Any) -> Any:
    """Bounding box of each body's poses, shape ``(W, 4)``; inverted for a body without poses."""
    boxes = np.empty((begins.shape[0] - 1, 4))
    for n in range(boxes.shape[0]):
        boxes[n, 0], boxes[n, 1], boxes[n, 2], boxes[n, 3] = np.inf, -np.inf, np.inf, -np.inf
        for at in range(begins[n], begins[n + 1]):
            boxes[n, 0], boxes[n, 1] = min(boxes[n, 0], poses[at, 0]), max(boxes[n, 1], poses[at, 0])
            boxes[n, 2], boxes[n, 3] = min(boxes[n, 2], poses[at, 1]), max(boxes[n, 3], poses[at, 1])
    return boxes


@compiled
def _bounds(ways: Any, used: Any) -> Any:
    """Bounding box of each used body's edges on its path, shape ``(W, 4)``."""
    bounds = np.full((ways.first.shape[0], 4), np.nan)
    for n in used:
        if not np.isnan(bounds[n, 0]):
            continue
        first, last, body = ways.first[n], ways.last[n], ways.bodies[n]
        x, y, cos, sin = _pose(ways.points, first, last, body[3], body[4], body[5], body[9])
        aside = abs(cos * (body[1] - y) - sin * (body[0] - x)) + abs(body[5])
        margin = aside + np.sqrt(body[7] ** 2 + body[8] ** 2) + _CLOSE_M
        begin, end = (body[4] - body[9]) / body[3], (body[4] + body[6] + body[9]) / body[3]
        low_x, low_y = way_point(ways.points, first, last, begin)
        high_x, high_y = low_x, low_y
        x, y = way_point(ways.points, first, last, end)
        low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
        for at in range(first + max(int(begin), 0), min(first + int(max(end, 0.0)) + 1, last)):
            x, y = ways.points[at, 0], ways.points[at, 1]
            low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
        bounds[n, 0], bounds[n, 1] = low_x - margin, high_x + margin
        bounds[n, 2], bounds[n, 3] = low_y - margin, high_y + margin
    return bounds


@compiled
def _near_each_other(own: Any, others: Any, pairs: Any) -> Any:
    """Pairs whose bounding boxes overlap; only these need poses."""
    a, b = _bounds(own, pairs[:, 0]), _bounds(others, pairs[:, 1])
    near, count = np.empty_like(pairs), 0
    for p in range(pairs.shape[0]):
        i, n = pairs[p, 0], pairs[p, 1]
        if a[i, 0] <= b[n, 1] and b[n, 0] <= a[i, 1] and a[i, 2] <= b[n, 3] and b[n, 2] <= a[i, 3]:
            near[count, 0], near[count, 1] = i, n
            count += 1
    return near[:count]


@compiled
def zones_of(own: Any, others: Any, pairs: Any, leads: bool) -> Any:
    """The first zone in which the ways of each pair meet: ``(P, 8)``, whether they meet, then the fields of ``Zone``.

    A pair is an own and another body, shape ``(P, 2)``. A margin beside a body is part of its half width. Without
    ``leads``, of a body that leads on the same way only ``blocked_m`` and ``blocked_along`` are right.
    """
    out = np.empty((pairs.shape[0], _COLUMNS))
    near = _near_each_other(own, others, pairs)
    own_poses, their_poses = _poses(own, near[:, 0].copy()), _poses(others, near[:, 1].copy())
    _search_poses(own, own_poses, others, their_poses, pairs, leads, out)
    return out


@compiled
def search_among(ways: Any, pairs: Any) -> Any:
    """``zones_of`` without leads, where both bodies of a pair are of the same ways."""
    out = np.empty((pairs.shape[0], _COLUMNS))
    poses = _poses(ways, _near_each_other(ways, ways, pairs).ravel())
    _search_poses(ways, poses, ways, poses, pairs, bool(0), out)  # a literal False would compile the search again
    return out


@compiled
def _search_poses(own: Any, own_poses: Any, others: Any, their_poses: Any, pairs: Any, leads: bool, out: Any) -> None:
    """``zones_of`` with poses of both along their courses. Ways that stay apart as a whole are not looked at."""
    ways, own_begins = own_poses
    their_ways, their_begins = their_poses
    own_box, their_box = _around(ways, own_begins), _around(their_ways, their_begins)
    for p in range(pairs.shape[0]):
        i, n = pairs[p, 0], pairs[p, 1]
        ahead = ways[own_begins[i] : own_begins[i + 1]]
        theirs = their_ways[their_begins[n] : their_begins[n + 1]]
        sizes = own.bodies[i, 7], own.bodies[i, 8], others.bodies[n, 7], others.bodies[n, 8]
        far = _CLOSE_M + np.sqrt(sizes[0] ** 2 + sizes[1] ** 2) + np.sqrt(sizes[2] ** 2 + sizes[3] ** 2)
        low_x, high_x = their_box[n, 0] - far, their_box[n, 1] + far
        low_y, high_y = their_box[n, 2] - far, their_box[n, 3] + far
        met, s_in, s_out, q_in, q_out, course = 0.0, 0.0, np.inf, np.inf, 0.0, 0.0
        blocked, blocked_along = np.inf, 0.0
        apart = own_box[i, 1] < low_x or own_box[i, 0] > high_x or own_box[i, 3] < low_y or own_box[i, 2] > high_y
        for k in range(0 if apart else ahead.shape[0]):
            pose = ahead[k, 0], ahead[k, 1], ahead[k, 2], ahead[k, 3]
            at = theirs.shape[0]
            if low_x <= pose[0] <= high_x and low_y <= pose[1] <= high_y:
                at = _next_touch(pose, theirs, sizes, 0)
            if at == theirs.shape[0]:
                if met > 0.0:
                    s_out = k * STEP_M
                    break
                continue
            if at == 0 and blocked == np.inf:
                blocked = _entry_m(own, i, k, theirs[:1], sizes)
                blocked_along = pose[2] * theirs[0, 2] + pose[3] * theirs[0, 3]
                if not leads and blocked_along > SAME_DIRECTION:
                    met = 1.0
                    break
            if met == 0.0:
                met, s_in = 1.0, _entry_m(own, i, k, theirs, sizes)
            q_in = min(q_in, at * STEP_M)
            while at < theirs.shape[0]:
                end, at = at, _next_touch(pose, theirs, sizes, at + 1)
            q_out = max(q_out, end * STEP_M)
            course = pose[2] * theirs[end, 2] + pose[3] * theirs[end, 3]
        out[p, 0], out[p, 1], out[p, 2], out[p, 3] = met, s_in, s_out, q_in
        out[p, 4], out[p, 5], out[p, 6], out[p, 7] = q_out + STEP_M, course, blocked, blocked_along
