"""Drivers who stand on a junction with an EMV that stands there, too."""

from dataclasses import replace

import libsumo
import numpy as np
import pytest
from hand_made_record import traffic_of
from traffic_helpers import load_map, plan_of

from siren_ros.traffic.demand.plan import PlannedVehicle
from siren_ros.traffic.sumo.standoff import StandOff
from siren_ros.world.actors import Owner
from siren_ros.world.traffic_state import TrafficFlags, TrafficState

EMV, FIRST, SECOND = 1, 2, 3


@pytest.fixture(scope="module")
def vehicles() -> dict[int, PlannedVehicle]:
    plan, _, _ = plan_of("S2", load_map(None)[1], 0)
    return {EMV: plan.emvs[0], FIRST: plan.background[0], SECOND: plan.background[1]}


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    calls: list[tuple[str, str]] = []
    monkeypatch.setattr(libsumo.vehicle, "setParameter", lambda name, _, ids: calls.append((name, ids)))
    return calls


def scene(
    speeds_mps: tuple[float, float, float],
    inside: tuple[bool, bool, bool] = (True, True, True),
    owner: Owner = Owner.SUMO,
) -> TrafficState:
    """The EMV and two civilians, with who is on the junction; ``owner`` is the first civilian's."""
    columns = {
        "actor_id": np.array([EMV, FIRST, SECOND], np.uint32),
        "owner": np.array([Owner.ROS, owner, Owner.SUMO], np.uint8),
        "speed_mps": np.array(speeds_mps),
        "flags": np.array([TrafficFlags.ON_JUNCTION if is_in else 0 for is_in in inside], np.uint8),
    }
    return replace(traffic_of(0, ""), **columns)  # type: ignore[arg-type] # fields by name


def test_who_stands_there_with_the_emv_need_not_wait_for_it_until_it_has_left_the_junction(vehicles, told) -> None:
    names = [vehicles[key].name for key in (FIRST, SECOND)]
    going = StandOff(("emv0", "emv1"))
    going.apply(None, vehicles)
    going.apply(scene((1.0, 0.0, 0.0)), vehicles)
    assert told == [], "the EMV moves"
    going.apply(scene((0.0, 0.0, 3.0)), vehicles)
    assert told == [(names[0], "emv0 emv1")]
    going.apply(scene((2.0, 3.0, 0.0)), vehicles)
    assert len(told) == 1, "who has begun to go goes on, and nobody else begins"
    going.apply(scene((2.0, 3.0, 0.0), inside=(True, False, True)), vehicles)
    assert told[1:] == [(names[0], "")]


def test_only_drivers_of_sumo_on_the_junction_count(vehicles, told) -> None:
    going = StandOff(("emv0",))
    going.apply(scene((0.0, 0.0, 0.0), inside=(False, True, True)), vehicles)
    going.apply(scene((0.0, 0.0, 1.0), owner=Owner.ROS), vehicles)
    assert told == []


def test_who_has_left_the_simulation_is_forgotten(vehicles, told) -> None:
    going = StandOff(("emv0",))
    going.apply(scene((0.0, 0.0, 0.0)), vehicles)
    told.clear()
    left = {key: vehicle for key, vehicle in vehicles.items() if key != FIRST}
    rest = scene((0.0, 0.0, 0.0)).actor_id != FIRST
    before = scene((0.0, 0.0, 0.0))
    columns = {name: getattr(before, name)[rest] for name in ("actor_id", "owner", "speed_mps", "flags")}
    going.apply(replace(before, **columns), left)
    assert told == []
