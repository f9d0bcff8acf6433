"""Sites, bridges, and roads that lie over each other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hand_made_record import crossing
from map_networks import network_of_map, plain_net

from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.roads.sites import bridges, middle_of_site, overlaps


def test_a_junction_without_an_outline_has_its_own_place():
    network = crossing()
    for points in (0, 2):
        bare = replace(network.junctions["J"], outline=np.zeros((points, 2)), x_m=7.0, y_m=-3.0)
        middle = middle_of_site(replace(network, junctions={"J": bare}), {"junction": "J"})
        assert middle is not None
        assert middle.tolist() == [7.0, -3.0]
    corner = replace(network.junctions["J"], outline=np.array([(0.0, 0.0), (3.0, 0.0), (0.0, 3.0)]))
    assert middle_of_site(replace(network, junctions={"J": corner}), {"junction": "J"}) == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize(
    ("stretch", "middle"),
    [
        *[(["w_in", "e_out"], (-10.0, -5.25)), (["w_in", "e_out", "n_out"], (70.0, -6.75))],
        *[(["e_out", "w_in"], (120.0, -6.75)), (["w_in", "nowhere"], (-60.0, -5.25))],
    ],
)
def test_a_road_of_several_pieces_is_measured_as_one(stretch, middle):
    """Each piece is 100 m long; e_out has two lanes, at y = −5.25 m and −8.25 m, whose mean counts."""
    assert middle_of_site(crossing(), {"stretch": stretch}) == pytest.approx(middle)


def test_a_site_without_junction_and_road_has_no_middle():
    assert middle_of_site(crossing(), {}) is None
    assert middle_of_site(crossing(), {"stretch": ["nowhere"]}) is None


def net(*shapes: str, function: str = "normal") -> bytes:
    lanes = (
        f'<edge id="{number}" function="{function if number else "normal"}" from="a{number}" to="b{number}">'
        f'<lane id="{number}_0" index="0" speed="10" shape="{shape}"/></edge>'
        for number, shape in enumerate(shapes)
    )
    return f"<net>{''.join(lanes)}</net>".encode()


@pytest.mark.parametrize(
    ("other", "places"),
    [("30,-50 30,50", [(30.0, 0.0)]), ("100,0 100,50", []), ("0,5 100,5", []), ("20,-10 40,10", [(30.0, 0.0)])],
)
def test_a_bridge_is_where_two_roads_cross(other: str, places: list[tuple[float, float]]) -> None:
    found = [point for *edges, points in bridges(parse_road_network(net("0,0 100,0", other))) for point in points]
    np.testing.assert_allclose(np.reshape(found, (-1, 2)), np.reshape(places, (-1, 2)), atol=1e-9)


def test_paths_across_junctions_are_no_bridges() -> None:
    assert len(bridges(parse_road_network(net("0,0 100,0", "30,-50 30,50", function="internal")))) == 0


@pytest.mark.parametrize(
    ("other", "stretch"),
    [
        ("0,2 100,2", (0.0, 100.0)),
        ("100,2 0,2", (0.0, 100.0)),
        ("0,3 100,3", None),
        ("0,40 40,2 60,2 100,40", (39.0, 61.0)),
        ("30,-50 30,50", None),
        ("100,0 200,0", None),
    ],
    ids=["beside", "against", "apart", "for a while", "a bridge", "after"],
)
def test_a_road_lies_over_another_one_where_their_middles_are_nearer_than_a_bus_is_wide(
    other: str, stretch: tuple[float, float] | None
) -> None:
    found = overlaps(parse_road_network(net("0,0 100,0", other)))
    if stretch is None:
        assert found == {}
    else:
        assert set(found) == {(0, 1), (1, 0)}
        assert found[0, 1] == pytest.approx(stretch, abs=1.0)


def test_lanes_of_one_road_and_paths_over_one_junction_are_none(tmp_path: Path) -> None:
    """The paths from both roads into one, and from it into both, lie over each other and are SUMO's business."""
    nodes = {"A": (-200, 0), "B": (-200, 30), "C": (0, 0), "D": (100, 0), "E": (300, 0), "F": (300, 30)}
    places = "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in nodes.items())
    edges = "".join(f'<edge id="{ends}" from="{ends[0]}" to="{ends[1]}"/>' for ends in ("AC", "BC", "CD", "DE", "DF"))
    network = network_of_map(plain_net(tmp_path, places, edges))
    assert len([lane for lane in network.lanes if lane.kind is LaneKind.INTERNAL]) >= 4
    assert {
        frozenset(network.edges[network.lanes[lane].edge].edge_id for lane in pair) for pair in overlaps(network)
    } <= {frozenset({"AC", "BC"}), frozenset({"DE", "DF"})}
