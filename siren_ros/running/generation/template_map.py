"""The map on which a template happens.

It is the map itself where the template has a good site there. Elsewhere it is the map with what the template needs.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from siren_ros.running.generation.site_choice import crossing_roads, good_sites, needed_m
from siren_ros.simulation.roads.maps.map_compiler import CompiledMap, changed_map, with_lanes_closed
from siren_ros.simulation.roads.maps.map_source import SourceKind
from siren_ros.simulation.roads.maps.netconvert import mended_lanes
from siren_ros.simulation.roads.maps.prolonged_ends import with_prolonged_ends
from siren_ros.simulation.roads.maps.road_space import with_motorway_lanes, with_space
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork, right_hand_image
from siren_ros.simulation.roads.site_finder import find_sites
from siren_ros.simulation.roads.sites import EXIT_M, SiteKind
from siren_ros.simulation.scenario.scenario import Template


def map_of_template(
    template: Template, compiled: CompiledMap, source: Path | None, *, cyclists: bool = False
) -> CompiledMap:
    """The first of the map and its variants on which a template has a good site; the map where it has none.

    Args:
        template: The template as its file has it.
        compiled: The compiled map.
        source: The file of the map, or the name of a built-in one; None is the town.
        cyclists: Whether somebody cycles in the episode; cycle lanes are then theirs.

    Raises:
        MapError, InputError: The map cannot be compiled.
    """
    made = _VARIANTS.get(template.site_kind)
    for variant in made(template, compiled, source, cyclists) if made else ():
        if good_sites(_driven(variant), template):
            return variant
    return compiled


def _driven(compiled: CompiledMap) -> RoadNetwork:
    return right_hand_image(parse_road_network(compiled.read_bytes()))


def _motorways(template: Template, compiled: CompiledMap, _: Path | None, __: bool) -> Iterator[CompiledMap]:
    """The map, with longer and wider motorways, and with the roads closed that cross these on bridges."""
    yield compiled
    longer_m = needed_m(template) + EXIT_M

    def changed(net: bytes) -> bytes:
        wide = with_motorway_lanes(net)
        longer = with_prolonged_ends(wide, parse_road_network(wide), (), longer_m, out_of_town=True)
        return mended_lanes(longer)

    longer = changed_map(compiled, f"motorways 3 {longer_m:.0f}", changed, "motorway")
    yield longer
    network = _driven(longer)
    crossing = {edge for site in find_sites(network, template.site_kind) for edge in crossing_roads(network, site)}
    lanes = {network.lanes[lane].lane_id for edge in crossing for lane in network.edges[edge].lanes}
    key = " ".join(("closed 1", *sorted(lanes)))
    closing = partial(with_lanes_closed, chosen=lambda lane: lane.attrib["id"] in lanes)
    yield changed_map(longer, key, closing, "motorway without bridges")


def _spaces(template: Template, compiled: CompiledMap, source: Path | None, cyclists: bool) -> Iterator[CompiledMap]:
    """The map, and the map with each kind of space that the template may use beside a queue."""
    if "shoulder" in template.spaces:
        yield compiled
    for space in template.spaces if compiled.kind is not SourceKind.BUILT_IN else ():
        if space != "cycle_lane" or not cyclists:
            yield with_space(compiled, space, source)


_VARIANTS: Final[Mapping[SiteKind, Callable[[Template, CompiledMap, Path | None, bool], Iterator[CompiledMap]]]] = {
    SiteKind.MOTORWAY_STRETCH: _motorways,
    SiteKind.SHOULDER_RIGHT_TURN: _spaces,
}
"""The map and its variants, the first ones preferred, for each kind of site that has any."""
