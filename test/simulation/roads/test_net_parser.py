import re

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.simulation.roads.net_parser import (
    PathAcross,
    kind_of_lane,
    parse_road_network,
    paths_across,
    permissions_of,
)
from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind

NET = """<net version="1.20">
<location netOffset="100.00,50.00" convBoundary="0,0,300,100" origBoundary="0,0,0,0"
          projParameter="+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +x_0=0 +y_0=0"/>
<edge id=":j_0" function="internal">
  <lane id=":j_0_0" index="0" disallow="pedestrian" speed="5" length="5" shape="200,50 205,50"/>
</edge>
<edge id=":j_1" function="internal">
  <lane id=":j_1_0" index="0" disallow="pedestrian" speed="5" length="0" shape="205,50 205,50"/>
</edge>
<edge id=":j_c0" function="crossing">
  <lane id=":j_c0_0" index="0" allow="pedestrian" speed="1" length="8" width="4" shape="198,46 198,54"/>
</edge>
<edge id=":j_w0" function="walkingarea">
  <lane id=":j_w0_0" index="0" allow="pedestrian" speed="1" length="8" width="4" shape="198,46 198,54 199,54"/>
</edge>
<edge id="in" from="a" to="j" name="Main Street">
  <lane id="in_0" index="0" allow="pedestrian" speed="1.39" length="100" width="2" shape="100,41 200,41"/>
  <lane id="in_1" index="1" disallow="all" speed="1.39" length="100" width="0.6" shape="100,43 200,43"/>
  <lane id="in_2" index="2" allow="emergency" speed="13.89" length="100" width="2.5" shape="100,46 200,46"/>
  <lane id="in_3" index="3" allow="bus taxi emergency" speed="13.89" length="100" shape="100,48 200,48"/>
  <lane id="in_4" index="4" disallow="pedestrian tram" speed="13.89" length="100" shape="100,50 200,50"/>
</edge>
<edge id="out" from="j" to="b">
  <lane id="out_0" index="0" speed="8.33" length="95" shape="205,50 300,50" type="sidewalk"/>
  <lane id="out_1" index="1" speed="8.33" length="95" shape="205,52 300,52"/>
</edge>
<junction id="a" type="dead_end" x="100" y="50" incLanes="" intLanes="" shape=""/>
<junction id="j" type="allway_stop" x="202" y="50" incLanes="in_4" intLanes=":j_0_0" shape="200,45 205,45 205,55"/>
<junction id="b" type="right_before_left" x="300" y="50" incLanes="out_1" intLanes="" shape="300,50"/>
<junction id=":j_1_0" type="internal" x="203" y="50" incLanes="in_4" intLanes=""/>
<connection from="in" to="out" fromLane="4" toLane="1" via=":j_0_0" dir="l" state="w"/>
<connection from="in" to="out" fromLane="0" toLane="0" dir="s" state="M"/>
<connection from=":j_0" to="out" fromLane="0" toLane="1" via=":j_1_0" dir="l" state="M"/>
<connection from=":j_1" to="out" fromLane="0" toLane="1" dir="l" state="M"/>
</net>"""


@pytest.fixture(scope="module")
def network():
    return parse_road_network(NET.encode())


def test_a_map_is_parsed_once(network):
    """By its content."""
    assert parse_road_network(bytes(bytearray(NET.encode()))) is network
    assert parse_road_network(NET.replace("Main Street", "High Street").encode()) is not network


def test_kinds_follow_permissions_and_types(network):
    kinds = {lane.lane_id: lane.kind for lane in network.lanes}
    assert kinds == {
        ":j_0_0": LaneKind.INTERNAL, ":j_1_0": LaneKind.INTERNAL, ":j_c0_0": LaneKind.CROSSING,
        "in_0": LaneKind.SIDEWALK, "in_1": LaneKind.KERB, "in_2": LaneKind.SHOULDER, "in_3": LaneKind.DRIVING,
        "in_4": LaneKind.DRIVING, "out_0": LaneKind.SIDEWALK, "out_1": LaneKind.DRIVING,
    }  # fmt: skip
    lanes = network.lane_by_id
    assert [lanes[f"in_{k}"].emergency_allowed for k in range(5)] == [False, False, True, True, True]
    assert [lanes[f"in_{k}"].civilian_allowed for k in range(5)] == [False, False, False, False, True]


def test_map_coordinates_are_sumo_minus_the_net_offset(network):
    assert network.sumo_offset_m == (100.0, 50.0)
    np.testing.assert_allclose(network.lane_by_id["in_4"].centre.points, [[0.0, 0.0], [100.0, 0.0]])
    assert (network.junctions["j"].x_m, network.junctions["j"].y_m) == (102.0, 0.0)
    np.testing.assert_allclose(network.junctions["j"].outline[0], [100.0, -5.0])
    assert list(network.junctions) == ["a", "j", "b"], "those inside junctions are left out"
    assert network.origin_lat_lon_deg == pytest.approx((0.0, 0.0), abs=1e-12)
    assert network.lane_by_id["in_4"].width_m == 3.2, "SUMO's width"
    centre = network.lane_by_id[":j_1_0"].centre
    assert (centre.length_m, centre.heading_rad(0.0)) == (pytest.approx(0.01), 0.0), "an internal lane of no length"


def test_a_distant_projection_origin_moves_to_the_middle_of_the_map():
    far = NET.replace('netOffset="100.00,50.00"', 'netOffset="-500000.00,-4982950.40"')
    far = re.sub(r'projParameter="[^"]*"', 'projParameter="+proj=utm +zone=33 +ellps=WGS84"', far)
    network = parse_road_network(far.encode())
    assert network.sumo_offset_m == (150.0, 50.0)
    lat, lon = network.origin_lat_lon_deg
    assert lat == pytest.approx(45.0 + 50.0 / 111_131.0, abs=1e-6)
    assert lon == pytest.approx(15.0 + 150.0 / 78_847.0, abs=1e-5)


def moved(net, east_m, north_m):
    """A net whose coordinates are all shifted, as those that ``--offset.disable-normalization`` keeps."""
    net = re.sub(r"(?<=[\", ])(\d+),(\d+)", lambda pair: f"{int(pair[1]) + east_m},{int(pair[2]) + north_m}", net)
    return re.sub(r' x="(\d+)" y="(\d+)"', lambda at: f' x="{int(at[1]) + east_m}" y="{int(at[2]) + north_m}"', net)


@pytest.mark.parametrize("boundary", [True, False], ids=["with its boundary", "without"])
def test_coordinates_far_from_the_nets_own_origin_become_those_around_its_middle(boundary):
    plain = NET.replace('netOffset="100.00,50.00"', 'netOffset="0.00,0.00"')
    plain = re.sub(r'projParameter="[^"]*"', 'projParameter="+proj=utm +zone=32 +ellps=WGS84"', plain)
    net = moved(plain, 644_000, 5_491_000)
    if not boundary:
        net = re.sub(r'convBoundary="[^"]*"', "", net)
    near, far = (parse_road_network(text.encode()) for text in (plain, net))
    x_m, y_m = middle = (644_150, 5_491_050) if boundary else (644_200, 5_491_050)
    assert far.sumo_offset_m == far.projected_origin_m == middle
    for name, lane in near.lane_by_id.items():
        shifted = lane.centre.points + np.array([644_000 - x_m, 5_491_000 - y_m])
        np.testing.assert_allclose(far.lane_by_id[name].centre.points, shifted, atol=1e-9)
    assert far.origin_lat_lon_deg == pytest.approx((49.555, 10.994), abs=1e-3)


def test_an_origin_within_10_km_of_the_maps_middle_stays():
    for east_m, north_m, offset_m in (
        *[(9_799, 0, (100.0, 50.0)), (10_001, 0, (10_151, 50)), (0, 9_999, (100.0, 50.0)), (0, 10_002, (150, 10_052))],
    ):
        network = parse_road_network(moved(NET.replace("100.00,50.00", "100.0,50.0"), east_m, north_m).encode())
        assert network.sumo_offset_m == offset_m
    half = moved(NET, 20_000, 0).replace("20000,0,20300,100", "20000,0,20301,101")
    assert parse_road_network(half.encode()).sumo_offset_m == (20_150, 50), "whole metres"


def test_connections_chain_all_internal_lanes_and_leave_pedestrians_out(network):
    (connection,) = network.connections
    lanes = network.lanes
    assert [lanes[index].lane_id for index in connection.via] == [":j_0_0", ":j_1_0"]
    assert (lanes[connection.from_lane].lane_id, lanes[connection.to_lane].lane_id) == ("in_4", "out_1")
    assert (connection.direction, connection.junction, connection.must_stop) == ("l", "j", True)
    assert (connection.signal_id, connection.signal_link) == (None, -1)


@pytest.mark.parametrize(
    ("state", "stops", "gives_way"),
    [("s", True, True), ("w", True, True), ("m", False, True), ("=", False, True), ("M", False, False)],
)
def test_stop_signs_bind_by_link_state(state, stops, gives_way):
    network = parse_road_network(NET.replace('dir="l" state="w"', f'dir="l" state="{state}"').encode())
    assert (network.connections[0].must_stop, network.connections[0].gives_way) == (stops, gives_way)
    signal = NET.replace('dir="l" state="w"', f'tl="j" linkIndex="3" dir="l" state="{state}"')
    connection = parse_road_network(signal.encode()).connections[0]
    assert (connection.signal_id, connection.signal_link, connection.must_stop) == ("j", 3, False)
    assert not connection.gives_way


@pytest.mark.parametrize("lane", ["in_4", "out_1"])
@pytest.mark.parametrize(("allow", "ways"), [("pedestrian", (0, 0)), ("bicycle", (0, 1)), ("emergency", (1, 0))])
def test_a_movement_is_one_for_the_vehicles_that_both_its_lanes_are_open_to(lane, allow, ways):
    """Those of cyclists are kept by themselves; a way of civilians alone onto a sidewalk is none."""
    closed = re.sub(rf'(id="{lane}" index="." )(disallow="[^"]*" )?', rf'\1allow="{allow}" ', NET)
    network = parse_road_network(closed.encode())
    assert (len(network.connections), len(network.cycle_connections)) == ways


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    ("states", "alternates", "green", "yellow_s"),
    [
        *[("Gr yr rG ry", True, {0}, 2.0), ("Gr GG", False, {0, 1}, 0.0), ("rG rr", False, set(), 0.0)],
        *[("gr or rg Gr", True, {0, 3}, 0.0), ("Gr yr ry yy ry", True, {0}, 4.0)],
    ],
)
def test_a_signal_alternates_where_its_programme_has_red_and_green_and_its_longest_yellow_counts(
    states, alternates, green, yellow_s, order
):
    """Those of the movement's own link, in whatever order the phases are."""
    phases = [f'<phase duration="{s}" state="{state}"/>' for s, state in enumerate(states.split(), start=1)]
    phases = "".join(phases[::order])
    programme = f'<tlLogic id="T" type="static" programID="0" offset="0">{phases}</tlLogic><connection '
    signal = NET.replace('dir="l" state="w"', 'dir="l" state="o" tl="T" linkIndex="0"').replace(
        "<connection ", programme, 1
    )
    first = next(way for way in parse_road_network(signal.encode()).connections if way.signal_id == "T")
    assert (first.alternates, first.yellow_s) == (alternates, yellow_s)
    last = len(states.split()) - 1
    assert first.green_phases == {number if order > 0 else last - number for number in green}


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        *[("traffic_light", JunctionKind.SIGNAL), ("traffic_light_right_on_red", JunctionKind.SIGNAL)],
        *[("allway_stop", JunctionKind.ALL_WAY_STOP), ("priority_stop", JunctionKind.PRIORITY_STOP)],
        *[
            ("priority", JunctionKind.PRIORITY),
            ("zipper", JunctionKind.PRIORITY),
            ("unregulated", JunctionKind.UNCONTROLLED),
        ],
    ],
)
def test_junction_kinds(word, kind):
    network = parse_road_network(NET.replace('type="allway_stop"', f'type="{word}"').encode())
    assert network.junctions["j"].kind is kind


def test_crossing_outline_is_the_lane_widened_or_the_outline_the_net_states(network):
    (outline,) = network.crossings
    assert sorted(map(tuple, outline)) == [(96.0, -4.0), (96.0, 4.0), (100.0, -4.0), (100.0, 4.0)]
    sides_m = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1)
    assert sorted(sides_m) == [4.0, 4.0, 8.0, 8.0], "in order around it"
    stated = NET.replace(
        'width="4" shape="198,46 198,54"/>', 'width="4" shape="198,46 198,54" outlineShape="197,46 199,50 197,54"/>', 1
    )
    np.testing.assert_allclose(parse_road_network(stated.encode()).crossings[0][1], [99.0, 0.0])


LONELY = """<net><edge id="e" from="a" to="b"><lane id="e_0" index="0" speed="13.89" length="1" shape="0,0 END"/></edge>
<junction id="a" type="dead_end" x="0" y="0" shape=""/><junction id="b" type="dead_end" x="0" y="1" shape=""/></net>"""


@pytest.mark.parametrize(("length_m", "kept"), [(0.006, True), (0.004, False)])
def test_a_lane_of_half_a_centimetre_is_as_long_as_it_is(length_m, kept):
    centre = parse_road_network(LONELY.replace("END", f"0,{length_m}").encode()).lanes[0].centre
    assert centre.length_m == pytest.approx(length_m if kept else 0.01)


@pytest.mark.parametrize(
    ("document", "reason"),
    [
        *[(b"", "unreadable XML"), (b"<net", "unreadable XML"), (b"<osm/>", "<osm>")],
        (b"<net/>", "without driving lanes"),
        (b'<!DOCTYPE n [<!ENTITY a "b">]><net>&a;</net>', "unreadable XML"),
        (b'<net><edge id="e"><lane id="e_0" index="0" speed="1" shape=""/></edge></net>', "damaged net"),
        (b'<net><edge id="e"><lane id="e_0" index="0" shape="0,0 1,0"/></edge></net>', "damaged net"),
        (b'<net><location netOffset="x,y"/></net>', "damaged net"),
    ],
)
def test_what_is_no_usable_net_is_refused(document, reason):
    with pytest.raises(MapError, match=re.escape(reason)):
        parse_road_network(document)


NET_JUNCTION_LANES = """<net>
  <connection from="west" fromLane="0" to="east" toLane="1" via=":j_0_0"/>
  <connection from="west" fromLane="1" to="north" toLane="0" via=":j_1_0"/>
  <connection from="south" fromLane="0" to="east" toLane="0"/>
  <connection from=":j_0" fromLane="0" to="east" toLane="1"/>
  <connection from=":j_1" fromLane="0" to="north" toLane="0" via=":j_4_0"/>
  <connection from=":j_4" fromLane="0" to="north" toLane="0"/>
</net>"""


def test_each_movement_has_its_lanes_in_driving_order():
    assert list(paths_across(fromstring(NET_JUNCTION_LANES))) == [
        PathAcross("west_0", "east_1", (":j_0_0",)),
        PathAcross("west_1", "north_0", (":j_1_0", ":j_4_0")),
        PathAcross("south_0", "east_0", ()),
    ]


@pytest.mark.parametrize("back_to", [":j_0_0", ":j_1_0"])
def test_a_way_that_does_not_end_is_refused(back_to):
    end = '<connection from=":j_4" fromLane="0" to="north" toLane="0"'
    circle = NET_JUNCTION_LANES.replace(end, f'{end} via="{back_to}"').replace(
        'to="east" toLane="1"/>', 'to="east" toLane="1" via=":j_1_0"/>'
    )
    with pytest.raises(ValueError, match="does not end"):
        list(paths_across(fromstring(circle)))


@pytest.mark.parametrize(
    ("allow", "disallow", "civilian", "emergency", "pedestrian"),
    [
        *[(None, None, True, True, True), ("all", None, True, True, True)],
        *[(None, "all", False, False, False), ("emergency", None, False, True, False)],
        *[("pedestrian", "pedestrian", False, False, True), (None, "passenger", False, True, True)],
    ],
)
def test_permissions(allow, disallow, civilian, emergency, pedestrian):
    permissions = permissions_of(allow, disallow)
    assert (permissions.civilian, permissions.emergency, permissions.pedestrian) == (civilian, emergency, pedestrian)


@pytest.mark.parametrize(
    ("allow", "lane_type", "kind"),
    [
        *[("bus", "", LaneKind.DRIVING), ("emergency authority", "", LaneKind.SHOULDER)],
        *[("bicycle", "", LaneKind.CYCLE), ("rail", "", LaneKind.KERB), ("bicycle pedestrian", "", LaneKind.SIDEWALK)],
        *[(None, "sidewalk", LaneKind.SIDEWALK), ("tram", "", LaneKind.KERB)],
    ],
)
def test_kind(allow, lane_type, kind):
    assert kind_of_lane(permissions_of(allow, None), lane_type) is kind
