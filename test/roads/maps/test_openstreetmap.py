"""Signs, limits and one-way streets of OpenStreetMap reach the compiled net."""

from pathlib import Path

import pytest
from defusedxml.ElementTree import fromstring
from repository import REPOSITORY

from siren_ros.errors import MapError
from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.maps.openstreetmap import signed_edges
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.roads.road_network import JunctionKind, RoadNetwork

SIGNS = REPOSITORY / "test" / "maps" / "signs.osm"


def compiled(tmp_path: Path, text: str) -> tuple[bytes, RoadNetwork]:
    file = tmp_path / "map.osm"
    file.write_text(text, encoding="utf-8")
    net = compile_map(file, tmp_path / "cache").read_bytes()
    return net, parse_road_network(net)


def stopping(network: RoadNetwork, junction: str) -> set[str]:
    """Edges whose traffic has to stop at a junction."""
    return {
        network.edges[network.lanes[movement.from_lane].edge].edge_id
        for movement in network.connections
        if movement.junction == junction and movement.must_stop
    }


@pytest.fixture(scope="module")
def signs(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, RoadNetwork]:
    return compiled(tmp_path_factory.mktemp("maps"), SIGNS.read_text(encoding="utf-8"))


def test_stop_signs_before_a_junction_bind_their_approaches(signs: tuple[bytes, RoadNetwork]) -> None:
    network = signs[1]
    assert network.junctions["10"].kind is JunctionKind.PRIORITY_STOP
    assert stopping(network, "10") == {"101#0", "-101#1"}


def test_a_stop_sign_at_the_junction_itself_binds_all_approaches(signs: tuple[bytes, RoadNetwork]) -> None:
    network = signs[1]
    assert network.junctions["13"].kind is JunctionKind.ALL_WAY_STOP
    assert stopping(network, "13") == {"101#1", "103#0", "-103#1"}


def test_a_give_way_sign_lowers_the_priority_of_its_approach(signs: tuple[bytes, RoadNetwork]) -> None:
    priority = {edge.get("id"): edge.get("priority") for edge in fromstring(signs[0]).iterfind("edge")}
    assert int(priority["102"] or 0) < int(priority["-102"] or 0), "the sign stands for traffic towards the main road"
    assert int(priority["102"] or 0) < min(int(priority[edge] or 0) for edge in ("100#0", "-100#1"))


def test_limits_and_one_way_streets_are_those_of_the_map(signs: tuple[bytes, RoadNetwork]) -> None:
    network = signs[1]
    limits = {network.edges[lane.edge].edge_id: lane.speed_limit_mps for lane in network.lanes if lane.civilian_allowed}
    assert limits["100#1"] == pytest.approx(50.0 / 3.6, abs=0.01)
    assert limits["101#0"] == pytest.approx(30.0 / 3.6, abs=0.01)
    assert limits["102"] == pytest.approx(20.0 * 0.44704, abs=0.05)
    assert "104" in network.edge_by_id
    assert "-104" not in network.edge_by_id


def test_a_direction_says_for_whom_a_sign_stands(tmp_path: Path) -> None:
    text = SIGNS.read_text(encoding="utf-8")
    net = fromstring(compiled(tmp_path, text)[0])
    assert signed_edges(text.encode(), net).stopping == {"101#0", "-101#1", "101#1", "103#0", "-103#1"}
    away = text.replace('k="direction" v="forward"', 'k="direction" v="backward"')
    assert signed_edges(away.encode(), net).stopping == {"-101#1", "101#1", "103#0", "-103#1"}
    assert signed_edges(away.encode(), net).yielding == {"102"}


def test_without_signs_nobody_has_to_stop(tmp_path: Path) -> None:
    text = SIGNS.read_text(encoding="utf-8").replace('k="highway" v="stop"', 'k="x" v="y"').replace("give_way", "z")
    _, network = compiled(tmp_path, text)
    kinds = {junction.kind for junction in network.junctions.values()}
    assert not kinds & {JunctionKind.ALL_WAY_STOP, JunctionKind.PRIORITY_STOP}
    assert not any(movement.must_stop for movement in network.connections)


def test_a_map_of_a_place_with_left_hand_traffic_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="keeps left"):
        compiled(tmp_path, SIGNS.read_text(encoding="utf-8").replace('lon="13.', 'lon="-0.'))
