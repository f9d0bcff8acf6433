"""The rows of a template's groups on a road of three lanes, and on two streets that cross at a signal."""

import math
from dataclasses import replace
from itertools import pairwise, product
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
    CROSSING,
    FAR,
    NEAR,
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
    Road,
    crossing,
    group,
    signal_site,
    start_at,
    streets,
    with_connection,
)

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.scenario.scenario import DemandGroup, GroupAnchor, Placement
from siren_ros.simulation.traffic.demand.emv_start import EmvStart, lane_before
from siren_ros.simulation.traffic.demand.group_demand import before_bends_mps
from siren_ros.simulation.traffic.demand.group_rows import GroupRow, connection_from, group_rows
from siren_ros.simulation.traffic.demand.plan import chain_of

NETWORK: Final = streets()
LANES_OF: Final = {
    Placement.EMV_LANE: ([1], [1], [1]),
    Placement.ADJACENT_LANE: ([0], [2], [2]),
    Placement.OTHER_LANES: ([0, 2], [0, 2], [0, 2]),
    Placement.TURNING_LANES: ([2], [0, 2], [0, 2]),
    Placement.SAME_DIRECTION: ([0], [1], [1]),
    Placement.EVERY_LANE: ([0, 1, 2], [0, 1, 2], [0, 1, 2]),
}
"""First lanes of the rows: where the right lane leads on as the EMV's middle one does, where none does, and behind the
site."""


def rounded(row: GroupRow) -> GroupRow:
    places_m = (round(float(place_m), 6) for place_m in (row.anchor_m, row.least_m, row.most_m))
    return replace(row, **dict(zip(("anchor_m", "least_m", "most_m"), places_m, strict=True)))


def anchored(row: GroupRow, group: DemandGroup, line_m: float, *, follows: bool) -> GroupRow:
    """A row that is counted from the EMV's place, as its group asks; the EMV follows it in its lane."""
    emv_m = row.anchor_m
    row = replace(row, least_m=emv_m if follows else 0.0)
    if group.anchor is GroupAnchor.STOP_LINE:
        return replace(row, anchor_m=line_m, forwards=False)
    if group.anchor is GroupAnchor.ARRIVAL:
        early_m = 0.0 if group.optional else 28.0
        return replace(row, anchor_m=emv_m - 6.0 if follows else line_m - 96.0 - early_m, most_m=line_m)
    most_m = emv_m + (line_m - emv_m) / 3.0 if group.placement is Placement.SAME_DIRECTION else math.inf
    return replace(row, most_m=most_m)


@pytest.mark.parametrize("edge", [0, 1, 2])
@pytest.mark.parametrize(("straight_on", "case"), [((3, 4), 0), ((4,), 1)])
def test_the_rows_of_each_placement_begin_on_the_edge_of_the_emv(
    edge: int, straight_on: tuple[int, ...], case: int
) -> None:
    """200 m, 100 m up to the line and 200 m of road; the EMV drives in the middle of three lanes.

    A stream of 8 m/s comes 96 m far in 12 s. It starts 28 m nearer to the line than it would by its gap of 20 m, as
    its last car has to be 8 m inside; an optional one, or one that the EMV follows, does not.
    """
    road, start_m = Road(), (90.0, 30.0, 30.0)[edge]
    for from_m, to_m in ((0.0, 200.0), (200.0, 300.0), (300.0, 500.0)):
        road.edge(from_m, to_m, (0, 1, 2))
    for lane in range(6):
        road.connect(lane, lane + 3)
    network, line_m = road.built(), (300.0, 100.0, math.nan)[edge]
    start = EmvStart(3 * edge + 1, start_m, (0, 1, 2)[edge:], ((1, 4), (4,), (7,))[edge])
    for placement, anchor, kind in product(LANES_OF, GroupAnchor, ("", "standing", "optional")):
        asked = group(placement, anchor, 3, kind == "standing", kind == "optional")
        asked, expected = replace(asked, first_gap_m=20.0), []
        for lane in LANES_OF[placement][2 if edge == 2 else case]:
            row = GroupRow(chain_of(network, range(3 * edge + lane, 9, 3)), start.route, start_m, forwards=True)
            free = lane != 1 or kind == "" or (kind == "standing" and placement is Placement.EMV_LANE)
            if edge == 2:
                expected.append(row)
            elif free:  # else the EMV could not pass
                expected.append(rounded(anchored(row, asked, line_m, follows=lane == 1)))
        site = road.site((0, 1, 2), 4, straight_on)
        found = group_rows(network, site, start, asked, 12.0, np.random.default_rng(0))
        assert list(map(rounded, found)) == expected, (placement, anchor, kind)
        if edge < 2:
            road_site = replace(site, junction=None)
            found = group_rows(network, road_site, start, asked, 12.0, np.random.default_rng(0))
            assert {(row.anchor_m, row.forwards, row.most_m) for row in found} == {(start_m, True, math.inf)}


def rows(
    group: DemandGroup,
    start: EmvStart | None = None,
    arrival_s: float = 12.0,
    network: RoadNetwork = NETWORK,
    seed: int = 0,
    **site: Any,
) -> list[GroupRow]:
    where, rng = replace(signal_site(), **site), np.random.default_rng(seed)
    return group_rows(network, where, start or start_at(90.0), group, arrival_s, rng)


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


@pytest.mark.parametrize(("signal", "least_m"), [(None, 200.0), ("K", 240.0)])
def test_who_turns_on_the_other_side_of_the_emv_waits_behind_the_branch_and_behind_that_way(
    signal: str | None, least_m: float
) -> None:
    """One lane for 200 m, then three for 100 m: the shoulder, the EMV's lane and that of those who turn left."""
    road = Road()
    road.edge(0.0, 200.0, (1,))
    road.edge(200.0, 300.0, (0, 1, 2))
    road.lanes[1] = replace(road.lanes[1], kind=LaneKind.SHOULDER)
    road.connect(0, 2)
    road.connect(0, 3)
    road.connections[1] = replace(road.connections[1], signal_id=signal)
    start, turning = EmvStart(0, 90.0, (0, 1), (0, 2)), group(Placement.TURNING_LANES, GroupAnchor.STOP_LINE)
    (row,) = group_rows(road.built(), road.site((0, 1), 1, ()), start, turning, 9.0, np.random.default_rng(0))
    assert (row.chain.lanes, row.least_m) == ((0, 3), pytest.approx(least_m))


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
    apart = replace(NETWORK, connections=(NETWORK.connections[0], *NETWORK.connections[2:]))
    (row,) = rows(replace(group(Placement.EMV_LANE, GroupAnchor.ARRIVAL), first_gap_m=10.0), network=apart)
    assert (row.chain.lanes[0], row.anchor_m) == (B_LEFT, pytest.approx(100.0 - 96.0)), "no lane leads to the EMV's"


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
    for ways in ((CROSSING, chosen), (chosen, CROSSING)):
        (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=network, crossing=ways)
        assert (row.movement, row.edges) == (chosen, (M, N, C))
    added = replace(network, connections=(*network.connections, replace(network.connections[CROSSING])))
    drawn = {
        rows(crossing(9), network=added, seed=seed, crossing=(CROSSING, chosen + 2))[0].movement for seed in range(9)
    }
    assert drawn == {CROSSING, chosen + 2}, "of two that are alike, by chance"


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
    forked, further = with_connection(STRAIGHT, from_lane=B_LEFT), {"site_edge": C, "site_position": 2}
    changes = replace(start, lanes_to_site=(A_RIGHT, B_LEFT, C_LEFT))
    assert rows(queue, changes, network=forked, approach_lane=C_LEFT, **further) == [], "from another lane of its way"


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
