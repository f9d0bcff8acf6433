"""SUMO's subscription results as arrays: along the lanes' geometric lengths, in our frame, with our light codes."""

from collections.abc import Mapping
from typing import Any

import libsumo
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_streets import A_LEFT, NEAR, streets
from traffic_helpers import columns_of

from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.traffic.sumo.readings import (
    ahead_on_route,
    emv_advice,
    intent_flags,
    joined_rows,
    lane_change_intent,
    map_from_sumo,
    read_vehicles,
    sumo_from_map,
)
from siren_ros.simulation.world.actors import NO_ACTOR, Lights, TrafficFlags

NETWORK = streets()
LEFT, RIGHT, BRAKE = Lights.INDICATOR_LEFT, Lights.INDICATOR_RIGHT, Lights.BRAKE


def result(lane_id: str, angle_deg: float, signals: int = 8) -> Mapping[int, Any]:
    return {
        libsumo.VAR_POSITION: (100.0, 50.0),
        libsumo.VAR_ANGLE: angle_deg,
        libsumo.VAR_SPEED: 12.0,
        libsumo.VAR_ACCELERATION: -3.0,
        libsumo.VAR_LANE_ID: lane_id,
        libsumo.VAR_LANEPOSITION: 30.0,
        libsumo.VAR_LANEPOSITION_LAT: -0.4,
        libsumo.VAR_SIGNALS: signals,
        libsumo.VAR_ROUTE_INDEX: 2,
    }


def test_motion_is_along_the_geometric_length_of_the_lane() -> None:
    """SUMO's first lane is twice as long as its centre line; the other vehicle is off the road."""
    lane_id = NETWORK.lanes[A_LEFT].lane_id
    results = {"on": result(lane_id, 90.0), "off": result("", 0.0)}
    scale = {lane_id: 2.0, NETWORK.lanes[NEAR].lane_id: 7.0}
    columns = columns_of(results, NETWORK, scale)
    rows = np.array([columns.row_of["off"], columns.row_of["on"]])
    readings = read_vehicles(columns, rows, np.array([4.0, 6.0]), NETWORK.sumo_offset_m)
    assert readings.lane.tolist() == [NO_LANE, A_LEFT]
    assert readings.speed_mps.tolist() == [12.0, 6.0]
    assert readings.accel_mps2.tolist() == [-3.0, -1.5]
    assert readings.lane_position_m.tolist() == [0.0, 15.0]
    assert readings.lateral_m.tolist() == [0.0, -0.4]
    assert readings.lights.tolist() == [BRAKE, BRAKE]
    assert readings.route_index.tolist() == [2, 2]
    assert readings.x_m == pytest.approx([100.0, 97.0])
    assert readings.y_m == pytest.approx([48.0, 50.0])
    assert readings.yaw_rad == pytest.approx([np.pi / 2.0, 0.0])


@pytest.mark.parametrize(
    ("bits", "lights"),
    [(0, 0), (1, RIGHT), (2, LEFT), (4, LEFT | RIGHT), (8, BRAKE), (9, BRAKE | RIGHT), (10, BRAKE | LEFT), (16, 0)],
)
def test_sumos_signals_are_our_lights(bits: int, lights: int) -> None:
    """Bits of SUMO: 0 right, 1 left, 2 hazard, 3 brake; higher ones have no light of ours."""
    columns = columns_of({"v": result("", 0.0, bits)}, NETWORK, {})
    assert read_vehicles(columns, np.array([0]), np.array([4.0]), (0.0, 0.0)).lights.tolist() == [lights]


def test_columns_are_the_same_objects_while_nothing_changes() -> None:
    lane_id, other_id = NETWORK.lanes[A_LEFT].lane_id, NETWORK.lanes[NEAR].lane_id
    columns = columns_of({"a": result(lane_id, 0.0), "b": result(lane_id, 0.0)}, NETWORK, {lane_id: 2.0})
    names, lane_ids, indices = columns.names, columns.lane_ids, columns.route_index
    columns.take({"a": result(lane_id, 9.0), "b": result(lane_id, 9.0)})
    assert (columns.names is names, columns.lane_ids is lane_ids, columns.route_index is indices) == (True,) * 3
    columns.take({"a": result(lane_id, 9.0), "b": result(other_id, 9.0)})
    assert columns.lane.tolist() == [A_LEFT, NEAR]
    assert columns.scale.tolist() == [2.0, 1.0]
    assert columns.names is names
    columns.leave_out(("a", "nobody"))
    assert columns.names == ["b"]
    assert columns.lane.tolist() == [NEAR]
    assert columns.which({"b", "a"}).tolist() == [True]
    assert columns.which(()).tolist() == [False]
    columns.take({})
    assert columns.numbers.shape == (9, 0)


def test_lists_of_different_lengths_become_one() -> None:
    offsets, values = joined_rows([[1, 2], [], [3]])
    assert (offsets.tolist(), values.tolist()) == ([0, 2, 2, 3], [1, 2, 3])
    assert joined_rows([])[0].tolist() == [0]


LEFT_ADVICE, RIGHT_ADVICE = 1 << 1, 1 << 2
STRATEGIC, COOPERATIVE, SPEED_GAIN, KEEP_RIGHT = 1 << 3, 1 << 4, 1 << 5, 1 << 6
SUBLANE, UNKNOWN = 1 << 7, 1 << 30
IDS = {"emv": 1, "leader": 7, "other": 9}


@pytest.fixture(name="sumo")
def _sumo(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Wishes to the left and to the right, the leader with its gap, and the free speed."""
    sumo: dict[str, Any] = {1: 0, -1: 0, "leader": None, "speed": 12.0}
    monkeypatch.setattr(libsumo.vehicle, "getLaneChangeState", lambda _, side: (sumo[side], 0))
    monkeypatch.setattr(libsumo.vehicle, "getLeader", lambda _, reach: sumo["leader"] if reach == 80.0 else None)
    monkeypatch.setattr(libsumo.vehicle, "getSpeedWithoutTraCI", lambda _: sumo["speed"])
    return sumo


@pytest.mark.parametrize("reason", [STRATEGIC, COOPERATIVE, SPEED_GAIN, KEEP_RIGHT])
def test_a_wish_counts_on_its_side_with_a_reason(sumo: dict[str, Any], reason: int) -> None:
    for side, bit, flag in ((1, LEFT_ADVICE, TrafficFlags.WANTS_LEFT), (-1, RIGHT_ADVICE, TrafficFlags.WANTS_RIGHT)):
        for wish, intent in (
            (bit | reason, side),
            (bit, 0),
            (reason, 0),
            (bit | SUBLANE, 0),
            (bit | reason | UNKNOWN, 0),
        ):
            sumo.update({1: 0, -1: 0, side: wish})
            assert lane_change_intent("emv") == intent
            assert intent_flags("emv") == (flag if intent else TrafficFlags.NONE)
    sumo.update({1: RIGHT_ADVICE | reason, -1: LEFT_ADVICE | reason})
    assert lane_change_intent("emv") == 0, "of a question about the left the right is no answer"
    sumo.update({1: LEFT_ADVICE | reason, -1: RIGHT_ADVICE | reason})
    assert lane_change_intent("emv") == 1


def advised(sumo: dict[str, Any], leader: object, yielding: tuple[str, ...] = ()) -> Any:
    sumo["leader"] = leader
    return emv_advice("emv", IDS, yielding, 80.0, 2.5, 3)


@pytest.mark.parametrize("reason", [SPEED_GAIN, KEEP_RIGHT])
@pytest.mark.parametrize(
    ("leader", "yielding", "counts"),
    [
        (("leader", 39.9), (), True),
        (("leader", 40.1), (), False),
        (("leader", 20.0), ("leader",), False),
        (("leader", 20.0), ("other",), True),
        (("stranger", 20.0), (), False),
        (None, (), False),
    ],
)
def test_wishes_that_come_from_a_leader_count_while_it_holds_up_the_emv(
    sumo: dict[str, Any], reason: int, leader: object, yielding: tuple[str, ...], counts: bool
) -> None:
    sumo[1] = LEFT_ADVICE | reason
    assert advised(sumo, leader, yielding).lane_change_intent == int(counts)
    for other_reason in (STRATEGIC, COOPERATIVE):
        sumo[1] = LEFT_ADVICE | other_reason
        assert advised(sumo, leader, yielding).lane_change_intent == 1, "the others need no leader"


def test_the_leaders_gap_is_from_bumper_to_bumper_and_without_one_the_range(sumo: dict[str, Any]) -> None:
    advice = advised(sumo, ("leader", 11.0))
    assert (advice.leader_id, advice.leader_gap_m, advice.speed_without_control_mps) == (7, 13.5, 12.0)
    assert (advice.actor_id, advice.rescue_count) == (1, 3)
    for nobody in (None, ("stranger", 11.0)):
        advice = advised(sumo, nobody)
        assert (advice.leader_id, advice.leader_gap_m) == (NO_ACTOR, 80.0)


@pytest.mark.parametrize("turn", np.radians([0.0, 40.0, -120.0]))
def test_who_hears_the_siren_is_on_the_route_ahead_and_within_reach(turn: float) -> None:
    """On the EMV's own edge only ahead of it; on the later ones anywhere."""
    along, left = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    emv = np.array([30.0, -20.0])
    places = [(10.0, 0.0), (-10.0, 0.0), (39.0, 8.0), (40.1, 0.0), (-5.0, 30.0), (20.0, 3.0), (-0.1, 3.0), (0.1, -3.0)]
    edges = np.array([4, 4, 5, 5, 5, 9, 4, 4], dtype=np.int32)
    points = np.array([emv, *(emv + ahead * along + aside * left for ahead, aside in places), emv + along])
    poses = (*points.T.copy(), np.full(len(points), turn))
    routes = [[4, 5, 6], *([edge, 99] for edge in edges.tolist()), []]
    assert ahead_on_route(0, poses, *joined_rows(routes), 40.0).tolist() == [1, 3, 5, 8]
    assert ahead_on_route(0, poses, *joined_rows([[], *routes[1:]]), 40.0).tolist() == []


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-3.1, 3.1), st.floats(1.0, 20.0))
def test_centre_to_front_bumper_and_back(x: float, y: float, yaw: float, length: float) -> None:
    offset = (109.34, 135.96)
    back = map_from_sumo(*sumo_from_map(x, y, yaw, length, offset), length, offset)
    assert np.allclose(back, (x, y, yaw), atol=1e-9)


@pytest.mark.parametrize(
    ("yaw", "front", "angle"),
    [
        (0.0, (12.0, 0.0), 90.0),
        (np.pi / 2, (10.0, 2.0), 0.0),
        (np.pi, (8.0, 0.0), 270.0),
        (-np.pi / 2, (10.0, -2.0), 180.0),
    ],
)
def test_front_bumper_and_angle_clockwise_from_north(yaw: float, front: tuple[float, float], angle: float) -> None:
    x, y, degrees = sumo_from_map(10.0, 0.0, yaw, 4.0, (0.0, 0.0))
    assert (float(x), float(y)) == pytest.approx(front)
    assert float(degrees) == pytest.approx(angle, abs=1e-9)
