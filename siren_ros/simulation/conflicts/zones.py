"""Finds where the paths of two bodies meet, by a compiled search along both courses."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Points, Rows
from siren_ros.base.numerics.compiled import COS, SIN, YAW, Pose, X, Y, box_gap_m, compiled, wrapped_rad

# These are no parameters: compiled code contains the resolution as constants.
STEP_M: Final = 1.0
"""Distance between checked places."""
SAME_DIRECTION: Final = 0.9
"""Bodies with a larger cosine (less than about 25° apart) move in the same direction."""
_ALONG_COURSE: Final = 0.9945
_COLUMNS: Final = 8
_BISECTIONS: Final = 3
"""Number of bisections: the entry into a zone is exact to an eighth of a step."""
STRAIGHT_AFTER_M: Final = 6.0
"""Distance after which a vehicle that points elsewhere follows its course."""
_TRACK_M: Final = 2.5
"""Half the distance between the points of its course that give the heading of a body whose centre stays on it."""
_CLOSE_M: Final = 1e-6
"""Tolerance for rounding when bounds of bodies are compared."""
_STRAIGHT_STEP_M: Final = 0.25
"""Distance between checked places straight ahead."""
_REAR_M: Final = 1.25
"""Distance from a body's centre back to the middle of these points, because bodies turn later than their centre."""
SPACING, PLACE, LEFT, REACH, HALF_LENGTH, HALF_WIDTH, CUT = range(3, 10)
"""Columns of ``Ways.bodies`` after ``X``, ``Y`` and ``YAW``."""
OWN, OTHER = range(2)
"""Columns of pairs of bodies."""
MET, OWN_IN, OWN_OUT, OTHER_IN, OTHER_OUT, ALONG, BLOCKED, BLOCKED_ALONG = range(8)
"""Columns of zones: whether two ways meet, then the fields of ``Zone``."""
_LOW_X, _HIGH_X, _LOW_Y, _HIGH_Y = range(4)
"""Columns of bounds."""
Sizes = tuple[float, float, float, float]
"""Half length and half width of two bodies."""
Poses = tuple[Floats, Rows]
"""Poses of bodies along their courses, one body after the other, shape ``(K, 4)``, and where each body's begin."""


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
    cut_m: float = _TRACK_M
    """The centre is in the middle between two points of the course, this far before and behind it: in bends it cuts the
    corner, as SUMO's vehicles do, whose ends are on the course. 0 for a vehicle that keeps the centre on it."""


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
    """Shape ``(W, 10)``, columns as in ``Way``: ``X``, ``Y``, ``YAW``, ``SPACING`` and so on until ``CUT``."""

    @classmethod
    def of(cls, ways: Sequence[Way]) -> "Ways":
        """Some ways together."""
        ends = np.cumsum([0, *(len(way.points) for way in ways)])
        bodies = np.array([(*way.pose, *way[1:4], *way[5:]) for way in ways])
        return cls(np.concatenate([way.points for way in ways]), ends[:-1], ends[1:], bodies)


@compiled
def way_point(points: Points, first: int, last: int, place: float) -> tuple[float, float]:
    """X and y at a position of ``points[first:last]``, counted in point distances; straight at both ends."""
    i = min(max(int(place), 0), last - first - 2) + first
    f = place - (i - first)
    x, y = points[i, X], points[i, Y]
    return x + f * (points[i + 1, X] - x), y + f * (points[i + 1, Y] - y)


@compiled
def pose_at(points: Points, first: int, last: int, spacing: float, s_m: float, left_m: float, cut_m: float) -> Pose:
    """x, y and the direction's cosine and sine of a body whose centre is at an arc length of ``points[first:last]``.

    The body points along a chord of its course, is ``left_m`` beside it, and cuts bends as if it were on the middle of
    a chord of ``2 * cut_m``. The points are ``spacing`` metres apart.
    """
    track_m = cut_m if cut_m > 0.0 else _TRACK_M
    xs, ys = way_point(points, first, last, (s_m - _REAR_M - track_m) / spacing)
    xe, ye = way_point(points, first, last, (s_m - _REAR_M + track_m) / spacing)
    dx, dy = xe - xs, ye - ys
    norm = np.sqrt(dx * dx + dy * dy) + 1e-9
    cos, sin = dx / norm, dy / norm
    x, y = way_point(points, first, last, (s_m - cut_m) / spacing)
    if cut_m > 0.0:
        ahead_x, ahead_y = way_point(points, first, last, (s_m + cut_m) / spacing)
        x, y = 0.5 * (x + ahead_x), 0.5 * (y + ahead_y)
    return x - sin * left_m, y + cos * left_m, cos, sin


@compiled
def follows_course(ways: Ways, row: int) -> bool:
    """Whether a body points along its course, within 6°."""
    yaw_rad, spacing_m, centre_m, left_m = ways.bodies[row, 2:6]
    first, last = ways.first[row], ways.last[row]
    _, _, cos, sin = pose_at(ways.points, first, last, spacing_m, centre_m, left_m, ways.bodies[row, CUT])
    return np.cos(yaw_rad) * cos + np.sin(yaw_rad) * sin > _ALONG_COURSE


@compiled
def straight_to_m(ways: Ways, own: int, other: int, reach_m: float) -> float:
    """Distance that a body drives straight ahead until it touches another one; infinite if it does not."""
    x, y, yaw_rad = ways.bodies[own, :3]
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    body, theirs = ways.bodies[own], ways.bodies[other]
    size = body[HALF_LENGTH], body[HALF_WIDTH], theirs[HALF_LENGTH], theirs[HALF_WIDTH]
    pose = theirs[X], theirs[Y], np.cos(theirs[YAW]), np.sin(theirs[YAW])
    for k in range(1, int(reach_m / _STRAIGHT_STEP_M) + 1):
        way_m = k * _STRAIGHT_STEP_M
        ahead = x + way_m * cos, y + way_m * sin, cos, sin
        if box_gap_m(ahead, pose, *size) <= 0.0:
            return way_m - _STRAIGHT_STEP_M
    return np.inf


@compiled
def way_poses(ways: Ways, used: Rows) -> Poses:
    """Poses of the used bodies (rows of ``ways``) along their courses, ``STEP_M`` apart.

    Returns:
        All poses, shape ``(K, 4)``, and the row at which those of each body begin, shape ``(W + 1,)``.
    """
    begins = np.zeros(ways.first.shape[0] + 1, np.intp)
    for n in used:
        begins[n + 1] = int(ways.bodies[n, REACH] / STEP_M) + 1
    for n in range(ways.first.shape[0]):
        begins[n + 1] += begins[n]
    poses = np.empty((begins[-1], 4))
    for n in range(ways.first.shape[0]):
        off = off_course(ways, n) if begins[n] < begins[n + 1] else (0.0, 0.0)
        for k in range(begins[n + 1] - begins[n]):
            pose = pose_after(ways, n, off, k * STEP_M)
            at = begins[n] + k
            poses[at, X], poses[at, Y], poses[at, COS], poses[at, SIN] = pose
    return poses, begins


@compiled
def off_course(ways: Ways, n: int) -> tuple[float, float]:
    """Difference between the pose of body ``n`` and its course: metres to the left, and radians."""
    body = ways.bodies[n]
    x, y, cos, sin = pose_at(
        ways.points, ways.first[n], ways.last[n], body[SPACING], body[PLACE], body[LEFT], body[CUT]
    )
    return cos * (body[Y] - y) - sin * (body[X] - x), wrapped_rad(body[YAW] - np.arctan2(sin, cos))


@compiled
def pose_after(ways: Ways, n: int, off: tuple[float, float], way_m: float) -> Pose:
    """Pose of body ``n`` after a distance; its present difference from the course, ``off``, decreases to zero."""
    body = ways.bodies[n]
    first, last, s_m = ways.first[n], ways.last[n], body[PLACE] + way_m
    x, y, cos, sin = pose_at(ways.points, first, last, body[SPACING], s_m, body[LEFT], body[CUT])
    if way_m > STRAIGHT_AFTER_M:
        return x, y, cos, sin
    left = 1.0 - way_m / STRAIGHT_AFTER_M
    aside, turned = left * off[0], left * off[1]
    c, s = np.cos(turned), np.sin(turned)
    return x - aside * sin, y + aside * cos, cos * c - sin * s, sin * c + cos * s


@compiled
def next_touch(own: Pose, theirs: Floats, sizes: Sizes, j: int) -> int:
    """First position on another path, from ``j`` on, that touches a body in a pose; the path's length if there is none.

    ``theirs`` has the poses on that path, shape ``(K, 4)``; ``sizes`` half lengths and widths, the body's own first.
    Places that are too far away to matter are stepped over: the distance changes by no more than the way does.
    """
    half_length, half_width, length, width = sizes
    around = np.sqrt(half_length**2 + half_width**2) + np.sqrt(length**2 + width**2)
    while j < theirs.shape[0]:
        dx, dy = theirs[j, X] - own[X], theirs[j, Y] - own[Y]
        gap = np.sqrt(dx * dx + dy * dy) - around
        if gap <= 0.0:
            pose = theirs[j, X], theirs[j, Y], theirs[j, COS], theirs[j, SIN]
            gap = box_gap_m(own, pose, half_length, half_width, length, width)
            if gap <= 0.0:
                return j
        j += max(int(gap / STEP_M), 1)
    return theirs.shape[0]


@compiled
def _entry_m(ways: Ways, n: int, k: int, theirs: Floats, sizes: Sizes) -> float:
    """Distance of a body until just before contact, between positions k − 1 and k, by bisection."""
    low, high, off = max(k - 1, 0) * STEP_M, k * STEP_M, off_course(ways, n)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if next_touch(pose_after(ways, n, off, middle), theirs, sizes, 0) == theirs.shape[0]:
            low = middle
        else:
            high = middle
    return low


@compiled
def _around(poses: Floats, begins: Rows) -> Floats:
    """Bounding box of each body's poses, shape ``(W, 4)``; inverted for a body without poses."""
    boxes = np.empty((begins.shape[0] - 1, 4))
    for n in range(boxes.shape[0]):
        boxes[n, _LOW_X], boxes[n, _HIGH_X], boxes[n, _LOW_Y], boxes[n, _HIGH_Y] = np.inf, -np.inf, np.inf, -np.inf
        for at in range(begins[n], begins[n + 1]):
            x, y = poses[at, X], poses[at, Y]
            boxes[n, _LOW_X], boxes[n, _HIGH_X] = min(boxes[n, _LOW_X], x), max(boxes[n, _HIGH_X], x)
            boxes[n, _LOW_Y], boxes[n, _HIGH_Y] = min(boxes[n, _LOW_Y], y), max(boxes[n, _HIGH_Y], y)
    return boxes


@compiled
def way_bounds(ways: Ways, used: Rows) -> Floats:
    """Bounding box of each used body's edges on its path: least and greatest x, then y; shape ``(W, 4)``, else NaN."""
    bounds = np.full((ways.first.shape[0], 4), np.nan)
    for n in used:
        if not np.isnan(bounds[n, _LOW_X]):
            continue
        first, last, body = ways.first[n], ways.last[n], ways.bodies[n]
        x, y, cos, sin = pose_at(ways.points, first, last, body[SPACING], body[PLACE], body[LEFT], body[CUT])
        aside = abs(cos * (body[Y] - y) - sin * (body[X] - x)) + abs(body[LEFT])
        margin = aside + np.sqrt(body[HALF_LENGTH] ** 2 + body[HALF_WIDTH] ** 2) + _CLOSE_M
        begin, end = (body[PLACE] - body[CUT]) / body[SPACING], (body[PLACE] + body[REACH] + body[CUT]) / body[SPACING]
        low_x, low_y = way_point(ways.points, first, last, begin)
        high_x, high_y = low_x, low_y
        x, y = way_point(ways.points, first, last, end)
        low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
        for at in range(first + max(int(begin), 0), min(first + int(max(end, 0.0)) + 1, last)):
            x, y = ways.points[at, X], ways.points[at, Y]
            low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
        bounds[n, _LOW_X], bounds[n, _HIGH_X] = low_x - margin, high_x + margin
        bounds[n, _LOW_Y], bounds[n, _HIGH_Y] = low_y - margin, high_y + margin
    return bounds


@compiled
def _near_each_other(own: Ways, others: Ways, pairs: Rows) -> Rows:
    """Pairs whose bounding boxes overlap; only these need poses."""
    a, b = way_bounds(own, pairs[:, OWN]), way_bounds(others, pairs[:, OTHER])
    near, count = np.empty_like(pairs), 0
    for p in range(pairs.shape[0]):
        i, n = pairs[p, OWN], pairs[p, OTHER]
        mine, theirs = a[i], b[n]
        beside_x = mine[_LOW_X] <= theirs[_HIGH_X] and theirs[_LOW_X] <= mine[_HIGH_X]
        if beside_x and mine[_LOW_Y] <= theirs[_HIGH_Y] and theirs[_LOW_Y] <= mine[_HIGH_Y]:
            near[count, OWN], near[count, OTHER] = i, n
            count += 1
    return near[:count]


@compiled
def zones_of(own: Ways, others: Ways, pairs: Rows, leads: bool) -> Floats:
    """The first zone in which the ways of each pair meet: ``(P, 8)``, whether they meet, then the fields of ``Zone``.

    A pair is an own and another body, shape ``(P, 2)``. A margin beside a body is part of its half width. Without
    ``leads``, of a body that leads on the same way only ``blocked_m`` and ``blocked_along`` are right.
    """
    out = np.empty((pairs.shape[0], _COLUMNS))
    near = _near_each_other(own, others, pairs)
    own_poses, their_poses = way_poses(own, near[:, OWN].copy()), way_poses(others, near[:, OTHER].copy())
    _search_poses(own, own_poses, others, their_poses, pairs, leads, out)
    return out


@compiled
def search_among(ways: Ways, pairs: Rows) -> Floats:
    """``zones_of`` without leads, where both bodies of a pair are of the same ways."""
    out = np.empty((pairs.shape[0], _COLUMNS))
    poses = way_poses(ways, _near_each_other(ways, ways, pairs).ravel())
    _search_poses(ways, poses, ways, poses, pairs, bool(0), out)  # a literal False would compile the search again
    return out


@compiled
def _search_poses(
    own: Ways, own_poses: Poses, others: Ways, their_poses: Poses, pairs: Rows, leads: bool, out: Floats
) -> None:
    """``zones_of`` with poses of both along their courses. Ways that stay apart as a whole are not looked at."""
    ways, own_begins = own_poses
    their_ways, their_begins = their_poses
    own_box, their_box = _around(ways, own_begins), _around(their_ways, their_begins)
    for p in range(pairs.shape[0]):
        i, n = pairs[p, OWN], pairs[p, OTHER]
        ahead = ways[own_begins[i] : own_begins[i + 1]]
        theirs = their_ways[their_begins[n] : their_begins[n + 1]]
        mine, other = own.bodies[i], others.bodies[n]
        sizes = mine[HALF_LENGTH], mine[HALF_WIDTH], other[HALF_LENGTH], other[HALF_WIDTH]
        far = _CLOSE_M + np.sqrt(sizes[0] ** 2 + sizes[1] ** 2) + np.sqrt(sizes[2] ** 2 + sizes[3] ** 2)
        low_x, high_x = their_box[n, _LOW_X] - far, their_box[n, _HIGH_X] + far
        low_y, high_y = their_box[n, _LOW_Y] - far, their_box[n, _HIGH_Y] + far
        met, s_in, s_out, q_in, q_out, course = 0.0, 0.0, np.inf, np.inf, 0.0, 0.0
        blocked, blocked_along = np.inf, 0.0
        apart = own_box[i, _HIGH_X] < low_x or own_box[i, _LOW_X] > high_x
        apart = apart or own_box[i, _HIGH_Y] < low_y or own_box[i, _LOW_Y] > high_y
        for k in range(0 if apart else ahead.shape[0]):
            pose = ahead[k, X], ahead[k, Y], ahead[k, COS], ahead[k, SIN]
            at = theirs.shape[0]
            if low_x <= pose[X] <= high_x and low_y <= pose[Y] <= high_y:
                at = next_touch(pose, theirs, sizes, 0)
            if at == theirs.shape[0]:
                if met > 0.0:
                    s_out = k * STEP_M
                    break
                continue
            if at == 0 and blocked == np.inf:
                blocked = _entry_m(own, i, k, theirs[:1], sizes)
                blocked_along = pose[COS] * theirs[at, COS] + pose[SIN] * theirs[at, SIN]
                if not leads and blocked_along > SAME_DIRECTION:
                    met = 1.0
                    break
            if met == 0.0:
                met, s_in = 1.0, _entry_m(own, i, k, theirs, sizes)
            q_in = min(q_in, at * STEP_M)
            while at < theirs.shape[0]:
                end, at = at, next_touch(pose, theirs, sizes, at + 1)
            q_out = max(q_out, end * STEP_M)
            course = pose[COS] * theirs[end, COS] + pose[SIN] * theirs[end, SIN]
        out[p, MET], out[p, OWN_IN], out[p, OWN_OUT], out[p, OTHER_IN] = met, s_in, s_out, q_in
        out[p, OTHER_OUT], out[p, ALONG] = q_out + STEP_M, course
        out[p, BLOCKED], out[p, BLOCKED_ALONG] = blocked, blocked_along
