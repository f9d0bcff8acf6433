"""Predicts a vehicle's course: the centre line of its lanes along its route, with movements across junctions.

The outlook is what every driver expects of every vehicle at one step: its way from now on, and its right of way.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import cos, sin
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats, Ids, Points, Rows
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.conflicts.yielding import Rank, rank_inside, rank_of, tight_lanes
from siren_ros.simulation.conflicts.zones import (
    CUT,
    HALF_LENGTH,
    HALF_WIDTH,
    LEFT,
    OWN,
    PLACE,
    SPACING,
    STEP_M,
    Ways,
)
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, LaneKind, RoadNetwork
from siren_ros.simulation.roads.sites import overlaps
from siren_ros.simulation.world.actors import Indices, Owner, TrafficState

# These are no parameters: compiled loops and caches contain the resolution and length of courses.
SPACING_M: Final = 1.0
"""Largest distance between points of a course."""
_AHEAD_M: Final = 80.0
"""Length of a course beyond its first lane."""
_FIRST_ROWS: Final = 256
"""Initial size of a new book; it grows."""
_STRAIGHT: Final = -1
_UNKNOWN: Final = -2
"""Number that stands for a course in no book."""
_FIRST_POINT, _LAST_POINT, _FIRST_MOVEMENT, _LAST_MOVEMENT = range(4)
"""Rows of the ends of courses, as in ``CoursesOfStep.ends``."""
_PRIORITY: Final = int(Rank.PRIORITY)
_STRAIGHT_M: Final = 60.0
"""Length of the course of a vehicle off the road."""
_WALK_M: Final = 10.0
"""Length of the course of a pedestrian, who has no route: the width of a street, or seven seconds."""


_NONE: Final = np.empty(0, np.intp)
_NO_PAIRS: Final = np.empty((0, 2), np.intp)


@dataclass(frozen=True)
class Entry:
    """A movement across a junction on a course."""

    start_m: float
    """Arc length at which the junction begins."""
    connection: Connection


@dataclass(frozen=True, eq=False)
class Course:
    """A path with equally spaced points; it continues straight at both ends."""

    points: npt.NDArray[np.float64]
    """Points, shape ``(K, 2)``."""
    spacing_m: float
    limit_mps: Floats
    """Speed limit of the lane at each point, shape ``(K,)``."""
    entries: tuple[Entry, ...] = ()
    """Movements in driving order."""
    lanes: Rows = field(default_factory=_NONE.copy)
    """Lane at each point, shape ``(K,)``."""

    @property
    def length_m(self) -> float:
        """Length of the whole course."""
        return self.spacing_m * (len(self.points) - 1)

    def limit_at(self, s_m: float) -> float:
        """Speed limit at an arc length."""
        return float(self.limit_mps[min(max(round(s_m / self.spacing_m), 0), len(self.limit_mps) - 1)])

    def entry_at(self, s_m: float) -> Entry | None:
        """Last movement that begins before an arc length; None before the first."""
        return next((entry for entry in reversed(self.entries) if entry.start_m <= s_m), None)

    @classmethod
    def straight(cls, x_m: float, y_m: float, yaw_rad: float, length_m: float = _STRAIGHT_M) -> "Course":
        """Straight course from a point."""
        s = np.arange(0.0, length_m, SPACING_M)
        points = np.stack((x_m + s * cos(yaw_rad), y_m + s * sin(yaw_rad)), axis=-1)
        return cls(points, SPACING_M, np.full(len(s), np.inf))


Places = tuple[Floats, Floats, Floats]
"""x, y and yaw of all vehicles."""


class Rights(NamedTuple):
    """Right of way and speed limits on the courses of a step, as arrays for compiled loops."""

    limit_mps: Floats
    """Speed limit at each point of ``Ways.points``."""
    first: Rows
    """Index of each course's first movement, shape ``(N,)``."""
    last: Rows
    """End index of each course's movements."""
    start_m: Floats
    """Arc length on the course at which each movement begins."""
    rank: npt.NDArray[np.intp]
    """Present ``Rank`` of each movement."""
    lanes: Rows = _NONE
    """Lane at each point of ``Ways.points``; −1 off the road."""
    overlying: Rows = _NO_PAIRS
    """Pairs of lanes that lie over each other in ways that SUMO does not know, shape ``(P, 2)``."""
    privileged: Rows = _NONE
    """Rows of the EMVs that SUMO does not drive: SUMO drives those without privilege."""
    tight: Rows = _NO_PAIRS
    """Pairs of lanes as in ``tight_lanes``, shape ``(P, 2)``."""


@dataclass(frozen=True, eq=False)
class CoursesOfStep:
    """Courses of all vehicles of a ``TrafficState``; arrays of shape ``(N,)`` have its rows."""

    traffic: TrafficState
    number: Rows
    """Number of each course in its book; −1 for straight ahead."""
    points: npt.NDArray[np.float64]
    """Points of all courses, one course after the other, shape ``(K, 2)``."""
    limit_mps: Floats
    """Speed limit at each point, shape ``(K,)``."""
    lanes: Rows
    """Lane at each point; −1 off the road."""
    ends: tuple[Rows, Rows, Rows, Rows]
    """Begin and end of each course's points, and of its movements."""
    spacing_m: Floats


class _Stack:
    """An array that grows at its end."""

    def __init__(self, *shape: int, dtype: npt.DTypeLike = np.float64) -> None:
        self.rows: npt.NDArray[Any] = np.empty((_FIRST_ROWS, *shape), dtype)
        self.used = 0

    def add(self, rows: npt.ArrayLike) -> int:
        """Append rows; returns where they begin."""
        added, first = np.asarray(rows, self.rows.dtype), self.used
        self.used += len(added)
        self.reserve(0)
        self.rows[first : self.used] = added
        return first

    def reserve(self, more: int) -> npt.NDArray[Any]:
        """All rows, with space for more behind those in use."""
        end = self.used + more
        if end > len(self.rows):
            self.rows = np.concatenate((self.rows, np.empty((end, *self.rows.shape[1:]), self.rows.dtype)))
        return self.rows


def _straight_of(traffic: TrafficState, row: int) -> Course:
    walks = traffic.route_offset[row] == traffic.route_offset[row + 1]
    pose = float(traffic.x_m[row]), float(traffic.y_m[row]), float(traffic.yaw_rad[row])
    return Course.straight(*pose, _WALK_M if walks else _STRAIGHT_M)


@compiled
def _lay_straight_ways(
    rows: Rows, poses: Places, offset: Indices, used: int, points: Points, limit_mps: Floats, ends: Rows
) -> None:
    """Append the straight courses of ``_straight_of`` and store where each begins and ends."""
    x_m, y_m, yaw_rad = poses
    for row in rows:
        length_m = _WALK_M if offset[row] == offset[row + 1] else _STRAIGHT_M
        cos, sin = np.cos(yaw_rad[row]), np.sin(yaw_rad[row])
        ends[_FIRST_POINT, row], ends[_FIRST_MOVEMENT, row], ends[_LAST_MOVEMENT, row] = used, 0, 0
        for k in range(round(length_m / SPACING_M)):
            s_m = k * SPACING_M
            points[used, X], points[used, Y] = x_m[row] + s_m * cos, y_m[row] + s_m * sin
            limit_mps[used] = np.inf
            used += 1
        ends[_LAST_POINT, row] = used


class CourseBook:
    """Caches the courses of a map; each is computed once.

    It remembers the last step too: most vehicles have the course that they had there.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._numbers: dict[tuple[int, bytes], int] = {}
        self._courses: list[Course] = []
        self._points, self._limits, self._lanes = _Stack(2), _Stack(), _Stack(dtype=np.intp)
        self._overlying = np.array(list(overlaps(network)), np.intp).reshape(-1, 2)
        self._tight = np.array(sorted(tight_lanes(network)), np.intp).reshape(-1, 2)
        self._ends, self._spacing = _Stack(4, dtype=np.intp), _Stack()
        self._starts, self._ranks = _Stack(), _Stack(dtype=np.intp)
        self._movements: list[Connection] = []
        self._of_signal: dict[str | None, list[int]] = {}
        self._states: Mapping[str, str] = {}
        self._step: CoursesOfStep | None = None

    def courses_of(self, traffic: TrafficState) -> CoursesOfStep:
        """Courses of all vehicles; those off the road go straight on."""
        last = self._step
        if last is not None and last.traffic is traffic:
            return last
        number = np.full(len(traffic), _UNKNOWN, np.intp)
        if last is not None:
            before = last.traffic
            then = before.actor_id, before.lane, before.route_offset, before.route_edges, last.number
            now = traffic.actor_id, traffic.lane, traffic.route_offset, traffic.route_edges
            if _keep_courses(then, now, number) and len(before) == len(traffic):
                self._step = replace(last, traffic=traffic)
                return self._step
        for row in (number == _UNKNOWN).nonzero()[0].tolist():
            lane = int(traffic.lane[row])
            number[row] = _STRAIGHT if lane == NO_LANE else self._number(lane, traffic.route_of_row(row))
        self._step = self._joined(traffic, number)
        return self._step

    def _joined(self, traffic: TrafficState, number: Rows) -> CoursesOfStep:
        ends, spacing = self._ends.rows[number].T.copy(), self._spacing.rows[number]
        straight, used = (number == _STRAIGHT).nonzero()[0], self._points.used
        if len(straight):
            most = len(straight) * round(_STRAIGHT_M / SPACING_M)
            stacks = self._points.reserve(most), self._limits.reserve(most)
            self._lanes.reserve(most)[used:] = NO_LANE
            poses = traffic.x_m, traffic.y_m, traffic.yaw_rad
            _lay_straight_ways(straight, poses, traffic.route_offset, used, *stacks, ends)
            spacing[straight] = SPACING_M
        of_points = self._points.rows, self._limits.rows, self._lanes.rows
        return CoursesOfStep(traffic, number, *of_points, tuple(ends), spacing)

    def course_of(self, traffic: TrafficState, row: int) -> Course:
        """The course of the vehicle in a row."""
        number = int(self.courses_of(traffic).number[row])
        if number != _STRAIGHT:
            return self._courses[number]
        return _straight_of(traffic, row)

    def along(self, lane: int, route: Indices) -> Course:
        """The course from the start of a lane, which may cross a junction, to the end of the route.

        The route begins with the present edge, or the one before the junction.
        """
        return self._courses[self._number(lane, route)]

    def _number(self, lane: int, route: Indices) -> int:
        key = (lane, route.tobytes())
        number = self._numbers.get(key)
        if number is None:
            course = _course(self._network, lane, tuple(route.tolist()))
            number = self._numbers[key] = len(self._courses)
            self._courses.append(course)
            begin = self._points.add(course.points)
            self._limits.add(course.limit_mps)
            self._lanes.add(course.lanes)
            first = self._starts.add([entry.start_m for entry in course.entries])
            self._ranks.add([rank_of(entry.connection, self._states) for entry in course.entries])
            self._ends.add([(begin, self._points.used, first, self._starts.used)])
            self._spacing.add([course.spacing_m])
            for at, entry in enumerate(course.entries, start=first):
                self._movements.append(entry.connection)
                self._of_signal.setdefault(entry.connection.signal_id, []).append(at)
        return number

    def rights_of(self, courses: CoursesOfStep, signals: Mapping[str, str]) -> Rights:
        """Right of way and limits on the courses of a step, given the state of each signal."""
        if signals != self._states:
            changed = dict.fromkeys(signal for signal, _ in signals.items() ^ self._states.items())
            self._states = dict(signals)
            self._ranks.rows = self._ranks.rows.copy()
            for signal in changed:
                for at in self._of_signal.get(signal, ()):
                    self._ranks.rows[at] = rank_of(self._movements[at], signals)
        movements = *courses.ends[2:], self._starts.rows, self._ranks.rows
        emvs = np.isin(courses.traffic.actor_id, [emv.actor_id for emv in courses.traffic.emvs])
        privileged = (emvs & (courses.traffic.owner != Owner.SUMO)).nonzero()[0]
        return Rights(courses.limit_mps, *movements, courses.lanes, self._overlying, privileged, self._tight)


@compiled
def _keep_courses(
    then: tuple[Ids, Indices, Indices, Indices, Rows], now: tuple[Ids, Indices, Indices, Indices], number: Rows
) -> bool:
    """Reuse the courses of vehicles whose lane and route did not change; returns whether that holds for all.

    Both steps hold ids, lanes, where routes begin, and their edges; the other one its courses too.
    """
    then_id, then_lane, then_offset, then_edges, then_number = then
    now_id, now_lane, now_offset, now_edges = now
    row, all_same = 0, True
    for at in range(len(now_id)):
        while row < len(then_id) and then_id[row] < now_id[at]:
            row += 1
        count = now_offset[at + 1] - now_offset[at]
        same = row < len(then_id) and then_id[row] == now_id[at] and now_lane[at] >= 0
        same = same and then_lane[row] == now_lane[at] and count == then_offset[row + 1] - then_offset[row]
        for k in range(count if same else 0):
            same = same and then_edges[then_offset[row] + k] == now_edges[now_offset[at] + k]
        if same:
            number[at] = then_number[row]
        all_same = all_same and same
    return all_same


def _course(network: RoadNetwork, lane: int, route: tuple[int, ...]) -> Course:
    lanes = [lane]
    movements: list[tuple[int, Connection]] = []
    if network.edges[network.lanes[lane].edge].internal:
        inside = _movement_over(network, lane, route)
        if inside is not None:
            movements.append((0, inside))
            lanes += [*inside.via[inside.via.index(lane) + 1 :], inside.to_lane]
    ahead = network.length_m(lanes[1:])
    while ahead < _AHEAD_M:
        connection = _movement_from(network, lanes[-1], route)
        if connection is None:
            break
        movements.append((len(lanes), connection))
        lanes += [*connection.via, connection.to_lane]
        ahead += network.length_m((*connection.via, connection.to_lane))
    return _joined(network, lanes, movements)


def _joined(network: RoadNetwork, lanes: list[int], movements: list[tuple[int, Connection]]) -> Course:
    parts = [network.lanes[item].centre for item in lanes]
    starts = np.concatenate(([0.0], np.cumsum([part.length_m for part in parts])))
    line = Polyline.joined(parts)
    most = starts[1] + _AHEAD_M
    if line.length_m > most:
        line = line.cut(0.0, most)
    even = line.resampled(SPACING_M)
    spacing = even.length_m / (len(even.points) - 1)
    on = np.clip(np.searchsorted(starts, spacing * np.arange(len(even.points)), side="right") - 1, 0, len(lanes) - 1)
    limits, numbers = np.array([network.lanes[item].speed_limit_mps for item in lanes]), np.array(lanes, np.intp)
    entries = tuple(Entry(float(starts[number]), connection) for number, connection in movements)
    return Course(even.points, spacing, limits[on], entries, numbers[on])


def _movement_from(network: RoadNetwork, lane: int, route: tuple[int, ...]) -> Connection | None:
    """Movement to the route's next edge; from the nearest lane if the present one does not lead there."""
    edge = network.lanes[lane].edge
    if edge not in route[:-1]:
        return None
    after = route[route.index(edge) + 1]
    if network.lanes[lane].kind is LaneKind.CYCLE:
        for connection in network.cycle_connections_from.get(lane, ()):
            if network.lanes[connection.to_lane].edge == after:
                return connection
    position = network.lanes[lane].position
    choices = [
        connection
        for item in network.edges[edge].lanes
        for connection in network.connections_from.get(item, ())
        if network.lanes[connection.to_lane].edge == after
    ]
    return min(choices, key=lambda choice: abs(network.lanes[choice.from_lane].position - position), default=None)


def _movement_over(network: RoadNetwork, lane: int, route: tuple[int, ...]) -> Connection | None:
    """Movement that an internal lane belongs to; if several share it, the one along the route."""
    choices = network.connections_over.get(lane) or network.cycle_connections_over.get(lane, ())
    along = (choice for choice in choices if network.lanes[choice.to_lane].edge in route)
    return next(along, choices[0] if choices else None)


class Outlook:
    """Predicted paths of all vehicles of a ``TrafficState``, computed when needed.

    The route stands for the turn signal: a driver who will turn shows it.
    """

    def __init__(self, traffic: TrafficState, book: CourseBook, half_length_m: Floats, half_width_m: Floats) -> None:
        """Take the bodies' sizes, with rows as in ``traffic``."""
        self._traffic = traffic
        self._book = book
        self.half_length_m = half_length_m
        self._half_width_m = half_width_m

    @cached_property
    def signals(self) -> Mapping[str, str]:
        """State of each signal."""
        return {signal.signal_id: signal.state for signal in self._traffic.signals}

    def course(self, row: int) -> Course:
        """The course of the vehicle in a row."""
        return self._book.course_of(self._traffic, row)

    def centre_m(self, row: int) -> float:
        """Arc length of a vehicle's centre on its course."""
        return float(self.ways.bodies[row, PLACE])

    def front_m(self, row: int) -> float:
        """Arc length of a vehicle's front on its course."""
        return self.centre_m(row) + float(self.half_length_m[row])

    @cached_property
    def ways(self) -> Ways:
        """All vehicles on their courses, with a reach of 0."""
        traffic, courses = self._traffic, self._book.courses_of(self._traffic)
        places = traffic.lane, traffic.lane_position_m, traffic.lateral_offset_m
        poses = traffic.x_m, traffic.y_m, traffic.yaw_rad
        bodies = _bodies_of(poses, places, courses.spacing_m, self.half_length_m, self._half_width_m)
        return Ways(courses.points, *courses.ends[:2], bodies)

    @cached_property
    def rights(self) -> Rights:
        """Right of way and speed limits on all courses."""
        return self._book.rights_of(self._book.courses_of(self._traffic), self.signals)

    def rank(self, row: int, way_m: float) -> Rank:
        """Right of way of a vehicle after its centre has moved a distance."""
        return Rank(rank_at(self.ways, self.rights, row, way_m))

    def limit_mps(self, row: int, way_m: float) -> float:
        """Speed limit of a vehicle's course after its centre has moved a distance."""
        return float(limit_at_mps(self.ways, self.rights, row, way_m))


@compiled
def _bodies_of(
    poses: Places,
    places: tuple[Indices, Floats, Floats],
    spacing_m: Floats,
    half_length_m: Floats,
    half_width_m: Floats,
) -> Floats:
    """``Ways.bodies`` of vehicles in traffic."""
    (x_m, y_m, yaw_rad), (lane, front_m, left_m) = poses, places
    bodies = np.zeros((len(x_m), CUT + 1))
    for n in range(len(x_m)):
        bodies[n, X], bodies[n, Y], bodies[n, YAW], bodies[n, SPACING] = x_m[n], y_m[n], yaw_rad[n], spacing_m[n]
        bodies[n, PLACE] = front_m[n] - half_length_m[n] if lane[n] >= 0 else 0.0
        bodies[n, LEFT] = left_m[n]
        bodies[n, HALF_LENGTH], bodies[n, HALF_WIDTH] = half_length_m[n], half_width_m[n]
        bodies[n, CUT] = half_length_m[n]
    return bodies


@compiled
def rank_at(ways: Ways, rights: Rights, row: int, way_m: float) -> int:
    """``Outlook.rank`` for compiled loops."""
    front_m = ways.bodies[row, PLACE] + ways.bodies[row, HALF_LENGTH]
    rank, start_m = _PRIORITY, np.inf
    for at in range(rights.first[row], rights.last[row]):
        if rights.start_m[at] <= front_m + way_m:
            rank, start_m = rights.rank[at], rights.start_m[at]
    return rank_inside(rank, (rights.privileged == row).any()) if front_m > start_m else rank


@compiled
def limit_at_mps(ways: Ways, rights: Rights, row: int, way_m: float) -> float:
    """``Outlook.limit_mps`` for compiled loops."""
    place = int(np.rint((ways.bodies[row, PLACE] + way_m) / ways.bodies[row, SPACING]))
    return rights.limit_mps[ways.first[row] + min(max(place, 0), ways.last[row] - ways.first[row] - 1)]


@compiled
def are_in(ways: Ways, rights: Rights, pairs: Rows, bodies: tuple[int, int], ways_m: tuple[float, float]) -> bool:
    """Whether two bodies, after these ways, are in lanes of one of the pairs, ``(P, 2)``."""
    (row, other), (own_m, other_m) = bodies, ways_m
    for p in range(len(pairs)):
        lane, over = pairs[p]
        if _is_in(ways, rights, row, own_m, STEP_M, lane) and _is_in(ways, rights, other, other_m, STEP_M, over):
            return True
    return False


@compiled
def come_to(ways: Ways, rights: Rights, pairs: Rows, ahead_m: Floats) -> Flags:
    """Which bodies are in the first lane of a pair, ``(P, 2)``, or come there within ``ahead_m``, shape ``(N,)``."""
    found = np.zeros(len(ahead_m), np.bool_)
    for row in range(len(ahead_m)):
        for p in range(len(pairs)):
            found[row] = found[row] or _is_in(ways, rights, row, 0.0, ahead_m[row], pairs[p, OWN])
    return found


@compiled
def _is_in(ways: Ways, rights: Rights, row: int, way_m: float, ahead_m: float, lane: int) -> bool:
    """Whether a body, after it has driven a way, is in a lane with any part of its length, or within some metres."""
    first, count, spacing_m = ways.first[row], ways.last[row] - ways.first[row], ways.bodies[row, SPACING]
    centre_m, half_m = ways.bodies[row, PLACE] + way_m, ways.bodies[row, HALF_LENGTH]
    low, high = int((centre_m - half_m) / spacing_m), int((centre_m + half_m + ahead_m) / spacing_m) + 1
    return bool((rights.lanes[first + max(low, 0) : first + min(high, count - 1) + 1] == lane).any())
