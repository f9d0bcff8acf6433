"""The civilian of a plan that the AV under test drives, and the way of a planned vehicle along its route."""

from itertools import takewhile
from typing import Final

import numpy as np

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError
from siren_ros.simulation.roads.road_network import Lane, RoadNetwork
from siren_ros.simulation.roads.routing import path_centre, route_path
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, TrafficPlan, chain_along


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
    return min((*_nearness(network, plan.emvs[0], vehicle), vehicle.name) for vehicle in plan.groups)[-1]


def _nearness(network: RoadNetwork, emv: PlannedVehicle, vehicle: PlannedVehicle) -> tuple[int, float]:
    """Sort key of vehicles: those in the EMV's lane first, then those on its route, then others, each by distance."""
    route = [network.edge_by_id[edge].index for edge in emv.route]
    chain = chain_along(network, network.lanes[emv.spot.lane], route)
    edge_start: dict[int, float] = {}
    for index, start_m in zip(chain.lanes, chain.start_m, strict=True):
        edge_start.setdefault(network.lanes[index].edge, start_m)
    lane = network.lanes[vehicle.spot.lane]
    ahead_m = edge_start.get(lane.edge, -np.inf) + vehicle.spot.front_m - emv.spot.front_m
    if ahead_m > 0.0:
        return 0 if lane.index in chain.lanes else 1, float(ahead_m)
    points = [network.lanes[spot.lane].centre.at(spot.front_m) for spot in (emv.spot, vehicle.spot)]
    return 2, float(np.linalg.norm(points[1] - points[0]))


_SPACING_M: Final = 1.0


def av_way(network: RoadNetwork, plan: TrafficPlan) -> Polyline:
    """The way of the AV in a plan, as ``way_of`` gives it."""
    return way_of(network, next(vehicle for vehicle in plan.groups if vehicle.name == plan.av))


def way_of(network: RoadNetwork, vehicle: PlannedVehicle) -> Polyline:
    """A vehicle's way along its route from its start: lane centres, and the lane changes that the route needs.

    Raises:
        InputError: the route cannot be driven from the lane that the vehicle starts in.
    """
    lanes = route_path(network, [network.edge_by_id[edge].index for edge in vehicle.route], vehicle.spot.lane)
    first_edge = network.lanes[lanes[0]].edge
    beside = [network.lanes[lane] for lane in takewhile(lambda lane: network.lanes[lane].edge == first_edge, lanes)]
    begun = way_to_lane(beside[0], beside[-1], max(vehicle.spot.front_m - vehicle.length_m, 0.0))
    onward = lanes[len(beside) :]
    return Polyline.joined([begun, path_centre(network, onward)]) if onward else begun


def way_to_lane(origin: Lane, target: Lane, from_m: float) -> Polyline:
    """The way from a place on a lane to the end of another lane of the edge, the change along a half cosine."""
    rest = origin.centre.cut(from_m, origin.length_m).resampled(_SPACING_M)
    share = 0.5 - 0.5 * np.cos(np.pi * rest.arc_m / rest.length_m)
    along, _ = target.centre.project(rest.points)
    return Polyline.through(rest.points + share[:, None] * (target.centre.at(along) - rest.points))
