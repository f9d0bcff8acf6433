"""How fast SUMO's vehicles may be before, in and behind a bend, on a road whose radius and lengths are known.

A straight lane of 100 m leads east (z), 10 m across a junction to another one of 100 m (a). There a quarter circle of
12 m radius turns left into a lane to the north (b), and 20 m lead straight on into another one (c).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import libsumo
import numpy as np
import pytest
from made_streets import CAR_M, same_drivers
from map_networks import network_of_map, plain_net
from traffic_helpers import WITHOUT, columns_of, load_map, plan_s2

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, Edge, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle, Spot
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo import driving_corrections as lane_continuity
from siren_ros.simulation.traffic.sumo.driving_corrections import (
    BRAKING_MPS2,
    LATERAL_ACCEL_MPS2,
    SIDEWAYS_SHARE,
    BendLimits,
    LaneContinuity,
    SidewaysLimits,
    look_ahead_m,
)
from siren_ros.simulation.traffic.sumo.readings import ALONG, X, Y
from siren_ros.simulation.world.actors import ActorClass, Owner

RADIUS_M = 12.0
BEND_M = 0.5 * np.pi * RADIUS_M
BEND_MPS = np.sqrt(LATERAL_ACCEL_MPS2 * RADIUS_M)
FULL_BEND_M = 102.0
"""On lane a, then through the bend: from here on all of a vehicle's wheelbase is in the bend."""
OWN_MPS = 30.0
LIMIT_MPS = 13.9
LANES = ("z_0", "a_0", "b_0", "c_0", "za_0", "ab_0", "ac_0")


def bend_ahead() -> RoadNetwork:
    turned = np.linspace(0.0, 0.5 * np.pi, 96)
    circle = np.stack((100.0 + RADIUS_M * np.sin(turned), RADIUS_M * (1.0 - np.cos(turned))), axis=-1)
    lines = (
        [(-110.0, 0.0), (-10.0, 0.0)],
        [(0.0, 0.0), (100.0, 0.0)],
        [(112.0, 12.0), (112.0, 112.0)],
        [(120.0, 0.0), (220.0, 0.0)],
        [(-10.0, 0.0), (0.0, 0.0)],
        circle,
        [(100.0, 0.0), (120.0, 0.0)],
    )
    lanes, edges = [], []
    for index, (name, points) in enumerate(zip(LANES, lines, strict=True)):
        internal = index > 3
        kind = LaneKind.INTERNAL if internal else LaneKind.DRIVING
        lanes.append(Lane(index, name, index, 0, kind, Polyline.through(points), 3.5, LIMIT_MPS, True, True))
        edges.append(Edge(index, name[:-2], (index,), "from", "to", internal))
    connections = tuple(
        Connection(source, target, (via,), direction, None, -1, must_stop=False, junction="J")
        for source, target, via, direction in ((0, 1, 4, "s"), (1, 2, 5, "l"), (1, 3, 6, "s"))
    )
    return RoadNetwork(tuple(lanes), tuple(edges), connections, {}, (0.0, 0.0), "!")


def car(*route: str) -> PlannedVehicle:
    driver = same_drivers().draw(ActorClass.SEDAN, np.random.default_rng(1))
    driver = replace(driver, driving=replace(driver.driving, max_speed_mps=OWN_MPS))
    spot = Spot(1, 10.0, 5.0)
    return PlannedVehicle("car", ActorClass.SEDAN, CAR_M, 1.8, 1.5, (9, 9, 9), driver, route, spot)


def reading(lane: str, at_m: float, speed_mps: float = 0.0, index: int = 0) -> Mapping[int, Any]:
    return {
        libsumo.VAR_LANE_ID: lane,
        libsumo.VAR_LANEPOSITION: at_m,
        libsumo.VAR_SPEED: speed_mps,
        libsumo.VAR_ROUTE_INDEX: index,
    }


class Drive:
    """A vehicle with all limits that SUMO was given for it."""

    def __init__(self, *route: str, scale: float = 1.0, network: RoadNetwork | None = None) -> None:
        self._vehicles = {"car": car(*route)}
        network = network or bend_ahead()
        self._limits = BendLimits(network)
        self._columns = columns_of({}, network, {lane.lane_id: scale for lane in network.lanes})
        self.limits_mps: list[float] = []

    def limit_mps(self, *state: Any, mirrored: tuple[str, ...] = (), **more: Any) -> float:
        self._columns.take({"car": WITHOUT | reading(*state, **more)})
        self._limits.apply(self._columns, self._vehicles, self._columns.which(mirrored))
        return self.limits_mps[-1] if self.limits_mps else OWN_MPS

    def leave(self) -> None:
        self._columns.take({})
        self._limits.apply(self._columns, self._vehicles, self._columns.which(()))

    def tell(self, name: str, speed_mps: float) -> None:
        assert name == "car"
        self.limits_mps.append(speed_mps)


@pytest.fixture
def drive(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Drive]:
    def begin(*route: str, **more: Any) -> Drive:
        driven = Drive(*route, **more)
        monkeypatch.setattr(libsumo.vehicle, "setMaxSpeed", driven.tell)
        return driven

    return begin


def before_bend_mps(at_m: float) -> float:
    return float(np.sqrt(BEND_MPS**2 + 2.0 * BRAKING_MPS2 * (FULL_BEND_M - at_m)))


@pytest.mark.parametrize("at_m", [0.0, 40.0, 80.0, 98.0])
def test_before_a_bend_one_may_be_as_fast_as_one_brakes_comfortably(drive: Callable[..., Drive], at_m: float) -> None:
    assert drive("a", "b").limit_mps("a_0", at_m) == pytest.approx(before_bend_mps(at_m), rel=0.01)


@pytest.mark.parametrize("at_m", [4.0, 10.0, 15.0])
def test_in_a_bend_the_lateral_acceleration_is_the_limit(drive: Callable[..., Drive], at_m: float) -> None:
    assert drive("a", "b").limit_mps("ab_0", at_m) == pytest.approx(BEND_MPS, rel=0.02)


@pytest.mark.parametrize("kind", [ActorClass.BICYCLE, ActorClass.MOTORCYCLE])
def test_riders_take_bends_with_four_fifths_of_the_speed(monkeypatch: pytest.MonkeyPatch, kind: ActorClass) -> None:
    network, told = bend_ahead(), list[float]()
    monkeypatch.setattr(libsumo.vehicle, "setMaxSpeed", lambda _, speed_mps: told.append(speed_mps))
    columns = columns_of({"car": reading("ab_0", 10.0)}, network, dict.fromkeys(LANES, 1.0))
    rider = replace(car("a", "b"), actor_class=kind)
    BendLimits(network).apply(columns, {"car": rider}, columns.which(()))
    assert told == [pytest.approx(0.8 * BEND_MPS, rel=0.02)]


def test_no_limit_drops_where_one_lane_follows_another(drive: Callable[..., Drive], tmp_path: Path) -> None:
    """Six short roads lead to a sharp turn, whose left lane leads to either lane of the next road."""
    xs = (-100.0, *np.arange(0.0, 91.0, 15.0))
    nodes = "".join(f'<node id="{k}" x="{x}" y="{0.3 * (k % 2)}"/>' for k, x in enumerate(xs))
    edge = '<edge id="e{0}" from="{0}" to="{1}" numLanes="2"/>'
    edges = "".join(edge.format(k, k + 1) for k in range(len(xs)))
    lanes = "".join(f'<connection from="e6" to="e7" fromLane="{a}" toLane="{b}"/>' for a, b in ((0, 0), (1, 0), (1, 1)))
    net = plain_net(tmp_path, f'{nodes}<node id="8" x="70.0" y="60.0"/>', edges, lanes)
    network, joints = network_of_map(net), 0
    route = [f"e{k}" for k in range(8)]
    for movement in network.connections:
        ways = [network.lanes[index] for index in (movement.from_lane, *movement.via, movement.to_lane)]
        index = int(ways[0].lane_id[1])
        for lane, following in pairwise(ways):
            end = drive(*route, network=network).limit_mps(lane.lane_id, lane.length_m, index=index)
            later = index + int(following is ways[-1])
            begin = drive(*route, network=network).limit_mps(following.lane_id, 0.0, index=later)
            assert end <= begin + 1e-6 or begin > LIMIT_MPS
            joints += begin < LIMIT_MPS
    assert joints > 10


def test_the_bend_of_another_way_does_not_count(drive: Callable[..., Drive]) -> None:
    straight_on = drive("a", "c")
    assert [straight_on.limit_mps("a_0", at_m) for at_m in (0.0, 60.0, 99.0)] == [OWN_MPS] * 3
    assert straight_on.limit_mps("ac_0", 10.0) == OWN_MPS
    assert not straight_on.limits_mps


@pytest.mark.parametrize(("index", "limited"), [(-1, True), (0, True), (1, False)])
def test_a_route_counts_from_the_edge_that_the_vehicle_is_on(
    drive: Callable[..., Drive], index: int, limited: bool
) -> None:
    assert (drive("a", "b").limit_mps("a_0", 90.0, index=index) < OWN_MPS) == limited


def test_a_bend_counts_from_90_m_behind_a_lanes_end_on_or_from_as_far_as_the_fastest_need_to_stop(
    drive: Callable[..., Drive],
) -> None:
    network = bend_ahead()
    slow = replace(network, lanes=tuple(replace(lane, speed_limit_mps=8.0) for lane in network.lanes))
    far = drive("z", "a", "b", network=slow)
    assert far.limit_mps("z_0", 99.0) == OWN_MPS
    assert far.limit_mps("za_0", 5.0) == OWN_MPS
    assert far.limit_mps("a_0", 1.0, index=1) == pytest.approx(before_bend_mps(1.0), rel=0.01)
    assert look_ahead_m(slow.lanes[0]) == 90.0
    assert look_ahead_m(replace(slow.lanes[0], speed_limit_mps=30.0)) == pytest.approx(45.0**2 / (2.0 * BRAKING_MPS2))


def test_who_is_faster_than_the_limit_brakes_for_a_far_bend_before_its_road_begins(drive: Callable[..., Drive]) -> None:
    """The bend is 100 m from where the road begins: more than 90 m, and than 64 m to stop from the limit."""
    far = drive("z", "a", "b")
    limits = [far.limit_mps(*place) for place in (("z_0", 100.0, 0.0, 0), ("za_0", 10.0, 0.0, 0), ("a_0", 0.0, 0.0, 1))]
    assert limits == [pytest.approx(before_bend_mps(at_m), rel=0.02) for at_m in (-10.0, 0.0, 0.0)]


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_the_bend_holds_a_vehicle_until_its_rear_has_left(drive: Callable[..., Drive], scale: float) -> None:
    """With 6 m/s the front bumper moves 0.3 m a step, twice as far where a lane is half as long for SUMO."""
    through = drive("a", "b", scale=scale)
    for front_m in np.arange(90.05, 140.0, 0.3 / scale):
        in_bend = 100.0 <= front_m < 100.0 + BEND_M
        lane, start = ("ab_0", 100.0) if in_bend else ("a_0", 0.0) if front_m < 100.0 else ("b_0", 100.0 + BEND_M)
        limit = through.limit_mps(lane, (front_m - start) * scale, 6.0, index=int(lane == "b_0"))
        rear_m = front_m - CAR_M
        if front_m < FULL_BEND_M:
            assert limit == pytest.approx(scale * before_bend_mps(front_m), rel=0.02)
        elif rear_m < 97.0 + BEND_M:
            assert limit == pytest.approx(scale * BEND_MPS, rel=0.02)
        elif rear_m > 100.0 + BEND_M + 0.31 / scale:
            assert limit == OWN_MPS


def test_a_vehicle_that_stands_in_a_bend_stays_held_and_another_of_its_name_is_not(drive: Callable[..., Drive]) -> None:
    standing = drive("a", "b")
    for _ in range(200):
        standing.limit_mps("ab_0", 10.0)
    assert standing.limit_mps("b_0", 0.0, 6.0, index=1) == pytest.approx(BEND_MPS, rel=0.02)
    standing.leave()
    standing.limits_mps.clear()
    assert standing.limit_mps("b_0", 0.5, 6.0, index=1) == OWN_MPS


def test_who_is_moved_from_outside_has_no_limit(drive: Callable[..., Drive]) -> None:
    moved = drive("a", "b")
    assert moved.limit_mps("a_0", 90.0) < OWN_MPS
    assert moved.limit_mps("a_0", 91.0, mirrored=("car",)) == OWN_MPS
    assert moved.limit_mps("a_0", 92.0) == pytest.approx(before_bend_mps(92.0), rel=0.01)
    assert moved.limit_mps("unknown_0", 5.0) == OWN_MPS


def test_sumo_is_told_of_changes_that_matter(drive: Callable[..., Drive]) -> None:
    """On lanes that are half as long for SUMO a metre of the centre line changes the limit by 0.04 m/s."""
    slow = drive("a", "b", scale=0.5)
    for at_m in (0.0, 0.2, 0.5):
        slow.limit_mps("a_0", at_m)
    assert slow.limits_mps == [pytest.approx(0.5 * before_bend_mps(0.0), rel=0.01)]
    slow.limit_mps("a_0", 1.0)
    assert slow.limits_mps[1:] == [pytest.approx(0.5 * before_bend_mps(2.0), rel=0.01)]


def test_a_place_before_the_lane_is_its_beginning(drive: Callable[..., Drive]) -> None:
    """SUMO gives a large negative place to a vehicle that it has nowhere."""
    limits = [drive("a", "b").limit_mps("ab_0", at_m) for at_m in (-1e9, -3.0, 0.0)]
    assert limits == [limits[2]] * 3


def test_a_route_that_cannot_be_driven_on_has_no_bends_behind_the_break(drive: Callable[..., Drive]) -> None:
    broken = drive("a", "z", "b")
    assert broken.limit_mps("a_0", 90.0) == OWN_MPS
    assert drive("a", "b").limit_mps("a_0", 90.0) < OWN_MPS


def test_another_episode_on_the_same_map_has_the_same_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Profiles are kept by map: what a first vehicle asked for does not change what a second one gets."""
    network, told = bend_ahead(), []
    monkeypatch.setattr(libsumo.vehicle, "setMaxSpeed", lambda _, speed_mps: told.append(speed_mps))
    for route, lane in ((("a", "b"), "a_0"), (("a", "c"), "a_0"), (("a", "b"), "ab_0"), (("a", "b"), "a_0")):
        columns = columns_of({"car": reading(lane, 5.0)}, network, dict.fromkeys(LANES, 1.0))
        BendLimits(network).apply(columns, {"car": car(*route)}, columns.which(()))
    assert told == [pytest.approx(limit, rel=0.02) for limit in (before_bend_mps(5.0), BEND_MPS, before_bend_mps(5.0))]
    assert told[0] == told[2]


RADIUS, WIDTH = 40.0, 4.0
OFFSET = (100.0, 50.0)
SUMO_LENGTH = RADIUS * np.pi / 2.0


def network():
    """A quarter circle to the left of two lanes, the right one outside; and a road of its own."""
    a = np.linspace(0.0, np.pi / 2.0, 200)
    lanes = []
    for position, radius in enumerate((RADIUS + WIDTH, RADIUS)):
        points = np.stack((radius * np.sin(a), RADIUS - radius * np.cos(a)), axis=-1)
        centre = Polyline.through(points)
        lanes.append(Lane(position, f"e0_{position}", 0, position, LaneKind.DRIVING, centre, WIDTH, 13.9, True, True))
    other = Polyline.through([[0.0, -50.0], [60.0, -50.0]])
    lanes.append(Lane(2, "e1_0", 1, 0, LaneKind.DRIVING, other, WIDTH, 13.9, True, True))
    edges = (Edge(0, "e0", (0, 1), "A", "B", internal=False), Edge(1, "e1", (2,), "C", "D", internal=False))
    return RoadNetwork(tuple(lanes), edges, (), {}, OFFSET, "!")


@pytest.fixture
def moved(monkeypatch):
    calls = []
    fake = SimpleNamespace(**{name: getattr(libsumo, name) for name in dir(libsumo) if name.startswith("VAR_")})
    fake.vehicle = SimpleNamespace(moveTo=lambda *arguments: calls.append(arguments))
    monkeypatch.setattr(lane_continuity, "libsumo", fake)
    return calls


NETWORK = network()
SCALE = {"e0_0": SUMO_LENGTH / NETWORK.lanes[0].length_m, "e0_1": 1.0, "e1_0": 1.0}


def result_at(lane, along, speed=8.0, lateral=0.3):
    """What SUMO says of a vehicle whose front is at an arc length of a lane."""
    x, y = NETWORK.lane_by_id[lane].centre.at(along)
    return {
        libsumo.VAR_LANE_ID: lane,
        libsumo.VAR_POSITION: (x + OFFSET[0], y + OFFSET[1]),
        libsumo.VAR_LANEPOSITION: along * SCALE[lane],
        libsumo.VAR_LANEPOSITION_LAT: lateral,
        libsumo.VAR_SPEED: speed,
    }


def after(before, now, skip=()):
    continuity, columns = LaneContinuity(NETWORK), columns_of({"v": before}, NETWORK, SCALE)
    continuity.correct(columns, ())
    columns.take({"v": WITHOUT | now})
    continuity.correct(columns, skip)
    return columns.numbers[:, 0]


@pytest.mark.parametrize(("origin", "target", "radii"), [("e0_1", "e0_0", 1.1), ("e0_0", "e0_1", 1.0 / 1.1)])
def test_a_lane_change_in_a_bend_goes_on_where_the_motion_leads(moved, origin, target, radii):
    """SUMO keeps the share of the length, so the place alongside; here it is 3 m off."""
    along = 30.0
    alongside = along * radii
    expected = alongside + 8.0 / SCALE[target] * STEP_S
    for off in (3.0, -3.0):
        moved.clear()
        now = after(result_at(origin, along), result_at(target, expected + off))
        ((name, lane, position),) = moved
        assert (name, lane) == ("v", target)
        assert position == pytest.approx(expected * SCALE[target], abs=0.02)
        assert now[ALONG] == position
        point = NETWORK.lane_by_id[target].centre.offset_points(position / SCALE[target], 0.3)
        assert now[[X, Y]] == pytest.approx((point[0] + OFFSET[0], point[1] + OFFSET[1]))


@pytest.mark.parametrize(("origin", "target"), [("e0_1", "e0_1"), ("e0_1", "e1_0"), ("e0_1", "gone")])
def test_only_changes_to_a_lane_of_the_same_edge_are_corrected(moved, origin, target):
    now = result_at(origin, 40.0) if target == "gone" else result_at(target, 40.0)
    now[libsumo.VAR_LANE_ID] = target
    after(result_at(origin, 30.0), now)
    assert moved == []


def test_vehicles_moved_from_outside_or_right_in_place_and_places_beyond_the_lane_are_left_alone(moved):
    after(result_at("e0_1", 30.0), result_at("e0_0", 40.0), skip=("v",))
    after(result_at("e0_1", 30.0), result_at("e0_0", 33.0 + 8.0 / SCALE["e0_0"] * STEP_S + 0.03))
    after(result_at("e0_1", SUMO_LENGTH - 0.1, speed=30.0), result_at("e0_0", 40.0))
    assert moved == []


def test_what_counts_is_the_step_before(moved):
    continuity, columns = LaneContinuity(NETWORK), columns_of({}, NETWORK, SCALE)
    for results in ({"v": result_at("e0_1", 30.0)}, {}, {"v": result_at("e0_0", 40.0)}):
        columns.take({name: WITHOUT | result for name, result in results.items()})
        continuity.correct(columns, ())
    assert moved == []


def test_of_several_vehicles_the_one_that_changed_is_corrected_also_when_another_one_has_left(moved):
    continuity = LaneContinuity(NETWORK)
    stays, changed = result_at("e0_1", 10.0), result_at("e0_1", 30.0)
    columns = columns_of({"a": stays, "gone": stays, "v": changed}, NETWORK, SCALE)
    continuity.correct(columns, ())
    columns.take({"a": WITHOUT | stays, "v": WITHOUT | result_at("e0_0", 40.0)})
    continuity.correct(columns, ())
    assert [name for name, _, _ in moved] == ["v"]


COMPILED, NETWORK_SIDEWAYS = load_map(None)
PLAN = plan_s2(NETWORK_SIDEWAYS, warm_up_s=10.0)[0]


@pytest.fixture
def sumo() -> Iterator[SumoSimulation]:
    with SumoSimulation(COMPILED, NETWORK_SIDEWAYS, PLAN, EmergencyLevel.L0) as simulation:
        yield simulation


def test_the_limit_follows_the_speed_and_mirrored_vehicles_are_held(sumo: SumoSimulation) -> None:
    sumo.step(0, None)
    vehicles = {vehicle.name: vehicle for vehicle in PLAN.groups[:3]}
    slow, fast, mirrored = vehicles
    own = vehicles[fast].driver.max_lateral_speed_mps
    speeds = {slow: 1.0, fast: 10.0, mirrored: 10.0}
    limits = SidewaysLimits()
    columns = columns_of({name: {libsumo.VAR_SPEED: speed} for name, speed in speeds.items()}, NETWORK_SIDEWAYS, {})
    limits.apply(columns, vehicles, columns.which({mirrored}))
    assert 0.1 < libsumo.vehicle.getMaxSpeedLat(slow) <= SIDEWAYS_SHARE * 1.0
    assert libsumo.vehicle.getMaxSpeedLat(fast) == own
    assert libsumo.vehicle.getMaxSpeedLat(mirrored) < 0.01
    columns.take({name: WITHOUT | {libsumo.VAR_SPEED: 10.0} for name in vehicles})
    limits.apply(columns, vehicles, columns.which(()))
    assert [libsumo.vehicle.getMaxSpeedLat(name) for name in vehicles] == [own] * 3


def test_drivers_move_sideways_at_their_own_pace_but_who_makes_way_as_fast_as_all(sumo: SumoSimulation) -> None:
    sumo.step(0, None)
    vehicles = {car.name: replace(car, lane_change_s=9.0) for car in PLAN.groups[:3]}
    asked, other, last = vehicles
    columns = columns_of({name: {libsumo.VAR_SPEED: 10.0} for name in vehicles}, NETWORK_SIDEWAYS, {})
    limits, usual_mps = SidewaysLimits(), vehicles[asked].driver.max_lateral_speed_mps
    limits.apply(columns, vehicles, columns.which(()), {asked, "who has left"})
    slow_mps = [libsumo.vehicle.getMaxSpeedLat(name) for name in (other, last)]
    assert libsumo.vehicle.getMaxSpeedLat(asked) == usual_mps
    assert slow_mps == [pytest.approx(vehicles[other].sideways[0])] * 2
    limits.apply(columns, vehicles, columns.which(()), {other})
    assert libsumo.vehicle.getMaxSpeedLat(asked) == slow_mps[0] < libsumo.vehicle.getMaxSpeedLat(other) == usual_mps


def test_nobody_slides_sideways_while_standing(sumo: SumoSimulation) -> None:
    before = sumo.step(0, None)
    stood = 0
    for step in range(1, 150):
        state = sumo.step(step, None)
        common = np.intersect1d(state.actor_id, before.actor_id)
        now, then = np.searchsorted(state.actor_id, common), np.searchsorted(before.actor_id, common)
        standing = (state.sumo_speed_mps[now] < 0.01) & (before.sumo_speed_mps[then] < 0.01)
        standing &= state.owner[now] == Owner.SUMO
        moved = np.hypot(state.sumo_x_m[now] - before.sumo_x_m[then], state.sumo_y_m[now] - before.sumo_y_m[then])
        assert np.all(moved[standing] < 0.002)
        stood += int(standing.sum())
        before = state
    assert stood > 100


def test_cyclists_ride_in_the_middle_of_narrow_lanes_and_30_cm_from_the_edge_of_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    network: Any = SimpleNamespace(lanes=[SimpleNamespace(width_m=width) for width in (1.85, 3.4, 3.0)])
    said: list[tuple[str, str]] = []
    vehicle = SimpleNamespace(setLateralAlignment=lambda name, side: said.append((name, side)))
    monkeypatch.setattr(lane_continuity, "libsumo", SimpleNamespace(vehicle=vehicle))
    kinds = {"b": ActorClass.BICYCLE, "c": ActorClass.SEDAN}
    vehicles: Any = {name: SimpleNamespace(actor_class=kind, width_m=0.6) for name, kind in kinds.items()}
    side = lane_continuity.CyclistsSide(network)

    def on(lane: int, other: int = 0) -> list[tuple[str, str]]:
        said.clear()
        columns: Any = SimpleNamespace(names=["b", "c"], lane=np.array([lane, other]), lane_ids=(str(lane), str(other)))
        side.apply(columns, vehicles)
        return list(said)

    assert on(1) == [("b", "-1.10")]
    assert on(0) == [("b", "center")]
    assert on(0, other=1) == []
    assert on(NO_LANE) == []
    assert on(2) == [("b", "-0.90")]
