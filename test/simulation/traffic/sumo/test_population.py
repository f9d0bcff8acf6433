from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import libsumo
import numpy as np
import pytest
from defusedxml.ElementTree import fromstring
from repository import shared_file
from traffic_helpers import MAPS, load_map, named_map, plan_of, plan_s2, responding

from siren_ros.base.numerics.geometry import Polyline, footprint_corners, overlapping_pairs, separation_m
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.plan import Spot, load_drivers, with_responses
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo import population as population_module
from siren_ros.simulation.traffic.sumo.population import (
    REPLACEMENT_DISTANCE_M,
    SumoPopulation,
    type_id,
    vehicle_types_xml,
)
from siren_ros.simulation.world.actors import TWO_WHEELED, ActorClass

PLAN = plan_s2(load_map(None)[1])[0]


@pytest.mark.parametrize(
    ("level", "privileged"),
    [
        (EmergencyLevel.L0, False),
        (EmergencyLevel.L1, True),
        (EmergencyLevel.L2, True),
        (EmergencyLevel.L3, True),
    ],
)
def test_emv_has_the_privileges_of_its_level(level: EmergencyLevel, privileged: bool) -> None:
    """And never SUMO's bluelight device: nobody's type changes because of an EMV."""
    root = fromstring(vehicle_types_xml(PLAN.emvs, level))
    (emv,) = root.findall("vType")
    assert not list(emv)
    assert ("jmDriveAfterRedTime" in emv.attrib) is privileged
    assert emv.get("vClass") == "emergency"


@pytest.mark.parametrize(
    ("model", "off"),
    [("IDM", set()), ("EIDM", {"sigmaleader", "sigmagap", "sigmaerror"}), ("Krauss", {"sigma"}), ("ACC", set())],
)
def test_no_driver_shakes(model: str, off: set[str]) -> None:
    """Where a car-following model has errors of drivers."""
    drivers = [replace(vehicle, driver=replace(vehicle.driver, car_following=model)) for vehicle in PLAN.background]
    for element in fromstring(vehicle_types_xml(drivers, EmergencyLevel.L2)):
        assert element.get("carFollowModel") == model
        assert {name for name in element.attrib if name.startswith("sigma")} == off
        assert {element.get(name) for name in off} <= {"0"}


def test_every_vehicle_has_its_own_type_with_its_body_and_driver() -> None:
    root = fromstring(vehicle_types_xml(PLAN.background, EmergencyLevel.L2))
    types = {element.get("id"): element for element in root.findall("vType")}
    assert set(types) == {type_id(vehicle) for vehicle in PLAN.background}
    for vehicle in PLAN.background:
        element = types[type_id(vehicle)]
        assert float(element.get("length")) == pytest.approx(vehicle.length_m)
        assert float(element.get("speedFactor")) == pytest.approx(vehicle.driver.speed_factor, rel=1e-4)
        assert float(element.get("speedDev")) == 0.0
        assert element.get("vClass") == "passenger"
        assert float(element.get("jmDriveAfterYellowTime")) == 1.0


def test_two_wheels_have_sumos_own_classes() -> None:
    """A cyclist keeps right, does not overtake and wishes for an own speed."""
    sedan = next(vehicle for vehicle in PLAN.background if vehicle.actor_class is ActorClass.SEDAN)
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


@pytest.mark.parametrize(("cyclists", "motorcycles"), [(12, 4)])
def test_riders_are_kept_in_the_network_beside_the_other_civilians(cyclists: int, motorcycles: int) -> None:
    values = f"demand.people.cyclists={cyclists},demand.people.motorcycles={motorcycles}"
    counts = {}
    for text in ("", values):
        setup = set_up_episode(EpisodeRequest("S2", map="city", values=text, sensors="none"))
        kinds: dict[int, ActorClass] = {}
        for step in closed_loop(setup, 200):
            kinds |= {actor.actor_id: actor.actor_class for actor in step.traffic.spawned}
            for actor_id in step.traffic.removed.tolist():
                del kinds[actor_id]
        counts[text] = Counter(kind if kind in TWO_WHEELED else None for kind in kinds.values())
    assert set(counts[""]) == {None}
    riding = counts[values]
    # one who has just left is followed by another one where a spot is free
    assert cyclists - 1 <= riding[ActorClass.BICYCLE] <= cyclists
    assert motorcycles - 1 <= riding[ActorClass.MOTORCYCLE] <= motorcycles
    assert abs(riding[None] - counts[""][None]) <= 1


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize("seed", [1, 2])
def test_nobody_overlaps_when_the_episode_begins(name: str, seed: int) -> None:
    compiled, network = named_map(name)
    plan, _, _ = plan_of("S6", network, seed)
    with SumoSimulation(compiled, network, plan, EmergencyLevel.L1, seed=seed) as simulation:
        state = simulation.step(0, None)
    assert len(state.actor_id) == len(plan.emvs) + plan.civilians
    size = np.array([(actor.length_m, actor.width_m) for actor in state.spawned])
    corners = footprint_corners(state.sumo_x_m, state.sumo_y_m, state.sumo_yaw_rad, size[:, 0], size[:, 1])
    first, second = np.triu_indices(len(corners), k=1)
    assert separation_m(corners[first], corners[second]).min() > 0.0


def standing(name: str, front_m: float = 0.0, **more: Any) -> Any:
    body = {"length_m": 4.0, "width_m": 1.8, "actor_class": ActorClass.SEDAN, "is_emv": False, "attentive": True}
    return SimpleNamespace(name=name, route=("edge",), spot=Spot(0, front_m, 0.0), **{**body, **more})


class OneLane:
    """A network of one straight lane."""

    def __init__(self, *ends_m: tuple[float, float]) -> None:
        centre = Polyline.through(np.array(ends_m))
        fields = {"lane_id": "lane", "position": 0, "speed_limit_mps": 14.0, "width_m": 1.5}
        self.lanes = [SimpleNamespace(centre=centre, length_m=centre.length_m, **fields)]
        self.lane_by_id: dict[str, Any] = {}
        self.sumo_offset_m = (0.0, 0.0)


class SumoTraffic:
    """A stand-in for SUMO: where the fronts of vehicles are, all of which look east, and how fast they drive."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.front_m: dict[str, tuple[float, float]] = {}
        self.speed_mps: dict[str, float] = {}
        self.entered: list[str] = []
        self.left: list[str] = []
        vehicle = SimpleNamespace(
            getLaneID=lambda name: "elsewhere" if name in self.front_m else "",
            getPosition=lambda name: self.front_m.get(name, (libsumo.INVALID_DOUBLE_VALUE,) * 2),
            getAngle=lambda _: 90.0,
            getSpeed=lambda name: self.speed_mps.get(name, 0.0),
            add=lambda name, *_, **__: self.entered.append(name),
            remove=self.left.append,
            subscribe=lambda *_: None,
            unsubscribe=lambda *_: None,
        )
        others = {
            "route": SimpleNamespace(add=lambda *_: None),
            "vehicletype": SimpleNamespace(getSpeedFactor=lambda _: 1.0),
            "lane": SimpleNamespace(getLength=lambda _: 100.0),
            "INVALID_DOUBLE_VALUE": libsumo.INVALID_DOUBLE_VALUE,
        }
        monkeypatch.setattr(population_module, "libsumo", SimpleNamespace(vehicle=vehicle, **others))


@pytest.fixture
def sumo(monkeypatch: pytest.MonkeyPatch) -> SumoTraffic:
    return SumoTraffic(monkeypatch)


def population_of(network: Any, *present: str, **plan: Any) -> SumoPopulation:
    planned: Any = {
        "emvs": (),
        "groups": (),
        "stage": (),
        "reserve": (),
        "civilians": 0,
        "riders": (),
        "riders_kept": {},
    }
    population = SumoPopulation(network, SimpleNamespace(**{**planned, **plan}))  # type: ignore[arg-type] # a stand-in
    population.vehicles = {name: standing(name) for name in present}
    return population


def test_of_two_vehicles_that_overlap_the_later_one_leaves_before_the_episode_begins(sumo: SumoTraffic) -> None:
    """Fronts 0.5 m apart and 1.6 m aside; a third one is elsewhere, and two still wait to enter SUMO.

    The third one is 15.5 m behind the fourth: from 12 m/s it needs 12 m to stop, from 14 m/s 16.3 m. A vehicle that is
    planned where the fourth one is stays, and the third one leaves.
    """
    sumo.front_m = {"a": (10.0, 0.0), "b": (10.5, 1.6), "c": (30.0, 0.0), "f": (49.5, 0.0)}

    def who_leaves(*present: str, planned: tuple[Any, ...] = ()) -> list[str]:
        sumo.left.clear()
        sumo.entered.clear()
        population = population_of(OneLane((0.0, 0.0), (100.0, 0.0)), *present, groups=planned)
        population.enter_stage()
        assert sumo.entered == [vehicle.name for vehicle in planned]
        assert set(population.vehicles) == {*present, *sumo.entered} - set(sumo.left)
        return sumo.left.copy()

    assert who_leaves(*"abcfde") == ["b"]
    for speed_mps, leaves in ((12.0, []), (14.0, ["f"])):
        sumo.speed_mps["c"] = speed_mps
        assert who_leaves(*"abcfde") == ["b", *leaves]
        found = who_leaves(*"abcde", planned=(standing("f", 49.5),))
        assert found == (["c", "b"] if leaves else ["b"])
    assert who_leaves(*"de") == []


@pytest.mark.parametrize(
    ("speed_mps", "others_mps", "away_m", "refused"),
    [(8.0, 5.0, 0.0, True), (8.0, 0.0, 0.0, False), (6.0, 5.0, 0.0, False), (8.0, 5.0, 100.0, False)],
)
def test_no_rider_enters_where_one_of_two_could_not_stop(
    sumo: SumoTraffic, speed_mps: float, others_mps: float, away_m: float, refused: bool
) -> None:
    """The rider goes north at x = 12 m from y = -5 m, the car east from x = 10 m: 8 m/s take 5.3 m, 5 m/s 2.1 m."""
    sumo.front_m, sumo.speed_mps = {"car": (10.0 - away_m, 0.0)}, {"car": others_mps}
    bicycle, body = ActorClass.BICYCLE, {"length_m": 2.0, "width_m": 0.8}
    rider = standing("rider", actor_class=bicycle, **body)
    rider.spot = Spot(0, 45.0, speed_mps)
    street = OneLane((12.0, -50.0), (12.0, 50.0))
    population = population_of(street, "car", riders=(rider,), riders_kept={bicycle: 1})
    assert population.exchange_riders([(12.0 + REPLACEMENT_DISTANCE_M + 1.0, -5.0)]) == []
    assert sumo.entered == ([] if refused else ["rider"])


@pytest.mark.parametrize(("template", "seed"), [("S2", 3), ("S3", 0)])
def test_nobody_touches_after_the_warm_up_on_a_crowded_map(template: str, seed: int) -> None:
    """On Town04 the drivers of these seeds change lanes side by side when the episode begins."""
    town04 = shared_file("maps", "Town04.xodr")
    setup = set_up_episode(EpisodeRequest(template=template, seed=seed, map=str(town04)))
    (step,) = closed_loop(setup, 1)
    size = {actor.actor_id: (actor.length_m, actor.width_m) for actor in step.traffic.spawned}
    lengths, widths = np.array([size[int(actor_id)] for actor_id in step.states.actor_id]).T
    states = step.states
    assert len(overlapping_pairs(states.x_m, states.y_m, states.yaw_rad, lengths, widths)[0]) == 0


def test_sumo_too_lets_inattentive_drivers_overlook_an_emv_on_the_junction() -> None:
    compiled, network = load_map(None)
    plan = with_responses(plan_of("S6", network, 1)[0], responding(0.5), 3)
    with SumoSimulation(compiled, network, plan, EmergencyLevel.L1, seed=1) as simulation:
        simulation.step(0, None)
        ignored = {
            vehicle.name: libsumo.vehicle.getParameter(vehicle.name, "junctionModel.ignoreTypes")
            for vehicle in (*plan.emvs, *plan.groups)
        }
    attentive = {vehicle.name: vehicle.attentive for vehicle in (*plan.emvs, *plan.groups)}
    assert set(attentive.values()) == {True, False}
    assert {name for name, types in ignored.items() if types} == {name for name, sees in attentive.items() if not sees}
    assert {types for types in ignored.values() if types} == {type_id(plan.emvs[0])}
