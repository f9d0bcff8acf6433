"""Where a vehicle will go: the centre line of its lanes along its route, with the movements across junctions."""

from dataclasses import dataclass
from math import cos, sin
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import Connection, RoadNetwork
from siren_ros.world.traffic_state import Indices

SPACING_M: Final = 1.0
"""Distance between the points of a course, at most."""
_AHEAD_M: Final = 80.0
"""How far a course leads beyond the lane on which it begins."""
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


class CourseBook:
    """The courses of a map, each worked out once: a memory of pure results."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._courses: dict[tuple[int, bytes], Course] = {}

    def along(self, lane: int, route: Indices) -> Course:
        """The course from the start of a lane.

        Args:
            lane: Present lane, which may cross a junction.
            route: Edges from the present one (or the one before the junction) on.

        Returns:
            The course; it ends with the route.
        """
        key = (lane, route.tobytes())
        found = self._courses.get(key)
        if found is None:
            found = self._courses[key] = _course(self._network, lane, tuple(route.tolist()))
        return found


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
    return min(choices, key=lambda one: abs(network.lanes[one.from_lane].position - position), default=None)


def _movement_over(network: RoadNetwork, lane: int, route: tuple[int, ...]) -> Connection | None:
    """The movement that an internal lane belongs to, that along the route where several share the lane."""
    choices = network.connections_over.get(lane, ())
    return next((one for one in choices if network.lanes[one.to_lane].edge in route), choices[0] if choices else None)
