"""Starts of EMVs: the first, those behind it, and those across its way."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hand_made_record import STRAIGHT as NORTHBOUND_WAY
from hand_made_record import crossing as signal_crossing
from made_streets import (
    A_LEFT,
    A_RIGHT,
    B_LEFT,
    B_RIGHT,
    C_LEFT,
    C_RIGHT,
    CROSSING,
    FAR,
    NEAR,
    SOUTH,
    STRAIGHT_LEFT,
    A,
    B,
    C,
    D,
    M,
    N,
    Road,
    emv_demand,
    group,
    same_drivers,
    signal_site,
    start_at,
    streets,
    template_with,
)
from traffic_helpers import DIMENSIONS

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError, MapError
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.sites import Site, SiteKind
from siren_ros.simulation.scenario.driver_parameters import EmvDriver
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.scenario.scenario import (
    EmvDemand,
    GroupAnchor,
    Placement,
    SignalDemand,
    StartReference,
)
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand import emv_start as emv_start_module
from siren_ros.simulation.traffic.demand.emv_start import (
    EMV_ACCEL_MPS2,
    EmvStart,
    approach_to,
    arrival_s,
    behind_queue_mps,
    bound_s_of,
    crossing_start,
    crossing_ways,
    depart_speed_mps,
    early_m_of,
    emv_start,
    lane_before,
    long_enough_route,
    start_m_of,
    stays_inside,
    travel_lane,
    unhindered_arrival_s,
    way_to_stop_line_m,
)
from siren_ros.simulation.traffic.demand.plan import Spot
from siren_ros.simulation.traffic.demand.road_users import VehicleFactory
from siren_ros.simulation.world.actors import ActorClass


def demand(start_m: float, speed_mps: float = 10.0, depart_mps: float = 10.0) -> EmvDemand:
    emv = load_template("S4").emv
    return EmvDemand(emv.actor_class, 1, start_m, speed_mps, depart_mps, 3.0, emv.start_from)


def test_speeding_up_follows_the_constant_acceleration() -> None:
    changing_m = (12.0**2 - 6.0**2) / (2.0 * EMV_ACCEL_MPS2)
    expected_s = (12.0 - 6.0) / EMV_ACCEL_MPS2 + (200.0 - changing_m) / 12.0
    assert unhindered_arrival_s(NETWORK, start_at(110.0), demand(0.0, 12.0, 6.0)) == pytest.approx(expected_s, abs=0.15)


def set_up(template: str, values: str, seed: int = 0) -> EpisodeSetup:
    return set_up_episode(EpisodeRequest(template, seed=seed, sensors="none", values=values))


def test_a_jam_on_a_motorway_takes_more_emvs_and_none_that_crosses() -> None:
    setup = set_up("S8", "emv.count=2,emv.headway_s=20")
    assert [emv.name for emv in setup.plan.emvs] == ["emv0", "emv1"]
    with pytest.raises(InputError, match=r"emv\.crossing"):
        set_up("S8", "emv.crossing=1")


@pytest.mark.parametrize("name", TEMPLATES)
def test_every_template_takes_more_emvs_and_one_that_crosses(name: str) -> None:
    setup = set_up(name, "emv.count=3,emv.crossing=1,emv.headway_s=4")
    assert [emv.name for emv in setup.plan.emvs] == ["emv0", "emv1", "emv2", "crossing_emv0"]
    assert setup.description.emv_ids == (1, 2, 3, 4)
    first, second, third, across = (emv.route for emv in setup.plan.emvs)
    assert second[-len(first) :] == third[-len(first) :] == first
    assert across[-len(first) :] != first
    assert setup.description.crossed_junctions == {4: setup.plan.crossed}


def side_streets() -> RoadNetwork:
    """More ways from the north over J: to the EMV's road (9), to a road from which a way leads back (8), and others."""
    network = streets()
    lanes, edges = list(network.lanes), list(network.edges)
    for name, x_m, ends_m, allowed in (("e", 15.0, (-20.0, -120.0), True), ("f", 12.0, (120.0, 12.0), False)):
        centre = Polyline.through([(x_m, y_m) for y_m in ends_m])
        changed = {"index": len(lanes), "edge": len(edges), "lane_id": f"{name}_0", "civilian_allowed": allowed}
        edges.append(replace(edges[D], index=len(edges), edge_id=name, lanes=(len(lanes),)))
        lanes.append(replace(lanes[SOUTH], centre=centre, **changed))
    east, gone = len(lanes) - 2, len(lanes) - 1
    crossed = network.connections[CROSSING]
    ways = (
        replace(crossed, from_lane=FAR, to_lane=C_LEFT, via=(), direction="t"),
        replace(crossed, to_lane=east, via=(), direction="r"),
        replace(crossed, to_lane=C_LEFT, via=(), direction="l"),
        replace(crossed, from_lane=gone, to_lane=C_LEFT, via=()),
        replace(crossed, from_lane=east, to_lane=NEAR, via=(), junction="E"),
    )
    return replace(network, lanes=tuple(lanes), edges=tuple(edges), connections=(*network.connections, *ways))


def test_ways_across_come_first_and_of_these_the_one_straight_on() -> None:
    """Nobody turns back, or comes from a road that is closed to civilians. On a road the next side street counts."""
    network, site, start = side_streets(), signal_site(), start_at(110.0)
    expected = [(N, (CROSSING,)), (N, (8,)), (N, (9,))]
    road = replace(site, junction=None, site_edge=A, site_position=0, stretch=(A, B))
    for one in (site, road, replace(road, stretch=(A,), connections=(0, 1))):
        ways, edge = crossing_ways(network, one, start)
        assert [(way.site_edge, way.connections) for way in ways] == expected
        assert (edge, {way.junction for way in ways}) == (B, {"J"})
    own = tuple(way for way in network.connections if network.lanes[way.from_lane].edge in site.route)
    lonely, before = replace(network, connections=own), replace(road, stretch=(A,), connections=(0, 1), junction="K")
    for roads, one in ((lonely, site), (network, before)):
        with pytest.raises(InputError, match=r"emv\.crossing is above 0"):
            crossing_ways(roads, one, start)


@pytest.mark.parametrize(
    ("end_m", "needed_m", "junction", "last"),
    [
        (530.0, 490.0, None, C),
        (530.0, 520.0, None, D),
        (530.0, 5000.0, None, C),
        (6000.0, 5000.0, None, D),
        (6000.0, 5000.0, "J", C),
    ],
)
def test_a_way_on_that_is_long_enough_or_much_longer_replaces_the_route_behind_the_site(
    end_m: float, needed_m: float, junction: str | None, last: int
) -> None:
    """A route of 500 m; behind the site at 300 m there is another road, up to a place that is farther away."""
    road = Road()
    for from_m, to_m in ((0.0, 200.0), (200.0, 300.0), (300.0, 500.0), (300.0, end_m)):
        road.edge(from_m, to_m, (0,))
    for source, target in ((A, B), (B, C), (B, D)):
        road.connect(source, target)
    factory = VehicleFactory(road.built(), same_drivers(), DIMENSIONS)
    site = replace(road.site((A, B, C), 1, ()), junction=junction)
    for seed in range(4):
        assert long_enough_route(factory, (A, B, C), site, needed_m, np.random.default_rng(seed)) == (A, B, last)


def test_where_the_side_street_is_too_short_or_full_no_emv_starts() -> None:
    """It is 300 m long, of which an EMV at 10 m/s drives 150 m within 15 s."""
    ways, _ = crossing_ways(NETWORK, signal_site(), start_at(110.0))
    way, start = crossing_start(NETWORK, ways, emv_demand(0.0), 15.0, ())
    assert (way.junction, way_to_stop_line_m(NETWORK, start)) == ("J", pytest.approx(150.0, abs=6.0))
    there: Any = SimpleNamespace(spot=Spot(start.lane, start.front_m, 0.0))
    _, clear = crossing_start(NETWORK, ways, emv_demand(0.0), 15.0, (there,))
    assert (clear.lane, abs(clear.front_m - start.front_m)) == (start.lane, pytest.approx(21.0, abs=1.0))
    with pytest.raises(MapError, match="enough road"):
        crossing_start(NETWORK, ways, emv_demand(0.0), 60.0, ())
    elsewhere: Any = SimpleNamespace(spot=Spot(A_LEFT, start.front_m, 0.0))
    assert crossing_start(NETWORK, ways, emv_demand(0.0), 15.0, (elsewhere,)) == (way, start)
    assert crossing_start(NETWORK, [*ways, replace(way, name="later")], emv_demand(0.0), 15.0, ()) == (way, start)
    _, first = crossing_start(NETWORK, ways, emv_demand(0.0), 29.8, ())
    assert (first.lane, first.front_m) == (FAR, 8.0), "its body is on the road"
    soon, near = crossing_start(NETWORK, ways, emv_demand(0.0), -1.0, ())
    assert (soon.junction, way_to_stop_line_m(NETWORK, near)) == ("J", pytest.approx(10.0)), "the nearest start"


NETWORK = streets()


@pytest.mark.parametrize(
    ("start_m", "lane", "front_m", "way_m"),
    [
        (30.0, B_LEFT, 30.0, 70.0),
        (0.0, B_LEFT, 0.0, 100.0),
        (-40.0, A_LEFT, 170.0, 140.0),
        (-150.0, A_LEFT, 60.0, 250.0),
        # Inside the junction K or right before it: 20 m before it.
        (-5.0, A_LEFT, 180.0, 130.0),
        (-25.0, A_LEFT, 180.0, 130.0),
        (-31.0, A_LEFT, 179.0, 131.0),
    ],
)
def test_starts_before_and_on_the_sites_edge(start_m: float, lane: int, front_m: float, way_m: float) -> None:
    start = emv_start(NETWORK, signal_site(), start_m)
    assert (start.lane, start.front_m) == (lane, pytest.approx(front_m))
    assert start.route == ((A, B, C) if lane == A_LEFT else (B, C))
    assert [index for index in start.lanes_to_site if index < 9] == ([A_LEFT, B_LEFT] if lane == A_LEFT else [B_LEFT])
    assert way_to_stop_line_m(NETWORK, start) == pytest.approx(way_m)


def test_the_run_up_before_a_junction_leaves_space_for_the_emvs_body() -> None:
    for length_m, front_m in ((100.0, 80.0), (24.0, 8.0), (5.0, 5.0)):
        start = emv_start(with_cut(NETWORK, length_m, A_LEFT), signal_site(), -5.0)
        assert (start.lane, start.front_m) == (A_LEFT, pytest.approx(front_m))


def test_starts_beyond_the_sites_edge_are_on_the_way_on() -> None:
    """The edge is 100 m long, the junction 20 m."""
    start = emv_start(NETWORK, signal_site(), 150.0)
    assert (start.lane, start.front_m, start.route) == (C_LEFT, pytest.approx(30.0), (C,))
    assert start.lanes_to_site == (C_LEFT,)
    with pytest.raises(MapError, match="more of road"):
        emv_start(NETWORK, signal_site(), 330.0)
    with pytest.raises(MapError, match="more of road"):
        emv_start(NETWORK, signal_site(), -211.0)


def test_the_lane_before_is_of_the_same_kind_and_on_the_edge_that_is_asked_for() -> None:
    """A lane of the side street, and a shoulder on the left, lead into the left lane, too."""
    joining = [replace(NETWORK.connections[1], from_lane=lane) for lane in (FAR, A_RIGHT, A_LEFT)]
    lanes = list(NETWORK.lanes)
    lanes[A_LEFT] = replace(lanes[A_LEFT], kind=LaneKind.SHOULDER)
    for connections in (joining, joining[::-1]):
        network = replace(NETWORK, connections=tuple(connections))
        assert lane_before(network, NETWORK.lanes[B_LEFT], A)[0].index == A_LEFT
        beside = replace(network, lanes=tuple(lanes))
        assert lane_before(beside, NETWORK.lanes[B_LEFT], A)[0].index == A_RIGHT
        assert lane_before(beside, NETWORK.lanes[B_LEFT], M)[0].index == FAR
    assert lane_before(NETWORK, NETWORK.lanes[C_RIGHT], A) == (NETWORK.lanes[A_LEFT], ()), "no lane leads there"


def test_others_have_the_right_of_way_at_stops_and_behind_a_signal_that_turns_red() -> None:
    template, site = replace(template_with(), signal=SignalDemand(4.0)), signal_site()
    kinds = (SiteKind.STOP_JUNCTION, SiteKind.SIGNAL_JUNCTION, SiteKind.QUEUED_APPROACH)
    for one, expected in ((template, [math.inf, 4.0, 0.0]), (replace(template, signal=None), [math.inf, 0.0, 0.0])):
        assert [bound_s_of(replace(site, kind=kind), one) for kind in kinds] == expected


def test_a_bend_behind_the_line_slows_an_emv_before_it_where_the_line_counts() -> None:
    """A quarter circle of 8 m begins at the line."""
    angle, lanes = np.linspace(0.0, np.pi / 2.0, 40), list(NETWORK.lanes)
    (path,) = NETWORK.connections[STRAIGHT_LEFT].via
    lanes[path] = replace(lanes[path], centre=Polyline.through(np.stack((8 * np.sin(angle), 8 * np.cos(angle)), -1)))
    lanes[C_LEFT] = replace(lanes[C_LEFT], centre=Polyline.through([(8.0, 0.0), (8.0, -200.0)]))
    bent = replace(NETWORK, lanes=tuple(lanes))
    emv, start = emv_demand(0.0, 14.0), start_at(110.0)
    free_s, flat_s, bent_s = (
        unhindered_arrival_s(network, start, emv, bound_s)
        for network, bound_s in ((bent, None), (NETWORK, 0.0), (bent, 0.0))
    )
    assert free_s == pytest.approx(200.0 / 14.0)
    assert flat_s == pytest.approx(free_s, abs=0.1)
    assert bent_s > flat_s + 0.5
    assert unhindered_arrival_s(NETWORK, start, emv, math.inf) > flat_s + 0.5, "as at a stop sign"


def test_an_emv_that_starts_behind_the_sites_edge_arrives_once_although_its_way_comes_back() -> None:
    """70 m are left of the second edge, and the third one has 200 m."""
    road = {"site_edge": A, "site_position": 0, "stretch": (A, B, C), "approach_lane": A_LEFT, "junction": None}
    site, start = replace(signal_site(), **road), EmvStart(B_LEFT, 30.0, (B, C), (B_LEFT,))
    for one in (start, replace(start, route=(B, C, A))):
        assert arrival_s(NETWORK, site, one, C, emv_demand(0.0)) == pytest.approx(7.0 + 20.0)


def with_cut(network: RoadNetwork, length_m: float, *lanes: int) -> RoadNetwork:
    """The network with lanes that end after a length."""
    cut = {lane: replace(network.lanes[lane], centre=network.lanes[lane].centre.cut(0.0, length_m)) for lane in lanes}
    return replace(network, lanes=tuple(cut.get(lane.index, lane) for lane in network.lanes))


def busy() -> RoadNetwork:
    """The junction before the approach has traffic of its own."""
    crossed = replace(NETWORK.connections[0], from_lane=6, to_lane=B_LEFT)
    return replace(NETWORK, connections=(*NETWORK.connections, crossed))


def road_site() -> Site:
    """A site whose start is no matter of quiet ways."""
    return replace(signal_site(), kind=SiteKind.QUEUED_APPROACH)


def test_the_start_is_counted_from_the_sites_edge_or_from_the_stop_line() -> None:
    from_start = replace(emv_demand(-30.0), start_from=StartReference.SITE_START)
    assert start_m_of(NETWORK, road_site(), from_start) == -30.0
    assert start_m_of(NETWORK, road_site(), emv_demand(-30.0)) == pytest.approx(70.0)
    assert start_m_of(NETWORK, road_site(), emv_demand(-150.0)) == pytest.approx(-50.0)
    far = replace(road_site(), site_edge=C, site_position=2, stretch=(C,), approach_lane=C_LEFT)
    assert [start_m_of(NETWORK, far, emv_demand(m)) for m in (-400.0, -1000.0)] == pytest.approx([-200.0, 8.0 - 330.0])
    # Behind a junction with traffic, with the body on the road, where 60 m of it are enough before a signal alone.
    assert start_m_of(busy(), signal_site(), emv_demand(-200.0)) == pytest.approx(8.0)
    assert start_m_of(busy(), signal_site(), emv_demand(-80.0)) == pytest.approx(20.0)
    assert start_m_of(with_cut(busy(), 60.0, B_LEFT), signal_site(), emv_demand(-80.0)) == pytest.approx(8.0), "48 m"
    assert start_m_of(busy(), road_site(), emv_demand(-200.0)) == pytest.approx(-100.0)
    # The approach of 210 m is used from its beginning, of which the EMV's body takes 8 m.
    assert [start_m_of(NETWORK, road_site(), emv_demand(m)) for m in (-500.0, -2000.0)] == pytest.approx([-202.0] * 2)


def test_in_a_bend_the_lateral_acceleration_is_the_limit() -> None:
    """A quarter circle of 40 m."""
    angle = np.linspace(0.0, 0.5 * np.pi, 200)
    lanes = list(NETWORK.lanes)
    bend = Polyline.through(40.0 * np.stack((np.sin(angle), 1.0 - np.cos(angle)), axis=-1))
    lanes[A_LEFT] = replace(lanes[A_LEFT], centre=bend)
    network, start = replace(NETWORK, lanes=tuple(lanes)), EmvStart(A_LEFT, 10.0, (A,), (A_LEFT,))
    mps = (40.0 * EmvDriver().driving.lateral_accel_mps2) ** 0.5
    fast = emv_demand(0.0, 30.0)
    assert depart_speed_mps(network, start, fast) == pytest.approx(mps, rel=0.03)
    assert unhindered_arrival_s(network, start, fast) == pytest.approx((20.0 * np.pi - 10.0) / mps, rel=0.04)


def test_next_to_a_shoulder_is_its_neighbour_on_either_side() -> None:
    lanes, edges = list(NETWORK.lanes), list(NETWORK.edges)
    shoulder = replace(lanes[B_LEFT], index=len(lanes), lane_id="b_2", position=2, kind=LaneKind.SHOULDER)
    edges[B] = replace(edges[B], lanes=(*edges[B].lanes, shoulder.index))
    network = replace(NETWORK, lanes=(*lanes, shoulder), edges=tuple(edges))
    assert travel_lane(network, replace(signal_site(), approach_lane=shoulder.index)).index == B_LEFT
    assert travel_lane(network, signal_site()).index == B_LEFT
    short = with_cut(busy(), 50.0, B_RIGHT)
    lanes = list(short.lanes)
    lanes[B_RIGHT] = replace(lanes[B_RIGHT], kind=LaneKind.SHOULDER)
    for site in (signal_site(), road_site()):
        starts_m = [
            start_m_of(replace(short, lanes=tuple(lanes)), replace(site, approach_lane=lane), emv_demand(-120.0))
            for lane in (B_LEFT, B_RIGHT)
        ]
        assert starts_m == [8.0, 8.0]


def test_the_arrival_takes_the_rest_of_the_way_at_the_end() -> None:
    """A way of whole metres and a part of one; each at 10 m/s."""
    for front_m in (110.0, 110.4, 299.7, 309.5):
        arrival_s = unhindered_arrival_s(NETWORK, start_at(front_m), emv_demand(0.0, 10.0))
        assert arrival_s == pytest.approx((310.0 - front_m) / 10.0, abs=1e-6)


def test_a_site_with_a_quiet_way_is_best_then_one_behind_a_junction_then_one_behind_a_sharp_bend(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From 60 m of quiet way on a conflict point is good; the road of 310 m before J has K in it, without traffic."""
    site = signal_site()
    assert approach_to(NETWORK, site, emv_demand(-200.0)).rank == 0
    assert approach_to(busy(), site, emv_demand(-200.0)).rank == 0
    assert approach_to(NETWORK, replace(site, kind=SiteKind.QUEUED_APPROACH), emv_demand(-5000.0)).rank == 0
    late = replace(emv_demand(-200.0, 20.0), depart_speed_mps=2.0)
    for accel_mps2, rank in ((0.05, 2), (8.0, 0)):
        monkeypatch.setattr(emv_start_module, "EMV_ACCEL_MPS2", accel_mps2)
        assert approach_to(NETWORK, site, late).rank == rank


def test_an_approach_that_is_too_short_says_by_how_much() -> None:
    """All reasons of this kind are one text; the length is beside it."""
    far = [replace(emv_demand(-metres), start_from=StartReference.SITE_START) for metres in (5000.0, 5100.0)]
    first, second = (approach_to(NETWORK, signal_site(), emv) for emv in far)
    assert first.rank == second.rank == 3
    assert first.flaw is not None
    assert second.flaw == first.flaw._replace(missing_m=first.flaw.missing_m + 100.0)
    assert str(second.flaw).endswith(f"start ({second.flaw.missing_m:.0f} m)")
    with pytest.raises(MapError, match=f"with {second.flaw.missing_m:.0f} m more of road"):
        emv_start(NETWORK, signal_site(), far[1].start_m)


@pytest.mark.parametrize(("start_m", "first_m", "rank"), [(-207.0, 200.0, 2), (-202.0, 200.0, 0), (-5.0, 5.0, 0)])
def test_an_emv_has_its_length_of_road_behind_its_front(start_m: float, first_m: float, rank: int) -> None:
    """8 m, or the whole of a shorter road."""
    emv = replace(emv_demand(start_m), start_from=StartReference.SITE_START)
    lanes = list(NETWORK.lanes)
    lanes[A_LEFT] = replace(lanes[A_LEFT], centre=lanes[A_LEFT].centre.cut(200.0 - first_m, 200.0))
    assert approach_to(replace(NETWORK, lanes=tuple(lanes)), signal_site(), emv).rank == rank


@pytest.mark.parametrize(("length_m", "rank"), [(14.9, 2), (15.1, 1)])
def test_an_approach_without_space_for_two_cars_is_as_bad_as_a_sharp_bend(length_m: float, rank: int) -> None:
    """The road up to the line is cut off."""
    short = with_cut(busy(), length_m, B_LEFT)
    assert approach_to(short, signal_site(), emv_demand(-200.0)).rank == rank
    assert approach_to(short, replace(signal_site(), kind=SiteKind.QUEUED_APPROACH), emv_demand(-200.0)).rank == 0


@pytest.mark.parametrize(("length_m", "rank"), [(89.0, 1), (91.0, 0)])
def test_a_shoulder_turn_with_space_for_a_queue_and_the_way_onto_the_shoulder_comes_first(
    length_m: float, rank: int
) -> None:
    """50 m for the queue and 40 m behind the junction before it."""
    lanes = list(with_cut(NETWORK, length_m, B_LEFT).lanes)
    lanes[B_RIGHT] = replace(lanes[B_RIGHT], kind=LaneKind.SHOULDER)
    short = replace(busy(), lanes=tuple(lanes))
    site = replace(signal_site(), kind=SiteKind.SHOULDER_RIGHT_TURN, approach_lane=B_RIGHT)
    assert approach_to(short, site, emv_demand(-200.0)).rank == rank


@pytest.mark.parametrize(("length_m", "rank"), [(99.0, 2), (101.0, 0)])
def test_a_site_with_hardly_any_road_behind_it_comes_last(length_m: float, rank: int) -> None:
    """The road behind the junction ends after so many metres."""
    assert approach_to(with_cut(NETWORK, length_m, C_RIGHT, C_LEFT), signal_site(), emv_demand(-200.0)).rank == rank


@pytest.mark.parametrize(
    ("start_m", "lane", "front_m", "speed_mps", "expected_mps"),
    [
        (90.0, A_LEFT, 107.6, 0.0, 45.0**0.5),
        (190.0, B_LEFT, 19.6, 0.0, 155.0**0.5),
        (90.0, A_LEFT, 97.6, 0.0, 0.0),
        (90.0, A_LEFT, 94.5, 0.0, math.inf),
        (90.0, A_RIGHT, 107.6, 0.0, math.inf),
        (90.0, A_LEFT, 107.6, 5.0, 50.0**0.5),
        (90.0, A_LEFT, 98.6, 5.0, 5.0),
    ],
    ids=["13 m", "in the next lane of the way", "too near", "next to it", "another lane", "drives", "drives near"],
)
def test_an_emv_starts_no_faster_than_it_can_stop_behind_a_queue(
    start_m: float, lane: int, front_m: float, speed_mps: float, expected_mps: float
) -> None:
    """Braking with 2.5 m/s² to 4 m, and 0.8 s if it drives, behind a car of 4.6 m."""
    factory = VehicleFactory(NETWORK, same_drivers(), DIMENSIONS)
    rng = np.random.default_rng(1)
    driver = factory.draw_driver(ActorClass.SEDAN, rng)
    car = factory.civilian("car", ActorClass.SEDAN, driver, ("a",), Spot(lane, front_m, speed_mps), rng)
    assert car.length_m == pytest.approx(4.6)
    assert behind_queue_mps(NETWORK, start_at(start_m), [car]) == pytest.approx(expected_mps)


@pytest.mark.parametrize(
    ("first_gap_m", "yellow_s", "gap_m"),
    [(20.0, 3.0, 20.0), (30.0, 3.0, 22.0), (15.0, 4.5, 8.0 * 3.1 - 4.5), (5.0, 2.0, 5.0), (15.0, 6.0, 8.0 * 4.6 - 4.5)],
)
def test_the_red_lies_between_a_stream_and_the_emv(first_gap_m: float, yellow_s: float, gap_m: float) -> None:
    """It begins 0.4 s before the EMV comes. The last vehicle drives on 1.8 s after the yellow began.

    The junction is 30 m long: at 22 m the vehicle is inside.
    """
    network = signal_crossing()
    ways = tuple(replace(way, yellow_s=yellow_s) for way in network.connections)
    stream = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL), first_gap_m=first_gap_m, speed_mps=8.0)
    where = replace(signal_site(), connections=(NORTHBOUND_WAY,))
    network = replace(network, connections=(*ways, replace(ways[NORTHBOUND_WAY], via=())))
    for order in ((NORTHBOUND_WAY, len(ways)), (len(ways), NORTHBOUND_WAY)):
        early_m = early_m_of(network, replace(where, connections=order), stream)
        assert stream.first_gap_m - early_m == pytest.approx(gap_m), "the longest way counts"


@pytest.mark.parametrize(
    ("speed_mps", "anchor", "stays"), [(16.0, "arrival", True), (17.0, "arrival", False), (17.0, "emv", True)]
)
def test_a_fast_stream_has_left_a_small_junction_before_the_emv_comes(
    speed_mps: float, anchor: str, stays: bool
) -> None:
    """The last vehicle of 4.5 m is 1.6 s ahead of the EMV, and 8 m before the end of 30 m: at 16.6 m/s or less."""
    stream = replace(group(Placement.SAME_DIRECTION, GroupAnchor(anchor)), speed_mps=speed_mps)
    where = replace(signal_site(), connections=(NORTHBOUND_WAY,))
    ways = tuple(replace(way, yellow_s=3.0) for way in signal_crossing().connections)
    network = replace(signal_crossing(), connections=ways)
    assert stays_inside(network, where, stream) == stays
    assert stays_inside(network, where, replace(stream, optional=True))
