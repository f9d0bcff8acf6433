"""Signs, limits and one-way streets of OpenStreetMap reach the compiled net, and each sign binds its edges.

Which edge a sign binds is shown by two streets that cross, in a plane that touches the Earth there.
"""

import math
import re

import pytest
from defusedxml.ElementTree import fromstring
from repository import REPOSITORY

from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.openstreetmap import drives_on, signed_edges
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import JunctionKind

SIGNS = REPOSITORY / "test" / "maps" / "signs.osm"


def compiled(tmp_path, text):
    file = tmp_path / "map.osm"
    file.write_text(text, encoding="utf-8")
    net = compile_map(file, tmp_path / "cache").read_bytes()
    return net, parse_road_network(net)


def stopping(network, junction):
    """Edges whose traffic has to stop at a junction."""
    return {
        network.edges[network.lanes[movement.from_lane].edge].edge_id
        for movement in network.connections
        if movement.junction == junction and movement.must_stop
    }


@pytest.fixture(scope="module")
def signs(tmp_path_factory):
    return compiled(tmp_path_factory.mktemp("maps"), SIGNS.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("junction", "kind", "edges"),
    [
        ("10", JunctionKind.PRIORITY_STOP, {"101#0", "-101#1"}),
        ("13", JunctionKind.ALL_WAY_STOP, {"101#1", "103#0", "-103#1"}),
    ],
)
def test_stop_signs_bind_their_approaches_and_at_the_junction_itself_all(signs, junction, kind, edges):
    assert signs[1].junctions[junction].kind is kind
    assert stopping(signs[1], junction) == edges


def test_a_give_way_sign_lowers_the_priority_of_its_approach(signs):
    priority = {edge.get("id"): edge.get("priority") for edge in fromstring(signs[0]).iterfind("edge")}
    assert int(priority["102"] or 0) < int(priority["-102"] or 0), "the sign stands for traffic towards the main road"
    assert int(priority["102"] or 0) < min(int(priority[edge] or 0) for edge in ("100#0", "-100#1"))


def test_limits_and_one_way_streets_are_those_of_the_map(signs):
    network = signs[1]
    limits = {network.edges[lane.edge].edge_id: lane.speed_limit_mps for lane in network.lanes if lane.civilian_allowed}
    assert limits["100#1"] == pytest.approx(50.0 / 3.6, abs=0.01)
    assert limits["101#0"] == pytest.approx(30.0 / 3.6, abs=0.01)
    assert limits["102"] == pytest.approx(20.0 * 0.44704, abs=0.05)
    assert "104" in network.edge_by_id
    assert "-104" not in network.edge_by_id


def test_a_direction_says_for_whom_a_sign_stands(tmp_path):
    text = SIGNS.read_text(encoding="utf-8")
    net = fromstring(compiled(tmp_path, text)[0])
    assert signed_edges(text.encode(), net)[0] == {"101#0", "-101#1", "101#1", "103#0", "-103#1"}
    away = text.replace('k="direction" v="forward"', 'k="direction" v="backward"')
    assert signed_edges(away.encode(), net) == ({"-101#1", "101#1", "103#0", "-103#1"}, {"102"})


def test_without_signs_nobody_has_to_stop(tmp_path):
    text = SIGNS.read_text(encoding="utf-8").replace('k="highway" v="stop"', 'k="x" v="y"').replace("give_way", "z")
    _, network = compiled(tmp_path, text)
    kinds = {junction.kind for junction in network.junctions.values()}
    assert not kinds & {JunctionKind.ALL_WAY_STOP, JunctionKind.PRIORITY_STOP}
    assert not any(movement.must_stop for movement in network.connections)


def test_where_traffic_keeps_left_the_map_has_the_same_roads_and_signs_on_the_other_side(tmp_path, signs):
    """The same extract, with its longitudes mirrored and moved to London, where signs stand for the same traffic."""
    west, middle = 13.4, 0.1
    text = re.sub(
        r'lon="([0-9.]+)"',
        lambda found: f'lon="{middle - (float(found.group(1)) - west):.7f}"',
        SIGNS.read_text(encoding="utf-8"),
    )
    _, network = compiled(tmp_path, text)
    assert (network.left_hand, signs[1].left_hand) == (True, False)
    assert {edge.edge_id for edge in network.edges if not edge.internal} == {
        edge.edge_id for edge in signs[1].edges if not edge.internal
    }
    for junction in ("10", "13"):
        assert stopping(network, junction) == stopping(signs[1], junction)
    for edge in (edge for edge in network.edges if not edge.internal):
        other = network.edge_by_id.get(edge.edge_id.removeprefix("-"))
        if edge.edge_id.startswith("-") and other is not None:
            mine, theirs = (network.lanes[one.lanes[0]].centre for one in (edge, other))
            assert mine.project(theirs.at(0.5 * theirs.length_m))[1] < 0.0, "oncoming traffic is on the right"


LAT, LON = 52.0, 13.0
NORTH_M = math.radians(1.0) * 6_364_900.0
"""Of a degree of latitude there: the Earth's radius of curvature along the meridian is 6 364.9 km."""
EAST_M = math.radians(1.0) * 6_391_500.0 * math.cos(math.radians(LAT))
"""Of a degree of longitude: the radius across the meridian is 6 391.5 km."""
OFFSET_M = (1000.0, 500.0)
PLACES = {"w": (-150.0, 0.0), "e": (150.0, 0.0), "n": (0.0, 150.0), "s": (0.0, -150.0), "J": (0.0, 0.0)}
ROADS = {
    "from_w": ((-150.0, -1.6), (-10.0, -1.6)), "to_w": ((-10.0, 1.6), (-150.0, 1.6)),
    "from_e": ((150.0, 1.6), (10.0, 1.6)), "to_e": ((10.0, -1.6), (150.0, -1.6)),
    "from_s": ((1.6, -150.0), (1.6, -10.0)), "to_s": ((-1.6, -10.0), (-1.6, -150.0)),
    "from_n": ((-1.6, 150.0), (-1.6, 10.0)), "to_n": ((1.6, 10.0), (1.6, 150.0)),
}  # fmt: skip
PRIMARY = '<tag k="highway" v="primary"/>'


def net(projection=f"+proj=tmerc +lat_0={LAT} +lon_0={LON}", more=""):
    edges = "".join(
        f'<edge id="{name}"><lane id="{name}_0" shape="{_text(start)} {_text(end)}"/></edge>'
        for name, (start, end) in ROADS.items()
    )
    place = f"{OFFSET_M[0]},{OFFSET_M[1]}"
    return f'<net><location netOffset="{place}" projParameter="{projection}"/>{edges}{more}</net>'


def _text(place):
    return f"{place[0] + OFFSET_M[0]},{place[1] + OFFSET_M[1]}"


def sign(at, kind="stop", **tags):
    """A node of the street from west to east, or one of its places."""
    east_m, north_m = PLACES[at] if isinstance(at, str) else at
    name = at if isinstance(at, str) else "sign"
    all_tags = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in {"highway": kind, **tags}.items())
    return f'<node id="{name}" lat="{LAT + north_m / NORTH_M}" lon="{LON + east_m / EAST_M}">{all_tags}</node>'


def bound(node_with_sign, way="w sign J e", tags="", projection=""):
    """Of an extract with one sign, on a street through some nodes; another street crosses it at J."""
    nodes = "".join(
        f'<node id="{name}" lat="{LAT + y_m / NORTH_M}" lon="{LON + x_m / EAST_M}"/>'
        for name, (x_m, y_m) in PLACES.items()
        if f'id="{name}"' not in node_with_sign
    )
    streets = "".join(
        f"<way>{''.join(f'<nd ref={chr(34)}{node}{chr(34)}/>' for node in names.split())}{street_tags}</way>"
        for names, street_tags in ((way, tags or PRIMARY), ("s J n", PRIMARY))
    )
    extract = f"<osm>{nodes}{node_with_sign}{streets}</osm>"
    return signed_edges(extract.encode(), fromstring(net(projection) if projection else net()))


def stopped(*names):
    return frozenset(names), frozenset()


def test_a_sign_binds_the_traffic_towards_the_nearer_junction():
    assert bound(sign((-14.0, 0.0))) == stopped("from_w")
    assert bound(sign((14.0, 0.0)), "w J sign e") == stopped("from_e")
    assert bound(sign((-14.0, 0.0), "give_way")) == (frozenset(), frozenset({"from_w"}))


def test_a_sign_binds_the_end_of_its_edge():
    """Up to 60 m before the end, which lies 10 m before the middle of the crossing."""
    assert (bound(sign((-68.0, 0.0))), bound(sign((-72.0, 0.0)))) == (stopped("from_w"), stopped())
    assert bound(sign((-60.0, 13.0))) == stopped("from_w"), "14.6 m to the side"
    assert bound(sign((-60.0, 14.0))) == stopped()


@pytest.mark.parametrize(
    ("way", "direction", "edges"),
    [
        *[("w sign J e", "forward", ("from_w",)), ("e J sign w", "backward", ("from_w",))],
        *[("w sign J e", "backward", ()), ("w sign J e", "sideways", ("from_w",))],
    ],
)
def test_a_direction_is_that_of_the_way(way, direction, edges):
    """Away from the crossing the edge ends far away; up to 25 m behind it, a sign may be that of the edge before."""
    assert bound(sign((-16.0, 0.0), direction=direction), way) == stopped(*edges)
    behind = bound(sign((-14.0, 0.0), direction=direction), way)
    assert behind == (stopped(*edges) if edges else stopped("from_e"))


@pytest.mark.parametrize(
    ("oneway", "edges"),
    [("yes", ("from_w",)), ("true", ("from_w",)), ("1", ("from_w",)), ("-1", ()), ("no", ("from_w",))],
)
def test_nobody_stops_where_nobody_may_drive(oneway, edges):
    assert bound(sign((-14.0, 0.0)), tags=f'{PRIMARY}<tag k="oneway" v="{oneway}"/>') == stopped(*edges)


def test_at_the_junctions_own_node_it_binds_all_approaches():
    everybody = ("from_w", "from_e", "from_s", "from_n")
    assert bound(sign("J"), "w J e") == stopped(*everybody)
    assert bound(sign("J", stop="all"), "w J e") == stopped(*everybody)
    assert bound(sign("J", stop="minor"), "w J e") == stopped()
    assert bound(sign("J", "give_way"), "w J e") == stopped()
    one_way = PRIMARY + '<tag k="oneway" v="yes"/>'
    assert bound(sign("J"), "w J e", one_way) == stopped("from_w", "from_s", "from_n")


@pytest.mark.parametrize("tags", ['<tag k="highway" v="footway"/>', '<tag k="waterway" v="river"/>'])
def test_signs_on_what_is_no_road_bind_nobody(tags):
    assert bound(sign((-14.0, 0.0)), tags=tags) == stopped()
    assert bound(sign((-14.0, 0.0)), "w J e") == stopped(), "of no way at all"


def test_without_a_junction_ahead_a_sign_binds_nobody():
    assert bound(sign((-14.0, 0.0)), "w sign e") == stopped(), "the other street is another one"


def test_where_the_projection_is_not_known_nobody_is_bound():
    assert bound(sign((-14.0, 0.0)), projection="!") == stopped()


def test_a_roundabout_is_a_one_way_street():
    tags = PRIMARY + '<tag k="junction" v="roundabout"/>'
    assert bound(sign((14.0, 0.0)), "w J sign e", tags) == stopped()
    assert bound(sign((-14.0, 0.0)), tags=tags) == stopped("from_w")


def test_cars_drive_where_one_lane_allows_it():
    def edge(*lanes):
        return drives_on(fromstring(f"<edge>{''.join(f'<lane {lane}/>' for lane in lanes)}</edge>"))

    assert edge('allow="pedestrian"', 'disallow="tram"')
    assert not edge('allow="pedestrian"', 'allow="bicycle"')
    assert not edge()
