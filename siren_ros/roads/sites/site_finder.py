"""Finds the sites of a map: the places where a template's interaction can happen."""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

from siren_ros.errors import MapError
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.roads.routing import EdgeGraph
from siren_ros.roads.sites.junction_sites import queued_approaches, shoulder_turns, signal_junctions, stop_junctions
from siren_ros.roads.sites.road_sites import multi_lane_roads
from siren_ros.roads.sites.site import REQUIREMENTS, Site, SiteKind

__all__ = ["REQUIREMENTS", "Site", "SiteKind", "find_sites", "require_site"]

_FINDERS: Final[Mapping[SiteKind, Callable[[EdgeGraph], Iterator[Site]]]] = {
    SiteKind.MULTI_LANE_ROAD: multi_lane_roads,
    SiteKind.QUEUED_APPROACH: queued_approaches,
    SiteKind.SIGNAL_JUNCTION: signal_junctions,
    SiteKind.STOP_JUNCTION: stop_junctions,
    SiteKind.SHOULDER_RIGHT_TURN: shoulder_turns,
}


def find_sites(network: RoadNetwork, kind: SiteKind) -> tuple[Site, ...]:
    """All places of a kind on a map, best first; equal scores keep the order of the map's edges."""
    graph = EdgeGraph.of(network)
    sites = _FINDERS[kind](graph)
    return tuple(sorted(sites, key=lambda site: -site.score))


def require_site(network: RoadNetwork, kind: SiteKind, shown_map: str = "this map") -> Site:
    """The best place of a kind.

    Raises:
        MapError: There is none; the message says what the map lacks.
    """
    sites = find_sites(network, kind)
    if not sites:
        raise MapError(shown_map, REQUIREMENTS[kind])
    return sites[0]
