"""What every driver expects of every vehicle at one step: its way from now on, and its right of way."""

from collections.abc import Mapping
from functools import cached_property

from siren_ros.conflicts.course import Course, CourseBook
from siren_ros.conflicts.right_of_way import Rank, rank_inside, rank_of
from siren_ros.conflicts.zones import Way
from siren_ros.numerics.arrays import Floats
from siren_ros.roads.road_network import NO_LANE
from siren_ros.world.traffic_state import TrafficState


class Outlook:
    """The ways of all vehicles of a ``TrafficState``, worked out when they are asked for.

    The route stands for the turn signal: a driver who will turn shows it.
    """

    def __init__(self, traffic: TrafficState, book: CourseBook, half_length_m: Floats, half_width_m: Floats) -> None:
        """What is to be expected from a step on.

        Args:
            traffic: The step.
            book: Courses of the map.
            half_length_m: Half the length of each vehicle, rows as in ``traffic``.
            half_width_m: Half the width.
        """
        self._traffic = traffic
        self._book = book
        self._half_length_m = half_length_m
        self._half_width_m = half_width_m
        self._courses: dict[int, Course] = {}

    @property
    def half_length_m(self) -> Floats:
        """Half the length of each vehicle."""
        return self._half_length_m

    @cached_property
    def signals(self) -> Mapping[str, str]:
        """State of each signal."""
        return {signal.signal_id: signal.state for signal in self._traffic.signals}

    def course(self, row: int) -> Course:
        """The course of the vehicle in a row."""
        found = self._courses.get(row)
        if found is None:
            traffic = self._traffic
            lane, route = int(traffic.lane[row]), traffic.route_of_row(row)
            if lane == NO_LANE:
                found = Course.straight(float(traffic.x_m[row]), float(traffic.y_m[row]), float(traffic.yaw_rad[row]))
            else:
                found = self._book.along(lane, route)
            self._courses[row] = found
        return found

    def centre_m(self, row: int) -> float:
        """Arc length of a vehicle's centre on its course."""
        traffic = self._traffic
        on_road = traffic.lane[row] >= 0
        return float(traffic.lane_position_m[row] - self._half_length_m[row]) if on_road else 0.0

    def front_m(self, row: int) -> float:
        """Arc length of a vehicle's front on its course."""
        return self.centre_m(row) + float(self._half_length_m[row])

    def way(self, row: int, reach_m: float) -> Way:
        """A vehicle on its course, with what may be looked at ahead of it."""
        course = self.course(row)
        traffic = self._traffic
        left_m, pose = traffic.lateral_offset_m[row], (traffic.x_m[row], traffic.y_m[row], traffic.yaw_rad[row])
        size = self._half_length_m[row], self._half_width_m[row]
        return Way(course.points, course.spacing_m, self.centre_m(row), left_m, pose, reach_m, *size)

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
