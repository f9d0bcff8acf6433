"""Paths across junctions leave and enter lanes without a corner."""

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.roads.maps.junction_paths import mend_junction_paths, points_of, text_of

NET = """<net>
  <edge id=":J_0" function="internal"><lane id=":J_0_0" shape="{path}"/></edge>
  <edge id=":J_1" function="internal"><lane id=":J_1_0" shape="{rest}"/></edge>
  <edge id="a"><lane id="a_0" shape="-50,0,1 0,0,1"/></edge>
  <edge id="b"><lane id="b_0" shape="10,10 10,60"/></edge>
  <connection from="a" to="b" fromLane="0" toLane="0" via=":J_0_0"/>
  <connection from=":J_0" to="b" fromLane="0" toLane="0" {via}/>
  <connection from=":J_1" to="b" fromLane="0" toLane="0"/>
</net>"""


def shapes_of(path: str, rest: str = "") -> dict[str, np.ndarray]:
    net = fromstring(NET.format(path=path, rest=rest or "0,0 1,1", via='via=":J_1_0"' if rest else ""))
    mend_junction_paths(net)
    return {lane.attrib["id"]: points_of(lane.attrib["shape"]) for lane in net.iter("lane")}


@pytest.mark.parametrize("rest", ["", "4,4,2 10,10,3"])
def test_a_turn_drawn_as_a_straight_line_becomes_nearly_a_circle(rest: str) -> None:
    shapes = shapes_of("0,0,1 4,4,2" if rest else "0,0,1 10,10,3", rest)
    curve = shapes[":J_0_0"]
    if rest:
        assert shapes[":J_1_0"][0] == pytest.approx(curve[-1])
        assert len(curve) < len(shapes[":J_1_0"]) + 1, "the parts keep their shares"
        curve = np.concatenate((curve, shapes[":J_1_0"][1:]))
    assert curve[0] == pytest.approx([0.0, 0.0, 1.0])
    assert curve[-1] == pytest.approx([10.0, 10.0, 3.0])
    assert np.hypot(curve[:, 0], curve[:, 1] - 10.0) == pytest.approx(10.0, abs=0.1)
    heading = np.arctan2(*np.diff(curve[:, :2], axis=0).T[::-1])
    assert np.abs(heading[[0, -1]] - [0.0, np.pi / 2.0]).max() < 0.06
    assert np.diff(curve[:, 2]) == pytest.approx(2.0 / 16.0), "heights stay linear"


@pytest.mark.parametrize("path", ["0,0 5,0 9,1 10,5 10,10", "0,0 1,1.2"])
def test_paths_without_corners_and_short_ones_stay(path: str) -> None:
    assert shapes_of(path)[":J_0_0"] == pytest.approx(points_of(path))


@pytest.mark.parametrize(
    ("path", "rest", "mended"),
    [
        ("0,0 4,0 5,1 5,5", "5,5 10,10", True),
        ("0,0 4,0 6,2", "6,2 10,6 10,10", False),
        ("0,0 6,6", "6,6 10,7 10,10", True),
    ],
)
def test_a_corner_at_either_end_of_a_path_in_two_parts_counts(path: str, rest: str, mended: bool) -> None:
    """The end is that of the last part; a corner where the parts meet is none."""
    shapes = shapes_of(path, rest)
    curve = np.concatenate((shapes[":J_0_0"], shapes[":J_1_0"][1:]))
    assert (len(curve) == 17) == mended
    if mended:
        assert np.hypot(curve[:, 0], curve[:, 1] - 10.0) == pytest.approx(10.0, abs=0.1)
    else:
        assert shapes[":J_1_0"] == pytest.approx(points_of(rest))


def test_a_curve_is_a_beziers_with_handles_along_the_lanes() -> None:
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
        ("0,0 5,0.8 9,4 10,10", False),
        ("0,0 5,1.1 9,4 10,10", True),
        ("0,0 5,0 9,4 9.5,7.5 10,10", True),
        ("0,0 5,0 9,4 9.6,7.5 10,10", False),
    ],
)
def test_ten_degrees_at_either_end_are_a_corner(path: str, mended: bool) -> None:
    found = shapes_of(path)[":J_0_0"]
    assert (len(found) == 17) is mended


def test_where_a_lane_is_missing_nothing_changes() -> None:
    text = NET.format(path="0,0 10,10", rest="0,0 1,1", via="").replace('<lane id="b_0" shape="10,10 10,60"/>', "")
    net = fromstring(text)
    mend_junction_paths(net)
    assert next(net.iter("lane")).attrib["shape"] == "0,0 10,10"


def test_numbers_are_written_to_a_tenth_of_a_millimetre() -> None:
    assert text_of(np.array([[1.0, -2.5, 0.12344], [10.0, 0.0, 100.0]])) == "1,-2.5,0.1234 10,0,100"
    assert points_of("1,2,3 4,5").tolist() == [[1.0, 2.0], [4.0, 5.0]]
