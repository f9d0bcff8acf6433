"""Who drives an actor: taken over, handed back, brought back in SUMO, without a jump."""

from dataclasses import replace

import numpy as np
import pytest
from dynamics.fleet_scenes import PARAMETERS, begun, command_of, description, kinds, started, traffic_of

from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.dynamics.fleet import FleetState, step_fleet
from siren_ros.simulation.world.actors import Lights, Mode, Owner
from siren_ros.simulation.world.traffic_state import Event, EventKind


def test_an_actor_may_belong_to_ros_from_its_first_step() -> None:
    traffic = traffic_of(0, {1: (0.0, 0.0, 0.0, 5.0)}, [description(1)])
    _, states, events = step_fleet(FleetState.empty(PARAMETERS), traffic, [command_of(0, 1, throttle=1.0)])
    assert (states.owner[0], states.x_m[0]) == (Owner.ROS, 0.0)
    assert kinds(events) == [EventKind.SPAWNED, EventKind.OWNER_CHANGED]


def test_a_command_of_owner_sumo_only_shows() -> None:
    state, _ = started()
    command = command_of(1, 1, Owner.SUMO, throttle=1.0, steer=0.5, mode=Mode.YIELD_REACTING, lights=Lights.BEACON)
    _, shown, events = step_fleet(state, traffic_of(1, {1: (0.5, 50.0, 0.0, 10.0)}), [command])
    _, left, _ = step_fleet(state, traffic_of(1, {1: (0.5, 50.0, 0.0, 10.0)}), ())
    assert events == ()
    assert (shown.mode[0], shown.lights[0], shown.owner[0]) == (Mode.YIELD_REACTING, Lights.BEACON, Owner.SUMO)
    assert shown.x_m[0] == left.x_m[0]


@pytest.mark.parametrize("mirror_delay", [0, 1])
def test_taking_over_and_handing_back_makes_no_jump(mirror_delay: int) -> None:
    """SUMO's pose of a ROS-owned actor is the mirror of the step before; from the release on SUMO drives on."""
    state, states = started(1, 10.0)
    history = [states]
    sumo = np.array([0.0, 50.0, 0.0, 10.0])
    changes = []
    for step in range(1, 200):
        ours = 40 <= step < 100
        last = history[-1]
        if 40 < step <= 100 + mirror_delay:
            sumo = np.array([last.x_m[0], last.y_m[0], last.yaw_rad[0], last.speed_mps[0]])
        else:
            sumo[3] = max(sumo[3] - 2.0 * STEP_S, 10.0)
            sumo[:2] += sumo[3] * STEP_S * np.array([np.cos(sumo[2]), np.sin(sumo[2])])
            sumo[2] *= 0.95
        x, y, yaw, speed = sumo.tolist()
        commands = [command_of(step, 1, throttle=0.35, steer=0.004)] if ours else []
        state, states, events = step_fleet(state, traffic_of(step, {1: (x, y, yaw, speed)}), commands)
        changes += [(step, event.detail["owner"]) for event in events if event.kind is EventKind.OWNER_CHANGED]
        history.append(states)
    assert changes == [(40, "ROS"), (100, "SUMO")]
    columns = [(item.x_m[0], item.y_m[0], item.yaw_rad[0], item.speed_mps[0]) for item in history]
    way_x, way_y, yaw_rad, speeds = np.array(columns).T
    np.testing.assert_allclose(np.hypot(np.diff(way_x), np.diff(way_y)), speeds[1:] * STEP_S, atol=0.02)
    assert np.abs(np.diff(speeds)).max() < 10.0 * STEP_S
    assert np.abs(np.diff(yaw_rad)).max() < 0.05
    assert max(item.residual_m[0] for item in history) < 1.0
    assert history[-1].residual_m[0] < 0.1


def test_a_released_actor_rolls_on_at_the_step_of_release() -> None:
    state, states = started(1, 10.0)
    state, states, _ = step_fleet(state, traffic_of(1, {1: (0.5, 50.0, 0.0, 10.0)}), [command_of(1, 1, throttle=0.1)])
    before = states
    mirror = (float(states.x_m[0]), 50.0, 0.0, float(states.speed_mps[0]))
    _, states, _ = step_fleet(state, traffic_of(2, {1: mirror}), [command_of(2, 1, Owner.SUMO, mode=Mode.REJOIN)])
    assert (states.owner[0], states.mode[0]) == (Owner.SUMO, Mode.REJOIN)
    assert states.x_m[0] - before.x_m[0] == pytest.approx(before.speed_mps[0] * STEP_S, abs=0.01)
    assert states.residual_m[0] == 0.0


def test_a_vehicle_brought_back_in_sumo_makes_no_jump() -> None:
    fleet, _ = begun((0.0, 0.0, 0.0, 8.0))
    positions, x = [0.0], 0.0
    for step in range(1, 60):
        x += 8.0 * STEP_S
        events: tuple[Event, ...] = ()
        if step == 20:  # SUMO's vehicle was 3 m ahead for a moment and is brought back
            events = (Event(step, EventKind.REALIGNED, 1),)
            x = positions[-1] + 8.0 * STEP_S
        ahead_m = 3.0 if step == 19 else 0.0
        fleet, states, _ = step_fleet(fleet, traffic_of(step, {1: (x + ahead_m, 0.0, 0.0, 8.0)}, events=events), [])
        positions.append(float(states.x_m[0]))
    steps_m = np.diff(positions)
    assert np.abs(steps_m - 8.0 * STEP_S).max() < 0.05
    assert positions[-1] == pytest.approx(x, abs=0.3)


@pytest.mark.parametrize("yaw", np.radians([0.0, 50.0, 140.0, -100.0]))
def test_a_released_actor_rolls_on_whichever_way_it_points(yaw: float) -> None:
    """SUMO's pose is still the mirror of the step before; without a correction the actor would brake for it."""
    way = np.array([np.cos(yaw), np.sin(yaw)])
    state, _ = begun((*(5.0 * way), yaw, 10.0))
    state, before, _ = step_fleet(
        state, traffic_of(1, {1: (*(5.5 * way), yaw, 10.0)}), [command_of(1, 1, throttle=0.2)]
    )
    mirror = (float(before.x_m[0]), float(before.y_m[0]), yaw, float(before.speed_mps[0]))
    _, after, _ = step_fleet(state, traffic_of(2, {1: mirror}), [command_of(2, 1, Owner.SUMO)])
    moved = np.array([after.x_m[0] - before.x_m[0], after.y_m[0] - before.y_m[0]])
    assert moved @ way == pytest.approx(before.speed_mps[0] * STEP_S, abs=0.005)
    assert after.speed_mps[0] == pytest.approx(before.speed_mps[0], abs=0.05)
    assert abs(after.steer_rad[0]) < 1e-3


@pytest.mark.parametrize("yaw", np.radians([0.0, 50.0, 140.0, -100.0]))
@pytest.mark.parametrize(("ahead", "left"), [(0.4, 0.3), (-0.5, -0.2)])
def test_the_residual_is_the_distance_between_both_poses(yaw: float, ahead: float, left: float) -> None:
    state, _ = begun((0.0, 0.0, yaw, 0.0))
    x, y = ahead * np.cos(yaw) - left * np.sin(yaw), ahead * np.sin(yaw) + left * np.cos(yaw)
    _, states, _ = step_fleet(state, traffic_of(1, {1: (x, y, yaw, 0.0)}), ())
    assert states.residual_m[0] == pytest.approx(np.hypot(x - states.x_m[0], y - states.y_m[0]))
    assert states.residual_m[0] == pytest.approx(np.hypot(ahead, left), abs=0.05)


@pytest.mark.parametrize("accel", [-6.0, 4.0])
def test_at_the_step_of_release_sumos_acceleration_is_not_taken(accel: float) -> None:
    """SUMO's acceleration of that step is still that of the mirror."""
    state, _ = started(1, 10.0)
    state, _, _ = step_fleet(state, traffic_of(1, {1: (0.5, 50.0, 0.0, 10.0)}), [command_of(1, 1, throttle=0.1)])
    traffic = traffic_of(2, {1: (1.0, 50.0, 0.0, 10.0)})
    _, plain, _ = step_fleet(state, traffic, ())
    _, other, _ = step_fleet(state, replace(traffic, sumo_accel_mps2=np.array([accel])), ())
    assert other.throttle[0] == plain.throttle[0]
    assert other.brake[0] == plain.brake[0]


def test_a_vehicle_brought_back_says_how_far_it_is_from_sumos_and_one_that_ros_drives_is_not_brought_back() -> None:
    fleet, _ = started(2, 8.0)
    rows = {1: (0.4, 51.0, 0.0, 8.0), 2: (0.4, 101.0, 0.0, 8.0)}
    events = (Event(1, EventKind.REALIGNED, 1), Event(1, EventKind.REALIGNED, 2))
    after, states, _ = step_fleet(fleet, traffic_of(1, rows, events=events), [command_of(1, 2)])
    assert states.residual_m == pytest.approx([1.0, 0.0], abs=0.02)
    assert after.tracker.y_m == pytest.approx([51.0, states.y_m[1]])
    assert states.y_m == pytest.approx([50.0, 100.0], abs=1e-6)
