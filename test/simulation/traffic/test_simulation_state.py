"""What the simulation makes of SUMO's answers at one step, with a stand-in for SUMO: ids, routes, events, removals."""

from collections import defaultdict
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import libsumo
import numpy as np
import pytest
from made_streets import A_LEFT, A_RIGHT, B_LEFT, C_LEFT, CAR_M, STRAIGHT_LEFT, A, B, C, streets
from traffic_helpers import states_of

from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic import simulation as simulation_module
from siren_ros.simulation.traffic.observation import CrossingWatch
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo import rules
from siren_ros.simulation.traffic.sumo.mirror import LaneMatch, Place
from siren_ros.simulation.traffic.sumo.population import route_id
from siren_ros.simulation.traffic.sumo.rules import RULES, Moment
from siren_ros.simulation.world.actors import ActorClass, ActorStates, Lights, Owner
from siren_ros.simulation.world.traffic_state import Event, EventKind

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
            emvs=(planned(EMV),), av=AV, civilians=2, jam=None, signal=None, warm_up_steps=0, traffic=None, **nobody
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
