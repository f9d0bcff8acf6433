"""Space beside the right lane: who finds it, where lanes and movements then are, and what stays as it was."""

from pathlib import Path

import numpy as np
import pytest

from siren_ros.simulation.roads.maps.map_compiler import CompiledMap, compile_map
from siren_ros.simulation.roads.maps.road_space import with_motorway_lanes, with_space
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork, right_hand_image
from siren_ros.simulation.roads.site_finder import find_sites
from siren_ros.simulation.roads.sites import SiteKind
from test.map_networks import plain_net

NODES = (
    '<node id="W" x="-300" y="0"/><node id="J" x="0" y="0" type="priority"/><node id="E" x="300" y="0"/>'
    '<node id="S" x="0" y="-300"/>'
)
ROADS = "w:W:J e:J:E n:S:J s:J:S"
CYCLE = '<lane index="0" allow="bicycle" width="{}"/><lane index="1" disallow="bicycle"/>'
WIDE = '<lane index="0" width="{}"/>'


def crossing(folder: Path, approach: str, lanes: int = 1) -> CompiledMap:
    """A T-junction where the way from W to S turns right; ``approach`` has the lanes of the edge from W."""
    edges = (road.split(":") for road in ROADS.split())
    text = "".join(
        f'<edge id="{name}" from="{start}" to="{end}" numLanes="{lanes if name == "w" else 1}" speed="13.9">'
        f"{approach if name == 'w' else ''}</edge>"
        for name, start, end in edges
    )
    return compile_map(plain_net(folder, NODES, text), folder)


def opened(compiled: CompiledMap, space: str) -> tuple[RoadNetwork, tuple[str, ...]]:
    """The network with a kind of space, and the names of its right turns along it."""
    network = right_hand_image(parse_road_network(with_space(compiled, space, None).read_bytes()))
    return network, tuple(site.name for site in find_sites(network, SiteKind.SHOULDER_RIGHT_TURN))


@pytest.mark.parametrize(
    ("space", "approach", "lanes", "widths_m"),
    [
        ("cycle_lane", CYCLE.format(2.0), 2, [2.0, 3.2]),
        ("wide_lane", WIDE.format(5.5), 1, [2.5, 3.0]),
    ],
)
def test_space_beside_the_queue_leads_into_the_right_turn(
    tmp_path: Path, space: str, approach: str, lanes: int, widths_m: list[float]
) -> None:
    network, turns = opened(crossing(tmp_path, approach, lanes), space)
    assert turns == ("w..s",)
    beside, driving = (network.lanes[lane] for lane in network.edge_by_id["w"].lanes)
    assert [lane.kind for lane in (beside, driving)] == [LaneKind.SHOULDER, LaneKind.DRIVING]
    np.testing.assert_allclose([beside.width_m, driving.width_m], widths_m)
    _, left_m = driving.centre.project(beside.centre.at(100.0))
    assert float(left_m) == pytest.approx(-0.5 * sum(widths_m), abs=0.01)
    (turn,) = (way for way in network.connections_from[beside.index] if way.direction == "r")
    assert network.lanes[turn.to_lane].kind is LaneKind.DRIVING


@pytest.mark.parametrize(
    ("space", "approach", "lanes"),
    [("cycle_lane", CYCLE.format(1.5), 2), ("wide_lane", WIDE.format(5.0), 1), ("parking_lane", WIDE.format(5.5), 1)],
)
def test_a_map_without_the_space_stays_as_it_is(tmp_path: Path, space: str, approach: str, lanes: int) -> None:
    compiled = crossing(tmp_path, approach, lanes)
    assert with_space(compiled, space, None) is compiled


OSM = """<osm version="0.6">{nodes}
<way id="1"><nd ref="1"/><nd ref="2"/>{tags}<tag k="highway" v="secondary"/></way>
<way id="2"><nd ref="2"/><nd ref="3"/><tag k="highway" v="secondary"/></way>
<way id="3"><nd ref="2"/><nd ref="4"/><tag k="highway" v="secondary"/>{side}</way></osm>"""
PLACES = {1: (0.0, -0.003), 2: (0.0, 0.0), 3: (0.0, 0.003), 4: (-0.003, 0.0)}


@pytest.mark.parametrize(
    ("space", "tag", "value", "width_m"),
    [
        ("parking_lane", "parking:right", "lane", 2.0),
        ("parking_lane", "parking:lane:both", "parallel", 2.0),
        ("parking_lane", "parking:left", "lane", None),
        ("parking_lane", "parking:both", "street_side", None),
        ("shoulder", "shoulder", "right", 2.5),
        ("shoulder", "shoulder", "no", None),
        ("cycle_lane", "cycleway", "lane", 1.85),
        ("cycle_lane", "cycleway", "track", None),
    ],
)
def test_tags_tell_of_space(tmp_path: Path, space: str, tag: str, value: str, width_m: float | None) -> None:
    nodes = "".join(f'<node id="{name}" lat="{lat}" lon="{lon}"/>' for name, (lat, lon) in PLACES.items())
    source = tmp_path / "tags.osm"
    source.write_text(OSM.format(nodes=nodes, tags=f'<tag k="{tag}" v="{value}"/>', side=""))
    compiled = compile_map(source, tmp_path)
    network = parse_road_network(with_space(compiled, space, source).read_bytes())
    before = parse_road_network(compiled.read_bytes())
    beside = [lane for lane in network.lanes if lane.kind is LaneKind.SHOULDER and lane.lane_id == "1_0"]
    assert [lane.width_m for lane in beside] == ([] if width_m is None else [width_m])
    driving, old = (
        next(net.lanes[lane] for lane in net.edge_by_id["1"].lanes if net.lanes[lane].kind is LaneKind.DRIVING)
        for net in (network, before)
    )
    apart_m = old.centre.project(driving.centre.at(50.0) + network.sumo_offset_m - before.sumo_offset_m)[1]
    assert float(apart_m) == pytest.approx(0.0, abs=0.05), "the driving lanes stay in place"


def test_motorways_get_their_lanes_where_the_map_states_no_width(tmp_path: Path) -> None:
    net = plain_net(
        tmp_path,
        '<node id="A" x="0" y="0"/><node id="B" x="500" y="0"/><node id="C" x="1000" y="0"/>',
        '<edge id="fast" from="A" to="B" numLanes="2" speed="30" spreadType="center"/>'
        '<edge id="narrow" from="B" to="C" numLanes="2" speed="30" width="3.0" spreadType="center"/>',
    )
    network = parse_road_network(with_motorway_lanes(net.read_bytes()))
    widths = {
        name: {network.lanes[lane].width_m for lane in network.edge_by_id[name].lanes} for name in ("fast", "narrow")
    }
    assert widths == {"fast": {3.75}, "narrow": {3.0}}
