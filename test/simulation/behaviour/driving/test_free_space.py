import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.base.numerics.geometry import footprint_corners, separation_m
from siren_ros.simulation.behaviour.driving.free_space import (
    FreeWay,
    Obstacles,
    clearances_m,
    poses_ahead,
    separations_m,
)
from siren_ros.simulation.behaviour.driving.step_view import Body
from siren_ros.simulation.behaviour.paths.curve import Curve
from siren_ros.simulation.behaviour.paths.tracked_path import Navigation, TrackedPath
from siren_ros.simulation.world.actors import NO_ACTOR

BODY = Body(3.0, 1.0)
SQUEEZES = ((0.3, 8.0), (0.15, 4.0), (0.06, 1.0))


def boxes(*rows):
    """Rows of x, y, yaw, half length, half width; ids from 2 on."""
    x, y, yaw, length, width = np.array(rows, dtype=float).reshape(-1, 5).T
    return Obstacles(np.arange(2, 2 + len(x), dtype=np.uint32), x, y, np.cos(yaw), np.sin(yaw), length, width)


def straight(obstacles, reach=30.0, start=(0.0, 0.0, 0.0), credit=0.0):
    path = TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [50.0, 0.0]])), Navigation())
    return FreeWay.along(path, start, 0.0, reach, BODY, obstacles, np.full(len(obstacles), credit))


coordinate = st.floats(-8.0, 8.0)
angle = st.floats(-math.pi, math.pi)


@given(coordinate, coordinate, angle, angle)
def test_separation_is_that_of_the_footprints(x, y, yaw, other):
    corners = footprint_corners(*(np.array(v) for v in ([0.0, x], [0.0, y], [yaw, other], [6.0, 4.4], [2.0, 1.8])))
    expected = separation_m(corners[:1], corners[1:])[0]
    gaps = separations_m(np.array(0.0), np.array(0.0), np.array(yaw), BODY, boxes((x, y, other, 2.2, 0.9)))
    assert gaps[0] == pytest.approx(expected, abs=1e-9)


def test_separation_broadcasts_over_poses_and_obstacles():
    gap = separations_m(np.zeros((4, 1)), np.zeros((4, 1)), np.zeros(5), BODY, boxes((9, 0, 0, 2, 1), (0, 4, 0, 2, 1)))
    assert gap.shape == (4, 5, 2)
    np.testing.assert_allclose(gap[2, 3], [4.0, 2.0])


def test_an_obstacle_does_not_count_at_poses_no_nearer_to_it():
    obstacles, x = boxes((0, 2.1, 0, 2, 1)), np.array([0.0, 1.0])
    present = separations_m(np.array(0.0), np.array(0.0), np.array(0.0), BODY, obstacles)
    assert present[0] == pytest.approx(0.1)
    assert np.isinf(clearances_m(x, np.zeros(2), np.zeros(2), BODY, obstacles, present)).all()
    np.testing.assert_allclose(clearances_m(x, np.full(2, 0.05), np.zeros(2), BODY, obstacles, present), 0.05)


def test_free_way_ends_at_the_first_contact_and_names_the_blocker():
    way = straight(boxes((20, 0, 0, 2, 1), (12, 0.5, 0, 2, 1)))
    assert way.free_m == pytest.approx(12.0 - 2.0 - 3.0, abs=0.5)
    limit = way.limit(5.0, SQUEEZES, 1.0, 2.5)
    assert limit.blocker_id == 3
    assert limit.speed_mps == pytest.approx(math.sqrt(2.0 * 2.5 * (way.free_m - 1.0)))
    assert limit.brake_mps2 == 0.0


def test_free_way_without_contact_is_infinite():
    way = straight(boxes((12, 2.5, 0, 2, 1)))
    assert math.isinf(way.free_m)
    limit = way.limit(8.0, SQUEEZES, 1.0, 2.5)
    assert math.isinf(limit.speed_mps)
    assert limit.blocker_id == NO_ACTOR


def test_tight_places_are_approached_at_the_speed_that_their_margin_allows():
    way = straight(boxes((15, 2.2, 0, 2, 1)))
    free = way.until_m(0.3)
    assert free == pytest.approx(10.0, abs=0.5)
    assert way.limit(8.0, SQUEEZES, 1.0, 2.5).speed_mps == pytest.approx(math.sqrt(4.0**2 + 2.0 * 2.5 * free))
    assert straight(boxes((0, 2.1, 0, 2, 1))).limit(8.0, SQUEEZES, 1.0, 2.5).speed_mps == pytest.approx(1.0)


def test_brakes_harder_where_the_way_is_short():
    way = straight(boxes((10, 0, 0, 2, 1)))
    assert way.limit(8.0, SQUEEZES, 1.0, 2.5).brake_mps2 == pytest.approx(8.0**2 / (2.0 * (way.free_m - 1.0)))


def test_brakes_hard_for_contact_and_gently_for_a_place_that_is_only_too_tight():
    tight = straight(boxes((6, 2.06, 0, 2, 1))).limit(8.0, SQUEEZES, 1.0, 2.5, clearance_m=0.1)
    assert tight.speed_mps < 3.0
    assert tight.blocker_id != NO_ACTOR
    assert tight.brake_mps2 == 0.0
    assert straight(boxes((6, 1.9, 0, 2, 1))).limit(8.0, SQUEEZES, 1.0, 2.5, clearance_m=0.1).brake_mps2 > 10.0


def test_close_to_contact_the_braking_does_not_fade_with_the_speed():
    near = straight(boxes((5.6, 0, 0, 2, 1)))
    assert near.free_m < 1.0
    assert [near.limit(speed, SQUEEZES, 1.0, 2.5).brake_mps2 for speed in (0.6, 0.3)] == [2.5, 2.5]
    assert straight(boxes((8, 0, 0, 2, 1))).limit(0.6, SQUEEZES, 1.0, 2.5).brake_mps2 == 0.0


def test_behind_a_bend_the_body_turns_as_a_trailer_of_its_centre():
    turn = np.linspace(0.0, 0.5 * math.pi, 60)
    bend = np.stack((10.0 + 8.0 * np.sin(turn), 8.0 - 8.0 * np.cos(turn)), axis=-1)
    curve = Curve.through(np.concatenate(([[0.0, 0.0]], bend, [[18.0, 30.0]])))
    way, centre_m = np.arange(0.0, 30.0, 0.25), 1.6
    poses = np.empty((4, len(way)))
    line = curve.points, curve.heading_rad, curve.curvature_1pm, curve.spacing_m
    poses_ahead(*line, 0.0, 0.0, 0.0, centre_m, way, poses)
    fine = np.arange(0.0, 30.0, 0.01)
    yaw, yaws = 0.0, []
    for place_m, heading in zip(fine, curve.heading_at(fine), strict=True):
        if abs(place_m / 0.25 - round(place_m / 0.25)) < 1e-6:
            yaws.append(yaw)
        yaw += 0.01 / centre_m * math.sin(heading - yaw)
    np.testing.assert_allclose(np.arctan2(poses[3], poses[2]), yaws, atol=0.03)


def test_a_vehicle_that_drives_ahead_leaves_way_behind_itself():
    assert straight(boxes((12, 0, 0, 2, 1)), credit=4.0).free_m == straight(boxes((12, 0, 0, 2, 1))).free_m + 4.0


def test_the_present_offset_and_direction_count():
    beside = boxes((6, 2.4, 0, 2, 1))
    assert math.isinf(straight(beside).free_m)
    assert straight(beside, start=(0.0, 0.5, 0.0)).free_m < 6.0
    assert straight(beside, start=(0.0, 0.0, 0.2)).free_m < 6.0


def test_a_body_points_into_the_bend_of_its_path():
    a = np.linspace(0.0, 1.2, 40)
    path = TrackedPath.of(Curve.through(20.0 * np.stack((np.sin(a), 1.0 - np.cos(a)), axis=-1)), Navigation())
    heading = float(path.curve.heading_at(np.array([10.0]))[0]) - math.atan(2.0 / 20.0)
    place = path.curve.at(np.array([10.0]))[0]
    front = place + 3.0 * np.array([math.cos(heading), math.sin(heading)])
    obstacles = boxes((*(front + 0.4), heading, 0.1, 0.1))
    ways = [FreeWay.along(path, (10.0, 0.0, heading), rear, 0.5, BODY, obstacles, np.zeros(1)) for rear in (2.0, 0.0)]
    corners = footprint_corners(
        np.array([place[0], front[0] + 0.4]), np.array([place[1], front[1] + 0.4]),
        np.array([heading, heading]), np.array([6.0, 0.2]), np.array([2.0, 0.2]),
    )  # fmt: skip
    assert ways[0].gap_m[0, 0] == pytest.approx(separation_m(corners[:1], corners[1:])[0], abs=0.02)


def test_moving_vehicles_are_swept_along_their_motion(lab, straight):
    seen = lab.view(straight, lab.L3, [lab.Car(2, 0, 50, 10.0, (0,)), lab.Car(3, 0, 80, 0.0, (0,))]).seen
    swept = Obstacles.swept(seen, np.array([0, 1]), np.array([2.0, 2.0]))
    half = seen.half_length_m[0]
    np.testing.assert_allclose(swept.x_m - swept.half_length_m, [50.0 - half, 80.0 - half])
    np.testing.assert_allclose(swept.x_m + swept.half_length_m, [70.0 + half, 80.0 + half])
    assert swept.select(np.array([False, True])).actor_id.tolist() == [3]


def test_the_tolerance_of_many_steps_does_not_add_up_to_contact():
    """Where bodies are 2 cm apart no step may come nearer; else none below 3 cm."""
    for gap, allowed in ((0.02, 0.02), (0.035, 0.03), (0.05, 0.03)):
        for then, free in ((allowed - 0.001, 1.0), (allowed + 0.0005, math.inf)):
            gaps = np.array([[gap], [then]])
            assert FreeWay(np.arange(2.0), gaps, np.zeros(1), np.array([2], np.uint32)).free_m == free
