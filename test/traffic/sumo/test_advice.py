"""What SUMO is asked for an EMV, with a stand-in that answers from a table."""

from typing import Any

import libsumo
import numpy as np
import pytest

from siren_ros.traffic.sumo.advice import ahead_on_route, emv_advice, intent_flags, lane_change_intent, rescued_names
from siren_ros.world.actors import NO_ACTOR
from siren_ros.world.traffic_state import TrafficFlags

LEFT, RIGHT = 1 << 1, 1 << 2
STRATEGIC, COOPERATIVE, SPEED_GAIN, KEEP_RIGHT = 1 << 3, 1 << 4, 1 << 5, 1 << 6
SUBLANE, UNKNOWN = 1 << 7, 1 << 30
IDS = {"emv": 1, "leader": 7, "other": 9}


@pytest.fixture(name="told")
def _told(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Wishes to the left and to the right, the leader with its gap, and the free speed."""
    told: dict[str, Any] = {1: 0, -1: 0, "leader": None, "speed": 12.0}
    monkeypatch.setattr(libsumo.vehicle, "getLaneChangeState", lambda _, side: (told[side], 0))
    monkeypatch.setattr(libsumo.vehicle, "getLeader", lambda _, reach: told["leader"] if reach == 80.0 else None)
    monkeypatch.setattr(libsumo.vehicle, "getSpeedWithoutTraCI", lambda _: told["speed"])
    return told


@pytest.mark.parametrize("reason", [STRATEGIC, COOPERATIVE, SPEED_GAIN, KEEP_RIGHT])
def test_a_wish_counts_on_its_side_with_a_reason(told: dict[str, Any], reason: int) -> None:
    for side, bit, flag in ((1, LEFT, TrafficFlags.WANTS_LEFT), (-1, RIGHT, TrafficFlags.WANTS_RIGHT)):
        for wish, found in (
            (bit | reason, side),
            (bit, 0),
            (reason, 0),
            (bit | SUBLANE, 0),
            (bit | reason | UNKNOWN, 0),
        ):
            told.update({1: 0, -1: 0, side: wish})
            assert lane_change_intent("emv") == found
            assert intent_flags("emv") == (flag if found else TrafficFlags.NONE)
    told.update({1: RIGHT | reason, -1: LEFT | reason})
    assert lane_change_intent("emv") == 0, "of a question about the left the right is no answer"
    told.update({1: LEFT | reason, -1: RIGHT | reason})
    assert lane_change_intent("emv") == 1


def advised(told: dict[str, Any], leader: object, yielding: tuple[str, ...] = ()) -> Any:
    told["leader"] = leader
    return emv_advice("emv", 1, IDS, yielding, 80.0, 2.5, 3)


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
    told: dict[str, Any], reason: int, leader: object, yielding: tuple[str, ...], counts: bool
) -> None:
    told[1] = LEFT | reason
    assert advised(told, leader, yielding).lane_change_intent == int(counts)
    for own in (STRATEGIC, COOPERATIVE):
        told[1] = LEFT | own
        assert advised(told, leader, yielding).lane_change_intent == 1, "the others need no leader"


def test_the_leaders_gap_is_from_bumper_to_bumper_and_without_one_the_range(told: dict[str, Any]) -> None:
    found = advised(told, ("leader", 11.0))
    assert (found.leader_id, found.leader_gap_m, found.speed_without_control_mps) == (7, 13.5, 12.0)
    assert (found.actor_id, found.rescue_count) == (1, 3)
    for nobody in (None, ("stranger", 11.0)):
        found = advised(told, nobody)
        assert (found.leader_id, found.leader_gap_m) == (NO_ACTOR, 80.0)


def test_who_reacts_to_which_emv_is_what_each_vehicle_says(monkeypatch: pytest.MonkeyPatch) -> None:
    says = {"a": "emv0", "b": "", "c": "emv1 emv0", "d": "stranger"}
    monkeypatch.setattr(libsumo.vehicle, "getParameter", lambda name, key: says[name] if key == "rescueLane" else "x")
    assert rescued_names("abcd", ("emv0", "emv1", "emv2")) == {"emv0": ["a", "c"], "emv1": ["c"], "emv2": []}


@pytest.mark.parametrize("turn", np.radians([0.0, 40.0, -120.0]))
def test_who_hears_the_siren_is_on_the_route_ahead_and_within_reach(turn: float) -> None:
    """On the EMV's own edge only ahead of it; on the later ones anywhere."""
    along, left = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    emv = np.array([30.0, -20.0])
    places = [(10.0, 0.0), (-10.0, 0.0), (39.0, 8.0), (40.1, 0.0), (-5.0, 30.0), (20.0, 3.0), (-0.1, 3.0), (0.1, -3.0)]
    edges = np.array([4, 4, 5, 5, 5, 9, 4, 4], dtype=np.int32)
    points = emv + np.array([ahead * along + aside * left for ahead, aside in places])
    found = ahead_on_route(emv, turn, (4, 5, 6), points, edges, 40.0)
    assert found.tolist() == [True, False, True, False, True, False, False, True]
    assert not ahead_on_route(emv, turn, (), points, edges, 40.0).any()
