"""The wheel angle in closed form on lines and circles that point anywhere, pedals, and free space."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_episode import rotate

from siren_ros.base.numerics.geometry import footprint_corners, separation_m
from siren_ros.simulation.behaviour.driving.driver_states import EmvUnit
from siren_ros.simulation.behaviour.driving.navigator import (
    DAMPING,
    LEADER_BRAKE_MPS2,
    NARROW_STOP_SHORT_M,
    PREVIEW_MIN_M,
    PREVIEW_TIME_S,
    FreeWay,
    NavigatorState,
    Obstacles,
    SpeedLimit,
    Wheels,
    clearances_m,
    manoeuvring_limit,
    poses_ahead,
    press_pedals,
    separations_m,
    steer_along,
)
from siren_ros.simulation.behaviour.driving.speed_mechanisms import MECHANISMS, Mechanism, navigate
from siren_ros.simulation.behaviour.driving.step_view import STEER_RATE_SHARE, Body, Surroundings
from siren_ros.simulation.behaviour.driving.tracked_path import Curve, Navigation, TrackedPath
from siren_ros.simulation.dynamics.vehicle_model import BodyState, Controls, ParameterTable, step_bodies
from siren_ros.simulation.scenario.driver_parameters import ManoeuvringConfig
from siren_ros.simulation.world.actors import NO_ACTOR, ActorClass

BODY = Body(3.0, 1.0)
SQUEEZES = ((0.3, 8.0), (0.15, 4.0), (0.06, 1.0))
WHEELS = Wheels(centre_ahead_m=0.0, slip_s2pm=0.0, sharpest_1pm=0.2, rate_1pms=0.3)


def boxes(*rows):
    """Rows of x, y, yaw, half length, half width; ids from 2 on."""
    x, y, yaw, length, width = np.array(rows, dtype=float).reshape(-1, 5).T
    return Obstacles(np.arange(2, 2 + len(x), dtype=np.uint32), x, y, np.cos(yaw), np.sin(yaw), length, width)


def straight(obstacles, reach=30.0, start=(0.0, 0.0, 0.0), credit=0.0):
    path = TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [50.0, 0.0]])), Navigation())
    return FreeWay.along(path, (*start, 1.0, math.nan), WHEELS, reach, BODY, obstacles, np.full(len(obstacles), credit))


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
    near = straight(boxes((10, 0, 0, 2, 1)))
    assert near.limit(8.0, SQUEEZES, 1.0, 2.5).brake_mps2 == pytest.approx(8.0**2 / (2.0 * (near.free_m - 1.0)))
    apart = straight(boxes((12, 2.5, 0, 2, 1)))
    assert math.isinf(apart.free_m)
    assert apart.limit(8.0, SQUEEZES, 1.0, 2.5) == SpeedLimit()


def test_tight_places_are_approached_at_the_speed_that_their_margin_allows():
    way = straight(boxes((15, 2.2, 0, 2, 1)))
    free = way.until_m(0.3)
    assert free == pytest.approx(10.0, abs=0.5)
    assert way.limit(8.0, SQUEEZES, 1.0, 2.5).speed_mps == pytest.approx(math.sqrt(4.0**2 + 2.0 * 2.5 * free))
    assert straight(boxes((0, 2.1, 0, 2, 1))).limit(8.0, SQUEEZES, 1.0, 2.5).speed_mps == pytest.approx(1.0)


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


@pytest.mark.parametrize("turned", [0.08, 0.0, -0.08])
@pytest.mark.parametrize("kind", [ActorClass.BUS, ActorClass.SEDAN])
def test_the_poses_ahead_are_those_to_which_the_vehicle_steers(lab, kind, turned):
    """A move by 1 m that begins at an angle: the ends of a bus swing over, and so do the poses that it expects."""
    vehicle, x = lab.vehicles[kind], np.arange(-2.0, 40.0, 0.5)
    u, speed = np.clip(x / 8.0, 0.0, 1.0), 2.5
    path = TrackedPath.of(Curve.through(np.stack((x, u**3 * (10 - 15 * u + 6 * u * u)), axis=-1)), CONFIG)
    way, line = np.arange(0.0, 12.0, 0.25), (path.curve.points, path.curve.heading_rad, path.curve.curvature_1pm)
    poses = np.empty((4, len(way)))
    poses_ahead(*line, path.curve.spacing_m, (2.0, 0.0, turned, speed, 0.0), Wheels.of(vehicle), way, poses)
    table, nobody, one = ParameterTable.of([kind], lab.vehicles), np.zeros(1, np.bool_), np.ones(1)
    body = BodyState.moving(*(np.array([value]) for value in (0.0, 0.0, turned, speed)))
    progress_m, driven_m, far = 2.0, 0.0, 0.5 * vehicle.length_m
    while driven_m < 6.0:
        before = body.x_m[0], body.y_m[0]
        progress_m, left_m = path.curve.nearest_to(progress_m, *before)
        steer = steer_along(path, progress_m, left_m, body.yaw_rad[0], body.forward_mps[0], vehicle)
        pedals = press_pedals(body.forward_mps[0], speed, 0.0, 0.0, vehicle, CONFIG, steer)
        asked = (np.array([value]) for value in (pedals.throttle, pedals.brake, steer))
        body = step_bodies(body, Controls(*asked, nobody, one, one), table, 0.05)
        driven_m += math.hypot(body.x_m[0] - before[0], body.y_m[0] - before[1])
        expected_y = np.interp(driven_m, way, poses[1]), np.interp(driven_m, way, np.arctan2(poses[3], poses[2]))
        for end in (far, -far):
            y_m = body.y_m[0] + end * math.sin(body.yaw_rad[0])
            assert y_m == pytest.approx(expected_y[0] + end * math.sin(expected_y[1]), abs=0.15)


def test_a_vehicle_that_drives_ahead_leaves_way_behind_itself():
    assert straight(boxes((12, 0, 0, 2, 1)), credit=4.0).free_m == straight(boxes((12, 0, 0, 2, 1))).free_m + 4.0


def test_the_present_offset_and_direction_count():
    beside = boxes((6, 2.4, 0, 2, 1))
    assert math.isinf(straight(beside).free_m)
    assert straight(beside, start=(0.0, 0.8, 0.0)).free_m < 6.0
    assert straight(beside, start=(0.0, 0.0, 0.2)).free_m < 6.0


def test_a_body_points_into_the_bend_of_its_path():
    a = np.linspace(0.0, 1.2, 40)
    path = TrackedPath.of(Curve.through(20.0 * np.stack((np.sin(a), 1.0 - np.cos(a)), axis=-1)), Navigation())
    heading = float(path.curve.heading_at(np.array([10.0]))[0]) - math.atan(2.0 / 20.0)
    place = path.curve.at(np.array([10.0]))[0]
    front = place + 3.0 * np.array([math.cos(heading), math.sin(heading)])
    obstacles = boxes((*(front + 0.4), heading, 0.1, 0.1))
    pose = 10.0, 0.0, heading, 1.0, math.nan
    way = FreeWay.along(path, pose, WHEELS._replace(centre_ahead_m=2.0), 0.5, BODY, obstacles, np.zeros(1))
    corners = footprint_corners(
        np.array([place[0], front[0] + 0.4]), np.array([place[1], front[1] + 0.4]),
        np.array([heading, heading]), np.array([6.0, 0.2]), np.array([2.0, 0.2]),
    )  # fmt: skip
    assert way.gap_m[0, 0] == pytest.approx(separation_m(corners[:1], corners[1:])[0], abs=0.02)


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


CONFIG = Navigation()
TURNS = np.radians([0.0, 50.0, 175.0, -120.0])


@pytest.fixture
def vehicle(lab):
    return lab.vehicles[ActorClass.AMBULANCE]


def line(turn):
    return TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [100.0 * np.cos(turn), 100.0 * np.sin(turn)]])), CONFIG)


def expected(vehicle, left, turned, speed):
    length, offset = max(PREVIEW_MIN_M, PREVIEW_TIME_S * speed), max(-1.0, min(1.0, left))
    bend_rate = STEER_RATE_SHARE * vehicle.max_steer_rate_radps / vehicle.wheelbase_m
    errors = abs(offset + 2.0 * DAMPING * math.sin(turned) * length)
    length = max(length, (speed * errors / bend_rate) ** (1.0 / 3.0))
    target = -offset / length**2 - 2.0 * DAMPING * math.sin(turned) / length
    return math.atan(vehicle.wheelbase_m * target) + vehicle.understeer_gradient_s2pm * target * speed**2


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(
    ("left", "turned", "speed"),
    [(0.5, 0.0, 10.0), (-0.5, 0.0, 10.0), (0.0, 0.1, 3.0), (0.0, -0.1, 12.0), (0.8, 0.2, 8.0)],
)
def test_on_a_line_offset_and_heading_are_steered_back(vehicle, turn, left, turned, speed):
    steer = steer_along(line(turn), 40.0, left, turn + turned, speed, vehicle)
    assert steer == pytest.approx(expected(vehicle, left, turned, speed), abs=1e-9)
    if left * turned >= 0.0:
        assert np.sign(steer) == -np.sign(left + turned)


@pytest.mark.parametrize("speed", [3.0, 9.0])
def test_large_offsets_are_corrected_no_more_steeply_than_one_metre(vehicle, speed):
    for left in (4.0, -4.0):
        one = steer_along(line(0.3), 40.0, math.copysign(1.0, left), 0.3, speed, vehicle)
        assert steer_along(line(0.3), 40.0, left, 0.3, speed, vehicle) == one


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_wheels_turn_no_farther_than_they_can(vehicle, side):
    assert steer_along(line(0.0), 40.0, 0.0, -side * 1.4, 0.5, vehicle) == side * vehicle.max_steer_rad


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("speed", [4.0, 9.0])
def test_on_a_circle_the_steady_cornering_angle_and_sideslip(vehicle, side, speed):
    """The footprint's centre runs on the circle; its heading differs from the path's by the sideslip."""
    radius = 40.0
    a = np.linspace(0.0, 2.0, 800)
    circle = np.stack((radius * np.sin(a), side * radius * (1.0 - np.cos(a))), axis=-1)
    path = TrackedPath.of(Curve.through(circle), CONFIG)
    bend = side / radius
    slip = vehicle.mass_kg * vehicle.cg_to_front_axle_m / (vehicle.wheelbase_m * vehicle.cornering_stiffness_rear_npr)
    sideslip = math.atan(vehicle.centre_ahead_of_rear_axle_m * bend) - slip * bend * speed**2
    steer = steer_along(path, 40.0, 0.0, side * 40.0 / radius - sideslip, speed, vehicle)
    steady = math.atan(vehicle.wheelbase_m * bend) + vehicle.understeer_gradient_s2pm * bend * speed**2
    assert steer == pytest.approx(steady, abs=2e-3)


def test_never_both_pedals(vehicle):
    for speed in (0.0, 3.0, 14.0):
        for target in (0.0, 2.0, 14.0, 20.0):
            pedals = press_pedals(speed, target, 0.0, 0.0, vehicle, CONFIG)
            assert pedals.throttle == 0.0 or pedals.brake == 0.0
            assert 0.0 <= pedals.throttle <= 1.0
            assert 0.0 <= pedals.brake <= 1.0


@pytest.mark.parametrize(("speed", "target", "holds"), [(0.3, 0.0, True), (0.31, 0.0, False), (0.1, 0.06, False)])
def test_the_brake_holds_only_at_a_standstill_that_is_wanted(vehicle, speed, target, holds):
    pedals = press_pedals(speed, target, 0.0, 0.5, vehicle, CONFIG)
    assert (pedals.brake == 0.6) is holds
    assert not holds or (pedals.throttle, pedals.integral_mps2) == (0.0, 0.0)


def accel_of(pedals, speed, vehicle):
    """What the pedals do to the speed: drive and brakes against drag and rolling resistance."""
    most = min(vehicle.max_drive_accel_mps2, vehicle.drive_power_w / (vehicle.mass_kg * max(speed, 1.0)))
    drag = 0.5 * 1.225 * vehicle.drag_area_m2 * speed**2 / vehicle.mass_kg
    resistance = drag + vehicle.rolling_resistance * 9.80665
    return pedals.throttle * most - pedals.brake * vehicle.max_brake_decel_mps2 - resistance


@pytest.mark.parametrize(
    ("target", "must", "accel"),
    [
        *[(6.3, 0.0, 0.6 + 0.1), (5.4, 0.0, -1.2 + 0.1), (9.0, 0.0, 2.5)],
        *[(0.0, 0.0, -1.3 * 3.0), (6.3, 2.0, -2.0), (0.0, 2.0, -1.3 * 3.0)],
    ],
)
def test_pedals_give_the_acceleration_that_is_asked_for_within_comfort(vehicle, target, must, accel):
    pedals = press_pedals(6.0, target, must, 0.1, vehicle, CONFIG)
    assert accel_of(pedals, 6.0, vehicle) == pytest.approx(accel, abs=1e-9)
    assert press_pedals(6.0, target, 50.0, 0.1, vehicle, CONFIG).brake == 1.0


def braked(vehicle, steer_rad):
    """The body after driving at 11 m/s with its wheels at an angle, and 0.6 s of firm braking."""
    table, nobody, none, one = ParameterTable.of_rows([vehicle]), np.zeros(1, np.bool_), np.zeros(1), np.ones(1)
    body = BodyState.moving(none, none, none, np.array([11.0]))
    for target_mps in [11.0] * 24 + [0.0] * 12:
        pedals = press_pedals(float(body.forward_mps[0]), target_mps, 0.0, 0.0, vehicle, CONFIG, steer_rad)
        throttle, brake = np.array([pedals.throttle]), np.array([pedals.brake])
        body = step_bodies(body, Controls(throttle, brake, np.array([steer_rad]), nobody, one, one), table, 0.05)
    return body


@pytest.mark.parametrize("steer_rad", [-0.12, 0.12])
def test_braking_is_no_harder_in_a_bend(vehicle, steer_rad):
    bend, straight = braked(vehicle, steer_rad), braked(vehicle, 0.0)
    assert abs(bend.lateral_accel_mps2[0]) > 1.5
    assert bend.accel_mps2[0] == pytest.approx(straight.accel_mps2[0], abs=0.05)


@pytest.mark.parametrize(("target", "grows"), [(6.5, 0.3 * 0.5 * 0.05), (5.5, -0.3 * 0.5 * 0.05)])
def test_the_integral_grows_with_the_error(vehicle, target, grows):
    assert press_pedals(6.0, target, 0.0, 0.2, vehicle, CONFIG).integral_mps2 == pytest.approx(0.2 + grows)
    assert press_pedals(6.0, target, 1.0, 0.2, vehicle, CONFIG).integral_mps2 == 0.2
    assert press_pedals(6.0, target + np.sign(grows), 0.0, 0.2, vehicle, CONFIG).integral_mps2 == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_integral_is_bounded_on_both_sides(vehicle, side):
    assert press_pedals(6.0, 6.0 + 0.5 * side, 0.0, 0.8 * side, vehicle, CONFIG).integral_mps2 == 0.8 * side


CLASSES = [ActorClass.AMBULANCE, ActorClass.FIRE_TRUCK]


def seen_of(body, table):
    ids, yaw = np.arange(1, len(body) + 1, dtype=np.uint32), body.yaw_rad
    poses = (body.x_m, body.y_m, yaw, np.cos(yaw), np.sin(yaw), np.hypot(body.forward_mps, body.lateral_mps))
    return Surroundings(ids, *poses, table.length_m / 2.0, table.width_m / 2.0, np.zeros(len(body), dtype=bool))


def on_straight(lab, kinds, *rows):
    """The first of some vehicles (x, y, yaw, speed) on a path of 100 m along x; its state and all actors."""
    body = BodyState.moving(*np.array(rows, dtype=float).T.copy())
    path = TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [100.0, 0.0]])), CONFIG)
    state = NavigatorState().following(path, 0.0, 0.0)
    return state, seen_of(body, ParameterTable.of(kinds, lab.vehicles)), lab.vehicles[kinds[0]]


def navigated(state, seen, vehicle, target, mechanisms=MECHANISMS[:3], **unit):
    """One step of an EMV by the mechanisms that all drivers have in common."""
    pose = float(seen.x_m[0]), float(seen.y_m[0]), float(seen.yaw_rad[0])
    ego = SimpleNamespace(
        seen=seen, row=0, vehicle=vehicle, speed_mps=float(seen.speed_mps[0]), pose=pose, place=pose[:2]
    )
    return navigate(EmvUnit(1, navigator=state, **unit), ego, target, CONFIG, mechanisms)


def drive(lab, kind, speed, target, seconds, start=(0.0, 0.0, 0.0)):
    """Rows of (x, speed, offset) along a line of 250 m."""
    path = TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [250.0, 0.0]]), 1.5), CONFIG, stop_at_end=True)
    table, body = ParameterTable.of([kind], lab.vehicles), BodyState.moving(*np.array([(*start, speed)]).T)
    state, rows, one = NavigatorState().following(path, *start[:2]), [], np.ones(1)
    for _ in range(round(seconds / 0.05)):
        state, command, _ = navigated(state, seen_of(body, table), lab.vehicles[kind], target)
        asked = Controls(*np.array(command[:3])[:, None], np.zeros(1, bool), one, one)
        body = step_bodies(body, asked, table, 0.05)
        rows.append((body.x_m[0], body.forward_mps[0], state.left_m))
    return np.array(rows).T


@pytest.mark.parametrize("kind", CLASSES)
def test_reaches_and_keeps_50_kmh_and_stops_at_the_end(lab, kind):
    x_m, mps, _ = drive(lab, kind, 0.0, 13.89, 30.0)
    assert mps.max() == pytest.approx(13.89, abs=0.3)
    assert mps[-1] < 0.05
    assert x_m[-1] == pytest.approx(250.0, abs=2.0)
    assert np.ptp(x_m[-20:]) < 0.02


@pytest.mark.parametrize("kind", [ActorClass.BUS, ActorClass.FIRE_TRUCK])
@pytest.mark.parametrize("start", [(0.0, 1.2, 0.0), (0.0, -1.0, -0.2)])
@pytest.mark.parametrize("speed", [4.0, 8.3])
def test_no_vehicle_swings_about_its_path(lab, kind, start, speed):
    """The wheels of a long one turn slowly: feedback that is too quick for them is unstable."""
    *_, left_m = drive(lab, kind, speed, speed, 14.0, start)
    assert (np.sign(start[1]) * left_m).min() > -0.1
    assert np.abs(left_m[len(left_m) // 2 :]).max() < 0.06


@pytest.mark.parametrize("mode", ["gap_escape_active", "corridor"])
def test_in_a_gap_escape_and_in_a_corridor_leaders_are_left_to_the_other_limits(lab, mode):
    scene = on_straight(lab, [ActorClass.AMBULANCE, ActorClass.SEDAN], (0.0, 0.0, 0.0, 10.0), (15.0, 0.0, 0.0, 0.0))
    _, watching, blocker = navigated(*scene, 10.0)
    _, leaving, nobody = navigated(*scene, 10.0, **{mode: True})
    assert (blocker, nobody) == (2, NO_ACTOR)
    assert watching.brake > 0.5
    assert leaving.brake == 0.0


def test_without_a_path_it_brakes_to_a_stop(lab):
    _, seen, vehicle = on_straight(lab, [ActorClass.SEDAN], (0.0, 0.0, 0.0, 5.0))
    state, command, blocker = navigated(NavigatorState(integral_mps2=2.0), seen, vehicle, 10.0)
    assert (command.throttle, command.steer_rad, command.hand_brake) == (0.0, 0.0, False)
    assert command.brake > 0.35
    assert blocker == NO_ACTOR
    assert (state.done, state.remaining_m) == (True, 0.0)
    assert state.integral_mps2 == 0.0


def test_a_limit_counts_besides_target_and_path(lab):
    def command(limit, speed=6.0):
        mechanisms = (*MECHANISMS[:3], Mechanism("other", lambda _: limit, "for the test"))
        return navigated(*on_straight(lab, [ActorClass.SEDAN], (0.0, 0.0, 0.0, speed)), 10.0, mechanisms)[1]

    assert command(SpeedLimit()).throttle > 0.0
    assert command(SpeedLimit(6.0)).throttle < command(SpeedLimit(8.0)).throttle
    assert command(SpeedLimit(2.0)).brake > 0.0
    hard = command(SpeedLimit(5.0, brake_mps2=7.0)).brake
    assert hard * lab.vehicles[ActorClass.SEDAN].max_brake_decel_mps2 == pytest.approx(7.0, abs=0.3)
    assert command(SpeedLimit(5.0, brake_mps2=7.0), speed=0.3).brake == 0.0, "who hardly rolls sets off"


MANOEUVRING = ManoeuvringConfig()
SEDAN, SUV = ActorClass.SEDAN, ActorClass.SUV


def limit(lab, state, *cars, kind=SEDAN, speed=1.5):
    view = lab.view(lab.turned_road(2.2)[0], lab.L3, [lab.Car(2, 0, 80.0, speed, (0,), kind), *cars])
    return manoeuvring_limit(state, view.ego(0))


def sideways(slope, most_m=20.0):
    """On a path to one side of the first lane of a road that points elsewhere; it leads aside by no more than a way."""
    s = np.arange(0.0, 20.0, 0.5)
    points = rotate(np.stack((80.0 + s, np.clip(slope * s, -most_m, most_m)), axis=-1), 2.2)
    return NavigatorState(TrackedPath.of(Curve.through(points), Navigation()), 0.0, 0.0)


def test_nobody_near_or_no_path_leaves_the_speed_free(lab):
    assert math.isinf(limit(lab, sideways(0.0)).speed_mps)
    assert math.isinf(limit(lab, NavigatorState(), lab.Car(3, 1, 81.0, 0.0, (0,))).speed_mps)


def test_a_vehicle_alongside_is_not_driven_into_sideways(lab):
    """The strip ahead is free, and the vehicle alongside is behind the own front bumper."""
    width = 0.5 * (lab.vehicles[SEDAN].width_m + lab.vehicles[SUV].width_m)
    beside = lab.Car(3, 1, 82.0, 0.0, (0,), SUV, left=width + 0.6 - 3.3)
    speed_limit = limit(lab, sideways(0.2), beside)
    assert speed_limit.blocker_id == 3
    assert 0.0 < speed_limit.free_m < (0.6 - 0.1) / 0.2 + 0.3
    assert speed_limit.speed_mps == pytest.approx(
        math.sqrt(2.0 * MANOEUVRING.brake_mps2 * (speed_limit.free_m - NARROW_STOP_SHORT_M))
    )
    assert math.isinf(limit(lab, sideways(0.0), beside).speed_mps)


def test_who_comes_on_at_the_side_counts_where_it_will_be_in_a_moment(lab):
    """An EMV 12 m behind in the next lane at 10 m/s will be alongside in a second; a standing one stays behind."""
    coming, standing = (lab.Car(3, 1, 68.0, speed, (0,), ActorClass.AMBULANCE, left=-1.0) for speed in (10.0, 0.0))
    assert limit(lab, sideways(0.25), coming).blocker_id == 3
    assert math.isinf(limit(lab, sideways(0.25), standing).free_m)


def test_who_swings_towards_a_coming_emv_stops_where_past_others_it_creeps(lab):
    """It comes as near as 0.2 m to somebody who will be alongside when it has had the time to stop."""
    width = 0.5 * (lab.vehicles[SEDAN].width_m + lab.vehicles[ActorClass.AMBULANCE].width_m)
    state = sideways(0.1, 0.3)
    emv = lab.Car(3, 1, 66.0, 6.0, (0,), ActorClass.AMBULANCE, left=width + 0.5 - 3.3)
    clears = limit(lab, state, emv, speed=4.0)
    assert clears.blocker_id == 3
    assert clears.free_m < 4.0
    assert limit(lab, state, emv, speed=0.5).blocker_id == NO_ACTOR
    suv_m = 0.5 * (lab.vehicles[SEDAN].width_m + lab.vehicles[SUV].width_m)
    past = limit(lab, state, lab.Car(3, 1, 76.0, 6.0, (0,), SUV, left=suv_m + 0.5 - 3.3), speed=4.0)
    assert past.blocker_id == NO_ACTOR
    assert past.speed_mps < 4.0


def test_a_leader_that_drives_leaves_the_way_that_it_needs_to_stop(lab):
    near = 80.0 + lab.vehicles[SEDAN].length_m + 3.0
    standing, driving = (limit(lab, sideways(0.0), lab.Car(3, 0, near, speed, (0,))) for speed in (0.0, 4.0))
    assert driving.free_m - standing.free_m == pytest.approx(4.0**2 / (2.0 * LEADER_BRAKE_MPS2), abs=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_flank_of_a_leader_in_the_next_lane_counts_as_far_as_it_reaches(lab, side):
    """Its rear is just ahead of the own front; the own path leads into its side, some metres farther on."""
    width = 0.5 * (lab.vehicles[SEDAN].width_m + lab.vehicles[ActorClass.BUS].width_m)
    length = 0.5 * (lab.vehicles[SEDAN].length_m + lab.vehicles[ActorClass.BUS].length_m)
    state = sideways(side * 0.2)
    standing, driving = (
        limit(lab, state, lab.Car(3, 0, 80.0 + length + 0.2, speed, (0,), ActorClass.BUS, left=side * (width + 0.8)))
        for speed in (0.0, 4.0)
    )
    assert standing.free_m < 8.0
    assert driving.free_m - standing.free_m == pytest.approx(4.0**2 / (2.0 * LEADER_BRAKE_MPS2), abs=1e-6)
