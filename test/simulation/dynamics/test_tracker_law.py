"""The tracker's law in closed form, for vehicles that point anywhere."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.base.numerics.units import GRAVITY_MPS2, STEP_S
from siren_ros.scoring.judging.physics import VerifyLimits
from siren_ros.simulation.dynamics.parameters import ParameterTable, load_vehicle_parameters
from siren_ros.simulation.dynamics.tracker import Reference, TrackerGains, TrackerState, track
from siren_ros.simulation.dynamics.vehicle_model import BodyState
from siren_ros.simulation.world.actors import ActorClass

KIND = ActorClass.SEDAN
VEHICLE = load_vehicle_parameters()[KIND]
TABLE = ParameterTable.of([KIND], load_vehicle_parameters())
GAINS = TrackerGains()
TURNS = np.radians([0.0, 40.0, 130.0, -100.0])
REACH = VEHICLE.wheelbase_m - VEHICLE.centre_ahead_of_rear_axle_m
"""From the footprint's centre to the front axle."""
CG_AHEAD_M = VEHICLE.wheelbase_m - VEHICLE.cg_to_front_axle_m
"""From the rear axle to the centre of gravity."""


def row(value):
    return np.array([float(value)])


def tracked(turn=0.0, *, behind=0.0, right=0.0, turned=0.0, speed=8.0, sumo=8.0, accel=0.0, swerve=0.0, **state):
    """Controls for a vehicle ``behind`` and to the ``right`` of SUMO's, which drives along a line that is turned.

    ``turned`` is the vehicle's yaw against that line; ``swerve`` the angle of SUMO's step against it.
    """
    along, left = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    start = np.array([20.0, 30.0])
    own = start - behind * along - right * left
    step = sumo * STEP_S * np.array([np.cos(turn + swerve), np.sin(turn + swerve)])
    body = replace(BodyState.moving(row(own[0]), row(own[1]), row(turn + turned), row(speed)), **state)
    tracker = TrackerState.at(row(start[0]), row(start[1]), row(turn))
    reference = Reference(row(start[0] + step[0]), row(start[1] + step[1]), row(turn + swerve), row(sumo), row(accel))
    return track(body, tracker, reference, TABLE, STEP_S)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("right", "turned"), [(0.2, 0.0), (-0.2, 0.0), (0.0, 0.05), (0.0, -0.05), (0.1, 0.04)])
def test_stanleys_law_at_the_front_axle(turn, right, turned):
    """SUMO goes straight: the angle is the heading error plus the offset of the front axle over the speed."""
    offset = right - REACH * np.sin(turned)
    expected = -turned + np.arctan2(GAINS.lateral_per_s * offset, 8.0 + GAINS.lateral_soft_mps)
    controls, _ = tracked(turn, right=right, turned=turned, steer_rad=row(expected))
    assert controls.steer_rad[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("swerve", [0.02, -0.02])
def test_in_a_bend_the_angle_of_the_curve_and_the_front_tyres_slip_are_fed_forward(turn, swerve):
    controls, after = tracked(turn, swerve=swerve)
    pull = VEHICLE.centre_ahead_of_rear_axle_m
    curvature = np.tan(swerve) / pull
    rear_share = 1.0 - VEHICLE.cg_to_front_axle_m / VEHICLE.wheelbase_m
    slip = VEHICLE.mass_kg * rear_share / VEHICLE.cornering_stiffness_front_npr * 8.0**2 * curvature
    heading = np.arctan(VEHICLE.wheelbase_m * curvature)
    assert controls.steer_rad[0] == pytest.approx(heading + slip, abs=1e-6)
    assert after.yaw_rad[0] == pytest.approx(turn + 8.0 * STEP_S * np.sin(swerve) / pull)


def steering_share(speed):
    return GAINS.swerve_share if speed <= GAINS.town_mps else GAINS.grip_share


def steering_grip(speed):
    return steering_share(speed) * GRAVITY_MPS2 * VEHICLE.friction_coefficient


def turned_in(curvature, speed):
    """The curvature that wheels which stand straight may ask for."""
    share = 1.0 - np.exp(-STEP_S * GAINS.quickness / VEHICLE.steer_lag_s)
    most = steering_grip(speed) / (max(speed, 0.1) * CG_AHEAD_M) * STEP_S / share
    return np.clip(curvature, -most, most)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_steering_asks_for_no_more_than_lock_and_grip(side):
    slow, _ = tracked(right=side * 9.0, speed=0.5, sumo=0.5)
    assert slow.steer_rad[0] == pytest.approx(side * VEHICLE.max_steer_rad)
    for speed in (8.0, 14.0, 14.1, 20.0):
        at_grip = side * np.arctan(VEHICLE.wheelbase_m * steering_grip(speed) / speed**2)
        fast, _ = tracked(right=side * 9.0, speed=speed, sumo=speed, steer_rad=row(at_grip))
        assert fast.steer_rad[0] == pytest.approx(at_grip)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("speed", [3.0, 8.0, 20.0])
@pytest.mark.parametrize("part", [0.0, 0.3, 0.8, -0.5])
def test_wheels_turn_no_quicker_than_the_centre_of_gravity_may_be_pushed_aside(part, speed, side):
    """Rolling without slip: v² κ + v l_r dκ/dt, where the wheels follow what is asked for with their lag."""
    grip = steering_grip(speed)
    held = side * part * min(grip / speed**2, np.tan(VEHICLE.max_steer_rad) / VEHICLE.wheelbase_m)
    present = np.arctan(VEHICLE.wheelbase_m * held)
    controls, _ = tracked(right=side * 9.0, speed=speed, sumo=speed, steer_rad=row(present))
    asked = np.tan(controls.steer_rad[0]) / VEHICLE.wheelbase_m
    quickening = (asked - held) * (1.0 - np.exp(-STEP_S * GAINS.quickness / VEHICLE.steer_lag_s)) / STEP_S
    aside = speed**2 * held + speed * CG_AHEAD_M * quickening
    assert side * aside <= grip + 1e-9
    if abs(controls.steer_rad[0]) < VEHICLE.max_steer_rad and abs(asked) < grip / speed**2:
        assert side * aside == pytest.approx(grip)


def test_in_town_nobody_swerves_with_more_than_half_a_g():
    """``siren verify`` allows 5 m/s²."""
    for vehicle in load_vehicle_parameters().values():
        assert GAINS.swerve_share * GRAVITY_MPS2 * vehicle.friction_coefficient < VerifyLimits().civilian_lateral_mps2


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_reference_swings_no_farther_than_a_car_can(side):
    _, after = tracked(swerve=side * 1.2)
    pull = VEHICLE.centre_ahead_of_rear_axle_m
    most = np.arctan(pull / VEHICLE.wheelbase_m * np.tan(VEHICLE.max_steer_rad))
    assert after.yaw_rad[0] == pytest.approx(side * 8.0 * STEP_S * np.sin(most) / pull)


def led(share, present, lag_s):
    """The pedal whose mean behind its lag is the share: the mean of w + (p - w) e^(-t/T) over the step."""
    lag_s /= GAINS.quickness
    kept = lag_s / STEP_S * (1.0 - np.exp(-STEP_S / lag_s))
    return float(np.clip((np.clip(share, 0.0, 1.0) - kept * present) / (1.0 - kept), 0.0, 1.0))


def settled(push, lag_s, most):
    """The pedal whose mean over the step is a force, from a pedal that gives none yet."""
    return led(push / most, 0.0, lag_s)


def resistance(speed):
    return 0.5 * 1.225 * VEHICLE.drag_area_m2 / VEHICLE.mass_kg * speed**2 + VEHICLE.rolling_resistance * GRAVITY_MPS2


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("behind", "accel"), [(0.05, 0.0), (-0.08, 0.0), (0.0, 0.6), (0.0, -1.5), (0.02, 0.3)])
def test_pedals_close_the_distance_and_follow_sumos_acceleration(turn, behind, accel):
    controls, after = tracked(turn, behind=behind, accel=accel)
    smoothed = accel * (1.0 - np.exp(-STEP_S / GAINS.accel_time_s))
    closing = (GAINS.along_per_s * behind - smoothed * STEP_S) / GAINS.speed_time_s
    push = smoothed + closing + resistance(8.0)
    drive = min(VEHICLE.max_drive_accel_mps2, VEHICLE.drive_power_w / (VEHICLE.mass_kg * 8.0))
    throttle = settled(push, VEHICLE.throttle_lag_s, GAINS.drive_factor * drive)
    brake = settled(-push, VEHICLE.brake_lag_s, VEHICLE.max_brake_decel_mps2)
    assert (controls.throttle[0], controls.brake[0]) == pytest.approx((throttle, brake), abs=1e-6)
    assert after.accel_mps2[0] == pytest.approx(smoothed)
    assert (controls.quickness[0], controls.drive_factor[0]) == (GAINS.quickness, GAINS.drive_factor)


@pytest.mark.parametrize(("behind", "most"), [(50.0, 3.0), (-50.0, -3.0)])
def test_the_speed_is_corrected_by_no_more_than_its_limit(behind, most):
    """The vehicle has its corrected speed: only the resistances are overcome."""
    speed = 8.0 + most
    far, _ = tracked(behind=behind, speed=speed)
    drive = min(VEHICLE.max_drive_accel_mps2, VEHICLE.drive_power_w / (VEHICLE.mass_kg * speed))
    throttle = settled(resistance(speed), VEHICLE.throttle_lag_s, GAINS.drive_factor * drive)
    assert (far.throttle[0], far.brake[0]) == pytest.approx((throttle, 0.0), abs=1e-6)


def test_who_shall_stand_is_held_with_the_brake():
    controls, _ = tracked(speed=0.0, sumo=0.0)
    assert (controls.throttle[0], controls.brake[0]) == (0.0, pytest.approx(GAINS.holding_brake))


@pytest.mark.parametrize(("share", "pace"), [(0.95, 0.95), (0.5, 0.85), (1.5, 1.1)])
def test_the_pace_follows_how_far_the_centre_moves_within_what_a_vehicle_can_drive(share, pace):
    tracker = TrackerState.at(row(0.0), row(0.0), row(0.3))
    way = share * 10.0 * STEP_S
    reference = Reference(row(way * np.cos(0.3)), row(way * np.sin(0.3)), row(0.3), row(10.0), row(0.0))
    body = BodyState.moving(row(0.0), row(0.0), row(0.3), row(10.0))
    _, after = track(body, tracker, reference, TABLE, STEP_S)
    kept = np.exp(-STEP_S / GAINS.pace_time_s)
    assert after.pace[0] == pytest.approx(kept + (1.0 - kept) * pace)


@pytest.mark.parametrize("kind", [ActorClass.SEDAN, ActorClass.BUS])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_in_a_turn_nobody_is_faster_than_the_grip_allows(kind, side):
    """SUMO's vehicle is far to one side, so that the wheels are turned as far as lock or grip let them."""
    vehicle = load_vehicle_parameters()[kind]
    table = ParameterTable.of([kind], load_vehicle_parameters())
    body = BodyState.moving(row(0.0), row(-9.0 * side), row(0.0), row(5.0))
    reference = Reference(row(8.0 * STEP_S), row(0.0), row(0.0), row(8.0), row(0.0))
    controls, _ = track(body, TrackerState.at(row(0.0), row(0.0), row(0.0)), reference, table, STEP_S)
    grip = GAINS.grip_share * GRAVITY_MPS2 * vehicle.friction_coefficient
    swerve = GAINS.swerve_share * GRAVITY_MPS2 * vehicle.friction_coefficient
    steered = min(np.tan(vehicle.max_steer_rad) / vehicle.wheelbase_m, swerve / 5.0**2)
    fastest = np.sqrt(grip / steered)
    assert fastest < 8.0
    drag = 0.5 * 1.225 * vehicle.drag_area_m2 / vehicle.mass_kg * 5.0**2
    push = (fastest - 5.0) / GAINS.speed_time_s + drag + vehicle.rolling_resistance * GRAVITY_MPS2
    drive = min(vehicle.max_drive_accel_mps2, vehicle.drive_power_w / (vehicle.mass_kg * 5.0))
    expected = settled(push, vehicle.throttle_lag_s, GAINS.drive_factor * drive)
    assert controls.throttle[0] == pytest.approx(expected, abs=1e-6)
    assert np.sign(controls.steer_rad[0]) == side


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("way_m", "aside"), [(0.009, 0.25), (0.009, -0.25), (0.011, 0.25), (0.011, -0.25)])
def test_who_hardly_moves_has_the_course_of_its_heading(turn, way_m, aside):
    """SUMO's vehicle points along the line and moves a little to one side; from 1 cm on that is its course."""
    cos, sin = np.cos(turn + aside), np.sin(turn + aside)
    reference = Reference(row(way_m * cos), row(way_m * sin), row(turn + 0.1), row(way_m / STEP_S), row(0.0))
    body = BodyState.moving(row(0.0), row(0.0), row(turn), row(0.2))
    _, after = track(body, TrackerState.at(row(0.0), row(0.0), row(turn)), reference, TABLE, STEP_S)
    swerve = aside if way_m > 0.01 else 0.1
    turned = way_m * np.sin(swerve) / VEHICLE.centre_ahead_of_rear_axle_m
    assert after.yaw_rad[0] == pytest.approx(turn + turned, abs=1e-12)


LAWS = {
    "behind in a left bend": {"behind": 0.3, "right": 0.1, "turned": 0.05, "swerve": 0.03, "accel": 0.4},
    "ahead in a right bend": {"behind": -0.2, "right": -0.1, "turned": -0.04, "swerve": -0.03, "accel": -0.6},
    "slower than SUMO's": {"speed": 6.0, "sumo": 8.0, "throttle": row(0.3), "accel": 0.8, "pace": 0.95},
    "faster than SUMO's": {
        "speed": 9.0,
        "sumo": 8.0,
        "brake": row(0.2),
        "accel": -1.0,
        "pace": 0.92,
        "last_accel": -0.5,
    },
    "grip limits the wheels": {"speed": 14.0, "sumo": 14.0, "right": 2.0, "swerve": 0.05},
    "grip limits the wheels to the right": {"speed": 14.0, "sumo": 14.0, "right": -2.0, "swerve": -0.05},
    "creeps": {"speed": 0.3, "sumo": 0.4, "right": 0.05, "swerve": 0.05, "pace": 1.05, "last_accel": 0.3},
    "comes to a stop": {
        "speed": 0.4,
        "sumo": 0.02,
        "behind": -0.02,
        "accel": -2.0,
        "last_accel": -2.0,
        "brake": row(0.5),
    },
    "on the brake, and SUMO's goes": {"speed": 5.0, "sumo": 6.5, "brake": row(0.4), "throttle": row(0.1), "accel": 1.0},
}


@pytest.mark.parametrize("turn", [*TURNS, 3.1, -3.1])
@pytest.mark.parametrize("name", list(LAWS))
def test_the_whole_law_in_the_axes_of_the_line(name, turn):
    case = {"behind": 0.0, "right": 0.0, "turned": 0.0, "speed": 8.0, "sumo": 8.0, "accel": 0.0, "swerve": 0.0}
    case |= {"throttle": row(0.0), "brake": row(0.0), "pace": 1.0, "last_accel": 0.0, **LAWS[name]}
    along, left = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    last = np.array([20.0, 30.0])
    own = last - case["behind"] * along - case["right"] * left
    swerve, sumo, speed = case["swerve"], case["sumo"], case["speed"]
    to = last + sumo * STEP_S * (np.cos(swerve) * along + np.sin(swerve) * left)
    yaw = np.arctan2(np.sin(turn + case["turned"]), np.cos(turn + case["turned"]))
    body = replace(
        BodyState.moving(row(own[0]), row(own[1]), row(yaw), row(speed)), throttle=case["throttle"], brake=case["brake"]
    )
    tracker = TrackerState(row(last[0]), row(last[1]), row(turn), row(case["pace"]), row(case["last_accel"]))
    reference = Reference(row(to[0]), row(to[1]), row(turn + swerve), row(sumo), row(case["accel"]))
    controls, after = track(body, tracker, reference, TABLE, STEP_S)
    moves = sumo * STEP_S > 0.01
    pull = VEHICLE.centre_ahead_of_rear_axle_m
    curvature = np.tan(swerve) / pull
    heading = np.arctan(VEHICLE.wheelbase_m * curvature)
    front = np.array([REACH * np.cos(case["turned"]) - case["behind"], REACH * np.sin(case["turned"]) - case["right"]])
    to_goal = np.array([REACH, 0.0]) - front
    offset = to_goal[1] * np.cos(heading) - to_goal[0] * np.sin(heading)
    asked = heading - case["turned"] + np.arctan2(GAINS.lateral_per_s * offset, speed + GAINS.lateral_soft_mps)
    grip = GAINS.grip_share * GRAVITY_MPS2 * VEHICLE.friction_coefficient
    tightest = min(np.tan(VEHICLE.max_steer_rad) / VEHICLE.wheelbase_m, steering_grip(speed) / max(speed, 0.1) ** 2)
    steered = turned_in(np.clip(np.tan(asked) / VEHICLE.wheelbase_m, -tightest, tightest), speed)
    rear_share = 1.0 - VEHICLE.cg_to_front_axle_m / VEHICLE.wheelbase_m
    slip = VEHICLE.mass_kg * rear_share / VEHICLE.cornering_stiffness_front_npr * speed**2 * curvature
    assert controls.steer_rad[0] == pytest.approx(np.arctan(VEHICLE.wheelbase_m * steered) + slip, abs=1e-9)

    ratio = 1.0 if moves else np.clip(sumo * STEP_S / 0.01, 0.85, 1.1)
    pace = ratio + (case["pace"] - ratio) * np.exp(-STEP_S / GAINS.pace_time_s)
    accel = case["accel"] + (case["last_accel"] - case["accel"]) * np.exp(-STEP_S / GAINS.accel_time_s)
    assert (after.pace[0], after.accel_mps2[0]) == pytest.approx((pace, accel))
    assert (after.x_m[0], after.y_m[0]) == tuple(to)
    behind = case["behind"] * np.cos(swerve) + case["right"] * np.sin(swerve)
    fastest = np.sqrt(grip / max(abs(steered), 1e-3))
    goal_mps = max(min(pace * sumo + np.clip(GAINS.along_per_s * behind, -3.0, 3.0), fastest), 0.0)
    push = accel + (goal_mps - accel * STEP_S - speed) / GAINS.speed_time_s + resistance(speed)
    drive = min(VEHICLE.max_drive_accel_mps2, VEHICLE.drive_power_w / (VEHICLE.mass_kg * speed))
    throttle = led(push / (GAINS.drive_factor * drive), case["throttle"][0], VEHICLE.throttle_lag_s)
    brake = led(-push / VEHICLE.max_brake_decel_mps2, case["brake"][0], VEHICLE.brake_lag_s)
    if goal_mps < 0.05:
        throttle, brake = 0.0, max(brake, 0.3)
    assert (controls.throttle[0], controls.brake[0]) == pytest.approx((throttle, brake), abs=1e-9)
