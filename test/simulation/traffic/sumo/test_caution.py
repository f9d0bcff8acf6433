"""SUMO's drivers wait for vehicles that are driven from outside, on a crossing of two roads."""

import math
from dataclasses import dataclass, replace
from itertools import permutations, product
from types import SimpleNamespace
from typing import Any
from xml.etree.ElementTree import Element

import hand_made_record
import numpy as np
import pytest
from synthetic_episode import rotate

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.conflicts.course import CourseBook, Outlook
from siren_ros.simulation.conflicts.junction_approach import outlines_of, people_at
from siren_ros.simulation.conflicts.yielding import MOST_BRAKE_MPS2, Margins, tight_lanes
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.roads.maps.map_compiler import converted
from siren_ros.simulation.roads.maps.netconvert import document, mended_lanes
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import Edge, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.traffic.demand.road_users import LONG_VEHICLE_RADIUS_M
from siren_ros.simulation.traffic.sumo import caution as caution_module
from siren_ros.simulation.traffic.sumo.caution import (
    AMONG_THEMSELVES,
    BESIDE_M,
    ROLLING_MPS,
    WAYS_AHEAD_S,
    WAYS_FAR_M,
    WAYS_MORE_M,
    Caution,
    CautiousDrivers,
    Drivers,
    cautions,
    near_pairs,
)
from siren_ros.simulation.world.actors import ActorClass, Owner, TrafficFlags, TrafficState

TURNS = np.radians([0.0, 30.0, 60.0])
HALF_LENGTH, HALF_WIDTH = 2.3, 0.9


@dataclass(frozen=True)
class Car:
    edge: int
    """0 leads east, 1 north; they cross after 100 m."""
    front_m: float
    speed: float
    owner: Owner = Owner.SUMO
    accel: float = 0.0
    flags: TrafficFlags = TrafficFlags.NONE
    left: float = 0.0
    """Of the lane's middle."""
    turned: float = 0.0
    """Off the lane's direction."""


def network(turn: float) -> RoadNetwork:
    ways = ([[0.0, 0.0], [200.0, 0.0]], [[100.0, -100.0], [100.0, 100.0]])
    lines = [Polyline.through(rotate(np.array(way), turn)) for way in ways]
    lanes = tuple(
        Lane(i, f"l{i}", i, 0, LaneKind.DRIVING, line, 3.3, 13.9, emergency_allowed=True, civilian_allowed=True)
        for i, line in enumerate(lines)
    )
    edges = tuple(Edge(i, f"e{i}", (i,), f"A{i}", f"B{i}", internal=False) for i in range(2))
    return RoadNetwork(lanes, edges, (), {}, (0.0, 0.0), "!")


def traffic_of(cars: list[Car], roads: RoadNetwork) -> TrafficState:
    edges = [car.edge for car in cars]
    poses = [
        (*way.offset_points(car.front_m - HALF_LENGTH, car.left), way.heading_rad(car.front_m) + car.turned, car.speed)
        for way, car in zip([roads.lanes[edge].centre for edge in edges], cars, strict=True)
    ]
    fields = {"owner": "owner", "sumo_accel_mps2": "accel", "lane_position_m": "front_m", "flags": "flags"}
    told = {name: [getattr(car, field) for car in cars] for name, field in fields.items()}
    routes = {"lane": edges, "route_offset": range(len(cars) + 1), "route_edges": edges}
    return hand_made_record.traffic_of(0, poses=poses, actor_id=range(1, len(cars) + 1), **told, **routes)


def seen(traffic: TrafficState, roads: RoadNetwork, *limits: Any) -> tuple[Caution, ...]:
    n = len(traffic)
    outlook = Outlook(traffic, CourseBook(roads), np.full(n, HALF_LENGTH), np.full(n, HALF_WIDTH))
    return cautions(traffic, outlook, *limits)


def two_vehicles(decel_mps2: float = 3.0, attentive: bool = True) -> Any:
    """What cautious drivers read of SUMO's vehicles."""
    driver = SimpleNamespace(driving=SimpleNamespace(decel_mps2=decel_mps2))
    body = {"length_m": 2.0 * HALF_LENGTH, "width_m": 2.0 * HALF_WIDTH, "attentive": attentive, "driver": driver}
    body["actor_class"] = ActorClass.SEDAN
    return {actor_id: SimpleNamespace(name=f"v{actor_id}", **body) for actor_id in (1, 2)}


def cautious(
    cars: list[Car], turn: float = 0.0, waiting: tuple[int, ...] = (), inattentive: tuple[int, ...] = ()
) -> tuple[Caution, ...]:
    roads = network(turn)
    return seen(traffic_of(cars, roads), roads, waiting, inattentive)


@pytest.mark.parametrize("turn", TURNS)
def test_a_driver_waits_for_an_outside_vehicle_that_cannot_stop_any_more(turn: float) -> None:
    (caution,) = cautious([Car(0, 75.0, 13.0), Car(1, 85.0, 12.0, Owner.ROS)], turn)
    assert (caution.actor_id, caution.other_id) == (1, 2)
    way = 25.0 - HALF_WIDTH - Margins().standoff_m
    assert way - 1.5 < caution.wait.free_m <= way
    clear_s = (15.0 + 2.0 * HALF_LENGTH + HALF_WIDTH) / 12.0
    assert 13.0 * clear_s - 0.5 * caution.wait.brake_mps2 * clear_s**2 < way
    roads = network(turn)
    traffic = traffic_of([Car(0, 75.0, 13.0), Car(1, 85.0, 12.0, Owner.ROS)], roads)
    late = replace(traffic, sumo_speed_mps=np.array([13.0, 0.0]), speed_mps=np.array([0.0, 12.0]))
    assert seen(late, roads) == (caution,), "its simulated speed counts, and the own one in SUMO"
    braking = [Car(0, 90.0, 2.0, accel=-2.0), Car(1, 92.0, 4.0, Owner.ROS)]
    assert cautious(braking, turn) == ()
    assert [caution.actor_id for caution in cautious(braking, turn, waiting=(1,))] == [1], "it goes on waiting"


ROS, ON_JUNCTION = Owner.ROS, TrafficFlags.ON_JUNCTION
TOUCHING_M = 80.0 - 2.0 * HALF_LENGTH


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(
    ("cars", "waits"),
    [
        *[
            ([Car(0, 90.0, 12.0), Car(1, 20.0, 8.0, ROS)], False),
            ([Car(0, 75.0, 10.0), Car(1, 120.0, 12.0, ROS)], False),
        ],
        ([Car(0, 86.0, 0.5), Car(1, 100.0, 0.5, ROS)], True),
        ([Car(0, 93.0, 5.0), Car(1, 97.0, 6.0)], True),
        ([Car(0, 93.0, 5.0), Car(1, 107.0, 8.0)], False),
        ([Car(0, 93.0, 5.0), Car(1, 100.5, 0.0, flags=ON_JUNCTION)], True),
        *[([Car(0, TOUCHING_M - 0.2, speed), Car(0, 80.0, 0.0)], True) for speed in (0.0, 0.2)],
        *[([Car(0, TOUCHING_M - 2.5, speed), Car(0, 80.0, 0.0)], False) for speed in (0.0, 0.2)],
        *[([Car(0, 50.0, 12.5), Car(0, 77.5, 0.0, owner)], owner is ROS) for owner in (Owner.SUMO, ROS)],
        ([Car(0, 50.0, 12.5), Car(0, 74.0, 0.0)], True),
    ],
    ids=[
        *("comes much later", "has passed", "both creep, from outside", "bodies would touch", "is past the own way"),
        *("stands on the junction", "nearly touches", "creeps up to it", "stands 2.5 m behind", "creeps 2.5 m behind"),
        *("SUMO's, farther than a second and 12 m", "so far, from outside", "SUMO's, nearer"),
    ],
)
def test_who_waits_for_whom(turn: float, cars: list[Car], waits: bool) -> None:
    assert [(caution.actor_id, caution.other_id) for caution in cautious(cars, turn)] == ([(1, 2)] if waits else [])


@pytest.mark.parametrize("turn", TURNS)
def test_an_inattentive_driver_sees_who_is_ahead_and_not_who_comes_across(turn: float) -> None:
    across = [Car(0, 75.0, 13.0), Car(1, 85.0, 12.0, Owner.ROS)]
    assert cautious(across, turn, inattentive=(1,)) == ()
    assert cautious(across, turn, inattentive=(2,)) == cautious(across, turn)
    ahead = [Car(0, 70.0, 10.0), Car(0, 80.0, 2.0, Owner.ROS)]
    assert cautious(ahead, turn, inattentive=(1,)) == cautious(ahead, turn)
    among_themselves = [Car(0, 93.0, 5.0), Car(1, 97.0, 6.0)]
    assert cautious(among_themselves, turn, inattentive=(1,)) == cautious(among_themselves, turn) != ()


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_changes_lanes_looks_where_the_vehicle_points(turn: float, side: float) -> None:
    """A body ahead, in the lane that the driver goes to, is 0.4 m or more aside of the way that leads straight on."""

    def waits(changing: Car, there: Car) -> tuple[Caution, ...]:
        roads = network(turn)
        traffic = traffic_of([changing, there], roads)
        return seen(replace(traffic, lateral_offset_m=np.array([changing.left, there.left])), roads)

    changing = Car(0, 75.0, 4.5, left=2.4 * side, turned=-0.2 * side)
    there = Car(0, 82.0, 0.0, Owner.ROS)
    (caution,) = waits(changing, there)
    assert (caution.actor_id, caution.wait.speed_mps) == (1, 0.0)
    assert 0.5 < caution.wait.free_m < 2.5
    assert waits(replace(changing, turned=0.0), there) == (), "it leads past"
    for other in (replace(there, left=-3.0 * side), replace(there, owner=Owner.SUMO), replace(there, front_m=90.0)):
        assert waits(changing, other) == ()
    assert waits(replace(changing, speed=2.0), there) == (), "there is time to brake"


@pytest.mark.parametrize("owner", Owner)
def test_leaders_are_sumos_own_business_while_there_is_room(owner: Owner) -> None:
    assert cautious([Car(0, 50.0, 10.0), Car(0, 80.0, 2.0, owner)]) == ()
    (caution,) = cautious([Car(0, 70.0, 10.0), Car(0, 80.0, 2.0, owner)])
    assert caution.actor_id == 1
    assert caution.wait.brake_mps2 == pytest.approx(8.0**2 / (2.0 * caution.wait.free_m))


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_driver_lets_an_outside_vehicle_merge_and_leaves_sumos_own_ones_to_sumo(turn: float, side: float) -> None:
    """It is 5 m ahead beside the lane and goes on in it."""
    merging = Car(0, 98.0, 6.0, Owner.ROS, left=side * 2.6)
    (caution,) = cautious([Car(0, 93.0, 8.0), merging], turn)
    assert (caution.actor_id, caution.other_id) == (1, 2)
    assert caution.wait.speed_mps < 8.0
    assert cautious([Car(0, 93.0, 8.0), replace(merging, owner=Owner.SUMO, flags=TrafficFlags.ON_JUNCTION)], turn) == ()


@pytest.mark.parametrize("slow_in_m", [0.1, 0.4, 0.7, 1.0, 1.3])
def test_of_two_whose_bodies_would_touch_one_waits(slow_in_m: float) -> None:
    """Where both took the other one to be farther away than it is, both would go."""
    for fast_in_m in (1.0, 1.4, 1.8, 2.2, 2.6, 3.0):
        fast, slow = Car(0, 100.0 - HALF_WIDTH - fast_in_m, 3.2), Car(1, 100.0 - HALF_WIDTH - slow_in_m, 1.0)
        assert len(cautious([fast, slow], 0.5)) == 1


class SumoVehicles:
    """libsumo's domain of vehicles, as far as cautious drivers use it."""

    def __init__(self) -> None:
        self.speeds: dict[str, float] = {}
        self.modes: dict[str, int] = {}

    def setSpeed(self, name: str, speed_mps: float) -> None:  # noqa: N802 - libsumo's name
        self.speeds[name] = speed_mps

    def setSpeedMode(self, name: str, mode: int) -> None:  # noqa: N802 - libsumo's name
        self.modes[name] = mode


@pytest.fixture
def sumo(monkeypatch: pytest.MonkeyPatch) -> SumoVehicles:
    vehicles = SumoVehicles()
    monkeypatch.setattr(caution_module, "libsumo", SimpleNamespace(vehicle=vehicles))
    return vehicles


@pytest.mark.parametrize(
    ("front_m", "decel_mps2", "brake_mps2"), [(70.0, 3.0, None), (70.0, 50.0, 50.0), (73.4, 3.0, "most")]
)
def test_imposed_speeds_brake_comfortably_where_that_is_enough_and_else_as_hard_as_needed(
    sumo: SumoVehicles, front_m: float, decel_mps2: float, brake_mps2: float | str | None
) -> None:
    """The leader at 2 m/s is 10 m or less ahead; the speed falls in one step by the deceleration."""
    cars = [Car(0, front_m, 10.0), Car(0, 80.0, 2.0, Owner.ROS)]
    (caution,) = cautious(cars)
    CautiousDrivers(network(0.0)).apply(traffic_of(cars, network(0.0)), two_vehicles(decel_mps2))
    needed = caution.wait.brake_mps2
    expected = {None: max(needed, 0.0), "most": MOST_BRAKE_MPS2}.get(brake_mps2, brake_mps2)  # type: ignore[arg-type]
    assert sumo.speeds == {"v1": pytest.approx(max(10.0 - float(expected) * STEP_S, 2.0))}
    assert (needed > decel_mps2) is (brake_mps2 != 50.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("turn", TURNS)
def test_who_stands_aside_is_passed_with_a_margin_where_it_is_driven_from_outside(turn: float, side: float) -> None:
    """Half widths of 0.9 m each; 0.2 m more towards those from outside."""
    for owner, apart_m in ((Owner.SUMO, 1.8), (Owner.ROS, 2.0)):
        for more_m, waits in ((-0.05, True), (0.05, False)):
            aside = Car(0, 80.0, 0.0, owner, left=side * (apart_m + more_m))
            assert bool(cautious([Car(0, 72.0, 8.0), aside], turn)) is waits


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("front_m", "turned", "waits"), [(78.0, 0.0, False), (82.0, 0.0, True), (78.0, 0.2, True)])
def test_a_driver_does_not_brake_for_a_vehicle_that_points_at_its_tail(
    turn: float, side: float, front_m: float, turned: float, waits: bool
) -> None:
    """It is beside, 5 cm within the margin. A driver who leaves the course towards it brakes."""
    other = Car(0, front_m, 4.0, Owner.ROS, left=1.95 * side, turned=-0.02 * side)
    assert bool(cautious([Car(0, 80.0, 7.6, turned=turned * side), other], turn)) is waits


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("aside_m", "waits"), [(3.8, True), (4.6, False)])
def test_the_tail_of_a_bus_that_changes_lanes_is_in_the_way(
    turn: float, side: float, aside_m: float, waits: bool
) -> None:
    """At 20° its tail is 2.1 m nearer to the lane's middle than its centre, which is farther aside than any car's."""
    roads = network(turn)
    traffic = traffic_of([Car(0, 72.0, 5.0), Car(0, 84.0, 0.0)], roads)
    place = rotate(np.array([[79.3, side * aside_m]]), turn)[0]
    x, y, yaw = traffic.x_m.copy(), traffic.y_m.copy(), traffic.yaw_rad.copy()
    x[1], y[1], yaw[1] = place[0], place[1], turn + side * np.radians(20.0)
    traffic = replace(traffic, x_m=x, y_m=y, yaw_rad=yaw)
    outlook = Outlook(traffic, CourseBook(roads), np.array([HALF_LENGTH, 6.0]), np.array([HALF_WIDTH, 1.275]))
    assert ([caution.actor_id for caution in cautions(traffic, outlook)] == [1]) is waits


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("riders", [(), (1,), (2,)])
def test_riders_and_others_follow_who_stands_at_an_angle_on_the_same_way(turn: float, riders: tuple[int, ...]) -> None:
    """At 35 degrees, as in a bend: drivers of cars leave it to SUMO."""
    roads = network(turn)
    traffic = traffic_of([Car(0, 72.0, 8.0), Car(0, 84.0, 0.0)], roads)
    yaw = traffic.yaw_rad.copy()
    yaw[1] += np.radians(35.0)
    found = seen(replace(traffic, yaw_rad=yaw), roads, (), (), riders)
    assert [caution.actor_id for caution in found] == ([1] if riders else [])


@pytest.mark.parametrize("riders", [(), (1,), (2,)])
def test_a_rider_and_another_one_beside_each_other_do_not_go_on_together(riders: tuple[int, ...]) -> None:
    """The second one moves as fast, 1.7 m to the left, and its rear is behind the own front."""
    cars = [Car(0, 80.0, 1.3), Car(0, 83.0, 1.3, Owner.ROS, left=1.7)]
    roads = network(0.0)
    found = seen(traffic_of(cars, roads), roads, (), (), riders)
    assert [caution.wait.speed_mps for caution in found] == [0.0 if riders else 1.3]


@pytest.mark.parametrize("kind", [LaneKind.INTERNAL, LaneKind.DRIVING])
@pytest.mark.parametrize("riders", [(), (1,), (2,)])
def test_riders_and_others_give_way_where_they_merge(riders: tuple[int, ...], kind: LaneKind) -> None:
    """The second one turns into the way of the first one, 12 m ahead, as SUMO lets it do.

    On the paths of a junction cars are SUMO's business; of two roads that lie over each other SUMO knows nothing.
    """
    lines = ([[0.0, 0.0], [200.0, 0.0]], [[70.0, -30.0], [100.0, -6.0], [112.0, 0.0], [200.0, 0.0]])
    roads = network(0.0)
    lanes = tuple(
        replace(lane, centre=Polyline.through(line), kind=kind) for lane, line in zip(roads.lanes, lines, strict=True)
    )
    roads = replace(roads, lanes=lanes)
    inside = TrafficFlags.ON_JUNCTION if kind is LaneKind.INTERNAL else TrafficFlags.NONE
    traffic = traffic_of([Car(0, 90.0, 8.0, flags=inside), Car(1, 30.0, 6.0, flags=inside)], roads)
    found = seen(traffic, roads, (), (), riders)
    assert bool(found) is (bool(riders) or kind is LaneKind.DRIVING)


def beside(apart_m: float, *cars: Car) -> tuple[Caution, ...]:
    """Cautions on two one-way roads whose middles run side by side."""
    roads = network(0.0)
    lines = [Polyline.through([[0.0, y_m], [200.0, y_m]]) for y_m in (0.0, apart_m)]
    roads = replace(roads, lanes=tuple(replace(roads.lanes[i], centre=line) for i, line in enumerate(lines)))
    return seen(traffic_of(list(cars), roads), roads)


@pytest.mark.parametrize(
    ("apart_m", "cars", "waits"),
    [
        *[(1.5, [Car(0, 104.0, 4.0), Car(1, 96.0, 8.0)], [2]), (3.2, [Car(0, 104.0, 4.0), Car(1, 96.0, 8.0)], [])],
        (1.5, [Car(0, 100.0, 4.0, left=-1.1), Car(1, 96.0, 8.0)], [2]),
        (1.5, [Car(0, 100.0, 4.0, left=-1.1, turned=-0.3), Car(1, 96.0, 8.0)], []),
        (1.9, [Car(0, 100.0, 4.0), Car(1, 96.0, 5.0)], []),
        (1.9, [Car(0, 100.0, 4.0, turned=0.2), Car(1, 96.0, 5.0)], [2]),
    ],
    ids=["near", "apart", "comes back", "points away", "goes straight on", "points there"],
)
def test_where_roads_lie_over_each_other_one_waits_behind_the_other(
    apart_m: float, cars: list[Car], waits: list[int]
) -> None:
    """A car of 1.8 m width that points at the other road, or away from it, is taken to go there."""
    assert [caution.actor_id for caution in beside(apart_m, *cars)] == waits


def test_of_two_that_touch_on_such_roads_the_one_ahead_goes_on() -> None:
    """And nobody follows one that is still beside it, free of it by 10 cm, and comes nearer."""
    for ahead_m, stopped in ((1.0, [1]), (6.0, [])):
        found = beside(1.5, Car(0, 100.0, 2.5, left=-0.7, turned=0.15), Car(1, 100.0 + ahead_m, 5.0))
        assert [caution.actor_id for caution in found if caution.wait.speed_mps == 0.0] == stopped
    for ahead, behind in ((1, 2), (2, 1)):
        cars = [Car(0, 101.5 if ahead == 1 else 100.0, 0.0), Car(1, 101.5 if ahead == 2 else 100.0, 0.0)]
        assert [caution.actor_id for caution in beside(1.5, *cars)] == [behind]


def shifting(aside_m: float) -> RoadNetwork:
    """A road with two lanes that go aside on 10 m between its two pieces."""
    ends = {"a": (0.0, 0.0), "j": (105.0, 0.5 * aside_m), "b": (210.0, aside_m)}
    shapes = {"aj": "0,0 100,0", "jb": f"110,{aside_m} 210,{aside_m}"}
    nodes = [Element("node", id=name, x=str(x_m), y=str(y_m)) for name, (x_m, y_m) in ends.items()]
    edges = [Element("edge", {"id": way, "from": way[0], "to": way[1], "numLanes": "2", "shape": shape})
             for way, shape in shapes.items()]  # fmt: skip
    files = {"--node-files": document("nodes", nodes), "--edge-files": document("edges", edges)}
    return parse_road_network(mended_lanes(converted("made", ("--offset.disable-normalization",), files)))


@pytest.mark.parametrize(("aside_m", "waits"), [(0.0, False), (14.0, True)])
def test_side_by_side_in_a_swerve_one_waits_until_the_other_is_through(aside_m: float, waits: bool) -> None:
    roads = shifting(aside_m)
    right, left = (way.via[0] for way in sorted(roads.connections, key=lambda way: way.from_lane))
    assert tight_lanes(roads) == (
        {pair for way, other in permutations(roads.connections)
         for pair in product((*way.via, way.to_lane), (*other.via, other.to_lane)) if {*pair} & {right, left}}
        if waits else set()
    )  # fmt: skip
    found = seen(traffic_of([Car(left, 3.0, 6.0), Car(right, 0.5, 6.0)], roads), roads)
    assert [(caution.actor_id, caution.other_id) for caution in found] == ([(2, 1)] if waits else [])


@pytest.mark.parametrize(("kind", "apart_m"), [(ActorClass.SEDAN, 1.8), (ActorClass.BICYCLE, 2.2)])
def test_riders_are_passed_and_pass_with_a_space(sumo: SumoVehicles, kind: ActorClass, apart_m: float) -> None:
    """Half widths of 0.9 m each, and 0.2 m on both of two riders."""
    roads, vehicles = network(0.0), two_vehicles()
    for vehicle in vehicles.values():
        vehicle.actor_class = kind
    for more_m, waits in ((-0.05, True), (0.05, False)):
        traffic = traffic_of([Car(0, 72.0, 8.0), Car(0, 80.0, 0.0, left=apart_m + more_m)], roads)
        sumo.speeds.clear()
        CautiousDrivers(roads).apply(traffic, vehicles)
        assert bool(sumo.speeds) is waits


@pytest.mark.parametrize("turn", TURNS)
def test_of_several_waits_the_strictest_is_kept(turn: float) -> None:
    """A standing vehicle 3 m ahead is stricter than one that comes across 25 m on, whichever is looked at first."""
    across = Car(1, 85.0, 12.0, Owner.ROS)
    ahead = Car(0, 75.0 + 2.0 * HALF_LENGTH + 3.0, 0.0, Owner.ROS)
    for others in ([across, ahead], [ahead, across]):
        (caution,) = cautious([Car(0, 75.0, 13.0), *others], turn)
        assert (caution.other_id, caution.wait.speed_mps) == (2 + others.index(ahead), 0.0)


def test_imposed_speeds_are_along_sumos_length_of_the_lane(sumo: SumoVehicles) -> None:
    """A lane that SUMO takes for shorter than it is: its speeds are lower."""
    roads = network(0.0)
    traffic = traffic_of([Car(0, 70.0, 10.0), Car(0, 80.0, 2.0, Owner.ROS)], roads)
    CautiousDrivers(roads).apply(traffic, two_vehicles(3.0))
    (speed_mps,) = sumo.speeds.values()
    CautiousDrivers(roads).apply(traffic, two_vehicles(3.0), scale_of=lambda lane: {0: 0.9}[lane])
    assert sumo.speeds == {"v1": 0.9 * speed_mps}


@pytest.mark.parametrize(("owner", "at_m", "slowed"), [(0, 95.0, True), (0, 115.0, False), (1, 95.0, False)])
def test_sumos_drivers_come_to_people_on_a_crossing_at_walking_pace(
    sumo: SumoVehicles, owner: int, at_m: float, *, slowed: bool
) -> None:
    """The crossing begins 12 m ahead of the front; on it somebody stands 1.5 m beside the way."""
    corners = np.array([(92.0, -5.0), (98.0, -5.0), (98.0, 5.0), (92.0, 5.0)])
    roads = replace(network(0.0), crossings=(corners,))
    pose = (np.array([at_m]), np.array([HALF_WIDTH + 1.5]), np.zeros(1), np.zeros(1))
    people = people_at([9], pose, outlines_of(roads))
    cars = [Car(0, 80.0, 8.0, Owner(owner)), Car(1, 10.0, 0.0)]
    CautiousDrivers(roads).apply(traffic_of(cars, roads), two_vehicles(3.0), people)
    assert sumo.speeds == ({"v1": pytest.approx(8.0 - 3.0 * STEP_S, abs=0.05)} if slowed else {})


@pytest.mark.parametrize(("attentive", "slowed"), [(True, {"v1"}), (False, set())])
def test_the_drivers_who_do_not_look_out_are_the_inattentive_ones(
    sumo: SumoVehicles, attentive: bool, slowed: set[str]
) -> None:
    traffic = traffic_of([Car(0, 75.0, 13.0), Car(1, 85.0, 12.0, Owner.ROS)], network(0.0))
    CautiousDrivers(network(0.0)).apply(traffic, two_vehicles(attentive=attentive))
    assert set(sumo.speeds) == slowed


def test_who_need_not_wait_any_more_gets_its_own_speed_back(sumo: SumoVehicles) -> None:
    vehicles, drivers = two_vehicles(), CautiousDrivers(network(0.0))
    near = traffic_of([Car(0, 70.0, 10.0), Car(0, 80.0, 2.0, Owner.ROS)], network(0.0))
    free = traffic_of([Car(0, 20.0, 10.0), Car(0, 180.0, 2.0, Owner.ROS)], network(0.0))
    drivers.apply(None, vehicles)
    assert sumo.speeds == {}
    drivers.apply(near, vehicles)
    assert sumo.modes == {"v1": 27}
    assert 0.0 < sumo.speeds["v1"] < 10.0
    drivers.apply(free, vehicles)
    assert (sumo.speeds, sumo.modes) == ({"v1": -1.0}, {"v1": 31})
    sumo.speeds.clear()
    drivers.apply(free, vehicles)
    assert sumo.speeds == {}, "it is set once"
    drivers.apply(near, vehicles)
    sumo.speeds.clear()
    drivers.apply(None, {2: vehicles[2]})
    drivers.apply(free, vehicles)
    assert sumo.speeds == {}, "who has left is left alone"


@pytest.mark.parametrize("seed", range(6))
def test_near_pairs_are_those_of_looking_at_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = [0, 1, 30, 90, 90, 150][seed]
    yaw = rng.uniform(-np.pi, np.pi, n)
    poses = rng.uniform(0.0, 260.0, n), rng.uniform(0.0, 260.0, n), np.cos(yaw), np.sin(yaw)
    speed, half_length = rng.choice([0.0, 0.2, 8.0, 38.0], n), rng.choice([2.3, 9.0], n)
    inside, counts = rng.random(n) < 0.8, rng.random(n) < 0.3
    order = np.argsort(poses[0], kind="stable")
    flags = inside, counts, inside, inside, inside
    drivers = Drivers(poses[0], poses[1], yaw, speed, speed, half_length, *flags)
    found = near_pairs(drivers, order)
    pairs = [(a, b) for a in range(n) for b in range(n) if a != b and inside[a]]
    expected = [pair for pair in pairs if is_near(*pair, poses, speed, half_length, counts)]
    assert [tuple(pair) for pair in found.tolist()] == expected


def is_near(row: int, other: int, poses: Any, speed: Any, half_length: Any, counts: Any) -> bool:
    x, y, cos, sin = poses
    apart = np.array([x[other] - x[row], y[other] - y[row]])
    own, theirs = np.array([cos[row], sin[row]]), np.array([cos[other], sin[other]])
    ahead, left = own @ apart, own[0] * apart[1] - own[1] * apart[0]
    reach = min(WAYS_AHEAD_S * (speed[row] + speed[other]) + 2.0 * WAYS_MORE_M, WAYS_FAR_M)
    if np.linalg.norm(apart) < reach and counts[other]:
        return True
    moving = min(speed[row], speed[other]) > ROLLING_MPS
    if np.linalg.norm(apart) < reach and moving and abs(own @ theirs) < 0.9 and ahead > -WAYS_MORE_M:
        return True
    sideways = half_length[other] * abs(own[0] * theirs[1] - own[1] * theirs[0])
    return bool(0.0 < ahead < speed[row] + WAYS_MORE_M and abs(left) < BESIDE_M + sideways)


def test_who_waits_stays_clear_of_the_tail_of_a_long_vehicle_in_its_tightest_bend():
    """The centre of a long vehicle keeps to a circle; its heading is behind the circle's by what its rear axle lags."""
    for vehicle in load_vehicle_parameters().values():
        lag_rad = math.atan(vehicle.centre_ahead_of_rear_axle_m / LONG_VEHICLE_RADIUS_M)
        assert AMONG_THEMSELVES.standoff_m > 0.5 * vehicle.length_m * math.sin(lag_rad)
