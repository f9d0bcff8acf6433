"""Which replacements enter, and who leaves the stage: with a stand-in for SUMO that only says where vehicles are."""

from dataclasses import replace
from typing import Any

import libsumo
import numpy as np
import pytest
from made_streets import A_LEFT, A_RIGHT, B_LEFT, CAR_M, NEAR, group, same_drivers, signal_site, streets, template_with
from traffic_helpers import DIMENSIONS

from siren_ros.simulation.scenario.scenario import GroupAnchor, Placement
from siren_ros.simulation.traffic.demand.demand import plan_traffic
from siren_ros.simulation.traffic.demand.plan import LaneInterval, PlannedVehicle, Spot
from siren_ros.simulation.traffic.sumo import population as population_module
from siren_ros.simulation.traffic.sumo.population import SumoPopulation
from siren_ros.simulation.world.actors import ActorClass

OFFSET = (500.0, -200.0)
NETWORK = replace(streets(), sumo_offset_m=OFFSET)
"""A runs from (−310, −5.25) and (−310, −1.75) eastwards."""
TEMPLATE = template_with(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=1))
PLAN = plan_traffic(NETWORK, signal_site(), TEMPLATE, 3, same_drivers(), DIMENSIONS)


class Sumo:
    """Fronts of vehicles in SUMO's frame by name, with lane, place on it and angle."""

    def __init__(self) -> None:
        self.at: dict[str, tuple[str, float, float, tuple[float, float]]] = {}
        self.added: list[str] = []
        self.removed: list[str] = []
        self.parameters: dict[str, Any] = {}

    def put(self, name: str, lane: int, front_m: float, left_m: float = 0.0) -> None:
        centre = NETWORK.lanes[lane].centre
        x, y = centre.offset_points(front_m, left_m)
        angle = 90.0 - float(np.degrees(centre.heading_rad(front_m)))
        self.at[name] = (NETWORK.lanes[lane].lane_id, front_m, angle, (float(x) + OFFSET[0], float(y) + OFFSET[1]))


@pytest.fixture(name="sumo")
def _sumo(monkeypatch: pytest.MonkeyPatch) -> Sumo:
    sumo = Sumo()
    unknown = libsumo.INVALID_DOUBLE_VALUE
    vehicle = {
        "getPosition": lambda name: sumo.at[name][3] if name in sumo.at else (unknown, unknown),
        "getLaneID": lambda name: sumo.at[name][0] if name in sumo.at else "",
        "getLanePosition": lambda name: sumo.at[name][1],
        "getAngle": lambda name: sumo.at[name][2],
        "getSpeed": lambda _: 0.0,
        "add": lambda name, *_, **more: (sumo.added.append(name), sumo.parameters.__setitem__(name, more)),
        "subscribe": lambda *_: None,
        "unsubscribe": lambda *_: None,
        "remove": sumo.removed.append,
        "setParameter": lambda name, key, value: sumo.parameters.__setitem__((name, key), value),
    }
    for name, function in vehicle.items():
        monkeypatch.setattr(libsumo.vehicle, name, function)
    monkeypatch.setattr(libsumo.route, "add", lambda *_: None)
    monkeypatch.setattr(population_module, "REPLACEMENT_DISTANCE_M", 50.0)
    monkeypatch.setattr(libsumo.vehicletype, "getSpeedFactor", lambda _: 1.0)
    lengths = {lane.lane_id: 2.0 * lane.length_m for lane in NETWORK.lanes}
    monkeypatch.setattr(libsumo.lane, "getLength", lengths.__getitem__)
    monkeypatch.setattr(libsumo.simulation, "getArrivedIDList", lambda: ("b", "elsewhere"))
    return sumo


def vehicle(name: str, lane: int, front_m: float, **changes: Any) -> PlannedVehicle:
    return replace(PLAN.groups[0], name=name, spot=Spot(lane, front_m, 5.0), **changes)


def population(*reserve: PlannedVehicle, inside: tuple[PlannedVehicle, ...] = (), **plan: Any) -> SumoPopulation:
    traffic = SumoPopulation(NETWORK, replace(PLAN, reserve=reserve, **plan))
    traffic.vehicles.update({vehicle.name: vehicle for vehicle in inside})
    traffic.civilians = sum(not vehicle.is_emv for vehicle in inside)
    return traffic


@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (0, -1), (0.6, 0.8), (-0.6, -0.8)])
@pytest.mark.parametrize(("away_m", "enters"), [(49.9, False), (50.1, True)])
def test_a_replacement_enters_50_m_from_every_emv_or_more(
    sumo: Sumo, direction: tuple[float, float], away_m: float, enters: bool
) -> None:
    x, y = NETWORK.lanes[A_LEFT].centre.at(100.0)
    emv = (float(x) + direction[0] * away_m, float(y) + direction[1] * away_m)
    population(vehicle("a", A_LEFT, 100.0)).refill(((5000.0, 0.0), emv), 1)
    assert sumo.added == (["a"] if enters else [])


@pytest.mark.parametrize(
    ("front_m", "free"),
    [
        (100.0 + 15.0 + CAR_M - 0.1, False),
        (100.0 + 15.0 + CAR_M + 0.1, True),
        (100.0 - CAR_M - 15.0 - 15.0 + 0.1, False),
        (100.0 - CAR_M - 15.0 - 15.0 - 0.1, True),
        (100.0, False),
    ],
)
@pytest.mark.parametrize("known", [True, False])
def test_a_replacement_keeps_its_gap_to_fronts_and_rears_in_its_lane(
    sumo: Sumo, front_m: float, free: bool, known: bool
) -> None:
    """The other's front may be 15 m behind the stretch that is looked at, or its rear beyond it.

    ``known`` says whether SUMO has put the other in already; before that it will be at its own spot.
    """
    other = vehicle("other", A_LEFT, front_m if not known else 10.0)
    if known:
        sumo.put("other", A_LEFT, front_m)
    population(vehicle("a", A_LEFT, 100.0), inside=(other,)).refill((), 2)
    assert (sumo.added == ["a"]) is free


@pytest.mark.parametrize(("left_m", "free"), [(3.4, False), (-3.4, False), (3.6, True), (-3.6, True)])
def test_a_replacement_looks_a_lanes_width_to_both_sides(sumo: Sumo, left_m: float, free: bool) -> None:
    sumo.put("other", A_LEFT, 100.0, left_m)
    population(vehicle("a", A_LEFT, 100.0), inside=(vehicle("other", A_LEFT, 10.0),)).refill((), 2)
    assert (sumo.added == ["a"]) is free


def test_as_many_enter_as_are_missing_in_turn_and_who_finds_no_place_waits(
    sumo: Sumo, monkeypatch: pytest.MonkeyPatch
) -> None:
    crowded = vehicle("crowded", A_LEFT, 100.0)
    reserve = [crowded, *(vehicle(f"r{k}", NEAR, 20.0 + 36.0 * k) for k in range(3))]
    sumo.put("other", A_LEFT, 100.0)
    emv = replace(PLAN.emvs[0], name="emv")
    traffic = population(*reserve, inside=(vehicle("other", A_LEFT, 10.0), emv))
    traffic.refill((), 1)
    assert sumo.added == [], "one civilian is there, and EMVs are none"
    traffic.refill((), 2)
    assert sumo.added == ["r0"]
    del sumo.at["other"]
    monkeypatch.setattr(libsumo.simulation, "getArrivedIDList", lambda: ("other",))
    traffic.drop_departed()
    sumo.put("r0", B_LEFT, 50.0)
    sumo.put("emv", B_LEFT, 90.0)
    traffic.refill((), 3)
    assert sumo.added == ["r0", "r1", "r2"]
    traffic.refill((), 4)
    assert sumo.added == ["r0", "r1", "r2", "crowded"]
    traffic.refill((), 9)
    assert len(sumo.added) == 4, "the reserve is empty"


def test_who_has_arrived_is_forgotten_and_named_in_order_of_entry(sumo: Sumo) -> None:
    del sumo
    traffic = population(inside=tuple(vehicle(name, NEAR, 10.0) for name in ("a", "b", "c")))
    assert traffic.drop_departed() == ("b",)
    assert list(traffic.vehicles) == ["a", "c"]


@pytest.mark.parametrize(
    ("lane", "front_m", "cleared"),
    [
        (A_LEFT, 20.0 - 0.1, False),
        (A_LEFT, 20.0 + 0.1, True),
        (A_LEFT, 30.0 + CAR_M - 0.1, True),
        (A_LEFT, 30.0 + CAR_M + 0.1, False),
        (A_RIGHT, 25.0, False),
    ],
)
def test_the_stage_is_cleared_of_whoever_is_on_it_with_any_part(
    sumo: Sumo, lane: int, front_m: float, cleared: bool
) -> None:
    """From 20 to 30 m; SUMO's lanes are twice as long as their centre lines."""
    sumo.put("car", lane, front_m)
    lane_id, at_m, angle, place = sumo.at["car"]
    sumo.at["car"] = (lane_id, 2.0 * at_m, angle, place)
    stage = (LaneInterval(A_LEFT, 20.0, 30.0),)
    far = replace(PLAN.emvs[0], spot=Spot(NEAR, 20.0, 5.0))
    traffic = population(inside=(vehicle("car", lane, front_m),), stage=stage, emvs=(far,), groups=(), civilians=0)
    traffic.enter_stage()
    assert sumo.removed == (["car"] if cleared else [])
    assert ("car" in traffic.vehicles) is not cleared


@pytest.mark.parametrize(("apart_m", "cleared"), [(-0.1, True), (0.1, False)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_may_overlap_one_that_enters_makes_way_on_whatever_lane(
    sumo: Sumo, apart_m: float, cleared: bool, side: float
) -> None:
    """Their centres are as far apart as both half lengths together, an EMV of 6.2 m and a car, or a little more."""
    emv = replace(PLAN.emvs[0], spot=Spot(A_LEFT, 100.0, 5.0))
    reach = 0.5 * (emv.length_m + CAR_M) + apart_m
    centre = 100.0 - 0.5 * emv.length_m + side * float(np.sqrt(reach**2 - 3.5**2))
    sumo.put("car", A_RIGHT, centre + 0.5 * CAR_M)
    traffic = population(inside=(vehicle("car", A_RIGHT, 10.0),), stage=(), emvs=(emv,), groups=(), civilians=0)
    traffic.enter_stage()
    assert sumo.removed == (["car"] if cleared else [])
    assert sumo.added == [emv.name]


def test_vehicles_enter_at_their_place_in_sumos_length_no_faster_than_their_driver_may_go(sumo: Sumo) -> None:
    population(vehicle("a", A_LEFT, 100.0)).refill((), 1)
    assert sumo.parameters["a"]["departPos"] == repr(200.0)
    assert sumo.parameters["a"]["departLane"] == "1"
    assert sumo.parameters["a"]["departSpeed"] == repr(5.0)
    fast = replace(vehicle("b", A_RIGHT, 100.0), spot=Spot(A_RIGHT, 100.0, 99.0), attentive=False)
    population(fast).refill((), 1)
    assert sumo.parameters["b"]["departSpeed"] == repr(NETWORK.lanes[A_RIGHT].speed_limit_mps)
    assert ("b", "junctionModel.ignoreTypes") in sumo.parameters
    assert ("a", "junctionModel.ignoreTypes") not in sumo.parameters


def riders(*fronts_m: float) -> dict[str, Any]:
    """A plan that keeps two cyclists."""
    kind = ActorClass.BICYCLE
    cyclists = tuple(vehicle(f"c{k}", A_LEFT, front_m, actor_class=kind) for k, front_m in enumerate(fronts_m))
    return {"riders": cyclists, "riders_kept": {kind: 2}}


def test_riders_enter_out_of_sight_near_an_emv_and_leave_far_from_it(sumo: Sumo, monkeypatch: Any) -> None:
    """Within 180 m; they enter at least 50 m from it, which these tests say."""
    removed: list[str] = []
    monkeypatch.setattr(libsumo.vehicle, "unsubscribe", lambda _: None)
    monkeypatch.setattr(libsumo.vehicle, "remove", removed.append)
    traffic = population(**riders(20.0, 60.0, 100.0, 140.0))
    x, y = (float(value) for value in NETWORK.lanes[A_LEFT].centre.at(0.0))
    assert traffic.exchange_riders([(x, y)]) == []
    assert sumo.added == ["c1", "c2"], "the first one is too near, and two are enough"
    for name, front_m in (("c1", 60.0), ("c2", 100.0)):
        sumo.put(name, A_LEFT, front_m)
    far = NETWORK.lanes[A_LEFT].centre.offset_points(np.array([60.0]), 179.0)[0]
    assert traffic.exchange_riders([(float(far[0]), float(far[1]))]) == removed == ["c2"]
    assert traffic.civilians == 0, "riders are on top"
