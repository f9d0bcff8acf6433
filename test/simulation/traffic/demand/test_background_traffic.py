"""The plan of a whole episode on two streets that cross: the stage, the background traffic and the signal."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_streets import (
    A_LEFT,
    A_RIGHT,
    B_LEFT,
    C_LEFT,
    CONFIG,
    FAR,
    LIMIT_MPS,
    NEAR,
    group,
    same_drivers,
    signal_site,
    streets,
    template_with,
)
from traffic_helpers import DIMENSIONS

from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.scenario import (
    DemandGroup,
    GroupAnchor,
    Placement,
    SignalDemand,
    StartReference,
)
from siren_ros.simulation.traffic.demand import demand as demand_module
from siren_ros.simulation.traffic.demand import plan as plan_module
from siren_ros.simulation.traffic.demand.demand import plan_traffic
from siren_ros.simulation.traffic.demand.plan import LaneInterval, SignalTiming, TrafficPlan

NETWORK = streets()


def edges_of(traffic: TrafficPlan, network: RoadNetwork = NETWORK) -> set[str]:
    """Edges on which background and reserve start."""
    lanes = {vehicle.spot.lane for vehicle in (*traffic.background, *traffic.reserve)}
    return {network.edges[network.lanes[lane].edge].edge_id for lane in lanes}


def plan(*groups: DemandGroup, count: int = 1, network: RoadNetwork = NETWORK, **changed: Any) -> TrafficPlan:
    template = template_with(*groups)
    crossing = {"crossing": 1, "crossing_after_s": changed.pop("after_s")} if "after_s" in changed else {}
    emv = replace(template.emv, count=count, start_from=StartReference.SITE_START, start_m=-50.0, **crossing)
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


@pytest.mark.parametrize(("after_s", "lane", "front_m"), [(-2.0, FAR, 170.0), (-6.0, NEAR, 10.0)])
def test_the_emv_that_crosses_comes_so_long_before_the_first_one(after_s: float, lane: int, front_m: float) -> None:
    """That one comes after 15 s, and both drive 10 m/s; NEAR has 100 m, and before it 200 m lead there."""
    crossing = plan(after_s=after_s).emvs[-1]
    assert (crossing.name, crossing.spot.lane) == ("crossing_emv0", lane)
    assert crossing.spot.front_m == pytest.approx(front_m, abs=1.0)
