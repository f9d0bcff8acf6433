from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import libsumo
import numpy as np
import pytest
from traffic_helpers import MAPS, named_map, plan_s2, states_of

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.simulation.roads.maps.map_compiler import CompiledMap
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.roads.routing import path_centre, route_path
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.plan import TrafficPlan
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo import standoff
from siren_ros.simulation.traffic.sumo.mirror import DEFAULT_LANE_CHANGE_MODE, KEEP_LANE_CHANGE_MODE
from siren_ros.simulation.traffic.sumo.standoff import IgnoredFoes
from siren_ros.simulation.world.actors import ActorStates, Lights, Mode, Owner, rows_of_ids
from siren_ros.simulation.world.traffic_state import TRAFFIC_STATE_DTYPES, EventKind, TrafficFlags, TrafficState

Town = tuple[CompiledMap, RoadNetwork, TrafficPlan]
"""A map, the same parsed, and the plan of an episode of S2 on it."""
EMV = 1
SUMO_JUMP_M = 0.3
"""SUMO's own motion is not continuous where lanes bend; the simulated vehicle smooths it."""


@pytest.fixture(scope="module", params=MAPS)
def town(request: pytest.FixtureRequest) -> Town:
    compiled, network = named_map(request.param)
    return compiled, network, plan_s2(network)[0]


@pytest.fixture
def sumo(town: Town) -> Iterator[SumoSimulation]:
    with SumoSimulation(*town, EmergencyLevel.L2) as simulation:
        yield simulation


class Follower:
    """Drives an actor along a curve at a speed, sideways by an offset: the simulated world in its simplest form."""

    def __init__(self, actor_id: int, path: Polyline, state: TrafficState) -> None:
        row = int(np.flatnonzero(state.actor_id == actor_id)[0])
        self.actor_id = actor_id
        self.path = path
        self.arc_m = float(path.project([state.sumo_x_m[row], state.sumo_y_m[row]])[0])
        self.speed_mps = float(state.sumo_speed_mps[row])
        self.left_m = float(path.project([state.sumo_x_m[row], state.sumo_y_m[row]])[1])

    def row(self, owner: Owner = Owner.ROS, mode: Mode = Mode.ROUTE_FOLLOW) -> dict[str, float]:
        x, y = self.path.offset_points(self.arc_m, self.left_m)
        yaw = float(self.path.heading_rad(self.arc_m))
        return {
            "actor_id": self.actor_id,
            "x_m": float(x),
            "y_m": float(y),
            "yaw_rad": yaw,
            "vx_mps": self.speed_mps * np.cos(yaw),
            "vy_mps": self.speed_mps * np.sin(yaw),
            "owner": int(owner),
            "mode": int(mode),
        }

    def advance(self, accel_mps2: float = 0.0, left_mps: float = 0.0, top_mps: float = 12.0) -> None:
        self.arc_m += self.speed_mps * STEP_S
        self.left_m += left_mps * STEP_S
        self.speed_mps = min(max(self.speed_mps + accel_mps2 * STEP_S, 0.0), top_mps)


def test_sumo_s_vehicle_is_brought_back_to_a_simulated_one_that_cannot_follow(sumo: SumoSimulation) -> None:
    state = sumo.step(0, None)
    for step in range(1, 40):
        states = following(state)
        state = sumo.step(step, states)
    on_lane = np.flatnonzero((state.lane != NO_LANE) & (state.lane_position_m > 15.0) & (state.sumo_speed_mps > 3.0))
    row = int(on_lane[-1])
    actor = int(state.actor_id[row])
    lagging = following(state, actor, 4.0)
    after = sumo.step(40, lagging)
    (event,) = [event for event in after.events if event.kind is EventKind.REALIGNED]
    assert event.actor_id == actor
    assert event.detail["residual_m"] == pytest.approx(4.0)
    assert not [event for event in after.events if event.kind is EventKind.TELEPORT]
    now, then = int(rows_of_ids(after.actor_id, np.array([actor], np.uint32))[0]), row
    assert after.owner[now] == Owner.SUMO
    # It is put where the simulated one is at this step, and SUMO drives the step from there.
    ahead_m = 2.0 * lagging.vx_mps[then] * STEP_S, 2.0 * lagging.vy_mps[then] * STEP_S
    assert after.sumo_x_m[now] == pytest.approx(lagging.x_m[then] + ahead_m[0], abs=0.15)
    assert after.sumo_y_m[now] == pytest.approx(lagging.y_m[then] + ahead_m[1], abs=0.15)
    for step in range(41, 60):
        after = sumo.step(step, following(after))
        assert not [event for event in after.events if event.kind in {EventKind.REALIGNED, EventKind.TELEPORT}]
    assert after.sumo_speed_mps[rows_of_ids(after.actor_id, np.array([actor], np.uint32))[0]] > 1.0, "SUMO drives on"


def following(state: TrafficState, lagging: int = 0, by_m: float = 0.0) -> ActorStates:
    """Simulated vehicles at SUMO's poses; one of them lags behind."""
    rows = []
    for row, actor in enumerate(state.actor_id.tolist()):
        yaw, speed = float(state.sumo_yaw_rad[row]), float(state.sumo_speed_mps[row])
        behind = by_m if actor == lagging else 0.0
        rows.append(
            {
                "actor_id": actor,
                "x_m": float(state.sumo_x_m[row]) - behind * np.cos(yaw),
                "y_m": float(state.sumo_y_m[row]) - behind * np.sin(yaw),
                "yaw_rad": yaw,
                "vx_mps": speed * np.cos(yaw),
                "vy_mps": speed * np.sin(yaw),
                "residual_m": behind,
                "owner": int(Owner.SUMO),
            }
        )
    return states_of(state.step, rows)


def path_of_emv(network: RoadNetwork, plan: TrafficPlan) -> Polyline:
    emv = plan.emvs[0]
    edges = [network.edge_by_id[edge].index for edge in emv.route]
    return path_centre(network, route_path(network, edges, emv.spot.lane))


def test_mirrored_emv_stays_where_it_is_put_for_25_seconds(sumo: SumoSimulation, town: Town) -> None:
    _, network, plan = town
    route = {network.edge_by_id[edge].index for edge in plan.emvs[0].route}
    state = sumo.step(0, None)
    follower = Follower(EMV, path_of_emv(network, plan), state)
    events = []
    off_m: list[float] = []
    for step in range(1, 500):
        row = follower.row()
        state = sumo.step(step, states_of(step - 1, [row]))
        off_x_m = state.sumo_x_m[0] - row["x_m"] - row["vx_mps"] * STEP_S
        off_y_m = state.sumo_y_m[0] - row["y_m"] - row["vy_mps"] * STEP_S
        off_m.append(float(np.hypot(off_x_m, off_y_m)))
        assert state.x_m[0] == row["x_m"]
        assert state.owner[0] == Owner.ROS
        assert state.lane[0] != NO_LANE
        lane = network.lanes[state.lane[0]]
        assert lane.edge in route or network.edges[lane.edge].internal
        assert abs(state.lateral_offset_m[0]) < lane.width_m / 2.0 + 0.2
        assert state.route_of_row(0)[0] in route
        events += [event for event in state.events if event.actor_id == EMV]
        follower.advance(accel_mps2=1.0)
    assert max(off_m) < 0.6
    assert np.mean(np.array(off_m) > 1e-6) < 0.03, "only where two pieces of a road are joined"
    crossed = [event for event in events if event.kind is EventKind.STOP_LINE_CROSSED]
    assert crossed
    assert crossed[0].detail["signal_state"] in set("rygGuso")
    assert crossed[0].detail["speed_mps"] == pytest.approx(12.0, rel=0.1)
    assert any(event.kind is EventKind.JUNCTION_LEFT for event in events)


def test_standing_emv_is_held_while_it_creeps_by_millimetres(sumo: SumoSimulation, town: Town) -> None:
    _, network, plan = town
    state = sumo.step(0, None)
    follower = Follower(EMV, path_of_emv(network, plan), state)
    follower.speed_mps = 0.0
    lane = state.lane[0]
    places = set()
    for step in range(1, 60):
        row = follower.row()
        state = sumo.step(step, states_of(step - 1, [row]))
        places.add((float(state.sumo_x_m[0]), float(state.sumo_y_m[0])))
        assert state.lane[0] == lane
        follower.arc_m -= 0.0001
    assert len(places) == 1


def test_emv_off_its_route_keeps_the_route(sumo: SumoSimulation, town: Town) -> None:
    _, network, plan = town
    state = sumo.step(0, None)
    follower = Follower(EMV, path_of_emv(network, plan), state)
    first_route = state.route_of_row(0).tolist()
    follower.left_m = 9.0
    state = sumo.step(1, states_of(0, [follower.row()]))
    assert state.lane[0] == NO_LANE
    follower.left_m = 0.0
    follower.advance()
    state = sumo.step(2, states_of(1, [follower.row()]))
    assert state.lane[0] != NO_LANE
    assert state.route_of_row(0).tolist() == first_route


def test_release_goes_on_from_the_pose_at_the_speed(sumo: SumoSimulation, town: Town) -> None:
    _, network, plan = town
    state = sumo.step(0, None)
    row = next(i for i, actor in enumerate(state.spawned) if actor.name == "platoon1")
    actor = state.spawned[row]
    follower = Follower(actor.actor_id, path_of_emv(network, plan), state)
    for step in range(1, 41):
        follower.advance(accel_mps2=-1.0, left_mps=-0.6)
        state = sumo.step(step, states_of(step - 1, [follower.row()]))
    here = rows_of_ids(state.actor_id, np.array([actor.actor_id], dtype=np.uint32))[0]
    x, y = state.sumo_x_m[here], state.sumo_y_m[here]
    for step in range(41, 80):
        follower_row = follower.row(owner=Owner.SUMO, mode=Mode.NOMINAL)
        state = sumo.step(step, states_of(step - 1, [follower_row]))
        here = rows_of_ids(state.actor_id, np.array([actor.actor_id], dtype=np.uint32))[0]
        moved = float(np.hypot(state.sumo_x_m[here] - x, state.sumo_y_m[here] - y))
        if step == 41:
            assert moved == pytest.approx(follower.speed_mps * STEP_S, abs=0.05)
            assert state.sumo_speed_mps[here] == pytest.approx(follower.speed_mps, abs=0.3)
            assert state.owner[here] == Owner.SUMO
        assert moved <= state.sumo_speed_mps[here] * STEP_S + 0.05
        x, y = state.sumo_x_m[here], state.sumo_y_m[here]


def test_vehicle_that_cleared_the_lane_keeps_its_lane_more_slowly_and_is_freed(
    sumo: SumoSimulation, town: Town
) -> None:
    state = sumo.step(0, None)
    background = [actor.actor_id for actor in state.spawned if actor.name.startswith("background")]
    rows = rows_of_ids(state.actor_id, np.array(background, dtype=np.uint32))
    fastest = int(rows[np.argmax(state.sumo_speed_mps[rows])])
    actor_id = int(state.actor_id[fastest])
    name = next(actor.name for actor in state.spawned if actor.actor_id == actor_id)
    speed_factor = libsumo.vehicle.getSpeedFactor(name)
    lanes = []
    for step in range(1, 200):
        row = {"actor_id": actor_id, "owner": int(Owner.SUMO), "mode": int(Mode.YIELD_KEEP_LANE)}
        state = sumo.step(step, states_of(step - 1, [row]))
        here = rows_of_ids(state.actor_id, np.array([actor_id], dtype=np.uint32))[0]
        lanes.append((town[1].lanes[state.lane[here]].edge, int(state.lane[here])))
    assert len({lane for _, lane in lanes}) == len({edge for edge, _ in lanes})
    assert libsumo.vehicle.getSpeedFactor(name) == pytest.approx(TrafficDrivers().cleared_pace * speed_factor)
    assert libsumo.vehicle.getLaneChangeMode(name) == KEEP_LANE_CHANGE_MODE
    row["mode"] = int(Mode.NOMINAL)
    sumo.step(200, states_of(199, [row]))
    assert libsumo.vehicle.getSpeedFactor(name) == speed_factor
    assert libsumo.vehicle.getLaneChangeMode(name) == DEFAULT_LANE_CHANGE_MODE


def run(town: Town, level: EmergencyLevel, steps: int) -> list[TrafficState]:
    with SumoSimulation(*town, level) as simulation:
        return [simulation.step(step, None if step == 0 else ActorStates.empty(step - 1)) for step in range(steps)]


def test_two_runs_are_identical(town: Town) -> None:
    for first, second in zip(run(town, EmergencyLevel.L3, 120), run(town, EmergencyLevel.L3, 120), strict=True):
        for name in TRAFFIC_STATE_DTYPES:
            assert np.array_equal(getattr(first, name), getattr(second, name)), name
        assert (first.spawned, first.emvs, first.signals, first.events) == (
            second.spawned,
            second.emvs,
            second.signals,
            second.events,
        )


def test_traffic_keeps_its_volume_and_moves_without_jumps_for_60_seconds(town: Town) -> None:
    plan = town[2]
    states = run(town, EmergencyLevel.L2, 1200)
    kinds = {event.kind for state in states for event in state.events}
    assert EventKind.TELEPORT not in kinds
    for last, state in pairwise(states):
        assert state.actor_id.tolist() == sorted(state.actor_id.tolist())
        assert plan.civilians - 3 <= np.count_nonzero(state.actor_id != EMV) <= plan.civilians
        rows = rows_of_ids(last.actor_id, state.actor_id)
        stayed = rows >= 0
        moved = np.hypot(state.sumo_x_m - last.sumo_x_m[rows], state.sumo_y_m - last.sumo_y_m[rows])[stayed]
        assert np.all(moved <= state.sumo_speed_mps[stayed] * STEP_S + SUMO_JUMP_M)
    means = [float(state.sumo_speed_mps.mean()) for state in states]
    assert np.mean(means) > 2.0


def test_first_state_has_emv_platoon_and_siren(town: Town) -> None:
    plan = town[2]
    state = run(town, EmergencyLevel.L2, 1)[0]
    assert state.spawned[0].is_emv
    assert state.spawned[0].actor_id == EMV
    assert len(state.spawned) == plan.civilians + 1
    assert state.lane[0] == plan.emvs[0].spot.lane
    assert state.lane_position_m[0] == pytest.approx(plan.emvs[0].spot.front_m, abs=1.0)
    assert state.sumo_speed_mps[0] == pytest.approx(plan.emvs[0].spot.speed_mps, abs=0.5)
    assert state.lights[0] & Lights.SIREN
    reacting = state.actor_id[(state.flags & TrafficFlags.RESCUE_LANE) != 0]
    names = {actor.actor_id: actor.name for actor in state.spawned}
    assert "platoon0" in {names[int(actor_id)] for actor_id in reacting}
    assert state.emvs[0].rescue_count == len(reacting)
    assert names[state.emvs[0].leader_id] == "platoon0"
    assert state.emvs[0].leader_gap_m == pytest.approx(22.0, abs=1.0)


@pytest.mark.parametrize("level", [EmergencyLevel.L0, EmergencyLevel.L1])
def test_without_siren_nobody_reacts(town: Town, level: EmergencyLevel) -> None:
    states = run(town, level, 60)
    assert all(not np.any(state.flags & TrafficFlags.RESCUE_LANE) for state in states)
    assert all(not state.lights[0] & (Lights.SIREN | Lights.BEACON) for state in states)


def test_sumo_itself_pushes_nobody_aside(town: Town) -> None:
    """Its bluelight device would; who makes way, and how, is the yield manager's."""
    heard = run(town, EmergencyLevel.L3, 160)[-1]
    assert heard.emvs[0].rescue_count > 0
    reacting = (heard.flags & TrafficFlags.RESCUE_LANE) != 0
    assert np.median(np.abs(heard.lateral_offset_m[reacting])) < 0.3


def test_steps_come_in_order_and_one_simulation_at_a_time(sumo: SumoSimulation, town: Town) -> None:
    with pytest.raises(EpisodeError, match="step 3"):
        sumo.step(3, None)
    with pytest.raises(EpisodeError, match="already running"):
        SumoSimulation(*town, EmergencyLevel.L2)


def test_after_a_failed_start_another_simulation_can_start(town: Town) -> None:
    compiled, network, plan = town
    astray = replace(plan, background=(replace(plan.background[0], route=("no_such_edge",)), *plan.background[1:]))
    with pytest.raises(EpisodeError, match="no_such_edge"):
        SumoSimulation(compiled, network, astray, EmergencyLevel.L2)
    with SumoSimulation(compiled, network, plan, EmergencyLevel.L2) as simulation:
        assert len(simulation.step(0, None).actor_id) > 0


@pytest.mark.parametrize(
    ("count", "level", "looked_at"),
    [(1, EmergencyLevel.L1, True), (2, EmergencyLevel.L1, True), (1, EmergencyLevel.L0, False)],
)
def test_stand_offs_are_looked_at_where_emvs_run_red_lights(
    town: Town, monkeypatch: pytest.MonkeyPatch, count: int, level: EmergencyLevel, looked_at: bool
) -> None:
    compiled, network, plan = town
    first = plan.emvs[0]
    behind = replace(first, name="emv1", spot=replace(first.spot, front_m=first.spot.front_m - first.length_m - 1.0))
    steps, told = list[int](), list[Mapping[str, frozenset[str]]]()

    def who_goes(_: object, traffic: TrafficState, __: object, emvs: frozenset[str]) -> Mapping[str, frozenset[str]]:
        steps.append(traffic.step)
        return {"first": emvs}

    monkeypatch.setattr(standoff, "drivers_who_go", who_goes)
    monkeypatch.setattr(IgnoredFoes, "apply", lambda _, __, ___, going: told.append(going))
    with SumoSimulation(compiled, network, replace(plan, emvs=(first, behind)[:count]), level) as simulation:
        simulation.step(0, None)
        simulation.step(1, None)
    emvs = {first.name, behind.name} if count > 1 else {first.name}
    assert steps == [0] * looked_at
    assert told == [{}, {"first": emvs} if looked_at else {}]
