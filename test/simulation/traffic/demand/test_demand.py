from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_streets import (
    A_LEFT,
    A_RIGHT,
    B_LEFT,
    C_LEFT,
    CONFIG,
    group,
    same_drivers,
    signal_site,
    streets,
    template_with,
)
from traffic_helpers import DIMENSIONS, MAPS, load_map, named_map, plan_of, plan_s2

from siren_ros.errors import InputError, MapError
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph, driving_lanes
from siren_ros.simulation.roads.site_finder import require_site
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.scenario.scenario import DemandGroup, GroupAnchor, Placement, SignalDemand, StartReference
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand import demand
from siren_ros.simulation.traffic.demand.demand import (
    plan_traffic,
    sharing_junction_paths,
)
from siren_ros.simulation.traffic.demand.plan import (
    LaneInterval,
    PlannedVehicle,
    SignalTiming,
    TrafficPlan,
    load_drivers,
)
from siren_ros.simulation.world.actors import ActorClass

STREETS = streets()


@pytest.fixture(scope="module", name="network")
def _network() -> RoadNetwork:
    return load_map(None)[1]


def plan(network: RoadNetwork, seed: int = 0) -> TrafficPlan:
    return plan_s2(network, seed)[0]


def s2(network: RoadNetwork) -> Any:
    template = load_template("S2")
    return template, require_site(network, template.site_kind)


def everyone(traffic: TrafficPlan) -> tuple[PlannedVehicle, ...]:
    return (*traffic.emvs, *traffic.groups, *traffic.background, *traffic.reserve)


def test_same_seed_same_plan_at_every_level_other_seed_other_plan(network: RoadNetwork) -> None:
    assert plan(network, 3) == plan(network, 3)
    assert plan(network, 3).background != plan(network, 4).background
    traffic, template = plan_s2(network, 3)
    other = replace(template, level=EmergencyLevel.L0)
    assert other.level is not template.level
    assert plan_traffic(network, s2(network)[1], other, 3, load_drivers(), DIMENSIONS) == traffic


def test_reserve_stays_off_the_stage(network: RoadNetwork) -> None:
    traffic = plan(network)
    for vehicle in traffic.reserve:
        assert vehicle.spot.front_m >= vehicle.length_m, "with its whole length on its lane"
        for area in traffic.stage:
            assert area.lane != vehicle.spot.lane or not area.from_m <= vehicle.spot.front_m <= area.to_m


def gaps_m(vehicles: Iterable[PlannedVehicle]) -> list[float]:
    """Between vehicles of one lane, from each to the rear of the next one."""
    by_lane: dict[int, list[PlannedVehicle]] = {}
    for vehicle in sorted(vehicles, key=lambda vehicle: vehicle.spot.front_m):
        by_lane.setdefault(vehicle.spot.lane, []).append(vehicle)
    pairs = [pair for row in by_lane.values() for pair in pairwise(row)]
    return [ahead.spot.front_m - ahead.length_m - behind.spot.front_m for behind, ahead in pairs]


@pytest.mark.parametrize("map_name", MAPS)
@pytest.mark.parametrize("name", ["S1", "S3", "S4", "S5", "S6", "S7"])
def test_every_template_has_its_volume_and_distinct_places(map_name: str, name: str) -> None:
    traffic, template, _ = plan_of(name, named_map(map_name)[1])
    near = [vehicle for vehicle in traffic.background if vehicle.name.startswith("background")]
    assert len(traffic.groups) + len(near) == template.demand.background_vehicles
    assert len(traffic.groups) + len(traffic.background) == traffic.civilians
    assert len({vehicle.name for vehicle in everyone(traffic)}) == len(everyone(traffic))
    assert [vehicle for vehicle in everyone(traffic) if vehicle.is_emv] == [*traffic.emvs]
    assert all(gap_m > 0.4 for gap_m in gaps_m((*traffic.emvs, *traffic.groups)))


def test_a_signal_that_is_never_red_for_the_emv_is_left_alone(network: RoadNetwork) -> None:
    """At the end of S2's road, which may have one."""
    steady = tuple(replace(way, alternates=False) for way in network.connections)
    assert plan_s2(replace(network, connections=steady))[0].signal is None


def test_a_stream_passes_signals_behind_a_junction_where_it_has_no_room_before_them(
    network: RoadNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With cars of 100 m it has none; the green wave has the speed of the stream, over junctions of 40 m at most."""
    assert plan_of("S3", network)[0].signals_behind == ()
    monkeypatch.setattr(demand, "QUEUED_CAR_M", 100.0)
    traffic, template, site = plan_of("S3", network)
    assert traffic.signal is not None
    assert template.signal is not None
    wave_s = traffic.signal.red_from_s + template.signal.red_before_arrival_s
    edges = [network.edge_by_id[edge].index for edge in traffic.emvs[0].route]
    behind = edges[edges.index(site.stretch[-1]) + 1 :]
    ways_m = np.cumsum([driving_lanes(network, edge)[-1].length_m for edge in behind])
    assert traffic.signals_behind
    for timing in traffic.signals_behind:
        late_s = timing.red_from_s - wave_s - ways_m / template.demand.groups[0].speed_mps
        assert np.any((late_s > -0.5) & (late_s < 5.0 * np.arange(1, len(ways_m) + 1) + 0.5))


def test_missing_dimensions_and_too_many_vehicles_are_refused(network: RoadNetwork) -> None:
    template, site = s2(network)
    with pytest.raises(InputError, match="AMBULANCE"):
        plan_traffic(network, site, template, 0, load_drivers(), {ActorClass.SEDAN: (4.5, 1.8, 1.5)})
    crowded = replace(template, demand=replace(template.demand, background_vehicles=5000))
    with pytest.raises(MapError, match="room"):
        plan_traffic(network, site, crowded, 0, load_drivers(), DIMENSIONS)


def test_the_stage_holds_the_junction_paths_on_which_others_turn_off_the_emvs_way_or_into_it(
    network: RoadNetwork,
) -> None:
    way = max(network.connections, key=lambda way: len(network.connections_from[way.from_lane]))
    paths = sharing_junction_paths(network, [LaneInterval(way.via[0], 2.0, 5.0)])
    whole = {area.lane: (area.from_m, area.to_m) for area in paths}
    ends = {(over.from_lane, over.to_lane) for lane in whole for over in network.connections_over[lane]}
    assert len(whole) > len(way.via), "others turn off there"
    assert all(start == way.from_lane or end == way.to_lane for start, end in ends)
    assert any(start != way.from_lane for start, _ in ends), "others join there"
    assert whole == {lane: (0.0, network.lanes[lane].length_m) for lane in whole}
    assert sharing_junction_paths(network, [LaneInterval(way.from_lane, 0.0, 5.0)]) == []


CITY = load_map(Path("city"))[1]
RIDERS = {"demand.people.cyclists": 8.0, "demand.people.motorcycles": 3.0}


def with_riders(network: RoadNetwork, seed: int = 0) -> TrafficPlan:
    template, site = s2(network)
    return plan_traffic(network, site, template.with_values(RIDERS), seed, load_drivers(), DIMENSIONS)


def test_riders_change_nothing_else(network: RoadNetwork) -> None:
    template, site = s2(network)
    plain = plan_traffic(network, site, template, 0, load_drivers(), DIMENSIONS)
    assert plain.riders == ()
    assert everyone(with_riders(network)) == everyone(plain)


@pytest.mark.parametrize("seed", [0, 1])
def test_cyclists_start_on_cycle_lanes_or_on_the_right_of_streets_without(seed: int) -> None:
    cyclists = [rider for rider in with_riders(CITY, seed).riders if rider.actor_class is ActorClass.BICYCLE]
    kinds = set()
    for rider in cyclists:
        lane = CITY.lanes[rider.spot.lane]
        kinds.add(lane.kind)
        right = CITY.neighbour(lane, -1)
        assert right is not None
        assert right.kind is LaneKind.SIDEWALK
        edges = [CITY.edge_by_id[edge].index for edge in rider.route]
        assert edges[0] == lane.edge
        assert all(later in EdgeGraph.of(CITY).successors[edge] for edge, later in pairwise(edges))
    assert LaneKind.CYCLE in kinds


@pytest.mark.parametrize("seed", [19, 35])
def test_the_red_does_not_catch_a_driver_of_the_platoon_who_starts_too_near_to_stop(seed: int) -> None:
    setup = set_up_episode(EpisodeRequest(template="S4", seed=seed))
    assert setup.plan.signal is not None
    caught_s = []
    for vehicle in setup.plan.groups:
        way_m = setup.network.lanes[vehicle.spot.lane].length_m - vehicle.spot.front_m
        if vehicle.name in setup.plan.signal.platoon and way_m < vehicle.spot.speed_mps**2 / 6.0:
            caught_s.append(way_m / vehicle.spot.speed_mps)
    assert caught_s
    assert setup.plan.signal.red_from_s == pytest.approx(max(caught_s) + 1.2)


def edges_of(traffic: TrafficPlan, network: RoadNetwork = STREETS) -> set[str]:
    """Edges on which background and reserve start."""
    lanes = {vehicle.spot.lane for vehicle in (*traffic.background, *traffic.reserve)}
    return {network.edges[network.lanes[lane].edge].edge_id for lane in lanes}


def on_streets(*groups: DemandGroup, count: int = 1, network: RoadNetwork = STREETS, **changed: Any) -> TrafficPlan:
    template = template_with(*groups)
    emv = replace(template.emv, count=count, start_from=StartReference.SITE_START, start_m=-50.0)
    template = replace(template, emv=emv, **changed)
    return plan_traffic(network, signal_site(), template, 3, replace(same_drivers(), traffic=CONFIG), DIMENSIONS)


def near(monkeypatch: pytest.MonkeyPatch, **values: float) -> None:
    """Background traffic near the EMV's way alone, with a large reserve."""
    usual = {"NEIGHBOURHOOD_M": 5.0, "BACKGROUND_SPACING_M": 10.0, "RESERVE_FACTOR": 8.0}
    for name, value in {**usual, **values}.items():
        monkeypatch.setattr(demand, name, value)


def test_the_stage_reaches_from_behind_the_last_emv_to_ahead_of_the_groups() -> None:
    """The EMV's rear is at 153.8 m; 25 m behind that and 35 m ahead of the foremost front, on both lanes."""
    traffic = on_streets(replace(group(Placement.EMV_LANE, GroupAnchor.EMV, vehicles=1), first_gap_m=12.0))
    (foremost,) = traffic.groups
    front_m = foremost.spot.front_m
    assert front_m == pytest.approx(160.0 + 12.0 + 4.6)
    rear_m = 160.0 - 6.2 - 25.0
    assert LaneInterval(A_LEFT, pytest.approx(rear_m), pytest.approx(200.0)) in traffic.stage
    assert LaneInterval(A_RIGHT, pytest.approx(rear_m), pytest.approx(200.0)) in traffic.stage
    beyond_m = front_m + 35.0 - 210.0
    assert LaneInterval(B_LEFT, 0.0, pytest.approx(beyond_m)) in traffic.stage
    # Nobody of the groups in its lane: then its whole way to the stop line is kept free.
    free = on_streets(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=1, standing=True)).stage
    assert LaneInterval(B_LEFT, 0.0, pytest.approx(100.0)) in free
    assert LaneInterval(A_LEFT, 0.0, pytest.approx(200.0)) in free


def test_the_signal_turns_red_before_the_emv_arrives() -> None:
    """From 160 m, 150 m before the stop line at 10 m/s: 15 s. The left lane's movement has link 1.

    Braking from 10 to 5.56 m/s with 1.2 m/s² takes 3.70 s over 28.8 m, which is 0.82 s more.
    """
    crossing = group(Placement.CROSSING, GroupAnchor.STOP_LINE, vehicles=2, standing=True)
    traffic = on_streets(crossing, signal=SignalDemand(4.0)).signal
    assert traffic == SignalTiming(
        "J", 1, pytest.approx(11.82, abs=0.05), (3,), (), "emv0", pytest.approx(15.0), (0, 2, 1)
    )
    assert on_streets(crossing, signal=None).signal is None
    stream = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL, vehicles=2), name="stream")
    timing = on_streets(stream, crossing, signal=SignalDemand(4.0)).signal
    assert timing is not None
    assert (timing.platoon, timing.beside) == (("stream0", "stream1"), ())
    neighbours = replace(group(Placement.SAME_DIRECTION, GroupAnchor.EMV, vehicles=2), name="near")
    timing = on_streets(neighbours, crossing, signal=SignalDemand(4.0)).signal
    assert timing is not None
    assert (timing.platoon, timing.beside) == ((), ("near0", "near1"))


def test_the_emv_starts_farther_back_where_the_light_would_be_yellow_from_the_beginning() -> None:
    """It comes to the line after 15.8 s at 10 m/s, whatever its light. The road begins 160 m behind its start."""
    stream = group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL, vehicles=1)
    ways = tuple(replace(way, yellow_s=6.0) for way in STREETS.connections)
    for red_s, optional, front_m in ((9.7, 0, 160.0), (11.0, 0, 148.0), (11.0, 1, 160.0), (60.0, 0, 160.0)):
        network = replace(STREETS, connections=ways)
        traffic = on_streets(replace(stream, optional=bool(optional)), network=network, signal=SignalDemand(red_s))
        assert traffic.emvs[0].spot.front_m == pytest.approx(front_m, abs=0.3)


def test_the_emv_starts_farther_back_where_its_stream_cannot_start_in_time_in_front_of_a_junction() -> None:
    """The line is at 310 m, and a junction from 200 m to 210 m: at none of these speeds the stream comes late."""
    leads_s, fronts_m = [], []
    for speed_mps in np.arange(6.0, 8.0, 0.1):
        stream = group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL, vehicles=1)
        traffic = on_streets(replace(stream, speed_mps=speed_mps), signal=SignalDemand(4.0))
        (last,), (emv,), signal = traffic.groups, traffic.emvs, traffic.signal
        assert signal is not None
        before_m = 310.0 - last.spot.front_m - (210.0 if last.route[0] == "b" else 0.0)
        leads_s.append(signal.emv_from_s - before_m / last.spot.speed_mps)
        fronts_m.append(emv.spot.front_m)
    assert min(leads_s) > 0.5, "from its own place it is 0.6 s to 1.1 s ahead"
    assert min(fronts_m) < 158.0 < max(fronts_m) == pytest.approx(160.0)


def test_background_traffic_is_near_the_emvs_way_also_beyond_the_site(monkeypatch: pytest.MonkeyPatch) -> None:
    """50 m beyond the site's edge the way ends with the edge that it has come to; the side road is 30 m away."""
    near(monkeypatch, NEIGHBOURHOOD_AFTER_M=50.0)
    traffic = on_streets()
    assert edges_of(traffic) == {"a", "b"}, "from the last edge nobody can drive on"
    back = replace(STREETS.connections[0], from_lane=C_LEFT, via=())
    looped = replace(STREETS, connections=(*STREETS.connections, back))
    wide = on_streets(network=looped)
    assert edges_of(wide, looped) == {"a", "b", "c"}


def test_the_streets_around_have_a_density_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the lanes near the EMV's way, of 5 m, three lanes of 100 m lead on, of the roads m and n."""
    dense = replace(template_with().demand, background_vehicles=2, district_per_lane_km=40.0)
    for district_m, around in ((5.0, 0), (300.0, 12)):
        near(monkeypatch, DISTRICT_M=district_m)
        traffic = on_streets(demand=dense)
        district = [vehicle for vehicle in traffic.background if vehicle.name.startswith("district")]
        assert len(district) == around
        assert {vehicle.route[0] for vehicle in district} <= {"m", "n"}
        assert traffic.civilians == 2 + around


def test_a_lane_is_near_the_emvs_way_where_its_middle_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The side road ends 12 m from the way, and its middle is 62 m away."""
    for reach_m, edges in ((20.0, {"a", "b"}), (70.0, {"a", "b", "n"})):
        near(monkeypatch, NEIGHBOURHOOD_M=reach_m)
        assert edges_of(on_streets()) == edges


def test_background_traffic_is_everywhere_where_the_lanes_near_the_way_are_too_short(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two lanes of 200 m and two of 100 m are near; ten civilians want 59 m or 61 m each."""
    for spacing_m, wide in ((59.0, False), (61.0, True)):
        near(monkeypatch, BACKGROUND_SPACING_M=spacing_m)
        assert ({"m", "n"} <= edges_of(on_streets())) is wide
