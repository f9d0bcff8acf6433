"""Roads that end at a map's border too near to a junction are prolonged, and only those."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from defusedxml.ElementTree import fromstring
from made_crossing import ARMS, CROSSING, made_net

from siren_ros.simulation.roads.maps.map_compiler import compile_map, mirrored_map
from siren_ros.simulation.roads.maps.prolonged_ends import NEEDED_M, with_prolonged_ends
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork


def prolonged(net: bytes) -> RoadNetwork:
    return parse_road_network(with_prolonged_ends(net, parse_road_network(net)))


def end_of(network: RoadNetwork, edge: str) -> tuple[float, float]:
    """Middle of the end of an edge."""
    lanes = [network.lanes[lane] for lane in network.edge_by_id[edge].lanes]
    x_m, y_m = np.mean([lane.centre.points[-1] for lane in lanes], axis=0)
    return float(x_m), float(y_m)


def test_short_arms_reach_as_far_as_an_episode_needs_and_the_long_one_stays(tmp_path: Path) -> None:
    net = made_net(tmp_path, CROSSING, ARMS)
    before, after = parse_road_network(net), prolonged(net)
    for name, direction in (("n", (0, 1)), ("e", (1, 0)), ("s", (0, -1))):
        into, out = after.edge_by_id[f"{name}_c"], after.edge_by_id[f"c_{name}"]
        for edge in (into, out):
            old = before.edge_by_id[edge.edge_id]
            assert [after.lanes[lane].length_m for lane in edge.lanes] == pytest.approx([NEEDED_M] * 2, abs=0.2)
            longer_m = NEEDED_M - before.lanes[old.lanes[0]].length_m
            assert edge.prolonged_m == pytest.approx(longer_m, abs=0.1)
            limits = {after.lanes[lane].speed_limit_mps for lane in edge.lanes}
            assert limits == {13.9}
        moved = np.subtract(end_of(after, out.edge_id), end_of(before, out.edge_id))
        assert moved == pytest.approx(np.multiply(direction, out.prolonged_m), abs=0.1)
        node, was = after.junctions[name], before.junctions[name]
        assert (node.x_m - was.x_m, node.y_m - was.y_m) == pytest.approx(tuple(moved), abs=0.1)
        assert node.outline - was.outline == pytest.approx(np.broadcast_to(moved, node.outline.shape), abs=0.1)
    assert after.edge_by_id["w_c"].prolonged_m == after.edge_by_id["c_w"].prolonged_m == 0.0
    assert [(c.from_lane, c.to_lane, c.signal_link) for c in after.connections] == [
        (c.from_lane, c.to_lane, c.signal_link) for c in before.connections
    ]


def test_a_net_that_lacks_nothing_keeps_its_bytes(tmp_path: Path) -> None:
    """Its arms are long enough, or there is no junction."""
    arms = made_net(tmp_path, CROSSING, ARMS)
    once = with_prolonged_ends(arms, parse_road_network(arms))
    wide = made_net(tmp_path, {name: (5.0 * x, 5.0 * y) for name, (x, y) in CROSSING.items()}, ARMS)
    for net in (wide, once, made_net(tmp_path, {"a": (0, 0), "b": (100, 0), "d": (200, 0)}, ("a b", "b d"))):
        assert with_prolonged_ends(net, parse_road_network(net)) == net


def test_a_cul_de_sac_between_other_roads_stays(tmp_path: Path) -> None:
    """The road from p to q passes 400 m north of the northern arm."""
    nodes = {**CROSSING, "p": (-300.0, 460.0), "q": (300.0, 460.0)}
    after = prolonged(made_net(tmp_path, nodes, (*ARMS, "p q", "p w")))
    assert after.edge_by_id["n_c"].prolonged_m == 0.0
    assert after.edge_by_id["e_c"].prolonged_m > 100.0


@pytest.mark.parametrize("y_m", [9.0, -9.0])
def test_a_road_ahead_of_half_of_the_lanes_stands_in_the_way(tmp_path: Path, y_m: float) -> None:
    """The eastern arm and the road from p to q are 12.8 m wide."""
    after = prolonged(made_net(tmp_path, {**CROSSING, "p": (300.0, y_m), "q": (600.0, y_m)}, (*ARMS, "p q")))
    assert after.edge_by_id["e_c"].prolonged_m == 0.0
    assert after.edge_by_id["n_c"].prolonged_m > 100.0


def test_roads_that_come_together_are_prolonged_less(tmp_path: Path) -> None:
    nodes = {"c": (0, 0), "a": (0, 40), "d": (200, 0), "b": (120, 40), "w": (-300, 0), "e": (500, 0)}
    after = prolonged(made_net(tmp_path, nodes, ("w c", "c d", "d e", "a c", "b d")))
    lengths_m = {name: after.edge_by_id[name].prolonged_m for name in ("a_c", "b_d")}
    assert lengths_m["a_c"] > 180.0
    assert 0.0 < lengths_m["b_d"] < 120.0
    roads = [
        shapely.union_all([shapely.LineString(after.lanes[lane].centre.points).buffer(1.6) for lane in edge.lanes])
        for edge in (after.edge_by_id["a_c"], after.edge_by_id["b_d"])
    ]
    assert shapely.distance(*roads) > 5.0


def test_roads_beside_each_other_are_both_prolonged(tmp_path: Path) -> None:
    """Two roads of 12.8 m lie 14 m apart: nothing is ahead of either."""
    nodes = {"c": (0, 0), "a": (0, 60), "d": (14, 0), "b": (14, 60), "w": (-300, 0), "e": (300, 0)}
    after = prolonged(made_net(tmp_path, nodes, ("w c", "c d", "d e", "a c", "b d")))
    lengths_m = [after.edge_by_id[name].prolonged_m for name in ("a_c", "b_d")]
    assert lengths_m == pytest.approx([NEEDED_M - 60.0] * 2, abs=15.0)


def test_the_length_counts_over_joints(tmp_path: Path) -> None:
    nodes = {**CROSSING, "n2": (0, 150), "n3": (0, 200)}
    net = made_net(tmp_path, nodes, (*ARMS, "n2 n", "n3 n2"))
    after = prolonged(net)
    assert after.edge_by_id["n3_n2"].prolonged_m == pytest.approx(NEEDED_M - 200.0, abs=25.0)
    assert after.edge_by_id["n2_n"].prolonged_m == after.edge_by_id["n_c"].prolonged_m == 0.0
    damaged = replace(parse_road_network(net), junctions={})
    assert parse_road_network(with_prolonged_ends(net, damaged)).lanes == after.lanes, "also if it lacks junctions"


def test_the_way_back_at_a_dead_end_moves_along(tmp_path: Path) -> None:
    """Nets of users let vehicles turn round at dead ends: the path across still joins both lanes."""
    after = prolonged(made_net(tmp_path, CROSSING, ARMS, "--no-turnarounds", "false"))
    turns = [c for c in after.connections if c.junction in "nes" and c.direction == "t"]
    assert len(turns) == 3
    for turn in turns:
        ends = after.lanes[turn.from_lane].centre.points[-1], after.lanes[turn.to_lane].centre.points[0]
        path = [after.lanes[lane].centre.points for lane in turn.via]
        assert np.linalg.norm(path[0][0] - ends[0]) < 0.2
        assert np.linalg.norm(path[-1][-1] - ends[1]) < 0.2


def test_a_compiled_map_and_its_mirror_image_say_what_was_prolonged(tmp_path: Path) -> None:
    (tmp_path / "arms.net.xml").write_bytes(made_net(tmp_path, CROSSING, ARMS))
    compiled = compile_map(tmp_path / "arms.net.xml", tmp_path / "cache")
    network = parse_road_network(compiled.read_bytes())
    lengths_m = {edge.edge_id: edge.prolonged_m for edge in network.edges if edge.prolonged_m}
    assert set(lengths_m) == {"n_c", "c_n", "e_c", "c_e", "s_c", "c_s"}
    assert {lane.kind for lane in network.lanes if not network.edges[lane.edge].internal} == {LaneKind.DRIVING}
    image = parse_road_network(mirrored_map(compiled).read_bytes())
    assert {edge.edge_id: edge.prolonged_m for edge in image.edges if edge.prolonged_m} == lengths_m
    lanes = fromstring(compiled.read_bytes()).iter("lane")
    stated = {lane.attrib["id"]: float(lane.attrib["length"]) for lane in lanes}
    assert all(stated[lane.lane_id] == pytest.approx(lane.length_m, rel=0.1, abs=0.2) for lane in network.lanes)


@pytest.mark.parametrize(("y_m", "longer"), [(NEEDED_M + 2.0, False), (NEEDED_M - 10.0, True)])
def test_roads_that_lack_less_than_two_cars_stay(tmp_path: Path, y_m: float, longer: bool) -> None:
    """Some 8 m of them are on the junction."""
    after = prolonged(made_net(tmp_path, {**CROSSING, "n": (0.0, y_m)}, ARMS))
    assert (after.edge_by_id["n_c"].prolonged_m > 10.0) is longer
    assert after.edge_by_id["e_c"].prolonged_m > 100.0


def test_a_signal_between_two_roads_is_a_junction(tmp_path: Path) -> None:
    after = prolonged(made_net(tmp_path, {"c": (0, 0), "n": (0, 60), "s": (0, -400)}, ("n c", "s c")))
    assert after.edge_by_id["n_c"].prolonged_m == pytest.approx(NEEDED_M - 60.0, abs=15.0)
    assert after.edge_by_id["s_c"].prolonged_m == 0.0


def test_out_of_town_alone_roads_of_two_lanes_with_such_a_limit_are_prolonged(tmp_path: Path) -> None:
    """The way out of the northern arm has one; the eastern arm has it, too, but one lane."""
    net = made_net(tmp_path, CROSSING, ARMS, narrow="e")
    fast = re.sub(rb'(<lane id="(?:c_n|e_c|c_e)_[^>]*speed=")[0-9.]+', rb"\g<1>25.00", net)
    network = parse_road_network(fast)
    assert network.lanes[network.edge_by_id["c_n"].lanes[0]].speed_limit_mps == 25.0
    after = parse_road_network(with_prolonged_ends(fast, network, out_of_town=True))
    assert {edge.edge_id for edge in after.edges if edge.prolonged_m} == {"n_c", "c_n"}
    assert with_prolonged_ends(net, parse_road_network(net), out_of_town=True) == net
