"""Signals, stop signs, shoulders and longer roads that are added to a map, and what stays as it was."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from made_crossing import made_net

from siren_ros.errors import InputError
from siren_ros.simulation.roads.maps.amended_map import ADDITIONS, additions_of, amended_map, places_for
from siren_ros.simulation.roads.maps.netconvert import sumo_home
from siren_ros.simulation.roads.maps.prolonged_ends import NEEDED_M
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import connections_between, driving_lanes

NODES = {"a": (0, 0), "c": (300, 0), "n": (0, 300), "s": (0, -300), "w": (-300, 0), "cn": (300, 300), "ce": (600, 0)}
STREETS = ("a c", "a n", "a s", "a w", "c cn", "c ce")
"""A crossing a without control, and a junction c with a signal."""


@pytest.fixture(scope="module", params=["", "--lefthand"])
def net(request, tmp_path_factory) -> bytes:
    return made_net(tmp_path_factory.mktemp("net"), NODES, STREETS, *request.param.split())


def amended(net: bytes, *additions: str) -> RoadNetwork:
    return parse_road_network(amended_map(net, additions, "made"))


def movements(network: RoadNetwork, junction: str) -> list:
    return [way for _, way in network.connections_at[junction]]


def test_a_junction_gets_a_signal_and_the_other_one_keeps_its_own(net: bytes) -> None:
    before, after = parse_road_network(net), amended(net, "signal:a")
    assert (before.junctions["a"].kind, after.junctions["a"].kind) == (JunctionKind.PRIORITY, JunctionKind.SIGNAL)
    assert all(way.signal_id == "a" and way.alternates for way in movements(after, "a") if way.direction == "s")
    assert [way.signal_link for way in movements(after, "c")] == [way.signal_link for way in movements(before, "c")]
    assert [edge.edge_id for edge in after.edges if not edge.internal] == [
        edge.edge_id for edge in before.edges if not edge.internal
    ]


def test_all_approaches_of_a_junction_get_a_stop_sign(net: bytes) -> None:
    after = amended(net, "all_way_stop:a")
    assert after.junctions["a"].kind is JunctionKind.ALL_WAY_STOP
    assert all(way.must_stop for way in movements(after, "a"))
    assert places_for(after)["all_way_stop"] == []


@pytest.mark.parametrize("turn", [("s_a", "a_c"), ("a_c", "c_cn")])
def test_shoulders_lie_outside_and_lead_on_along_a_movement(net: bytes, turn: tuple[str, str]) -> None:
    before = parse_road_network(net)
    after = amended(net, *(f"shoulder:{edge}" for edge in turn))
    first, second = (after.lanes[after.edge_by_id[edge].lanes[0]] for edge in turn)
    for lane in (first, second):
        old, new = (
            driving_lanes(network, network.edge_by_id[after.edges[lane.edge].edge_id].index)
            for network in (before, after)
        )
        assert (lane.kind, lane.width_m, lane.civilian_allowed) == (LaneKind.SHOULDER, 2.5, False)
        assert len(new) == len(old)
        middle = new[0].centre.at(100.0)
        assert abs(old[0].centre.project(middle)[1]) < 0.1, "the driving lanes stay"
        outwards = -1.0 if not before.left_hand else 1.0
        aside_m = float(new[0].centre.project(lane.centre.at(100.0))[1])
        assert outwards * aside_m == pytest.approx(0.5 * (new[0].width_m + 2.5), abs=0.1)
    (beside, *_) = connections_between(before, *(before.edge_by_id[edge].index for edge in turn))
    along = [way for way in after.connections_from.get(first.index, ()) if way.to_lane == second.index]
    assert len(along) == (beside.direction == ("l" if before.left_hand else "r"))
    assert {(way.signal_id, way.signal_link) for way in along} <= {(beside.signal_id, beside.signal_link)}
    assert not set(turn) & set(places_for(after)["shoulder"])
    for name, later in (turn, turn[::-1]):
        again = amended(amended_map(net, [f"shoulder:{name}"], "made"), f"shoulder:{later}")
        ends = [again.edge_by_id[edge].lanes[0] for edge in turn]
        ways = [way for way in again.connections_from.get(ends[0], ()) if way.to_lane == ends[1]]
        assert len(ways) == len(along), "also along a shoulder that the map has already"


def test_a_road_becomes_longer_as_far_as_there_is_space(net: bytes, tmp_path: Path) -> None:
    """To the north of n there is nothing; a road passes 120 m to the south of s."""
    nodes = {**NODES, "p": (-400, -420), "q": (400, -420)}
    crowded = made_net(
        tmp_path, nodes, (*STREETS, "p q"), *(["--lefthand"] if parse_road_network(net).left_hand else [])
    )
    before, after = parse_road_network(crowded), amended(crowded, "longer:a_n", "longer:s_a")
    assert after.edge_by_id["n_a"].prolonged_m == after.edge_by_id["a_n"].prolonged_m == pytest.approx(NEEDED_M)
    assert 80.0 < after.edge_by_id["s_a"].prolonged_m < 120.0
    for name in ("n_a", "s_a"):
        lane, was = (network.lanes[network.edge_by_id[name].lanes[0]] for network in (after, before))
        assert lane.length_m - was.length_m == pytest.approx(after.edge_by_id[name].prolonged_m, abs=0.2)
    again = amended(amended_map(crowded, ["longer:n_a"], "made"), "longer:n_a")
    assert again.edge_by_id["n_a"].prolonged_m == pytest.approx(2.0 * NEEDED_M)


def test_the_net_says_what_was_added_and_sumos_tools_read_it(net: bytes, tmp_path: Path) -> None:
    additions = ["all_way_stop:a", "longer:c_ce", "shoulder:s_a", "shoulder:a_c"]
    out = amended_map(net, additions, "made")
    assert amended_map(net, additions, "made") == out
    assert sorted(additions_of(out)) == sorted(additions)
    assert additions_of(net) == []
    file = tmp_path / "out.net.xml"
    file.write_bytes(out)
    for command in (["netconvert", "-s", file, "-o", tmp_path / "again.net.xml"], ["sumo", "-n", file, "--end", "2"]):
        said = subprocess.run(
            [sumo_home() / "bin" / command[0], *command[1:]], check=True, capture_output=True, text=True
        )
        assert "Error" not in said.stderr
    again = parse_road_network((tmp_path / "again.net.xml").read_bytes())
    network = parse_road_network(out)
    assert {lane.lane_id: lane.kind for lane in again.lanes} == {lane.lane_id: lane.kind for lane in network.lanes}
    lengths = [
        (lane.length_m, again.lane_by_id[lane.lane_id].length_m)
        for lane in network.lanes
        if lane.kind is LaneKind.DRIVING
    ]
    assert np.ptp(lengths, axis=1).max() < 0.5
    assert sorted(additions_of((tmp_path / "again.net.xml").read_bytes())) == sorted(additions)


def test_an_unknown_place_is_refused_with_those_that_there_are(net: bytes) -> None:
    places = places_for(parse_road_network(net))
    assert set(places) == set(ADDITIONS)
    assert places["signal"] == ["a"]
    for addition, allowed in (
        ("signal:c", "a"),
        ("shoulder:x", ", ".join(places["shoulder"])),
        ("longer:a_c", ", ".join(places["longer"])),
    ):
        with pytest.raises(InputError) as caught:
            amended_map(net, [addition], "made")
        assert caught.value.value == addition
        assert caught.value.allowed.endswith(allowed)
    with pytest.raises(InputError, match="all_way_stop:NAME"):
        amended_map(net, ["bridge:a"], "made")


def test_two_junctions_get_signals_and_a_joint_of_two_roads_is_none(tmp_path: Path) -> None:
    nodes = {"a": (0, 0), "b": (300, 0), "m": (150, 0), "n": (0, 200), "w": (-200, 0), "e": (500, 0), "s": (300, -200)}
    plain = made_net(tmp_path, nodes, ("a m", "m b", "a n", "a w", "b e", "b s"))
    assert sorted(places_for(parse_road_network(plain))["signal"]) == ["a", "b"]
    after = amended(plain, "signal:a", "signal:b")
    kinds = [after.junctions[name].kind for name in ("a", "b")]
    assert kinds == [JunctionKind.SIGNAL] * 2
    assert places_for(after)["signal"] == []


def test_a_shoulder_lies_between_the_sidewalk_and_the_driving_lanes(tmp_path: Path) -> None:
    options = ("--sidewalks.guess", "true", "--sidewalks.guess.max-speed", "20", "--default.lanewidth", "4.0")
    wide = made_net(tmp_path, NODES, STREETS, *options)
    after = amended(wide, "shoulder:s_a")
    walk, shoulder, *driving = (after.lanes[lane] for lane in after.edge_by_id["s_a"].lanes)
    assert [walk.kind, shoulder.kind] == [LaneKind.SIDEWALK, LaneKind.SHOULDER]
    assert {lane.kind for lane in driving} == {LaneKind.DRIVING}
    aside_m = float(driving[0].centre.project(shoulder.centre.at(100.0))[1])
    assert aside_m == pytest.approx(-0.5 * (4.0 + 2.5), abs=0.1)
