"""The checks of every step."""

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hand_made_record import EMV, NORTHBOUND, Driven, crossing, hand_made
from made_streets import B_LEFT, B_RIGHT, C_RIGHT, STRAIGHT, STRAIGHT_LEFT, streets
from traffic_helpers import load_map

from siren_ros.base.numerics.arrays import Codes
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.simulation.roads.road_network import Connection, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic import observation as reactions_module
from siren_ros.simulation.traffic.observation import (
    ADVICE_RANGE_M,
    CrossingWatch,
    Mover,
    Reactions,
    check_no_teleport,
    check_residual,
    find_teleports,
)
from siren_ros.simulation.traffic.sumo.readings import joined_rows
from siren_ros.simulation.world.actors import RESIDUAL_LIMIT_M, Event, EventKind, Owner, TrafficFlags

RECORD = hand_made(crossing(), {EMV: Driven(NORTHBOUND, np.zeros(2)), 2: Driven(NORTHBOUND, np.full(2, 30.0))})


def with_residuals(*residual_m):
    return replace(RECORD.states[1], residual_m=np.array(residual_m))


def test_the_largest_residual_counts():
    check_residual(with_residuals(RESIDUAL_LIMIT_M, 0.0))
    with pytest.raises(EpisodeError, match=r"actor 2 is 3\.50 m .* at step 1; the limit is 3 m"):
        check_residual(with_residuals(0.1, 3.5), limit_m=3.0)
    with pytest.raises(EpisodeError, match="actor 1 "):
        check_residual(with_residuals(RESIDUAL_LIMIT_M + 0.01, 0.0))


def test_a_teleport_fails_and_other_events_do_not():
    traffic = RECORD.traffic[0]
    check_no_teleport(replace(traffic, events=(Event(0, EventKind.COLLISION, 1, 2),)))
    events = (Event(4, EventKind.REALIGNED, 2), Event(4, EventKind.TELEPORT, 2, detail={"reason": "jump"}))
    with pytest.raises(EpisodeError, match=r"teleported actor 2 at step 4 \(jump\)"):
        check_no_teleport(replace(traffic, events=events))


NETWORK = load_map(None)[1]


def movement(*, signal: bool) -> Connection:
    return next(
        connection
        for connection in NETWORK.connections
        if connection.via
        and NETWORK.lanes[connection.from_lane].kind is LaneKind.DRIVING
        and (connection.signal_id is not None if signal else connection.must_stop)
    )


def mover(lane: int) -> Mover:
    return Mover(actor_id=7, lane=lane, x_m=1.0, y_m=2.0, speed_mps=9.0)


def events_on(
    *lanes: int, signals: Mapping[str, str] | None = None, network: RoadNetwork = NETWORK
) -> list[tuple[Event, ...]]:
    """Events of a vehicle that is on one lane after the other, step by step."""
    watch = CrossingWatch(network)
    return [watch.watch(step, mover(lane), signals or {}) for step, lane in enumerate(lanes)]


@pytest.mark.parametrize("letter", ["r", "G"])
def test_crossing_at_a_signal_tells_its_state_and_leaving_the_junction(letter: str) -> None:
    connection = movement(signal=True)
    state = {str(connection.signal_id): "y" * connection.signal_link + letter + "y" * 40}
    via, onward = connection.via[0], connection.to_lane
    before, (crossed,), inside, (left,), after = events_on(
        connection.from_lane, via, via, onward, onward, signals=state
    )
    assert before == inside == after == ()
    assert (crossed.kind, left.kind) == (EventKind.STOP_LINE_CROSSED, EventKind.JUNCTION_LEFT)
    assert (crossed.detail["signal_state"], crossed.detail["speed_mps"]) == (letter, 9.0)
    assert crossed.detail["junction"] == left.detail["junction"] == connection.junction


def test_crossing_a_stop_line_has_no_signal_state() -> None:
    connection = movement(signal=False)
    _, (crossed,) = events_on(connection.from_lane, connection.via[0])
    assert (crossed.detail["must_stop"], crossed.detail["signal_state"]) == (1, "")


def test_a_lane_change_at_the_line_does_not_hide_the_crossing() -> None:
    """From one step to the next a vehicle leaves its lane and enters the path that begins at the lane next to it."""
    state = dict.fromkeys({str(connection.signal_id) for connection in NETWORK.connections}, "G" * 60)
    tried = 0
    for connection in NETWORK.connections:
        if connection.signal_id is None or not connection.via:
            continue
        for source in NETWORK.edges[NETWORK.lanes[connection.from_lane].edge].lanes:
            movements = NETWORK.connections_from.get(source, ())
            leads_there = any(connection.via[0] in way.via or connection.to_lane == way.to_lane for way in movements)
            if source == connection.from_lane or leads_there:
                continue
            _, (crossed,), (left,) = events_on(source, connection.via[0], connection.to_lane, signals=state)
            assert (crossed.kind, left.kind) == (EventKind.STOP_LINE_CROSSED, EventKind.JUNCTION_LEFT)
            assert (crossed.detail["junction"], crossed.detail["signal_state"]) == (connection.junction, "G")
            tried += 1
    assert tried > 5


def test_a_lane_change_on_the_road_crosses_nothing() -> None:
    edge = next(edge for edge in NETWORK.edges if len(edge.lanes) > 1 and not edge.internal)
    assert events_on(*edge.lanes[:2])[1] == ()


@pytest.mark.parametrize(("lane", "letter"), [(B_RIGHT, "r"), (B_LEFT, "G")])
def test_where_two_lanes_lead_into_one_the_letter_is_that_of_the_own_lane(lane: int, letter: str) -> None:
    """Also where the path across was missed between two steps."""
    roads = streets()
    connections = list(roads.connections)
    connections[STRAIGHT_LEFT] = replace(connections[STRAIGHT_LEFT], to_lane=C_RIGHT)
    network = replace(roads, connections=tuple(connections))
    letters = "".join("G" if link == connections[STRAIGHT_LEFT].signal_link else "r" for link in range(8))
    assert connections[STRAIGHT].to_lane == C_RIGHT
    _, (crossed,) = events_on(lane, C_RIGHT, signals={"J": letters}, network=network)
    assert crossed.detail["signal_state"] == letter


def test_who_left_inside_a_junction_has_not_been_in_it_when_the_number_comes_again() -> None:
    connection = movement(signal=True)
    watch = CrossingWatch(NETWORK)
    assert watch.watch(0, mover(connection.via[0]), {}) == ()
    assert watch.watch(0, mover(connection.to_lane), {}) == (), "first seen inside"
    watch.watch(0, mover(connection.from_lane), {})
    watch.watch(1, mover(connection.via[0]), {})
    watch.forget(7)
    assert watch.watch(2, mover(connection.via[0]), {}) == ()
    assert watch.watch(3, mover(connection.to_lane), {}) == ()
    watch.watch(4, mover(connection.from_lane), {})
    watch.forget(7)
    assert watch.watch(5, mover(connection.via[0]), {}) == ()


NETWORK_REACTIONS = crossing()
NEAR_M = ADVICE_RANGE_M - 1.0
NAMES = ["emv0", "emv1", "by0", "by1", "between"]
X_M = np.array([0.0, 1000.0, NEAR_M, 1000.0 - NEAR_M, 500.0])
ROAD = next(lane.index for lane in NETWORK_REACTIONS.lanes if lane.kind is LaneKind.DRIVING)
PATH = next(lane.index for lane in NETWORK_REACTIONS.lanes if lane.kind is LaneKind.INTERNAL)


def readings(lanes: list[int] | None = None) -> Any:
    count = len(X_M)
    lane = np.array(lanes or [ROAD] * count, dtype=np.int32)
    return SimpleNamespace(x_m=X_M, y_m=np.zeros(count), yaw_rad=np.zeros(count), lane=lane)


def flagged(flags: Codes, mask: int) -> list[str]:
    return [name for name, flag in zip(NAMES, flags.tolist(), strict=True) if flag & mask]


def reactions_to(*emvs: str) -> Reactions:
    plan: Any = SimpleNamespace(emvs=tuple(SimpleNamespace(name=emv) for emv in emvs), response_distance_m=30.0)
    return Reactions(NETWORK_REACTIONS, plan, EmergencyLevel.L2)


@pytest.fixture(name="reactions")
def _reactions(monkeypatch: pytest.MonkeyPatch) -> Reactions:
    """Two EMVs; everybody wants to the left."""
    assert ADVICE_RANGE_M < 490.0
    monkeypatch.setattr(reactions_module, "intent_flags", lambda _name: TrafficFlags.WANTS_LEFT)
    return reactions_to("emv0", "emv1")


def test_flags_tell_of_wishes_near_each_emv_of_who_reacts_to_either_siren_and_of_paths_across(
    reactions: Reactions,
) -> None:
    rescued = {"emv0": ["by0"], "emv1": ["by1", "between"]}
    flags = reactions.flags(NAMES, readings([ROAD, PATH, -1, ROAD, PATH]), rescued)
    assert flagged(flags, TrafficFlags.WANTS_LEFT) == ["emv0", "emv1", "by0", "by1"]
    assert flagged(flags, TrafficFlags.RESCUE_LANE) == ["by0", "by1", "between"]
    assert flagged(flags, TrafficFlags.ON_JUNCTION) == ["emv1", "between"]
    flags = reactions.flags(["gone", *NAMES[1:]], readings(), {"emv0": [], "emv1": []})
    assert flagged(flags, 0xFF) == ["emv1", "by1"], "of an EMV that has left nothing is told"


def listening(routes: list[list[int]], x_m: list[float]) -> list[str]:
    """Who hears an EMV that drives east on edge 0."""
    count = len(x_m)
    there: Any = SimpleNamespace(x_m=np.array(x_m), y_m=np.zeros(count), yaw_rad=np.zeros(count))
    names = ["emv0", *(f"car{number}" for number in range(1, count))]
    return reactions_to("emv0").rescued(names, there, *joined_rows(routes))["emv0"]


def test_who_is_ahead_on_the_emvs_route_within_reach_hears_it() -> None:
    routes = [[0, 1], [0], [1], [5], [0], [0]]
    assert listening(routes, [0.0, 20.0, 29.0, 10.0, 31.0, -5.0]) == ["car1", "car2"]


def test_an_emv_on_the_way_of_another_one_is_none_that_makes_way() -> None:
    reactions = reactions_to("emv0", "emv1")
    there: Any = SimpleNamespace(x_m=np.array([0.0, 10.0, 20.0]), y_m=np.zeros(3), yaw_rad=np.zeros(3))
    reacting = reactions.rescued(["emv0", "emv1", "car"], there, *joined_rows([[0, 1]] * 3))
    assert reacting == {"emv0": ["car"], "emv1": ["car"]}


LENGTH = 4.0
JUMP = 0.5
TURNS = np.radians([0.0, 50.0, 120.0, -100.0])


def column(*values):
    return np.array(values, dtype=float)


def teleports(
    moved, turn=0.0, swing=0.0, speeds=(8.0, 8.0), owners=(Owner.SUMO, Owner.SUMO), started=(), on_purpose=()
):
    """Events of actor 7, whose front moves along a direction, while its rod swings about the front."""
    then, now = turn, turn + swing
    front = np.array([30.0, -10.0])
    after = front + moved * np.array([np.cos(turn), np.sin(turn)])
    before = front - 0.5 * LENGTH * np.array([np.cos(then), np.sin(then)])
    centre = after - 0.5 * LENGTH * np.array([np.cos(now), np.sin(now)])
    last = SimpleNamespace(
        actor_id=np.array([3, 7], np.uint32),
        owner=np.array([Owner.SUMO, owners[0]], np.uint8),
        sumo_x_m=column(0.0, before[0]),
        sumo_y_m=column(0.0, before[1]),
        sumo_yaw_rad=column(0.0, then),
        sumo_speed_mps=column(0.0, speeds[0]),
    )
    readings = SimpleNamespace(
        x_m=column(centre[0]), y_m=column(centre[1]), yaw_rad=column(now), speed_mps=column(speeds[1])
    )
    ids, owner = np.array([7], np.uint32), np.array([owners[1]], np.uint8)
    return find_teleports(12, ids, readings, column(LENGTH), owner, started, on_purpose, last, JUMP)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_front_that_moves_farther_than_the_speed_explains_has_jumped(turn, way):
    most = 8.0 * STEP_S + JUMP
    assert teleports(way * (most - 0.01), turn) == []
    (event,) = teleports(way * (most + 0.01), turn)
    assert (event.kind, event.actor_id, event.step, event.detail["reason"]) == (EventKind.TELEPORT, 7, 12, "jump")
    front = np.array([30.0, -10.0]) + way * (most + 0.01) * np.array([np.cos(turn), np.sin(turn)])
    centre = front - 0.5 * LENGTH * np.array([np.cos(turn), np.sin(turn)])
    assert (event.x_m, event.y_m) == pytest.approx(tuple(centre))


@pytest.mark.parametrize("swing", [1.5, -1.5])
def test_a_rod_that_swings_behind_its_front_has_not_jumped(swing):
    assert teleports(0.4, 0.6, swing) == []


@pytest.mark.parametrize("speeds", [(12.0, 2.0), (2.0, 12.0)])
def test_the_larger_of_both_speeds_explains_the_way(speeds):
    assert teleports(12.0 * STEP_S + JUMP - 0.01, speeds=speeds) == []
    assert len(teleports(12.0 * STEP_S + JUMP + 0.01, speeds=speeds)) == 1


@pytest.mark.parametrize("owners", [(Owner.ROS, Owner.SUMO), (Owner.SUMO, Owner.ROS), (Owner.ROS, Owner.ROS)])
def test_only_vehicles_that_sumo_owned_before_and_after_can_jump(owners):
    assert teleports(9.0, owners=owners) == []


def test_who_was_put_elsewhere_on_purpose_has_not_jumped():
    assert teleports(9.0, on_purpose=(7,)) == []
    assert len(teleports(9.0, on_purpose=(3,))) == 1


def test_what_sumo_calls_a_teleport_is_one_whether_or_not_the_vehicle_is_still_there():
    assert [(event.actor_id, event.detail["reason"]) for event in teleports(9.0, started=(7,))] == [(7, "sumo")]
    gone, present = teleports(0.4, started=(9, 7))[::-1]
    assert (present.actor_id, present.detail["reason"]) == (7, "sumo")
    assert (gone.actor_id, gone.x_m, gone.y_m) == (9, 0.0, 0.0)
