"""Where a vehicle will go: the centre line of its lanes along its route, with the movements across junctions.

The outlook is what every driver expects of every vehicle at one step: its way from now on, and its right of way.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, sin
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.conflicts.yielding import Rank, rank_inside, rank_of
from siren_ros.conflicts.zones import TRACK_M, Ways
from siren_ros.numerics.arrays import Floats, Rows
from siren_ros.numerics.compiled import compiled
from siren_ros.numerics.geometry import Polyline
from siren_ros.roads.road_network import NO_LANE, Connection, RoadNetwork
from siren_ros.world.traffic_state import Indices, TrafficState

# No parameters: resolution and reach of courses, which compiled loops and memories of courses hold.
SPACING_M: Final = 1.0
"""Distance between the points of a course, at most."""
_AHEAD_M: Final = 80.0
"""How far a course leads beyond the lane on which it begins."""
_FIRST_POINTS: Final = 4096
"""Room for points in a new book; it grows."""
_STRAIGHT_M: Final = 60.0
"""Length of the course of a vehicle that is off the road."""


@dataclass(frozen=True)
class Entry:
    """A movement across a junction that a course takes."""

    start_m: float
    """Arc length at which the junction begins."""
    connection: Connection


@dataclass(frozen=True, eq=False)
class Course:
    """A way with points at a uniform distance; it goes straight on before its start and after its end."""

    points: npt.NDArray[np.float64]
    """Shape ``(K, 2)``."""
    spacing_m: float
    limit_mps: Floats
    """Speed limit of the lane below each point, shape ``(K,)``."""
    entries: tuple[Entry, ...] = ()
    """In driving order."""
    first: int = -1
    """Where its points begin among those of its ``CourseBook``; −1 for a course of no book."""

    @property
    def length_m(self) -> float:
        """Length of the whole course."""
        return self.spacing_m * (len(self.points) - 1)

    def limit_at(self, s_m: float) -> float:
        """Speed limit at an arc length."""
        return float(self.limit_mps[min(max(round(s_m / self.spacing_m), 0), len(self.limit_mps) - 1)])

    def entry_at(self, s_m: float) -> Entry | None:
        """The last movement that begins before an arc length; None before the first."""
        return next((entry for entry in reversed(self.entries) if entry.start_m <= s_m), None)

    @classmethod
    def straight(cls, x_m: float, y_m: float, yaw_rad: float) -> "Course":
        """The way straight ahead of a point."""
        s = np.arange(0.0, _STRAIGHT_M, SPACING_M)
        points = np.stack((x_m + s * cos(yaw_rad), y_m + s * sin(yaw_rad)), axis=-1)
        return cls(points, SPACING_M, np.full(len(s), np.inf))


@dataclass(frozen=True, eq=False)
class CoursesOfStep:
    """The courses of all vehicles of a ``TrafficState``; arrays of shape ``(N,)`` have its rows."""

    traffic: TrafficState
    courses: tuple[Course, ...]
    points: npt.NDArray[np.float64]
    """Points of these courses and of others, one after the other, shape ``(K, 2)``."""
    first: Rows
    """Where the points of each course begin in ``points``."""
    last: Rows
    """Where they end."""
    spacing_m: Floats


class CourseBook:
    """The courses of a map, each worked out once: a memory of pure results.

    It remembers the last step too: most vehicles have the course that they had there.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._courses: dict[tuple[int, bytes], Course] = {}
        self._points = np.empty((_FIRST_POINTS, 2))
        self._used = 0
        self._step: CoursesOfStep | None = None

    def courses_of(self, traffic: TrafficState) -> CoursesOfStep:
        """The courses of all vehicles; those off the road go straight on."""
        last = self._step
        if last is not None and last.traffic is traffic:
            return last
        kept = np.full(len(traffic), -1, np.intp)
        if last is not None:
            before = last.traffic
            routes = before.route_offset, before.route_edges, traffic.route_offset, traffic.route_edges
            _same_courses(before.actor_id, before.lane, traffic.actor_id, traffic.lane, *routes, kept)
        known = () if last is None else last.courses
        courses = tuple(known[at] if at >= 0 else self._course(traffic, row) for row, at in enumerate(kept.tolist()))
        if last is not None and len(courses) == len(known) and (kept == np.arange(len(kept))).all():
            self._step = replace(last, traffic=traffic, points=self._points)
            return self._step
        first = np.array([course.first for course in courses], dtype=np.intp)
        counts = np.array([len(course.points) for course in courses], dtype=np.intp)
        points, straight = self._points, [course.points for course in courses if course.first < 0]
        if straight:
            points = np.concatenate((self._points[: self._used], *straight))
            first[first < 0] = self._used + np.cumsum([0, *map(len, straight[:-1])])
        spacing = np.array([course.spacing_m for course in courses])
        self._step = CoursesOfStep(traffic, courses, points, first, first + counts, spacing)
        return self._step

    def _course(self, traffic: TrafficState, row: int) -> Course:
        lane = int(traffic.lane[row])
        if lane == NO_LANE:
            return Course.straight(float(traffic.x_m[row]), float(traffic.y_m[row]), float(traffic.yaw_rad[row]))
        return self.along(lane, traffic.route_of_row(row))

    def along(self, lane: int, route: Indices) -> Course:
        """The course from the start of a lane, which may cross a junction, to the end of the route.

        The route begins with the present edge, or the one before the junction.
        """
        key = (lane, route.tobytes())
        course = self._courses.get(key)
        if course is None:
            course = _course(self._network, lane, tuple(route.tolist()))
            course = self._courses[key] = replace(course, first=self._keep(course.points))
        return course

    def _keep(self, points: npt.NDArray[np.float64]) -> int:
        """Where points that are added to those of all courses begin."""
        first, self._used = self._used, self._used + len(points)
        if self._used > len(self._points):
            self._points = np.concatenate((self._points, np.empty((self._used, 2))))
        self._points[first : self._used] = points
        return first


@compiled
def _same_courses(
    then_id: Any, then_lane: Any, now_id: Any, now_lane: Any,
    then_offset: Any, then_edges: Any, now_offset: Any, now_edges: Any, kept: Any,
) -> None:  # fmt: skip
    """Fill in each vehicle's row at another step where its course is the same: lane and route have not changed."""
    then = 0
    for now in range(len(now_id)):
        while then < len(then_id) and then_id[then] < now_id[now]:
            then += 1
        if then == len(then_id) or then_id[then] != now_id[now]:
            continue
        count = now_offset[now + 1] - now_offset[now]
        same = now_lane[now] >= 0 and then_lane[then] == now_lane[now]
        same = same and count == then_offset[then + 1] - then_offset[then]
        for k in range(count if same else 0):
            same = same and then_edges[then_offset[then] + k] == now_edges[now_offset[now] + k]
        if same:
            kept[now] = then


def _course(network: RoadNetwork, lane: int, route: tuple[int, ...]) -> Course:
    lanes = [lane]
    movements: list[tuple[int, Connection]] = []
    if network.edges[network.lanes[lane].edge].internal:
        inside = _movement_over(network, lane, route)
        if inside is not None:
            movements.append((0, inside))
            lanes += [*inside.via[inside.via.index(lane) + 1 :], inside.to_lane]
    ahead = sum(network.lanes[item].length_m for item in lanes[1:])
    while ahead < _AHEAD_M:
        connection = _movement_from(network, lanes[-1], route)
        if connection is None:
            break
        movements.append((len(lanes), connection))
        lanes += [*connection.via, connection.to_lane]
        ahead += sum(network.lanes[item].length_m for item in (*connection.via, connection.to_lane))
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
    limits = np.array([network.lanes[item].speed_limit_mps for item in lanes])
    entries = tuple(Entry(float(starts[number]), connection) for number, connection in movements)
    return Course(even.points, spacing, limits[on], entries)


def _movement_from(network: RoadNetwork, lane: int, route: tuple[int, ...]) -> Connection | None:
    """The movement to the route's next edge, that of the nearest lane where the present one does not lead there."""
    edge = network.lanes[lane].edge
    if edge not in route[:-1]:
        return None
    after = route[route.index(edge) + 1]
    position = network.lanes[lane].position
    choices = [
        connection
        for item in network.edges[edge].lanes
        for connection in network.connections_from.get(item, ())
        if network.lanes[connection.to_lane].edge == after
    ]
    return min(choices, key=lambda choice: abs(network.lanes[choice.from_lane].position - position), default=None)


def _movement_over(network: RoadNetwork, lane: int, route: tuple[int, ...]) -> Connection | None:
    """The movement that an internal lane belongs to, that along the route where several share the lane."""
    choices = network.connections_over.get(lane, ())
    along = (choice for choice in choices if network.lanes[choice.to_lane].edge in route)
    return next(along, choices[0] if choices else None)


class Outlook:
    """The ways of all vehicles of a ``TrafficState``, worked out when they are asked for.

    The route stands for the turn signal: a driver who will turn shows it.
    """

    def __init__(self, traffic: TrafficState, book: CourseBook, half_length_m: Floats, half_width_m: Floats) -> None:
        """Bodies have rows as in ``traffic``."""
        self._traffic = traffic
        self._book = book
        self.half_length_m = half_length_m
        self._half_width_m = half_width_m

    @cached_property
    def signals(self) -> Mapping[str, str]:
        """State of each signal."""
        return {signal.signal_id: signal.state for signal in self._traffic.signals}

    @cached_property
    def _courses(self) -> CoursesOfStep:
        return self._book.courses_of(self._traffic)

    def course(self, row: int) -> Course:
        """The course of the vehicle in a row."""
        return self._courses.courses[row]

    def centre_m(self, row: int) -> float:
        """Arc length of a vehicle's centre on its course."""
        on_road = self._traffic.lane[row] >= 0
        return float(self._traffic.lane_position_m[row] - self.half_length_m[row]) if on_road else 0.0

    def front_m(self, row: int) -> float:
        """Arc length of a vehicle's front on its course."""
        return self.centre_m(row) + float(self.half_length_m[row])

    @cached_property
    def ways(self) -> Ways:
        """All vehicles on their courses, row by row, with a reach of 0."""
        traffic, courses = self._traffic, self._courses
        bodies = np.empty((len(traffic), 10))
        centre_m = np.where(traffic.lane >= 0, traffic.lane_position_m - self.half_length_m, 0.0)
        bodies[:, 0], bodies[:, 1], bodies[:, 2] = traffic.x_m, traffic.y_m, traffic.yaw_rad
        bodies[:, 3], bodies[:, 4] = courses.spacing_m, centre_m
        bodies[:, 5], bodies[:, 6] = traffic.lateral_offset_m, 0.0
        bodies[:, 7], bodies[:, 8], bodies[:, 9] = self.half_length_m, self._half_width_m, TRACK_M
        return Ways(courses.points, courses.first, courses.last, bodies)

    def ways_of(self, rows: Rows, reach_m: Floats) -> Ways:
        """Some vehicles on their courses, with how far ahead of each may be looked."""
        ways = self.ways
        bodies = ways.bodies[rows]
        bodies[:, 6] = reach_m
        return Ways(ways.points, ways.first[rows], ways.last[rows], bodies)

    def rank(self, row: int, way_m: float) -> Rank:
        """Right of way of a vehicle at a place, given by the way of its centre to it."""
        front = self.front_m(row)
        entry = self.course(row).entry_at(front + way_m)
        if entry is None:
            return Rank.PRIORITY
        rank = rank_of(entry.connection, self.signals)
        return rank_inside(rank) if front > entry.start_m else rank

    def limit_mps(self, row: int, way_m: float) -> float:
        """Speed limit at a place of a vehicle's course."""
        return self.course(row).limit_at(self.centre_m(row) + way_m)
