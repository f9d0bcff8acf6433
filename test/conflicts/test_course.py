"""Courses along lanes and across junctions."""

import numpy as np
import pytest

from siren_ros.conflicts.course import SPACING_M, Course, CourseBook
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import Connection, Edge, Lane, LaneKind, RoadNetwork


def lane(index, edge, points, limit=13.89, position=0, kind=LaneKind.DRIVING):
    centre = Polyline.through(np.asarray(points, dtype=float))
    return Lane(index, f"l{index}", edge, position, kind, centre, 3.3, limit, True, True)


def edges(*indices):
    return np.array(indices, dtype=np.int32)


@pytest.fixture
def network():
    """Two lanes east, then a turn to the north from the left one and straight on from both."""
    a = np.linspace(0.0, np.pi / 2.0, 16)
    arc = np.stack((100.0 + 15.0 * np.sin(a), 3.3 + 15.0 * (1.0 - np.cos(a))), axis=-1)
    lanes = (
        lane(0, 0, [[0, 0], [100, 0]]),
        lane(1, 0, [[0, 3.3], [100, 3.3]], position=1),
        lane(2, 1, arc, limit=6.0, kind=LaneKind.INTERNAL),
        lane(3, 2, [[115, 18.3], [115, 150]]),
        lane(4, 3, [[100, 0], [130, 0]], kind=LaneKind.INTERNAL),
        lane(5, 4, [[130, 0], [300, 0]]),
    )
    edges = (
        Edge(0, "west", (0, 1), "W", "J", internal=False),
        Edge(1, ":J_0", (2,), "J", "J", internal=True),
        Edge(2, "north", (3,), "J", "N", internal=False),
        Edge(3, ":J_1", (4,), "J", "J", internal=True),
        Edge(4, "east", (5,), "J", "E", internal=False),
    )
    connections = (
        Connection(1, 3, (2,), "l", None, -1, must_stop=False, junction="J"),
        Connection(0, 5, (4,), "s", None, -1, must_stop=False, junction="J"),
    )
    return RoadNetwork(lanes, edges, connections, {}, (0.0, 0.0), "!")


def test_a_turner_is_expected_along_its_turn(network):
    course = CourseBook(network).along(1, edges(0, 2))
    at = course.points[round((100.0 + 15.0 * np.pi / 2.0 + 20.0) / course.spacing_m)]
    assert at == pytest.approx([115.0, 38.3], abs=1.5)
    assert course.entries[0].start_m == pytest.approx(100.0)
    assert course.entries[0].connection.direction == "l"
    assert course.limit_at(50.0) == pytest.approx(13.89)
    assert course.limit_at(110.0) == pytest.approx(6.0)


def test_the_same_lane_with_another_route_goes_straight_on(network):
    course = CourseBook(network).along(0, edges(0, 4))
    assert np.abs(course.points[:, 1]).max() == 0.0
    assert course.length_m == pytest.approx(180.0)


def test_points_have_one_distance(network):
    course = CourseBook(network).along(1, edges(0, 2))
    steps = np.hypot(*np.diff(course.points, axis=0).T)
    assert steps.max() <= SPACING_M + 1e-9
    assert np.abs(steps - course.spacing_m).max() < 0.02


def test_on_the_junction_the_course_begins_with_the_movement(network):
    course = CourseBook(network).along(2, edges(0, 2))
    assert course.entries[0].start_m == 0.0
    assert course.entry_at(-1.0) is None
    assert course.entry_at(5.0) is course.entries[0]


def test_where_the_lane_leads_astray_the_nearest_one_that_does_not_is_taken(network):
    course = CourseBook(network).along(0, edges(0, 2))
    assert course.points[-1] == pytest.approx([115.0, 75.0], abs=6.0)


def test_without_a_next_edge_the_course_ends_with_the_lane(network):
    assert CourseBook(network).along(3, edges(2)).length_m == pytest.approx(131.7)


def test_a_course_is_worked_out_once(network):
    book = CourseBook(network)
    assert book.along(1, edges(0, 2)) is book.along(1, edges(0, 2))


@pytest.mark.parametrize("yaw", np.radians([0.0, 30.0, 60.0, -135.0]))
def test_off_the_road_everybody_goes_straight_on(yaw):
    course = Course.straight(3.0, 4.0, yaw)
    assert course.points[10] == pytest.approx([3.0 + 10.0 * np.cos(yaw), 4.0 + 10.0 * np.sin(yaw)])
