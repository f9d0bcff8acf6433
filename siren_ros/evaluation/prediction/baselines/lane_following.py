"""The path of a vehicle that keeps its lane and goes straight on at every junction."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import NO_LANE, Connection, Lane, RoadNetwork
from siren_ros.world.traffic_state import Indices

_SAME_TURN_RAD = 0.1
"""Movements count as equally straight where their turns differ by less; the smaller lateral shift then decides."""


def straight_successors(network: RoadNetwork) -> Indices:
    """The lane that follows each lane without a lane change, NO_LANE at an end; shape ``(L,)``.

    Where several movements leave a lane, the straightest is taken, because an observer does not know the driver's
    turn. Lanes of the same kind come first, so that a shoulder leads to a shoulder. A path across a junction is
    followed to its end.
    """
    successor = np.full(len(network.lanes), NO_LANE, dtype=np.int32)
    for lane in network.lanes:
        movements = network.connections_from.get(lane.index, ())
        if movements:
            best = min(movements, key=lambda movement: _bend(network, lane, movement))
            successor[lane.index] = (*best.via, best.to_lane)[0]
    for movement in network.connections:
        chain = (*movement.via, movement.to_lane)
        for inside, following in pairwise(chain):
            successor[inside] = following
    return successor


def _bend(network: RoadNetwork, lane: Lane, movement: Connection) -> tuple[bool, int, float, int]:
    target = network.lanes[movement.to_lane]
    heading = float(lane.centre.heading_rad(lane.length_m))
    turn = abs(float(wrap_angle(target.centre.heading_rad(0.0) - heading)))
    ahead = target.centre.points[0] - lane.centre.points[-1]
    sideways = abs(float(ahead[1] * np.cos(heading) - ahead[0] * np.sin(heading)))
    return target.kind is not lane.kind, round(turn / _SAME_TURN_RAD), sideways, target.index


@dataclass(frozen=True)
class LanePaths:
    """P paths, each straight on from one lane."""

    path_of_lane: npt.NDArray[np.intp]
    """Path that starts at each lane of the network, −1 where there is none; shape ``(L,)``."""
    curves: tuple[Polyline, ...]
    """Centre line of each path, from its first lane's start."""
    start_m: Floats
    """Distance along path p at which lane l starts, inf where p does not use it; shape ``(P, L)``."""

    def points(self, path: npt.NDArray[np.intp], arc_m: Floats, offset_m: Floats) -> Floats:
        """Places along paths.

        Args:
            path: Path of each of N vehicles, shape ``(N,)``.
            arc_m: Distances along it, shape ``(N, T)``; the path continues straight past its end.
            offset_m: Offset to keep from the centre line, left positive, shape ``(N,)``.

        Returns:
            Shape ``(N, T, 2)``.
        """
        found = np.zeros((*arc_m.shape, 2))
        for index in np.unique(path).tolist():
            rows = path == index
            found[rows] = self.curves[index].offset_points(arc_m[rows], offset_m[rows, None])
        return found


def paths_from(network: RoadNetwork, lanes: npt.NDArray[np.int32], reach_m: float) -> LanePaths:
    """Paths straight on from lanes.

    Args:
        network: The map.
        lanes: Lanes to start from, each once.
        reach_m: Length of each path beyond the end of its first lane, as far as lanes follow.
    """
    successor = straight_successors(network)
    path_of_lane = np.full(len(network.lanes), -1, dtype=np.intp)
    start_m = np.full((len(lanes), len(network.lanes)), np.inf)
    curves = []
    for path, first in enumerate(lanes.tolist()):
        path_of_lane[first] = path
        chain, lane, end = [], first, 0.0
        end_of_reach = network.lanes[first].length_m + reach_m
        while lane != NO_LANE and end < end_of_reach:
            chain.append(network.lanes[lane].centre)
            start_m[path, lane] = min(start_m[path, lane], end)
            end += network.lanes[lane].length_m
            lane = int(successor[lane])
        curves.append(Polyline.joined(chain))
    return LanePaths(path_of_lane, tuple(curves), start_m)
