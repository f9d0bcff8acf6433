"""The rows of a template's groups on two streets that cross."""

from dataclasses import replace

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
    A,
    B,
    C,
    D,
    M,
    N,
    group,
    signal_site,
    start_at,
    streets,
)

from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import LaneKind, RoadNetwork
from siren_ros.scenario.scenario import DemandGroup, GroupAnchor, Placement
from siren_ros.traffic.demand.emv_start import EmvStart, _lane_before
from siren_ros.traffic.demand.group_rows import GroupRow, _approach_row, _connection_from, group_rows

NETWORK = streets()


def rows(
    wanted: DemandGroup, start: EmvStart | None = None, arrival_s: float = 12.0, network: RoadNetwork = NETWORK
) -> list[GroupRow]:
    return group_rows(network, signal_site(), start or start_at(90.0), wanted, arrival_s, np.random.default_rng(0))


def test_a_queue_grows_backwards_from_the_stop_line() -> None:
    (own,) = rows(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE))
    assert [lane for lane in own.chain.lanes if lane < 9] == [A_LEFT, B_LEFT, C_LEFT]
    assert own.edges == (A, B, C)
    assert own.anchor_m == pytest.approx(STOP_LINE_M)
    assert not own.forwards
    # In the EMV's own lane nobody is put behind it: its front is 90 m after the beginning of the row.
    assert own.least_m == pytest.approx(90.0)
    assert own.chain.end_m == pytest.approx(530.0)
    (next_to,) = rows(group(Placement.ADJACENT_LANE, GroupAnchor.STOP_LINE))
    assert [lane for lane in next_to.chain.lanes if lane < 9] == [A_RIGHT, B_RIGHT, C_RIGHT]
    assert (next_to.anchor_m, next_to.least_m) == (pytest.approx(STOP_LINE_M), 0.0)


def shoulder_rows(wanted: DemandGroup, start: EmvStart, signal_before: bool, from_m: float = 0.0) -> list[GroupRow]:
    """The right lane of the approach is a shoulder; the junction K before it is a joint, or has a signal.

    The approach may be cut off at its beginning.
    """
    lanes = list(NETWORK.lanes)
    lanes[B_RIGHT] = replace(lanes[B_RIGHT], kind=LaneKind.SHOULDER, civilian_allowed=False)
    lanes[B_LEFT] = replace(lanes[B_LEFT], centre=lanes[B_LEFT].centre.cut(from_m, 100.0))
    connections = list(NETWORK.connections)
    (into,) = (index for index, one in enumerate(connections) if one.to_lane == B_LEFT)
    if signal_before:
        connections[into] = replace(connections[into], signal_id="K", signal_link=0)
    network = replace(NETWORK, lanes=tuple(lanes), connections=tuple(connections))
    site = replace(signal_site(), approach_lane=B_RIGHT)
    return group_rows(network, site, start, wanted, 12.0, np.random.default_rng(0))


def test_a_queue_next_to_a_shoulder_leaves_the_way_onto_it() -> None:
    """40 m before it: from the junction K at 210 m on, or from the EMV's start on."""
    queue = group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, standing=True)
    for start_m, signal_before, least_m in ((90.0, True, 250.0), (90.0, False, 130.0), (190.0, True, 250.0)):
        (row,) = shoulder_rows(queue, start_at(start_m), signal_before)
        assert row.least_m == pytest.approx(least_m)
    (late,) = shoulder_rows(queue, EmvStart(B_LEFT, 30.0, (B, C), (B_LEFT,)), signal_before=True)
    assert late.least_m == pytest.approx(70.0)


def test_a_queue_next_to_a_shoulder_has_50_m_at_least() -> None:
    queue = group(Placement.EMV_LANE, GroupAnchor.STOP_LINE, standing=True)
    (row,) = shoulder_rows(queue, start_at(90.0), signal_before=True, from_m=40.0)
    assert row.anchor_m - row.least_m == pytest.approx(50.0)


def test_a_row_begins_on_the_edge_of_the_emvs_start() -> None:
    start = EmvStart(B_LEFT, 30.0, (B, C), (B_LEFT,))
    (own,) = rows(group(Placement.EMV_LANE, GroupAnchor.STOP_LINE), start)
    assert [lane for lane in own.chain.lanes if lane < 9] == [B_LEFT, C_LEFT]
    assert (own.edges, own.anchor_m, own.least_m) == ((B, C), pytest.approx(100.0), pytest.approx(30.0))


def test_ahead_of_the_emv_the_row_grows_forwards() -> None:
    (own,) = rows(group(Placement.EMV_LANE, GroupAnchor.EMV))
    assert own.forwards
    assert own.anchor_m == pytest.approx(90.0)
    (next_to,) = rows(group(Placement.OTHER_LANES, GroupAnchor.EMV))
    assert next_to.chain.lanes[0] == A_RIGHT
    assert next_to.anchor_m == pytest.approx(90.0)


def test_a_stream_comes_to_the_stop_line_together_with_the_emv() -> None:
    """At 8 m/s a stream follows at 7.44 m/s: within 12 s it comes 89.3 m far."""
    (stream,) = rows(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL))
    assert stream.chain.lanes[0] == A_RIGHT
    assert stream.forwards
    assert STOP_LINE_M - stream.anchor_m == pytest.approx(0.93 * 8.0 * 12.0, abs=1.0)
    assert stream.most_m == pytest.approx(STOP_LINE_M)
    (early,) = rows(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL), arrival_s=100.0)
    assert early.anchor_m == pytest.approx(STOP_LINE_M - 800.0), "from before the row's beginning"


def test_a_stream_that_the_emv_follows_keeps_its_distance_from_the_start_on() -> None:
    (own,) = rows(group(Placement.EMV_LANE, GroupAnchor.ARRIVAL))
    assert own.anchor_m == pytest.approx(90.0 - 6.0)
    assert own.most_m == pytest.approx(STOP_LINE_M)


def test_a_bend_on_the_way_brings_the_stream_nearer() -> None:
    """A quarter circle of 12 m before the stop line is driven at 6 m/s: that costs time, and so way."""
    angle = np.linspace(0.0, np.pi / 2.0, 40)
    bend = np.stack((-18.85 + 12.0 * np.sin(angle), -5.25 - 12.0 + 12.0 * np.cos(angle)), axis=-1)
    lanes = list(NETWORK.lanes)
    straight = Polyline.through([(-100.0, -5.25), (-18.85, -5.25)])
    lanes[B_RIGHT] = replace(lanes[B_RIGHT], centre=Polyline.through(np.concatenate((straight.points, bend))))
    bent = replace(NETWORK, lanes=tuple(lanes))
    fast = replace(group(Placement.SAME_DIRECTION, GroupAnchor.ARRIVAL), speed_mps=12.0)
    (row,) = rows(fast, network=bent)
    (flat,) = rows(fast)
    assert flat.most_m - flat.anchor_m == pytest.approx(0.93 * 12.0 * 12.0, abs=1.0)
    way_m = row.most_m - row.anchor_m
    # 18.85 m at 6 m/s, and before it braking from 11.16 m/s with 1.5 m/s²: (11.16² − 6²) / 3 = 29.5 m in 3.44 s.
    expected_m = 18.85 + 29.5 + (12.0 - 18.85 / 6.0 - 3.44) * 0.93 * 12.0
    assert way_m == pytest.approx(expected_m, abs=3.0)


def test_crossing_rows_reach_back_over_plain_junctions() -> None:
    (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE))
    assert [lane for lane in row.chain.lanes if lane < 9] == [FAR, NEAR]
    assert row.anchor_m == pytest.approx(190.0 + 10.0 + 100.0)
    assert row.edges == (M, N, D)
    assert (row.forwards, row.movement) == (False, CROSSING)


def with_connection(number: int, **changed: object) -> RoadNetwork:
    connections = list(NETWORK.connections)
    connections[number] = replace(connections[number], **changed)  # type: ignore[arg-type] # fields by name
    return replace(NETWORK, connections=tuple(connections))


@pytest.mark.parametrize("changed", [{"signal_id": "L"}, {"must_stop": True}, {"direction": "r"}])
def test_crossing_rows_end_at_signals_stop_signs_and_turns(changed: dict[str, object]) -> None:
    (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=with_connection(6, **changed))
    assert row.chain.lanes == (NEAR,)
    assert row.edges == (N, D)


def test_long_side_roads_are_enough_by_themselves() -> None:
    lanes = list(NETWORK.lanes)
    lanes[NEAR] = replace(lanes[NEAR], centre=Polyline.through([(10.0, 140.0), (10.0, 10.0)]))
    (row,) = rows(group(Placement.CROSSING, GroupAnchor.STOP_LINE), network=replace(NETWORK, lanes=tuple(lanes)))
    assert row.chain.lanes == (NEAR,)


def test_standing_neighbours_leave_the_emvs_lane_free() -> None:
    """With one lane in its direction an optional group is left out: the EMV could not pass."""
    (row,) = rows(group(Placement.SAME_DIRECTION, GroupAnchor.STOP_LINE, standing=True, optional=True))
    assert row.chain.lanes[0] == A_RIGHT
    alone = replace(signal_site(), connections=(3,))

    def of(anchor: GroupAnchor, optional: bool) -> list[int]:
        wanted = group(Placement.SAME_DIRECTION, anchor, optional=optional)
        found = group_rows(NETWORK, alone, start_at(90.0), wanted, 12.0, np.random.default_rng(0))
        return [row.chain.lanes[0] for row in found]

    for anchor in GroupAnchor:
        assert of(anchor, optional=True) == []
    assert of(GroupAnchor.ARRIVAL, optional=False) == [A_LEFT]


def test_traffic_next_to_the_emv_starts_on_the_first_third_of_its_way() -> None:
    (row,) = rows(group(Placement.SAME_DIRECTION, GroupAnchor.EMV))
    assert row.chain.lanes[0] == A_RIGHT
    assert (row.anchor_m, row.forwards) == (pytest.approx(90.0), True)
    assert row.most_m == pytest.approx(90.0 + (STOP_LINE_M - 90.0) / 3.0)
    (ahead,) = rows(group(Placement.EMV_LANE, GroupAnchor.EMV))
    assert ahead.most_m == np.inf


def test_standing_rows_do_not_lie_on_the_emvs_way() -> None:
    """The EMV starts in the right lane; the row next to its approach lane begins there, too."""
    joined = with_connection(0, to_lane=B_LEFT)
    start = EmvStart(A_RIGHT, 90.0, (A, B, C), (A_RIGHT, 9, B_LEFT))
    wanted = replace(group(Placement.OTHER_LANES, GroupAnchor.STOP_LINE, standing=True))
    (kept,) = rows(wanted, start, network=joined)
    assert kept.chain.lanes[0] == B_RIGHT, "no lane leads to it"
    lane_of_all = replace(joined, connections=(*joined.connections, replace(NETWORK.connections[0])))
    assert rows(wanted, start, network=lane_of_all) == []
    assert rows(replace(wanted, standing=False), start, network=lane_of_all) != []


def test_on_a_road_without_junction_rows_begin_at_the_emvs_front() -> None:
    road = replace(signal_site(), junction=None)
    found = group_rows(
        NETWORK,
        road,
        start_at(90.0),
        group(Placement.ADJACENT_LANE, GroupAnchor.EMV),
        12.0,
        np.random.default_rng(0),
    )
    (row,) = found
    assert row.chain.lanes[0] == A_RIGHT
    assert (row.anchor_m, row.forwards, row.edges) == (pytest.approx(90.0), True, (A, B, C))


def test_of_two_adjacent_lanes_the_left_one_is_taken() -> None:
    """Three lanes, the EMV in the middle."""
    lanes, edges = list(NETWORK.lanes), list(NETWORK.edges)
    third = replace(lanes[A_LEFT], index=len(lanes), lane_id="a_2", position=2)
    edges[A] = replace(edges[A], lanes=(*edges[A].lanes, third.index))
    wide = replace(NETWORK, lanes=(*lanes, third), edges=tuple(edges))
    road = replace(signal_site(), junction=None)
    wanted = group(Placement.ADJACENT_LANE, GroupAnchor.EMV)
    (row,) = group_rows(wide, road, start_at(90.0), wanted, 12.0, np.random.default_rng(0))
    assert row.chain.lanes[0] == third.index
    others = group(Placement.OTHER_LANES, GroupAnchor.EMV)
    found = group_rows(wide, road, start_at(90.0), others, 12.0, np.random.default_rng(0))
    assert [one.chain.lanes[0] for one in found] == [A_RIGHT, third.index]


@pytest.mark.parametrize(("lane", "first"), [(C_LEFT, A_LEFT), (C_RIGHT, A_RIGHT)])
def test_a_row_before_the_site_reaches_back_over_several_edges(lane: int, first: int) -> None:
    """200 m, 10 m, 100 m, 20 m and 200 m: all of them lead to the end of the last edge."""
    roads = streets()
    start = EmvStart(A_LEFT, 30.0, (A, B, C), (A_LEFT,))
    row = _approach_row(roads, replace(signal_site(), site_edge=C), start, roads.lanes[lane])
    assert row.chain.lanes[0] == first
    assert row.chain.lanes[-1] == lane
    assert row.anchor_m == pytest.approx(530.0)
    assert row.edges == (A, B, C)


def test_without_a_lane_that_leads_there_the_leftmost_one_is_before() -> None:
    roads = streets()
    assert _lane_before(roads, roads.lanes[C_RIGHT], A) == (roads.lanes[A_LEFT], ())
    lane, via = _lane_before(roads, roads.lanes[C_RIGHT], B)
    assert lane.index == B_RIGHT
    assert len(via) == 1


def test_of_two_lanes_that_lead_into_one_the_leftmost_is_before() -> None:
    roads = streets()
    merging = replace(roads.connections[0], to_lane=B_LEFT)
    for connections in ((*roads.connections, merging), (merging, *roads.connections)):
        network = replace(roads, connections=connections)
        assert {one.from_lane for one in network.connections_to[B_LEFT]} == {A_LEFT, A_RIGHT}
        found = _connection_from(network, B_LEFT, A)
        assert found is not None
        assert found.from_lane == A_LEFT
        assert _lane_before(network, network.lanes[B_LEFT], A)[0].index == A_LEFT
