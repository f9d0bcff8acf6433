"""Roads of an OpenDRIVE map keep the limit of their type."""

import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.roads.maps.opendrive_limits import with_stated_limits

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


def speeds(*types: str) -> dict[str, float]:
    roads = "".join(f'<road id="{number}" length="100">{text}</road>' for number, text in enumerate(types, start=1))
    net = fromstring(with_stated_limits(NET, f"<OpenDRIVE>{roads}</OpenDRIVE>".encode()))
    return {lane.attrib["id"]: float(lane.attrib["speed"]) for lane in net.iter("lane")}


def kind(limit: str, unit: str = "", from_m: float = 0.0) -> str:
    stated = f' unit="{unit}"' if unit else ""
    return f'<type s="{from_m}" type="town"><speed max="{limit}"{stated}/></type>'


def test_roads_get_the_limit_of_their_type_and_paths_the_lower_one() -> None:
    found = speeds(kind("65", "mph"), kind("72", "km/h"), kind("72", "km/h"))
    assert found == {
        "-1_0": 1.39,
        "-1_1": 29.06,
        "2.15_0": 20.0,
        "3_0": 8.0,
        ":J_0_0": 20.0,
        ":J_1_0": 20.0,
        ":J_2_0": 6.5,
    }


@pytest.mark.parametrize("limit", [kind("no limit"), kind("undefined"), kind("30", "furlongs"), '<type s="0"/>', ""])
def test_without_a_number_netconverts_limit_stays(limit: str) -> None:
    assert speeds(limit)["-1_1"] == 13.89


def test_of_several_types_the_longest_counts() -> None:
    assert speeds(kind("10") + kind("20", from_m=30.0) + kind("5", from_m=90.0))["-1_1"] == 20.0
