"""The map on which a template happens: itself where it has a good site, else a variant that has one."""

from dataclasses import replace
from pathlib import Path

import pytest

from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.generation.site_choice import good_sites, needed_m
from siren_ros.running.generation.template_map import map_of_template
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.templates import available_templates, load_template
from test.map_networks import plain_net


@pytest.mark.parametrize("name", available_templates())
def test_a_built_in_map_has_no_variant(name: str) -> None:
    template = load_template(name)
    compiled = compile_map(Path(template.map_name) if template.map_name else None)
    assert map_of_template(template, compiled, None) is compiled


def trunk_road(folder: Path, speed_mps: float) -> Path:
    """A road of 400 m with two lanes that leads to a junction; another road crosses it on a bridge."""
    return plain_net(
        folder,
        '<node id="A" x="-400" y="0"/><node id="J" x="0" y="0"/><node id="E" x="300" y="0"/>'
        '<node id="S" x="0" y="-300"/>'
        '<node id="N" x="-200" y="300"/><node id="F" x="-200" y="-300"/>',
        f'<edge id="trunk" from="A" to="J" numLanes="2" speed="{speed_mps}"/>'
        '<edge id="on" from="J" to="E" speed="13.9"/><edge id="off" from="J" to="S" speed="13.9"/>'
        '<edge id="bridge" from="N" to="F" speed="13.9"/>',
    )


def test_a_road_out_of_town_is_prolonged_for_a_jam_and_the_bridge_closed(tmp_path: Path) -> None:
    template, source = load_template("S8"), trunk_road(tmp_path, 27.8)
    compiled = compile_map(source, tmp_path)
    variant = map_of_template(template, compiled, source)
    network = parse_road_network(variant.read_bytes())
    (site,) = good_sites(network, template)
    assert not good_sites(parse_road_network(compiled.read_bytes()), template)
    assert site.length_m >= needed_m(template)
    trunk, bridge = network.edge_by_id["trunk"], network.edge_by_id["bridge"]
    assert trunk.prolonged_m == pytest.approx(site.length_m - 400.0, abs=15.0)
    assert not network.lanes[bridge.lanes[0]].civilian_allowed
    assert variant.variant == "motorway without bridges"


def test_a_road_of_a_town_is_not_prolonged(tmp_path: Path) -> None:
    source = trunk_road(tmp_path, 13.9)
    compiled = compile_map(source, tmp_path)
    assert map_of_template(load_template("S8"), compiled, source) is compiled


def test_a_cycle_lane_is_for_cyclists_where_there_are_some(tmp_path: Path) -> None:
    """The EMV uses it elsewhere, and the description names it."""
    source = plain_net(
        tmp_path,
        '<node id="W" x="-300" y="0"/><node id="J" x="0" y="0" type="traffic_light"/><node id="E" x="300" y="0"/>'
        '<node id="S" x="0" y="-300"/>',
        '<edge id="w" from="W" to="J" numLanes="2" speed="13.9"><lane index="0" allow="bicycle" width="2.0"/>'
        '<lane index="1" disallow="bicycle"/></edge><edge id="e" from="J" to="E" speed="13.9"/>'
        '<edge id="s" from="J" to="S" speed="13.9"/><edge id="n" from="S" to="J" speed="13.9"/>',
    )
    template, compiled = load_template("S7"), compile_map(source, tmp_path)
    assert map_of_template(template, compiled, source, cyclists=True) is compiled
    variant = map_of_template(template, compiled, source)
    assert [site.name for site in good_sites(parse_road_network(variant.read_bytes()), template)] == ["w..s"]
    setup = set_up_episode(EpisodeRequest("S7", sensors="none", map=str(source)))
    assert setup.description.site["map_variant"] == variant.variant == "cycle_lane"
    without = replace(template, spaces=("shoulder", "parking_lane"))
    assert map_of_template(without, compiled, source) is compiled
