import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps.opendrive import opendrive_patches, with_stated_limits

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


def test_permissions_by_lane_type_and_width():
    lanes = lane_patches(net())
    assert set(lanes) == {"0", "1", "2", "4"}
    assert (lanes["0"]["allow"], float(lanes["0"]["speed"])) == ("pedestrian", 1.39)
    assert lanes["1"] == {"index": "1", "disallow": "all"}
    assert (lanes["2"]["allow"], float(lanes["2"]["speed"])) == ("emergency", 13.89)
    assert lanes["4"] == {"index": "4", "disallow": "all"}


def test_cycle_lanes_are_open_where_there_are_cyclists():
    cycled = net().replace(b'width="0.6" type="shoulder"', b'width="1.6" type="biking"')
    assert lane_patches(cycled)["1"] == {"index": "1", "disallow": "all"}
    assert lane_patches(cycled, for_people=True)["1"] == {"index": "1", "allow": "bicycle"}


def test_the_shoulder_follows_right_turns_only():
    (connection,) = fromstring(patches()["--connection-files"])
    assert dict(connection.attrib) == {"from": "1", "to": "3", "fromLane": "2", "toLane": "2"}


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


def test_without_signs_no_junction_changes():
    assert len(fromstring(patches()["--node-files"])) == 0


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


def test_a_signal_outranks_a_stop_sign():
    assert len(fromstring(patches(sign("206", "+"), junction_type="traffic_light")["--node-files"])) == 0


def test_damaged_opendrive_is_refused():
    with pytest.raises(MapError, match="well-formed"):
        opendrive_patches(net(), b"<OpenDRIVE>", "map.xodr")


NET = b"""<net>
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
    net = fromstring(with_stated_limits(NET, f"<OpenDRIVE>{roads}</OpenDRIVE>".encode()))
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
