"""Where a vehicle would go on at the end of its record: along its lane and its route."""

from typing import Final

import numpy as np

from siren_ros.judging.lane_location import places_of
from siren_ros.numerics.arrays import Points
from siren_ros.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.roads.road_network import NO_LANE, Connection, RoadNetwork
from siren_ros.world.actors import rows_of_ids

REACH_M: Final = 45.0
"""More than a vehicle's length and the corridor's look-ahead."""
_FIRST_M: Final = 1.0
_STEP_M: Final = 1.0


def way_ahead(record: EpisodeRecord, track: StateRows) -> Points:
    """Points from a track's end onwards, shape ``(K, 2)``, K ≥ 1; at the same distance from the lane's centre line.

    Where the vehicle is in no lane, or its lane ends, they lead straight on.
    """
    last = track.select(np.arange(len(track)) == len(track) - 1)
    place = places_of(record, last)
    lane, arc = int(place.lane[0]), float(place.arc_m[0]) + _FIRST_M
    points: list[Points] = []
    way, edges = 0.0, _route(record, last)
    while lane != NO_LANE and way < REACH_M:
        centre = record.network.lanes[lane].centre
        along = np.arange(arc, centre.length_m, _STEP_M)
        points.extend(centre.offset_points(along, np.full(len(along), place.offset_m[0])))
        way += max(0.0, centre.length_m - arc)
        lane, arc = _next_lane(record.network, lane, edges), 0.0
    if len(points) < 2:
        heading = float(last.yaw_rad[0])
        straight = np.arange(_FIRST_M, REACH_M, _STEP_M)[:, None] * (np.cos(heading), np.sin(heading))
        return np.asarray(last.xy_m[0] + straight)
    return np.array(points)


def _route(record: EpisodeRecord, last: StateRows) -> frozenset[int]:
    """Edges that the vehicle still has ahead; none where SUMO said nothing."""
    for traffic in reversed(record.traffic):
        if traffic.step == int(last.step[0]):
            row = int(rows_of_ids(traffic.actor_id, last.actor_id)[0])
            return frozenset(traffic.route_of_row(row).tolist()) if row >= 0 else frozenset()
    return frozenset()


def _next_lane(network: RoadNetwork, lane: int, edges: frozenset[int]) -> int:
    """The lane that follows, on the route if one does, otherwise straight on; NO_LANE at the end of the road."""
    over = network.connections_over.get(lane, ())
    if over:
        via = over[0].via
        after = via.index(lane) + 1
        return via[after] if after < len(via) else over[0].to_lane
    ways = sorted(
        network.connections_from.get(lane, ()),
        key=lambda way: (network.lanes[way.to_lane].edge not in edges, way.direction != "s"),
    )
    return _first_of(ways[0]) if ways else NO_LANE


def _first_of(connection: Connection) -> int:
    return connection.via[0] if connection.via else connection.to_lane
