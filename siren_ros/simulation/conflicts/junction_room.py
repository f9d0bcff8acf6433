"""How far a vehicle may go onto a junction before it blocks vehicles from elsewhere."""

import math
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import Final

import numpy as np

from siren_ros.simulation.conflicts.yielding import Rank, rank_of
from siren_ros.simulation.roads.movements import movement_path
from siren_ros.simulation.roads.road_network import Connection, RoadNetwork

# These are no parameters: resolution and width of the paths.
_SPACING_M: Final = 0.5
_CLEAR_M: Final = 1.0
"""Distance kept between a body and the edge of others' paths."""


class JunctionRoom:
    """Caches where the paths of others begin on each movement of a map."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._starts: dict[tuple[int, int], tuple[tuple[Connection, float], ...]] = {}

    def beyond_line_m(self, movement: Connection, signals: Mapping[str, str], occupied: AbstractSet[int]) -> float:
        """Distance beyond the stop line that a vehicle's front may go without blocking others.

        Infinite if none may come.

        Others come from other approaches. They may come where no red light holds them, or if they are on the junction
        already: ``occupied`` are the lanes with vehicles.
        """
        coming = (
            start_m
            for other, start_m in self._others(movement)
            if rank_of(other, signals) is not Rank.RED or not occupied.isdisjoint(other.via)
        )
        return min(coming, default=math.inf)

    def _others(self, movement: Connection) -> tuple[tuple[Connection, float], ...]:
        key = movement.from_lane, movement.to_lane
        if key not in self._starts:
            network, approach = self._network, self._network.lanes[movement.from_lane].edge
            others = (
                other
                for _, other in network.connections_at.get(movement.junction, ())
                if network.lanes[other.from_lane].edge != approach and network.is_civilian(other)
            )
            starts = ((other, self._start_m(movement, other)) for other in others)
            self._starts[key] = tuple((other, start_m) for other, start_m in starts if start_m < math.inf)
        return self._starts[key]

    def _start_m(self, movement: Connection, other: Connection) -> float:
        """Where the path of another movement, as wide as its lane, begins on a movement.

        Infinite if they do not meet.
        """
        own, its = (movement_path(self._network, item).resampled(_SPACING_M) for item in (movement, other))
        apart_m = np.linalg.norm(own.points[:, None] - its.points[None], axis=-1).min(axis=1)
        near = np.flatnonzero(apart_m < 0.5 * self._network.lanes[other.to_lane].width_m + _CLEAR_M)
        return float(own.arc_m[near[0]]) if len(near) else math.inf
