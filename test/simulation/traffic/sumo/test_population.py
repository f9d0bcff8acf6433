"""Vehicles that are put into SUMO, which replacements enter, and who leaves the stage."""

import math
from dataclasses import replace
from typing import Any

import libsumo
import numpy as np
import pytest
from defusedxml.ElementTree import fromstring
from made_streets import A_LEFT, A_RIGHT, B_LEFT, CAR_M, NEAR, group, same_drivers, signal_site, streets, template_with
from traffic_helpers import DIMENSIONS, MAPS, load_map, named_map, plan_of, plan_s2

from siren_ros.base.numerics.geometry import Polyline, footprint_corners, separation_m
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.scenario.scenario import GroupAnchor, Placement
from siren_ros.simulation.traffic.demand.demand import plan_traffic
from siren_ros.simulation.traffic.demand.plan import LaneInterval, PlannedVehicle, Spot, load_drivers
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo import population as population_module
from siren_ros.simulation.traffic.sumo.population import (
    Reserve,
    SumoPopulation,
    meet_head_on,
    type_id,
    vehicle_types_xml,
)
from siren_ros.simulation.world.actors import ActorClass


def test_those_in_the_ring_around_every_point_try_to_enter_in_their_order() -> None:
    reserve = Reserve("abcd", [(0.0, 50.0), (0.0, 10.0), (0.0, -40.0), (200.0, 0.0)])
    asked: list[str] = []

    def enter(name: str) -> bool:
        asked.append(name)
        return name != "a"

    reserve.let_in([], 0.0, math.inf, enter)
    assert asked == []
    reserve.let_in([(0.0, 0.0)], 20.0, 100.0, enter)
    assert asked == ["a", "c"]
    reserve.let_in([(0.0, 0.0)], 20.0, 100.0, enter)
    assert asked == ["a", "c", "a"], "one has entered, the other one tries again"
    reserve.let_in([(0.0, 0.0), (200.0, 0.0)], 0.0, 20.0, enter)
    assert asked[3:] == ["b", "d"]


PLAN_IN_TOWN = plan_s2(load_map(None)[1])[0]


@pytest.mark.parametrize("level", EmergencyLevel)
def test_emv_has_the_privileges_of_its_level(level: EmergencyLevel) -> None:
    """And never SUMO's bluelight device: nobody's type changes because of an EMV."""
    root = fromstring(vehicle_types_xml(PLAN_IN_TOWN.emvs, level))
    (emv,) = root.findall("vType")
    assert not list(emv)
    assert ("jmDriveAfterRedTime" in emv.attrib) is (level is not EmergencyLevel.L0)
    assert emv.get("vClass") == "emergency"


@pytest.mark.parametrize(
    ("model", "off"),
    [("IDM", set()), ("EIDM", {"sigmaleader", "sigmagap", "sigmaerror"}), ("Krauss", {"sigma"}), ("ACC", set())],
)
def test_no_driver_shakes(model: str, off: set[str]) -> None:
    """Where a car-following model has errors of drivers."""
    drivers = [
        replace(vehicle, driver=replace(vehicle.driver, car_following=model)) for vehicle in PLAN_IN_TOWN.background
    ]
    for element in fromstring(vehicle_types_xml(drivers, EmergencyLevel.L2)):
        assert element.get("carFollowModel") == model
        assert {name for name in element.attrib if name.startswith("sigma")} == off
        assert {element.get(name) for name in off} <= {"0"}


def test_every_vehicle_has_its_own_type_with_its_body_and_driver() -> None:
    root = fromstring(vehicle_types_xml(PLAN_IN_TOWN.background, EmergencyLevel.L2))
    types = {element.get("id"): element for element in root.findall("vType")}
    assert set(types) == {type_id(vehicle) for vehicle in PLAN_IN_TOWN.background}
    for vehicle in PLAN_IN_TOWN.background:
        element = types[type_id(vehicle)]
        assert float(element.get("length")) == pytest.approx(vehicle.length_m)
        assert float(element.get("speedFactor")) == pytest.approx(vehicle.driver.speed_factor, rel=1e-4)
        assert float(element.get("speedDev")) == 0.0
        assert element.get("vClass") == "passenger"
        assert float(element.get("jmDriveAfterYellowTime")) == 1.0


def test_sumo_accelerates_sideways_as_fast_as_the_driver_who_changes_lanes_faster_than_usual() -> None:
    cars = [replace(PLAN_IN_TOWN.background[0], lane_change_s=time_s) for time_s in (2.5, None)]
    fast, usual = fromstring(vehicle_types_xml(cars, EmergencyLevel.L2))
    assert float(fast.get("lcAccelLat")) == pytest.approx(cars[0].sideways[1], rel=1e-4)
    assert usual.get("lcAccelLat") is None


def test_faster_drivers_accelerate_at_speed_by_what_the_engine_gives() -> None:
    car = PLAN_IN_TOWN.background[0]
    quick = replace(
        car.driver, driving=replace(car.driver.driving, accel_mps2=4.0, engine_mps2=2.0, max_speed_mps=24.0)
    )
    fast, usual = fromstring(vehicle_types_xml([replace(car, driver=quick), car], EmergencyLevel.L2))
    speeds, most = ([float(word) for word in fast.get(name).split()] for name in ("speedTable", "maxAccelProfile"))
    assert speeds == [2.5 * number for number in range(11)]
    assert most == pytest.approx([4.0] * 5 + [44.444 / speed for speed in speeds[5:]], rel=1e-4)
    assert usual.get("maxAccelProfile") is usual.get("speedTable") is None


def test_two_wheels_have_sumos_own_classes() -> None:
    """A cyclist keeps right, does not overtake and wishes for an own speed."""
    sedan = next(vehicle for vehicle in PLAN_IN_TOWN.background if vehicle.actor_class is ActorClass.SEDAN)
    drivers = load_drivers()

    def of(kind: ActorClass) -> Any:
        driver = replace(sedan.driver, driving=drivers.classes[kind], speed_factor=0.9)
        vehicle = replace(sedan, actor_class=kind, width_m=0.64, driver=driver)
        (element,) = fromstring(vehicle_types_xml([vehicle], EmergencyLevel.L2))
        return element

    bicycle, motorcycle, car = of(ActorClass.BICYCLE), of(ActorClass.MOTORCYCLE), of(ActorClass.SEDAN)
    assert [element.get("vClass") for element in (bicycle, motorcycle, car)] == ["bicycle", "motorcycle", "passenger"]
    assert [float(element.get("width")) for element in (bicycle, motorcycle, car)] == pytest.approx([0.64, 1.04, 1.04])
    assert float(bicycle.get("maxSpeed")) == pytest.approx(0.9 * 5.56, rel=1e-3)
    assert float(motorcycle.get("maxSpeed")) == 45.0
    assert (bicycle.get("latAlignment"), bicycle.get("lcSpeedGain")) == ("right", "0")
    assert motorcycle.get("latAlignment") == "center"
    assert [float(element.get("accel")) for element in (bicycle, motorcycle, car)] == [1.2, 2.5, 2.4]


@pytest.mark.parametrize("name", MAPS)
def test_nobody_overlaps_when_the_episode_begins(name: str) -> None:
    compiled, network = named_map(name)
    plan, _, _ = plan_of("S6", network, 1)
    with SumoSimulation(compiled, network, plan, EmergencyLevel.L1, seed=1) as simulation:
        state = simulation.step(0, None)
    assert len(state.actor_id) == len(plan.emvs) + plan.civilians
    size = np.array([(actor.length_m, actor.width_m) for actor in state.spawned])
    corners = footprint_corners(state.sumo_x_m, state.sumo_y_m, state.sumo_yaw_rad, size[:, 0], size[:, 1])
    first, second = np.triu_indices(len(corners), k=1)
    assert separation_m(corners[first], corners[second]).min() > 0.0


OFFSET = (500.0, -200.0)
NETWORK = replace(streets(), sumo_offset_m=OFFSET)
"""A runs from (−310, −5.25) and (−310, −1.75) eastwards."""
TEMPLATE = template_with(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=1))
PLAN_OF_STREETS = plan_traffic(NETWORK, signal_site(), TEMPLATE, 3, same_drivers(), DIMENSIONS)


class SumoOfStreets:
    """Fronts of vehicles in SUMO's frame by name, with lane, place on it and angle."""

    def __init__(self) -> None:
        self.at: dict[str, tuple[str, float, float, tuple[float, float]]] = {}
        self.added: list[str] = []
        self.removed: list[str] = []
        self.parameters: dict[str, Any] = {}
        self.speed_mps: dict[str, float] = {}

    def put(self, name: str, lane: int, front_m: float, left_m: float = 0.0) -> None:
        centre = NETWORK.lanes[lane].centre
        x, y = centre.offset_points(front_m, left_m)
        angle = 90.0 - float(np.degrees(centre.heading_rad(front_m)))
        self.at[name] = (NETWORK.lanes[lane].lane_id, front_m, angle, (float(x) + OFFSET[0], float(y) + OFFSET[1]))


@pytest.fixture
def streets_sumo(monkeypatch: pytest.MonkeyPatch) -> SumoOfStreets:
    sumo = SumoOfStreets()
    unknown = libsumo.INVALID_DOUBLE_VALUE
    vehicle = {
        "getPosition": lambda name: sumo.at[name][3] if name in sumo.at else (unknown, unknown),
        "getLaneID": lambda name: sumo.at[name][0] if name in sumo.at else "",
        "getLanePosition": lambda name: sumo.at[name][1],
        "getAngle": lambda name: sumo.at[name][2] if name in sumo.at else 0.0,
        "getSpeed": lambda name: sumo.speed_mps.get(name, 0.0),
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
    return replace(PLAN_OF_STREETS.groups[0], name=name, spot=Spot(lane, front_m, 5.0), **changes)


def population(*reserve: PlannedVehicle, inside: tuple[PlannedVehicle, ...] = (), **plan: Any) -> SumoPopulation:
    traffic = SumoPopulation(NETWORK, replace(PLAN_OF_STREETS, reserve=reserve, **plan))
    traffic.vehicles.update({vehicle.name: vehicle for vehicle in inside})
    traffic.civilians = sum(not vehicle.is_emv for vehicle in inside)
    return traffic


@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (0, -1), (0.6, 0.8), (-0.6, -0.8)])
@pytest.mark.parametrize(("away_m", "enters"), [(49.9, False), (50.1, True)])
def test_a_replacement_enters_50_m_from_every_emv_or_more(
    streets_sumo: SumoOfStreets, direction: tuple[float, float], away_m: float, enters: bool
) -> None:
    x, y = NETWORK.lanes[A_LEFT].centre.at(100.0)
    emv = (float(x) + direction[0] * away_m, float(y) + direction[1] * away_m)
    population(vehicle("a", A_LEFT, 100.0)).refill(((5000.0, 0.0), emv), 1)
    assert streets_sumo.added == (["a"] if enters else [])


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
    streets_sumo: SumoOfStreets, front_m: float, free: bool, known: bool
) -> None:
    """The other's front may be 15 m behind the stretch that is looked at, or its rear beyond it.

    ``known`` says whether SUMO has put the other in already; before that it will be at its own spot.
    """
    other = vehicle("other", A_LEFT, front_m if not known else 10.0)
    if known:
        streets_sumo.put("other", A_LEFT, front_m)
    population(vehicle("a", A_LEFT, 100.0), inside=(other,)).refill((), 2)
    assert (streets_sumo.added == ["a"]) is free


@pytest.mark.parametrize("apart_m", [10.0, -10.0, 0.0])
def test_two_replacements_of_one_step_keep_their_gap_to_each_other(streets_sumo: SumoOfStreets, apart_m: float) -> None:
    population(vehicle("a", A_LEFT, 100.0), vehicle("b", A_LEFT, 100.0 + apart_m)).refill((), 2)
    assert streets_sumo.added == ["a"]


@pytest.mark.parametrize(("left_m", "free"), [(3.4, False), (-3.4, False), (3.6, True), (-3.6, True)])
def test_a_replacement_looks_a_lanes_width_to_both_sides(
    streets_sumo: SumoOfStreets, left_m: float, free: bool
) -> None:
    streets_sumo.put("other", A_LEFT, 100.0, left_m)
    population(vehicle("a", A_LEFT, 100.0), inside=(vehicle("other", A_LEFT, 10.0),)).refill((), 2)
    assert (streets_sumo.added == ["a"]) is free


def test_as_many_enter_as_are_missing_in_turn_and_who_finds_no_place_waits(
    streets_sumo: SumoOfStreets, monkeypatch: pytest.MonkeyPatch
) -> None:
    crowded = vehicle("crowded", A_LEFT, 100.0)
    reserve = [crowded, *(vehicle(f"r{k}", NEAR, 20.0 + 36.0 * k) for k in range(3))]
    streets_sumo.put("other", A_LEFT, 100.0)
    emv = replace(PLAN_OF_STREETS.emvs[0], name="emv")
    traffic = population(*reserve, inside=(vehicle("other", A_LEFT, 10.0), emv))
    traffic.refill((), 1)
    assert streets_sumo.added == [], "one civilian is there, and EMVs are none"
    traffic.refill((), 2)
    assert streets_sumo.added == ["r0"]
    del streets_sumo.at["other"]
    monkeypatch.setattr(libsumo.simulation, "getArrivedIDList", lambda: ("other",))
    assert traffic.drop_departed() == ("other",)
    assert list(traffic.vehicles) == ["emv", "r0"]
    streets_sumo.put("r0", B_LEFT, 50.0)
    streets_sumo.put("emv", B_LEFT, 90.0)
    traffic.refill((), 3)
    assert streets_sumo.added == ["r0", "r1", "r2"]
    traffic.refill((), 4)
    assert streets_sumo.added == ["r0", "r1", "r2", "crowded"]
    traffic.refill((), 9)
    assert len(streets_sumo.added) == 4, "the reserve is empty"


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
    streets_sumo: SumoOfStreets, lane: int, front_m: float, cleared: bool
) -> None:
    """From 20 to 30 m; SUMO's lanes are twice as long as their centre lines."""
    streets_sumo.put("car", lane, front_m)
    lane_id, at_m, angle, place = streets_sumo.at["car"]
    streets_sumo.at["car"] = (lane_id, 2.0 * at_m, angle, place)
    stage = (LaneInterval(A_LEFT, 20.0, 30.0),)
    far = replace(PLAN_OF_STREETS.emvs[0], spot=Spot(NEAR, 20.0, 5.0))
    traffic = population(inside=(vehicle("car", lane, front_m),), stage=stage, emvs=(far,), groups=(), civilians=0)
    traffic.enter_stage()
    assert streets_sumo.removed == (["car"] if cleared else [])
    assert ("car" in traffic.vehicles) is not cleared


@pytest.mark.parametrize(("apart_m", "cleared"), [(-0.1, True), (0.1, False)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_may_overlap_one_that_enters_makes_way_on_whatever_lane(
    streets_sumo: SumoOfStreets, apart_m: float, cleared: bool, side: float
) -> None:
    """Their centres are as far apart as both half lengths together, an EMV of 6.2 m and a car, or a little more."""
    emv = replace(PLAN_OF_STREETS.emvs[0], spot=Spot(A_LEFT, 100.0, 5.0))
    reach = 0.5 * (emv.length_m + CAR_M) + apart_m
    centre = 100.0 - 0.5 * emv.length_m + side * float(np.sqrt(reach**2 - 3.5**2))
    streets_sumo.put("car", A_RIGHT, centre + 0.5 * CAR_M)
    traffic = population(inside=(vehicle("car", A_RIGHT, 10.0),), stage=(), emvs=(emv,), groups=(), civilians=0)
    traffic.enter_stage()
    assert streets_sumo.removed == (["car"] if cleared else [])
    assert streets_sumo.added == [emv.name]
    assert traffic.civilians == (0 if cleared else 1), "an EMV is none"


def test_vehicles_enter_at_their_place_in_sumos_length_no_faster_than_their_driver_may_go(
    streets_sumo: SumoOfStreets,
) -> None:
    population(vehicle("a", A_LEFT, 100.0)).refill((), 1)
    assert streets_sumo.parameters["a"]["departPos"] == repr(200.0)
    assert streets_sumo.parameters["a"]["departLane"] == "1"
    assert streets_sumo.parameters["a"]["departSpeed"] == repr(5.0)
    fast = replace(vehicle("b", A_RIGHT, 100.0), spot=Spot(A_RIGHT, 100.0, 99.0), attentive=False)
    population(fast).refill((), 1)
    assert streets_sumo.parameters["b"]["departSpeed"] == repr(NETWORK.lanes[A_RIGHT].speed_limit_mps)
    overlooked = type_id(PLAN_OF_STREETS.emvs[0])
    assert streets_sumo.parameters["b", "junctionModel.ignoreTypes"] == overlooked, "who looks at nobody"
    assert ("a", "junctionModel.ignoreTypes") not in streets_sumo.parameters


def test_of_two_vehicles_that_overlap_the_later_one_leaves_before_the_episode_begins(
    streets_sumo: SumoOfStreets,
) -> None:
    """Fronts 0.5 m apart and 1.6 m aside; c is elsewhere, and d and e still wait to enter SUMO.

    c is 14.9 m behind f: from 12 m/s it needs 12 m to stop, from 14 m/s 16.3 m. A vehicle that is planned where f is
    stays, and c leaves.
    """
    for name, front_m, left_m in (("a", 10.0, 0.0), ("b", 10.5, 1.6), ("c", 30.0, 0.0), ("f", 49.5, 0.0)):
        streets_sumo.put(name, A_LEFT, front_m, left_m)

    def who_leaves(names: str, *planned: PlannedVehicle) -> list[str]:
        streets_sumo.removed.clear()
        inside = tuple(vehicle(name, NEAR, 10.0) for name in names)
        traffic = population(inside=inside, emvs=(), stage=(), civilians=0, groups=planned)
        traffic.enter_stage()
        assert set(traffic.vehicles) == {*names, *(one.name for one in planned)} - {*streets_sumo.removed}
        return streets_sumo.removed.copy()

    assert who_leaves("abcfde") == ["b"]
    for speed_mps, leaves in ((12.0, ""), (14.0, "f")):
        streets_sumo.speed_mps["c"] = speed_mps
        assert who_leaves("abcfde") == ["b", *leaves]
        assert who_leaves("abcde", vehicle("f", A_LEFT, 49.5)) == (["c", "b"] if leaves else ["b"])
    assert who_leaves("de") == []


@pytest.mark.parametrize("turned_deg", [0.0, 130.0])
@pytest.mark.parametrize(
    ("ahead_m", "left_m", "yaw_deg", "meet"),
    [
        *[(14.0, 0.0, 180.0, True), (14.2, 0.0, 180.0, False), (-14.0, 0.0, 180.0, False), (10.0, 0.0, 0.0, False)],
        *[(10.0, 1.7, 180.0, True), (10.0, -1.7, 180.0, True), (10.0, 1.9, 180.0, False), (10.0, -1.9, 180.0, False)],
        *[(10.0, 0.0, 171.0, True), (10.0, 0.0, 169.0, False), (10.0, 3.0, 211.0, False), (10.0, 1.0, 185.0, True)],
    ],
)
def test_two_meet_head_on_where_each_points_at_the_other_too_near_to_turn_past(
    turned_deg: float, ahead_m: float, left_m: float, yaw_deg: float, meet: bool
) -> None:
    """Cars of 4.5 m and 1.8 m: 9.6 m between the noses. Turned by 10° the other one points 1.74 m beside the first."""
    turn = np.radians(turned_deg)
    cos, sin, yaw = np.cos(turn), np.sin(turn), turn + np.radians(yaw_deg)
    one = 3.0, -2.0, float(turn)
    other = 3.0 + cos * ahead_m - sin * left_m, -2.0 + sin * ahead_m + cos * left_m, float(yaw)
    assert meet_head_on(one, other, 4.5, 1.8) is meet
    assert meet_head_on(other, one, 4.5, 1.8) is meet


@pytest.mark.parametrize(("across", "leaving"), [(True, ["b"]), (False, [])])
def test_who_meets_another_one_head_on_in_a_junction_leaves_before_the_episode_begins(
    streets_sumo: SumoOfStreets, across: bool, leaving: list[str]
) -> None:
    """On roads drivers pass each other. b comes towards a, and towards c, which is far behind a."""
    for name, x_m, angle_deg in (("a", 0.0, 90.0), ("b", 9.0, 270.0), ("c", -20.0, 90.0)):
        streets_sumo.at[name] = (":j_0_0" if across else "a_0", 5.0, angle_deg, (x_m, 0.0))
    inside = tuple(vehicle(name, NEAR, 10.0) for name in "abc")
    traffic = population(inside=inside, emvs=(), stage=(), civilians=0, groups=())
    traffic.enter_stage()
    assert streets_sumo.removed == leaving


@pytest.mark.parametrize("kind", [ActorClass.BICYCLE, ActorClass.SEDAN])
@pytest.mark.parametrize(
    ("speed_mps", "others_mps", "away_m", "refused"),
    [(8.0, 5.0, 0.0, True), (8.0, 0.0, 0.0, False), (6.0, 5.0, 0.0, False), (8.0, 5.0, 100.0, False)],
)
def test_nobody_enters_where_one_of_two_who_cross_could_not_stop(
    streets_sumo: SumoOfStreets, speed_mps: float, others_mps: float, away_m: float, refused: bool, kind: ActorClass
) -> None:
    """Who enters goes south from 5 m before the road on which the car drives: 8 m/s take 5.3 m, 5 m/s 2.1 m."""
    streets_sumo.put("car", A_LEFT, 100.0 - away_m)
    streets_sumo.speed_mps["car"] = others_mps
    x, y = NETWORK.lanes[A_LEFT].centre.at(100.0)
    rides, body = kind is ActorClass.BICYCLE, {"length_m": 2.0, "width_m": 0.8}
    new = replace(vehicle("new", NEAR, 50.0, actor_class=kind, **body), spot=Spot(NEAR, 50.0, speed_mps))
    far = x + 2.0, y + 5.0
    centre = Polyline.through([(far[0], far[1] + 50.0), (far[0], far[1] - 50.0)])
    lanes = list(NETWORK.lanes)
    lanes[NEAR] = replace(lanes[NEAR], centre=centre, width_m=1.5)
    kept = {"riders": (new,), "riders_kept": {kind: 1}} if rides else {"reserve": (new,)}
    traffic = SumoPopulation(replace(NETWORK, lanes=tuple(lanes)), replace(PLAN_OF_STREETS, **kept))
    traffic.vehicles["car"] = vehicle("car", A_LEFT, 10.0, length_m=4.0)
    if rides:
        assert traffic.exchange_riders([(float(far[0]) + 51.0, float(far[1]))]) == []
    else:
        traffic.refill((), 1)
    assert streets_sumo.added == ([] if refused else ["new"])


def riders(*fronts_m: float) -> dict[str, Any]:
    """A plan that keeps two cyclists."""
    kind = ActorClass.BICYCLE
    cyclists = tuple(vehicle(f"c{k}", A_LEFT, front_m, actor_class=kind) for k, front_m in enumerate(fronts_m))
    return {"riders": cyclists, "riders_kept": {kind: 2}}


def test_riders_enter_out_of_sight_near_an_emv_and_leave_far_from_it(
    streets_sumo: SumoOfStreets, monkeypatch: Any
) -> None:
    """Within 180 m; they enter at least 50 m from it, which these tests say."""
    removed: list[str] = []
    monkeypatch.setattr(libsumo.vehicle, "unsubscribe", lambda _: None)
    monkeypatch.setattr(libsumo.vehicle, "remove", removed.append)
    traffic = population(**riders(20.0, 60.0, 100.0, 140.0))
    x, y = (float(value) for value in NETWORK.lanes[A_LEFT].centre.at(0.0))
    assert traffic.exchange_riders([(x, y)]) == []
    assert streets_sumo.added == ["c1", "c2"], "the first one is too near, and two are enough"
    for name, front_m in (("c1", 60.0), ("c2", 100.0)):
        streets_sumo.put(name, A_LEFT, front_m)
    far = NETWORK.lanes[A_LEFT].centre.offset_points(np.array([60.0]), 179.0)[0]
    assert traffic.exchange_riders([(float(far[0]), float(far[1]))]) == removed == ["c2"]
    assert traffic.civilians == 0, "riders are on top"
