"""References as SUMO gives them: a rigid rod whose bumpers both stay on the lane's polyline."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.dynamics.parameters import ParameterTable, VehicleParameters, load_vehicle_parameters
from siren_ros.simulation.dynamics.tracker import Reference, TrackerState, track
from siren_ros.simulation.dynamics.vehicle_model import BodyState, step_bodies
from siren_ros.simulation.world.actors import VEHICLE_CLASSES, ActorClass

REFERENCE_FIELDS = tuple(field.name for field in fields(Reference))
PARAMETERS = load_vehicle_parameters()
CARS = (ActorClass.HATCHBACK, ActorClass.SEDAN, ActorClass.SUV, ActorClass.VAN)
HEAVY = (ActorClass.BUS, ActorClass.TRUCK, ActorClass.FIRE_TRUCK)


@dataclass(frozen=True)
class Run:
    """Arrays of shape ``(steps,)``."""

    residual_m: Floats
    along_m: Floats
    """Distance of the simulated centre ahead of SUMO's, along SUMO's heading."""
    speed_mps: Floats
    x_m: Floats
    y_m: Floats
    steer_rad: Floats
    brake: Floats
    lateral_mps2: Floats


def _rod(
    line: Polyline, front_s_m: Floats, length_m: float, left_m: Floats | float = 0.0
) -> tuple[Floats, Floats, Floats]:
    front, back = line.at(front_s_m), line.at(front_s_m - length_m)
    centre = 0.5 * (front + back)
    yaw = np.arctan2(front[:, 1] - back[:, 1], front[:, 0] - back[:, 0])
    return centre[:, 0] - left_m * np.sin(yaw), centre[:, 1] + left_m * np.cos(yaw), yaw


def _follow(kind: ActorClass, pose: tuple[Floats, Floats, Floats], speed_mps: Floats) -> Run:
    table = ParameterTable.of([kind], PARAMETERS)
    reference = Reference(*pose, speed_mps, np.diff(speed_mps, prepend=speed_mps[0]) / STEP_S)

    def at(step: int) -> Reference:
        return Reference(*(getattr(reference, name)[[step]] for name in REFERENCE_FIELDS))

    first = at(0)
    body = BodyState.moving(first.x_m, first.y_m, first.yaw_rad, first.speed_mps)
    tracker = TrackerState.at(first.x_m, first.y_m, first.yaw_rad)
    rows = []
    for step in range(1, len(speed_mps)):
        goal = at(step)
        controls, tracker = track(body, tracker, goal, table, STEP_S)
        body = step_bodies(body, controls, table, STEP_S)
        dx, dy = body.x_m - goal.x_m, body.y_m - goal.y_m
        along = dx * np.cos(goal.yaw_rad) + dy * np.sin(goal.yaw_rad)
        driven = body.forward_mps, body.x_m, body.y_m, body.steer_rad, body.brake, body.lateral_accel_mps2
        rows.append((np.hypot(dx, dy), along, *driven))
    return Run(*np.array(rows)[:, :, 0].T)


def _straight() -> Polyline:
    return Polyline.through([[-50.0, 0.0], [1000.0, 0.0]])


def _speeds(*legs: tuple[float, float], start_mps: float = 0.0) -> Floats:
    """Speeds step by step from legs of (acceleration in m/s², duration in s)."""
    speed, out = start_mps, [start_mps]
    for accel, duration in legs:
        for _ in range(round(duration / STEP_S)):
            speed = max(speed + accel * STEP_S, 0.0)
            out.append(speed)
    return np.array(out)


def _way(speed_mps: Floats) -> Floats:
    """Front bumper's way under SUMO's Euler integration."""
    return np.concatenate(([0.0], np.cumsum(speed_mps[1:] * STEP_S)))


def _arc_turn(radius_m: float, segments: int, approach_m: float = 30.0) -> Polyline:
    angle = np.linspace(0.0, -np.pi / 2.0, segments + 1)
    arc = np.stack((approach_m - radius_m * np.sin(angle), radius_m * (np.cos(angle) - 1.0)), axis=1)
    start, end = [[-50.0, 0.0]], [[approach_m + radius_m, -radius_m - 60.0]]
    return Polyline.through(np.concatenate((start, arc, end)))


@pytest.mark.parametrize("kind", CARS)
def test_straight_start_cruise_brake(kind: ActorClass) -> None:
    speed = _speeds((2.0, 6.0), (0.0, 3.0), (-3.0, 5.0), (0.0, 3.0))
    run = _follow(kind, _rod(_straight(), _way(speed), PARAMETERS[kind].length_m), speed)
    assert np.percentile(run.residual_m, 99) < 0.3
    assert abs(run.along_m[-1]) < 0.1


@pytest.mark.parametrize("kind", HEAVY)
def test_heavy_vehicles_keep_up(kind: ActorClass) -> None:
    speed = _speeds((1.1, 10.0), (0.0, 3.0), (-2.4, 6.0), (0.0, 3.0))
    run = _follow(kind, _rod(_straight(), _way(speed), PARAMETERS[kind].length_m), speed)
    assert np.percentile(run.residual_m, 99) < 0.5
    assert abs(run.along_m[-1]) < 0.15


@pytest.mark.parametrize("kind", VEHICLE_CLASSES)
def test_emergency_stop_does_not_reach_the_leader(kind: ActorClass) -> None:
    speed = _speeds((-4.5, 4.0), (0.0, 4.0), start_mps=13.9)
    run = _follow(kind, _rod(_straight(), _way(speed), PARAMETERS[kind].length_m), speed)
    assert run.along_m.max() < 0.6
    assert abs(run.along_m[-1]) < 0.6
    # at rest: neither creeping nor the pedal released
    assert np.all(run.speed_mps[-20:] == 0.0)
    assert np.ptp(run.x_m[-20:]) == 0.0
    assert run.brake[-1] > 0.02


def test_stop_and_go_ends_where_sumo_ends() -> None:
    legs = [(1.5, 2.0), (-2.5, 2.0), (0.0, 2.0)] * 6
    speed = _speeds(*legs)
    run = _follow(ActorClass.SEDAN, _rod(_straight(), _way(speed), PARAMETERS[ActorClass.SEDAN].length_m), speed)
    assert run.residual_m.max() < 0.35
    assert abs(run.along_m[-1]) < 0.1
    assert np.all(np.diff(run.x_m) >= 0.0)


@pytest.mark.parametrize("kind", [*CARS, ActorClass.AMBULANCE])
def test_tight_right_turn_on_a_coarse_polyline(kind: ActorClass) -> None:
    speed = np.full(240, 5.0)
    run = _follow(kind, _rod(_arc_turn(6.0, 5), _way(speed), PARAMETERS[kind].length_m), speed)
    assert np.percentile(run.residual_m, 99) < 0.5
    assert run.residual_m[-20:].max() < 0.1
    assert np.abs(run.steer_rad).max() <= PARAMETERS[kind].max_steer_rad + 1e-9


@pytest.mark.parametrize("kind", HEAVY)
def test_heavy_vehicles_recover_from_a_turn_too_tight_for_them(kind: ActorClass) -> None:
    speed = np.full(400, 3.5)
    run = _follow(kind, _rod(_arc_turn(6.0, 5), _way(speed), PARAMETERS[kind].length_m), speed)
    assert run.residual_m.max() < 2.5
    assert run.residual_m[-20:].max() < 0.2


@pytest.mark.parametrize("kind", CARS)
@pytest.mark.parametrize(("speed_mps", "turn_deg"), [(4.0, 30.0), (6.0, 20.0)])
def test_a_corner_of_a_lane_takes_no_more_than_half_of_the_grip(
    kind: ActorClass, speed_mps: float, turn_deg: float
) -> None:
    """Lanes of maps have such corners where two roads join; SUMO turns there at once."""
    ahead = 60.0 * np.array([np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))])
    line = Polyline.through([[-50.0, 0.0], [30.0, 0.0], [30.0 + ahead[0], ahead[1]]])
    speed = np.full(500, speed_mps)
    run = _follow(kind, _rod(line, _way(speed), PARAMETERS[kind].length_m), speed)
    assert np.abs(run.lateral_mps2).max() < 5.0
    assert run.residual_m.max() < 0.5


@pytest.mark.parametrize("speed_mps", [6.0, 14.0, 25.0])
@pytest.mark.parametrize("kind", [*CARS, *HEAVY])
def test_lane_change_without_yaw(kind: ActorClass, speed_mps: float) -> None:
    speed = np.full(300, speed_mps)
    left = np.interp(np.arange(300) * STEP_S, [2.0, 6.0], [0.0, 3.5])
    run = _follow(kind, _rod(_straight(), _way(speed), PARAMETERS[kind].length_m, left), speed)
    assert run.residual_m.max() < 0.5
    assert run.residual_m[-20:].max() < 0.1
    assert run.y_m.max() < 3.5 + 0.35


def test_a_gap_along_the_path_closes_without_overshoot() -> None:
    kind = ActorClass.SEDAN
    table = ParameterTable.of([kind], PARAMETERS)
    body = BodyState.moving(np.zeros(1), np.zeros(1), np.zeros(1), np.full(1, 8.0))
    tracker = TrackerState.at(np.full(1, 2.0), np.zeros(1), np.zeros(1))
    gaps = []
    for step in range(1, 120):
        x = np.full(1, 2.0 + 0.4 * step)
        reference = Reference(x, np.zeros(1), np.zeros(1), np.full(1, 8.0), np.zeros(1))
        controls, tracker = track(body, tracker, reference, table, STEP_S)
        body = step_bodies(body, controls, table, STEP_S)
        gaps.append(float(x[0] - body.x_m[0]))
    assert min(gaps) > -0.15
    assert abs(gaps[-1]) < 0.05


def test_sideways_slide_at_standstill_moves_nothing() -> None:
    """SUMO may shift standing vehicles sideways; a car cannot follow, and must not drive off either."""
    steps = 60
    pose = (np.zeros(steps), np.linspace(0.0, 0.8, steps), np.zeros(steps))
    run = _follow(ActorClass.SEDAN, pose, np.zeros(steps))
    assert np.abs(run.x_m).max() < 0.3


@settings(max_examples=25, deadline=None)
@given(
    jump_m=st.floats(-3.0, 3.0),
    turn_rad=st.floats(-1.5, 1.5),
    speed_mps=st.floats(0.0, 15.0),
    kind=st.sampled_from(VEHICLE_CLASSES),
)
def test_any_reference_gives_usable_controls(
    jump_m: float, turn_rad: float, speed_mps: float, kind: ActorClass
) -> None:
    table = ParameterTable.of([kind], PARAMETERS)
    body = BodyState.moving(np.zeros(1), np.zeros(1), np.zeros(1), np.full(1, speed_mps))
    tracker = TrackerState.at(np.zeros(1), np.zeros(1), np.zeros(1))
    for step in range(1, 40):
        reach = jump_m + speed_mps * STEP_S * step
        pose = reach * np.cos(turn_rad), reach * np.sin(turn_rad), turn_rad
        reference = Reference(*(np.full(1, value) for value in (*pose, speed_mps, 0.0)))
        controls, tracker = track(body, tracker, reference, table, STEP_S)
        assert 0.0 <= controls.throttle[0] <= 1.0
        assert 0.0 <= controls.brake[0] <= 1.0
        assert np.isfinite(controls.steer_rad[0])
        following = step_bodies(body, controls, table, STEP_S)
        vx, vy = body.velocity_mps(table)
        moved = np.hypot(following.x_m - body.x_m, following.y_m - body.y_m)
        assert moved[0] <= np.hypot(vx, vy)[0] * STEP_S + 0.05
        body = following


def test_tracker_rows_can_be_selected_joined_and_mixed(parameters: Mapping[ActorClass, VehicleParameters]) -> None:
    assert set(parameters) == set(PARAMETERS)
    state = TrackerState.at(np.arange(3.0), np.zeros(3), np.zeros(3))
    other = replace(state, x_m=state.x_m + 10.0)
    picked = TrackerState.joined((state.select(np.array([2])), other.select(np.array([0]))))
    assert picked.x_m.tolist() == [2.0, 10.0]
    mixed = TrackerState.where(np.array([True, False, True]), state, other)
    assert mixed.x_m.tolist() == [0.0, 11.0, 2.0]
