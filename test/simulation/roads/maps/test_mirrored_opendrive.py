"""An OpenDRIVE map with left-hand traffic is compiled as the mirror image of one with right-hand traffic."""

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring
from repository import shared_file

from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.mirrored_opendrive import mirrored_opendrive
from siren_ros.simulation.roads.mirror_image import right_hand_image
from siren_ros.simulation.roads.net_parser import parse_road_network


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


@pytest.mark.parametrize("name", [None, "Town07.xodr"], ids=["made", "Town07"])
def test_its_network_is_the_mirror_image(name, tmp_path):
    drive = shared_file("maps", name).read_bytes() if name else DRIVE.encode()
    right, left = network_of(tmp_path, drive), network_of(tmp_path, mirrored_opendrive(drive))
    assert (left.left_hand, right.left_hand) == (True, False)
    image = right_hand_image(left)
    assert image.connections == right.connections
    shown = [[(lane.lane_id, lane.kind, lane.width_m) for lane in network.lanes] for network in (image, right)]
    assert shown[0] == shown[1]
    for lane_of_image, own in zip(image.lanes, right.lanes, strict=True):
        np.testing.assert_allclose(lane_of_image.centre.points, own.centre.points, atol=0.011)


def test_numbers_of_lanes_and_what_lies_to_the_left_change_their_signs():
    root = fromstring(mirrored_opendrive(DRIVE.encode()))
    assert root.find("road").get("rule") == "LHT"
    section = root.find("road/lanes/laneSection")
    assert [side.tag for side in section] == ["left", "center", "right"]
    assert [x.get("id") for x in section.iter("lane")] == ["3", "2", "1", "0", "-1", "-2"]
    geometry = root.find("road/planView/geometry")
    assert (geometry.get("x"), geometry.get("y"), geometry.get("hdg")) == ("10", "-20", "-0.3")
    assert root.find(".//arc").get("curvature") == "-0.01"
    assert root.find(".//laneOffset").get("a") == "-0.5"
    assert root.find(".//signal").get("t") == "6"
    assert dict(root.find(".//validity").attrib) == {"fromLane": "1", "toLane": "2"}


def test_the_image_of_the_image_is_the_map():
    once = mirrored_opendrive(DRIVE.encode())
    assert mirrored_opendrive(mirrored_opendrive(once)) == once
