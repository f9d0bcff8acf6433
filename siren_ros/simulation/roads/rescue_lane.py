"""The rescue lane (Rettungsgasse): between which lanes it is, and to which side drivers keep for it.

German law (StVO § 11 (2)) asks for it on motorways and on roads out of town with two lanes or more in one direction, as
soon as traffic goes at walking pace or stands: between the leftmost lane and the one on its right.
"""

import numpy as np
import numpy.typing as npt

from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes
from siren_ros.simulation.roads.sites import TOWN_LIMIT_MPS


def rescue_sides(network: RoadNetwork) -> npt.NDArray[np.int8]:
    """Side to which drivers in each lane keep: +1 left in the leftmost one, −1 right in all others, 0 without the duty.

    A path over a joint has the side of the lane from which it comes.
    """
    sides = np.zeros(len(network.lanes), np.int8)
    for edge in range(len(network.edges)):
        lanes = driving_lanes(network, edge)
        if len(lanes) > 1 and lanes[-1].speed_limit_mps > TOWN_LIMIT_MPS:
            sides[[lane.index for lane in lanes]] = -1
            sides[lanes[-1].index] = 1
    for connection in network.connections:
        sides[list(connection.via)] = sides[connection.from_lane]
    return sides


def rescue_boundary_m(network: RoadNetwork, lane: int) -> float:
    """Offset of the line between the leftmost lane and its right neighbour from a lane's centre, left positive.

    0 on shoulders and on roads of one lane.
    """
    here = network.lanes[lane]
    lanes = (network.lanes[item] for item in network.edges[here.edge].lanes)
    driving = [item for item in lanes if item.kind is LaneKind.DRIVING]
    if here.kind is LaneKind.SHOULDER or len(driving) < 2:
        return 0.0
    leftmost = driving[-1].position
    if here.position >= leftmost:
        return -0.5 * here.width_m
    between = sum(item.width_m for item in driving if here.position < item.position < leftmost)
    return 0.5 * here.width_m + between
