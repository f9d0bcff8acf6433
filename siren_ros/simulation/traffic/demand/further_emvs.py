"""Places the EMVs other than the first: those behind it on its way, and those that cross it."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import count, pairwise
from typing import Final

from siren_ros.errors import MapError
from siren_ros.simulation.roads.movements import comes_from_the_side, crossing_connections
from siren_ros.simulation.roads.road_network import Connection, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph, civilian_movements, driving_lanes
from siren_ros.simulation.roads.site_finder import junction_site
from siren_ros.simulation.roads.sites import Site, way_back
from siren_ros.simulation.scenario.scenario import EmvDemand
from siren_ros.simulation.traffic.demand.emv_start import (
    EMV_CLEARANCE_M,
    ENTRY_M,
    EmvStart,
    emv_start,
    start_m_of,
    unhindered_arrival_s,
)
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle

_NO_CROSSING: Final = "a side street at its junction with enough road for another EMV (emv.crossing is above 0)"
_NEXT_WAY_S: Final = 2.0
_MOST_OFF_S: Final = 5.0
"""Largest difference between the arrivals at the junction with which the two EMVs still meet there."""


def following_starts(network: RoadNetwork, site: Site, emv: EmvDemand, headway_m: float) -> list[EmvStart]:
    """The starts of all EMVs on one route, the foremost first. The approach is made longer as far as they need it.

    Raises:
        MapError: the map has no road that leads to the approach and is long enough.
    """
    start_m = start_m_of(network, site, emv)
    starts = [emv_start(network, site, start_m)]
    for number in range(1, emv.count):
        try:
            starts.append(emv_start(network, site, start_m - number * headway_m))
        except MapError:
            longer = prolonged(network, site, number * headway_m - start_m)
            starts.append(emv_start(network, longer, start_m - number * headway_m))
    return starts


def prolonged(network: RoadNetwork, site: Site, approach_m: float) -> Site:
    """The site with a route that begins at least this far before its edge, where roads lead there."""
    graph = EdgeGraph.of(network)
    missing_m = approach_m - graph.route_length_m(site.route[: site.site_position])
    before = way_back(graph, site.route[: site.site_position + 1], missing_m)
    return replace(site, route=(*before, *site.route), site_position=len(before) + site.site_position)


def arrival_s(network: RoadNetwork, site: Site, start: EmvStart, edge: int, emv: EmvDemand) -> float:
    """Time from step 0 to the end of an edge of the way through a site, on a free road."""
    route = start.route
    last = route.index(edge)
    # On a long way, an EMV that starts behind the site's edge may come back to it.
    reached = route.index(site.site_edge) if site.site_edge in route[: last + 1] else 0
    further = route[reached + 1 : last + 1]
    way_m = sum(driving_lanes(network, beyond)[-1].length_m for beyond in further)
    return unhindered_arrival_s(network, start, emv) + way_m / emv.speed_mps


def crossing_ways(network: RoadNetwork, site: Site, start: EmvStart) -> tuple[tuple[Site, ...], int]:
    """Ways on which another EMV can cross the first one's way, best first, and the edge at the end of which they cross.

    It is at the site's junction, or for a road at the first junction behind it that has a side street.

    Raises:
        MapError: there is no such junction.
    """
    route = start.route
    first = route.index(site.stretch[-1]) if site.stretch[-1] in route else 0
    for edge, following in pairwise(route[first:]):
        movements = civilian_movements(network, edge, following)
        own = [network.connections[index] for index in site.connections] if edge == site.stretch[-1] else movements
        found = tuple(_side_streets(network, site, own[-1])) if own else ()
        if found:
            return found, edge
        if site.junction is not None:
            break
    raise MapError(site.name, _NO_CROSSING)


def _side_streets(network: RoadNetwork, site: Site, own: Connection) -> Iterator[Site]:
    """Movements from the side whose way crosses another one, or leads to the same road.

    Of them those straight on come first, then those that do not lead off the map soon.
    """
    crossing, exit_edge = crossing_connections(network, own), network.lanes[own.to_lane].edge
    lasting = EdgeGraph.of(network).endless_edges()
    ways: dict[tuple[int, int], tuple[bool, bool, bool, int]] = {}
    for index, way in network.connections_at[own.junction]:
        ends = network.lanes[way.from_lane].edge, network.lanes[way.to_lane].edge
        from_side = network.is_civilian(way) and comes_from_the_side(network, own, way) and way.direction != "t"
        if from_side and (index in crossing or ends[1] == exit_edge):
            ways.setdefault(ends, (index not in crossing, way.direction != "s", ends[1] not in lasting, index))
    for edge, following in sorted(ways, key=lambda ends: ways[ends]):
        movements = civilian_movements(network, edge, following)
        yield junction_site(EdgeGraph.of(network), site.kind, movements, (edge,))


def crossing_start(
    network: RoadNetwork,
    sites: Sequence[Site],
    emv: EmvDemand,
    wanted_s: float,
    placed: Sequence[PlannedVehicle],
) -> tuple[Site, EmvStart]:
    """The start from which an EMV comes unhindered to a junction nearest to a time.

    Args:
        network: The map.
        sites: Ways over the junction, best first: a later one has to come nearer by two seconds.
        emv: Speeds of the EMV.
        wanted_s: Time from step 0.
        placed: Vehicles that are there already; the EMV starts clear of them.

    Raises:
        MapError: No way has a place for the start, or the road of all is too short.
    """
    found: list[tuple[float, int, Site, EmvStart]] = []
    for number, site in enumerate(sites):
        way = prolonged(network, site, emv.speed_mps * max(wanted_s, 0.0))
        for start in _starts_back(network, way):
            late_s = unhindered_arrival_s(network, start, emv) - wanted_s
            if start.front_m >= ENTRY_M and _is_clear(start, placed):
                if abs(late_s) < _MOST_OFF_S:
                    found.append((abs(late_s) + _NEXT_WAY_S * number, len(found), way, start))
                if late_s > 0.0:
                    break
    if not found:
        raise MapError(sites[0].name, _NO_CROSSING)
    return min(found)[2:]


def _starts_back(network: RoadNetwork, site: Site) -> Iterator[EmvStart]:
    """Starts before a stop line, each farther back than the one before, as far as the approach reaches."""
    line_m = network.lanes[site.approach_lane].length_m
    with suppress(MapError):
        for before_m in count(EMV_CLEARANCE_M):
            yield emv_start(network, site, line_m - before_m)


def _is_clear(start: EmvStart, placed: Sequence[PlannedVehicle]) -> bool:
    """Whether the start's lane is free of vehicles, up to a clearance ahead and behind."""
    near = (vehicle for vehicle in placed if vehicle.spot.lane == start.lane)
    return all(abs(vehicle.spot.front_m - start.front_m) > 2.0 * EMV_CLEARANCE_M for vehicle in near)
