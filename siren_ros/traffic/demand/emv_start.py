"""The EMV's start: lane and place, the way from there to the site, and the time of its arrival."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.errors import MapError
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.bend_speeds import SAMPLE_M, bend_speeds_mps, with_accelerating, with_braking
from siren_ros.roads.movements import quiet_reach_m
from siren_ros.roads.road_network import Lane, LaneKind, RoadNetwork
from siren_ros.roads.routing import driving_lanes
from siren_ros.roads.sites.site_finder import Site
from siren_ros.scenario.scenario import EmvDemand, StartReference
from siren_ros.traffic.demand.demand_config import DemandConfig
from siren_ros.traffic.demand.lane_chains import chain_along
from siren_ros.traffic.demand.vehicle_factory import VehicleFactory

_ROUTE_TRIES: Final = 12
_CREEP_MPS: Final = 1.0
_LEAST_APPROACH_SHARE: Final = 0.6
"""Of the template's distance to the stop line, the least that is left where the EMV starts after a junction."""
_ENTRY_M: Final = 8.0
"""Road behind an EMV's front at the very beginning of its approach: its own length."""


@dataclass(frozen=True)
class EmvStart:
    """Where the foremost EMV's front bumper starts, and the edges of its route from there on."""

    lane: int
    front_m: float
    route: tuple[int, ...]
    lanes_to_site: tuple[int, ...]
    """Lanes from the start to the end of the site's edge, junction paths included; starts beyond it have their own."""


def start_m_of(network: RoadNetwork, site: Site, emv: EmvDemand) -> float:
    """A template's start of the EMV, counted from the beginning of the site's edge.

    Before a stop line it is as far back as the template wants and the approach reaches, with the EMV's body on the
    lane where its front is. It is after the junction before, where the road from there is long enough, so that the EMV
    meets nobody there.
    """
    if emv.start_from is StartReference.SITE_START:
        return emv.start_m
    lane, reach_m = travel_lane(network, site), 0.0
    quiet_m = quiet_reach_m(network, lane.index, -emv.start_m)
    if quiet_m - _ENTRY_M >= -_LEAST_APPROACH_SHARE * emv.start_m:
        return lane.length_m + max(emv.start_m, _ENTRY_M - quiet_m)
    wanted_m = lane.length_m + emv.start_m
    for edge in reversed(site.route[: site.site_position]):
        if reach_m >= -wanted_m:
            break
        lane, via = _lane_before(network, lane, edge)
        reach_m += lane.length_m + _length_m(network, via)
    return max(wanted_m, _ENTRY_M - reach_m)


def travel_lane(network: RoadNetwork, site: Site) -> Lane:
    """The site's approach lane; where that is a shoulder, the driving lane beside it: nobody arrives on a shoulder."""
    lane = network.lanes[site.approach_lane]
    if lane.kind is not LaneKind.SHOULDER:
        return lane
    return min(driving_lanes(network, lane.edge), key=lambda other: abs(other.position - lane.position))


def emv_start(network: RoadNetwork, site: Site, start_m: float) -> EmvStart:
    """The start at a distance from the beginning of the site's edge, negative before it.

    A start that would lie inside a junction is put before it. Before the site the lane is one that leads to
    the site's approach lane without a lane change, where there is such a lane, and otherwise the leftmost
    driving lane.

    Raises:
        MapError: the site's approach or the site itself is too short.
    """
    position = site.site_position
    lane = travel_lane(network, site)
    to_site: tuple[int, ...] = (lane.index,)
    while start_m < 0.0 and position > 0:
        position -= 1
        lane, via = _lane_before(network, lane, site.route[position])
        to_site = (lane.index, *via, *to_site)
        start_m = min(start_m + _length_m(network, via), 0.0) + lane.length_m
    while start_m > lane.length_m and position + 1 < len(site.route):
        chain = chain_along(network, lane, site.route[position : position + 2])
        position, start_m = position + 1, start_m - (chain.start_m[-1] if len(chain.lanes) > 1 else lane.length_m)
        lane = network.lanes[chain.lanes[-1]]
        to_site = (lane.index,)
    if not 0.0 <= start_m <= lane.length_m:
        raise MapError(site.name, f"a place with {abs(start_m):.0f} m more of road for the EMV's start")
    return EmvStart(lane.index, start_m, site.route[position:], to_site)


def _lane_before(network: RoadNetwork, lane: Lane, edge: int) -> tuple[Lane, tuple[int, ...]]:
    """The leftmost lane of an edge that leads to a lane of the same kind, and the junction path between them."""
    leading = [
        (network.lanes[connection.from_lane], connection.via)
        for connection in network.connections_to.get(lane.index, ())
        if network.lanes[connection.from_lane].edge == edge and network.lanes[connection.from_lane].kind is lane.kind
    ]
    if leading:
        return max(leading, key=lambda found: found[0].position)
    return driving_lanes(network, edge)[-1], ()


def way_to_stop_line_m(network: RoadNetwork, start: EmvStart) -> float:
    """Length of the way from the start to the end of the site's edge."""
    return _length_m(network, start.lanes_to_site) - start.front_m


def _length_m(network: RoadNetwork, lanes: Sequence[int]) -> float:
    return sum(network.lanes[lane].length_m for lane in lanes)


def unhindered_arrival_s(network: RoadNetwork, start: EmvStart, emv: EmvDemand, config: DemandConfig) -> float:
    """Time from step 0 to the stop line on a free road: speeding up, and slowing down for bends.

    The speed is the largest one with the EMV's target speed, a limit on lateral acceleration and limits on
    speeding up and braking (two passes over samples of the way).
    """
    way = Polyline.joined([network.lanes[lane].centre for lane in start.lanes_to_site])
    if start.front_m >= way.length_m:
        return 0.0
    ahead = way.cut(start.front_m, way.length_m)
    speed = np.minimum(emv.speed_mps, bend_speeds_mps(ahead, config.emv_lateral_accel_mps2))
    speed = with_accelerating(with_braking(speed, config.emv_brake_mps2), emv.depart_speed_mps, config.emv_accel_mps2)
    driven_m = np.minimum(SAMPLE_M, ahead.length_m - SAMPLE_M * np.arange(len(speed)))
    return float(np.sum(driven_m / np.maximum(speed, _CREEP_MPS)))


def long_enough_route(
    factory: VehicleFactory, route: tuple[int, ...], site: Site, needed_m: float, rng: np.random.Generator
) -> tuple[int, ...]:
    """The route, with another way on after the site where it would leave the map too early.

    Of the ways on, those that keep most of the route come first; where none is long enough, the
    longest way found is taken.
    """
    kept_at_least = max(route.index(edge) for edge in _site_edges(site) if edge in route) + 1
    best, best_m = route, factory.length_m(route)
    for kept in range(len(route), kept_at_least - 1, -1):
        for _ in range(_ROUTE_TRIES):
            if best_m >= needed_m:
                return best
            way = factory.draw_way(route[:kept], needed_m, rng)
            if factory.length_m(way) > best_m:
                best, best_m = way, factory.length_m(way)
    return best


def _site_edges(site: Site) -> Sequence[int]:
    """Edges that make the interaction: the stretch, and beyond a junction the edge that the EMV's movement leads to."""
    beyond = () if site.junction is None else site.route[site.site_position + 1 : site.site_position + 2]
    return (site.site_edge, *site.stretch, *beyond)
