"""Which civilian of an episode becomes the AV under test, and the way that it would drive."""

from dataclasses import dataclass
from itertools import takewhile
from typing import Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import Lane, RoadNetwork
from siren_ros.roads.routing import path_centre, route_path
from siren_ros.traffic.demand.lane_chains import chain_along
from siren_ros.traffic.demand.plan import PlannedVehicle, TrafficPlan

_SPACING_M: Final = 1.0


@dataclass(frozen=True, order=True)
class _Nearness:
    """Sorts vehicles: in the EMV's lane first, then on its route, then elsewhere; the nearest first in each."""

    rank: int
    distance_m: float
    name: str


def choose_av(network: RoadNetwork, plan: TrafficPlan) -> str:
    """The civilian that the EMV has to pass: the first one ahead in its lane.

    Where a template puts nobody into the EMV's lane it is the nearest vehicle ahead on the EMV's route, and where
    nobody is there either (cross traffic) the group vehicle nearest to the EMV. Background vehicles have moved
    on by the time that the EMV starts, and are not taken.

    Returns:
        The vehicle's name.

    Raises:
        InputError: the template has no vehicles around its EMV.
    """
    if not plan.groups:
        raise InputError("av", "civilian", "a template with civilians around its emergency vehicle")
    return min(_nearness(network, plan.emvs[0], vehicle) for vehicle in plan.groups).name


def _nearness(network: RoadNetwork, emv: PlannedVehicle, vehicle: PlannedVehicle) -> _Nearness:
    route = [network.edge_by_id[edge].index for edge in emv.route]
    chain = chain_along(network, network.lanes[emv.spot.lane], route)
    start = dict(zip(chain.lanes, chain.start_m, strict=True))
    edge_start: dict[int, float] = {}
    for index, start_m in zip(chain.lanes, chain.start_m, strict=True):
        edge_start.setdefault(network.lanes[index].edge, start_m)
    lane = network.lanes[vehicle.spot.lane]
    ahead_m = edge_start.get(lane.edge, -np.inf) + vehicle.spot.front_m - emv.spot.front_m
    if ahead_m > 0.0:
        return _Nearness(0 if lane.index in start else 1, float(ahead_m), vehicle.name)
    points = [network.lanes[one.spot.lane].centre.at(one.spot.front_m) for one in (emv, vehicle)]
    return _Nearness(2, float(np.linalg.norm(points[1] - points[0])), vehicle.name)


def av_way(network: RoadNetwork, plan: TrafficPlan) -> Polyline:
    """The way of a plan's AV along its route from its start: lane centres, and the lane changes that the route needs.

    Raises:
        InputError: the route cannot be driven from the lane that the AV starts in.
    """
    av = next(vehicle for vehicle in plan.groups if vehicle.name == plan.av)
    lanes = route_path(network, [network.edge_by_id[edge].index for edge in av.route], av.spot.lane)
    first_edge = network.lanes[lanes[0]].edge
    own = [network.lanes[lane] for lane in takewhile(lambda lane: network.lanes[lane].edge == first_edge, lanes)]
    begun = _to_lane(own[0], own[-1], max(av.spot.front_m - av.length_m, 0.0))
    onward = lanes[len(own) :]
    return Polyline.joined([begun, path_centre(network, onward)]) if onward else begun


def _to_lane(origin: Lane, target: Lane, from_m: float) -> Polyline:
    """The way from a place on a lane to the end of another lane of the edge, the change along a half cosine."""
    rest = origin.centre.cut(from_m, origin.length_m).resampled(_SPACING_M)
    share = 0.5 - 0.5 * np.cos(np.pi * rest.arc_m / rest.length_m)
    along, _ = target.centre.project(rest.points)
    return Polyline.through(rest.points + share[:, None] * (target.centre.at(along) - rest.points))
