"""The map with the sites of each template: what is drawn, how it is counted, and that it repeats."""

from pathlib import Path

import pytest
from repository import REPOSITORY

from siren_ros.errors import InputError
from siren_ros.running.generation.site_choice import good_sites, shortcomings
from siren_ros.scoring.pictures.site_map import Survey, draw_site_map, save_site_map
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.roads.site_finder import places_without_site
from siren_ros.simulation.scenario.templates import available_templates, load_template

TEMPLATES = [load_template(name) for name in available_templates()]


@pytest.fixture(scope="module", params=["town", "signs.osm"])
def network(request) -> RoadNetwork:
    file = None if request.param == "town" else REPOSITORY / "test" / "maps" / request.param
    return parse_road_network(compile_map(file).read_bytes())


def surveys(network: RoadNetwork, count: int = len(TEMPLATES)) -> list[Survey]:
    return [(template, shortcomings(network, template)) for template in TEMPLATES[:count]]


def test_each_panel_counts_what_it_draws(network: RoadNetwork) -> None:
    panels = draw_site_map(network, surveys(network)).axes
    assert len(panels) == len(TEMPLATES)
    for axes, template in zip(panels, TEMPLATES, strict=True):
        sites, others = shortcomings(network, template), places_without_site(network, template.site_kind)
        good = len(good_sites(network, template))
        lines = [line for line in axes.lines if line.get_linestyle() != "None"]
        assert len(lines) == len(sites)
        assert len(axes.lines) - len(lines) == len(others)
        title = f"{good} good of {len(sites)} sites" if sites else "no site"
        assert axes.texts[-2].get_text() == f"{template.template_id}: {title}"
        legend = [text.get_text() for text in axes.get_legend().get_texts()]
        assert sum(int(text.rsplit(": ", 1)[1]) for text in legend) == len(sites) + len(others)


def test_colours_tell_what_is_lacking(network: RoadNetwork) -> None:
    for axes, template in zip(draw_site_map(network, surveys(network)).axes, TEMPLATES, strict=True):
        handles = axes.get_legend().legend_handles
        colours = [handle.get_color() for handle in handles]
        assert len(set(colours)) == len(colours)
        drawn = {line.get_color() for line in axes.lines}
        assert drawn == set(colours), template.template_id


def test_the_same_map_gives_the_same_bytes(network: RoadNetwork, tmp_path: Path) -> None:
    first, second = (save_site_map(network, surveys(network, 1), tmp_path / "sub" / f"{n}.png") for n in (1, 2))
    assert first.read_bytes() == second.read_bytes()


def test_a_picture_is_a_png_file(network: RoadNetwork, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ends in \.png"):
        save_site_map(network, surveys(network, 1), tmp_path / "sites.pdf")
