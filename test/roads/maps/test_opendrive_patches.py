import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.roads.maps.opendrive_patches import opendrive_patches

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


def lane_patches(document):
    return {lane.get("index"): dict(lane.attrib) for lane in fromstring(document).find("edge").iterfind("lane")}


def test_permissions_by_lane_type_and_width():
    lanes = lane_patches(patches().edges)
    assert set(lanes) == {"0", "1", "2", "4"}
    assert (lanes["0"]["allow"], float(lanes["0"]["speed"])) == ("pedestrian", 1.39)
    assert lanes["1"] == {"index": "1", "disallow": "all"}
    assert (lanes["2"]["allow"], float(lanes["2"]["speed"])) == ("emergency", 13.89)
    assert lanes["4"] == {"index": "4", "disallow": "all"}


def test_the_shoulder_follows_right_turns_only():
    (connection,) = fromstring(patches().connections)
    assert dict(connection.attrib) == {"from": "1", "to": "3", "fromLane": "2", "toLane": "2"}


def test_without_signs_no_junction_changes():
    assert len(fromstring(patches().nodes)) == 0


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
    nodes = {node.get("id"): node.get("type") for node in fromstring(result.nodes)}
    assert nodes == ({} if kind is None else {"9": kind})
    lowered = {edge.get("id") for edge in fromstring(result.edges) if edge.get("priority") == "0"}
    assert lowered == minor


def test_references_to_a_sign_count_like_the_sign():
    elsewhere = '<road id="70" junction="-1" length="9"><signals><signal id="x" type="206" s="1"/></signals></road>'
    reference = (
        sign("206", "-").replace("<signal id", "<signalReference id").replace('"s50"', '"x"').replace('type="206" ', "")
    )
    nodes = fromstring(patches(elsewhere, reference).nodes)
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
    assert len(fromstring(result.nodes)) == 0
    assert all(edge.get("priority") is None for edge in fromstring(result.edges))


def test_a_signal_outranks_a_stop_sign():
    assert len(fromstring(patches(sign("206", "+"), junction_type="traffic_light").nodes)) == 0


def test_damaged_opendrive_is_refused():
    with pytest.raises(MapError, match="well-formed"):
        opendrive_patches(net(), b"<OpenDRIVE>", "map.xodr")
