"""Commands on the rows of the actors; how vehicles and people on foot follow SUMO's."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from dynamics.fleet_scenes import command_of, stacked, traffic_of

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.compiled import X, Y
from siren_ros.base.numerics.units import GRAVITY_MPS2, STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.scoring.judging.verify import VerifyLimits
from siren_ros.simulation.dynamics.controls import (
    Reference,
    TrackerGains,
    TrackerState,
    merge_commands,
    stopped_orders,
    track,
    walk,
)
from siren_ros.simulation.dynamics.vehicle_model import (
    BRAKE,
    FORWARD,
    BodyState,
    ParameterTable,
    load_vehicle_parameters,
    step_bodies,
)
from siren_ros.simulation.world.actors import VEHICLE_CLASSES, ActorClass, Lights, Mode, Owner

ROWS = {2: (0.0, 0.0, 0.0, 5.0), 5: (20.0, 0.0, 0.0, 5.0), 9: (40.0, 0.0, 0.0, 5.0)}
LIGHTS = {2: Lights.INDICATOR_LEFT, 5: Lights.INDICATOR_RIGHT, 9: Lights.SIREN}


def test_each_command_lies_on_its_actors_row_and_the_others_are_sumos():
    command = stacked(
        command_of(3, 9, throttle=0.4, brake=0.1, steer=-0.2, mode=Mode.REJOIN, lights=Lights.BEACON),
        command_of(3, 2, throttle=0.7, brake=0.3, steer=0.1, mode=Mode.YIELD_HOLD, lights=Lights.SIREN),
    )
    command = replace(command, hand_brake=np.array([0, 1], np.uint8))
    orders = merge_commands(traffic_of(3, ROWS, lights=LIGHTS), [command])
    assert orders.owner.tolist() == [Owner.ROS, Owner.SUMO, Owner.ROS]
    assert orders.throttle.tolist() == [0.7, 0.0, 0.4]
    assert orders.brake.tolist() == [0.3, 0.0, 0.1]
    assert orders.steer_rad.tolist() == [0.1, 0.0, -0.2]
    assert orders.hand_brake.tolist() == [True, False, False]
    assert orders.mode.tolist() == [Mode.YIELD_HOLD, Mode.NOMINAL, Mode.REJOIN]
    assert orders.lights.tolist() == [Lights.SIREN, Lights.INDICATOR_RIGHT, Lights.BEACON]


def test_of_a_command_the_rows_of_actors_that_left_are_void_and_the_others_hold():
    command = stacked(command_of(3, 4, throttle=1.0), command_of(3, 5, throttle=0.5))
    orders = merge_commands(traffic_of(3, ROWS, removed=[4]), [command])
    assert orders.throttle.tolist() == [0.0, 0.5, 0.0]
    assert orders.owner.tolist() == [Owner.SUMO, Owner.ROS, Owner.SUMO]
    for message, ids in ((r"commands actors \[4, 7\], unknown", (4, 7)), ("commands an actor twice", (4, 4))):
        with pytest.raises(EpisodeError, match=message):
            merge_commands(traffic_of(3, ROWS, removed=[4]), [stacked(*(command_of(3, one) for one in ids))])


@pytest.mark.parametrize("field", ["throttle", "brake", "steer"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_the_actor_whose_command_is_not_finite_is_named(field, value):
    command = stacked(command_of(3, 2), command_of(3, 5, **{field: value}))
    with pytest.raises(EpisodeError, match="commands actor 5 by values that are not finite"):
        merge_commands(traffic_of(3, ROWS), [command])


def test_of_two_controllers_of_one_actor_both_and_the_actor_are_named():
    first = stacked(command_of(3, 2, source="a"), command_of(3, 5, source="a"))
    second = stacked(command_of(3, 9, source="c"), command_of(3, 5, source="c"))
    with pytest.raises(EpisodeError, match="c and a both command actor 5 at step 3"):
        merge_commands(traffic_of(3, ROWS), [first, _empty("b"), second])


def _empty(source):
    command = command_of(3, 2, source=source)
    arrays = {name: value[:0] for name, value in vars(command).items() if isinstance(value, np.ndarray)}
    return replace(command, **arrays)


def test_who_was_in_contact_brakes_with_its_wheels_as_they_are_and_the_others_do_as_they_are_told():
    asked = {"throttle": 0.4, "brake": 0.1, "steer": 0.3, "mode": Mode.ROUTE_FOLLOW, "lights": Lights.SIREN}
    command = stacked(*(command_of(3, i, **asked) for i in ROWS))
    orders = merge_commands(traffic_of(3, ROWS), [command])._replace(hand_brake=np.ones(3, bool))
    present = np.array([0.01, -0.02, 0.03])
    ids = np.array([2, 5, 9], np.uint32)
    stopped = stopped_orders(orders, ids, (5, 77), present)
    assert stopped.owner.tolist() == [Owner.ROS] * 3
    assert stopped.throttle.tolist() == [0.4, 0.0, 0.4]
    assert stopped.brake.tolist() == [0.1, 1.0, 0.1]
    assert stopped.steer_rad.tolist() == [0.3, -0.02, 0.3]
    assert stopped.hand_brake.tolist() == [True, False, True]
    assert stopped.mode.tolist() == [Mode.ROUTE_FOLLOW, Mode.STOPPED, Mode.ROUTE_FOLLOW]
    hazard = Lights.INDICATOR_LEFT | Lights.INDICATOR_RIGHT
    assert stopped.lights.tolist() == [Lights.SIREN, Lights.SIREN | hazard, Lights.SIREN]
    assert stopped_orders(orders, ids, (), present) is orders
    assert stopped_orders(orders, ids, (77,), present) is orders
    taken = stopped_orders(merge_commands(traffic_of(3, ROWS), []), ids, (9,), present)
    assert taken.owner.tolist() == [Owner.SUMO, Owner.SUMO, Owner.ROS]


PARAMETERS = load_vehicle_parameters()
HEAVY = (ActorClass.BUS, ActorClass.TRUCK, ActorClass.FIRE_TRUCK)


def followed(kind: ActorClass, x_m: Floats, y_m: Floats, yaw_rad: Floats, speed_mps: Floats) -> Floats:
    """``BodyState.columns`` of a vehicle that follows SUMO's poses from the second on, shape ``(11, steps - 1)``."""
    accel_mps2 = np.diff(speed_mps, prepend=speed_mps[0]) / STEP_S
    poses = np.stack((x_m, y_m, yaw_rad, speed_mps, accel_mps2), axis=-1)[:, :, None]
    table = ParameterTable.of([kind], PARAMETERS)
    body, tracker = BodyState.moving(*poses[0, :4]), TrackerState.at(*poses[0, :3])
    bodies = []
    for pose in poses[1:]:
        controls, tracker = track(body, tracker, Reference(*pose), table, STEP_S)
        body = step_bodies(body, controls, table, STEP_S)
        bodies.append(body.columns[:, 0])
    return np.array(bodies).T


def way_at(speed_mps: Floats) -> Floats:
    """Way under SUMO's Euler integration."""
    return np.concatenate(([0.0], np.cumsum(speed_mps[1:] * STEP_S)))


@pytest.mark.parametrize("kind", VEHICLE_CLASSES)
def test_emergency_stop_does_not_reach_the_leader(kind: ActorClass) -> None:
    speed = np.maximum(13.9 - 4.5 * STEP_S * np.arange(161), 0.0)
    way, none = way_at(speed), np.zeros(len(speed))
    bodies = followed(kind, way, none, none, speed)
    ahead = bodies[X] - way[1:]
    assert ahead.max() < 0.6
    assert abs(ahead[-1]) < 0.6
    # at rest: neither creeping nor the pedal released
    assert np.all(bodies[FORWARD, -20:] == 0.0)
    assert np.ptp(bodies[X, -20:]) == 0.0
    assert bodies[BRAKE, -1] > 0.02


@pytest.mark.parametrize("speed_mps", [6.0, 25.0])
@pytest.mark.parametrize("kind", [ActorClass.SEDAN, *HEAVY])
def test_lane_change_without_yaw(kind: ActorClass, speed_mps: float) -> None:
    speed = np.full(300, speed_mps)
    way, left = way_at(speed), np.interp(np.arange(300) * STEP_S, [2.0, 6.0], [0.0, 3.5])
    bodies = followed(kind, way, left, np.zeros(300), speed)
    apart = np.hypot(bodies[X] - way[1:], bodies[Y] - left[1:])
    assert apart.max() < 0.5
    assert apart[-20:].max() < 0.1
    assert bodies[Y].max() < 3.5 + 0.35


def test_sideways_slide_at_standstill_moves_nothing() -> None:
    """SUMO may shift standing vehicles sideways; a car cannot follow, and must not drive off either."""
    none = np.zeros(60)
    assert np.abs(followed(ActorClass.SEDAN, none, np.linspace(0.0, 0.8, 60), none, none)[X]).max() < 0.3


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


def resistance(speed):
    return 0.5 * 1.225 * VEHICLE.drag_area_m2 / VEHICLE.mass_kg * speed**2 + VEHICLE.rolling_resistance * GRAVITY_MPS2


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


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_in_a_turn_nobody_is_faster_than_the_grip_allows(side):
    """Out of town wheels may be turned as far as all of the grip allows; SUMO's vehicle is faster."""
    speed = 15.0
    at_grip = side * np.arctan(VEHICLE.wheelbase_m * steering_grip(speed) / speed**2)
    controls, _ = tracked(right=side * 9.0, speed=speed, sumo=18.0, steer_rad=row(at_grip))
    drive = min(VEHICLE.max_drive_accel_mps2, VEHICLE.drive_power_w / (VEHICLE.mass_kg * speed))
    expected = led(resistance(speed) / (GAINS.drive_factor * drive), 0.0, VEHICLE.throttle_lag_s)
    assert controls.throttle[0] == pytest.approx(expected, abs=1e-6)


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


ACCELS = "accel", "last_accel"
LAWS = {
    "far behind": {"behind": 50.0, "speed": 11.0},
    "far ahead": {"behind": -50.0, "speed": 5.0},
    "behind in a left bend": {"behind": 0.3, "right": 0.1, "turned": 0.05, "swerve": 0.03, "accel": 0.4},
    "ahead in a right bend": {"behind": -0.2, "right": -0.1, "turned": -0.04, "swerve": -0.03, "accel": -0.6},
    "slower than SUMO's": {"speed": 6.0, "sumo": 8.0, "throttle": row(0.3), "accel": 0.8, "pace": 0.95},
    "faster than SUMO's": {"speed": 9.0, "brake": row(0.2), "accel": -1.0, "pace": 0.92, "last_accel": -0.5},
    "grip limits the wheels": {"speed": 14.0, "sumo": 14.0, "right": 2.0, "swerve": 0.05},
    "grip limits the wheels to the right": {"speed": 14.0, "sumo": 14.0, "right": -2.0, "swerve": -0.05},
    "creeps": {"speed": 0.3, "sumo": 0.4, "right": 0.05, "swerve": 0.05, "pace": 1.05, "last_accel": 0.3},
    "comes to a stop": {"speed": 0.4, "sumo": 0.02, "behind": -0.02, "brake": row(0.5)} | dict.fromkeys(ACCELS, -2.0),
    "on the brake, and SUMO's goes": {"speed": 5.0, "sumo": 6.5, "brake": row(0.4), "throttle": row(0.1), "accel": 1.0},
}


@pytest.mark.parametrize("turn", [*TURNS[1:3], 3.1, -3.1])
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


ONE = np.array([True])


def walked(targets: list[tuple[float, float, float, float]], start: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Any:
    """Columns of the body after each of SUMO's poses: x, y, yaw, speed; shape ``(steps, 11)``."""
    body = np.zeros((11, 1))
    body[:3, 0] = start
    rows = []
    for target in targets:
        after = np.zeros_like(body)
        walk(body, np.array([target]).T.copy(), ONE, STEP_S, after)
        body = after
        rows.append(body[:, 0])
    return np.array(rows)


def straight(steps: int, speed_mps: float = 1.3) -> list[tuple[float, float, float, float]]:
    return [(speed_mps * STEP_S * (step + 1), 0.0, 0.0, speed_mps) for step in range(steps)]


def test_a_steady_walk_is_followed_without_lag() -> None:
    body = walked(straight(100))
    assert body[-1, 0] == pytest.approx(1.3 * STEP_S * 100, abs=0.02)
    assert body[-1, 3] == pytest.approx(1.3, abs=0.02)
    assert np.abs(body[:, 1]).max() == 0.0


@pytest.mark.parametrize("aside_m", [0.65, -1.0])
def test_a_jump_aside_becomes_steps(aside_m: float) -> None:
    """No step is longer than the pace with haste allows, and the place is reached within two seconds."""
    targets = [(x, aside_m if step > 20 else 0.0, yaw, v) for step, (x, _, yaw, v) in enumerate(straight(80))]
    body = walked(targets)
    moved = np.hypot(*np.diff(body[:, :2], axis=0).T)
    assert moved.max() <= (1.3 + 0.8) * STEP_S + 1e-9
    assert body[60, 1] == pytest.approx(aside_m, abs=0.05)
    accel = np.hypot(*np.diff(np.diff(body[:, :2], axis=0), axis=0).T) / STEP_S**2
    assert accel.max() <= 2.5 + 1e-6


def test_speed_and_turn_rate_are_those_of_the_motion() -> None:
    targets = [(np.sin(0.04 * k), 1.0 - np.cos(0.04 * k), 0.04 * k, 0.8) for k in range(1, 120)]
    body = walked(targets)
    velocity = np.diff(body[:, :2], axis=0) / STEP_S
    cos, sin = np.cos(body[1:, 2]), np.sin(body[1:, 2])
    np.testing.assert_allclose(body[1:, 3] * cos - body[1:, 4] * sin, velocity[:, 0], atol=1e-9)
    np.testing.assert_allclose(body[1:, 3] * sin + body[1:, 4] * cos, velocity[:, 1], atol=1e-9)
    turned = np.diff(np.unwrap(body[:, 2])) / STEP_S
    np.testing.assert_allclose(body[1:, 5], turned, atol=1e-9)
    assert np.abs(turned).max() <= 4.0 + 1e-9


def test_who_stands_turns_to_where_sumos_person_looks() -> None:
    body = walked([(0.0, 0.0, 2.0, 0.0)] * 20)
    assert body[-1, 2] == pytest.approx(2.0)
    assert np.abs(body[:, :2]).max() == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_looks_back_turns_the_short_way_round(side: float) -> None:
    body = walked([(0.0, 0.0, -3.0 * side, 0.0)] * 3, start=(0.0, 0.0, 3.0 * side))
    assert np.sign(body[0, 5]) == side
    assert body[-1, 2] == pytest.approx(-3.0 * side)


def test_a_bus_does_not_swing_behind_lanes_that_shift() -> None:
    """Lanes shift by 3.2 m on 8 m; SUMO has front and tail of the bus on them."""
    speed = np.full(267, 4.5)
    ends = way_at(speed) - np.array([[0.0], [PARAMETERS[ActorClass.BUS].length_m]])
    (front, tail), (left, right) = ends, 3.2 * (0.5 - 0.5 * np.cos(np.pi * np.clip(ends / 8.0, 0.0, 1.0)))
    x, y = 0.5 * (front + tail), 0.5 * (left + right)
    bodies = followed(ActorClass.BUS, x, y, np.arctan2(left - right, front - tail), speed)
    offsets_m = np.hypot(bodies[X] - x[1:], bodies[Y] - y[1:])
    assert offsets_m.max() < 1.2
    assert offsets_m[-100:].max() < 0.1
