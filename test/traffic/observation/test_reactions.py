"""Flags of vehicles near one or two EMVs, and who hears which siren."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hand_made_record import crossing

from siren_ros.roads.road_network import LaneKind
from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.traffic.observation import reactions as reactions_module
from siren_ros.traffic.observation.reactions import Reactions
from siren_ros.traffic.sumo.config import TrafficConfig
from siren_ros.world.traffic_state import TrafficFlags

NETWORK = crossing()
CONFIG = TrafficConfig()
NEAR_M = CONFIG.advice_range_m - 1.0
NAMES = ["emv0", "emv1", "by0", "by1", "between"]
X_M = np.array([0.0, 1000.0, NEAR_M, 1000.0 - NEAR_M, 500.0])
ROAD = next(lane.index for lane in NETWORK.lanes if lane.kind is LaneKind.DRIVING)
PATH = next(lane.index for lane in NETWORK.lanes if lane.kind is LaneKind.INTERNAL)


def readings(lanes: list[int] | None = None) -> Any:
    count = len(X_M)
    lane = np.array(lanes or [ROAD] * count, dtype=np.int32)
    return SimpleNamespace(x_m=X_M, y_m=np.zeros(count), yaw_rad=np.zeros(count), lane=lane)


@pytest.fixture(name="reactions")
def _reactions(monkeypatch: pytest.MonkeyPatch) -> Reactions:
    """Two EMVs; everybody wants to the left."""
    assert CONFIG.advice_range_m < 490.0
    monkeypatch.setattr(reactions_module, "intent_flags", lambda _name: TrafficFlags.WANTS_LEFT)
    plan: Any = SimpleNamespace(
        emvs=(SimpleNamespace(name="emv0"), SimpleNamespace(name="emv1")), response_distance_m=30.0
    )
    return Reactions(NETWORK, plan, EmergencyLevel.L2, CONFIG)


def test_wishes_are_told_near_each_emv(reactions: Reactions) -> None:
    flags = reactions.flags(NAMES, readings(), {"emv0": [], "emv1": []})
    told = [name for name, flag in zip(NAMES, flags.tolist(), strict=True) if flag & TrafficFlags.WANTS_LEFT]
    assert told == ["emv0", "emv1", "by0", "by1"]


def test_an_emv_that_has_left_tells_nobodys_wishes(reactions: Reactions) -> None:
    there = readings()
    names = ["gone", *NAMES[1:]]
    flags = reactions.flags(names, there, {"emv0": [], "emv1": []})
    told = [name for name, flag in zip(names, flags.tolist(), strict=True) if flag]
    assert told == ["emv1", "by1"]


def test_everybody_who_reacts_to_either_siren_has_the_flag(reactions: Reactions) -> None:
    flags = reactions.flags(NAMES, readings(), {"emv0": ["by0"], "emv1": ["by1", "between"]})
    rescuing = [name for name, flag in zip(NAMES, flags.tolist(), strict=True) if flag & TrafficFlags.RESCUE_LANE]
    assert rescuing == ["by0", "by1", "between"]


def test_vehicles_on_paths_across_are_on_a_junction(reactions: Reactions) -> None:
    lanes = [ROAD, PATH, -1, ROAD, PATH]
    flags = reactions.flags(NAMES, readings(lanes), {"emv0": [], "emv1": []})
    inside = [bool(flag & TrafficFlags.ON_JUNCTION) for flag in flags.tolist()]
    assert inside == [False, True, False, False, True]


def listening(routes: list[list[int]], x_m: list[float]) -> list[str]:
    """Who hears an EMV at L1 (without SUMO's device) that drives east on edge 0."""
    plan: Any = SimpleNamespace(emvs=(SimpleNamespace(name="emv0"),), response_distance_m=30.0)
    reactions = Reactions(NETWORK, plan, EmergencyLevel.L2, replace(CONFIG, bluelight_levels=frozenset()))
    count = len(x_m)
    there: Any = SimpleNamespace(x_m=np.array(x_m), y_m=np.zeros(count), yaw_rad=np.zeros(count))
    names = ["emv0", *(f"car{number}" for number in range(1, count))]
    return reactions.rescued(names, there, routes)["emv0"]


def test_who_is_ahead_on_the_emvs_route_within_reach_hears_it() -> None:
    routes = [[0, 1], [0], [1], [5], [0], [0]]
    assert listening(routes, [0.0, 20.0, 29.0, 10.0, 31.0, -5.0]) == ["car1", "car2"]


def test_a_vehicle_without_a_route_is_on_nobodys_way() -> None:
    assert listening([[0, 1], []], [0.0, 20.0]) == []


def test_an_emv_on_the_way_of_another_one_is_none_that_makes_way() -> None:
    plan: Any = SimpleNamespace(
        emvs=(SimpleNamespace(name="emv0"), SimpleNamespace(name="emv1")), response_distance_m=30.0
    )
    reactions = Reactions(NETWORK, plan, EmergencyLevel.L2, replace(CONFIG, bluelight_levels=frozenset()))
    there: Any = SimpleNamespace(x_m=np.array([0.0, 10.0, 20.0]), y_m=np.zeros(3), yaw_rad=np.zeros(3))
    found = reactions.rescued(["emv0", "emv1", "car"], there, [[0, 1]] * 3)
    assert found == {"emv0": ["car"], "emv1": ["car"]}
