"""Where a road gets wider, vehicles need not slow down, on any map from OpenStreetMap."""

from dataclasses import replace
from pathlib import Path

import pytest
from defusedxml.ElementTree import fromstring
from made_streets import A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, C_LEFT, C_RIGHT, streets

from siren_ros.roads.maps.lane_tapers import _only_joins, taper_patches
from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.movements import movement_turn_rad
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.roads.road_network import RoadNetwork

OSM = """<?xml version="1.0"?><osm version="0.6">
<node id="1" lat="52.5200" lon="13.3900" version="1"/><node id="2" lat="52.5200" lon="13.3950" version="1"/>
<node id="3" lat="52.5200" lon="13.4000" version="1"><tag k="highway" v="traffic_signals"/></node>
<node id="4" lat="52.5200" lon="13.4050" version="1"/>
<node id="5" lat="52.5170" lon="13.4000" version="1"/><node id="6" lat="52.5230" lon="13.4000" version="1"/>
<way id="10" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="primary"/>
<tag k="lanes" v="1"/><tag k="oneway" v="yes"/><tag k="maxspeed" v="70"/></way>
<way id="11" version="1"><nd ref="2"/><nd ref="3"/><nd ref="4"/><tag k="highway" v="primary"/>
<tag k="lanes" v="3"/><tag k="oneway" v="yes"/><tag k="maxspeed" v="70"/></way>
<way id="12" version="1"><nd ref="5"/><nd ref="3"/><nd ref="6"/><tag k="highway" v="primary"/></way></osm>"""


@pytest.fixture(scope="module")
def net(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("maps")
    source: Path = folder / "wider.osm"
    source.write_text(OSM)
    return compile_map(source, folder / "cache").read_bytes()


@pytest.fixture(scope="module")
def network(net: bytes) -> RoadNetwork:
    return parse_road_network(net)


def test_a_lane_fans_out_into_three_over_a_long_way(network: RoadNetwork) -> None:
    fan = [connection for _, connection in network.connections_at["2"]]
    assert len(fan) == 3
    for connection in fan:
        assert sum(network.lanes[lane].length_m for lane in connection.via) > 20.0, "one lane aside, 30 km/h, 3 m/s²"
        assert movement_turn_rad(network, connection) < 0.8


def test_only_sharp_joints_are_lengthened(network: RoadNetwork) -> None:
    assert taper_patches(network) == []
    turns = [movement_turn_rad(network, connection) for _, connection in network.connections_at["3"]]
    assert max(turns) > 1.0, "turns at the junction are sharp and stay so"


def test_yellow_is_as_long_as_in_towns_whatever_the_limit(net: bytes) -> None:
    phases = list(fromstring(net).iter("phase"))
    assert {float(phase.attrib["duration"]) for phase in phases if "y" in phase.attrib["state"]} == {3.0}


@pytest.mark.parametrize(
    ("joined", "only_joins"),
    [
        (((A_RIGHT, B_RIGHT), (A_LEFT, B_LEFT)), True),
        (((A_RIGHT, B_RIGHT), (B_LEFT, A_LEFT)), True),
        (((A_RIGHT, B_RIGHT), (A_LEFT, C_LEFT)), False),
        (((A_RIGHT, C_RIGHT), (B_LEFT, C_LEFT)), False),
    ],
    ids=["one road", "both directions", "a fork", "a merge"],
)
def test_a_joint_neither_forks_nor_merges_nor_is_controlled(
    joined: tuple[tuple[int, int], ...], only_joins: bool
) -> None:
    roads = streets()
    plain = replace(roads.connections[0], direction="s", signal_id=None, must_stop=False)
    movements = [replace(plain, from_lane=source, to_lane=target) for source, target in joined]
    assert _only_joins(roads, movements) is only_joins
    for change in ({"direction": "r"}, {"signal_id": "J"}, {"must_stop": True}):
        assert not _only_joins(roads, [movements[0], replace(movements[1], **change)])
