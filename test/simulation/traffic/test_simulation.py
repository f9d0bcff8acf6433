"""What the simulation makes of SUMO's answers: on built-in maps, and at one step with a stand-in for SUMO."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import libsumo
import numpy as np
import pytest
from made_streets import A_LEFT, A_RIGHT, B_LEFT, C_LEFT, CAR_M, STRAIGHT_LEFT, A, B, C, streets
from traffic_helpers import MAPS, named_map, plan_s2, states_of

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.simulation.roads.maps.map_compiler import CompiledMap
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.roads.routing import path_centre, route_path
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic import simulation as simulation_module
from siren_ros.simulation.traffic.demand.plan import TrafficPlan
from siren_ros.simulation.traffic.observation import CrossingWatch
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo import orders, rules
from siren_ros.simulation.traffic.sumo.mirror import DEFAULT_LANE_CHANGE_MODE, KEEP_LANE_CHANGE_MODE, LaneMatch, Place
from siren_ros.simulation.traffic.sumo.orders import IgnoredFoes
from siren_ros.simulation.traffic.sumo.population import route_id
from siren_ros.simulation.traffic.sumo.rules import RULES, Moment
from siren_ros.simulation.world.actors import (
    TRAFFIC_STATE_DTYPES,
    ActorClass,
    ActorStates,
    Event,
    EventKind,
    Lights,
    Mode,
    Owner,
    TrafficFlags,
    TrafficState,
    rows_of_ids,
)

Town = tuple[CompiledMap, RoadNetwork, TrafficPlan]
"""A map, the same parsed, and the plan of an episode of S2 on it."""
EMV_ID = 1
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
    follower = Follower(EMV_ID, path_of_emv(network, plan), state)
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
        events += [event for event in state.events if event.actor_id == EMV_ID]
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
    follower = Follower(EMV_ID, path_of_emv(network, plan), state)
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
    follower = Follower(EMV_ID, path_of_emv(network, plan), state)
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
        assert plan.civilians - 3 <= np.count_nonzero(state.actor_id != EMV_ID) <= plan.civilians
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
    assert state.spawned[0].actor_id == EMV_ID
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

    monkeypatch.setattr(orders, "drivers_who_go", who_goes)
    monkeypatch.setattr(IgnoredFoes, "apply", lambda _, __, ___, going: told.append(going))
    with SumoSimulation(compiled, network, replace(plan, emvs=(first, behind)[:count]), level) as simulation:
        simulation.step(0, None)
        simulation.step(1, None)
    emvs = {first.name, behind.name} if count > 1 else {first.name}
    assert steps == [0] * looked_at
    assert told == [{}, {"first": emvs} if looked_at else {}]


NETWORK = streets()
EMV, AV, CAR, OTHER = "emv0", "av0", "car", "other"
IDS = {EMV: 1, AV: 2, CAR: 3, OTHER: 4}
ROUTE = ("a", "b", "c")


def planned(name: str) -> Any:
    body = {
        "actor_class": ActorClass.SEDAN,
        "length_m": CAR_M,
        "width_m": 1.8,
        "height_m": 1.5,
        "colour_rgb": (1, 2, 3),
    }
    driver = SimpleNamespace(driving=SimpleNamespace(min_gap_m=2.0))
    return SimpleNamespace(name=name, is_emv=name == EMV, route=ROUTE, driver=driver, **body)


def place(lane: int, position_m: float = 50.0, lateral_m: float = 0.4) -> Place:
    return Place(0.0, 0.0, 0.0, LaneMatch(lane, position_m, lateral_m))


class Corrected(SumoSimulation):
    """It has the rules alone that correct what SUMO has done: those need no more than the stand-in answers."""

    _rules = tuple(rule for rule in RULES if rule.moment is Moment.CORRECTION)


class Stage:
    """A simulation around a stand-in for SUMO in which everybody drives east, on the lane that ``lanes`` says."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.lanes = dict.fromkeys((EMV, AV, CAR), A_LEFT)
        self.front_m = dict.fromkeys((EMV, AV, CAR), 100.0)
        self.speed_mps = 8.0
        self.index = 0
        self.forgotten: list[str] = []
        self.routes_of_mirror: list[set[str]] = []
        """Of which vehicles the mirror knew the route, step by step."""
        self.refills: list[Any] = []
        self.corrected: list[set[str]] = []
        self.departed: tuple[str, ...] = ()
        self.routes_in_sumo: dict[str, str] = {}
        self.leader: tuple[str, float] | None = None
        self.deferred: set[str] = set()
        vehicles: Any = SimpleNamespace(
            getIDList=lambda: tuple(self.lanes),
            getRouteID=lambda name: self.routes_in_sumo.get(name, route_id(name)),
            getAllSubscriptionResults=self.results,
        )
        sumo = SimpleNamespace(
            vehicle=vehicles,
            simulation=SimpleNamespace(getStartingTeleportIDList=lambda: ()),
            trafficlight=SimpleNamespace(getIDList=lambda: ("J",), getRedYellowGreenState=lambda _signal: "rrrrr"),
            start=lambda _words: None,
            close=lambda: None,
            simulationStep=lambda: None,
            TraCIException=libsumo.TraCIException,
        )
        monkeypatch.setattr(simulation_module, "libsumo", sumo)
        monkeypatch.setattr(simulation_module, "emv_advice", lambda *arguments: arguments)
        continuity = SimpleNamespace(correct=lambda _columns, moved: self.corrected.append(set(moved)))
        monkeypatch.setattr(rules, "LaneContinuity", lambda _: continuity)
        self.population = SimpleNamespace(
            vehicles={name: planned(name) for name in (EMV, AV, CAR)},
            length_scale=defaultdict(lambda: 1.0),
            scale_of=lambda _: 1.0,
            civilians=1,
            emv_starts=[],
            enter_background=lambda: None,
            enter_stage=lambda: None,
            drop_departed=lambda: self.departed,
            take_in_own=lambda: None,
            refill=lambda points, civilians: self.refills.append((points, civilians)),
        )
        self.mirror = SimpleNamespace(
            places={},
            deferred=lambda: self.deferred,
            realigned={},
            forget=self.forgotten.append,
            apply=lambda *given: self.routes_of_mirror.append(set(given[-1])),
            check_placed=lambda _columns: None,
        )
        self.crossings = CrossingWatch(NETWORK)
        reactions = SimpleNamespace(
            rescued=lambda names, *_: {EMV: [name for name in names if name == CAR]},
            flags=lambda names, *_: np.zeros(len(names), np.uint8),
        )
        made = {
            "SumoPopulation": self.population,
            "Mirror": self.mirror,
            "CrossingWatch": self.crossings,
            "Reactions": reactions,
            "vehicle_types_xml": b"",
        }
        for name, part in made.items():
            monkeypatch.setattr(simulation_module, name, lambda *_, part=part: part)
        nobody = dict.fromkeys(("groups", "background", "reserve", "riders", "walkers"), ())
        plan: Any = SimpleNamespace(
            emvs=(planned(EMV),),
            av=AV,
            own=None,
            civilians=2,
            jam=None,
            signal=None,
            signals_behind=(),
            warm_up_steps=0,
            traffic=None,
            **nobody,
        )
        compiled_map: Any = SimpleNamespace(net_path="streets.net.xml")
        self.simulation = Corrected(compiled_map, NETWORK, plan, EmergencyLevel.L2)

    def results(self) -> dict[str, dict[int, Any]]:
        results = {}
        for name, lane in self.lanes.items():
            x, y = (float(value) for value in NETWORK.lanes[lane].centre.at(self.front_m[name]))
            results[name] = {
                libsumo.VAR_POSITION: (x, y),
                libsumo.VAR_ANGLE: 90.0,
                libsumo.VAR_SPEED: self.speed_mps,
                libsumo.VAR_ACCELERATION: 0.0,
                libsumo.VAR_LANE_ID: NETWORK.lanes[lane].lane_id,
                libsumo.VAR_LANEPOSITION: self.front_m[name],
                libsumo.VAR_LANEPOSITION_LAT: 0.25,
                libsumo.VAR_SIGNALS: 0,
                libsumo.VAR_ROUTE_INDEX: self.index,
            }
        return results

    def step(self, step: int, states: ActorStates | None = None) -> Any:
        return self.simulation.step(step, states)


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    stage = Stage(monkeypatch)
    with stage.simulation:
        yield stage


def driven(step: int, name: str = EMV, owner: Owner = Owner.ROS, **fields: float) -> ActorStates:
    return states_of(step, [{"actor_id": IDS[name], "x_m": -205.5, "y_m": -1.2, "owner": owner, **fields}])


def test_the_first_step_describes_everybody_and_numbers_them_in_order_of_entry(stage: Stage) -> None:
    state = stage.step(0)
    assert [actor.name for actor in state.spawned] == [EMV, AV, CAR]
    assert state.actor_id.tolist() == [1, 2, 3]
    assert state.owner.tolist() == [Owner.SUMO] * 3
    assert state.x_m == pytest.approx([-310.0 + 100.0 - CAR_M / 2] * 3)
    stage.lanes[OTHER], stage.front_m[OTHER] = A_RIGHT, 20.0
    stage.population.vehicles[OTHER] = planned(OTHER)
    again = stage.step(1, ActorStates.empty(0))
    assert [actor.actor_id for actor in again.spawned] == [4]


def test_siren_and_beacon_are_the_emvs_alone(stage: Stage) -> None:
    both = Lights.BEACON | Lights.SIREN
    assert [Lights(value) & both for value in stage.step(0).lights.tolist()] == [both, Lights.NONE, Lights.NONE]


def test_poses_are_the_simulated_ones_where_there_are_some(stage: Stage) -> None:
    stage.step(0)
    states = driven(0, x_m=-205.5, y_m=-1.2, yaw_rad=0.3, vx_mps=3.0, vy_mps=4.0)
    stage.mirror.places = {EMV: place(A_RIGHT, 104.0, 0.4)}
    state = stage.step(1, states)
    assert state.owner.tolist() == [Owner.ROS, Owner.SUMO, Owner.SUMO]
    assert (state.x_m[0], state.y_m[0], state.yaw_rad[0], state.speed_mps[0]) == (-205.5, -1.2, 0.3, 5.0)
    assert (state.sumo_yaw_rad[0], state.sumo_speed_mps[0]) == (0.0, 8.0)
    assert (state.x_m[1], state.yaw_rad[1], state.speed_mps[1]) == (state.sumo_x_m[1], 0.0, 8.0)
    assert state.lane.tolist() == [A_RIGHT, A_LEFT, A_LEFT]
    assert state.lane_position_m.tolist() == [104.0, 100.0, 100.0]
    assert state.lateral_offset_m.tolist() == [0.4, 0.25, 0.25]


@pytest.mark.parametrize(("owner", "speed_mps"), [(Owner.ROS, 5.0), (Owner.SUMO, 8.0)])
def test_a_stop_line_is_crossed_with_the_speed_of_who_drives(stage: Stage, owner: Owner, speed_mps: float) -> None:
    stage.lanes[EMV] = B_LEFT
    stage.step(0)
    stage.lanes[EMV] = STRAIGHT_INSIDE
    stage.front_m[EMV] = 1.0
    (event,) = stage.step(1, driven(0, owner=owner, vx_mps=3.0, vy_mps=4.0)).events
    assert (event.kind, event.actor_id) == (EventKind.STOP_LINE_CROSSED, 1)
    assert event.detail["speed_mps"] == speed_mps
    assert event.detail["signal_state"] == "r"


STRAIGHT_INSIDE = NETWORK.connections[STRAIGHT_LEFT].via[0]


def test_who_is_put_off_the_road_and_comes_back_has_crossed_nothing(stage: Stage) -> None:
    stage.step(0)
    for step, lane in ((1, -1), (2, A_LEFT), (3, -1)):
        stage.mirror.places = {EMV: place(lane)}
        state = stage.step(step, driven(step - 1))
        assert state.lane[0] == lane
        assert state.events == ()


def test_a_stop_line_that_is_passed_off_the_road_is_crossed(stage: Stage) -> None:
    """From the approach over the verge onto the path across."""
    stage.step(0)
    events = []
    for step, lane in enumerate((B_LEFT, -1, -1, STRAIGHT_INSIDE), start=1):
        stage.mirror.places = {EMV: place(lane)}
        events += [(step, event.kind) for event in stage.step(step, driven(step - 1)).events]
    assert events == [(4, EventKind.STOP_LINE_CROSSED)]


def test_whoever_was_brought_back_is_told_and_not_corrected_again(stage: Stage) -> None:
    stage.step(0)
    stage.mirror.realigned = {3: 2.5}
    stage.mirror.places = {EMV: place(A_LEFT)}
    state = stage.step(1, driven(0))
    assert stage.corrected[-1] == {EMV, CAR}
    (event,) = state.events
    assert (event.kind, event.actor_id, event.detail) == (EventKind.REALIGNED, 3, {"residual_m": 2.5})


def is_elsewhere(stage: Stage, actor_id: int, lane: int) -> bool:
    return stage.crossings.elsewhere(np.array([actor_id], np.uint32), np.array([lane], np.int32)) == [0]


def test_everything_of_a_vehicle_that_leaves_is_forgotten(stage: Stage) -> None:
    stage.lanes[CAR] = B_LEFT
    stage.step(0)
    assert not is_elsewhere(stage, 3, B_LEFT)
    stage.departed = (CAR, AV, "never seen")
    for name in (CAR, AV):
        del stage.lanes[name], stage.population.vehicles[name]
    state = stage.step(1, ActorStates.empty(0))
    assert state.removed.tolist() == [2, 3]
    assert state.actor_id.tolist() == [1]
    assert set(stage.forgotten) == set(stage.departed)
    assert is_elsewhere(stage, 3, B_LEFT)
    stage.departed, stage.lanes[CAR], stage.population.vehicles[CAR] = (), B_LEFT, planned(CAR)
    back = stage.step(2, ActorStates.empty(1))
    assert stage.routes_of_mirror == [set(), {EMV, AV, CAR}, {EMV}]
    assert back.actor_id.tolist() == [1, 3]
    assert back.route_of_row(1).tolist() == [A, B, C]


def test_replacements_keep_away_from_the_emvs_alone(stage: Stage) -> None:
    stage.step(0)
    assert stage.refills == []
    states = states_of(0, [{"actor_id": number, "x_m": 10.0 * number, "y_m": -number} for number in (1, 2, 3, 9)])
    stage.step(1, states)
    assert stage.refills == [([(10.0, -1.0)], 2)]


def test_who_makes_way_is_a_civilian_that_ros_drives(stage: Stage) -> None:
    """Neither the EMV nor the AV under test counts, which ROS drives for other reasons."""
    stage.step(0)
    stage.mirror.places = {name: place(A_LEFT) for name in (EMV, AV, CAR)}
    ((name, ids, yielding, *_, min_gap_m, rescued),) = stage.step(1, driven(0)).emvs
    assert (name, ids[name], min_gap_m, rescued) == (EMV, 1, 2.0, 1)
    assert yielding == {CAR}


def test_who_waits_for_a_gap_makes_way_too(stage: Stage) -> None:
    """Otherwise the EMV changes to the lane to which the vehicle ahead is about to go."""
    stage.deferred = {CAR}
    ((_, _, yielding, *_),) = stage.step(0).emvs
    assert yielding == {CAR}


def edges_ahead(stage: Stage, step: int, name: str) -> tuple[int, ...]:
    state = stage.step(step, None)
    return tuple(state.route_of_row(state.actor_id.tolist().index(IDS[name])).tolist())


def test_the_route_ahead_of_a_mirrored_vehicle_follows_the_lane_that_it_was_put_on(stage: Stage) -> None:
    """Not SUMO's place on the route: there SUMO counts what it found."""
    assert edges_ahead(stage, 0, EMV) == (A, B, C)
    stage.index = 7
    put = (B_LEFT, (B, C)), (STRAIGHT_INSIDE, (B, C)), (-1, (B, C)), (C_LEFT, (C,)), (A_LEFT, (C,))
    for step, (lane, ahead) in enumerate(put, start=1):
        stage.mirror.places = {EMV: place(lane)}
        assert edges_ahead(stage, step, EMV) == ahead


def test_a_vehicle_of_sumos_has_sumos_place_on_its_planned_route(stage: Stage) -> None:
    assert edges_ahead(stage, 0, CAR) == (A, B, C)
    stage.index = 1
    assert edges_ahead(stage, 1, CAR) == (B, C)
    stage.index, stage.routes_in_sumo = 2, {CAR: "another"}
    assert edges_ahead(stage, 2, CAR) == (B, C), "the number counts along another route"
    stage.routes_in_sumo = {}
    assert edges_ahead(stage, 3, CAR) == (C,)


def test_a_vehicle_that_waits_to_enter_has_its_whole_route_ahead(stage: Stage) -> None:
    """SUMO counts from -1 then."""
    stage.index = -1
    assert edges_ahead(stage, 0, CAR) == (A, B, C)


def test_a_teleport_that_sumo_tells_is_an_event(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    stage.step(0)
    starting = SimpleNamespace(getStartingTeleportIDList=lambda: (CAR, "never seen"))
    monkeypatch.setattr(simulation_module.libsumo, "simulation", starting)
    (event,) = stage.step(1, ActorStates.empty(0)).events
    assert isinstance(event, Event)
    assert (event.kind, event.actor_id, event.detail) == (EventKind.TELEPORT, 3, {"reason": "sumo"})
