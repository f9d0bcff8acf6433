"""Which rules an episode has, and what those about making way do."""

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import libsumo
import numpy as np
import pytest
from hand_made_record import traffic_of
from traffic_helpers import columns_of, load_map, plan_of, plan_s2

from siren_ros.base.numerics.geometry import overlapping_pairs
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.roads.road_network import NO_LANE, Lane, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes, opposite_edges, rescue_sides
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.plan import JamHead, PlannedVehicle, SignalTiming, load_drivers
from siren_ros.simulation.traffic.sumo.caution import CautiousDrivers
from siren_ros.simulation.traffic.sumo.driving_corrections import LaneContinuity, SidewaysLimits
from siren_ros.simulation.traffic.sumo.orders import JamOrders
from siren_ros.simulation.traffic.sumo.rules import (
    BEND,
    BESIDE_M,
    COMES_WITHIN_M,
    ENDS_ABOVE_MPS,
    FASTEST_MPS,
    FORMS_BELOW_MPS,
    KEEPS_M,
    NEXT_M,
    ROAD_M,
    RULES,
    WITHIN_M,
    FilteringRiders,
    Moment,
    OncomingDrivers,
    RescueLane,
    Road,
    Rule,
    Setting,
    acts_of,
    coming_to_jam,
    filter_speeds_mps,
    forming,
    kept_sides,
)
from siren_ros.simulation.world.actors import (
    MIRRORS_M,
    ActorClass,
    ActorDescription,
    Owner,
    TrafficState,
    rows_of_ids,
)

EVERYWHERE = {"caution", "yellow", "stand-offs", "sideways", "bends", "continuity"}
TIMING = SignalTiming(signal_id="s", link=1, red_from_s=5.0, crossing=(0,), platoon=("a",), emv="emv0")


@pytest.fixture(scope="module")
def setting() -> Setting:
    """A plan without signal, jam, riders and rescue lane."""
    _, network = load_map(None)
    plan, _ = plan_s2(network)
    plan = replace(plan, signal=None, jam=None, riders=(), duty=False)
    return Setting(network, plan, EmergencyLevel.L1)


def rules_of(setting: Setting) -> set[str]:
    return {rule.name for rule in RULES if rule.make(setting) is not None}


@pytest.mark.parametrize(
    ("level", "more"),
    [(EmergencyLevel.L0, {"route ends"}), (EmergencyLevel.L1, set()), (EmergencyLevel.L3, {"oncoming"})],
)
def test_levels_have_the_rules_of_their_privileges(setting: Setting, level: EmergencyLevel, more: set[str]) -> None:
    """Without a siren nobody notices an EMV, and only EMVs at L0 are driven by SUMO to the end of their route."""
    assert rules_of(replace(setting, level=level)) == EVERYWHERE | more


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"signal": TIMING}, "gap out"),
        ({"jam": JamHead(names=("a",), moves=False, roll_s=0.0, roll_mps=0.0, stand_s=1.0)}, "jam"),
        ({"duty": True}, "rescue lane"),
        ({"riders": (None,)}, "cyclists"),
    ],
)
def test_a_plan_has_the_rules_of_what_it_holds(setting: Setting, change: Mapping[str, Any], rule: str) -> None:
    assert rules_of(replace(setting, plan=replace(setting.plan, **change))) == EVERYWHERE | {rule}


def test_rules_act_in_the_order_of_the_table_within_their_moment(setting: Setting) -> None:
    done: list[str] = []

    def rule(name: str, moment: Moment, *, there: bool = True) -> Rule:
        return Rule(name, moment, lambda _: (lambda _: done.append(name)) if there else None, "")

    rules = rule("a", Moment.MOTION), rule("b", Moment.ORDERS), rule("c", Moment.MOTION, there=False)
    acts = acts_of(setting, (*rules, rule("d", Moment.MOTION)))
    for moment in (Moment.CAUTION, Moment.MOTION, Moment.ORDERS):
        for act in acts[moment]:
            act(None)  # type: ignore[arg-type] # these rules look at nothing
    assert done == ["a", "d", "b"]


EVERYBODY = dict.fromkeys(("placed", "moved", "yields"))


@pytest.mark.parametrize(
    ("name", "kind", "method", "told", "asked"),
    [
        ("caution", CautiousDrivers, "apply", ["last", "reported", "people", "scale"], {"yields"}),
        ("jam", JamOrders, "apply", [7, {"moved", "yields"}], {"yields"}),
        ("rescue lane", RescueLane, "apply", ["columns", EVERYBODY, "outside", ("emv0",)], {"yields", "keeps"}),
        ("sideways", SidewaysLimits, "apply", ["columns", EVERYBODY, "outside", {"yields"}], {"yields"}),
        ("continuity", LaneContinuity, "correct", ["columns", {"placed", "moved"}], {"yields"}),
    ],
)
def test_rules_know_who_is_driven_from_outside_who_makes_way_and_the_people(
    name: str, kind: type, method: str, told: list[Any], asked: set[str], setting: Setting, monkeypatch: Any
) -> None:
    """One is placed from outside, one was moved by SUMO's mirror, and one makes way; nobody knows actor 9 any more."""
    reported = {2: SimpleNamespace(name="moved")}
    heard: list[Any] = []
    monkeypatch.setattr(kind, method, lambda _, *said: heard.extend(said))
    monkeypatch.setattr(RescueLane, "keeping", {"keeps"})
    jam = JamHead(names=("a",), moves=False, roll_s=0.0, roll_mps=0.0, stand_s=1.0)
    acts = acts_of(
        replace(setting, plan=replace(setting.plan, jam=jam, duty=True)), [r for r in RULES if r.name == name]
    )
    population = SimpleNamespace(vehicles=EVERYBODY, scale_of="scale")
    mirror = SimpleNamespace(places={"placed": None}, realigned={2: 0.5, 9: 0.5})
    there = "columns", population, mirror, SimpleNamespace(people="people")
    road = Road(*there, reported, 7, "last", "outside", {"yields"})  # type: ignore[arg-type]
    for act in sum(acts.values(), ()):
        act(road)
    assert (heard, road.asked) == ([reported if item == "reported" else item for item in told], asked)


@pytest.mark.parametrize("angle_deg", [0.0, 75.0, 200.0])
@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "turned_deg", "speed_mps"),
    [
        (KEEPS_M + 6.0, 2.0, 0.0, 4.0),
        (KEEPS_M + 6.5, 2.0, 0.0, 4.0),
        (KEEPS_M + 0.1, 2.0, 0.0, 0.5),
        (60.0, -2.0, 0.0, 0.5 * np.floor(FASTEST_MPS / 0.5)),
        (WITHIN_M + 0.1, 0.0, 0.0, 0.0),
        (KEEPS_M - 0.1, 0.0, 0.0, 0.0),
        (-20.0, 0.0, 0.0, 0.0),
        (60.0, ROAD_M + 60.0 * BEND + 0.1, 0.0, 0.0),
        (60.0, ROAD_M + 60.0 * BEND - 0.1, 0.0, 8.0),
        (60.0, 0.0, 180.0, 0.0),
    ],
)
def test_riders_keep_a_distance_behind_an_emv_that_has_passed(
    angle_deg: float, ahead_m: float, aside_m: float, turned_deg: float, speed_mps: float
) -> None:
    angle = np.radians(angle_deg)
    forward, right = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    x, y = np.array([50.0, 20.0]) + ahead_m * forward + aside_m * right
    rider = np.array([[50.0], [20.0], [angle_deg]])
    assert filter_speeds_mps(rider, np.array([[x], [y], [angle_deg + turned_deg]])).tolist() == [speed_mps]


@pytest.mark.parametrize(("behind_m", "follows"), [(NEXT_M + 1.0, True), (NEXT_M - 1.0, False)])
def test_nobody_filters_before_the_next_emv(behind_m: float, follows: bool) -> None:
    rider, emvs = np.array([[0.0], [0.0], [0.0]]), np.array([[0.0, 0.0], [40.0, -behind_m], [0.0, 0.0]])
    assert bool(filter_speeds_mps(rider, emvs)[0] > 0.0) is follows
    assert filter_speeds_mps(rider, emvs[:, :0]).tolist() == [0.0]


@pytest.fixture(scope="module")
def motorway() -> RoadNetwork:
    return load_map(Path("motorway"))[1]


def at(lane: Lane, y_m: float) -> dict[int, Any]:
    return {libsumo.VAR_LANE_ID: lane.lane_id, libsumo.VAR_POSITION: (0.0, y_m)}


def ridden(vehicle: PlannedVehicle, **changes: Any) -> PlannedVehicle:
    driver = replace(vehicle.driver, driving=load_drivers().classes[ActorClass.MOTORCYCLE])
    body = {"actor_class": ActorClass.MOTORCYCLE, "length_m": 2.25, "width_m": 0.85, "height_m": 1.65}
    return replace(vehicle, driver=driver, **body, **changes)


def test_who_filters_is_told_a_width_and_a_speed_until_nobody_waits_beside_them(
    motorway: RoadNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two riders in each of three lanes one filters; the rescue lane is not beside the rightmost lane."""
    edge = next(edge.index for edge in motorway.edges if len(driving_lanes(motorway, edge.index)) == 3)
    lanes = driving_lanes(motorway, edge)
    assert rescue_sides(motorway)[[lane.index for lane in lanes]].tolist() == [-1, -1, 1]
    told: list[tuple[str, str, float]] = []
    monkeypatch.setattr(libsumo.vehicle, "setWidth", lambda name, width: told.append((name, "width", width)))
    monkeypatch.setattr(libsumo.vehicle, "setSpeedFactor", lambda name, factor: told.append((name, "speed", factor)))
    plan, _, _ = plan_of("S2", load_map(None)[1], 0)
    emv, driver = plan.emvs[0], plan.background[0]
    vehicles = {f"{kind}{lane.position}": ridden(driver, filters=kind == "f") for lane in lanes for kind in "fn"}

    def filtering(ahead_m: float, slow: bool = True, waits_m: float = 30.0) -> list[str]:
        here = {libsumo.VAR_POSITION: (0.0, ahead_m)}
        riders = {  # those who do not filter are behind
            f"{kind}{lane.position}": at(lane, 0.0 if kind == "f" else -50.0) for lane in lanes for kind in "fn"
        }
        waits = {libsumo.VAR_POSITION: (0.0, waits_m)}
        columns = columns_of({"emv0": here, "car": waits, **riders}, motorway, {})
        everybody = {"emv0": emv, "car": driver, **vehicles}
        flags = riding.apply(columns, everybody, np.array([False, *[slow] * 7]), ["emv0"])
        return [columns.names[row] for row in np.flatnonzero(flags).tolist()]

    riding, first = FilteringRiders(motorway), lanes[0].position
    both = [f"f{first + 1}", f"f{first + 2}"]
    assert filtering(60.0, slow=False) == []
    assert told == []
    assert filtering(60.0) == both
    assert filtering(50.0) == both
    factor = 8.0 / lanes[0].speed_limit_mps
    begins = [item for name in both for item in ((name, "width", pytest.approx(1.05)), (name, "speed", factor))]
    assert told == begins
    told.clear()
    assert filtering(50.0, waits_m=BESIDE_M[1] + 1.0) == []
    width, own = driver.width_m, vehicles[both[0]].driver.speed_factor
    assert width != 0.85
    ends = [item for name in both for item in ((name, "width", 0.85 + MIRRORS_M), (name, "speed", own))]
    assert told == ends


def test_who_stands_in_a_jam_is_told_a_side_but_for_emvs_and_those_driven_from_outside(
    motorway: RoadNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    edge = next(edge.index for edge in motorway.edges if len(driving_lanes(motorway, edge.index)) == 3)
    right, _, left = driving_lanes(motorway, edge)
    told: dict[str, str] = {}
    monkeypatch.setattr(libsumo.vehicle, "setLateralAlignment", told.__setitem__)
    monkeypatch.setattr(libsumo.vehicle, "setLaneChangeMode", lambda *_: None)
    plan, _, _ = plan_of("S2", load_map(None)[1], 0)
    driver = replace(plan.background[0], rescue_m=math.inf)
    lane = RescueLane(motorway, filtering=False, siren=True)

    def tells(speed_mps: float, *outside: str, names: Collection[str] = ("emv0", "emv1", "l", "r")) -> dict[str, str]:
        told.clear()
        lanes = {"emv0": left, "emv1": right, "l": left, "r": right}
        rows = {name: at(lanes[name], 20.0 * k) | {libsumo.VAR_SPEED: speed_mps} for k, name in enumerate(names)}
        columns = columns_of(rows, motorway, {})
        lane.apply(columns, dict.fromkeys(rows, driver), columns.which(outside), ["emv0", "emv1"])
        return dict(told)

    assert tells(1.0, "r") == {"l": "left"}
    assert tells(1.0) == {"r": "right"}
    assert tells(1.0, "r") == {}
    assert set(lane.keeping) == {"l"}
    assert tells(1.0) == {"r": "right"}, "it has been driven from outside meanwhile"
    assert tells(1.0, names=("r",)) == {}
    assert tells(1.0) == {"l": "left"}, "another one of its name has come"
    assert tells(30.0) == {"l": "center", "r": "center"}


STOP_AND_GO = "jam.moves=1,jam.roll_s=12,jam.roll_mps=3,jam.stand_s=8"


def test_riders_leave_the_jam_behind_the_emv() -> None:
    """S8 with a motorcycle in the place of each sixth of the vehicles that stand beside the rescue lane."""
    setup = set_up_episode(EpisodeRequest("S8", values=STOP_AND_GO, sensors="none"))
    groups, lanes = list(setup.plan.groups), [setup.network.lanes[vehicle.spot.lane] for vehicle in setup.plan.groups]
    leftmost = [driving_lanes(setup.network, lane.edge)[-1].position for lane in lanes]
    chosen = [row for row, lane in enumerate(lanes) if lane.position >= leftmost[row] - 1][3::12]
    for row in chosen:
        groups[row] = ridden(groups[row], filters=True)
    names = {groups[row].name for row in chosen}
    actors: dict[int, ActorDescription] = {}
    for step in closed_loop(replace(setup, plan=replace(setup.plan, groups=tuple(groups))), 900):
        traffic = step.traffic
        actors |= {actor.actor_id: actor for actor in traffic.spawned}
        if traffic.step % 10:
            continue
        size = np.array([(actors[i].length_m, actors[i].width_m) for i in traffic.actor_id.tolist()])
        first, second, *_ = overlapping_pairs(traffic.x_m, traffic.y_m, traffic.yaw_rad, size[:, 0], size[:, 1])
        touching = {actors[int(traffic.actor_id[row])].name for row in (*first.tolist(), *second.tolist())}
        assert not touching & names
        riders = sorted(actor_id for actor_id, actor in actors.items() if actor.name in names)
        assert len(riders) == len(names) > 4
        emv, *rows = rows_of_ids(traffic.actor_id, np.array([1, *riders], np.uint32)).tolist()
        cos, sin = np.cos(traffic.yaw_rad[emv]), np.sin(traffic.yaw_rad[emv])
        dx, dy = traffic.x_m[rows] - traffic.x_m[emv], traffic.y_m[rows] - traffic.y_m[emv]
        behind_m, aside_m = -(cos * dx + sin * dy), np.abs(cos * dy - sin * dx)
        if np.any((behind_m > KEEPS_M) & (behind_m < 100.0) & (aside_m < 1.0) & (traffic.speed_mps[rows] > 7.0)):
            return
    pytest.fail("nobody follows the EMV")


LEFT, RIGHT, MIDDLE = 1, -1, 0
NOBODY = np.zeros(3, np.bool_)


def sides(*values: int) -> np.ndarray:
    return np.array(values, np.int8)


def test_who_forms_the_lane_unasked_late_or_not_at_all() -> None:
    x_m, within_m = np.array([0.0, 50.0, 50.0, 90.0, 50.0]), np.array([math.inf, math.inf, 60.0, 60.0, 0.0])
    emv, nobody = np.array([True, False, False, False, False]), np.zeros(5, np.bool_)
    assert forming(x_m, np.zeros(5), within_m, emv).tolist() == [True, True, True, False, False]
    assert forming(x_m, np.zeros(5), within_m, nobody).tolist() == [True, True, False, False, False]
    last = np.array([False, False, False, False, True])
    both = forming(x_m, np.array([0.0, 0.0, 100.0, 0.0, 0.0]), within_m, emv | last)
    assert both.tolist() == [True, True, False, True, False]  # the second EMV counts as the first does


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_slow_drivers_keep_to_the_side_of_their_lane_until_traffic_flows(side):
    """Who comes to a jam does so at any speed."""
    lanes, comes = sides(side, side, side), np.array([False, False, True])
    speeds = np.array([0.0, FORMS_BELOW_MPS - 0.01, FORMS_BELOW_MPS + 0.01])
    assert kept_sides(lanes, sides(0, 0, 0), speeds, NOBODY).tolist() == [side, side, MIDDLE]
    assert kept_sides(lanes, sides(0, 0, 0), np.full(3, 30.0), comes).tolist() == [MIDDLE, MIDDLE, side]
    speeds = np.array([FORMS_BELOW_MPS + 0.01, ENDS_ABOVE_MPS - 0.01, ENDS_ABOVE_MPS + 0.01])
    assert kept_sides(lanes, lanes, speeds, NOBODY).tolist() == [side, side, MIDDLE]


def test_who_changes_lanes_changes_sides_and_towns_have_none():
    assert kept_sides(sides(LEFT, MIDDLE), sides(RIGHT, RIGHT), np.array([1.0, 1.0]), NOBODY[:2]).tolist() == [
        LEFT,
        MIDDLE,
    ]


@pytest.mark.parametrize("angle_deg", [0.0, 120.0, 315.0])
@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "slow_mps", "turned_deg", "comes"),
    [
        (COMES_WITHIN_M - 1.0, 0.0, 1.0, 0.0, True),
        (COMES_WITHIN_M + 1.0, 0.0, 1.0, 0.0, False),
        (-10.0, 0.0, 1.0, 0.0, False),
        (100.0, 12.0, 1.0, 0.0, True),
        (100.0, -18.0, 1.0, 0.0, False),
        (100.0, 0.0, FORMS_BELOW_MPS + 1.0, 0.0, False),
        (100.0, 0.0, 1.0, 180.0, False),
    ],
)
def test_a_jam_is_slow_vehicles_close_ahead(angle_deg, ahead_m, aside_m, slow_mps, turned_deg, comes):
    angle = np.radians(angle_deg)
    forward, right = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    x_m, y_m = np.array([[50.0, 20.0], np.array([50.0, 20.0]) + ahead_m * forward + aside_m * right]).T
    given = x_m, y_m, np.array([angle_deg, angle_deg + turned_deg]), np.array([30.0, slow_mps])
    assert coming_to_jam(*given, np.array([True, True])).tolist() == [comes, False]
    assert not coming_to_jam(*given, np.array([True, False])).any(), "not on a road with the duty"


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


@pytest.mark.parametrize(("ahead_m", "meets"), [(39.0, True), (1.0, True), (41.0, False), (-1.0, False)])
def test_a_driver_meets_an_emv_that_comes_on_the_other_side(network: RoadNetwork, ahead_m: float, meets: bool) -> None:
    assert meeting(network, ahead_m) == ({CIVILIAN} if meets else frozenset())


def test_only_drivers_of_sumo_on_the_other_side_count(network: RoadNetwork) -> None:
    edge, _ = facing(network)
    own = network.edges[edge].lanes[-1]
    assert meeting(network, 20.0, owner=np.full(2, Owner.ROS, np.uint8)) == frozenset()
    assert meeting(network, 20.0, lane=np.array([own, own], np.int32)) == frozenset()
    assert meeting(network, 20.0, lane=np.array([own, NO_LANE], np.int32)) == frozenset()


def test_who_meets_an_emv_slows_down_and_keeps_right_until_it_has_passed(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    network, plan = setting.network, setting.plan
    vehicles = {EMV: plan.emvs[0], CIVILIAN: replace(plan.background[0], oncoming_share=0.5)}
    told: list[tuple[str, object]] = []
    monkeypatch.setattr(libsumo.vehicle, "setSpeedFactor", lambda name, factor: told.append((name, factor)))
    monkeypatch.setattr(libsumo.vehicle, "setLateralAlignment", lambda name, side: told.append((name, side)))
    name, wished = vehicles[CIVILIAN].name, vehicles[CIVILIAN].driver.speed_factor
    near = replace(setting, level=EmergencyLevel.L3, plan=replace(plan, response_distance_m=40.0))
    (act,) = acts_of(near, [rule for rule in RULES if rule.name == "oncoming"])[Moment.CAUTION]

    def makes_way(ahead_m: float | None) -> bool:
        last = None if ahead_m is None else scene(network, ahead_m)
        road = Road(None, None, None, None, vehicles, last=last)  # type: ignore[arg-type] # the rule looks at no more
        act(road)
        assert road.asked <= {name}
        return road.asked == {name}

    assert [*map(makes_way, (None, 50.0, 30.0, 20.0, -1.0, -5.0))] == [False, False, True, True, False, False]
    assert told == [(name, 0.5 * wished), (name, "right"), (name, wished), (name, "center")]
    told.clear()
    vehicles[CIVILIAN] = replace(vehicles[CIVILIAN], oncoming_share=1.0)
    assert (makes_way(20.0), told) == (False, [])
