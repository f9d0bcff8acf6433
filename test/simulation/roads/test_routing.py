"""Movements across junctions, and routes over them."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import BESIDE, EAST, STRAIGHT, crossing
from hand_made_record import SOUTH as SOUTH_ARM
from hand_made_record import STRAIGHT_LEFT as STRAIGHT_IN_LEFT
from made_crossing import ARMS, CROSSING, made_net
from made_streets import (
    A_LEFT,
    A_RIGHT,
    B_LEFT,
    B_RIGHT,
    C_LEFT,
    C_RIGHT,
    FAR,
    NEAR,
    SOUTH,
    STRAIGHT_LEFT,
    TURN,
    A,
    B,
    C,
    D,
    M,
    N,
    streets,
)

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError
from siren_ros.simulation.roads import routing
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import NO_LANE, JunctionKind, LaneKind
from siren_ros.simulation.roads.routing import (
    comes_from_the_side,
    edges_in_lane,
    is_plain_joint,
    movement_path,
    paths_cross,
    quiet_reach_m,
    road_lane_of,
    same_direction_connections,
)


@pytest.mark.parametrize(
    ("first", "second", "crosses"),
    [
        *[([[0, 0], [2, 2]], [[0, 2], [2, 0]], True), ([[0, 0], [1, 0], [2, 0]], [[1, -1], [1, 1]], True)],
        *[([[0, 0], [2, 0]], [[1, 0.1], [1, 1]], False), ([[0, 0], [2, 0]], [[0, 1], [2, 1]], False)],
        ([[0, 0], [2, 0]], [[3, -1], [3, 1]], False),
    ],
)
def test_paths_cross(first, second, crosses):
    a, b = np.array(first, dtype=float), np.array(second, dtype=float)
    assert paths_cross(a, b) is crosses
    assert paths_cross(b, a) is crosses


def inside(network, connection):
    """The internal lane of a movement."""
    return network.connections[connection].via[0]


def test_a_lane_of_a_plain_joint_belongs_to_the_lane_before_and_one_of_a_junction_to_none():
    network = streets()
    assert [road_lane_of(network, inside(network, joint)) for joint in (0, 1, 6)] == [A_RIGHT, A_LEFT, FAR]
    for movement_at_signal in (STRAIGHT_LEFT, TURN):
        assert road_lane_of(network, inside(network, movement_at_signal)) == NO_LANE
    assert [road_lane_of(network, lane) for lane in (A_RIGHT, B_LEFT, NO_LANE)] == [A_RIGHT, B_LEFT, NO_LANE]


def test_a_plain_joint_has_one_way_on_and_one_way_in_without_control():
    network = streets()
    joint, controlled = network.connections[0], network.connections[STRAIGHT_LEFT]
    assert is_plain_joint(network, joint)
    assert not is_plain_joint(network, controlled)
    for changed in ({"signal_id": "K"}, {"must_stop": True}, {"direction": "r"}):
        other = replace(network, connections=(replace(joint, **changed), *network.connections[1:]))
        assert not is_plain_joint(other, other.connections[0])
    forked = replace(network, connections=(*network.connections, replace(joint, to_lane=NEAR)))
    assert not is_plain_joint(forked, forked.connections[0])
    joined = replace(network, connections=(*network.connections, replace(joint, from_lane=FAR)))
    assert not is_plain_joint(joined, joined.connections[0])


def test_road_before_a_lanes_end_is_counted_over_plain_joints_until_it_is_enough():
    """The lane up to J has 100 m, the joint before it 10 m, the lane before that 200 m."""
    network = streets()
    assert quiet_reach_m(network, B_RIGHT, 1000.0) == pytest.approx(310.0)
    assert quiet_reach_m(network, B_RIGHT, 100.0) == pytest.approx(100.0)
    assert quiet_reach_m(network, B_RIGHT, 100.1) == pytest.approx(310.0)
    assert quiet_reach_m(network, NEAR, 1000.0) == pytest.approx(300.0)
    assert quiet_reach_m(network, A_RIGHT, 1000.0) == pytest.approx(200.0)


def test_from_the_side_comes_who_crosses_the_street_and_neither_who_is_ahead_nor_behind():
    network = crossing()
    straight = network.connections[STRAIGHT]
    others = (STRAIGHT_IN_LEFT, EAST, SOUTH_ARM, BESIDE)
    from_side = [comes_from_the_side(network, straight, network.connections[other]) for other in others]
    assert from_side == [False, True, False, False]
    assert comes_from_the_side(network, network.connections[EAST], straight)


@pytest.mark.parametrize("lane", [B_LEFT, C_LEFT])
def test_a_movement_is_the_civilians_where_both_its_lanes_are(lane):
    roads = streets()
    assert same_direction_connections(roads, roads.connections[STRAIGHT_LEFT]) == (STRAIGHT_LEFT - 1, STRAIGHT_LEFT)
    lanes = tuple(replace(item, civilian_allowed=item.index != lane) for item in roads.lanes)
    closed = replace(roads, lanes=lanes)
    assert same_direction_connections(closed, closed.connections[STRAIGHT_LEFT]) == (STRAIGHT_LEFT - 1,)


def edges(town, names):
    return [town.edge_by_id[name].index for name in names.split()]


def names(town, indices):
    return " ".join(town.lanes[index].lane_id for index in indices)


def test_the_leftmost_of_several_lanes_is_one_for_driving(town):
    (several,) = edges(town, "main_e_1")
    found = [lane for lane in town.edges[several].lanes if routing.is_leftmost_of_several(town, lane)]
    assert names(town, found) == "main_e_1_3"
    assert [lane.position for lane in routing.driving_lanes(town, several)] == [2, 3], "no shoulder and no sidewalk"
    single = [edge for edge in town.edges if len(routing.driving_lanes(town, edge.index)) < 2]
    assert single
    assert not any(routing.is_leftmost_of_several(town, lane) for edge in single for lane in edge.lanes)


def graph_of(lengths_m, *ways):
    """Edges by their lengths, and which of them follow which; no shapes."""
    ahead = [tuple(sorted(b for a, b in ways if a == edge)) for edge in range(len(lengths_m))]
    behind = [tuple(sorted(a for a, b in ways if b == edge)) for edge in range(len(lengths_m))]
    return routing.EdgeGraph(streets(), tuple(ahead), tuple(behind), tuple(lengths_m))


def test_endless_are_the_edges_from_which_a_loop_can_be_reached():
    """0 and 1 are a loop; 2 leads into it; 3 is a dead end, 4 leads there alone, 5 to both."""
    graph = graph_of([1.0] * 7, (0, 1), (1, 0), (2, 0), (1, 3), (4, 3), (5, 4), (5, 0), (6, 4))
    assert graph.endless_edges == {0, 1, 2, 5}
    assert graph_of([1.0] * 3, (0, 1), (1, 2)).endless_edges == frozenset()


NETWORK = streets()


def test_a_path_keeps_its_lane_and_changes_as_soon_as_the_route_needs_it():
    """To the south only the right lane leads; the paths across the junctions are lanes 9 and on."""
    assert routing.route_path(NETWORK, (A, B, C), A_RIGHT) == (A_RIGHT, 9, B_RIGHT, 11, C_RIGHT)
    assert routing.route_path(NETWORK, (A, B, C), A_LEFT) == (A_LEFT, 10, B_LEFT, 12, C_LEFT)
    assert routing.route_path(NETWORK, (A, B, D), A_LEFT) == (A_LEFT, A_RIGHT, 9, B_RIGHT, 13, SOUTH)
    assert routing.route_path(NETWORK, (B, D), B_LEFT) == (B_LEFT, B_RIGHT, 13, SOUTH)
    assert routing.route_path(NETWORK, (A,), A_LEFT) == (A_LEFT,)
    with pytest.raises(InputError):
        routing.route_path(NETWORK, (A, C), A_LEFT)
    with pytest.raises(InputError):
        routing.route_path(NETWORK, (), A_LEFT)
    with pytest.raises(InputError, match="begin at the start lane"):
        routing.route_path(NETWORK, (A,), B_LEFT)


def test_where_a_road_gets_wider_a_path_keeps_its_place_counted_from_the_left():
    """A third lane joins on the right; from the left lane one may go on in any of the three."""
    lanes, edges = list(NETWORK.lanes), list(NETWORK.edges)
    added = replace(lanes[C_RIGHT], index=len(lanes), lane_id="c_new", centre=lanes[C_RIGHT].centre)
    lanes[C_RIGHT], lanes[C_LEFT] = replace(lanes[C_RIGHT], position=1), replace(lanes[C_LEFT], position=2)
    edges[C] = replace(edges[C], lanes=(added.index, C_RIGHT, C_LEFT))
    straight = NETWORK.connections[2]
    ways = [
        replace(straight, from_lane=source, to_lane=target, via=())
        for source in (B_RIGHT, B_LEFT)
        for target in (added.index, C_RIGHT, C_LEFT)
    ]
    network = replace(NETWORK, lanes=(*lanes, added), edges=tuple(edges), connections=tuple(ways))
    assert routing.route_path(network, (B, C), B_LEFT) == (B_LEFT, C_LEFT)
    assert routing.route_path(network, (B, C), B_RIGHT) == (B_RIGHT, C_RIGHT)


@pytest.mark.parametrize("kinds", [(LaneKind.SHOULDER, LaneKind.DRIVING), (LaneKind.DRIVING, LaneKind.SHOULDER)])
def test_a_lane_change_does_not_lead_over_a_shoulder(kinds):
    """A third lane lies to the right of the two; where the one between is a shoulder it cannot be reached."""
    lanes, edges = list(NETWORK.lanes), list(NETWORK.edges)
    lanes[B_RIGHT], lanes[B_LEFT] = replace(lanes[B_RIGHT], kind=kinds[0]), replace(lanes[B_LEFT], kind=kinds[1])
    network = replace(NETWORK, lanes=tuple(lanes), edges=tuple(edges))
    if kinds[1] is LaneKind.DRIVING:
        assert routing.route_path(network, (B, C), B_LEFT) == (B_LEFT, 12, C_LEFT)
        with pytest.raises(InputError):
            routing.route_path(network, (B, D), B_LEFT)
    else:
        assert routing.route_path(network, (B, D), B_RIGHT) == (B_RIGHT, 13, SOUTH)
        assert routing.route_path(network, (B, C), B_LEFT) == (B_LEFT, 12, C_LEFT)


@pytest.mark.parametrize(
    ("first", "second", "start", "end"), [(A_LEFT, A_RIGHT, -1.75, -5.25), (A_RIGHT, A_LEFT, -5.25, -1.75)]
)
def test_a_lane_change_takes_the_middle_half_of_its_edge_along_half_a_cosine(first, second, start, end):
    x, y = routing.path_centre(NETWORK, (first, second)).points.T
    share = np.clip((x + 310.0 - 50.0) / 100.0, 0.0, 1.0)
    assert y == pytest.approx(start + (end - start) * (0.5 - 0.5 * np.cos(np.pi * share)), abs=1e-6)
    assert (x[0], x[-1]) == pytest.approx((-310.0, -110.0))


def test_a_route_is_as_long_as_its_edges_and_the_straight_lines_between_them():
    graph = routing.EdgeGraph.of(NETWORK)
    assert graph.route_length_m((A, B, C)) == pytest.approx(200.0 + 10.0 + 100.0 + 20.0 + 200.0)
    assert graph.route_length_m((M, N, D)) == pytest.approx(190.0 + 10.0 + 100.0 + 30.0 + 100.0)
    assert graph.route_length_m((B,)) == pytest.approx(100.0)
    assert (graph.successors[B], graph.predecessors[D], graph.successors[C]) == ((C, D), (B, N), ())
    turning = replace(NETWORK, connections=(replace(NETWORK.connections[4], direction="t"),))
    assert routing.EdgeGraph.of(turning).successors[B] == (), "nobody turns round"


@pytest.mark.parametrize("options", [(), ("--lefthand",)])
def test_nobody_turns_round_at_the_dead_ends_of_a_net(tmp_path, options):
    """SUMO has another letter for turnarounds in nets with left-hand traffic."""
    net = parse_road_network(made_net(tmp_path, CROSSING, ARMS, "--no-turnarounds", "false", *options))
    graph = routing.EdgeGraph.of(net)
    for arm in "nesw":
        into, out = (net.edge_by_id[name].index for name in (f"{arm}_c", f"c_{arm}"))
        assert net.connections_from[net.edges[out].lanes[-1]], "SUMO's net leads back"
        assert graph.successors[out] == ()
        assert len(graph.successors[into]) == 3


def test_the_edges_of_a_lane_follow_a_way_as_far_as_the_lane_leads_along_it():
    """From the south the left lane leads north only, the right one also east; behind both the map ends."""
    network = crossing()
    left, right = (network.lane_by_id[name].index for name in ("s_in_2", "s_in_1"))
    north, east = (network.edge_by_id[name].index for name in ("n_out", "e_out"))
    assert edges_in_lane(network, right, (east, north), 50.0) == (east,)
    assert edges_in_lane(network, left, (east,), 50.0) == (north,), "it does not lead there"
    assert edges_in_lane(network, right, (), 150.0) == (north,), "straight on, as far as the road goes"
    assert edges_in_lane(network, left, (north,), 0.0) == ()
    back = replace(network.connections_from[left][0], from_lane=network.edges[north].lanes[-1], to_lane=left)
    ring = replace(network, connections=(*network.connections, back))
    assert edges_in_lane(ring, left, (), 1000.0) == (north, network.lanes[left].edge), "round once"


def wide_road(*kinds, limit_mps=30.0, civilian=True):
    """The streets, with these kinds of lanes from the right on B, the first 3.5 m wide and each next one 0.5 m more."""
    lanes, edges = list(NETWORK.lanes), list(NETWORK.edges)
    own = [B_RIGHT, B_LEFT, *range(len(lanes), len(lanes) + len(kinds) - 2)]
    for place, (index, kind) in enumerate(zip(own, kinds, strict=True)):
        lane = replace(NETWORK.lanes[B_LEFT], index=index, position=place, kind=kind, width_m=3.5 + 0.5 * place)
        lanes[index : index + 1] = [replace(lane, speed_limit_mps=limit_mps, civilian_allowed=civilian)]
    edges[B] = replace(edges[B], lanes=tuple(own))
    return replace(NETWORK, lanes=tuple(lanes), edges=tuple(edges)), own


def test_the_rescue_lane_is_between_the_leftmost_lane_and_the_one_on_its_right():
    """A shoulder of 3.5 m, then lanes of 4, 4.5 and 5 m; none in town, with one lane, or without civilians."""
    kinds = (LaneKind.SHOULDER, *[LaneKind.DRIVING] * 3)
    network, own = wide_road(*kinds)
    sides = routing.rescue_sides(network)
    assert sides[own].tolist() == [0, -1, -1, 1]
    assert [sides[network.connections[way].via[0]] for way in (2, 3, 0)] == [0, -1, 0]
    offsets_m = [routing.rescue_boundary_m(network, lane) for lane in own]
    assert offsets_m == pytest.approx([0.0, 2.0 + 4.5, 2.25, -2.5])
    assert routing.is_out_of_town(network, B)
    single, (_, lane) = wide_road(*kinds[:2])
    assert routing.rescue_boundary_m(single, lane) == 0.0
    for other in (single, wide_road(*kinds, limit_mps=17.0)[0], wide_road(*kinds, civilian=False)[0]):
        assert not routing.is_out_of_town(other, B)
        assert not routing.rescue_sides(other).any()


@pytest.mark.parametrize("lanes", [1, 2])
def test_roads_of_opposite_directions_touch_with_their_leftmost_lanes(lanes):
    """The way back of B lies next to it, or 5 m farther to the left."""
    for apart_m, expected in ((0.0, {B: 6, 6: B}), (5.0, {})):
        near, far = (np.array([(0.0, y_m), (-100.0, y_m)]) for y_m in (1.75 + apart_m, 5.25 + apart_m))
        left = replace(NETWORK.lanes[B_LEFT], index=len(NETWORK.lanes), edge=6, centre=Polyline.through(near))
        right = replace(left, index=left.index + 1, centre=Polyline.through(far))
        own = (right.index, left.index)[2 - lanes :]
        back = replace(NETWORK.edges[B], index=6, lanes=own, from_junction="J", to_junction="K")
        there = [
            replace(edge, from_junction="K", to_junction="J") if edge.index == B else edge for edge in NETWORK.edges
        ]
        others = [edge for edge in there if not edge.internal]
        network = replace(NETWORK, lanes=(*NETWORK.lanes, left, right), edges=(*others, back))
        assert routing.opposite_edges(network) == expected


def test_the_right_of_way_of_a_side_street():
    """Without ranks of roads for the one from the right; with ranks for those that do not give way."""
    network = crossing()
    north, east = network.connections[STRAIGHT], network.connections[EAST]
    oncoming = network.connections[SOUTH_ARM]
    node = network.junctions[north.junction]
    without, ranked = (
        replace(network, junctions={**network.junctions, north.junction: replace(node, kind=kind)})
        for kind in (JunctionKind.UNCONTROLLED, JunctionKind.PRIORITY)
    )
    first = [routing.has_right_of_way(without, *pair) for pair in ((north, east), (east, north), (north, oncoming))]
    assert sorted(first[:2]) == [False, True], "one is on the right of the other"
    assert not first[2]
    headings = [network.lanes[way.from_lane].centre.heading_rad(0.0) for way in (north, east)]
    assert first[0] == (np.sin(headings[1] - headings[0]) > 0.0)
    for pair in ((north, east), (east, north)):
        assert routing.has_right_of_way(ranked, *pair)
        assert not routing.has_right_of_way(ranked, pair[0], replace(pair[1], gives_way=True))
    assert not routing.has_right_of_way(ranked, north, oncoming)


def test_a_ring_of_road_is_counted_once_and_a_joint_is_straight_on():
    joint = NETWORK.connections[0]
    ring = replace(NETWORK, connections=(replace(joint, from_lane=B_RIGHT),))
    assert quiet_reach_m(ring, B_RIGHT, 1000.0) == pytest.approx(100.0)
    direct = replace(joint, via=())
    assert movement_path(NETWORK, direct).points == pytest.approx(np.array([(-110.0, -5.25), (-100.0, -5.25)]))
    touching = movement_path(NETWORK, replace(direct, to_lane=joint.via[0]))
    assert touching.points == pytest.approx(np.array([(-110.01, -5.25), (-110.0, -5.25)]))
    halves = replace(NETWORK.connections[2], via=(11, C_RIGHT))
    assert movement_path(NETWORK, halves).length_m == pytest.approx(220.0)
