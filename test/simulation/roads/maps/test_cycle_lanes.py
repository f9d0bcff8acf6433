from pathlib import Path

import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.simulation.roads.maps.cycle_lanes import with_cycle_lanes
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind

FILES = {
    "--edge-files": b"""<edges>
    <edge id="a" type="arterial" numLanes="2"><lane index="0" allow="pedestrian"/><lane index="1"/></edge>
    <edge id="b" type="arterial" numLanes="2"><lane index="0" allow="pedestrian"/><lane index="1"/></edge>
    <edge id="c" type="lane" numLanes="2"><lane index="0" allow="pedestrian"/><lane index="1"/></edge></edges>""",
    "--connection-files": b"""<connections><connection from="a" to="b" fromLane="0" toLane="0"/>
    <connection from="a" to="b" fromLane="1" toLane="1"/><connection from="a" to="c" fromLane="1" toLane="1"/>
    <connection from="c" to="c" fromLane="1" toLane="1"/><crossing node="n" edges="a b"/></connections>""",
    "--tllogic-files": b"""<tlLogics><connection from="a" to="b" fromLane="1" toLane="1" tl="n" linkIndex="3"/>
    </tlLogics>""",
}


def movements(content):
    wanted = "from", "to", "fromLane", "toLane", "linkIndex"
    return [tuple(c.get(key, "") for key in wanted) for c in fromstring(content).iterfind("connection")]


def test_lanes_and_movements_shift_and_those_of_cyclists_are_added():
    files = with_cycle_lanes(FILES)
    lanes = {
        edge.get("id"): [(lane.get("index"), lane.get("allow")) for lane in edge]
        for edge in fromstring(files["--edge-files"])
    }
    wide = [("0", "pedestrian"), ("1", "bicycle"), ("2", None)]
    assert lanes == {"a": wide, "b": wide, "c": [("0", "pedestrian"), ("1", None)]}
    assert movements(files["--connection-files"]) == [
        *[("a", "b", "0", "0", ""), ("a", "b", "2", "2", ""), ("a", "c", "2", "1", ""), ("c", "c", "1", "1", "")],
        *[("a", "b", "1", "1", ""), ("a", "c", "1", "1", "")],
    ]
    assert movements(files["--tllogic-files"]) == [("a", "b", "2", "2", "3"), ("a", "b", "1", "1", "3")]


@pytest.fixture(scope="module")
def nets(cache):
    return [parse_road_network(compile_map(name, cache).read_bytes()) for name in (None, Path("city"))]


def test_the_city_has_the_lanes_and_movements_of_the_town_and_cycle_lanes(nets):
    town, city = nets
    kinds = [[lane.kind for lane in net.lanes if lane.kind is not LaneKind.INTERNAL] for net in nets]
    assert sorted(kinds[1]) == sorted([*kinds[0], *[LaneKind.CYCLE] * kinds[1].count(LaneKind.CYCLE)])
    assert kinds[1].count(LaneKind.CYCLE) == 32

    def ways(net):
        named = [(net.lanes[c.from_lane], net.lanes[c.to_lane], c.signal_link) for c in net.connections]
        return sorted(
            (net.edges[a.edge].edge_id, net.edges[b.edge].edge_id, len(net.edges[a.edge].lanes) - a.position, link)
            for a, b, link in named
        )

    assert ways(city) == ways(town)
    assert not town.cycle_connections


def test_cyclists_can_go_wherever_cars_can_from_a_cycle_lane(nets):
    _, city = nets

    def pairs(connections):
        return {(city.lanes[c.from_lane].edge, city.lanes[c.to_lane].edge) for c in connections}

    cycle = [lane for lane in city.lanes if lane.kind is LaneKind.CYCLE]
    wide = {lane.edge for lane in cycle}
    assert pairs(city.cycle_connections) == {pair for pair in pairs(city.connections) if wide & {*pair}}
    for lane in cycle:
        assert not lane.civilian_allowed
        assert not lane.emergency_allowed
        right = city.neighbour(lane, -1)
        assert right is not None
        assert right.kind is LaneKind.SIDEWALK


def test_cyclists_go_with_the_signal_of_their_direction(nets):
    _, city = nets
    for movement in city.cycle_connections:
        pair = city.lanes[movement.from_lane].edge, city.lanes[movement.to_lane].edge
        others = [
            other.signal_link
            for other in city.connections
            if (city.lanes[other.from_lane].edge, city.lanes[other.to_lane].edge) == pair
        ]
        assert movement.signal_link in others
