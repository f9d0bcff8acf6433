"""Starts of EMVs: the first, those behind it, and those across its way; places of background traffic."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_streets import (
    A_LEFT,
    A_RIGHT,
    B_LEFT,
    B_RIGHT,
    C_LEFT,
    C_RIGHT,
    CONFIG,
    FAR,
    LIMIT_MPS,
    STRAIGHT_LEFT,
    A,
    B,
    C,
    M,
    emv_demand,
    group,
    same_drivers,
    signal_site,
    start_at,
    streets,
    template_with,
)
from traffic_helpers import DIMENSIONS, load_map

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError, MapError
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph, civilian_movements, comes_from_the_side
from siren_ros.simulation.roads.site_finder import find_sites, require_site
from siren_ros.simulation.roads.sites import Site, SiteKind
from siren_ros.simulation.scenario.driver_parameters import EmvDriver
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.scenario.scenario import (
    DemandGroup,
    EmvDemand,
    GroupAnchor,
    Placement,
    SignalDemand,
    StartReference,
)
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand import demand as demand_module
from siren_ros.simulation.traffic.demand import emv_start as emv_start_module
from siren_ros.simulation.traffic.demand import plan as plan_module
from siren_ros.simulation.traffic.demand.demand import plan_traffic
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
    emv_start,
    following_starts,
    lane_before,
    prolonged,
    start_m_of,
    travel_lane,
    unhindered_arrival_s,
    way_to_stop_line_m,
)
from siren_ros.simulation.traffic.demand.plan import LaneInterval, SignalTiming, Spot, TrafficPlan, chain_along
from siren_ros.simulation.traffic.demand.road_users import VehicleFactory
from siren_ros.simulation.world.actors import ActorClass


@pytest.fixture(scope="module")
def town() -> RoadNetwork:
    return load_map(None)[1]


def demand(start_m: float, speed_mps: float = 10.0, depart_mps: float = 10.0) -> EmvDemand:
    emv = load_template("S4").emv
    return EmvDemand(emv.actor_class, 1, start_m, speed_mps, depart_mps, 3.0, emv.start_from)


def test_speeding_up_follows_the_constant_acceleration() -> None:
    changing_m = (12.0**2 - 6.0**2) / (2.0 * EMV_ACCEL_MPS2)
    expected_s = (12.0 - 6.0) / EMV_ACCEL_MPS2 + (200.0 - changing_m) / 12.0
    assert unhindered_arrival_s(NETWORK, start_at(110.0), demand(0.0, 12.0, 6.0)) == pytest.approx(expected_s, abs=0.15)


def test_nobody_starts_on_a_shoulder(town: RoadNetwork) -> None:
    """The site is a turn along the shoulder; the EMV comes in the lane next to it and has to choose the shoulder."""
    site = require_site(town, SiteKind.SHOULDER_RIGHT_TURN)
    start = emv_start(town, site, start_m_of(town, site, demand(-70.0)))
    shoulder, lane = town.lanes[site.approach_lane], town.lanes[start.lane]
    assert shoulder.kind is LaneKind.SHOULDER
    assert lane.kind is LaneKind.DRIVING
    assert town.neighbour(town.lanes[start.lanes_to_site[-1]], -1) == shoulder


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


@pytest.mark.parametrize(("name", "after_s"), [("S1", -2.0), ("S2", 5.0), ("S4", 0.0), ("S6", -2.0)])
def test_the_crossing_emv_comes_from_the_side_to_the_first_ones_junction_in_time(name: str, after_s: float) -> None:
    """Into the site's junction, or into the first one behind the site's road."""
    setup = set_up(name, f"emv.crossing=1,emv.crossing_after_s={after_s}")
    network, site, template = setup.network, setup.site, setup.template
    start = emv_start(network, site, start_m_of(network, site, template.emv))
    ways, edge = crossing_ways(network, site, start)
    wanted_s = arrival_s(network, site, start, edge, template.emv) + after_s
    others = [vehicle for vehicle in setup.plan.groups if not vehicle.name.startswith("crossing")]
    way, across = crossing_start(network, ways, template.emv, wanted_s, (*setup.plan.emvs[:-1], *others))
    # It starts a run-up of 20 m before junctions on the way.
    assert abs(unhindered_arrival_s(network, across, template.emv) - wanted_s) < 5.0
    assert network.edges[edge].to_junction == way.junction == setup.plan.crossed
    assert setup.plan.crossed == (site.junction or network.edges[site.stretch[-1]].to_junction)
    own = civilian_movements(network, edge, start.route[start.route.index(edge) + 1])[-1]
    assert comes_from_the_side(network, own, network.connections[way.connections[-1]])
    assert setup.plan.emvs[-1].spot.lane == across.lane
    assert setup.plan.emvs[-1].spot.front_m == across.front_m
    assert any(area.lane == across.lane and area.from_m < across.front_m < area.to_m for area in setup.plan.stage)
    # No crossing queue stands in its lane; the other lanes keep theirs, and the volume stays.
    alone = set_up(name, "")
    chain = chain_along(network, network.lanes[across.lane], across.route).lanes
    before = chain[: next(at for at, lane in enumerate(chain) if network.lanes[lane].kind is LaneKind.INTERNAL)]
    queues = [[v.spot.lane for v in one.plan.groups if v.name.startswith("crossing")] for one in (setup, alone)]
    assert bool(queues[0]) is (name in {"S4", "S6"})
    assert len(queues[0]) <= len(queues[1])
    assert not {*queues[0]} & set(before)
    assert setup.plan.civilians == alone.plan.civilians
    assert (len(alone.plan.emvs), alone.description.crossed_junctions) == (1, {})
    assert "crossing" not in alone.description.parameters


def test_without_a_side_street_a_crossing_emv_is_refused() -> None:
    """The turn on the shoulder of a street without others: nobody comes from the side."""
    network, site = streets(), signal_site()
    side = [way for _, way in network.connections_at["J"] if network.lanes[way.from_lane].edge not in site.route]
    kept = tuple(way for way in network.connections if way not in side)
    lonely = replace(network, connections=kept)
    with pytest.raises(InputError, match=r"emv\.crossing is above 0"):
        crossing_ways(lonely, replace(site, connections=site.connections[:1]), start_at(110.0))


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
    assert crossing_start(NETWORK, [*ways, *ways], emv_demand(0.0), 15.0, ()) == (way, start)
    soon, near = crossing_start(NETWORK, ways, emv_demand(0.0), -1.0, ())
    assert (soon.junction, way_to_stop_line_m(NETWORK, near)) == ("J", pytest.approx(10.0)), "the nearest start"


def test_followers_keep_the_headway_where_the_approach_has_to_be_prolonged(town: RoadNetwork) -> None:
    network, template = town, load_template("S2")
    graph, pair = EdgeGraph.of(network), replace(template.emv, count=2)
    for site in find_sites(network, template.site_kind):
        before_m = graph.route_length_m(site.route[: site.site_position])
        longer = prolonged(network, site, before_m + 60.0)
        if len(longer.route) > len(site.route):
            break
    else:
        pytest.fail("no road leads to any approach")
    assert longer.route[longer.site_position] == site.site_edge
    headway_m = before_m + 30.0
    with pytest.raises(MapError):
        emv_start(network, site, start_m_of(network, site, pair) - headway_m - 60.0)
    first, second = following_starts(network, site, pair, headway_m)
    assert second.route[-len(first.route) :] == first.route
    assert len(second.route) > len(first.route)
    points = [np.array(network.lanes[start.lane].centre.at(start.front_m)) for start in (first, second)]
    assert np.linalg.norm(points[0] - points[1]) < headway_m + 60.0
    at_edge = replace(pair, start_m=0.0)
    third = following_starts(network, site, replace(at_edge, count=3), 0.5 * (headway_m + 60.0))[-1]
    assert third == following_starts(network, site, at_edge, headway_m + 60.0)[-1], "the second one of twice that"


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


def edges_of(traffic: TrafficPlan, network: RoadNetwork = NETWORK) -> set[str]:
    """Edges on which background and reserve start."""
    lanes = {vehicle.spot.lane for vehicle in (*traffic.background, *traffic.reserve)}
    return {network.edges[network.lanes[lane].edge].edge_id for lane in lanes}


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


def test_departing_and_arriving_on_a_straight_way() -> None:
    start = start_at(110.0)
    assert depart_speed_mps(NETWORK, start, emv_demand(0.0, 10.0)) == pytest.approx(10.0)
    there = replace(start, lane=B_LEFT, front_m=120.0, lanes_to_site=(B_LEFT,))
    assert unhindered_arrival_s(NETWORK, there, emv_demand(0.0, 10.0)) == 0.0
    assert depart_speed_mps(NETWORK, there, emv_demand(0.0, 10.0)) == 10.0


def plan(*groups: DemandGroup, count: int = 1, network: RoadNetwork = NETWORK, **changed: Any) -> TrafficPlan:
    template = template_with(*groups)
    emv = replace(template.emv, count=count, start_from=StartReference.SITE_START, start_m=-50.0)
    template = replace(template, emv=emv, **changed)
    return plan_traffic(network, signal_site(), template, 3, replace(same_drivers(), traffic=CONFIG), DIMENSIONS)


def near(monkeypatch: pytest.MonkeyPatch, **values: float) -> None:
    """Background traffic near the EMV's way alone, with a large reserve."""
    usual = {"NEIGHBOURHOOD_M": 5.0, "BACKGROUND_SPACING_M": 10.0, "RESERVE_FACTOR": 8.0}
    for name, value in {**usual, **values}.items():
        monkeypatch.setattr(demand_module, name, value)


def test_the_stage_reaches_from_behind_the_last_emv_to_ahead_of_the_groups() -> None:
    """The EMV's rear is at 153.8 m; 25 m behind that and 35 m ahead of the foremost front, on both lanes."""
    traffic = plan(replace(group(Placement.EMV_LANE, GroupAnchor.EMV, vehicles=1), first_gap_m=12.0))
    (foremost,) = traffic.groups
    front_m = foremost.spot.front_m
    assert front_m == pytest.approx(160.0 + 12.0 + 4.6)
    rear_m = 160.0 - 6.2 - 25.0
    assert LaneInterval(A_LEFT, pytest.approx(rear_m), pytest.approx(200.0)) in traffic.stage
    assert LaneInterval(A_RIGHT, pytest.approx(rear_m), pytest.approx(200.0)) in traffic.stage
    beyond_m = front_m + 35.0 - 210.0
    assert LaneInterval(B_LEFT, 0.0, pytest.approx(beyond_m)) in traffic.stage
    # Nobody of the groups in its lane: then its whole way to the stop line is kept free.
    free = plan(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=1, standing=True)).stage
    assert LaneInterval(B_LEFT, 0.0, pytest.approx(100.0)) in free
    assert LaneInterval(A_LEFT, 0.0, pytest.approx(200.0)) in free


def test_volumes_and_steps() -> None:
    traffic = plan(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=3))
    assert (len(traffic.groups), len(traffic.background), len(traffic.reserve)) == (3, 7, 40)
    assert (traffic.civilians, traffic.warm_up_steps) == (10, 100)


def test_background_traffic_can_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 0.7 of the limit, or so slow that it stops within 9 m, or before the end of its lane, at 2.5 m/s²."""
    monkeypatch.setattr(demand_module, "PLACEMENT_GAP_M", 6.0)
    monkeypatch.setattr(plan_module, "PLACEMENT_GAP_M", 6.0)
    traffic = plan()
    for vehicle in (*traffic.background, *traffic.reserve):
        lane = NETWORK.lanes[vehicle.spot.lane]
        free_m = min(6.0, lane.length_m - vehicle.spot.front_m)
        assert vehicle.spot.speed_mps == pytest.approx(min(0.7 * LIMIT_MPS, np.sqrt(2.0 * 2.5 * free_m)))
        assert vehicle.length_m <= vehicle.spot.front_m <= lane.length_m


def test_background_vehicles_keep_their_gaps_on_a_full_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """Vehicles of one lane are 9 m apart or more, on either side."""
    template = template_with()
    crowded = replace(template.demand, background_vehicles=22)
    monkeypatch.setattr(demand_module, "RESERVE_FACTOR", 0.0)
    vehicles = plan(demand=crowded).background
    by_lane: dict[int, list[float]] = {}
    for vehicle in vehicles:
        by_lane.setdefault(vehicle.spot.lane, []).append(vehicle.spot.front_m)
    assert max(map(len, by_lane.values())) > 2
    for fronts in by_lane.values():
        assert (np.diff(sorted(fronts)) >= 9.0 + 4.6).all()


def test_the_signal_turns_red_before_the_emv_arrives() -> None:
    """From 160 m, 150 m before the stop line at 10 m/s: 15 s. The left lane's movement has link 1.

    Braking from 10 to 5.56 m/s with 1.2 m/s² takes 3.70 s over 28.8 m, which is 0.82 s more.
    """
    crossing = group(Placement.CROSSING, GroupAnchor.STOP_LINE, vehicles=2, standing=True)
    traffic = plan(crossing, signal=SignalDemand(4.0)).signal
    assert traffic == SignalTiming(
        "J", 1, pytest.approx(11.82, abs=0.05), (3,), (), "emv0", pytest.approx(15.0), (0, 2, 1)
    )
    assert plan(crossing, signal=None).signal is None
    stream = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL, vehicles=2), name="stream")
    timing = plan(stream, crossing, signal=SignalDemand(4.0)).signal
    assert timing is not None
    assert (timing.platoon, timing.beside) == (("stream0", "stream1"), ())
    neighbours = replace(group(Placement.SAME_DIRECTION, GroupAnchor.EMV, vehicles=2), name="near")
    timing = plan(neighbours, crossing, signal=SignalDemand(4.0)).signal
    assert timing is not None
    assert (timing.platoon, timing.beside) == ((), ("near0", "near1"))


def test_background_traffic_is_near_the_emvs_way_also_beyond_the_site(monkeypatch: pytest.MonkeyPatch) -> None:
    """50 m beyond the site's edge the way ends with the edge that it has come to; the side road is 30 m away."""
    near(monkeypatch, NEIGHBOURHOOD_AFTER_M=50.0)
    traffic = plan()
    assert edges_of(traffic) == {"a", "b"}, "from the last edge nobody can drive on"
    back = replace(NETWORK.connections[0], from_lane=C_LEFT, via=())
    looped = replace(NETWORK, connections=(*NETWORK.connections, back))
    wide = plan(network=looped)
    assert edges_of(wide, looped) == {"a", "b", "c"}


def test_the_streets_around_have_a_density_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the lanes near the EMV's way, of 5 m, three lanes of 100 m lead on, of the roads m and n."""
    dense = replace(template_with().demand, background_vehicles=2, district_per_lane_km=40.0)
    for district_m, around in ((5.0, 0), (300.0, 12)):
        near(monkeypatch, DISTRICT_M=district_m)
        traffic = plan(demand=dense)
        district = [vehicle for vehicle in traffic.background if vehicle.name.startswith("district")]
        assert len(district) == around
        assert {vehicle.route[0] for vehicle in district} <= {"m", "n"}
        assert traffic.civilians == 2 + around


def test_next_to_a_shoulder_is_its_neighbour_on_either_side() -> None:
    lanes, edges = list(NETWORK.lanes), list(NETWORK.edges)
    shoulder = replace(lanes[B_LEFT], index=len(lanes), lane_id="b_2", position=2, kind=LaneKind.SHOULDER)
    edges[B] = replace(edges[B], lanes=(*edges[B].lanes, shoulder.index))
    network = replace(NETWORK, lanes=(*lanes, shoulder), edges=tuple(edges))
    assert travel_lane(network, replace(signal_site(), approach_lane=shoulder.index)).index == B_LEFT
    assert travel_lane(network, signal_site()).index == B_LEFT


def test_groups_ahead_are_counted_from_the_foremost_emv_and_the_others_keep_their_headway() -> None:
    """6.2 m of length and 2 s at 10 m/s."""
    traffic = plan(replace(group(Placement.EMV_LANE, GroupAnchor.EMV, vehicles=1), first_gap_m=12.0), count=3)
    assert [emv.spot.front_m for emv in traffic.emvs] == pytest.approx([160.0, 133.8, 107.6])
    assert {emv.spot.lane for emv in traffic.emvs} == {A_LEFT}
    assert LaneInterval(A_LEFT, pytest.approx(107.6 - 6.2 - 25.0), pytest.approx(200.0)) in traffic.stage
    first = traffic.emvs[0]
    assert (first.route, first.driver.speed_factor) == (("a", "b", "c"), pytest.approx(10.0 / LIMIT_MPS))
    assert traffic.groups[0].spot.front_m == pytest.approx(160.0 + 12.0 + 4.6)


def test_a_lane_is_near_the_emvs_way_where_its_middle_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The side road ends 12 m from the way, and its middle is 62 m away."""
    for reach_m, edges in ((20.0, {"a", "b"}), (70.0, {"a", "b", "n"})):
        near(monkeypatch, NEIGHBOURHOOD_M=reach_m)
        assert edges_of(plan()) == edges


def test_background_traffic_is_everywhere_where_the_lanes_near_the_way_are_too_short(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two lanes of 200 m and two of 100 m are near; ten civilians want 59 m or 61 m each."""
    for spacing_m, wide in ((59.0, False), (61.0, True)):
        near(monkeypatch, BACKGROUND_SPACING_M=spacing_m)
        assert ({"m", "n"} <= edges_of(plan())) is wide


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


def test_the_emv_of_a_plan_starts_at_that_speed() -> None:
    """The queue reaches back over K to the road on which the EMV starts at 160 m; a short one leaves it its 10 m/s."""
    for vehicles, limited in ((14, True), (4, False)):
        traffic = plan(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, vehicles=vehicles, standing=True))
        (emv,) = traffic.emvs
        spots = [vehicle.spot for vehicle in traffic.groups]
        rear_m = min({A_LEFT: 0.0, B_LEFT: 210.0}[spot.lane] + spot.front_m - 4.6 for spot in spots)
        expected_mps = min((5.0 * (rear_m - 160.0 - 4.0)) ** 0.5, 10.0)
        assert (expected_mps < 10.0) is limited
        assert emv.spot.speed_mps == pytest.approx(expected_mps)
