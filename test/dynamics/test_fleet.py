from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.dynamics.fleet import FleetState, step_fleet
from siren_ros.dynamics.parameters import VehicleParameters, load_vehicle_parameters
from siren_ros.errors import EpisodeError
from siren_ros.numerics.units import STEP_S
from siren_ros.world.actors import ActorClass, ActorDescription, ActorStates, Lights, Mode, Owner, rows_of_ids
from siren_ros.world.commands import COMMAND_DTYPES, VehicleCommands
from siren_ros.world.events import Event, EventKind
from siren_ros.world.traffic_state import TrafficState

PARAMETERS = load_vehicle_parameters()


def _description(actor_id: int, kind: ActorClass = ActorClass.SEDAN) -> ActorDescription:
    vehicle = PARAMETERS[kind]
    return ActorDescription(
        actor_id, f"v{actor_id}", kind, vehicle.length_m, vehicle.width_m, vehicle.height_m, (200, 30, 30)
    )


def _traffic(
    step: int,
    rows: Mapping[int, tuple[float, float, float, float]],
    spawned: Sequence[ActorDescription] = (),
    removed: Sequence[int] = (),
    lights: Mapping[int, Lights] | None = None,
    events: tuple[Event, ...] = (),
) -> TrafficState:
    """SUMO's rows by actor id: x, y, yaw, speed."""
    ids = sorted(rows)
    n = len(ids)
    x, y, yaw, speed = np.array([rows[i] for i in ids], dtype=np.float64).reshape(n, 4).T
    zero, codes, indices = np.zeros(n), np.zeros(n, np.uint8), np.zeros(n, np.int32)
    return TrafficState(
        step=step,
        spawned=tuple(spawned),
        removed=np.array(removed, dtype=np.uint32),
        actor_id=np.array(ids, dtype=np.uint32),
        owner=codes,
        sumo_x_m=x,
        sumo_y_m=y,
        sumo_yaw_rad=yaw,
        sumo_speed_mps=speed,
        sumo_accel_mps2=zero,
        x_m=x,
        y_m=y,
        yaw_rad=yaw,
        speed_mps=speed,
        lane=indices,
        lane_position_m=zero,
        lateral_offset_m=zero,
        lights=np.array([int((lights or {}).get(i, 0)) for i in ids], dtype=np.uint8),
        flags=codes,
        route_offset=np.zeros(n + 1, np.int32),
        route_edges=np.empty(0, np.int32),
        emvs=(),
        signals=(),
        events=events,
    )


def _command(
    step: int,
    actor_id: int,
    owner: Owner = Owner.ROS,
    throttle: float = 0.0,
    brake: float = 0.0,
    steer: float = 0.0,
    mode: Mode = Mode.ROUTE_FOLLOW,
    lights: Lights = Lights.NONE,
    source: str = "emv_controller",
    events: tuple[Event, ...] = (),
) -> VehicleCommands:
    return VehicleCommands(
        step=step,
        source=source,
        actor_id=np.array([actor_id], np.uint32),
        owner=np.array([owner], np.uint8),
        throttle=np.array([throttle]),
        brake=np.array([brake]),
        steer_rad=np.array([steer]),
        hand_brake=np.zeros(1, np.uint8),
        mode=np.array([mode], np.uint8),
        lights=np.array([lights], np.uint8),
        events=events,
    )


def _stacked(*commands: VehicleCommands) -> VehicleCommands:
    arrays = {name: np.concatenate([getattr(command, name) for command in commands]) for name in COMMAND_DTYPES}
    return VehicleCommands(step=commands[0].step, source=commands[0].source, events=(), **arrays)


def _kinds(events: Sequence[Event]) -> list[EventKind]:
    return [event.kind for event in events]


def _started(count: int = 1, speed_mps: float = 10.0) -> tuple[FleetState, ActorStates]:
    rows = {i: (0.0, 50.0 * i, 0.0, speed_mps) for i in range(1, count + 1)}
    spawned = [_description(i) for i in range(1, count + 1)]
    state, states, _ = step_fleet(FleetState.empty(PARAMETERS), _traffic(0, rows, spawned), ())
    return state, states


def test_spawned_actors_stand_at_sumos_pose() -> None:
    rows = {3: (5.0, -2.0, 0.7, 9.0), 8: (50.0, 60.0, -2.0, 0.0)}
    traffic = _traffic(4, rows, [_description(8, ActorClass.BUS), _description(3)], lights={3: Lights.INDICATOR_LEFT})
    state, states, events = step_fleet(FleetState.empty(PARAMETERS), traffic, ())
    assert states.actor_id.tolist() == [3, 8]
    assert states.step == 4
    assert (states.x_m[0], states.y_m[0], states.yaw_rad[0]) == (5.0, -2.0, 0.7)
    assert states.speed_mps[0] == pytest.approx(9.0)
    assert states.vx_mps[0] == pytest.approx(9.0 * np.cos(0.7))
    assert states.residual_m.tolist() == [0.0, 0.0]
    assert states.lights.tolist() == [Lights.INDICATOR_LEFT, Lights.NONE]
    assert [(event.kind, event.actor_id, event.x_m) for event in events] == [
        (EventKind.SPAWNED, 3, 5.0),
        (EventKind.SPAWNED, 8, 50.0),
    ]
    assert [item.actor_class for item in state.descriptions] == [ActorClass.SEDAN, ActorClass.BUS]


def test_sumo_actors_follow_sumo() -> None:
    state, states = _started()
    for step in range(1, 100):
        x = 10.0 * STEP_S * step
        state, states, events = step_fleet(state, _traffic(step, {1: (x, 50.0, 0.0, 10.0)}), ())
        assert events == ()
    assert states.residual_m[0] < 0.05
    assert states.owner[0] == Owner.SUMO
    assert states.mode[0] == Mode.NOMINAL


def test_actors_come_and_go_in_the_middle_of_the_rows() -> None:
    state, _ = _started(3)
    rows = {1: (0.5, 50.0, 0.0, 10.0), 2: (99.0, 99.0, 1.0, 3.0), 3: (0.5, 150.0, 0.0, 10.0)}
    del rows[2]
    state, states, events = step_fleet(state, _traffic(1, rows, removed=[2]), ())
    assert states.actor_id.tolist() == [1, 3]
    assert _kinds(events) == [EventKind.REMOVED]
    assert (events[0].actor_id, events[0].y_m) == (2, 100.0)
    rows = {1: (1.0, 50.0, 0.0, 10.0), 2: (7.0, 99.0, 1.0, 3.0), 3: (1.0, 150.0, 0.0, 10.0)}
    state, states, events = step_fleet(state, _traffic(2, rows, [_description(2, ActorClass.VAN)]), ())
    assert states.actor_id.tolist() == [1, 2, 3]
    assert (states.x_m[1], states.y_m[1], states.yaw_rad[1]) == (7.0, 99.0, 1.0)
    np.testing.assert_allclose(states.x_m[[0, 2]], 1.0, atol=0.02)
    assert _kinds(events) == [EventKind.SPAWNED]
    assert state.table.mass_kg[1] == PARAMETERS[ActorClass.VAN].mass_kg


def test_an_actor_may_belong_to_ros_from_its_first_step() -> None:
    traffic = _traffic(0, {1: (0.0, 0.0, 0.0, 5.0)}, [_description(1)])
    _, states, events = step_fleet(FleetState.empty(PARAMETERS), traffic, [_command(0, 1, throttle=1.0)])
    assert states.owner[0] == Owner.ROS
    assert states.x_m[0] == 0.0
    assert _kinds(events) == [EventKind.SPAWNED, EventKind.OWNER_CHANGED]


def test_commands_drive_and_are_shown() -> None:
    state, states = _started(2, 5.0)
    for step in range(1, 41):
        rows = {1: (float(states.x_m[0]), 50.0, 0.0, float(states.speed_mps[0])), 2: (0.25 * step, 100.0, 0.0, 5.0)}
        command = _command(step, 1, throttle=0.6, mode=Mode.COPY_SUMO, lights=Lights.SIREN | Lights.BEACON)
        state, states, events = step_fleet(state, _traffic(step, rows, lights={1: Lights.INDICATOR_LEFT}), [command])
        assert _kinds(events) == ([EventKind.OWNER_CHANGED, EventKind.SIREN_ON] if step == 1 else [])
    assert events == ()
    assert states.speed_mps[0] > 7.0
    assert states.owner.tolist() == [Owner.ROS, Owner.SUMO]
    assert states.mode.tolist() == [Mode.COPY_SUMO, Mode.NOMINAL]
    assert states.lights[0] == Lights.SIREN | Lights.BEACON
    assert states.residual_m[0] == 0.0
    assert states.residual_m[1] < 0.05


def test_a_siren_is_said_once_when_it_begins_and_ends() -> None:
    state, _ = _started(2)
    rows = {1: (0.5, 50.0, 0.0, 10.0), 2: (0.5, 100.0, 0.0, 10.0)}
    sounding, silent = {1: Lights.SIREN, 2: Lights.SIREN}, {2: Lights.SIREN}
    said = []
    for step, lights in enumerate((sounding, sounding, silent), start=1):
        state, _, events = step_fleet(state, _traffic(step, rows, lights=lights), ())
        said += [(event.step, event.kind, event.actor_id) for event in events]
    state, _, events = step_fleet(state, _traffic(4, {1: rows[1]}, removed=[2]), ())
    assert said == [(1, EventKind.SIREN_ON, 1), (1, EventKind.SIREN_ON, 2), (3, EventKind.SIREN_OFF, 1)]
    assert [(event.kind, event.actor_id) for event in events] == [(EventKind.REMOVED, 2), (EventKind.SIREN_OFF, 2)]


def test_the_brake_light_is_the_vehicles_own() -> None:
    state, states = _started(1, 10.0)
    traffic = _traffic(1, {1: (0.5, 50.0, 0.0, 10.0)})
    _, braked, _ = step_fleet(state, traffic, [_command(1, 1, brake=0.5, lights=Lights.SIREN)])
    assert braked.lights[0] == Lights.SIREN | Lights.BRAKE
    assert braked.brake[0] > 0.02
    assert states.lights[0] == Lights.NONE


def test_a_command_of_owner_sumo_only_shows() -> None:
    state, _ = _started()
    command = _command(1, 1, Owner.SUMO, throttle=1.0, steer=0.5, mode=Mode.YIELD_REACTING, lights=Lights.BEACON)
    _, told, events = step_fleet(state, _traffic(1, {1: (0.5, 50.0, 0.0, 10.0)}), [command])
    _, left, _ = step_fleet(state, _traffic(1, {1: (0.5, 50.0, 0.0, 10.0)}), ())
    assert events == ()
    assert told.mode[0] == Mode.YIELD_REACTING
    assert told.lights[0] == Lights.BEACON
    assert told.x_m[0] == left.x_m[0]
    assert told.owner[0] == Owner.SUMO


@pytest.mark.parametrize("mirror_delay", [0, 1])
def test_taking_over_and_handing_back_makes_no_jump(mirror_delay: int) -> None:
    """SUMO's pose of a ROS-owned actor is the mirror of the step before; from the release on SUMO drives on."""
    state, states = _started(1, 10.0)
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
        commands = [_command(step, 1, throttle=0.35, steer=0.004)] if ours else []
        state, states, events = step_fleet(state, _traffic(step, {1: (x, y, yaw, speed)}), commands)
        changes += [(step, event.detail["owner"]) for event in events if event.kind is EventKind.OWNER_CHANGED]
        history.append(states)
    assert changes == [(40, "ROS"), (100, "SUMO")]
    way_x = np.array([item.x_m[0] for item in history])
    way_y = np.array([item.y_m[0] for item in history])
    yaw_rad = np.array([item.yaw_rad[0] for item in history])
    speeds = np.array([item.speed_mps[0] for item in history])
    np.testing.assert_allclose(np.hypot(np.diff(way_x), np.diff(way_y)), speeds[1:] * STEP_S, atol=0.02)
    assert np.abs(np.diff(speeds)).max() < 10.0 * STEP_S
    assert np.abs(np.diff(yaw_rad)).max() < 0.05
    assert max(item.residual_m[0] for item in history) < 1.0
    assert history[-1].residual_m[0] < 0.1


def test_a_released_actor_rolls_on_at_the_step_of_release() -> None:
    state, states = _started(1, 10.0)
    state, states, _ = step_fleet(state, _traffic(1, {1: (0.5, 50.0, 0.0, 10.0)}), [_command(1, 1, throttle=0.1)])
    before = states
    mirror = (float(states.x_m[0]), 50.0, 0.0, float(states.speed_mps[0]))
    _, states, _ = step_fleet(state, _traffic(2, {1: mirror}), [_command(2, 1, Owner.SUMO, mode=Mode.REJOIN)])
    assert states.owner[0] == Owner.SUMO
    assert states.mode[0] == Mode.REJOIN
    assert states.x_m[0] - before.x_m[0] == pytest.approx(before.speed_mps[0] * STEP_S, abs=0.01)
    assert states.residual_m[0] == 0.0


def test_collisions_become_events_once() -> None:
    spawned = [_description(1), _description(2)]
    state, states, _ = step_fleet(
        FleetState.empty(PARAMETERS), _traffic(0, {1: (0.0, 0.0, 0.0, 10.0), 2: (12.0, 0.0, 0.0, 0.0)}, spawned), ()
    )
    found: list[Event] = []
    for step in range(1, 60):
        rows = {i + 1: (float(states.x_m[i]), 0.0, 0.0, float(states.speed_mps[i])) for i in range(2)}
        rows[2] = (12.0, 0.0, 0.0, 0.0)
        state, states, events = step_fleet(state, _traffic(step, rows), [_command(step, 1, throttle=0.05)])
        found += [event for event in events if event.kind is EventKind.COLLISION]
        if states.x_m[0] > 11.0:
            break
    (event,) = found
    assert (event.actor_id, event.other_id) == (1, 2)
    gap = 12.0 - PARAMETERS[ActorClass.SEDAN].length_m
    assert event.step == pytest.approx(gap / 10.0 / STEP_S, abs=1.5)
    assert event.detail["impact_speed_mps"] == pytest.approx(10.0, abs=0.3)
    assert event.x_m == pytest.approx(12.0 - PARAMETERS[ActorClass.SEDAN].length_m / 2.0, abs=0.4)


def test_reported_events_follow_by_source() -> None:
    state, _ = _started(2)

    def event(kind: EventKind, actor_id: int) -> Event:
        return Event(1, kind, actor_id)

    rows = {1: (0.5, 50.0, 0.0, 10.0), 2: (0.5, 100.0, 0.0, 10.0)}
    traffic = _traffic(1, rows, events=(event(EventKind.TELEPORT, 2),))
    commands = [
        _command(1, 2, source="yield_manager", events=(event(EventKind.YIELD_STARTED, 2),)),
        _command(1, 1, source="emv_controller", events=(event(EventKind.SIREN_ON, 1),)),
    ]
    _, forward, events = step_fleet(state, traffic, commands)
    _, backward, same = step_fleet(state, traffic, commands[::-1])
    assert _kinds(events) == [
        EventKind.OWNER_CHANGED,
        EventKind.OWNER_CHANGED,
        EventKind.SIREN_ON,
        EventKind.YIELD_STARTED,
        EventKind.TELEPORT,
    ]
    assert events == same
    np.testing.assert_array_equal(forward.x_m, backward.x_m)


def test_same_inputs_give_the_same_bytes() -> None:
    def run() -> bytes:
        state, states = _started(3)
        for step in range(1, 50):
            rows = {i: (0.5 * step, 50.0 * i, 0.01 * step, 10.0) for i in (1, 2, 3)}
            state, states, _ = step_fleet(state, _traffic(step, rows), [_command(step, 2, throttle=0.3, steer=0.02)])
        return b"".join(getattr(states, name).tobytes() for name in ("x_m", "y_m", "yaw_rad", "vx_mps", "brake"))

    assert run() == run()


def test_an_empty_fleet_steps() -> None:
    state = FleetState.empty(PARAMETERS)
    for step in range(3):
        state, states, events = step_fleet(state, _traffic(step, {}), [VehicleCommands.empty(step, "emv_controller")])
        assert len(states) == 0
        assert events == ()


def test_contradictions_are_refused() -> None:
    state, _ = _started(1)
    rows = {1: (0.5, 50.0, 0.0, 10.0)}
    with pytest.raises(EpisodeError, match="cannot follow"):
        step_fleet(state, _traffic(5, rows), ())
    with pytest.raises(EpisodeError, match="emv_controller are of step 7"):
        step_fleet(state, _traffic(1, rows), [_command(7, 1)])
    with pytest.raises(EpisodeError, match=r"\[9\]"):
        step_fleet(state, _traffic(1, rows | {9: (0.0, 0.0, 0.0, 0.0)}), ())
    with pytest.raises(EpisodeError, match="both command actor 1"):
        step_fleet(state, _traffic(1, rows), [_command(1, 1), _command(1, 1, source="yield_manager")])
    with pytest.raises(EpisodeError, match=r"commands actors \[4\], unknown"):
        step_fleet(state, _traffic(1, rows), [_command(1, 4)])
    with pytest.raises(EpisodeError, match="not finite"):
        step_fleet(state, _traffic(1, rows), [_command(1, 1, steer=float("nan"))])
    with pytest.raises(EpisodeError, match="twice"):
        step_fleet(state, _traffic(1, rows), [_stacked(_command(1, 1), _command(1, 1))])


def test_commands_for_actors_that_just_left_are_void() -> None:
    state, _ = _started(2)
    traffic = _traffic(1, {1: (0.5, 50.0, 0.0, 10.0)}, removed=[2])
    _, states, events = step_fleet(state, traffic, [_command(1, 2)])
    assert states.actor_id.tolist() == [1]
    assert _kinds(events) == [EventKind.REMOVED]
    assert rows_of_ids(states.actor_id, np.array([2], np.uint32)).tolist() == [-1]


def test_classes_have_their_own_motion(parameters: Mapping[ActorClass, VehicleParameters]) -> None:
    rows = {1: (0.0, 0.0, 0.0, 5.0), 2: (0.0, 50.0, 0.0, 5.0)}
    spawned = [_description(1), _description(2, ActorClass.BUS)]
    state, states, _ = step_fleet(FleetState.empty(parameters), _traffic(0, rows, spawned), ())
    for step in range(1, 40):
        state, states, _ = step_fleet(
            state, _traffic(step, rows), [_stacked(*(_command(step, i, throttle=1.0) for i in (1, 2)))]
        )
    assert states.speed_mps[0] > states.speed_mps[1] + 1.0


@pytest.mark.parametrize("yaw", np.radians([0.0, 30.0, 60.0, 200.0]))
def test_who_was_in_contact_stops_and_stays(yaw: float) -> None:
    way = np.array([np.cos(yaw), np.sin(yaw)])

    def traffic(step: int, spawned: Sequence[ActorDescription] = ()) -> TrafficState:
        """SUMO lets one car drive through another one that stands."""
        places = {1: (12.0 * STEP_S * step * way, 12.0), 2: (15.0 * way, 0.0)}
        return _traffic(step, {i: (*place, yaw, speed) for i, (place, speed) in places.items()}, spawned)

    state, states, _ = step_fleet(FleetState.empty(PARAMETERS), traffic(0, [_description(1), _description(2)]), ())
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


def test_commands_cannot_move_who_was_in_contact() -> None:
    state, _ = _started()
    state = replace(state, stopped=(1,))
    speed = []
    for step in range(1, 80):
        traffic = _traffic(step, {1: (0.5 * step, 50.0, 0.0, 10.0)})
        state, states, _ = step_fleet(state, traffic, [_command(step, 1, throttle=1.0, steer=0.3)])
        speed.append(float(states.speed_mps[0]))
    assert speed[-1] == 0.0
    assert states.throttle[0] < 1e-3


def test_a_vehicle_brought_back_in_sumo_makes_no_jump() -> None:
    fleet, _, _ = step_fleet(
        FleetState.empty(PARAMETERS), _traffic(0, {1: (0.0, 0.0, 0.0, 8.0)}, [_description(1)]), []
    )
    positions, x = [0.0], 0.0
    for step in range(1, 60):
        x += 8.0 * STEP_S
        events: tuple[Event, ...] = ()
        if step == 20:  # SUMO's vehicle was 3 m ahead for a moment and is brought back
            events = (Event(step, EventKind.REALIGNED, 1),)
            x = positions[-1] + 8.0 * STEP_S
        ahead_m = 3.0 if step == 19 else 0.0
        fleet, states, _ = step_fleet(fleet, _traffic(step, {1: (x + ahead_m, 0.0, 0.0, 8.0)}, events=events), [])
        positions.append(float(states.x_m[0]))
    steps_m = np.diff(positions)
    assert np.abs(steps_m - 8.0 * STEP_S).max() < 0.05
    assert positions[-1] == pytest.approx(x, abs=0.3)


@pytest.mark.parametrize("yaw", np.radians([0.0, 50.0, 140.0, -100.0]))
def test_a_released_actor_rolls_on_whichever_way_it_points(yaw: float) -> None:
    """SUMO's pose is still the mirror of the step before; without a correction the actor would brake for it."""
    way = np.array([np.cos(yaw), np.sin(yaw)])
    state, _, _ = step_fleet(
        FleetState.empty(PARAMETERS), _traffic(0, {1: (*(5.0 * way), yaw, 10.0)}, [_description(1)]), ()
    )
    state, before, _ = step_fleet(state, _traffic(1, {1: (*(5.5 * way), yaw, 10.0)}), [_command(1, 1, throttle=0.2)])
    mirror = (float(before.x_m[0]), float(before.y_m[0]), yaw, float(before.speed_mps[0]))
    _, after, _ = step_fleet(state, _traffic(2, {1: mirror}), [_command(2, 1, Owner.SUMO)])
    moved = np.array([after.x_m[0] - before.x_m[0], after.y_m[0] - before.y_m[0]])
    assert moved @ way == pytest.approx(before.speed_mps[0] * STEP_S, abs=0.005)
    assert after.speed_mps[0] == pytest.approx(before.speed_mps[0], abs=0.05)
    assert abs(after.steer_rad[0]) < 1e-3


@pytest.mark.parametrize("yaw", np.radians([0.0, 50.0, 140.0, -100.0]))
@pytest.mark.parametrize(("ahead", "left"), [(0.4, 0.3), (-0.5, -0.2)])
def test_the_residual_is_the_distance_between_both_poses(yaw: float, ahead: float, left: float) -> None:
    state, _, _ = step_fleet(
        FleetState.empty(PARAMETERS), _traffic(0, {1: (0.0, 0.0, yaw, 0.0)}, [_description(1)]), ()
    )
    x, y = ahead * np.cos(yaw) - left * np.sin(yaw), ahead * np.sin(yaw) + left * np.cos(yaw)
    _, states, _ = step_fleet(state, _traffic(1, {1: (x, y, yaw, 0.0)}), ())
    assert states.residual_m[0] == pytest.approx(np.hypot(x - states.x_m[0], y - states.y_m[0]))
    assert states.residual_m[0] == pytest.approx(np.hypot(ahead, left), abs=0.05)


@pytest.mark.parametrize(("brake", "accel", "lit"), [(0.0, -1.2, False), (0.0, -1.4, True), (0.5, 0.0, True)])
def test_the_brake_light_shows_the_pedal_or_the_deceleration(brake: float, accel: float, lit: bool) -> None:
    """Decelerations by drag alone: a command without a brake from a speed at which drag gives them."""
    kind = ActorClass.SEDAN
    vehicle = PARAMETERS[kind]
    speed = np.sqrt(-accel * vehicle.mass_kg / (0.5 * 1.225 * vehicle.drag_area_m2)) if accel else 10.0
    rolling = vehicle.rolling_resistance * 9.80665 * vehicle.mass_kg / (0.5 * 1.225 * vehicle.drag_area_m2)
    speed = float(np.sqrt(max(speed**2 - rolling, 1.0)))
    state, _, _ = step_fleet(
        FleetState.empty(PARAMETERS), _traffic(0, {1: (0.0, 0.0, 0.0, speed)}, [_description(1)]), ()
    )
    _, states, _ = step_fleet(state, _traffic(1, {1: (0.0, 0.0, 0.0, speed)}), [_command(1, 1, brake=brake)])
    assert bool(states.lights[0] & Lights.BRAKE) is lit
