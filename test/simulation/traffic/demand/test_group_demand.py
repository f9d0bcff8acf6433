"""The vehicles of a template's groups on two streets that cross, and where lanes branch off."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import pytest
from made_streets import (
    A_LEFT,
    A_RIGHT,
    B_LEFT,
    B_RIGHT,
    C_LEFT,
    C_RIGHT,
    CAR_M,
    CONFIG,
    CROSSING,
    FAR,
    LIMIT_MPS,
    NEAR,
    SOUTH,
    STRAIGHT,
    TURN,
    A,
    B,
    C,
    D,
    Road,
    crossing,
    group,
    same_drivers,
    signal_site,
    start_at,
    streets,
    template_with,
    with_connection,
)
from traffic_helpers import DIMENSIONS

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.sites import SiteKind
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.scenario.scenario import DemandGroup, GroupAnchor, Placement, SignalDemand, ValueRange
from siren_ros.simulation.traffic.demand.emv_start import EmvStart, bound_s_of, unhindered_arrival_s
from siren_ros.simulation.traffic.demand.group_demand import GroupPlan, plan_groups
from siren_ros.simulation.traffic.demand.plan import LEAST_HEADWAY_S, LaneInterval, PlannedVehicle, Spot
from siren_ros.simulation.traffic.demand.road_users import VehicleFactory
from siren_ros.simulation.world.actors import ActorClass

NETWORK = streets()
STARTS_M = {A_RIGHT: 0.0, A_LEFT: 0.0, B_RIGHT: 210.0, B_LEFT: 210.0, FAR: 0.0, NEAR: 200.0}
"""Where lanes begin on the way to the stop line."""
NOTHING: Final[Mapping[str, Any]] = MappingProxyType({})


def planned(
    *groups: DemandGroup,
    start: EmvStart | None = None,
    traffic: TrafficDrivers = CONFIG,
    seed: int = 0,
    network: RoadNetwork = NETWORK,
    demand: Mapping[str, Any] = NOTHING,
    template: Mapping[str, Any] = NOTHING,
    **site: Any,
) -> GroupPlan:
    """The plan with other fields of the site, of the template and of its demand."""
    factory, where = VehicleFactory(network, same_drivers(), DIMENSIONS), replace(signal_site(), **site)
    asked = template_with(*groups)
    asked = replace(asked, demand=replace(asked.demand, **demand), **template)
    return plan_groups(network, where, start or start_at(90.0), asked, seed, factory, traffic)


def test_the_plan_of_five_groups() -> None:
    """Cars of 4.6 m; 5 m or 3 m apart behind a first gap of 7 m or 12 m. All wish for 0.9 of the limit.

    Of the two crossing rows the second one shares its lane with the queues and begins behind them, at a whole metre.
    Behind each 25 m of road stay free.
    """
    lead = replace(platoon(2), name="lead")
    queue = replace(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, 2, standing=True), name="queue")
    more = replace(queue, name="more", vehicles=1)
    beside = replace(group(Placement.SAME_DIRECTION, GroupAnchor.EMV, 1), name="beside")
    groups = lead, queue, more, beside, replace(crossing(7), name="across")
    plan = planned(*groups, demand={"speed_factor": 0.9}, crossing=(CROSSING, TURN))
    side, joined = ("n", "d"), ("b", "d")
    expected = {
        "lead0": (A_LEFT, 106.6, 8.0, ("a", "b", "c"), 5.0),
        "lead1": (A_LEFT, 116.2, 8.0, ("a", "b", "c"), 5.0),
        "queue0": (B_RIGHT, 93.0, 0.0, ("b", "c"), 5.0),
        "queue1": (B_RIGHT, 83.4, 0.0, ("b", "c"), 5.0),
        "more0": (B_RIGHT, 73.8, 0.0, ("b", "c"), 5.0),
        "beside0": (A_RIGHT, 101.6, 8.0, ("a", "b", "c"), 5.0),
        **{f"across{n}": (NEAR, 93.0 - 3.8 * n, 0.0, side, 3.0) for n in (0, 2, 4, 6)},
        **{f"across{n}": (B_RIGHT, 64.0 - 3.8 * (n - 1), 0.0, joined, 3.0) for n in (1, 3, 5)},
    }
    assert {vehicle.name for vehicle in plan.vehicles} == expected.keys()
    for vehicle in plan.vehicles:
        lane, front_m, speed_mps, route, spacing_m = expected[vehicle.name]
        assert vehicle.spot == Spot(lane, pytest.approx(front_m), speed_mps), vehicle.name
        assert (vehicle.route, vehicle.driver.speed_factor) == (route, 0.9)
        assert (vehicle.driver.speed_gain_eagerness == 0.0) is (vehicle.name == "beside0")
        headway_s = (spacing_m - vehicle.driver.driving.min_gap_m) / 8.0
        assert vehicle.driver.tau_s == pytest.approx(min(max(headway_s, LEAST_HEADWAY_S), 1.2))
    stage = [LaneInterval(NEAR, pytest.approx(40.6), 100.0), LaneInterval(B_RIGHT, pytest.approx(19.2), 100.0)]
    assert plan == GroupPlan(plan.vehicles, 303.0, tuple(stage), (CROSSING, TURN))


def test_the_first_crossing_row_lasts_until_the_emv_comes() -> None:
    """Four at least, and one in 2 s of red: of seven vehicles the second row gets some only after a short red."""
    for vehicles, red_s, ways in ((7, 4.0, (CROSSING, TURN)), (6, 4.0, (CROSSING,)), (7, 12.0, (CROSSING,))):
        plan = planned(crossing(vehicles), template={"signal": SignalDemand(red_s)}, crossing=(CROSSING, TURN))
        assert plan.crossing == ways


def at_stop(*groups: DemandGroup, kind: SiteKind = SiteKind.STOP_JUNCTION, **demand: Any) -> list[str]:
    """Names of the vehicles that are planned there, within 40 s."""
    plan = planned(*groups, template={"duration_s": 40.0}, demand=demand, kind=kind)
    return [vehicle.name for vehicle in plan.vehicles]


def test_with_riders_fewer_lead_the_emv_at_a_stop_sign() -> None:
    """Each takes 9.6 s, and the EMV the turn after the last of them; others wait as they are."""
    queue = replace(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, 5, standing=True), name="own")
    others = replace(crossing(5), name="other")
    assert len(at_stop(queue, others)) == 10
    for kind in ("pedestrians", "cyclists", "motorcycles"):
        riders = {"people": replace(template_with().demand.people, **{kind: 3})}
        assert at_stop(queue, others, **riders) == [*(f"own{n}" for n in range(3)), *(f"other{n}" for n in range(5))]
        assert len(at_stop(queue, others, kind=SiteKind.SIGNAL_JUNCTION, **riders)) == 10


def test_at_a_stop_sign_the_queue_of_missing_lanes_waits_behind_the_other_one_as_many_as_go_in_time() -> None:
    """One in 4 s until the EMV comes, and one more."""
    queue = replace(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, 2, standing=True), name="own")
    turning = replace(group(Placement.TURNING_LANES, GroupAnchor.STOP_LINE, 9, standing=True), name="turning")
    emv = template_with().emv
    in_time = math.ceil(unhindered_arrival_s(NETWORK, start_at(90.0), emv, math.inf) / 4.0) + 1
    assert 4 < in_time < 10
    assert len(at_stop(queue, turning)) == in_time
    assert len(at_stop(queue, replace(turning, vehicles=1))) == 3
    assert len(at_stop(queue, turning, background_vehicles=4)) == 4
    assert at_stop(queue, turning, kind=SiteKind.SIGNAL_JUNCTION) == ["own0", "own1"]


def platoon(vehicles: int = 3) -> DemandGroup:
    """Ahead of the EMV in its lane, with a first gap of 12 m."""
    return replace(group(Placement.EMV_LANE, GroupAnchor.EMV, vehicles), first_gap_m=12.0)


def fronts_m(vehicles: Sequence[PlannedVehicle]) -> list[float]:
    """Along the way to the stop line."""
    return [STARTS_M[vehicle.spot.lane] + vehicle.spot.front_m for vehicle in vehicles]


def test_buses_start_only_in_lanes_from_which_they_can_drive_on() -> None:
    """The right lane leads south alone, round a corner; the left one goes straight on."""
    kept = (*NETWORK.connections[:STRAIGHT], *NETWORK.connections[STRAIGHT + 1 :])
    network = replace(NETWORK, connections=kept)
    factory = VehicleFactory(network, same_drivers(), DIMENSIONS)
    shares = ((ActorClass.SEDAN, 1.0), (ActorClass.BUS, 9.0))
    assert factory.suited_lanes(ActorClass.BUS, (B_RIGHT, B_LEFT)) == (B_LEFT,)
    assert factory.suited_lanes(ActorClass.SEDAN, (B_RIGHT, B_LEFT)) == (B_RIGHT, B_LEFT)
    rng = np.random.default_rng(2)
    drawn = {lane: {factory.draw_class(shares, rng, (lane,)) for _ in range(40)} for lane in (B_RIGHT, B_LEFT)}
    assert drawn == {B_RIGHT: {ActorClass.SEDAN}, B_LEFT: {ActorClass.SEDAN, ActorClass.BUS}}
    assert factory.draw_class(shares[1:], rng, (B_RIGHT,)) is ActorClass.BUS, "there is no other"
    queue = group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=9, standing=True)
    lanes = list(network.lanes)
    for kind, kinds in ((LaneKind.DRIVING, 2), (LaneKind.SHOULDER, 1)):
        lanes[A_RIGHT] = replace(lanes[A_RIGHT], kind=kind)
        plan = planned(queue, network=replace(network, lanes=tuple(lanes)), demand={"classes": shares})
        assert len({vehicle.actor_class for vehicle in plan.vehicles}) == kinds, "of a shoulder they cannot drive on"


def test_a_stream_next_to_the_emv_has_no_buses_that_cannot_follow_its_route() -> None:
    """They would have to turn off right behind the site. South the way is tight, straight on it is not."""
    shares = ((ActorClass.SEDAN, 1.0), (ActorClass.BUS, 9.0))
    factory = VehicleFactory(NETWORK, same_drivers(), DIMENSIONS)
    assert [factory.can_follow(kind, (A, B, D)) for kind, _ in shares] == [True, False]
    assert [factory.can_follow(kind, (A, B, C)) for kind, _ in shares] == [True, True]
    for last, placement, buses in (
        (C, Placement.SAME_DIRECTION, True),
        (D, Placement.SAME_DIRECTION, False),
        (D, Placement.EMV_LANE, False),
        (D, Placement.ADJACENT_LANE, True),
    ):
        queue = group(placement, GroupAnchor.STOP_LINE, vehicles=4, standing=True)
        plan = planned(queue, demand={"classes": shares}, route=(A, B, last))
        assert plan.vehicles
        assert any(vehicle.actor_class is ActorClass.BUS for vehicle in plan.vehicles) is buses


def test_no_bus_comes_across_round_a_bend_that_is_too_tight_for_it() -> None:
    """South the way is tight. Where it is so for cars, too, these come: at a hairpin of 1 m."""
    shares = ((ActorClass.SEDAN, 1.0), (ActorClass.BUS, 9.0))
    movement = NETWORK.connections[TURN]
    lanes = list(NETWORK.lanes)
    corner = lanes[movement.from_lane].centre.points[-1]
    back = Polyline.through(corner + np.array([[0.0, 0.0], [1.0, -1.0], [0.0, -2.0]]))
    lanes[movement.via[0]] = replace(lanes[movement.via[0]], centre=back)
    hairpin = replace(NETWORK, lanes=tuple(lanes))
    assert not VehicleFactory(hairpin, same_drivers(), DIMENSIONS).can_follow(ActorClass.SEDAN, (B, D))
    for network, way, buses in ((NETWORK, CROSSING, True), (NETWORK, TURN, False), (hairpin, TURN, False)):
        plan = planned(crossing(6), network=network, demand={"classes": shares}, crossing=(way,))
        assert plan.vehicles
        assert any(vehicle.actor_class is ActorClass.BUS for vehicle in plan.vehicles) is buses
    only = planned(crossing(6), network=hairpin, demand={"classes": shares[1:]}, crossing=(TURN,))
    assert {vehicle.actor_class for vehicle in only.vehicles} == {ActorClass.BUS}, "there is no other"


def test_a_jam_fills_every_lane_and_long_vehicles_stand_in_the_right_one() -> None:
    """Four and two in each lane of a road, on top of the background; nine of ten would be buses."""
    jam = group(Placement.EVERY_LANE, GroupAnchor.EMV, vehicles=4, standing=True)
    classes = ((ActorClass.SEDAN, 1.0), (ActorClass.BUS, 9.0))
    more = replace(jam, name="more", vehicles=2)
    plan = planned(jam, more, start=start_at(30.0), demand={"classes": classes}, junction=None)
    right, left = ([one for one in plan.vehicles if one.spot.lane == lane] for lane in (A_RIGHT, A_LEFT))
    assert (len(right), len(left), plan.on_top) == (6, 6, 12)
    assert {one.actor_class for one in left} == {ActorClass.SEDAN}
    assert ActorClass.BUS in {one.actor_class for one in right}
    assert set(plan.heads) == {max(lane, key=lambda one: one.spot.front_m).name for lane in (right, left)}
    short = EmvStart(A_LEFT, 170.0, (A,), (A_LEFT,))
    with pytest.raises(MapError, match="2 would fit"):  # in each lane
        planned(jam, start=short, junction=None)


def test_who_starts_before_a_bend_can_brake_for_it() -> None:
    """A quarter circle of 12 m, driven at 6 m/s, begins 4.5 m ahead of the foremost, and is full 2 m later."""
    lanes, angle = list(NETWORK.lanes), np.linspace(0.0, np.pi / 2.0, 40)
    (x_m, y_m), straight = lanes[A_LEFT].centre.at(130.0), lanes[A_LEFT].centre.at(np.array([0.0, 130.0]))
    bend = np.stack((x_m + 12.0 * np.sin(angle), y_m - 12.0 + 12.0 * np.cos(angle)), axis=-1)
    centre = Polyline.through(np.concatenate((straight, bend[1:], bend[-1:] - [[0.0, 60.0]])))
    lanes[A_LEFT] = replace(lanes[A_LEFT], centre=centre)
    plan = planned(platoon(), network=replace(NETWORK, lanes=tuple(lanes)))
    expected_mps = [8.0, 8.0, np.sqrt(36.0 + 2.0 * 1.5 * (4.5 + 2.0))]
    assert [vehicle.spot.speed_mps for vehicle in plan.vehicles] == pytest.approx(expected_mps, rel=0.03)


def test_nobody_stands_in_a_junction_or_with_its_rear_in_it() -> None:
    """The row passes the junction K from 200 to 210 m: whoever would be there is put before or behind it."""
    long = planned(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=12))
    places = np.array(fronts_m(long.vehicles))
    assert len(places) == 12
    assert not ((places > 200.0) & (places < 210.0 + CAR_M)).any()
    before = places[places <= 200.0][0]
    assert 199.0 < before <= 200.0, "looked for every metre"
    gaps = -np.diff(places) - CAR_M
    assert gaps.min() == pytest.approx(5.0)
    forwards = planned(platoon(), start=start_at(170.0))
    assert fronts_m(forwards.vehicles) == pytest.approx([186.6, 196.2, 214.8]), "looked for every metre from 205.8 m on"
    road = Road()
    for from_m, to_m in ((0.0, 100.0), (100.0, 106.0), (106.0, 200.0)):
        road.edge(from_m, to_m, (0,))
    road.connect(0, 1)
    road.connect(1, 2)
    queue = replace(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, 2), spacing_m=84.9)
    start = EmvStart(0, 20.0, (0, 1, 2), (0, 1, 2))
    plan = planned(queue, network=road.built(), start=start, **vars(road.site((0, 1, 2), 2, ())))
    places = [(2, pytest.approx(87.0)), (1, pytest.approx(3.5))]
    assert [(one.spot.lane, one.spot.front_m) for one in plan.vehicles] == places, (
        "half of a very short piece is enough"
    )


EMVS, BESIDE, ACROSS, WITH = (
    "in the EMV's lane",
    "in the lane next to it",
    "on crossing roads",
    "in the EMV's direction",
)
LINE, QUEUE = GroupAnchor.STOP_LINE, group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, 12, standing=True)
AHEAD, CROWD = group(Placement.EMV_LANE, GroupAnchor.EMV), group(Placement.ADJACENT_LANE, LINE, 200)
STREAM = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL, 2), spacing_m=200.0)


@pytest.mark.parametrize(
    ("asked", "start_m", "fit", "refused"),
    [
        (replace(QUEUE, vehicles=33, standing=False), 90.0, 20, ""),
        (replace(QUEUE, vehicles=34, standing=False), 90.0, 20, f"34 vehicles {EMVS}"),
        (AHEAD, 90.0, 0, f"3 vehicles {EMVS}"),
        *[(QUEUE, 255.0, 4, ""), (QUEUE, 264.0, 3, ""), (QUEUE, 275.0, 2, f"12 vehicles {EMVS}")],
        (replace(QUEUE, standing=False), 255.0, 4, f"12 vehicles {EMVS}"),
        *[(CROWD, 90.0, 31, f"200 vehicles {BESIDE}"), (replace(CROWD, optional=True), 90.0, 31, "")],
        (crossing(200, spacing_m=5.0), 90.0, 30, ""),
        (replace(crossing(200), first_gap_m=1000.0), 90.0, 0, f"200 vehicles {ACROSS}"),
        *[(crossing(2, spacing_m=400.0), 90.0, 1, ""), (STREAM, 90.0, 1, "")],
    ],
)
def test_a_row_that_is_too_short_for_most_vehicles_is_refused(
    asked: DemandGroup, start_m: float, fit: int, refused: str
) -> None:
    """0.6 of them, or three that stand, or one that crosses or comes with the EMV; any number of an optional group.

    The cars have fronts each 9.6 m from 303 m down to the junction at 210 m, and from 200 m down: in the EMV's lane to
    14.6 m ahead of it, next to it to 4.6 m. On the side road they begin at 293 m; its joint is from 190 m to 200 m.
    """
    if refused:
        with pytest.raises(MapError, match=f"{refused}; {fit} would fit"):
            planned(asked, start=start_at(start_m))
    else:
        assert len(planned(asked, start=start_at(start_m)).vehicles) == fit


def test_of_crossing_rows_the_longer_one_gets_what_does_not_fit_in_the_other() -> None:
    """One has a place each 72.6 m from 293 m down, the other from 303 m down: 4 and 5. Without a row nobody crosses."""
    assert len(planned(crossing(12, spacing_m=68.0), crossing=(CROSSING, TURN)).vehicles) == 9
    with pytest.raises(MapError, match=f"12 vehicles {ACROSS}; 0 would fit"):
        planned(crossing(12), crossing=())


def test_nobody_wishes_for_more_than_the_limit_unless_the_stream_would_come_too_late() -> None:
    fast = replace(platoon(), speed_mps=20.0)
    assert {vehicle.spot.speed_mps for vehicle in planned(fast).vehicles} == {LIMIT_MPS}
    assert {vehicle.driver.speed_factor for vehicle in planned(fast).vehicles} == {1.0}
    stream = replace(fast, anchor=GroupAnchor.ARRIVAL, placement=Placement.SAME_DIRECTION, speed_mps=15.4)
    vehicles = planned(stream, start=start_at(130.0)).vehicles
    assert [vehicle.driver.speed_factor for vehicle in vehicles] == pytest.approx([1.1] * 3)
    assert [vehicle.spot.speed_mps for vehicle in vehicles] == pytest.approx([15.4] * 3)
    slow = replace(stream, speed_mps=7.0)
    last, *ahead = planned(slow, start=start_at(130.0)).vehicles
    assert last.driver.speed_factor == pytest.approx(0.5), "it would come too early"
    *_, last, _, _ = planned(replace(crossing(2), name="other"), slow, start=start_at(130.0)).vehicles
    assert last.driver.speed_factor == pytest.approx(0.5), "also behind another group"
    assert {vehicle.driver.speed_factor for vehicle in ahead} == {1.0}
    road = Road()
    road.edge(0.0, 200.0, (0, 1, 2))
    site = road.site((0,), 1, (0, 1, 2))
    for number in range(3):
        road.connect(number, number)
    both = planned(replace(slow, vehicles=2), network=road.built(), start=EmvStart(1, 30.0, (0,), (1,)), **vars(site))
    assert [vehicle.spot.lane for vehicle in both.vehicles] == [0, 2]
    assert max(vehicle.driver.speed_factor for vehicle in both.vehicles) < 1.0, "the last one of each row"


def test_the_last_one_of_a_stream_comes_in_time_although_nobody_starts_in_a_junction() -> None:
    """The line is at 310 m, and a junction from 200 m to 210 m: where it would start there, it drives faster."""
    stream = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL), vehicles=1, speed_mps=8.0)
    ranges, emv = {"demand.group.speed_mps": ValueRange(7.5, 9.0)}, template_with().emv
    leads_s, speeds_mps = [], set()
    for start in map(start_at, np.arange(100.0, 180.0, 4.0)):
        (vehicle,) = planned(stream, start=start, template={"ranges": ranges}).vehicles
        arrival_s = unhindered_arrival_s(NETWORK, start, emv, bound_s_of(signal_site(), template_with()))
        leads_s.append(arrival_s - (310.0 - fronts_m([vehicle])[0]) / vehicle.spot.speed_mps)
        speeds_mps.add(round(vehicle.spot.speed_mps, 1))
    assert np.ptp(leads_s) < 0.3, "it starts at whole metres"
    assert len(speeds_mps) > 1
    for placement, low_mps, high_mps in (
        (Placement.SAME_DIRECTION, 7.9, 8.05),
        (Placement.EMV_LANE, 7.5, 7.5),
    ):
        ranges = {"demand.group.speed_mps": ValueRange(low_mps, 8.05)}
        narrow = replace(stream, placement=placement)
        for start in map(start_at, np.arange(100.0, 180.0, 10.0)):
            (vehicle,) = planned(narrow, start=start, template={"ranges": ranges}).vehicles
            assert low_mps <= vehicle.spot.speed_mps <= high_mps


def test_a_stream_drives_on_where_its_lane_leads() -> None:
    """The right lane leads south alone; behind the site the route is what is left of the EMV's."""
    stream = replace(group(Placement.SAME_DIRECTION, GroupAnchor.EMV), vehicles=2)
    for network, last in ((NETWORK, "c"), (with_connection(STRAIGHT, to_lane=SOUTH, direction="r"), "d")):
        assert {vehicle.route for vehicle in planned(stream, network=network).vehicles} == {("a", "b", last)}
    behind = planned(stream, start=EmvStart(B_LEFT, 90.0, (B, C), (B_LEFT,)), junction=None)
    assert {vehicle.route for vehicle in behind.vehicles} == {("c",)}
    road = Road()
    for from_m, to_m in ((0.0, 200.0), (200.0, 300.0), (300.0, 400.0), (400.0, 999.0), (400.0, 999.0)):
        road.edge(from_m, to_m, (0,))
    for source, target in ((0, 1), (1, 2), (2, 3), (2, 4)):
        road.connect(source, target)
    emv = EmvStart(0, 30.0, (0, 1, 2, 4), (0, 1))
    stream = replace(stream, vehicles=4, first_gap_m=12.0)
    plan = planned(stream, network=road.built(), start=emv, **vars(road.site((0, 1, 2, 4), 1, ())))
    assert {vehicle.route for vehicle in plan.vehicles} == {("e0", "e1", "e2", "e4")}, "as the EMV does"


def test_on_a_very_long_road_the_route_lasts_for_20_s_from_the_vehicle_on() -> None:
    """320 m at 16 m/s; fronts are 901.6 m and 916.6 m along 1230 m of road, from whose end a way leads back."""
    lanes = list(NETWORK.lanes)
    for lane, y_m in ((A_RIGHT, -5.25), (A_LEFT, -1.75)):
        lanes[lane] = replace(lanes[lane], centre=Polyline.through([(-1110.0, y_m), (-110.0, y_m)]))
    for lane in (C_LEFT, C_RIGHT):
        lanes[lane] = replace(lanes[lane], centre=lanes[lane].centre.cut(0.0, 100.0))
    back = replace(NETWORK.connections[0], from_lane=C_LEFT, to_lane=A_LEFT)
    network = replace(NETWORK, lanes=tuple(lanes), connections=(*NETWORK.connections, back))
    for start_m, route in ((885.0, ("a", "b", "c")), (900.0, ("a", "b", "c", "a"))):
        (vehicle,) = planned(platoon(1), network=network, start=start_at(start_m)).vehicles
        assert vehicle.route == route


def test_gaps_and_speeds_vary_as_much_as_the_config_says() -> None:
    traffic = replace(CONFIG, spacing_spread=0.2, speed_spread=0.1)
    queue = replace(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=9), spacing_m=5.0)
    vehicles = planned(queue, traffic=traffic).vehicles
    here = [front for front in fronts_m(vehicles) if front > 215.0]
    gaps = -np.diff(here) - CAR_M
    assert 4.0 <= gaps.min() < 4.7
    assert 5.3 < gaps.max() <= 6.0
    speeds = np.array([vehicle.spot.speed_mps for vehicle in vehicles])
    assert 7.2 <= speeds.min() < 7.8
    assert 8.2 < speeds.max() <= 8.8
    assert fronts_m(planned(queue, traffic=traffic, seed=1).vehicles)[1:] != fronts_m(vehicles)[1:]


@pytest.mark.parametrize("standing", [True, False])
def test_nobody_stands_nearer_than_the_own_standing_distance(standing: bool) -> None:
    """Standing distances of these four are 1.6 m, 2.5 m, 3.1 m and 1.3 m."""
    queue = replace(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, 4, standing=standing), spacing_m=2.0)
    vehicles = planned(queue, traffic=replace(CONFIG, spacing_spread=0.0)).vehicles
    asked_m = [max(2.0, vehicle.driver.driving.min_gap_m if standing else 0.0) for vehicle in vehicles]
    assert (max(asked_m) > 3.0) == standing
    assert -np.diff(fronts_m(vehicles)) - CAR_M == pytest.approx(asked_m[1:])


@pytest.mark.parametrize("spacings_m", [(4.0, 11.0), (11.0, 4.0)])
def test_where_rows_share_a_lane_the_longer_spacing_of_two_vehicles_counts(spacings_m: tuple[float, float]) -> None:
    road = Road()
    road.edge(0.0, 100.0, (0,))
    road.edge(100.0, 120.0, (0,), LaneKind.INTERNAL)
    road.edge(120.0, 123.0, (0, 1))
    road.connect(0, 2, (1,))
    road.connect(0, 3, (1,))
    start = EmvStart(0, 0.0, (0, 2), (0, 2))
    placements = (Placement.EMV_LANE, Placement.ADJACENT_LANE)
    own, beside = (
        replace(group(placement, GroupAnchor.STOP_LINE, 1), name=placement.value, spacing_m=spacing_m)
        for placement, spacing_m in zip(placements, spacings_m, strict=True)
    )
    plan = planned(own, beside, network=road.built(), start=start, **vars(road.site((0, 2), 2, ())))
    first, second = plan.vehicles
    assert first.spot.lane == second.spot.lane == 0
    gap_m = first.spot.front_m - CAR_M - second.spot.front_m
    assert max(spacings_m) - 1e-6 <= gap_m < max(spacings_m) + 1.0
