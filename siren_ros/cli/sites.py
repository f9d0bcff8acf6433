"""``siren sites``: the places of a map at which the templates can happen."""

import argparse
from collections.abc import Iterator
from pathlib import Path

from siren_ros.cli.command import Command
from siren_ros.errors import EXIT_OK
from siren_ros.generation.site_choice import good_sites, has_shoulder, ranked_sites
from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.roads.sites import Site
from siren_ros.scenario.scenario import Template
from siren_ros.scenario.templates import available_templates, load_template
from siren_ros.tables.table import Row, Table

_HEAD = ("template", "site", "good", "street", "junction", "length m", "lanes", "shoulder")


def add_arguments(verb: Command) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Lists the sites of a map for each template, the best first. A seed draws one of the good ones; a name "
        "pins the site: -p site:=NAME, or siren generate --sites NAME."
    )
    verb.add_argument("map", nargs="?", default="", metavar="MAP", help="map file (default: the built-in town)")
    verb.add_argument("--templates", nargs="+", metavar="ID", help="S1 to S7, or template files (default: all)")
    verb.add_argument("--all", action="store_true", help="also sites that lack something, which no seed draws")
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Prints the table; a template without a line has no site on the map."""
    network = parse_road_network(compile_map(Path(arguments.map) if arguments.map else None).read_bytes())
    templates = [load_template(name) for name in arguments.templates or available_templates()]
    rows = tuple(row for template in templates for row in _rows(network, template, lacking=arguments.all))
    print(*Table("sites", "", _HEAD, rows, specs={"length m": ".0f"}).text(), sep="\n")
    return EXIT_OK


def _rows(network: RoadNetwork, template: Template, *, lacking: bool) -> Iterator[Row]:
    good = {site.name for site in good_sites(network, template)}
    # Where no site is good, episodes take the best of the others.
    for site, _ in ranked_sites(network, template):
        if site.name in good or lacking or not good:
            yield _row(network, template, site, good=site.name in good)


def _row(network: RoadNetwork, template: Template, site: Site, *, good: bool) -> Row:
    street = network.edges[site.site_edge].name
    lanes = str(len(site.connections)) if site.connections else ""
    shoulder = "yes" if has_shoulder(network, site) else "no"
    junction = site.junction or ""
    return template.template_id, site.name, "yes" if good else "no", street, junction, site.length_m, lanes, shoulder
