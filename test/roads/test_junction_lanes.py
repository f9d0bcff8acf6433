import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.roads.junction_lanes import PathAcross, paths_across

NET = """<net>
  <connection from="west" fromLane="0" to="east" toLane="1" via=":j_0_0"/>
  <connection from="west" fromLane="1" to="north" toLane="0" via=":j_1_0"/>
  <connection from="south" fromLane="0" to="east" toLane="0"/>
  <connection from=":j_0" fromLane="0" to="east" toLane="1"/>
  <connection from=":j_1" fromLane="0" to="north" toLane="0" via=":j_4_0"/>
  <connection from=":j_4" fromLane="0" to="north" toLane="0"/>
</net>"""


def test_each_movement_has_its_lanes_in_driving_order() -> None:
    assert list(paths_across(fromstring(NET))) == [
        PathAcross("west_0", "east_1", (":j_0_0",)),
        PathAcross("west_1", "north_0", (":j_1_0", ":j_4_0")),
        PathAcross("south_0", "east_0", ()),
    ]


@pytest.mark.parametrize("back_to", [":j_0_0", ":j_1_0"])
def test_a_way_that_does_not_end_is_refused(back_to: str) -> None:
    end = '<connection from=":j_4" fromLane="0" to="north" toLane="0"'
    circle = NET.replace(end, f'{end} via="{back_to}"').replace(
        'to="east" toLane="1"/>', 'to="east" toLane="1" via=":j_1_0"/>'
    )
    with pytest.raises(ValueError, match="does not end"):
        list(paths_across(fromstring(circle)))
