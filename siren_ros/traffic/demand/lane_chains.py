"""Lanes in driving order along a route, addressed by one distance."""

from collections.abc import Sequence
from dataclasses import dataclass

from siren_ros.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.traffic.demand.plan import LaneInterval


@dataclass(frozen=True)
class LaneChain:
    """Lanes that follow each other, junction paths included; distances count from the first lane's start."""

    lanes: tuple[int, ...]
    start_m: tuple[float, ...]
    """Distance at which each lane starts."""
    end_m: float

    def place(self, network: RoadNetwork, distance_m: float) -> tuple[int, float] | None:
        """Lane and position at a distance; None beyond the ends and inside junctions."""
        if not 0.0 <= distance_m < self.end_m:
            return None
        last = max(i for i, start in enumerate(self.start_m) if start <= distance_m)
        lane = network.lanes[self.lanes[last]]
        if lane.kind is LaneKind.INTERNAL:
            return None
        return lane.index, distance_m - self.start_m[last]

    def intervals(self, network: RoadNetwork, from_m: float, to_m: float) -> tuple[LaneInterval, ...]:
        """The stretches of lanes between two distances."""
        found = []
        for lane, start in zip(self.lanes, self.start_m, strict=True):
            low, high = max(from_m - start, 0.0), min(to_m - start, network.lanes[lane].length_m)
            if low < high:
                found.append(LaneInterval(lane, low, high))
        return tuple(found)


def chain_along(network: RoadNetwork, lane: Lane, edges: Sequence[int]) -> LaneChain:
    """The chain from a lane along a route's edges; ``edges[0]`` is the lane's own edge.

    Where a lane does not lead to the next edge, the chain goes on from the nearest lane of the edge that does.
    """
    lanes: list[int] = []
    starts: list[float] = []
    end = 0.0
    current = lane
    for following in [*edges[1:], None]:
        lanes.append(current.index)
        starts.append(end)
        end += current.length_m
        if following is None:
            break
        step = connection_onward(network, current, following)
        if step is None:
            break
        for via in step.via:
            lanes.append(via)
            starts.append(end)
            end += network.lanes[via].length_m
        current = network.lanes[step.to_lane]
    return LaneChain(tuple(lanes), tuple(starts), end)


def connection_onward(network: RoadNetwork, lane: Lane, following: int) -> Connection | None:
    """The movement from a lane to an edge; where there is none, from the nearest driving lane of the same edge."""
    siblings = [network.lanes[index] for index in network.edges[lane.edge].lanes]
    for source in sorted(siblings, key=lambda other: (abs(other.position - lane.position), other.position)):
        if source.kind is not LaneKind.DRIVING:
            continue
        for connection in network.connections_from.get(source.index, ()):
            target = network.lanes[connection.to_lane]
            if target.edge == following and target.kind is LaneKind.DRIVING:
                return connection
    return None
