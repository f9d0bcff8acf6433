"""For whom SUMO's drivers do not wait on junctions: who stands there, too, driven from outside; people at kerbs."""

from dataclasses import replace

import libsumo
import numpy as np
import pytest
from hand_made_record import traffic_of
from traffic_helpers import load_map, plan_of

from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.traffic.sumo.standoff import IgnoredFoes, drivers_who_go
from siren_ros.simulation.world.actors import Owner
from siren_ros.simulation.world.traffic_state import TrafficFlags, TrafficState

EMV, FIRST, SECOND = 1, 2, 3
EMVS = frozenset({"emv0", "emv1"})


@pytest.fixture(scope="module")
def vehicles() -> dict[int, PlannedVehicle]:
    plan, _, _ = plan_of("S2", load_map(None)[1], 0)
    return {EMV: plan.emvs[0], FIRST: plan.background[0], SECOND: plan.background[1]}


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


def test_who_stands_there_with_the_emv_need_not_wait_for_it_until_the_junction_lies_behind(vehicles) -> None:
    names, passed = [vehicles[key].name for key in (FIRST, SECOND)], EMVS | {vehicles[EMV].name}
    going = drivers_who_go({}, scene((1.0, 0.0, 0.0)), vehicles, EMVS)
    assert going == {}, "the EMV moves"
    going = drivers_who_go(going, scene((0.0, 0.0, 3.0)), vehicles, EMVS)
    assert going == {names[0]: passed}
    going = drivers_who_go(going, scene((2.0, 3.0, 0.0)), vehicles, EMVS)
    assert going == {names[0]: passed}, "who has begun to go goes on, and nobody else begins"
    assert drivers_who_go(going, scene((2.0, 3.0, 0.0), inside=(True, False, True)), vehicles, EMVS) == {}


def test_who_stands_there_with_a_civilian_who_makes_room_need_not_wait_for_it(vehicles) -> None:
    """The EMV is still on its way; it is not waited for either, once it stands behind those two."""
    first, second = (vehicles[key].name for key in (FIRST, SECOND))
    going = drivers_who_go({}, scene((4.0, 0.0, 0.0), inside=(False, True, True), owner=Owner.ROS), vehicles, EMVS)
    assert going == {second: EMVS | {first}}
    moves = scene((4.0, 1.0, 0.0), inside=(False, True, True), owner=Owner.ROS)
    assert drivers_who_go({}, moves, vehicles, EMVS) == {}


def test_only_drivers_of_sumo_on_the_junction_go(vehicles) -> None:
    assert drivers_who_go({}, scene((0.0, 0.0, 0.0), inside=(False, True, True)), vehicles, EMVS) == {}
    assert drivers_who_go({}, scene((0.0, 0.0, 1.0), owner=Owner.ROS), vehicles, EMVS) == {}


def test_who_has_left_the_simulation_is_forgotten(vehicles) -> None:
    before = scene((0.0, 0.0, 0.0))
    going = drivers_who_go({}, before, vehicles, EMVS)
    rest = before.actor_id != FIRST
    columns = {name: getattr(before, name)[rest] for name in ("actor_id", "owner", "speed_mps", "flags")}
    assert list(drivers_who_go(going, replace(before, **columns), vehicles, EMVS)) == [vehicles[SECOND].name]


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    calls: list[tuple[str, str]] = []
    monkeypatch.setattr(libsumo.vehicle, "setParameter", lambda name, _, names: calls.append((name, names)))
    return calls


def test_drivers_are_told_where_something_has_changed_for_them(told) -> None:
    foes = IgnoredFoes()
    foes.apply(["a", "b"], ["kerb"], {})
    assert told == [("a", "kerb"), ("b", "kerb")]
    foes.apply(["a", "b"], ["kerb"], {})
    assert len(told) == 2
    foes.apply(["a", "b", "c"], ["kerb"], {})
    assert told[2:] == [("c", "kerb")]
    told.clear()
    foes.apply(["a", "c"], [], {})
    assert told == [("a", ""), ("c", "")], "b has left"


def test_what_holds_for_all_and_for_one_holds_at_once(told) -> None:
    """The parameter is one: who waits for nobody at the kerb still does not wait for the EMV."""
    foes = IgnoredFoes()
    foes.apply(["a", "b"], [], {"a": frozenset({"emv0", "car1"})})
    assert told == [("a", "car1 emv0")]
    foes.apply(["a", "b"], ["kerb"], {"a": frozenset({"emv0", "car1"})})
    assert told[1:] == [("a", "kerb car1 emv0"), ("b", "kerb")]
    foes.apply(["a", "b"], ["kerb"], {})
    assert told[3:] == [("a", "kerb")]


def test_nobody_is_told_where_there_is_nothing(told) -> None:
    IgnoredFoes().apply(["a"], [], {})
    assert told == []
