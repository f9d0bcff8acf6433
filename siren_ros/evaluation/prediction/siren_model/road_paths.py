"""Paths ahead of a lane: every way that the road network allows, with the stop lines along it."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from siren_ros.numerics.geometry import wrap_angle
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import Connection, LaneKind, RoadNetwork

PATHS_PER_LANE: Final = 4
"""The straightest ways of each lane are kept."""
_WAYS_MAX: Final = 64
"""Bound of the search, for networks of very short lanes."""


@dataclass(frozen=True)
class StopLine:
    """Where a path enters a junction, and the movement that it takes there."""

    arc_m: float
    """Along the path."""
    movement: Connection


@dataclass(frozen=True)
class RoadPath:
    """One way along consecutive lanes."""

    curve: Polyline
    stop_lines: tuple[StopLine, ...]
    turn_rad: float
    """Sum of the absolute angles turned at junctions."""
    first_lane: int


@dataclass
class _Way:
    lanes: list[int]
    end_m: float
    stop_lines: list[StopLine] = field(default_factory=list)
    turn_rad: float = 0.0


@dataclass
class RoadPaths:
    """The paths of one road network, each made when it is first asked for."""

    network: RoadNetwork
    _known: dict[tuple[int, float], tuple[RoadPath, ...]] = field(default_factory=dict)

    def ahead(self, lane: int, reach_m: float) -> tuple[RoadPath, ...]:
        """The straightest paths from a lane's start, the straightest first; at least one.

        Args:
            lane: Index of the lane; may be a path across a junction.
            reach_m: How far they go beyond the lane's end, as far as lanes follow.
        """
        key = (lane, reach_m)
        if key not in self._known:
            self._known[key] = self._search(lane, reach_m)
        return self._known[key]

    def _search(self, lane: int, reach_m: float) -> tuple[RoadPath, ...]:
        length = self.network.lanes[lane].length_m
        open_ways = [_Way([lane], length)]
        done: list[_Way] = []
        while open_ways:
            way = open_ways.pop()
            following = self._followings(way) if way.end_m < length + reach_m else []
            if following and len(open_ways) + len(done) < _WAYS_MAX:
                open_ways.extend(following)
            else:
                done.append(way)
        done.sort(key=lambda way: (round(way.turn_rad, 3), way.lanes))
        return tuple(
            RoadPath(
                Polyline.joined([self.network.lanes[index].centre for index in way.lanes]),
                tuple(way.stop_lines),
                way.turn_rad,
                lane,
            )
            for way in done[:PATHS_PER_LANE]
        )

    def _followings(self, way: _Way) -> list[_Way]:
        last = way.lanes[-1]
        network = self.network
        if network.lanes[last].kind is LaneKind.INTERNAL:
            movements = network.connections_over.get(last, ())
            parts = [(movement.via[movement.via.index(last) + 1 :], movement) for movement in movements]
            return [self._longer(way, (*via, movement.to_lane), ()) for via, movement in parts]
        return [
            self._longer(way, (*movement.via, movement.to_lane), (StopLine(way.end_m, movement),))
            for movement in network.connections_from.get(last, ())
        ]

    def _longer(self, way: _Way, added: tuple[int, ...], stop_lines: tuple[StopLine, ...]) -> _Way:
        lanes = self.network.lanes
        before = lanes[way.lanes[-1]].centre
        turn = wrap_angle(lanes[added[-1]].centre.heading_rad(0.0) - before.heading_rad(before.length_m))
        return _Way(
            [*way.lanes, *added],
            way.end_m + float(np.sum([lanes[index].length_m for index in added])),
            [*way.stop_lines, *stop_lines],
            way.turn_rad + abs(float(turn)),
        )
