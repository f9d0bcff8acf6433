"""Actors join, leave, are taken over and touch; everything that is known of the others stays theirs."""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest
from dynamics.fleet_scenes import PARAMETERS, begun, command_of, description, kinds, stacked, started, traffic_of

from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.simulation.dynamics.fleet import FleetState, step_fleet, with_spawned, without_actors
from siren_ros.simulation.roads.road_network import mirror_image
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    ActorClass,
    ActorDescription,
    Event,
    EventKind,
    Lights,
    Mode,
    Owner,
    TrafficState,
)
from siren_ros.simulation.world.commands import VehicleCommands

ROWS = {i: (10.0 * i, 50.0 * i, 0.1 * i, 3.0 * i) for i in (1, 2, 3, 4)}


def fleet_of_three():
    """Actors 1 to 3; each field of each row has its own value."""
    fleet, _ = started(3)
    columns = {
        name: np.arange(3.0) + 10.0 * place
        for place, name in enumerate((item.name for item in fields(fleet.bodies)), start=1)
    }
    tracked = {
        name: np.arange(3.0) + 200.0 * place
        for place, name in enumerate((item.name for item in fields(fleet.tracker)), start=1)
    }
    owner = np.array([Owner.SUMO, Owner.ROS, Owner.SUMO], np.uint8)
    return replace(
        fleet, bodies=replace(fleet.bodies, **columns), tracker=replace(fleet.tracker, **tracked), owner=owner
    )


def test_who_leaves_takes_its_row_alone():
    fleet = fleet_of_three()
    left = without_actors(fleet, np.array([1, 8], np.uint32))
    assert left.actor_id.tolist() == [2, 3]
    assert [item.actor_id for item in left.descriptions] == [2, 3]
    assert left.owner.tolist() == [Owner.ROS, Owner.SUMO]
    assert left.bodies.brake.tolist() == fleet.bodies.brake[1:].tolist()
    assert left.tracker.pace.tolist() == fleet.tracker.pace[1:].tolist()
    assert len(left.table) == len(left.length_m) == len(left.width_m) == 2
    assert without_actors(fleet, np.empty(0, np.uint32)) is fleet


def test_who_joins_starts_at_sumos_pose_with_its_speed_and_the_others_keep_theirs():
    fleet = without_actors(fleet_of_three(), np.array([2], np.uint32))
    bus = description(2, ActorClass.BUS)
    joined, fresh = with_spawned(fleet, traffic_of(1, {i: ROWS[i] for i in (1, 2, 3)}, [bus]))
    assert fresh.tolist() == [False, True, False]
    assert joined.actor_id.tolist() == [1, 2, 3]
    assert joined.owner.tolist() == [Owner.SUMO, Owner.SUMO, Owner.SUMO]
    assert (joined.length_m[1], joined.width_m[1]) == (bus.length_m, bus.width_m)
    assert joined.table.mass_kg[1] == PARAMETERS[ActorClass.BUS].mass_kg
    body, tracker = joined.bodies.select(np.array([1])), joined.tracker.select(np.array([1]))
    assert (body.x_m[0], body.y_m[0], body.yaw_rad[0], body.forward_mps[0]) == ROWS[2]
    assert not any(getattr(body, name)[0] for name in ("lateral_mps", "yaw_rate_radps", "steer_rad", "throttle"))
    assert (tracker.x_m[0], tracker.y_m[0], tracker.yaw_rad[0]) == ROWS[2][:3]
    assert (tracker.pace[0], tracker.accel_mps2[0]) == (1.0, 0.0)
    assert joined.bodies.steer_rad[[0, 2]].tolist() == fleet.bodies.steer_rad.tolist()
    assert joined.tracker.accel_mps2[[0, 2]].tolist() == fleet.tracker.accel_mps2.tolist()


def test_owners_follow_their_actors_as_others_join_before_and_after_them():
    fleet = without_actors(fleet_of_three(), np.array([1, 3], np.uint32))
    spawned = [description(4), description(1)]
    joined, fresh = with_spawned(fleet, traffic_of(1, {i: ROWS[i] for i in (1, 2, 4)}, spawned))
    assert joined.owner.tolist() == [Owner.SUMO, Owner.ROS, Owner.SUMO]
    assert fresh.tolist() == [True, False, True]
    assert joined.bodies.x_m.tolist() == [10.0, fleet.bodies.x_m[0], 40.0]
    assert [item.actor_id for item in joined.descriptions] == [1, 2, 4]


def test_without_arrivals_the_fleet_is_the_same_and_others_than_sumos_are_named():
    fleet = fleet_of_three()
    same, fresh = with_spawned(fleet, traffic_of(1, {i: ROWS[i] for i in (1, 2, 3)}))
    assert same is fleet
    assert not fresh.any()
    with pytest.raises(EpisodeError, match=r"not removed: \[3, 4\]"):
        with_spawned(fleet, traffic_of(1, {i: ROWS[i] for i in (1, 2, 4)}))


def test_spawned_actors_stand_at_sumos_pose() -> None:
    rows = {3: (5.0, -2.0, 0.7, 9.0), 8: (50.0, 60.0, -2.0, 0.0)}
    traffic = traffic_of(4, rows, [description(8, ActorClass.BUS), description(3)], lights={3: Lights.INDICATOR_LEFT})
    state, states, events = step_fleet(FleetState.empty(PARAMETERS), traffic, ())
    assert states.actor_id.tolist() == [3, 8]
    assert states.step == 4
    assert (states.x_m[0], states.y_m[0], states.yaw_rad[0]) == (5.0, -2.0, 0.7)
    assert (states.speed_mps[0], states.vx_mps[0]) == (pytest.approx(9.0), pytest.approx(9.0 * np.cos(0.7)))
    assert states.residual_m.tolist() == [0.0, 0.0]
    assert states.lights.tolist() == [Lights.INDICATOR_LEFT, Lights.NONE]
    assert [(event.kind, event.actor_id, event.x_m) for event in events] == [
        (EventKind.SPAWNED, 3, 5.0),
        (EventKind.SPAWNED, 8, 50.0),
    ]
    assert [item.actor_class for item in state.descriptions] == [ActorClass.SEDAN, ActorClass.BUS]


def test_commands_drive_and_are_shown() -> None:
    state, states = started(2, 5.0)
    for step in range(1, 41):
        rows = {1: (float(states.x_m[0]), 50.0, 0.0, float(states.speed_mps[0])), 2: (0.25 * step, 100.0, 0.0, 5.0)}
        command = command_of(step, 1, throttle=0.6, mode=Mode.COPY_SUMO, lights=Lights.SIREN | Lights.BEACON)
        state, states, events = step_fleet(state, traffic_of(step, rows, lights={1: Lights.INDICATOR_LEFT}), [command])
        assert kinds(events) == ([EventKind.OWNER_CHANGED, EventKind.SIREN_ON] if step == 1 else [])
    assert events == ()
    assert states.speed_mps[0] > 7.0
    assert states.owner.tolist() == [Owner.ROS, Owner.SUMO]
    assert states.mode.tolist() == [Mode.COPY_SUMO, Mode.NOMINAL]
    assert (states.lights[0], states.residual_m[0]) == (Lights.SIREN | Lights.BEACON, 0.0)
    assert states.residual_m[1] < 0.05


def test_reported_events_follow_by_source() -> None:
    state, _ = started(2)

    rows = {1: (0.5, 50.0, 0.0, 10.0), 2: (0.5, 100.0, 0.0, 10.0)}
    traffic = traffic_of(1, rows, events=(Event(1, EventKind.TELEPORT, 2),))
    commands = [
        command_of(1, 2, source="yield_manager", events=(Event(1, EventKind.YIELD_STARTED, 2),)),
        command_of(1, 1, source="emv_controller", events=(Event(1, EventKind.SIREN_ON, 1),)),
    ]
    _, forward, events = step_fleet(state, traffic, commands)
    _, backward, same = step_fleet(state, traffic, commands[::-1])
    reported = [EventKind.SIREN_ON, EventKind.YIELD_STARTED, EventKind.TELEPORT]
    assert kinds(events) == [EventKind.OWNER_CHANGED] * 2 + reported
    assert events == same
    np.testing.assert_array_equal(forward.x_m, backward.x_m)


def test_an_empty_fleet_steps() -> None:
    state = FleetState.empty(PARAMETERS)
    for step in range(3):
        state, states, events = step_fleet(state, traffic_of(step, {}), [VehicleCommands.empty(step, "emv_controller")])
        assert len(states) == 0
        assert events == ()


def test_contradictions_are_refused() -> None:
    state, _ = started(1)
    rows = {1: (0.5, 50.0, 0.0, 10.0)}
    for match, traffic, commands in (
        ("cannot follow", traffic_of(5, rows), ()),
        ("emv_controller are of step 7", traffic_of(1, rows), [command_of(7, 1)]),
        (r"\[9\]", traffic_of(1, rows | {9: (0.0, 0.0, 0.0, 0.0)}), ()),
        ("twice", traffic_of(1, rows), [stacked(command_of(1, 1), command_of(1, 1))]),
    ):
        with pytest.raises(EpisodeError, match=match):
            step_fleet(state, traffic, commands)


@pytest.mark.parametrize("gone", [[1], [3], [1, 3], [3, 1], [2, 8]])
def test_each_actor_that_leaves_is_told_at_its_last_place_wherever_its_row_was(gone: list[int]) -> None:
    """Actors 1 to 3 are at y = 50, 100 and 150 m; nobody knows actor 8."""
    state, _ = started(3)
    rows = {i: (0.5, 50.0 * i, 0.0, 10.0) for i in (1, 2, 3) if i not in gone}
    _, states, events = step_fleet(state, traffic_of(1, rows, removed=gone), ())
    left = sorted(i for i in gone if i <= 3)
    assert [(event.actor_id, event.y_m) for event in events] == [(i, 50.0 * i) for i in left]
    assert set(kinds(events)) == {EventKind.REMOVED}
    assert states.actor_id.tolist() == sorted(rows)


def test_a_drivers_pedals_lag_as_drivers_do_and_the_trackers_less() -> None:
    """One step of 0.05 s behind a first-order lag."""
    state, _ = started(2, 5.0)
    rows = {1: (0.25, 50.0, 0.0, 5.0), 2: (0.25, 100.0, 0.0, 5.0)}
    _, states, _ = step_fleet(state, traffic_of(1, rows), [command_of(1, 1, throttle=0.6)])
    lag_s = PARAMETERS[ActorClass.SEDAN].throttle_lag_s
    assert states.throttle[0] == pytest.approx(0.6 * (1.0 - np.exp(-STEP_S / lag_s)))


@pytest.mark.parametrize("owner", [Owner.SUMO, Owner.ROS])
def test_the_hand_brake_is_that_of_who_drives(owner: Owner) -> None:
    """A vehicle of SUMO's follows SUMO whatever a controller says that watches it."""
    state, _ = started(1, 5.0)
    traffic = traffic_of(1, {1: (0.25, 50.0, 0.0, 5.0)})
    pulled = replace(command_of(1, 1, owner=owner), hand_brake=np.ones(1, np.uint8))
    commands = (command_of(1, 1, owner=owner), pulled)
    speeds = [step_fleet(state, traffic, [command])[1].speed_mps[0] for command in commands]
    assert bool(speeds[1] < speeds[0] - 0.1) is (owner is Owner.ROS)
    assert bool(speeds[1] == speeds[0]) is (owner is Owner.SUMO)


def test_a_siren_is_said_once_when_it_begins_and_ends() -> None:
    state, _ = started(2)
    rows = {1: (0.5, 50.0, 0.0, 10.0), 2: (0.5, 100.0, 0.0, 10.0)}
    sounding, silent = {1: Lights.SIREN, 2: Lights.SIREN}, {2: Lights.SIREN}
    said = []
    for step, lights in enumerate((sounding, sounding, silent), start=1):
        state, _, events = step_fleet(state, traffic_of(step, rows, lights=lights), ())
        said += [(event.step, event.kind, event.actor_id) for event in events]
    state, _, events = step_fleet(state, traffic_of(4, {1: rows[1]}, removed=[2]), ())
    assert said == [(1, EventKind.SIREN_ON, 1), (1, EventKind.SIREN_ON, 2), (3, EventKind.SIREN_OFF, 1)]
    assert [(event.kind, event.actor_id) for event in events] == [(EventKind.REMOVED, 2), (EventKind.SIREN_OFF, 2)]
    assert [event.y_m for event in events] == pytest.approx([100.0, 100.0])
    state, _, events = step_fleet(state, traffic_of(5, {1: rows[1]}), ())
    assert events == ()


@pytest.mark.parametrize(("brake", "accel", "lit"), [(0.0, -1.2, False), (0.0, -1.4, True), (0.5, 0.0, True)])
def test_the_brake_light_shows_the_pedal_or_the_deceleration(brake: float, accel: float, lit: bool) -> None:
    """Decelerations by drag alone: a command without a brake from a speed at which drag gives them."""
    vehicle = PARAMETERS[ActorClass.SEDAN]
    speed = np.sqrt(-accel * vehicle.mass_kg / (0.5 * 1.225 * vehicle.drag_area_m2)) if accel else 10.0
    rolling = vehicle.rolling_resistance * 9.80665 * vehicle.mass_kg / (0.5 * 1.225 * vehicle.drag_area_m2)
    speed = float(np.sqrt(max(speed**2 - rolling, 1.0)))
    state, _ = begun((0.0, 0.0, 0.0, speed))
    command = command_of(1, 1, brake=brake, lights=Lights.SIREN)
    _, states, _ = step_fleet(state, traffic_of(1, {1: (0.0, 0.0, 0.0, speed)}), [command])
    assert states.lights[0] == (Lights.SIREN | Lights.BRAKE if lit else Lights.SIREN)
    assert (states.brake[0] > 0.02) == (brake > 0.0)


@pytest.mark.parametrize("yaw", np.radians([0.0, 30.0, 60.0, 200.0]))
def test_who_was_in_contact_stops_and_stays(yaw: float) -> None:
    way = np.array([np.cos(yaw), np.sin(yaw)])

    def traffic(step: int, spawned: Sequence[ActorDescription] = ()) -> TrafficState:
        """SUMO lets one car drive through another one that stands."""
        places = {1: (12.0 * STEP_S * step * way, 12.0), 2: (15.0 * way, 0.0)}
        return traffic_of(step, {i: (*place, yaw, speed) for i, (place, speed) in places.items()}, spawned)

    state, states, _ = step_fleet(FleetState.empty(PARAMETERS), traffic(0, [description(1), description(2)]), ())
    collisions: list[Event] = []
    for step in range(1, 120):
        state, states, events = step_fleet(state, traffic(step), ())
        collisions += [event for event in events if event.kind is EventKind.COLLISION]
        apart = (states.x_m[1] - states.x_m[0]) * way[0] + (states.y_m[1] - states.y_m[0]) * way[1]
        assert apart > PARAMETERS[ActorClass.SEDAN].length_m - 0.05
    (collision,) = collisions
    assert collision.detail["impact_speed_mps"] == pytest.approx(12.0, abs=0.2)
    assert states.speed_mps == pytest.approx([0.0, 0.0], abs=1e-3)
    assert states.owner.tolist() == [Owner.ROS, Owner.ROS]
    assert states.mode.tolist() == [Mode.STOPPED, Mode.STOPPED]
    hazard = Lights.INDICATOR_LEFT | Lights.INDICATOR_RIGHT
    assert np.all(states.lights & hazard == hazard)
    assert states.residual_m.tolist() == [0.0, 0.0]


def test_after_a_contact_the_velocity_is_the_one_that_the_contact_left() -> None:
    length = PARAMETERS[ActorClass.SEDAN].length_m
    standing = (length + 0.3, 0.0, 0.0, 0.0)
    state, _ = begun((0.0, 0.0, 0.0, 10.0), standing)
    state, states, events = step_fleet(state, traffic_of(1, {1: (0.5, 0.0, 0.0, 10.0), 2: standing}), ())
    assert EventKind.COLLISION in kinds(events)
    vx, vy = state.bodies.velocity_mps(state.table)
    assert (states.vx_mps.tolist(), states.vy_mps.tolist()) == (vx.tolist(), vy.tolist())
    assert states.vx_mps == pytest.approx([5.0, 5.0], abs=0.3), "equal masses that stay together"


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
    assert after.residual_m[0] == 0.0


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
    hard = replace(traffic_of(1, {1: (0.6, 50.0, 0.0, 10.0)}), sumo_accel_mps2=np.array([accel]))
    state, _, _ = step_fleet(state, hard, [command_of(1, 1, throttle=0.1)])
    traffic = traffic_of(2, {1: (1.0, 50.0, 0.0, 10.0)})
    assert (state.tracker.pace.tolist(), state.tracker.accel_mps2.tolist()) == ([1.0], [0.0])
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


WALKS = ActorClass.PEDESTRIAN
CROWD = {1: ActorClass.SEDAN, 2: WALKS, 3: ActorClass.AMBULANCE, 4: WALKS}


def in_a_crowd(ids: Sequence[int] = (1, 2, 3, 4), *, left_hand: bool = False):
    """The last of four steps, and all events: a car hits somebody who walks into somebody else, and an EMV turns."""
    state, told = FleetState.empty(PARAMETERS, left_hand=left_hand), []
    for step in range(4):
        at = STEP_S * step
        rows = {
            1: (12.0 * at, 3.0 + 1.2 * at, 0.1, 12.0), 2: (3.4, 3.3 + 1.4 * at, 1.5, 1.4),
            3: (-20.0, 8.0, 0.4, 9.0), 4: (3.4, 3.5, -1.5, 0.0),
        }  # fmt: skip
        spawned = [description(i, CROWD[i]) for i in ids] if step == 0 else ()
        traffic = traffic_of(step, {i: rows[i] for i in ids}, spawned, lights={2: Lights.INDICATOR_LEFT})
        lights = Lights.SIREN | Lights.INDICATOR_LEFT
        commands = [command_of(step, 3, throttle=0.3, steer=0.1, lights=lights)] if 3 in ids else []
        if left_hand:
            traffic, commands = mirror_image(traffic), [mirror_image(command) for command in commands]
        state, states, events = step_fleet(state, traffic, commands)
        told += events
    return state, states, told


def test_who_walks_is_moved_by_sumo_alone_shows_no_lights_and_does_not_stop_where_it_is_hit() -> None:
    fleet, states, events = in_a_crowd()
    assert [(e.actor_id, e.other_id) for e in events if e.kind is EventKind.COLLISION] == [(1, 2), (1, 4)]
    assert fleet.stopped == (1,)
    assert states.lights[[1, 3]].tolist() == [0, 0]
    _, alone, _ = in_a_crowd((2, 4))
    for name in ACTOR_STATE_DTYPES:
        assert getattr(states, name)[[1, 3]].tolist() == getattr(alone, name).tolist()


def test_where_traffic_keeps_left_states_and_events_are_the_mirror_image() -> None:
    _, states, events = in_a_crowd()
    _, image, theirs = in_a_crowd(left_hand=True)
    assert theirs == [mirror_image(event) for event in events] != events
    for name in ACTOR_STATE_DTYPES:
        assert getattr(image, name).tolist() == getattr(mirror_image(states), name).tolist()


def test_a_vehicle_has_the_size_that_its_description_says() -> None:
    large = replace(description(1), length_m=5.5, width_m=2.0, height_m=1.9)
    fleet, *_ = step_fleet(FleetState.empty(PARAMETERS), traffic_of(0, {1: (0.0, 0.0, 0.0, 0.0)}, [large]), ())
    vehicle = PARAMETERS[ActorClass.SEDAN].sized(5.5, 2.0, 1.9)
    assert {name: [getattr(vehicle, name)] for name in ("length_m", "width_m", "wheelbase_m")} == {
        name: getattr(fleet.table, name).tolist() for name in ("length_m", "width_m", "wheelbase_m")
    }
    assert vehicle.wheelbase_m > PARAMETERS[ActorClass.SEDAN].wheelbase_m
