"""Lanes of a compiled net: corners become bends, lengths are those of the shapes."""

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.roads.maps.lane_shapes import mended_lanes, rounded

NET = b"""<?xml version="1.0" encoding="UTF-8"?>
<net version="1.20" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="net.xsd">
  <location netOffset="0,0" convBoundary="0,0,100,100" origBoundary="0,0,1,1" projParameter="!"/>
  <edge id="alike" from="a" to="b"><lane id="alike_0" index="0" speed="9" length="77" shape="0,0 100,0"/>
    <lane id="alike_1" index="1" speed="9" length="77" shape="0,3 102,3"/></edge>
  <edge id="unlike" from="a" to="b"><lane id="unlike_0" index="0" speed="9" length="60" shape="0,0 40,0"/>
    <lane id="unlike_1" index="1" speed="9" length="60" shape="0,3 86,3"/></edge>
  <edge id="walked" from="a" to="b">
    <lane id="walked_0" index="0" allow="pedestrian" speed="1" length="60" shape="0,0 80,0"/>
    <lane id="walked_1" index="1" speed="9" length="60" shape="0,3 100,3"/></edge>
  <edge id=":b_w0" function="walkingarea">
    <lane id=":b_w0_0" index="0" allow="pedestrian" speed="1" length="5" shape="0,0 3,0 3,3"/></edge>
</net>"""


def lengths_of(net: bytes) -> dict[str, float]:
    return {lane.attrib["id"]: float(lane.attrib["length"]) for lane in fromstring(net).iter("lane")}


def test_lengths_are_those_of_the_shapes() -> None:
    assert lengths_of(mended_lanes(NET)) == {
        "alike_0": 101.0,
        "alike_1": 101.0,
        "unlike_0": 40.0,
        "unlike_1": 86.0,
        "walked_0": 100.0,
        "walked_1": 100.0,
        ":b_w0_0": 5.0,
    }


def test_nothing_else_of_a_net_changes() -> None:
    before, after = fromstring(NET), fromstring(mended_lanes(NET))
    for one, other in zip(before.iter(), after.iter(), strict=True):
        assert one.tag == other.tag
        kept = [{key: value for key, value in item.attrib.items() if key != "length"} for item in (one, other)]
        assert kept[0] == kept[1]


def test_mending_twice_changes_no_length_that_fits() -> None:
    once = mended_lanes(NET)
    assert lengths_of(mended_lanes(once)) == lengths_of(once)


@pytest.mark.parametrize("sides", [8, 24])
def test_a_polygon_becomes_nearly_a_circle(sides: int) -> None:
    angle = np.linspace(0.0, np.pi, sides)
    points = rounded(20.0 * np.stack((np.cos(angle), np.sin(angle)), axis=-1))
    radius = np.hypot(points[:, 0], points[:, 1])
    assert radius.min() > 20.0 * np.cos(np.pi / (sides - 1) / 2.0) - 0.01
    assert radius.max() <= 20.0 + 1e-9
    heading = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
    assert np.abs(np.diff(heading)).max() < 0.08


def test_a_corner_is_passed_closely_and_the_ends_stay() -> None:
    corner = np.array([[0.0, 0.0, 1.0], [30.0, 0.0, 2.0], [30.0, 30.0, 3.0]])
    points = rounded(corner)
    assert np.array_equal(points[[0, -1]], corner[[0, -1]])
    assert np.linalg.norm(points[:, :2] - corner[1, :2], axis=1).min() == pytest.approx(0.3, abs=0.02)
    assert np.all(np.diff(points[:, 2]) > 0.0)


@pytest.mark.parametrize(
    ("before_m", "after_m", "turn_rad", "cut_m"),
    [
        (1.0, 30.0, np.pi / 2.0, 0.5),
        (30.0, 0.8, np.pi / 2.0, 0.4),
        (30.0, 30.0, np.pi / 2.0, 0.6 / np.sin(np.pi / 4.0)),
        (30.0, 30.0, -1.0, 0.6 / np.sin(0.5)),
        (30.0, 30.0, 0.1, 6.0),
    ],
)
def test_a_corner_becomes_a_parabola_between_its_sides(
    before_m: float, after_m: float, turn_rad: float, cut_m: float
) -> None:
    """It begins half a side, 6 m, or what keeps it 0.3 m from the corner before it; a point every 0.05 rad or less."""
    ahead = np.array([np.cos(turn_rad), np.sin(turn_rad)])
    points = rounded(np.array([(-before_m, 0.0), (0.0, 0.0), after_m * ahead]))
    assert points[0].tolist() == [-before_m, 0.0]
    assert points[-1] == pytest.approx(after_m * ahead)
    bend = points[1:-1]
    assert bend[0] == pytest.approx([-cut_m, 0.0])
    assert bend[-1] == pytest.approx(cut_m * ahead)
    count = int(np.ceil(abs(turn_rad) / 0.05)) + 2
    share = np.linspace(0.0, 1.0, count)[:, None]
    parabola = (1.0 - share) ** 2 * [-cut_m, 0.0] + share**2 * (cut_m * ahead)
    near = np.min(np.hypot(*(parabola[:, None] - bend[None]).transpose(2, 0, 1)), axis=1)
    assert near.max() < 0.05 if len(bend) < count else near.max() < 1e-9


@pytest.mark.parametrize(("turn_rad", "count"), [(0.019, 3), (0.021, 5)])
def test_corners_of_about_a_degree_stay(turn_rad: float, count: int) -> None:
    ahead = np.array([np.cos(turn_rad), np.sin(turn_rad)])
    assert len(rounded(np.array([(-30.0, 0.0), (0.0, 0.0), 30.0 * ahead]))) == count


def test_straight_lines_and_repeated_points_stay() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.05], [20.0, 0.0]])
    assert np.array_equal(rounded(line), line)
    doubled = np.array([[0.0, 0.0], [0.0, 0.0], [5.0, 0.0]])
    assert np.array_equal(rounded(doubled), doubled)


def test_what_is_no_net_is_given_back() -> None:
    assert mended_lanes(b"<osm/>") == b"<osm/>"
