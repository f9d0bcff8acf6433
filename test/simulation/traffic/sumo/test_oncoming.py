"""Drivers who come towards an EMV on a road that nothing divides."""

from dataclasses import replace
from typing import Any

import libsumo
import numpy as np
import pytest
from hand_made_record import traffic_of
from traffic_helpers import load_map, plan_of

from siren_ros.simulation.roads.movements import opposite_edges
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.traffic.sumo.oncoming import OncomingDrivers
from siren_ros.simulation.world.actors import Owner
from siren_ros.simulation.world.traffic_state import TrafficState

EMV, CIVILIAN = 1, 2


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    return load_map(None)[1]


def facing(network: RoadNetwork) -> tuple[int, int]:
    """A road of 60 m and more that nothing divides, and its other side."""
    for edge, other in sorted(opposite_edges(network).items()):
        if network.lanes[network.edges[edge].lanes[-1]].length_m > 60.0:
            return edge, other
    raise AssertionError("the town has no such road")


def scene(network: RoadNetwork, ahead_m: float, **columns: Any) -> TrafficState:
    """An EMV in the middle of a road, and a civilian on the other side so far ahead of it."""
    edge, other = facing(network)
    lane, across = (network.edges[item].lanes[-1] for item in (edge, other))
    centre = network.lanes[lane].centre
    middle = 0.5 * centre.length_m
    (x, y), yaw = centre.at(middle), float(centre.heading_rad(middle))
    values: dict[str, Any] = {
        "actor_id": np.array([EMV, CIVILIAN], np.uint32),
        "lane": np.array([lane, across], np.int32),
        "x_m": np.array([x, x + ahead_m * np.cos(yaw)]),
        "y_m": np.array([y, y + ahead_m * np.sin(yaw)]),
        "yaw_rad": np.array([yaw, yaw + np.pi]),
        "owner": np.array([Owner.ROS, Owner.SUMO], np.uint8),
        "route_offset": np.array([0, 1, 2], np.int32),
        "route_edges": np.array([edge, other], np.int32),
    }
    return replace(traffic_of(0, ""), **(values | columns))


def meeting(network: RoadNetwork, ahead_m: float, **columns: Any) -> frozenset[int]:
    return OncomingDrivers(network, 40.0).meeting(scene(network, ahead_m, **columns), [EMV])


def test_a_driver_meets_an_emv_that_comes_on_the_other_side(network: RoadNetwork) -> None:
    assert meeting(network, 39.0) == {CIVILIAN}
    assert meeting(network, 1.0) == {CIVILIAN}


@pytest.mark.parametrize("ahead_m", [41.0, -1.0])
def test_a_driver_far_away_or_passed_meets_nobody(network: RoadNetwork, ahead_m: float) -> None:
    assert meeting(network, ahead_m) == frozenset()


def test_only_drivers_of_sumo_on_the_other_side_count(network: RoadNetwork) -> None:
    edge, _ = facing(network)
    own = network.edges[edge].lanes[-1]
    assert meeting(network, 20.0, owner=np.full(2, Owner.ROS, np.uint8)) == frozenset()
    assert meeting(network, 20.0, lane=np.array([own, own], np.int32)) == frozenset()
    assert meeting(network, 20.0, lane=np.array([own, NO_LANE], np.int32)) == frozenset()


def test_who_meets_an_emv_slows_down_and_keeps_right_until_it_has_passed(
    network: RoadNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, _, _ = plan_of("S2", network, 0)
    vehicles = {EMV: plan.emvs[0], CIVILIAN: replace(plan.background[0], oncoming_share=0.5)}
    told: list[tuple[str, object]] = []
    monkeypatch.setattr(libsumo.vehicle, "setSpeedFactor", lambda name, factor: told.append((name, factor)))
    monkeypatch.setattr(libsumo.vehicle, "setLateralAlignment", lambda name, side: told.append((name, side)))
    drivers, name = OncomingDrivers(network, 40.0), vehicles[CIVILIAN].name
    wished = vehicles[CIVILIAN].driver.speed_factor
    drivers.apply(None, vehicles)
    for ahead_m in (50.0, 30.0, 20.0, -1.0, -5.0):
        drivers.apply(scene(network, ahead_m), vehicles)
    assert told == [(name, 0.5 * wished), (name, "right"), (name, wished), (name, "center")]
    told.clear()
    drivers.apply(scene(network, 20.0), {**vehicles, CIVILIAN: replace(vehicles[CIVILIAN], oncoming_share=1.0)})
    assert told == []
