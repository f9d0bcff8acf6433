"""``siren sites``: the places of a map at which the templates can happen."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from siren_ros.base.tables.table import Row, Table
from siren_ros.cli.command import Command
from siren_ros.cli.study_options import BUILT_IN
from siren_ros.errors import EXIT_OK
from siren_ros.running.generation.site_choice import has_shoulder, shortcomings
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.mirror_image import right_hand_image
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.roads.sites import Site
from siren_ros.simulation.scenario.scenario import Template
from siren_ros.simulation.scenario.templates import available_templates, load_template

_HEAD = ("template", "site", "good", "street", "junction", "length m", "lanes", "shoulder", "lacks")


def add_arguments(verb: Command) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Lists the sites of a map for each template, the best first. A seed draws one of the good ones; a name "
        "pins the site: -p site:=NAME, or siren generate --sites NAME. The last column says what the others lack."
    )
    verb.add_argument("map", nargs="?", default="", metavar="MAP", help=f"map file, or {BUILT_IN} (default: town)")
    verb.add_argument("--templates", nargs="+", metavar="ID", help="S1 to S8, or template files (default: all)")
    verb.add_argument("--all", action="store_true", help="also sites that lack something, which no seed draws")
    verb.add_argument(
        "--out", type=Path, metavar="FILE.png", help="also draw the map with its sites, and what places lack"
    )
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Prints the table; a template without a line has no site on the map."""
    network = parse_road_network(compile_map(Path(arguments.map) if arguments.map else None).read_bytes())
    templates = [load_template(name) for name in arguments.templates or available_templates()]
    found = [(template, shortcomings(right_hand_image(network), template)) for template in templates]
    rows = tuple(row for survey in found for row in _rows(network, *survey, lacking=arguments.all))
    print(*Table("sites", "", _HEAD, rows, specs={"length m": ".0f"}).text(), sep="\n")
    if arguments.out is not None:
        from siren_ros.scoring.pictures.site_map import save_site_map  # noqa: PLC0415 - matplotlib takes as long as the table

        print(save_site_map(network, found, arguments.out))
    return EXIT_OK


def _rows(
    network: RoadNetwork, template: Template, found: Mapping[Site, Sequence[str]], *, lacking: bool
) -> Iterator[Row]:
    # Where no site is good, episodes take the best of these sites.
    for site, missing in found.items():
        if lacking or not missing or all(found.values()):
            yield _row(network, template, site, missing)


def _row(network: RoadNetwork, template: Template, site: Site, missing: Sequence[str]) -> Row:
    street = network.edges[site.site_edge].name
    lanes = str(len(site.connections)) if site.connections else ""
    shoulder = "yes" if has_shoulder(network, site) else "no"
    junction = site.junction or ""
    good, lacks = "no" if missing else "yes", "; ".join(missing)
    return template.template_id, site.name, good, street, junction, site.length_m, lanes, shoulder, lacks
