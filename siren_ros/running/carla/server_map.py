"""A server's map next to ours: distances of lanes, the heads of signals for our movements, heights of the ground."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork

SAMPLE_M: Final = 10.0
"""Distance of the places at which lanes are compared."""
MOST_M: Final = 0.5
"""A car of 1.8 m in the middle of a lane of 2.75 m, the narrowest for cars (RASt 06), is as far from its lines."""
_SHARE: Final = 0.95
"""Share of the places that has to be so near: where roads cross above each other, a place has two heights."""
TRAFFIC_LIGHT: Final = "1000001"
"""Type of a traffic light for vehicles in OpenDRIVE."""
_STRIDE_M: Final = 0.5
_ENDS_M: Final = 6.0
"""Largest sum of the distances of both ends of a road in a junction and of the movement that it is."""


def place_of(carla: Any, carla_map: Any, x_m: float, y_m: float) -> Any:
    """The waypoint of the server's map that is nearest to a place of ours."""
    return carla_map.get_waypoint(carla.Location(float(x_m), -float(y_m), 0.0), True, carla.LaneType.Driving)


def lane_distances(carla: Any, carla_map: Any, network: RoadNetwork) -> dict[str, float]:
    """How far the driving lanes of two maps are from each other: ``places``, and metres and degrees of the differences.

    Junctions and roads that were prolonged are left out: there the maps may differ.
    """
    offsets, turns = [], []
    for lane in network.lanes:
        edge = network.edges[lane.edge]
        if lane.kind is not LaneKind.DRIVING or edge.internal or edge.prolonged_m:
            continue
        for arc_m in np.arange(SAMPLE_M / 2.0, float(lane.centre.arc_m[-1]), SAMPLE_M):
            x, y = lane.centre.at(np.array([arc_m]))[0].tolist()
            waypoint = place_of(carla, carla_map, x, y).transform
            offsets.append(float(np.hypot(waypoint.location.x - x, -waypoint.location.y - y)))
            turned_rad = lane.centre.heading_rad(arc_m) + np.radians(waypoint.rotation.yaw)
            turns.append(abs(float(wrap_angle(turned_rad))))
    if not offsets:
        return {"places": 0.0}
    values = {"median_m": np.median(offsets), "share_m": np.quantile(offsets, _SHARE), "most_m": max(offsets)}
    headings = {"share_deg": np.degrees(np.quantile(turns, _SHARE)), "most_deg": np.degrees(max(turns))}
    return {"places": float(len(offsets)), **{name: float(each) for name, each in {**values, **headings}.items()}}


def is_same(distances: Mapping[str, float]) -> bool:
    """Whether lanes with these distances are those of one map."""
    return bool(distances["places"]) and distances["share_m"] <= MOST_M


def signal_heads(carla_map: Any, network: RoadNetwork) -> dict[str, set[tuple[str, int]]]:
    """For each traffic light by its OpenDRIVE id: the movements of ours that it is for, as signal and link.

    A light of CARLA's maps stands at roads inside a junction; a movement belongs to it whose ends are those of such a
    road. In a map that SIREN exported, a light has the names of its signal and link.
    """
    signalled = [each for each in network.connections if each.signal_id is not None]
    if not signalled:
        return {}
    ends = np.array(
        [
            [*network.lanes[each.from_lane].centre.points[-1], *network.lanes[each.to_lane].centre.points[0]]
            for each in signalled
        ]
    )
    heads: dict[str, set[tuple[str, int]]] = {
        f"{each.signal_id}_{each.signal_link}": {(each.signal_id, each.signal_link)}
        for each in signalled
        if each.signal_id
    }
    for name, road in _lit_roads(carla_map):
        away = np.hypot(*(ends[:, :2] - road[:2]).T) + np.hypot(*(ends[:, 2:] - road[2:]).T)
        movement = signalled[int(np.argmin(away))]
        if away.min() < _ENDS_M and movement.signal_id is not None:
            heads.setdefault(name, set()).add((movement.signal_id, movement.signal_link))
    return heads


def _lit_roads(carla_map: Any) -> Iterator[tuple[str, Any]]:
    """Each light with the two ends of each lane that it is for, in ``map``, shape ``(4,)``."""
    for mark in carla_map.get_all_landmarks_of_type(TRAFFIC_LIGHT):
        for first, last in mark.get_lane_validities():
            for lane in range(min(first, last), max(first, last) + 1):
                waypoint = carla_map.get_waypoint_xodr(mark.road_id, lane, mark.s) if lane else None
                if waypoint is None:
                    continue
                begin = _begin_of(waypoint)
                end = (waypoint.next_until_lane_end(_STRIDE_M) or [waypoint])[-1]
                both = [each.transform.location for each in (begin, end)]
                yield mark.id, np.array([value for place in both for value in (place.x, -place.y)])


def _begin_of(waypoint: Any) -> Any:
    """The first waypoint of a road in a junction, to within a stride; ``previous_until_lane_start`` goes beyond it."""
    while before := [each for each in waypoint.previous(_STRIDE_M) if each.road_id == waypoint.road_id]:
        waypoint = before[0]
    return waypoint
