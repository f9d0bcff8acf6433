"""Chooses the site of an episode: the best one at which the whole template finds its place."""

from collections.abc import Mapping
from typing import Final

from siren_ros.errors import MapError
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.roads.sites.site_finder import REQUIREMENTS, Site, find_sites
from siren_ros.scenario.scenario import Template
from siren_ros.traffic.demand.demand import plan_traffic
from siren_ros.traffic.demand.demand_config import DemandConfig
from siren_ros.traffic.demand.driver_models import DriverPopulation
from siren_ros.traffic.demand.emv_start import approach_rank
from siren_ros.traffic.demand.plan import TrafficPlan
from siren_ros.traffic.demand.vehicle_factory import Dimensions
from siren_ros.world.actors import ActorClass

_UNREACHABLE: Final = 3
"""Rank of sites whose approach is too short."""


def plan_at_best_site(
    network: RoadNetwork,
    template: Template,
    seed: int,
    drivers: DriverPopulation,
    dimensions: Mapping[ActorClass, Dimensions],
    shown_map: str,
) -> tuple[Site, TrafficPlan]:
    """The best site of the template's kind at which its EMVs and groups can start, and the traffic there.

    Sites up to which the EMV drives without a junction on the way come first, then those without sharp bends.

    Args:
        network: The map.
        template: The scenario with its values.
        seed: The episode's seed.
        drivers: Population from which drivers are drawn.
        dimensions: Length, width and height of each vehicle class in metres.
        shown_map: What an error names as the map.

    Raises:
        MapError: No site of the map will do. It says what the map lacks, and what the best site does.
    """
    sites = find_sites(network, template.site_kind)
    if not sites:
        raise MapError(shown_map, REQUIREMENTS[template.site_kind])
    reasons = []
    for site in sorted(sites, key=lambda site: _rank(network, site, template)):
        try:
            return site, plan_traffic(network, site, template, seed, drivers, dimensions)
        except MapError as error:
            reasons.append(error.allowed)
    places = "the only place of this kind" if len(sites) == 1 else f"the best of {len(sites)} places of this kind"
    allowed = f"{REQUIREMENTS[template.site_kind]}, and that is {reasons[0]} ({places} is {sites[0].name})"
    raise MapError(shown_map, allowed)


def _rank(network: RoadNetwork, site: Site, template: Template) -> int:
    try:
        return approach_rank(network, site, template.emv, DemandConfig())
    except MapError:
        return _UNREACHABLE
