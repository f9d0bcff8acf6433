"""The rows of a template's groups on two streets that cross, and on a straight approach to a signal."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
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
    CAR_M,
    CONFIG,
    CROSSING,
    FAR,
    LIMIT_MPS,
    NEAR,
    SOUTH,
    STOP_LINE_M,
    STRAIGHT,
    STRAIGHT_LEFT,
    TURN,
    A,
    B,
    C,
    D,
    M,
    N,
    group,
    same_drivers,
    signal_site,
    start_at,
    streets,
    template_with,
)
from traffic_helpers import DIMENSIONS

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import Connection, Edge, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.sites import Site, SiteKind
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.scenario.scenario import DemandGroup, GroupAnchor, Placement, SignalDemand, ValueRange
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.emv_start import (
    EmvStart,
    bound_s_of,
    early_m_of,
    lane_before,
    stays_inside,
    unhindered_arrival_s,
)
from siren_ros.simulation.traffic.demand.group_demand import (
    STAGE_BEHIND_M,
    GroupPlan,
    GroupRow,
    approach_row,
    before_bends_mps,
    connection_from,
    group_rows,
    plan_groups,
    route_length_m,
)
from siren_ros.simulation.traffic.demand.plan import LEAST_HEADWAY_S, LaneInterval, PlannedVehicle
from siren_ros.simulation.traffic.demand.road_users import VehicleFactory
from siren_ros.simulation.world.actors import ActorClass

NETWORK = streets()


def rows(
    group: DemandGroup,
    start: EmvStart | None = None,
    arrival_s: float = 12.0,
    network: RoadNetwork = NETWORK,
    **site: Any,
) -> list[GroupRow]:
    where, rng = replace(signal_site(), **site), np.random.default_rng(0)
    return group_rows(network, where, start or start_at(90.0), group, arrival_s, rng)


def test_a_queue_grows_backwards_from_the_stop_line() -> None:
    (row,) = rows(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE))
    assert [lane for lane in row.chain.lanes if lane < 9] == [A_LEFT, B_LEFT, C_LEFT]
    assert (row.edges, row.forwards) == ((A, B, C), False)
    # In the EMV's own lane nobody is put behind it: its front is 90 m after the beginning of the row.
    assert (row.anchor_m, row.least_m, row.chain.end_m) == pytest.approx((STOP_LINE_M, 90.0, 530.0))
    (next_to,) = rows(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE))
    assert [lane for lane in next_to.chain.lanes if lane < 9] == [A_RIGHT, B_RIGHT, C_RIGHT]
    assert (next_to.anchor_m, next_to.least_m) == (pytest.approx(STOP_LINE_M), 0.0)
    # It begins on the edge of the EMV's start.
    (late,) = rows(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE), EmvStart(B_LEFT, 30.0, (B, C), (B_LEFT,)))
    assert [lane for lane in late.chain.lanes if lane < 9] == [B_LEFT, C_LEFT]
    assert (late.edges, late.anchor_m, late.least_m) == ((B, C), pytest.approx(100.0), pytest.approx(30.0))


def shoulder_rows(group: DemandGroup, start: EmvStart, signal_before: bool, from_m: float = 0.0) -> list[GroupRow]:
    """The right lane of the approach is a shoulder; the junction K before it is a joint, or has a signal.

    The approach may be cut off at its beginning.
    """
    lanes = list(NETWORK.lanes)
    lanes[B_RIGHT] = replace(lanes[B_RIGHT], kind=LaneKind.SHOULDER, civilian_allowed=False)
    lanes[B_LEFT] = replace(lanes[B_LEFT], centre=lanes[B_LEFT].centre.cut(from_m, 100.0))
    connections = list(NETWORK.connections)
    (into,) = (index for index, connection in enumerate(connections) if connection.to_lane == B_LEFT)
    if signal_before:
        connections[into] = replace(connections[into], signal_id="K", signal_link=0)
    network = replace(NETWORK, lanes=tuple(lanes), connections=tuple(connections))
    return rows(group, start, network=network, approach_lane=B_RIGHT)


def test_a_queue_next_to_a_shoulder_leaves_the_way_onto_it() -> None:
    """40 m before it: from the junction K at 210 m on, or from the EMV's start on; and 50 m at least."""
    queue = group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, standing=True)
    for start_m, signal_before, least_m in ((90.0, True, 250.0), (90.0, False, 130.0), (190.0, True, 250.0)):
        (row,) = shoulder_rows(queue, start_at(start_m), signal_before)
        assert row.least_m == pytest.approx(least_m)
    (late,) = shoulder_rows(queue, EmvStart(B_LEFT, 30.0, (B, C), (B_LEFT,)), signal_before=True)
    assert late.least_m == pytest.approx(70.0)
    (short,) = shoulder_rows(queue, start_at(90.0), signal_before=True, from_m=40.0)
    assert short.anchor_m - short.least_m == pytest.approx(50.0), "at least"


def test_a_stream_comes_to_the_stop_line_together_with_the_emv() -> None:
    """At 8 m/s it comes 96 m far within 12 s."""
    together = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL), first_gap_m=10.0)
    (stream,) = rows(together)
    assert stream.chain.lanes[0] == A_RIGHT
    assert stream.forwards
    assert STOP_LINE_M - stream.anchor_m == pytest.approx(8.0 * 12.0, abs=1.0)
    assert stream.most_m == pytest.approx(STOP_LINE_M)
    (early,) = rows(together, arrival_s=100.0)
    assert early.anchor_m == pytest.approx(STOP_LINE_M - 800.0), "from before the row's beginning"


def test_a_stream_that_the_emv_follows_keeps_its_distance_from_the_start_on() -> None:
    for first_gap_m, nearer_m in ((20.0, 6.0), (12.0, 2.0), (8.0, -2.0)):
        (row,) = rows(replace(group(Placement.EMV_LANE, GroupAnchor.ARRIVAL), first_gap_m=first_gap_m))
        assert (row.anchor_m, row.most_m) == pytest.approx((90.0 - nearer_m, STOP_LINE_M)), "10 m at least"


def test_a_bend_on_the_way_brings_the_stream_nearer() -> None:
    """A quarter circle of 12 m before the stop line is driven at 6 m/s: that costs time, and so way."""
    angle = np.linspace(0.0, np.pi / 2.0, 40)
    bend = np.stack((-18.85 + 12.0 * np.sin(angle), -5.25 - 12.0 + 12.0 * np.cos(angle)), axis=-1)
    lanes = list(NETWORK.lanes)
    straight = Polyline.through([(-100.0, -5.25), (-18.85, -5.25)])
    lanes[B_RIGHT] = replace(lanes[B_RIGHT], centre=Polyline.through(np.concatenate((straight.points, bend))))
    fast = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL), speed_mps=12.0, first_gap_m=12.0)
    south_m = -17.25 - 30.0 * np.arange(4)  # and straight on beyond the line
    for lane, ends in zip(rows(fast)[0].chain.lanes[3:], pairwise(south_m), strict=False):
        lanes[lane] = replace(lanes[lane], centre=Polyline.through([(-6.85, y) for y in ends]))
    bent = replace(NETWORK, lanes=tuple(lanes))
    (row,) = rows(fast, network=bent)
    (flat,) = rows(fast)
    assert flat.most_m - flat.anchor_m == pytest.approx(12.0 * 12.0, abs=1.0)
    way_m = row.most_m - row.anchor_m
    # 18.85 m at 6 m/s, and before it braking from 12 m/s with 1.5 m/s²: (12² − 6²) / 3 = 36 m in 4 s.
    expected_m = 18.85 + 36.0 + (12.0 - 18.85 / 6.0 - 4.0) * 12.0
    assert way_m == pytest.approx(expected_m, abs=3.0)
    assert flat.headway_s == 0.0
    assert 6.0 < bent_line_mps(row) < 7.0, "where the bend ends"


def bent_line_mps(row: GroupRow) -> float:
    """Speed at the line for which a queue's headway of 2 s has the time that 7.6 m take longer than at 12 m/s."""
    return 1.0 / ((row.headway_s - 2.0) / 7.6 + 1.0 / 12.0)


def test_a_bend_right_behind_the_line_slows_a_stream_at_the_line() -> None:
    """A quarter circle of 12 m, driven at 6 m/s."""
    angle, lanes = np.linspace(0.0, np.pi / 2.0, 40), list(NETWORK.lanes)
    bend = np.stack((12.0 * np.sin(angle), -17.25 + 12.0 * np.cos(angle)), axis=-1)
    (path,) = NETWORK.connections[STRAIGHT].via
    lanes[path] = replace(lanes[path], centre=Polyline.through(bend))
    lanes[C_RIGHT] = replace(lanes[C_RIGHT], centre=Polyline.through([(12.0, -17.25), (12.0, -217.0)]))
    fast = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL), speed_mps=12.0, first_gap_m=12.0)
    (row,) = rows(fast, network=replace(NETWORK, lanes=tuple(lanes)))
    assert 6.0 < bent_line_mps(row) < 7.0
    bent = replace(NETWORK, lanes=tuple(lanes))
    near, far = (before_bends_mps(bent, lanes[B_RIGHT], 99.0, route, 20.0) for route in (("b", "c"), ("b",)))
    assert near < 7.0 < far


def crossing(vehicles: int, spacing_m: float = 3.0) -> DemandGroup:
    """Vehicles with 8 m/s."""
    queue = group(Placement.CROSSING, GroupAnchor.STOP_LINE, standing=True)
    return replace(queue, vehicles=vehicles, spacing_m=spacing_m)


def test_a_crossing_row_that_nothing_holds_is_a_stream_in_whose_middle_the_emv_comes() -> None:
    """Two pass it in 4 s, 2 s before the EMV and after; the street is 300 m long."""
    free = with_connection(CROSSING, signal_id=None, must_stop=False)
    (row,) = rows(crossing(2), network=free)
    assert row.headway_s == 2.0
    assert 300.0 - row.anchor_m == pytest.approx(8.0 * (12.0 - 2.0), abs=1.0)
    (held,) = rows(crossing(2), network=with_connection(CROSSING, signal_id=None, must_stop=True))
    assert (held.headway_s, held.anchor_m) == (0.0, pytest.approx(300.0))
    slow = replace(NETWORK.lanes[NEAR], speed_limit_mps=6.0)
    lanes = tuple(slow if lane.index == NEAR else lane for lane in NETWORK.lanes)
    (row,) = rows(crossing(2), network=replace(free, lanes=lanes))
    assert 300.0 - row.anchor_m == pytest.approx(6.0 * (12.0 - 2.0), abs=1.0), "the limit of the street"
    row, other = rows(crossing(8), network=free, crossing=(CROSSING, TURN))
    assert 300.0 - row.anchor_m == pytest.approx(8.0 * (12.0 - 4.0), abs=1.0), "four of eight in each row"
    assert (other.movement, other.headway_s) == (TURN, 0.0)


def crossing_order(*crossing_ways: int, network: RoadNetwork = NETWORK, **site: Any) -> list[int | None]:
    """Movements of the crossing rows; the queues are long enough for three."""
    return [row.movement for row in rows(crossing(10), network=network, crossing=crossing_ways, **site)]


def test_crossing_rows_come_from_each_side_in_turn_and_first_those_straight_on_to_other_roads() -> None:
    assert crossing_order(CROSSING, TURN) == crossing_order(TURN, CROSSING) == [CROSSING, TURN]
    merging = with_connection(CROSSING, to_lane=C_RIGHT)
    assert crossing_order(CROSSING, TURN, network=merging) == [TURN, CROSSING]
    sides = crossing_order(STRAIGHT, STRAIGHT_LEFT, CROSSING, connections=())
    assert sides == [STRAIGHT, CROSSING, STRAIGHT_LEFT]
    east = replace(NETWORK.connections[CROSSING], to_lane=C_RIGHT, direction="l")
    both, added = replace(NETWORK, connections=(*NETWORK.connections, east)), len(NETWORK.connections)
    for ways in ((CROSSING, added), (added, CROSSING)):
        assert crossing_order(*ways, network=both) == [CROSSING], "none leads on; the other joins the EMV's road"


def test_every_other_queue_at_stop_signs_begins_farther_back() -> None:
    """The approach of the side street is 300 m long, the other one 310 m."""
    signed = tuple(replace(way, must_stop=way.junction == "J") for way in NETWORK.connections)
    stops = replace(NETWORK, connections=signed)
    for ways, network, anchors_m in (
        ((CROSSING, TURN), stops, {CROSSING: 300.0, TURN: 302.0}),
        ((TURN, CROSSING), stops, {CROSSING: 292.0, TURN: 310.0}),
        ((TURN, CROSSING), NETWORK, {CROSSING: 300.0, TURN: 310.0}),
    ):
        found = rows(crossing(10), network=network, crossing=ways)
        assert {row.movement: row.anchor_m for row in found} == pytest.approx(anchors_m)


def test_the_first_crossing_row_lasts_until_the_emv_comes() -> None:
    """Four at least, and one in 2 s of red: of seven vehicles the second row gets some only after a short red."""
    factory, site = (
        VehicleFactory(NETWORK, same_drivers(), DIMENSIONS),
        replace(signal_site(), crossing=(CROSSING, TURN)),
    )
    for vehicles, red_s, ways in ((7, 4.0, (CROSSING, TURN)), (6, 4.0, (CROSSING,)), (7, 12.0, (CROSSING,))):
        template = replace(template_with(crossing(vehicles)), signal=SignalDemand(red_s))
        plan = plan_groups(NETWORK, site, start_at(90.0), template, 0, factory, CONFIG)
        assert plan.crossing == ways


def at_stop(*groups: DemandGroup, kind: SiteKind = SiteKind.STOP_JUNCTION, **demand: Any) -> list[str]:
    """Names of the vehicles that are planned there, within 40 s."""
    template = replace(template_with(*groups), duration_s=40.0)
    template = replace(template, demand=replace(template.demand, **demand))
    factory = VehicleFactory(NETWORK, same_drivers(), DIMENSIONS)
    plan = plan_groups(NETWORK, replace(signal_site(), kind=kind), start_at(90.0), template, 0, factory, CONFIG)
    return [vehicle.name for vehicle in plan.vehicles]


def test_with_riders_fewer_lead_the_emv_at_a_stop_sign() -> None:
    """Each takes 9.6 s, and the EMV the turn after the last of them; others wait as they are."""
    queue = replace(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, 5, standing=True), name="own")
    others = replace(crossing(5), name="other")
    riders = {"people": replace(template_with().demand.people, cyclists=3)}
    assert len(at_stop(queue, others)) == 10
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


@pytest.mark.parametrize(
    ("vehicles", "arrival_s", "anchor_m"),
    [(22, 40.0, 22 * 8.0), (40, 40.0, 300.0), (20, 34.0, 300.0 - 8.0 * (34.0 - 20.0 - 1.6))],
)
def test_on_a_short_street_it_is_a_queue_as_far_back_as_it_fits(
    vehicles: int, arrival_s: float, anchor_m: float
) -> None:
    """The last of 22 vehicles would be 8 m/s · 34 s before the line, and 22 in a queue are 176 m long.

    20 drive off later by the 1.6 s that they lose then.
    """
    free = with_connection(CROSSING, signal_id=None, must_stop=False)
    (row,) = rows(crossing(vehicles), network=free, arrival_s=arrival_s)
    assert (row.headway_s, row.anchor_m) == (0.0, pytest.approx(anchor_m, abs=1.0))


def test_crossing_rows_do_not_leave_the_map_behind_the_junction_where_another_way_leads_on() -> None:
    """Of the ways south and east only the one east leads on: back to the first road."""
    east = replace(NETWORK.connections[CROSSING], to_lane=C_RIGHT, direction="l")
    back = replace(NETWORK.connections[STRAIGHT], from_lane=C_RIGHT, to_lane=A_RIGHT)
    network = replace(NETWORK, connections=(*NETWORK.connections, east, back))
    chosen = len(NETWORK.connections)
    for crossing in ((CROSSING, chosen), (chosen, CROSSING)):
        (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=network, crossing=crossing)
        assert (row.movement, row.edges) == (chosen, (M, N, C))


def with_connection(number: int, **changed: object) -> RoadNetwork:
    connections = list(NETWORK.connections)
    connections[number] = replace(connections[number], **changed)  # type: ignore[arg-type] # fields by name
    return replace(NETWORK, connections=tuple(connections))


def test_crossing_rows_go_back_straight_on_or_around_the_only_bend_up_to_signals_and_stop_signs() -> None:
    """Where a turn joins the way straight on, the row stays on this; alone the turn is the way."""
    (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE))
    assert [lane for lane in row.chain.lanes if lane < 9] == [FAR, NEAR]
    assert (row.edges, row.anchor_m) == ((M, N, D), pytest.approx(190.0 + 10.0 + 100.0))
    assert (row.forwards, row.movement) == (False, CROSSING)
    for control in ({"signal_id": "L"}, {"must_stop": True}):
        (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=with_connection(6, **control))
        assert (row.chain.lanes, row.edges) == ((NEAR,), (N, D))
    gives_way = with_connection(6, gives_way=True)
    (held,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=gives_way)
    assert held.edges == (M, N, D)
    ways = [replace(way, signal_id=None) for way in gives_way.connections]
    (free,) = rows(crossing(2), network=replace(NETWORK, connections=tuple(ways)))
    assert free.edges == (N, D), "a stream would wait there"
    (ring,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=with_connection(6, from_lane=NEAR))
    assert ring.chain.lanes == (NEAR,)
    cycle_lane = replace(NETWORK.lanes[FAR], kind=LaneKind.CYCLE)
    lanes = tuple(cycle_lane if lane.index == FAR else lane for lane in NETWORK.lanes)
    (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=replace(NETWORK, lanes=lanes))
    assert row.edges == (N, D)
    joined = with_connection(6, direction="r")
    (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=joined)
    bend = row.chain.lanes
    assert bend[-1] == NEAR
    assert len(bend) > 1
    straight = replace(NETWORK.connections[6], from_lane=A_RIGHT)
    for order in ((*joined.connections, straight), (straight, *joined.connections)):
        (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=replace(joined, connections=order))
        assert row.chain.lanes[-3] == A_RIGHT


def test_long_side_roads_are_enough_by_themselves() -> None:
    lanes = list(NETWORK.lanes)
    lanes[NEAR] = replace(lanes[NEAR], centre=Polyline.through([(10.0, 320.0), (10.0, 10.0)]))
    (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=replace(NETWORK, lanes=tuple(lanes)))
    assert row.chain.lanes == (NEAR,)


def test_standing_neighbours_leave_the_emvs_lane_free() -> None:
    """With one lane in its direction an optional group is left out: the EMV could not pass."""
    (row,) = rows(group(Placement.SAME_DIRECTION, GroupAnchor.STOP_LINE, standing=True, optional=True))
    assert row.chain.lanes[0] == A_RIGHT

    def of(anchor: GroupAnchor, optional: bool) -> list[int]:
        beside = rows(group(Placement.SAME_DIRECTION, anchor, optional=optional), connections=(3,))
        return [row.chain.lanes[0] for row in beside]

    for anchor in GroupAnchor:
        assert of(anchor, optional=True) == []
    assert of(GroupAnchor.ARRIVAL, optional=False) == [A_LEFT]


def test_traffic_next_to_the_emv_starts_on_the_first_third_of_its_way() -> None:
    (row,) = rows(group(Placement.SAME_DIRECTION, GroupAnchor.EMV))
    assert row.chain.lanes[0] == A_RIGHT
    assert (row.anchor_m, row.forwards) == (pytest.approx(90.0), True)
    assert row.most_m == pytest.approx(90.0 + (STOP_LINE_M - 90.0) / 3.0)
    (ahead,) = rows(group(Placement.EMV_LANE, GroupAnchor.EMV))
    assert (ahead.forwards, ahead.anchor_m, ahead.most_m) == (True, pytest.approx(90.0), np.inf)
    (no_junction,) = rows(group(Placement.ADJACENT_LANE, GroupAnchor.EMV), junction=None)
    assert (no_junction.chain.lanes[0], no_junction.forwards) == (A_RIGHT, True)
    assert (no_junction.anchor_m, no_junction.edges) == (pytest.approx(90.0), (A, B, C))


def test_standing_rows_do_not_lie_on_the_emvs_way() -> None:
    """The EMV starts in the right lane; the row next to its approach lane begins there, too."""
    joined = with_connection(0, to_lane=B_LEFT)
    start = EmvStart(A_RIGHT, 90.0, (A, B, C), (A_RIGHT, 9, B_LEFT))
    queue = group(Placement.OTHER_LANES, GroupAnchor.STOP_LINE, standing=True)
    (kept,) = rows(queue, start, network=joined)
    assert kept.chain.lanes[0] == B_RIGHT, "no lane leads to it"
    lane_of_all = replace(joined, connections=(*joined.connections, replace(NETWORK.connections[0])))
    assert rows(queue, start, network=lane_of_all) == []
    assert rows(replace(queue, standing=False), start, network=lane_of_all) != []


def test_of_two_adjacent_lanes_the_left_one_is_taken() -> None:
    """Three lanes, the EMV in the middle."""
    lanes, edges = list(NETWORK.lanes), list(NETWORK.edges)
    third = replace(lanes[A_LEFT], index=len(lanes), lane_id="a_2", position=2)
    edges[A] = replace(edges[A], lanes=(*edges[A].lanes, third.index))
    wide = replace(NETWORK, lanes=(*lanes, third), edges=tuple(edges))
    for placement, first in ((Placement.ADJACENT_LANE, [third.index]), (Placement.OTHER_LANES, [A_RIGHT, third.index])):
        beside = rows(group(placement, GroupAnchor.EMV), network=wide, junction=None)
        assert [row.chain.lanes[0] for row in beside] == first


def test_drivers_who_turn_wait_in_the_lanes_from_which_nobody_follows_the_emv() -> None:
    """The connections of the site lead on from both lanes, or from the EMV's alone."""
    turning = group(Placement.TURNING_LANES, GroupAnchor.STOP_LINE, standing=True, optional=True)
    assert rows(turning) == []
    (row,) = rows(turning, connections=(3,))
    assert row.chain.lanes[0] == A_RIGHT
    assert (row.anchor_m, row.forwards) == (pytest.approx(STOP_LINE_M), False)


def test_drivers_wait_in_a_turning_lane_that_branches_off_from_the_emvs_lane_behind_the_branch() -> None:
    """Both lanes of B begin on the EMV's lane of A, which is 200 m long; only the left one leads on."""
    branching = with_connection(0, from_lane=A_LEFT)
    turning = group(Placement.TURNING_LANES, GroupAnchor.STOP_LINE, standing=True, optional=True)
    for path, branch_m in ((branching.connections_to[B_LEFT][0].via, 200.0), (branching.connections[0].via, 210.0)):
        start = EmvStart(A_LEFT, 90.0, (A, B, C), (A_LEFT, *path, B_LEFT))
        (row,) = rows(turning, start, network=branching, connections=(3,))
        assert [lane for lane in row.chain.lanes if lane in {A_LEFT, A_RIGHT, B_LEFT, B_RIGHT}] == [A_LEFT, B_RIGHT]
        assert (row.anchor_m, row.least_m) == (pytest.approx(STOP_LINE_M), pytest.approx(branch_m))
    taken = replace(start, lanes_to_site=(A_LEFT, B_RIGHT))
    assert rows(turning, taken, network=branching, connections=(3,)) == []


@pytest.mark.parametrize(("lane", "first"), [(C_LEFT, A_LEFT), (C_RIGHT, A_RIGHT)])
def test_a_row_before_the_site_reaches_back_over_several_edges(lane: int, first: int) -> None:
    """200 m, 10 m, 100 m, 20 m and 200 m: all of them lead to the end of the last edge."""
    roads = streets()
    start = EmvStart(A_LEFT, 30.0, (A, B, C), (A_LEFT,))
    row = approach_row(roads, replace(signal_site(), site_edge=C), start, roads.lanes[lane])
    assert (row.chain.lanes[0], row.chain.lanes[-1]) == (first, lane)
    assert (row.anchor_m, row.edges) == (pytest.approx(530.0), (A, B, C))


def test_without_a_lane_that_leads_there_the_leftmost_one_is_before() -> None:
    roads = streets()
    assert lane_before(roads, roads.lanes[C_RIGHT], A) == (roads.lanes[A_LEFT], ())
    lane, via = lane_before(roads, roads.lanes[C_RIGHT], B)
    assert lane.index == B_RIGHT
    assert len(via) == 1


def test_of_two_lanes_that_lead_into_one_the_leftmost_is_before() -> None:
    roads = streets()
    merging = replace(roads.connections[0], to_lane=B_LEFT)
    for connections in ((*roads.connections, merging), (merging, *roads.connections)):
        network = replace(roads, connections=connections)
        assert {connection.from_lane for connection in network.connections_to[B_LEFT]} == {A_LEFT, A_RIGHT}
        before = connection_from(network, B_LEFT, A)
        assert before is not None
        assert before.from_lane == A_LEFT
        assert lane_before(network, network.lanes[B_LEFT], A)[0].index == A_LEFT


STARTS_M = {A_RIGHT: 0.0, A_LEFT: 0.0, B_RIGHT: 210.0, B_LEFT: 210.0, FAR: 0.0, NEAR: 200.0}
"""Where lanes begin on the way to the stop line."""


def planned(
    *groups: DemandGroup,
    start: EmvStart | None = None,
    traffic: TrafficDrivers = CONFIG,
    seed: int = 0,
    network: RoadNetwork = NETWORK,
    **site: Any,
) -> GroupPlan:
    factory, where = VehicleFactory(network, same_drivers(), DIMENSIONS), replace(signal_site(), **site)
    return plan_groups(network, where, start or start_at(90.0), template_with(*groups), seed, factory, traffic)


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
    template = template_with(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=9, standing=True))
    template = replace(template, demand=replace(template.demand, classes=shares))
    lanes = list(network.lanes)
    for kind, kinds in ((LaneKind.DRIVING, 2), (LaneKind.SHOULDER, 1)):
        lanes[A_RIGHT] = replace(lanes[A_RIGHT], kind=kind)
        roads = replace(network, lanes=tuple(lanes))
        plan = plan_groups(roads, signal_site(), start_at(90.0), template, 0, factory, CONFIG)
        assert len({vehicle.actor_class for vehicle in plan.vehicles}) == kinds, "of a shoulder they cannot drive on"


def test_a_stream_next_to_the_emv_has_no_buses_that_cannot_follow_its_route() -> None:
    """They would have to turn off right behind the site. South the way is tight, straight on it is not."""
    shares = ((ActorClass.SEDAN, 1.0), (ActorClass.BUS, 9.0))
    factory = VehicleFactory(NETWORK, same_drivers(), DIMENSIONS)
    assert [factory.can_follow(kind, (A, B, D)) for kind, _ in shares] == [True, False]
    assert [factory.can_follow(kind, (A, B, C)) for kind, _ in shares] == [True, True]
    straight_on, south = signal_site(), replace(signal_site(), route=(A, B, D))
    for site, placement, buses in (
        (straight_on, Placement.SAME_DIRECTION, True),
        (south, Placement.SAME_DIRECTION, False),
        (south, Placement.ADJACENT_LANE, True),
    ):
        template = template_with(group(placement, GroupAnchor.STOP_LINE, vehicles=4, standing=True))
        template = replace(template, demand=replace(template.demand, classes=shares))
        plan = plan_groups(NETWORK, site, start_at(90.0), template, 0, factory, CONFIG)
        assert plan.vehicles
        assert any(vehicle.actor_class is ActorClass.BUS for vehicle in plan.vehicles) is buses


def test_a_jam_fills_every_lane_and_long_vehicles_stand_in_the_right_one() -> None:
    """Four in each lane of a road, on top of the background; nine of ten would be buses."""
    jam = group(Placement.EVERY_LANE, GroupAnchor.EMV, vehicles=4, standing=True)
    classes = ((ActorClass.SEDAN, 1.0), (ActorClass.BUS, 9.0))
    template = replace(template_with(jam), demand=replace(template_with(jam).demand, classes=classes))
    factory = VehicleFactory(NETWORK, same_drivers(), DIMENSIONS)
    plan = plan_groups(NETWORK, replace(signal_site(), junction=None), start_at(30.0), template, 0, factory, CONFIG)
    right, left = ([one for one in plan.vehicles if one.spot.lane == lane] for lane in (A_RIGHT, A_LEFT))
    assert (len(right), len(left), plan.on_top) == (4, 4, 8)
    assert {one.actor_class for one in left} == {ActorClass.SEDAN}
    assert ActorClass.BUS in {one.actor_class for one in right}
    assert set(plan.heads) == {max(lane, key=lambda one: one.spot.front_m).name for lane in (right, left)}
    short = EmvStart(A_LEFT, 170.0, (A,), (A_LEFT,))
    with pytest.raises(MapError, match="2 would fit"):  # in each lane
        plan_groups(NETWORK, replace(signal_site(), junction=None), short, template_with(jam), 0, factory, CONFIG)


@pytest.mark.parametrize("spacing_m", [1.0, 9.0, 50.0])
def test_who_starts_close_to_the_next_one_keeps_that_headway_and_others_their_own(spacing_m: float) -> None:
    (one,) = planned(replace(platoon(1), spacing_m=spacing_m)).vehicles
    headway_s = (spacing_m - one.driver.driving.min_gap_m) / 8.0
    assert one.driver.tau_s == pytest.approx(min(max(headway_s, LEAST_HEADWAY_S), 1.2))


def test_a_queue_at_the_stop_line() -> None:
    plan = planned(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=4, standing=True))
    expected = [STOP_LINE_M - 7.0 - number * (CAR_M + 5.0) for number in range(4)]
    assert fronts_m(plan.vehicles) == pytest.approx(expected)
    assert {vehicle.spot.lane for vehicle in plan.vehicles} == {B_RIGHT}
    assert {vehicle.spot.speed_mps for vehicle in plan.vehicles} == {0.0}
    assert [vehicle.name for vehicle in plan.vehicles] == ["group0", "group1", "group2", "group3"]
    assert plan.foremost_m == pytest.approx(STOP_LINE_M - 7.0)
    assert (plan.on_top, plan.heads) == (0, ())


def test_a_platoon_ahead_of_the_emv() -> None:
    plan = planned(platoon())
    expected = [90.0 + 12.0 + CAR_M + number * (CAR_M + 5.0) for number in range(3)]
    assert fronts_m(plan.vehicles) == pytest.approx(expected)
    assert {vehicle.spot.lane for vehicle in plan.vehicles} == {A_LEFT}
    assert {vehicle.spot.speed_mps for vehicle in plan.vehicles} == {8.0}
    assert plan.foremost_m == pytest.approx(expected[-1])
    assert all(vehicle.route[0] == "a" for vehicle in plan.vehicles)


def test_who_starts_before_a_bend_can_brake_for_it() -> None:
    """A quarter circle of 12 m, driven at 6 m/s, begins 4.5 m ahead of the foremost, and is full 2 m later."""
    lanes, angle = list(NETWORK.lanes), np.linspace(0.0, np.pi / 2.0, 40)
    (x_m, y_m), straight = lanes[A_LEFT].centre.at(130.0), lanes[A_LEFT].centre.at(np.array([0.0, 130.0]))
    bend = np.stack((x_m + 12.0 * np.sin(angle), y_m - 12.0 + 12.0 * np.cos(angle)), axis=-1)
    centre = Polyline.through(np.concatenate((straight, bend[1:], bend[-1:] - [[0.0, 60.0]])))
    lanes[A_LEFT] = replace(lanes[A_LEFT], centre=centre)
    network = replace(NETWORK, lanes=tuple(lanes))
    factory = VehicleFactory(network, same_drivers(), DIMENSIONS)
    plan = plan_groups(network, signal_site(), start_at(90.0), template_with(platoon()), 0, factory, CONFIG)
    expected_mps = [8.0, 8.0, np.sqrt(36.0 + 2.0 * 1.5 * (4.5 + 2.0))]
    assert [vehicle.spot.speed_mps for vehicle in plan.vehicles] == pytest.approx(expected_mps, rel=0.03)


def test_two_rows_are_filled_in_turn() -> None:
    """All lanes but the EMV's: with the EMV on the site's edge, both of the first road's lanes lead there."""
    both = replace(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, vehicles=2), name="first")
    others = replace(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=2), name="second")
    plan = planned(both, others)
    assert [vehicle.name for vehicle in plan.vehicles] == ["first0", "first1", "second0", "second1"]
    assert fronts_m(plan.vehicles) == pytest.approx([303.0, 293.4, 303.0, 293.4])
    assert [vehicle.spot.lane for vehicle in plan.vehicles] == [B_LEFT, B_LEFT, B_RIGHT, B_RIGHT]


def test_groups_in_one_row_queue_up_behind_each_other() -> None:
    first = replace(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, vehicles=1), name="first")
    second = replace(first, name="second")
    assert fronts_m(planned(first, second).vehicles) == pytest.approx([303.0, 303.0 - CAR_M - 5.0])
    ahead = replace(platoon(1), name="ahead")
    assert fronts_m(planned(ahead, replace(ahead, name="more")).vehicles) == pytest.approx([106.6, 106.6 + 5.0 + CAR_M])


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


def test_the_emv_has_its_clearance() -> None:
    """A queue of its own lane ends 10 m before it: the rear of the last vehicle is at 100 m or more."""
    plan = planned(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, vehicles=25))
    rears = np.array(fronts_m(plan.vehicles)) - CAR_M
    assert 100.0 <= rears.min() < 100.0 + CAR_M + 5.0
    with pytest.raises(MapError, match="0 would fit"):
        planned(group(Placement.EMV_LANE, GroupAnchor.EMV))


def test_a_row_that_is_too_short_for_most_vehicles_is_refused() -> None:
    # From 303 m down to 100 m, every 9.6 m and with the junction's gap, 21 find a place.
    places = len(planned(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, vehicles=30)).vehicles)
    assert places >= 18
    most = int(places / 0.6)
    assert len(planned(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, vehicles=most)).vehicles) == places
    with pytest.raises(MapError, match=f"{most + 2} vehicles in the EMV's lane; {places} would fit"):
        planned(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, vehicles=most + 2))


@pytest.mark.parametrize(("start_m", "fits"), [(255.0, 4), (264.0, 3)])
def test_three_standing_vehicles_are_a_queue(start_m: float, fits: int) -> None:
    queue = group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, vehicles=12, standing=True)
    assert len(planned(queue, start=start_at(start_m)).vehicles) == fits
    with pytest.raises(MapError, match="12 vehicles in the EMV's lane; 2 would fit"):
        planned(queue, start=start_at(275.0))
    with pytest.raises(MapError):
        planned(replace(queue, standing=False), start=start_at(start_m))


def test_an_optional_group_is_left_out_where_it_has_no_road() -> None:
    crowd = group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, vehicles=200)
    with pytest.raises(MapError):
        planned(crowd)
    assert 10 < len(planned(replace(crowd, optional=True)).vehicles) < 100


def test_of_crossing_traffic_and_streams_one_is_enough() -> None:
    crowd = group(Placement.CROSSING, GroupAnchor.STOP_LINE, vehicles=200, standing=True)
    assert 1 < len(planned(crowd).vehicles) < 120
    stream = group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL, vehicles=60)
    fronts = fronts_m(planned(stream).vehicles)
    assert 1 < len(fronts) < 36
    assert max(fronts) < STOP_LINE_M
    nobody = replace(crowd, first_gap_m=1000.0)
    with pytest.raises(MapError, match="200 vehicles on crossing roads; 0 would fit"):
        planned(nobody)
    with pytest.raises(MapError, match="200 vehicles on crossing roads; 0 would fit"):
        planned(crowd, crossing=())
    for sparse in (crowd, stream):
        assert len(planned(replace(sparse, vehicles=2, first_gap_m=7.0, spacing_m=400.0)).vehicles) == 1


def test_crossing_rows_are_the_stage_from_behind_the_last_vehicle_on() -> None:
    plan = planned(group(Placement.CROSSING, GroupAnchor.STOP_LINE, vehicles=2, standing=True))
    assert fronts_m(plan.vehicles) == pytest.approx([293.0, 293.0 - CAR_M - 5.0])
    assert plan.crossing == (CROSSING,)
    assert plan.foremost_m == 0.0
    rear_m = 293.0 - CAR_M - 5.0 - CAR_M
    assert plan.crossing_stage == (
        LaneInterval(NEAR, pytest.approx(rear_m - STAGE_BEHIND_M - 200.0), pytest.approx(100.0)),
    )


@pytest.mark.parametrize(("placement", "keeps"), [(Placement.SAME_DIRECTION, True), (Placement.CROSSING, False)])
def test_drivers_of_a_stream_keep_their_lane(placement: Placement, keeps: bool) -> None:
    stream = replace(group(placement, GroupAnchor.ARRIVAL), vehicles=2)
    for vehicle in planned(stream).vehicles:
        assert (vehicle.driver.speed_gain_eagerness == 0.0) is keeps


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


def test_the_last_one_of_a_stream_comes_in_time_although_nobody_starts_in_a_junction() -> None:
    """The line is at 310 m, and a junction from 200 m to 210 m: where it would start there, it drives faster."""
    stream = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL), vehicles=1, speed_mps=8.0)
    template = replace(template_with(stream), ranges={"demand.group.speed_mps": ValueRange(7.5, 9.0)})
    factory, site = VehicleFactory(NETWORK, same_drivers(), DIMENSIONS), signal_site()
    leads_s, speeds_mps = [], set()
    for start in map(start_at, np.arange(100.0, 180.0, 4.0)):
        (vehicle,) = plan_groups(NETWORK, site, start, template, 0, factory, CONFIG).vehicles
        arrival_s = unhindered_arrival_s(NETWORK, start, template.emv, bound_s_of(site, template))
        leads_s.append(arrival_s - (310.0 - fronts_m([vehicle])[0]) / vehicle.spot.speed_mps)
        speeds_mps.add(round(vehicle.spot.speed_mps, 1))
    assert np.ptp(leads_s) < 0.3, "it starts at whole metres"
    assert len(speeds_mps) > 1
    for placement, low_mps, high_mps in (
        (Placement.SAME_DIRECTION, 7.9, 8.05),
        (Placement.EMV_LANE, 7.5, 7.5),
    ):
        ranges = {"demand.group.speed_mps": ValueRange(low_mps, 8.05)}
        narrow = replace(template_with(replace(stream, placement=placement)), ranges=ranges)
        for start in map(start_at, np.arange(100.0, 180.0, 10.0)):
            (vehicle,) = plan_groups(NETWORK, site, start, narrow, 0, factory, CONFIG).vehicles
            assert low_mps <= vehicle.spot.speed_mps <= high_mps


@pytest.mark.parametrize("limit_mps", [LIMIT_MPS, 6.0])
def test_a_crossing_stream_drives_with_two_seconds_between_its_vehicles(limit_mps: float) -> None:
    lanes = tuple(replace(lane, speed_limit_mps=limit_mps) for lane in NETWORK.lanes)
    free = replace(with_connection(CROSSING, signal_id=None), lanes=lanes)
    vehicles = planned(crossing(4), network=free).vehicles
    pace_mps = min(8.0, limit_mps)
    assert {vehicle.spot.speed_mps for vehicle in vehicles} == {pace_mps}
    assert -np.diff(fronts_m(vehicles)) == pytest.approx([2.0 * pace_mps] * 3)


def test_a_stream_drives_on_where_its_lane_leads() -> None:
    """The right lane leads south alone; behind the site the route is what is left of the EMV's."""
    stream = replace(group(Placement.SAME_DIRECTION, GroupAnchor.EMV), vehicles=2)
    for network, last in ((NETWORK, "c"), (with_connection(STRAIGHT, to_lane=SOUTH, direction="r"), "d")):
        assert {vehicle.route for vehicle in planned(stream, network=network).vehicles} == {("a", "b", last)}
    behind = planned(stream, start=EmvStart(B_LEFT, 90.0, (B, C), (B_LEFT,)), junction=None)
    assert {vehicle.route for vehicle in behind.vehicles} == {("c",)}


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


def test_routes_begin_at_the_lane_and_are_long_enough() -> None:
    """At 16 m/s for 5, 20 and 20 s they would be 720 m: they end where the map ends."""
    plan = planned(platoon())
    assert {vehicle.route for vehicle in plan.vehicles} == {("a", "b", "c")}
    queue = planned(group(Placement.CROSSING, GroupAnchor.STOP_LINE, vehicles=3, standing=True))
    assert {vehicle.route for vehicle in queue.vehicles} == {("n", "d")}
    assert NETWORK.edges[A].edge_id == "a"
    assert route_length_m(template_with()) == pytest.approx(16.0 * (5.0 + 20.0 + 20.0))


WIDTH_M = 3.5


class _Road:
    def __init__(self) -> None:
        self.lanes: list[Lane] = []
        self.edges: list[Edge] = []
        self.connections: list[Connection] = []

    def edge(self, from_m: float, to_m: float, offsets: tuple[int, ...], kind: LaneKind = LaneKind.DRIVING) -> None:
        edge, first = len(self.edges), len(self.lanes)
        for position, offset in enumerate(offsets):
            centre = Polyline.through(np.array([[from_m, WIDTH_M * offset], [to_m, WIDTH_M * offset]]))
            name = f"e{edge}_{position}"
            self.lanes.append(Lane(first + position, name, edge, position, kind, centre, WIDTH_M, 8.3, True, True))
        lanes = tuple(range(first, len(self.lanes)))
        self.edges.append(Edge(edge, f"e{edge}", lanes, f"J{edge}", f"J{edge + 1}", kind is LaneKind.INTERNAL))

    def connect(self, source: int, target: int, via: tuple[int, ...] = ()) -> None:
        junction = f"J{self.lanes[target].edge}"
        self.connections.append(Connection(source, target, via, "s", None, -1, False, junction))

    def site(self, edges: tuple[int, ...], approach_lane: int, movements: tuple[int, ...]) -> Site:
        edge = self.lanes[approach_lane].edge
        where = (edges, edges.index(edge), edge, (edge,), approach_lane)
        return Site(SiteKind.QUEUED_APPROACH, "here", "J", *where, 100.0, movements, (), 1.0)

    def built(self) -> RoadNetwork:
        return RoadNetwork(tuple(self.lanes), tuple(self.edges), tuple(self.connections), {}, (0.0, 0.0), "!")


def rows_of(road: _Road, site: Site, start: EmvStart, group: DemandGroup, arrival_s: float = 8.0) -> list[GroupRow]:
    return group_rows(road.built(), site, start, group, arrival_s, np.random.default_rng(0))


def test_the_second_queue_of_s1_stands_in_one_lane_next_to_the_emvs() -> None:
    road = _Road()
    road.edge(0.0, 200.0, (0, 1, 2, 3))
    road.edge(200.0, 400.0, (0, 1, 2, 3))
    for lane in range(4):
        road.connect(lane, 4 + lane)
    group = next(group for group in load_template("S1").demand.groups if group.name == "queue_right")
    start = EmvStart(3, 50.0, (0, 1), (3,))
    assert [row.chain.lanes[0] for row in rows_of(road, road.site((0, 1), 3, (0, 1, 2, 3)), start, group)] == [2]
    pocket = road.site((0, 1), 2, (0, 1, 2))
    (row,) = rows_of(road, pocket, replace(start, lane=2, lanes_to_site=(2,)), group)
    assert row.chain.lanes[0] == 1, "the lane on the left leads elsewhere"


def fanning_road() -> "_Road":
    """One lane for 100 m, then a junction of 20 m and two lanes up to the site."""
    road = _Road()
    road.edge(0.0, 100.0, (0,))
    road.edge(120.0, 150.0, (0, 1))
    road.edge(150.0, 300.0, (0, 1))
    for source, target in ((0, 1), (0, 2), (1, 3), (2, 4)):
        road.connect(source, target)
    return road


@pytest.mark.parametrize("approach_lane", [1, 2])
@pytest.mark.parametrize("arrival_s", [10.0, 20.0])
def test_a_stream_that_the_emv_comes_up_next_to_starts_where_it_comes_with_the_emv(
    approach_lane: int, arrival_s: float
) -> None:
    road, group = fanning_road(), load_template("S3").demand.groups[0]
    assert (group.placement, group.anchor) == (Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL)
    start = EmvStart(0, 10.0, (0, 1, 2), (0, approach_lane))
    (row,) = rows_of(road, road.site((0, 1, 2), approach_lane, (2, 3)), start, group, arrival_s)
    assert approach_lane not in row.chain.lanes
    line_m = sum(road.lanes[lane].length_m for lane in row.chain.lanes[:2])
    early_m = group.first_gap_m - (0.0 - 8.0)  # its junctions have no paths
    # The lanes fan out at a corner, at which the stream slows down.
    assert row.anchor_m == pytest.approx(line_m - group.speed_mps * arrival_s - early_m, abs=2.5)


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
    early_m = early_m_of(replace(network, connections=ways), where, stream)
    assert stream.first_gap_m - early_m == pytest.approx(gap_m)


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
    assert stays_inside(replace(signal_crossing(), connections=ways), where, stream) == stays


@pytest.mark.parametrize("line_m", [130.0, 140.0, 300.0])
def test_queues_in_lanes_that_grow_out_of_one_lane_keep_their_spacing_in_it(line_m: float) -> None:
    """One lane fans out into two before the line; between 100 and 120 m is its junction."""
    road = _Road()
    road.edge(0.0, 100.0, (0,))
    road.edge(100.0, 120.0, (0,), LaneKind.INTERNAL)
    road.edge(120.0, line_m, (0, 1))
    road.connect(0, 2, (1,))
    road.connect(0, 3, (1,))
    network, start = road.built(), EmvStart(0, 0.0, (0, 2), (0, 2))
    queues = [
        replace(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, 3, standing=True), name="own"),
        replace(group(Placement.ADJACENT_LANE, GroupAnchor.EMV, 3), name="beside", first_gap_m=30.0),
        replace(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE, 3), name="behind", optional=True),
    ]
    factory = VehicleFactory(network, same_drivers(), DIMENSIONS)
    site = road.site((0, 2), 2, ())
    plan = plan_groups(network, site, start, template_with(*queues), 0, factory, CONFIG)
    places = [(vehicle.spot.lane, vehicle.spot.front_m) for vehicle in plan.vehicles]
    assert len(places) >= 7
    for lane in (0, 2, 3):
        fronts = sorted(front for at, front in places if at == lane)
        gaps = np.diff(fronts) - CAR_M
        assert (gaps >= 5.0 - 1e-6).all(), (lane, fronts)


@pytest.mark.parametrize("spacings_m", [(4.0, 11.0), (11.0, 4.0)])
def test_where_rows_share_a_lane_the_longer_spacing_of_two_vehicles_counts(spacings_m: tuple[float, float]) -> None:
    road = _Road()
    road.edge(0.0, 100.0, (0,))
    road.edge(100.0, 120.0, (0,), LaneKind.INTERNAL)
    road.edge(120.0, 123.0, (0, 1))
    road.connect(0, 2, (1,))
    road.connect(0, 3, (1,))
    network, start = road.built(), EmvStart(0, 0.0, (0, 2), (0, 2))
    placements = (Placement.EMV_LANE, Placement.ADJACENT_LANE)
    own, beside = (
        replace(group(placement, GroupAnchor.STOP_LINE, 1), name=placement.value, spacing_m=spacing_m)
        for placement, spacing_m in zip(placements, spacings_m, strict=True)
    )
    factory = VehicleFactory(network, same_drivers(), DIMENSIONS)
    groups = template_with(own, beside)
    first, second = plan_groups(network, road.site((0, 2), 2, ()), start, groups, 0, factory, CONFIG).vehicles
    assert first.spot.lane == second.spot.lane == 0
    gap_m = first.spot.front_m - CAR_M - second.spot.front_m
    assert max(spacings_m) - 1e-6 <= gap_m < max(spacings_m) + 1.0
