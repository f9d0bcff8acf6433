"""Finds places where roads cross without a junction, on a bridge.

Because this world is flat, vehicles of both roads meet there.
"""

from functools import lru_cache

import shapely

from siren_ros.base.numerics.arrays import Points
from siren_ros.simulation.roads.road_network import MAPS_KEPT, LaneKind, RoadNetwork


@lru_cache(maxsize=MAPS_KEPT)
def bridges(network: RoadNetwork) -> Points:
    """The places where driving lanes of two roads cross outside junctions, shape ``(N, 2)``."""
    lanes = [lane for lane in network.lanes if lane.kind is LaneKind.DRIVING]
    centres = [shapely.LineString(lane.centre.points) for lane in lanes]
    pairs = shapely.STRtree(centres).query(centres, predicate="crosses").T.tolist()
    crossed = [(a, b) for a, b in pairs if lanes[a].edge < lanes[b].edge]
    return shapely.get_coordinates([shapely.intersection(centres[a], centres[b]) for a, b in crossed])
