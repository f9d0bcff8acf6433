"""Signs, limits and one-way streets of OpenDRIVE and OpenStreetMap reach the compiled net; mirror images of maps."""

import math
import re

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring
from repository import REPOSITORY
from roads.test_net_parser import NET

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps.map_compiler import compile_map, mirrored_map
from siren_ros.simulation.roads.maps.map_formats import (
    drives_on,
    mirrored_net,
    mirrored_opendrive,
    opendrive_patches,
    signed_edges,
    with_stated_limits,
)
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import mirrored_network, right_hand_image

LANES = """<lane id="{0}_0" index="0" speed="13.89" width="6" type="sidewalk"/>
<lane id="{0}_1" index="1" disallow="all" speed="1.39" width="0.6" type="shoulder"/>
<lane id="{0}_2" index="2" disallow="all" speed="1.39" width="2.5" type="shoulder"/>
<lane id="{0}_3" index="3" speed="13.89" width="3.5" type="driving"/>
<lane id="{0}_4" index="4" disallow="all" speed="1.39" width="2.5" type="shoulder"/>"""


def net(junction_type="priority"):
    edges = "".join(
        f'<edge id="{name}" from="{start}" to="{end}" priority="1">{LANES.format(name)}</edge>'
        for name, start, end in [("1", "a", "9"), ("-2", "b", "9"), ("3", "9", "c")]
    )
    return (
        f'<net>{edges}<junction id="9" type="{junction_type}" x="0" y="0"/>'
        '<connection from="1" to="3" fromLane="3" toLane="3" dir="r"/>'
        '<connection from="-2" to="3" fromLane="3" toLane="3" dir="l"/>'
        '<connection from=":9_0" to="3" fromLane="0" toLane="3" dir="r"/></net>'
    ).encode()


def sign(kind, orientation, *, road="50", junction="9", s_m="1", length_m="20"):
    return (
        f'<road id="{road}" junction="{junction}" length="{length_m}"><link>'
        + (
            '<predecessor elementType="road" elementId="1"/><successor elementType="road" elementId="2"/>'
            if junction != "-1"
            else '<successor elementType="junction" elementId="9"/>'
        )
        + f'</link><signals><signal id="s{road}" type="{kind}" s="{s_m}" orientation="{orientation}"/></signals></road>'
    )


def patches(*roads, junction_type="priority"):
    return opendrive_patches(net(junction_type), f"<OpenDRIVE>{''.join(roads)}</OpenDRIVE>".encode(), "map.xodr")


def lane_patches(net_xml, *, for_people=False):
    edges = opendrive_patches(net_xml, b"<OpenDRIVE/>", "map.xodr", for_people=for_people)["--edge-files"]
    return {lane.get("index"): dict(lane.attrib) for lane in fromstring(edges).find("edge").iterfind("lane")}


def test_cycle_lanes_are_open_where_there_are_cyclists():
    cycled = net().replace(b'width="0.6" type="shoulder"', b'width="1.6" type="biking"')
    assert lane_patches(cycled)["1"] == {"index": "1", "disallow": "all"}
    assert lane_patches(cycled, for_people=True)["1"] == {"index": "1", "allow": "bicycle"}


@pytest.mark.parametrize(
    ("more", "added"),
    [
        ("", [("1", "3", "2", "2")]),
        ('<connection from="1" to="3" fromLane="2" toLane="2" dir="r"/>', []),
        ('<connection from="1" to="3" fromLane="2" toLane="1" dir="r"/>', [("1", "3", "2", "2")]),
        ('<connection from="-2" to="3" fromLane="2" toLane="2" dir="l"/>', [("1", "3", "2", "2")]),
    ],
    ids=["none", "the same", "to another lane", "from another road"],
)
def test_a_shoulder_movement_that_is_there_is_not_added_again(more, added):
    first = net().replace(b"</net>", more.encode() + b"</net>")
    document = fromstring(opendrive_patches(first, b"<OpenDRIVE/>", "map.xodr")["--connection-files"])
    assert [
        tuple(connection.get(key) for key in ("from", "to", "fromLane", "toLane")) for connection in document
    ] == added


@pytest.mark.parametrize(("letter", "count"), [("s", 1), ("r", 1), ("R", 1), ("l", 0), ("L", 0), ("t", 0)])
def test_the_shoulder_follows_straight_on_and_to_the_right(letter, count):
    first = net().replace(b'toLane="3" dir="r"/><conn', f'toLane="3" dir="{letter}"/><conn'.encode())
    assert len(fromstring(opendrive_patches(first, b"<OpenDRIVE/>", "map.xodr")["--connection-files"])) == count


@pytest.mark.parametrize(("index", "width", "open_to"), [(2, "1.8", "emergency"), (2, "1.79", None), (4, "2.5", None)])
def test_wide_shoulders_right_of_the_driving_lanes_are_open(index, width, open_to):
    text = net().decode().replace('index="2" disallow="all" speed="1.39" width="2.5"', f'index="2" width="{width}"')
    lanes = lane_patches(text.encode())
    assert lanes[str(index)].get("allow") == open_to
    assert (lanes[str(index)].get("disallow") == "all") is (open_to is None)


def test_a_shoulder_between_driving_lanes_is_open_to_nobody():
    more = '<lane id="1_5" index="5" speed="13.89" width="3.5" type="driving"/></edge>'
    lanes = lane_patches(net().decode().replace("</edge>", more, 1).encode())
    assert (lanes["2"].get("allow"), lanes["4"].get("disallow")) == ("emergency", "all")


def test_without_a_driving_lane_a_shoulder_is_open_to_nobody():
    lanes = lane_patches(net().decode().replace('type="driving"', 'type="biking"').encode())
    assert {lanes[index].get("disallow") for index in ("1", "2", "3", "4")} == {"all"}


@pytest.mark.parametrize(("s_m", "length_m", "binds"), [("12", "20", True), ("4", "20", False), ("5", "20", True)])
def test_a_sign_binds_the_junction_at_most_15_m_ahead(s_m, length_m, binds):
    documents = patches(sign("206", "+", road="1", junction="-1", s_m=s_m, length_m=length_m))
    assert len(fromstring(documents["--node-files"])) == int(binds)


@pytest.mark.parametrize(("s_m", "binds"), [("14", True), ("16", False)])
def test_a_sign_for_the_other_direction_is_measured_from_the_roads_start(s_m, binds):
    road = sign("206", "-", road="-2", junction="-1", s_m=s_m, length_m="100").replace('road id="-2"', 'road id="2"')
    road = road.replace("successor", "predecessor")
    assert len(fromstring(patches(road)["--node-files"])) == int(binds)


@pytest.mark.parametrize(
    ("roads", "kind", "minor"),
    [
        ([sign("206", "+")], "priority_stop", {"1"}),
        ([sign("206", "-")], "priority_stop", {"-2"}),
        ([sign("206", "+"), sign("206", "-", road="51")], "allway_stop", {"1", "-2"}),
        ([sign("206", "+", road="1", junction="-1", s_m="12")], "priority_stop", {"1"}),
        ([sign("205", "+")], None, {"1"}),
    ],
)
def test_signs_set_the_junctions_control(roads, kind, minor):
    result = patches(*roads)
    nodes = {node.get("id"): node.get("type") for node in fromstring(result["--node-files"])}
    assert nodes == ({} if kind is None else {"9": kind})
    lowered = {edge.get("id") for edge in fromstring(result["--edge-files"]) if edge.get("priority") == "0"}
    assert lowered == minor


def test_references_to_a_sign_count_like_the_sign():
    elsewhere = '<road id="70" junction="-1" length="9"><signals><signal id="x" type="206" s="1"/></signals></road>'
    reference = (
        sign("206", "-").replace("<signal id", "<signalReference id").replace('"s50"', '"x"').replace('type="206" ', "")
    )
    nodes = fromstring(patches(elsewhere, reference)["--node-files"])
    assert [node.get("type") for node in nodes] == ["priority_stop"]


@pytest.mark.parametrize(
    "road",
    [
        sign("274", "+"),
        sign("206", "+", junction="8"),
        sign("206", "+", road="1", junction="-1", s_m="1", length_m="100"),
        sign("206", "-", road="1", junction="-1"),
    ],
    ids=["another sign", "another junction", "far from the junction", "nothing ahead"],
)
def test_other_signs_change_nothing(road):
    result = patches(road)
    assert len(fromstring(result["--node-files"])) == 0
    assert all(edge.get("priority") is None for edge in fromstring(result["--edge-files"]))


def test_damaged_opendrive_is_refused():
    with pytest.raises(MapError, match="well-formed"):
        opendrive_patches(net(), b"<OpenDRIVE>", "map.xodr")


NET_WITH_LIMITS = b"""<net>
  <edge id="-1"><lane id="-1_0" allow="pedestrian" speed="1.39"/><lane id="-1_1" speed="13.89"/></edge>
  <edge id="2.15"><lane id="2.15_0" speed="13.89"/></edge>
  <edge id="3"><lane id="3_0" speed="8.00"/></edge>
  <edge id=":J_0" function="internal"><lane id=":J_0_0" speed="13.89"/></edge>
  <edge id=":J_1" function="internal"><lane id=":J_1_0" speed="13.89"/></edge>
  <edge id=":J_2" function="internal"><lane id=":J_2_0" speed="6.50"/></edge>
  <connection from="-1" to="2.15" fromLane="1" toLane="0" via=":J_0_0"/>
  <connection from=":J_0" to="2.15" fromLane="0" toLane="0" via=":J_1_0"/>
  <connection from=":J_1" to="2.15" fromLane="0" toLane="0"/>
  <connection from="-1" to="3" fromLane="1" toLane="0" via=":J_2_0"/>
</net>"""


def speeds(*types):
    roads = "".join(f'<road id="{number}" length="100">{text}</road>' for number, text in enumerate(types, start=1))
    net = fromstring(with_stated_limits(NET_WITH_LIMITS, f"<OpenDRIVE>{roads}</OpenDRIVE>".encode()))
    return {lane.attrib["id"]: float(lane.attrib["speed"]) for lane in net.iter("lane")}


def kind(limit, unit="", from_m=0.0):
    stated = f' unit="{unit}"' if unit else ""
    return f'<type s="{from_m}" type="town"><speed max="{limit}"{stated}/></type>'


def test_roads_get_the_limit_of_their_type_and_paths_the_lower_one():
    limits = speeds(kind("65", "mph"), kind("72", "km/h"), kind("72", "km/h"))
    assert limits == {
        "-1_0": 1.39, "-1_1": 29.06, "2.15_0": 20.0, "3_0": 8.0, ":J_0_0": 20.0, ":J_1_0": 20.0, ":J_2_0": 6.5,
    }  # fmt: skip


@pytest.mark.parametrize("limit", [kind("no limit"), kind("undefined"), kind("30", "furlongs"), '<type s="0"/>', ""])
def test_without_a_number_netconverts_limit_stays(limit):
    assert speeds(limit)["-1_1"] == 13.89


def test_of_several_types_the_longest_counts():
    assert speeds(kind("10") + kind("20", from_m=30.0) + kind("5", from_m=90.0))["-1_1"] == 20.0


SIGNS = REPOSITORY / "test" / "maps" / "signs.osm"


def compiled(tmp_path, text):
    file = tmp_path / "map.osm"
    file.write_text(text, encoding="utf-8")
    net_of_streets = compile_map(file, tmp_path / "cache").read_bytes()
    return net_of_streets, parse_road_network(net_of_streets)


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


def net_of_streets(projection=f"+proj=tmerc +lat_0={LAT} +lon_0={LON}", more=""):
    edges = "".join(
        f'<edge id="{name}"><lane id="{name}_0" shape="{_text(start)} {_text(end)}"/></edge>'
        for name, (start, end) in ROADS.items()
    )
    place = f"{OFFSET_M[0]},{OFFSET_M[1]}"
    return f'<net><location netOffset="{place}" projParameter="{projection}"/>{edges}{more}</net>'


def _text(place):
    return f"{place[0] + OFFSET_M[0]},{place[1] + OFFSET_M[1]}"


def sign_node(at, kind="stop", **tags):
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
    return signed_edges(extract.encode(), fromstring(net_of_streets(projection) if projection else net_of_streets()))


def stopped(*names):
    return frozenset(names), frozenset()


def test_a_sign_binds_the_traffic_towards_the_nearer_junction():
    assert bound(sign_node((-14.0, 0.0))) == stopped("from_w")
    assert bound(sign_node((14.0, 0.0)), "w J sign e") == stopped("from_e")
    assert bound(sign_node((-14.0, 0.0), "give_way")) == (frozenset(), frozenset({"from_w"}))


def test_a_sign_binds_the_end_of_its_edge():
    """Up to 60 m before the end, which lies 10 m before the middle of the crossing."""
    assert (bound(sign_node((-68.0, 0.0))), bound(sign_node((-72.0, 0.0)))) == (stopped("from_w"), stopped())
    assert bound(sign_node((-60.0, 13.0))) == stopped("from_w"), "14.6 m to the side"
    assert bound(sign_node((-60.0, 14.0))) == stopped()


@pytest.mark.parametrize(
    ("way", "direction", "edges"),
    [
        *[("w sign J e", "forward", ("from_w",)), ("e J sign w", "backward", ("from_w",))],
        *[("w sign J e", "backward", ()), ("w sign J e", "sideways", ("from_w",))],
    ],
)
def test_a_direction_is_that_of_the_way(way, direction, edges):
    """Away from the crossing the edge ends far away; up to 25 m behind it, a sign may be that of the edge before."""
    assert bound(sign_node((-16.0, 0.0), direction=direction), way) == stopped(*edges)
    behind = bound(sign_node((-14.0, 0.0), direction=direction), way)
    assert behind == (stopped(*edges) if edges else stopped("from_e"))


def test_a_sign_for_both_directions_binds_both():
    """Its traffic away from the crossing is bound where the sign stands close behind the end of its way."""
    assert bound(sign_node((-14.0, 0.0), direction="both")) == stopped("from_w", "from_e")
    assert bound(sign_node((-14.0, 0.0), "give_way", direction="both")) == (
        frozenset(),
        frozenset({"from_w", "from_e"}),
    )
    one_way = f'{PRIMARY}<tag k="oneway" v="yes"/>'
    assert bound(sign_node((-14.0, 0.0), direction="both"), tags=one_way) == stopped("from_w")


@pytest.mark.parametrize(
    ("tag", "east", "west"),
    [
        *[(f'oneway" v="{value}', ("from_w",), ()) for value in ("yes", "true", "1")],
        *[('oneway" v="-1', (), ("from_e",)), ('oneway" v="no', ("from_w",), ("from_e",))],
        ('junction" v="roundabout', ("from_w",), ()),
    ],
)
def test_nobody_stops_where_nobody_may_drive(tag, east, west):
    """A roundabout is a one-way street."""
    tags = f'{PRIMARY}<tag k="{tag}"/>'
    assert bound(sign_node((-14.0, 0.0)), tags=tags) == stopped(*east)
    assert bound(sign_node((14.0, 0.0)), "w J sign e", tags) == stopped(*west)


def test_at_the_junctions_own_node_it_binds_all_approaches():
    everybody = ("from_w", "from_e", "from_s", "from_n")
    assert bound(sign_node("J"), "w J e") == stopped(*everybody)
    assert bound(sign_node("J", stop="all"), "w J e") == stopped(*everybody)
    assert bound(sign_node("J", stop="minor"), "w J e") == stopped()
    assert bound(sign_node("J", "give_way"), "w J e") == stopped()
    one_way = PRIMARY + '<tag k="oneway" v="yes"/>'
    assert bound(sign_node("J"), "w J e", one_way) == stopped("from_w", "from_s", "from_n")


@pytest.mark.parametrize("tags", ['<tag k="highway" v="footway"/>', '<tag k="waterway" v="river"/>'])
def test_signs_on_what_is_no_road_bind_nobody(tags):
    assert bound(sign_node((-14.0, 0.0)), tags=tags) == stopped()
    assert bound(sign_node((-14.0, 0.0)), "w J e") == stopped(), "of no way at all"
    assert bound(sign_node((-14.0, 0.0)), "w sign e") == stopped(), "without a junction ahead"
    assert bound(sign_node((-14.0, 0.0)), projection="!") == stopped(), "where the projection is not known"


def test_cars_drive_where_one_lane_allows_it():
    def edge(*lanes):
        return drives_on(fromstring(f"<edge>{''.join(f'<lane {lane}/>' for lane in lanes)}</edge>"))

    assert edge('allow="pedestrian"', 'disallow="tram"')
    assert not edge('allow="pedestrian"', 'allow="bicycle"')
    assert not edge()


@pytest.mark.parametrize("name", ["made", "town"])
def test_it_is_the_net_of_the_mirrored_network(name):
    net = NET.encode() if name == "made" else compile_map(None).read_bytes()
    read, expected = parse_road_network(mirrored_net(net)), mirrored_network(parse_road_network(net))
    assert read.left_hand
    assert read.sumo_offset_m == expected.sumo_offset_m
    assert read.connections == expected.connections
    assert read.edges == expected.edges
    assert len(read.crossings) == len(expected.crossings)
    for lane, other in zip(read.lanes, expected.lanes, strict=True):
        assert np.array_equal(lane.centre.points, other.centre.points)
    for junction, other in zip(read.junctions.values(), expected.junctions.values(), strict=True):
        assert (junction.x_m, junction.y_m) == (other.x_m, other.y_m)
        assert np.array_equal(junction.outline, other.outline)


def test_the_image_of_the_image_has_the_bytes_of_the_net_and_is_kept_in_the_cache():
    town = compile_map(None)
    image = mirrored_map(town)
    assert image.net_path.parent == town.net_path.parent
    assert image.read_bytes() == mirrored_net(town.read_bytes()) != town.read_bytes()
    assert image.sha256 != town.sha256
    assert mirrored_net(image.read_bytes()) == town.read_bytes()
    assert b'netOffset="100.00,-50.00" convBoundary="0,-100,300,0"' in mirrored_net(NET.encode()), "all digits"


def lane(number, kind="driving"):
    width = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'
    return f'<lane id="{number}" type="{kind}" level="false">{width}</lane>'


DRIVE = f"""<?xml version="1.0"?>
<OpenDRIVE><header revMajor="1" revMinor="4"/>
<road name="" length="150" id="1" junction="-1">
<planView>
<geometry s="0" x="10" y="20" hdg="0.3" length="100"><line/></geometry>
<geometry s="100" x="105.5337" y="49.5520" hdg="0.3" length="50"><arc curvature="0.01"/></geometry>
</planView>
<lanes><laneOffset s="0" a="0.5" b="0" c="0" d="0"/><laneSection s="0">
<left>{lane(2)}{lane(1)}</left>
<center><lane id="0" type="none" level="false"/></center>
<right>{lane(-1)}{lane(-2)}{lane(-3, "shoulder")}</right>
</laneSection></lanes>
<signals><signal id="7" type="205" dynamic="no" s="10" t="-6" orientation="+">
<validity fromLane="-2" toLane="-1"/></signal></signals>
</road>
</OpenDRIVE>"""


def network_of(folder, xodr):
    file = folder / "map.xodr"
    file.write_bytes(xodr)
    return parse_road_network(compile_map(file, folder / "cache").read_bytes())


def test_its_network_is_the_mirror_image(tmp_path):
    drive = DRIVE.encode()
    right, left = network_of(tmp_path, drive), network_of(tmp_path, mirrored_opendrive(drive))
    assert (left.left_hand, right.left_hand) == (True, False)
    image = right_hand_image(left)
    assert image.connections == right.connections
    shown = [[(lane.lane_id, lane.kind, lane.width_m) for lane in network.lanes] for network in (image, right)]
    assert shown[0] == shown[1]
    for lane_of_image, own in zip(image.lanes, right.lanes, strict=True):
        np.testing.assert_allclose(lane_of_image.centre.points, own.centre.points, atol=0.011)


def test_the_image_of_the_image_is_the_map():
    once = mirrored_opendrive(DRIVE.encode())
    assert mirrored_opendrive(mirrored_opendrive(once)) == once
