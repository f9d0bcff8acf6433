"""Paths across junctions leave and enter lanes without a corner."""

from dataclasses import replace

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring
from made_streets import A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, C_LEFT, C_RIGHT, streets

from siren_ros.simulation.roads.maps.lane_shapes import (
    mend_junction_paths,
    mended_lanes,
    points_of,
    rounded,
    text_of,
    without_steps_back,
)
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.openstreetmap import only_joins, taper_patches
from siren_ros.simulation.roads.movements import movement_turn_rad
from siren_ros.simulation.roads.net_parser import parse_road_network

NET = """<net>
  <edge id=":J_0" function="internal"><lane id=":J_0_0" shape="{path}"/></edge>
  <edge id=":J_1" function="internal"><lane id=":J_1_0" shape="{rest}"/></edge>
  <edge id="a"><lane id="a_0" shape="-50,0,1 0,0,1"/></edge>
  <edge id="b"><lane id="b_0" shape="10,10 10,60"/></edge>
  <connection from="a" to="b" fromLane="0" toLane="0" via=":J_0_0"/>
  <connection from=":J_0" to="b" fromLane="0" toLane="0" {via}/>
  <connection from=":J_1" to="b" fromLane="0" toLane="0"/>
</net>"""


def shapes_of(path, rest=""):
    net = fromstring(NET.format(path=path, rest=rest or "0,0 1,1", via='via=":J_1_0"' if rest else ""))
    mend_junction_paths(net)
    return {lane.attrib["id"]: points_of(lane.attrib["shape"]) for lane in net.iter("lane")}


@pytest.mark.parametrize("rest", ["", "4,4,2 10,10,3"])
def test_a_turn_drawn_as_a_straight_line_becomes_nearly_a_circle(rest):
    shapes = shapes_of("0,0,1 4,4,2" if rest else "0,0,1 10,10,3", rest)
    curve = shapes[":J_0_0"]
    if rest:
        assert shapes[":J_1_0"][0] == pytest.approx(curve[-1])
        assert len(curve) < len(shapes[":J_1_0"]) + 1, "the parts keep their shares"
        curve = np.concatenate((curve, shapes[":J_1_0"][1:]))
    assert (curve[0], curve[-1]) == (pytest.approx([0.0, 0.0, 1.0]), pytest.approx([10.0, 10.0, 3.0]))
    assert np.hypot(curve[:, 0], curve[:, 1] - 10.0) == pytest.approx(10.0, abs=0.1)
    heading = np.arctan2(*np.diff(curve[:, :2], axis=0).T[::-1])
    assert np.abs(heading[[0, -1]] - [0.0, np.pi / 2.0]).max() < 0.06
    assert np.diff(curve[:, 2]) == pytest.approx(2.0 / 16.0), "heights stay linear"


@pytest.mark.parametrize("path", ["0,0 5,0 9,1 10,5 10,10", "0,0 1,1.2"])
def test_paths_without_corners_and_short_ones_stay(path):
    assert shapes_of(path)[":J_0_0"] == pytest.approx(points_of(path))


@pytest.mark.parametrize(("begins_m", "path"), [(-0.09, "-0.19,0,4 -0.09,0,4"), (0.09, "0,0,1 0.09,0,4")])
def test_a_joint_leads_ahead_where_its_roads_overlap(begins_m, path):
    """A short way back would turn SUMO's vehicles round, and put who drives on the right there on the left."""
    net = fromstring(
        f"""<net><edge id=":J_0" function="internal"><lane id=":J_0_0" shape="0,0,1 {begins_m},0,4"/></edge>
        <edge id="a"><lane id="a_0" shape="-50,0,1 0,0,1"/></edge>
        <edge id="b"><lane id="b_0" shape="{begins_m},0,4 50,0,4"/></edge>
        <connection from="a" to="b" fromLane="0" toLane="0" via=":J_0_0"/></net>"""
    )
    mend_junction_paths(net)
    shape = points_of(net.find(".//lane").attrib["shape"])
    assert shape == pytest.approx(points_of(path))


@pytest.mark.parametrize(
    ("path", "rest", "mended"),
    [
        ("0,0 4,0 5,1 5,5", "5,5 10,10", True),
        ("0,0 4,0 6,2", "6,2 10,6 10,10", False),
        ("0,0 6,6", "6,6 10,7 10,10", True),
    ],
)
def test_a_corner_at_either_end_of_a_path_in_two_parts_counts(path, rest, mended):
    """The end is that of the last part; a corner where the parts meet is none."""
    shapes = shapes_of(path, rest)
    curve = np.concatenate((shapes[":J_0_0"], shapes[":J_1_0"][1:]))
    assert (len(curve) == 17) == mended
    if mended:
        assert np.hypot(curve[:, 0], curve[:, 1] - 10.0) == pytest.approx(10.0, abs=0.1)
    else:
        assert shapes[":J_1_0"] == pytest.approx(points_of(rest))


def test_a_curve_is_a_beziers_with_handles_along_the_lanes():
    """From the east-going lane at the origin onto one that goes north from (10, 10) moved to (24, 10)."""
    net = fromstring(NET.format(path="0,0,1 24,10,3", rest="0,0 1,1", via="").replace("10,10 10,60", "24,10 24,60"))
    mend_junction_paths(net)
    curve = points_of(next(lane.attrib["shape"] for lane in net.iter("lane") if lane.attrib["id"] == ":J_0_0"))
    share = np.linspace(0.0, 1.0, 17)[:, None]
    handle_m = 0.39 * np.hypot(24.0, 10.0)
    start, end = np.zeros(2), np.array([24.0, 10.0])
    one, other = np.array([handle_m, 0.0]), end - np.array([0.0, handle_m])
    bezier = (1 - share) ** 3 * start + 3 * share * (1 - share) ** 2 * one + 3 * share**2 * (1 - share) * other
    assert curve[:, :2] == pytest.approx(bezier + share**3 * end, abs=1e-4)
    assert curve[:, 2] == pytest.approx(1.0 + 2.0 * share[:, 0])


@pytest.mark.parametrize(
    ("path", "mended"),
    [
        *[("0,0 5,0.8 9,4 10,10", False), ("0,0 5,1.1 9,4 10,10", True)],
        *[("0,0 5,0 9,4 9.5,7.5 10,10", True), ("0,0 5,0 9,4 9.6,7.5 10,10", False)],
    ],
)
def test_ten_degrees_at_either_end_are_a_corner(path, mended):
    assert (len(shapes_of(path)[":J_0_0"]) == 17) is mended


def test_where_a_lane_is_missing_nothing_changes():
    text = NET.format(path="0,0 10,10", rest="0,0 1,1", via="").replace('<lane id="b_0" shape="10,10 10,60"/>', "")
    net = fromstring(text)
    mend_junction_paths(net)
    assert next(net.iter("lane")).attrib["shape"] == "0,0 10,10"


def test_numbers_are_written_to_a_tenth_of_a_millimetre():
    assert text_of(np.array([[1.0, -2.5, 0.12344], [10.0, 0.0, 100.0]])) == "1,-2.5,0.1234 10,0,100"
    assert points_of("1,2,3 4,5").tolist() == [[1.0, 2.0], [4.0, 5.0]]


NET_LANE_SHAPES = b"""<?xml version="1.0" encoding="UTF-8"?>
<net version="1.20" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="net.xsd">
  <location netOffset="0,0" convBoundary="0,0,100,100" origBoundary="0,0,1,1" projParameter="!"/>
  <edge id="alike" from="a" to="b"><lane id="alike_0" index="0" speed="9" length="77" shape="0,0 100,0"/>
    <lane id="alike_1" index="1" speed="9" length="77" shape="0,3 102,3"/></edge>
  <edge id="unlike" from="a" to="b"><lane id="unlike_0" index="0" speed="9" length="60" shape="0,0 40,0"/>
    <lane id="unlike_1" index="1" speed="9" length="60" shape="0,3 86,3"/></edge>
  <edge id="bend" from="a" to="b"><lane id="bend_0" index="0" speed="9" length="60" shape="0,0 92,0"/>
    <lane id="bend_1" index="1" speed="9" length="60" shape="0,3 100,3"/>
    <lane id="bend_2" index="2" speed="9" length="60" shape="0,6 108,6"/></edge>
  <edge id="walked" from="a" to="b">
    <lane id="walked_0" index="0" allow="pedestrian" speed="1" length="60" shape="0,0 80,0"/>
    <lane id="walked_1" index="1" speed="9" length="60" shape="0,3 100,3"/></edge>
  <edge id=":b_w0" function="walkingarea">
    <lane id=":b_w0_0" index="0" allow="pedestrian" speed="1" length="5" shape="0,0 3,0 3,3"/></edge>
</net>"""


def lengths_of(net):
    return {lane.attrib["id"]: float(lane.attrib["length"]) for lane in fromstring(net).iter("lane")}


def test_lengths_are_those_of_the_shapes():
    """But for the lanes of one edge that are nearly as long: places side by side on them are so for SUMO, too."""
    assert lengths_of(mended_lanes(NET_LANE_SHAPES)) == {
        "alike_0": 101.0, "alike_1": 101.0, "unlike_0": 40.0, "unlike_1": 86.0,
        "bend_0": 100.0, "bend_1": 100.0, "bend_2": 100.0, "walked_0": 100.0, "walked_1": 100.0, ":b_w0_0": 5.0,
    }  # fmt: skip


def test_nothing_else_of_a_net_changes():
    before, after = fromstring(NET_LANE_SHAPES), fromstring(mended_lanes(NET_LANE_SHAPES))
    for one, other in zip(before.iter(), after.iter(), strict=True):
        assert one.tag == other.tag
        kept = [{key: value for key, value in item.attrib.items() if key != "length"} for item in (one, other)]
        assert kept[0] == kept[1]


def test_mending_twice_changes_no_length_that_fits():
    once = mended_lanes(NET_LANE_SHAPES)
    assert lengths_of(mended_lanes(once)) == lengths_of(once)


@pytest.mark.parametrize("sides", [8, 24])
def test_a_polygon_becomes_nearly_a_circle(sides):
    angle = np.linspace(0.0, np.pi, sides)
    points = rounded(20.0 * np.stack((np.cos(angle), np.sin(angle)), axis=-1))
    radius = np.hypot(points[:, 0], points[:, 1])
    assert 20.0 * np.cos(np.pi / (sides - 1) / 2.0) - 0.01 < radius.min() <= radius.max() <= 20.0 + 1e-9
    heading = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
    assert np.abs(np.diff(heading)).max() < 0.08


def test_a_corner_is_passed_closely_and_the_ends_stay():
    corner = np.array([[0.0, 0.0, 1.0], [30.0, 0.0, 2.0], [30.0, 30.0, 3.0]])
    points = rounded(corner)
    assert np.array_equal(points[[0, -1]], corner[[0, -1]])
    assert np.linalg.norm(points[:, :2] - corner[1, :2], axis=1).min() == pytest.approx(0.3, abs=0.02)
    assert np.all(np.diff(points[:, 2]) > 0.0)


@pytest.mark.parametrize(
    ("before_m", "after_m", "turn_rad", "cut_m"),
    [
        *[(1.0, 30.0, np.pi / 2.0, 0.5), (30.0, 0.8, np.pi / 2.0, 0.4)],
        *[(30.0, 30.0, np.pi / 2.0, 0.6 / np.sin(np.pi / 4.0)), (30.0, 30.0, -1.0, 0.6 / np.sin(0.5))],
        (30.0, 30.0, 0.1, 6.0),
    ],
)
def test_a_corner_becomes_a_parabola_between_its_sides(before_m, after_m, turn_rad, cut_m):
    """It begins half a side, 6 m, or what keeps it 0.3 m from the corner before it; a point every 0.05 rad or less."""
    ahead = np.array([np.cos(turn_rad), np.sin(turn_rad)])
    points = rounded(np.array([(-before_m, 0.0), (0.0, 0.0), after_m * ahead]))
    assert (points[0].tolist(), points[-1]) == ([-before_m, 0.0], pytest.approx(after_m * ahead))
    bend = points[1:-1]
    assert (bend[0], bend[-1]) == (pytest.approx([-cut_m, 0.0]), pytest.approx(cut_m * ahead))
    count = int(np.ceil(abs(turn_rad) / 0.05)) + 2
    share = np.linspace(0.0, 1.0, count)[:, None]
    parabola = (1.0 - share) ** 2 * [-cut_m, 0.0] + share**2 * (cut_m * ahead)
    near = np.min(np.hypot(*(parabola[:, None] - bend[None]).transpose(2, 0, 1)), axis=1)
    assert near.max() < 0.05 if len(bend) < count else near.max() < 1e-9


@pytest.mark.parametrize(("turn_rad", "count"), [(0.019, 3), (0.021, 5)])
def test_corners_of_about_a_degree_stay(turn_rad, count):
    ahead = np.array([np.cos(turn_rad), np.sin(turn_rad)])
    assert len(rounded(np.array([(-30.0, 0.0), (0.0, 0.0), 30.0 * ahead]))) == count


def test_straight_lines_and_repeated_points_stay():
    line = np.array([[0.0, 0.0], [10.0, 0.05], [20.0, 0.0]])
    assert np.array_equal(rounded(line), line)
    doubled = np.array([[0.0, 0.0], [0.0, 0.0], [5.0, 0.0]])
    assert np.array_equal(rounded(doubled), doubled)


@pytest.mark.parametrize(
    ("line", "kept"),
    [
        ([(0, 0), (5, 0), (4.9, 0.05), (10, 0)], [(0, 0), (4.9, 0.05), (10, 0)]),
        ([(0, 0), (0, 5), (0.02, 4.9), (0, 5.1), (0, 4.8), (0, 9)], [(0, 0), (0, 4.8), (0, 9)]),
        ([(0, 0), (5, 0), (3, 0.1), (10, 0)], None),
        ([(0, 0), (5, 0), (5, 0.5), (10, 0.5)], None),
    ],
    ids=["a short step back", "two of them along y", "a long way back leads somewhere", "a right angle"],
)
def test_short_steps_back_are_left_out(line, kept):
    assert without_steps_back(np.array(line, float)).tolist() == np.array(kept or line, float).tolist()


@pytest.mark.parametrize(("permission", "points"), [('allow="pedestrian"', 3), ('disallow="pedestrian"', 4)])
def test_sidewalks_alone_lose_their_steps_back(permission, points):
    net = f'<net><edge id="a"><lane id="a_0" {permission} shape="0,0 5,0 4.4,0 10,0"/></edge></net>'
    shape = points_of(fromstring(mended_lanes(net.encode())).find(".//lane").attrib["shape"])
    goes_back = bool((np.diff(shape[:, 0]) < 0.0).any())
    assert goes_back == (points == 4)


def test_what_is_no_net_is_given_back():
    assert mended_lanes(b"<osm/>") == b"<osm/>"


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
def net(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    source = folder / "wider.osm"
    source.write_text(OSM)
    return compile_map(source, folder / "cache").read_bytes()


@pytest.fixture(scope="module")
def network(net):
    return parse_road_network(net)


def test_a_lane_fans_out_into_three_over_a_long_way(network):
    fan = [connection for _, connection in network.connections_at["2"]]
    assert len(fan) == 3
    for connection in fan:
        assert sum(network.lanes[lane].length_m for lane in connection.via) > 20.0, "one lane aside, 30 km/h, 3 m/s²"
        assert movement_turn_rad(network, connection) < 0.8


def test_only_sharp_joints_are_lengthened(network):
    assert taper_patches(network) == []
    turns = [movement_turn_rad(network, connection) for _, connection in network.connections_at["3"]]
    assert max(turns) > 1.0, "turns at the junction are sharp and stay so"


def test_yellow_is_as_long_as_in_towns_whatever_the_limit(net):
    phases = list(fromstring(net).iter("phase"))
    assert {float(phase.attrib["duration"]) for phase in phases if "y" in phase.attrib["state"]} == {3.0}


@pytest.mark.parametrize(
    ("joined", "is_joint"),
    [
        *[(((A_RIGHT, B_RIGHT), (A_LEFT, B_LEFT)), True), (((A_RIGHT, B_RIGHT), (B_LEFT, A_LEFT)), True)],
        *[(((A_RIGHT, B_RIGHT), (A_LEFT, C_LEFT)), False), (((A_RIGHT, C_RIGHT), (B_LEFT, C_LEFT)), False)],
    ],
    ids=["one road", "both directions", "a fork", "a merge"],
)
def test_a_joint_neither_forks_nor_merges_nor_nor_is_controlled(joined, is_joint):
    roads = streets()
    plain = replace(roads.connections[0], direction="s", signal_id=None, must_stop=False)
    movements = [replace(plain, from_lane=source, to_lane=target) for source, target in joined]
    assert only_joins(roads, movements) is is_joint
    for change in ({"direction": "r"}, {"signal_id": "J"}, {"must_stop": True}):
        assert not only_joins(roads, [movements[0], replace(movements[1], **change)])
