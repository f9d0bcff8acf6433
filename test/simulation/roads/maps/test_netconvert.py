"""Calls of netconvert, shapes of lanes, and ways for people on compiled maps."""

import subprocess
import sys
import time
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring
from made_streets import A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, C_LEFT, C_RIGHT, streets

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps import netconvert
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.map_formats import crowded_joints, only_joins, taper_patches
from siren_ros.simulation.roads.maps.map_source import MapSource, SourceKind
from siren_ros.simulation.roads.maps.netconvert import (
    control_patches,
    crossing_places,
    crosswalk_junctions,
    has_corners,
    mend_junction_paths,
    mended_lanes,
    points_of,
    rounded,
    run_netconvert,
    text_of,
    with_cycle_lanes,
    with_sidewalks_on_streets,
    without_header,
    without_outlines,
    without_steps_back,
)
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.roads.routing import movement_turn_rad


def test_the_dated_header_goes_and_the_net_stays():
    declaration, header = b'<?xml version="1.0"?>\n', b"\n<!-- on 2026-01-02\n<netconvert/> --><!-- -->\n"
    net = b'<net version="1">\n<!-- kept --></net>\n'
    assert without_header(declaration + header + net) == declaration + net
    assert without_header(net) == net


NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/></nodes>'


def test_a_net_comes_back_without_its_dated_header(tmp_path):
    (tmp_path / "nodes.xml").write_text(NODES)
    (tmp_path / "edges.xml").write_text('<edges><edge id="e" from="a" to="b" numLanes="2"/></edges>')
    options = ["--node-files", str(tmp_path / "nodes.xml"), "--edge-files", str(tmp_path / "edges.xml")]
    net = run_netconvert(options, tmp_path / "out.net.xml", "mymap")
    assert net == without_header((tmp_path / "out.net.xml").read_bytes())
    assert net.startswith(b'<?xml version="1.0" encoding="UTF-8"?>\n<net ')
    assert net.count(b'<lane id="e_') == 2


def test_a_refusal_carries_netconverts_first_error_line(tmp_path):
    with pytest.raises(MapError, match=r"'mymap'.*it said: .*absent\.xodr"):
        run_netconvert(["--opendrive-files", str(tmp_path / "absent.xodr")], tmp_path / "out.net.xml", "mymap")


def in_place_of_netconvert(path, lines):
    """A shell script that runs as netconvert would."""
    path.write_text(f"#!/bin/sh\n{lines}\n")
    path.chmod(0o755)
    return path


TELLS_LIMITS = 'echo "Error: $(ulimit -v) $(ulimit -t) $(ulimit -f)"; exit 1'


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("exit 3", r"exit code 3\)"),
        (TELLS_LIMITS, f"{8 * 2**20} 900 {400_000_000 // 512}"),
        ("printf 'Error: \\033[2J'; head -c 100000 /dev/zero | tr '\\0' x; exit 1", r"\?\[2Jxxx"),
    ],
    ids=["no words", "its limits", "much"],
)
def test_what_netconvert_says_is_one_short_line_of_plain_characters(tmp_path, monkeypatch, lines, said):
    says = in_place_of_netconvert(tmp_path / "says", lines)
    monkeypatch.setattr(netconvert, "netconvert_path", lambda: says)
    with pytest.raises(MapError, match=f"it said: {said}") as caught:
        run_netconvert([], tmp_path / "out.net.xml", "mymap")
    assert len(str(caught.value)) < 500


def test_the_version_is_that_of_the_package_or_the_programs_first_line(tmp_path, monkeypatch):
    tells = in_place_of_netconvert(tmp_path / "tells", "echo warning >&2; echo netconvert 1.28; echo more")
    monkeypatch.setattr(netconvert, "netconvert_path", lambda: tells)
    uncached = netconvert.netconvert_version.__wrapped__
    assert uncached() == version("eclipse-sumo")
    monkeypatch.setattr(netconvert, "version", lambda name: version(f"no-{name}"))
    assert uncached() == "netconvert 1.28"


def test_lower_limits_of_the_user_hold(tmp_path):
    tells = in_place_of_netconvert(tmp_path / "tells", TELLS_LIMITS)
    program = f"""
import resource
from pathlib import Path
from siren_ros.simulation.roads.maps import netconvert
netconvert.netconvert_path = lambda: Path({str(tells)!r})
resource.setrlimit(resource.RLIMIT_AS, (5 * 2**30, 5 * 2**30))
resource.setrlimit(resource.RLIMIT_CPU, (300, 300))
resource.setrlimit(resource.RLIMIT_FSIZE, (100 * 512, 100 * 512))
try:
    netconvert.run_netconvert([], Path({str(tmp_path)!r}) / "out", "mymap")
except netconvert.MapError as error:
    print(error)
"""
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert f"it said: {5 * 2**20} 300 100)" in answer.stdout


def test_a_map_that_takes_too_much_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(netconvert, "MOST_MEMORY_BYTES", 2**30)
    geometry = '<geometry s="0" x="0" y="0" hdg="0" length="1e9"><arc curvature="0.01"/></geometry>'
    road = f'<road id="1" length="1e9" junction="-1"><planView>{geometry}</planView></road>'
    (tmp_path / "long.xodr").write_text(f'<OpenDRIVE><header revMajor="1" revMinor="4"/>{road}</OpenDRIVE>')
    with pytest.raises(MapError, match="it said: more than 1 GB of memory are needed"):
        run_netconvert(["--opendrive-files", str(tmp_path / "long.xodr")], tmp_path / "out.net.xml", "mymap")


def test_a_net_that_is_larger_than_what_is_read_is_refused(tmp_path, monkeypatch):
    writes = in_place_of_netconvert(tmp_path / "writes", f"head -c 1000001 /dev/zero > {tmp_path}/out.net.xml")
    monkeypatch.setattr(netconvert, "netconvert_path", lambda: writes)
    monkeypatch.setattr(netconvert, "MAX_MAP_BYTES", 1_000_000)
    with pytest.raises(MapError, match="a map whose net has at most 1 MB"):
        run_netconvert([], tmp_path / "out.net.xml", "mymap")


def test_netconvert_does_not_outlive_who_waits_for_it(tmp_path):
    note = tmp_path / "number"
    lines = f"echo $$ > {note}.new; mv {note}.new {note}; exec sleep 300"
    hangs = in_place_of_netconvert(tmp_path / "hangs", lines)
    program = f"""
from pathlib import Path
from siren_ros.simulation.roads.maps import netconvert
netconvert.netconvert_path = lambda: Path({str(hangs)!r})
netconvert.run_netconvert([], Path({str(tmp_path)!r}) / "out", "mymap")
"""
    with subprocess.Popen([sys.executable, "-c", program]) as waits:
        while not note.exists():
            assert waits.poll() is None
            time.sleep(0.01)
        waits.kill()
    child = int(note.read_text())
    while is_running(child):
        time.sleep(0.01)


def is_running(process):
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


JUNCTION_NET = """<net>
<edge id=":J_0" function="internal"/><edge id=":J_w" function="walkingarea"/>
<edge id="n" to="J" priority="5"/><edge id="e" to="J" priority="3"/><edge id="s" to="J"/>
<edge id="w" to="J" priority="4"/>
<edge id="path" to="J" priority="-7"/><edge id="away" to="K" priority="9"/>
<junction id="J" type="{kind}"/><junction id="K" type="priority"/></net>"""


def patched(stopping, yielding="", kind="priority"):
    """Types of nodes and priorities of edges; nobody drives on the path."""
    net = fromstring(JUNCTION_NET.format(kind=kind))
    signs = stopping.split(), yielding.split()
    nodes, priorities = control_patches(net, *signs, lambda edge: edge.attrib["id"] != "path")
    return {node.attrib["id"]: node.attrib["type"] for node in nodes}, dict(priorities)


@pytest.mark.parametrize(
    ("stopping", "yielding", "nodes", "priorities"),
    [
        *[("", "", {}, {}), ("n", "", {"J": "priority_stop"}, {"n": 0})],
        ("n e s w", "", {"J": "allway_stop"}, {"n": 4, "e": 2, "s": 0, "w": 3}),
        *[("n e w", "", {"J": "priority_stop"}, {"n": 0, "e": 0, "w": 0}), ("", "s", {}, {"s": 0})],
        *[("", "n", {}, {"n": 0}), ("n", "s", {"J": "priority_stop"}, {"n": 2, "s": 0})],
        ("path away", "", {"K": "allway_stop"}, {"away": 8}),
    ],
)
def test_signs_lower_their_approaches_below_the_others(stopping, yielding, nodes, priorities):
    """One less than the least of the approaches without a sign and the own one; 1 where nothing is stated."""
    assert patched(stopping, yielding) == (nodes, priorities)


@pytest.mark.parametrize("kind", ["traffic_light", "traffic_light_right_on_red"])
def test_a_signal_outranks_signs(kind):
    assert patched("n", "e", kind) == ({}, {})


CORNER_NET = """<net>
  <edge id=":J_0" function="internal"><lane id=":J_0_0" shape="{path}"/></edge>
  <edge id=":J_1" function="internal"><lane id=":J_1_0" shape="{rest}"/></edge>
  <edge id="a"><lane id="a_0" shape="-50,0,1 0,0,1"/></edge>
  <edge id="b"><lane id="b_0" shape="10,10 10,60"/></edge>
  <connection from="a" to="b" fromLane="0" toLane="0" via=":J_0_0"/>
  <connection from=":J_0" to="b" fromLane="0" toLane="0" {via}/>
  <connection from=":J_1" to="b" fromLane="0" toLane="0"/>
</net>"""


def shapes_of(path, rest=""):
    net = fromstring(CORNER_NET.format(path=path, rest=rest or "0,0 1,1", via='via=":J_1_0"' if rest else ""))
    mend_junction_paths(net)
    return {lane.attrib["id"]: points_of(lane.attrib["shape"]) for lane in net.iter("lane")}


@pytest.mark.parametrize(("long_m", "cut_m"), [(50.0, 6.0), (7.0, 0.0)])
def test_a_lane_ends_before_the_begin_of_the_next_one(long_m, cut_m):
    """No vehicle follows a path that leads back by metres; a lane that is too short for the cut stays."""
    net = fromstring(
        f"""<net><edge id=":J_0" function="internal"><lane id=":J_0_0" shape="0,0 -3,0"/></edge>
        <edge id=":J_1" function="internal"><lane id=":J_1_0" shape="0,0 12,0"/></edge>
        <edge id="a"><lane id="a_0" shape="{-long_m},0 -1,0 0,0"/></edge>
        <edge id="b"><lane id="b_0" shape="-3,0 50,0"/></edge><edge id="c"><lane id="c_0" shape="12,0 50,0"/></edge>
        <connection from="a" to="b" fromLane="0" toLane="0" via=":J_0_0"/>
        <connection from="a" to="c" fromLane="0" toLane="0" via=":J_1_0"/></net>"""
    )
    mend_junction_paths(net)
    ends = {lane.attrib["id"]: points_of(lane.attrib["shape"])[[0, -1], 0] for lane in net.iter("lane")}
    assert ends["a_0"] == pytest.approx([-long_m, -cut_m])
    assert ends[":J_0_0"] == pytest.approx([-cut_m, -3.0])
    assert ends[":J_1_0"] == pytest.approx([-cut_m, 12.0])


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
    net = fromstring(
        CORNER_NET.format(path="0,0,1 24,10,3", rest="0,0 1,1", via="").replace("10,10 10,60", "24,10 24,60")
    )
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
        *[("0,0 5,0 9,4 9.5,7.5 10,10", True), ("0,0 5,0 9,4 9.6,7.5 10,10", False), ("0,0 1,1.2", False)],
    ],
)
def test_ten_degrees_at_either_end_are_a_corner_but_for_short_paths(path, mended):
    shape = shapes_of(path)[":J_0_0"]
    assert (len(shape) == 17) is mended
    assert mended or shape == pytest.approx(points_of(path))


def test_numbers_are_written_to_a_tenth_of_a_millimetre():
    assert text_of(np.array([[1.0, -2.5, 0.12344], [10.0, 0.0, 100.0]])) == "1,-2.5,0.1234 10,0,100"
    assert points_of("1,2,3 4,5").tolist() == [[1.0, 2.0], [4.0, 5.0]]


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


FANNED_OUT_OSM = """<?xml version="1.0"?><osm version="0.6">
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
    source.write_text(FANNED_OUT_OSM)
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


def test_joints_at_roads_that_lie_over_each_other_in_the_longer_joints_net_alone_are_crowded(network):
    assert crowded_joints(network, network) == frozenset()
    lane, *_, other = (lane for lane in network.lanes if lane.kind is LaneKind.DRIVING and lane.position == 0)
    over = replace(other, centre=Polyline.through(lane.centre.offset_points(lane.centre.arc_m, 1.0)))
    moved = replace(network, lanes=tuple(over if item is other else item for item in network.lanes))
    edges = [network.edges[item.edge] for item in (lane, other)]
    joints = {junction for edge in edges for junction in (edge.from_junction, edge.to_junction)}
    assert joints <= crowded_joints(network, moved)
    assert crowded_joints(moved, moved) == crowded_joints(moved, network) == frozenset()


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


STREETS_NET = """<net><edge id="1" from="a" to="x"/><edge id="-1" from="x" to="a"/><edge id="2" from="x" to="b"/>
<edge id="3" from="x" to="c"/><edge id="4" from="c" to="d"/><edge id=":d_c0" function="crossing"/>
<junction id="a" type="dead_end"/><junction id="x" type="priority"/><junction id="c" type="priority"/>
<junction id="d" type="priority"/><junction id=":x_0_0" type="internal"/></net>"""
SIDEWALKS_OSM = """<osm version="0.6"><node id="1" lat="52.5" lon="13.400"/><node id="2" lat="52.5" lon="13.405"/>
<node id="3" lat="52.5" lon="13.410"/><node id="4" lat="52.503" lon="13.405"/><node id="5" lat="52.497" lon="13.405"/>
<way id="10"><nd ref="1"/><nd ref="2"/><nd ref="3"/><tag k="highway" v="secondary"/><tag k="lanes" v="4"/>
<tag k="maxspeed" v="50"/><tag k="sidewalk" v="both"/><tag k="cycleway" v="lane"/></way>
<way id="11"><nd ref="4"/><nd ref="2"/><nd ref="5"/><tag k="highway" v="tertiary"/><tag k="lanes" v="2"/>
<tag k="maxspeed" v="50"/><tag k="sidewalk" v="separate"/></way></osm>"""


def kinds(path, cache, *, for_people):
    network = parse_road_network(compile_map(path, cache, for_people=for_people).read_bytes())
    found = {kind: sum(lane.kind is kind for lane in network.lanes) for kind in LaneKind}
    return {kind: number for kind, number in found.items() if number and kind is not LaneKind.INTERNAL}


def road(junction, length_m, s_m):
    return (
        f'<road id="1" junction="{junction}" length="{length_m}"><link>'
        '<predecessor elementType="junction" elementId="7"/><successor elementType="junction" elementId="8"/></link>'
        f'<objects><object id="1" type="crosswalk" s="{s_m}"/><object id="2" type="pole" s="0"/></objects></road>'
    )


@pytest.mark.parametrize(("junction", "s_m", "found"), [("9", 1.0, "9"), ("-1", 49.0, "7"), ("-1", 51.0, "8")])
def test_a_crosswalk_belongs_to_its_junction_or_to_the_nearer_one(junction, s_m, found):
    assert crosswalk_junctions(fromstring(f"<OpenDRIVE>{road(junction, 100, s_m)}</OpenDRIVE>")) == {found}


@pytest.mark.parametrize(
    ("kind", "content", "expected"),
    [
        (SourceKind.SUMO, "", {"a", "c"}),
        (SourceKind.OPENDRIVE, f"<OpenDRIVE>{road('c', 9, 1)}</OpenDRIVE>", {"a", "d", "x"}),
    ],
)
def test_nothing_crosses_elsewhere(kind, content, expected):
    elements = list(crossing_places(MapSource("m", kind, content.encode()), fromstring(STREETS_NET)))
    assert {element.get("node") for element in elements} == expected
    assert {element.get("discard") for element in elements} == {"true"}


@pytest.mark.parametrize(
    ("tag", "expected"),
    [
        (b'k="sidewalk" v="separate"', b'k="sidewalk" v="both"'),
        (b"k='sidewalk:left' v='separate'", b"k='sidewalk:left' v='yes'"),
        (b'k="sidewalk:right" v="no"', b'k="sidewalk:right" v="no"'),
        (b'k="cycleway" v="separate"', b'k="cycleway" v="separate"'),
    ],
)
def test_separate_sidewalks_lie_on_their_street(tag, expected):
    assert with_sidewalks_on_streets(tag) == expected


def test_an_extract_has_ways_for_people_only_where_they_are_asked_for(tmp_path):
    path = tmp_path / "mini.osm"
    path.write_text(SIDEWALKS_OSM, encoding="utf-8")
    assert kinds(path, tmp_path, for_people=False) == {LaneKind.DRIVING: 12, LaneKind.SIDEWALK: 4}
    assert kinds(path, tmp_path, for_people=True) == {
        LaneKind.DRIVING: 12,
        LaneKind.SIDEWALK: 8,
        LaneKind.CYCLE: 4,
        LaneKind.CROSSING: 4,
    }


def test_a_net_with_corners_keeps_them_and_loses_the_outlines_of_crossings(cache, tmp_path):
    town = compile_map(None, cache)
    path = tmp_path / "copy.net.xml"
    path.write_bytes(town.read_bytes())
    assert has_corners(town.read_bytes())
    plain, peopled = (compile_map(path, tmp_path, for_people=asked).read_bytes() for asked in (False, True))
    assert b"outlineShape" in plain
    assert peopled == without_outlines(plain)
    assert b"outlineShape" not in peopled
    assert compile_map(None, cache, for_people=True) == town


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
