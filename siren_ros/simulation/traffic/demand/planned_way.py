"""The way of a planned vehicle along its route, with the lane changes that the route needs."""

from itertools import takewhile
from typing import Final

import numpy as np

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.road_network import Lane, RoadNetwork
from siren_ros.simulation.roads.routing import path_centre, route_path
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, TrafficPlan

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
