"""Closed loops of the navigator with the vehicle model."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.free_space import SpeedLimit
from siren_ros.behaviour.driving.navigator import NavigatorState, Situation, navigate
from siren_ros.behaviour.driving.surroundings import Surroundings
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.dynamics.parameters import ParameterTable
from siren_ros.dynamics.vehicle_model import BodyState, Controls, step_bodies
from siren_ros.world.actors import ActorClass

CONFIG = NavigatorConfig()
CLASSES = [ActorClass.AMBULANCE, ActorClass.SEDAN, ActorClass.FIRE_TRUCK, ActorClass.POLICE]


def seen_of(body: BodyState, table: ParameterTable) -> Surroundings:
    n = len(body)
    return Surroundings(
        actor_id=np.arange(1, n + 1, dtype=np.uint32),
        x_m=body.x_m,
        y_m=body.y_m,
        yaw_rad=body.yaw_rad,
        cos=np.cos(body.yaw_rad),
        sin=np.sin(body.yaw_rad),
        speed_mps=np.hypot(body.forward_mps, body.lateral_mps),
        half_length_m=table.length_m / 2.0,
        half_width_m=table.width_m / 2.0,
        is_emv=np.zeros(n, dtype=bool),
    )


def drive(lab, kind, points, speed, target, seconds, start=(0.0, 0.0, 0.0), others=(), stop=True):
    """Rows of (x, y, yaw, speed, offset, progress); others are (x, y, yaw, speed) of sedans that keep going."""
    curve = Curve.through(np.asarray(points, dtype=float), 1.5)
    table = ParameterTable.of([kind, *[ActorClass.SEDAN] * len(others)], lab.vehicles)
    first = np.array([(*start, speed), *others], dtype=float)
    body = BodyState.moving(*(first[:, i].copy() for i in range(4)))
    state = NavigatorState().following(TrackedPath.of(curve, CONFIG, stop_at_end=stop), *start[:2])
    rows, snapshots = [], []
    for _ in range(round(seconds / 0.05)):
        state, command, snapshot = navigate(
            state, Situation(seen_of(body, table), 0, lab.vehicles[kind], target), CONFIG
        )
        n = len(body)
        own = np.arange(n) == 0
        controls = Controls(
            np.where(own, command.throttle, 0.0),
            np.where(own, command.brake, 0.0),
            np.where(own, command.steer_rad, 0.0),
            np.zeros(n, bool),
            np.ones(n),
            np.ones(n),
        )
        moved = step_bodies(body, controls, table, 0.05)
        moved.forward_mps[1:] = first[1:, 3]
        body = moved
        rows.append((body.x_m[0], body.y_m[0], body.yaw_rad[0], body.forward_mps[0], state.left_m, state.progress_m))
        snapshots.append(snapshot)
    return np.array(rows), snapshots


@pytest.mark.parametrize("kind", CLASSES)
def test_reaches_and_keeps_50_kmh_and_stops_at_the_end(lab, kind):
    rows, _ = drive(lab, kind, [[0, 0], [250, 0]], 0.0, 13.89, 30.0)
    assert rows[:, 3].max() == pytest.approx(13.89, abs=0.3)
    assert rows[-1, 3] < 0.05
    assert rows[-1, 0] == pytest.approx(250.0, abs=2.0)
    assert np.ptp(rows[-20:, 0]) < 0.02


@pytest.mark.parametrize("kind", CLASSES)
def test_lane_change_at_50_kmh_within_a_third_of_a_metre(lab, kind):
    x = np.linspace(0.0, 250.0, 500)
    u = np.clip((x - 40.0) / 35.0, 0.0, 1.0)
    points = np.stack((x, 3.4 * u**3 * (10 - 15 * u + 6 * u * u)), axis=-1)
    rows, _ = drive(lab, kind, points, 13.89, 13.89, 9.0)
    assert np.abs(rows[:, 4]).max() < 0.3
    assert np.abs(rows[-30:, 4]).max() < 0.03


@pytest.mark.parametrize(("kind", "radius"), [(kind, r) for kind in CLASSES[:2] for r in (8.0, 12.0)])
def test_right_turn_within_half_a_metre_at_limited_lateral_acceleration(lab, kind, radius):
    a = np.linspace(0.0, np.pi / 2.0, 10)
    arc = np.stack((60.0 + radius * np.sin(a), -radius * (1.0 - np.cos(a))), axis=-1)
    points = np.concatenate(([[0, 0]], arc, [[60.0 + radius, -radius - 60.0]]))
    rows, _ = drive(lab, kind, points, 12.0, 13.89, 18.0)
    assert np.abs(rows[:, 4]).max() < 0.5
    turning = np.abs(np.diff(np.unwrap(rows[:, 2]))) / 0.05 * rows[1:, 3]
    assert turning.max() < 3.6
    assert rows[-1, 2] == pytest.approx(-np.pi / 2.0, abs=0.02)


def test_initial_offset_decays_without_overshoot(lab):
    rows, _ = drive(lab, ActorClass.AMBULANCE, [[0, 0], [200, 0]], 10.0, 10.0, 10.0, start=(0.0, 0.6, 0.0))
    assert rows[:, 4].min() > -0.06
    assert abs(rows[-1, 4]) < 0.02


def test_stops_behind_a_standing_vehicle_and_reports_it(lab):
    rows, snapshots = drive(
        lab, ActorClass.AMBULANCE, [[0, 0], [250, 0]], 13.89, 13.89, 14.0, others=[(100.0, 0.0, 0.0, 0.0)]
    )
    gap = 100.0 - 4.75 / 2.0 - (rows[-1, 0] + 6.5 / 2.0)
    assert rows[-1, 3] < 0.05
    assert CONFIG.standstill_gap_m - 0.6 < gap < CONFIG.standstill_gap_m + 1.5
    assert snapshots[-1] is not None
    assert snapshots[-1].actor_id == 2
    decel = -np.diff(rows[:, 3]) / 0.05
    assert decel.max() < 4.5


def test_follows_a_slower_vehicle_at_its_speed(lab):
    rows, _ = drive(
        lab, ActorClass.AMBULANCE, [[0, 0], [400, 0]], 13.89, 13.89, 20.0, others=[(60.0, 0.0, 0.0, 6.0)], stop=False
    )
    assert rows[-1, 3] == pytest.approx(6.0, abs=0.3)


def test_ignores_vehicles_in_the_next_lane_and_behind(lab):
    others = [(60.0, 3.3, 0.0, 0.0), (-12.0, 0.0, 0.0, 13.0), (80.0, -3.3, np.pi, 0.0)]
    rows, snapshots = drive(lab, ActorClass.AMBULANCE, [[0, 0], [250, 0]], 13.0, 13.0, 8.0, others=others, stop=False)
    assert all(snapshot is None for snapshot in snapshots)
    assert rows[-1, 3] == pytest.approx(13.0, abs=0.2)


def test_lets_a_crossing_vehicle_pass(lab):
    others = [(60.0, -36.0, np.pi / 2.0, 8.0)]
    rows, snapshots = drive(lab, ActorClass.AMBULANCE, [[0, 0], [250, 0]], 13.0, 13.89, 10.0, others=others, stop=False)
    assert any(snapshot is not None for snapshot in snapshots)
    t = np.arange(1, len(rows) + 1) * 0.05
    dx = np.abs(rows[:, 0] - 60.0)
    dy = np.abs(-36.0 + 8.0 * t)
    assert not np.any((dx < 3.25 + 0.92) & (dy < 1.05 + 2.38))
    assert rows[-1, 3] > 10.0


def test_a_crossing_vehicle_that_has_passed_is_no_reason_to_brake(lab):
    others = [(60.0, -20.0, np.pi / 2.0, 10.0)]
    rows, _ = drive(lab, ActorClass.AMBULANCE, [[0, 0], [250, 0]], 13.0, 13.0, 4.0, others=others, stop=False)
    assert rows[:, 3].min() > 12.5


def test_without_watch_nobody_is_seen(lab):
    table = ParameterTable.of([ActorClass.AMBULANCE, ActorClass.SEDAN], lab.vehicles)
    body = BodyState.moving(np.array([0.0, 10.0]), np.zeros(2), np.zeros(2), np.array([5.0, 0.0]))
    path = TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [100.0, 0.0]])), CONFIG)
    state = NavigatorState().following(path, 0.0, 0.0)
    vehicle = lab.vehicles[ActorClass.AMBULANCE]
    situation = Situation(seen_of(body, table), 0, vehicle, 5.0, watch=False)
    _, command, snapshot = navigate(state, situation, CONFIG)
    assert snapshot is None
    assert command.brake == 0.0
    _, command, snapshot = navigate(state, Situation(seen_of(body, table), 0, vehicle, 5.0), CONFIG)
    assert snapshot is not None
    assert command.brake > 0.1


def test_without_a_path_it_brakes_to_a_stop(lab):
    table = ParameterTable.of([ActorClass.SEDAN], lab.vehicles)
    body = BodyState.moving(np.zeros(1), np.zeros(1), np.zeros(1), np.array([5.0]))
    situation = Situation(seen_of(body, table), 0, lab.vehicles[ActorClass.SEDAN], 10.0)
    state, command, threat = navigate(NavigatorState(integral_mps2=2.0), situation, CONFIG)
    assert (command.throttle, command.steer_rad, command.hand_brake) == (0.0, 0.0, False)
    assert command.brake > 0.35
    assert threat is None
    assert state.done
    assert state.integral_mps2 == 0.0


def test_a_limit_counts_besides_target_and_path(lab):
    vehicle = lab.vehicles[ActorClass.SEDAN]
    table = ParameterTable.of([ActorClass.SEDAN], lab.vehicles)
    body = BodyState.moving(*(np.array([value]) for value in (0.0, 0.0, 0.0, 6.0)))
    path = TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [80.0, 0.0]])), CONFIG)
    state = NavigatorState().following(path, 0.0, 0.0)

    def command(limit):
        return navigate(state, Situation(seen_of(body, table), 0, vehicle, 10.0, limit=limit), CONFIG)[1]

    assert command(SpeedLimit()).throttle > 0.0
    assert command(SpeedLimit(6.0)).throttle < command(SpeedLimit(8.0)).throttle
    assert command(SpeedLimit(2.0)).brake > 0.0
    hard = command(SpeedLimit(5.0, brake_mps2=7.0)).brake
    assert hard * vehicle.max_brake_decel_mps2 == pytest.approx(7.0, abs=0.3)


def test_leaders_can_be_left_to_the_limit(lab):
    table = ParameterTable.of([ActorClass.AMBULANCE, ActorClass.SEDAN], lab.vehicles)
    start = np.array([[0.0, 0.0, 0.0, 10.0], [15.0, 0.0, 0.0, 0.0]])
    body = BodyState.moving(*(start[:, i].copy() for i in range(4)))
    path = TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [200.0, 0.0]])), CONFIG)
    state = NavigatorState().following(path, 0.0, 0.0)
    situation = Situation(seen_of(body, table), 0, lab.vehicles[ActorClass.AMBULANCE], 10.0)
    _, watching, snapshot = navigate(state, situation, CONFIG)
    _, leaving, nobody = navigate(state, replace(situation, watch_leaders=False), CONFIG)
    assert snapshot.actor_id == 2
    assert watching.brake > 0.5
    assert nobody is None
    assert leaving.brake == 0.0


def test_without_a_path_nothing_is_left_of_it_and_it_is_done():
    assert NavigatorState().remaining_m == 0.0
    assert NavigatorState().done
