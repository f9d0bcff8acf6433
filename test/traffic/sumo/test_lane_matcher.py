import numpy as np
import pytest
from hand_made_record import LEFT_X_M, RIGHT_X_M, crossing
from hypothesis import given, settings
from hypothesis import strategies as st
from traffic_helpers import load_map

from siren_ros.roads.road_network import NO_LANE, LaneKind
from siren_ros.traffic.sumo.lane_matcher import LaneMatcher

NETWORK = load_map(None)[1]
WAYS = [
    (connection, network_lane)
    for connection in NETWORK.connections
    if (network_lane := NETWORK.lanes[connection.from_lane]).kind is LaneKind.DRIVING and connection.via
]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, len(WAYS) - 1), st.floats(0.05, 0.95), st.floats(-1.0, 1.0))
def test_points_on_a_lane_are_matched_to_it_at_their_place(number: int, share: float, left: float) -> None:
    connection, lane = WAYS[number]
    edges = (lane.edge, NETWORK.lanes[connection.to_lane].edge)
    matcher = LaneMatcher(NETWORK)
    arc = share * lane.length_m
    x, y = lane.centre.offset_points(arc, left)
    match = matcher.match(edges, (float(x), float(y)), float(lane.centre.heading_rad(arc)), lane.index)
    assert match.lane == lane.index
    assert match.position_m == pytest.approx(arc, abs=1.0)
    assert match.lateral_m == pytest.approx(left, abs=0.2)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, len(WAYS) - 1), st.floats(0.1, 0.9))
def test_paths_across_junctions_are_those_of_the_route(number: int, share: float) -> None:
    connection, lane = WAYS[number]
    target = NETWORK.lanes[connection.to_lane].edge
    via = NETWORK.lanes[connection.via[0]]
    arc = share * via.length_m
    x, y = via.centre.at(arc)
    match = LaneMatcher(NETWORK).match(
        (lane.edge, target), (float(x), float(y)), float(via.centre.heading_rad(arc)), via.index
    )
    paths = [one for one in NETWORK.connections if NETWORK.lanes[one.to_lane].edge == target]
    assert match.lane in {index for one in paths for index in one.via} | set(NETWORK.edges[target].lanes)
    assert abs(match.lateral_m) < 1.0


def test_far_beside_the_road_or_against_it_there_is_no_lane() -> None:
    _, lane = WAYS[0]
    matcher = LaneMatcher(NETWORK)
    x, y = lane.centre.at(lane.length_m / 2.0)
    heading = float(lane.centre.heading_rad(lane.length_m / 2.0))
    assert matcher.match((lane.edge,), (float(x) + 500.0, float(y)), heading, NO_LANE).lane == NO_LANE
    assert matcher.match((lane.edge,), (float(x), float(y)), heading + np.pi, NO_LANE).lane == NO_LANE


def test_beside_the_paths_a_junction_is_road_still() -> None:
    connection, lane = next((way, source) for way, source in WAYS if way.direction == "r")
    via = NETWORK.lanes[connection.via[0]]
    x, y = via.centre.offset_points(via.length_m / 2.0, 3.5)
    heading = float(via.centre.heading_rad(via.length_m / 2.0))
    edges = (lane.edge, NETWORK.lanes[connection.to_lane].edge)
    assert LaneMatcher(NETWORK).match(edges, (float(x), float(y)), heading, via.index).lane in connection.via
    lost = LaneMatcher(NETWORK, junction_sideways_m=0.5).match(edges, (float(x), float(y)), heading, via.index)
    assert lost.lane not in connection.via


CROSSING = crossing()
S_IN = next(edge for edge in CROSSING.edges if edge.edge_id == "s_in")
SHOULDER, RIGHT, LEFT = S_IN.lanes
LINE_X_M = (LEFT_X_M + RIGHT_X_M) / 2.0


@pytest.mark.parametrize(
    ("past_the_line_m", "present", "found"),
    [
        (0.03, RIGHT, RIGHT),
        (0.07, RIGHT, LEFT),
        (0.03, LEFT, LEFT),
        (-0.03, LEFT, LEFT),
        (-0.07, LEFT, RIGHT),
        (-0.03, RIGHT, RIGHT),
        (0.03, NO_LANE, LEFT),
        (-0.03, NO_LANE, RIGHT),
        (0.03, SHOULDER, LEFT),
        (-0.03, SHOULDER, RIGHT),
    ],
)
def test_a_vehicle_stays_in_its_lane_until_the_neighbour_is_nearer_by_a_margin(
    past_the_line_m: float, present: int, found: int
) -> None:
    """At d past the line between two equal lanes the neighbour is nearer by 2 d; the margin is 0.1 m."""
    match = LaneMatcher(CROSSING, stay_m=0.1).match(
        (S_IN.index,), (LINE_X_M - past_the_line_m, -70.0), np.pi / 2, present
    )
    assert match.lane == found
    centre_x_m = {RIGHT: RIGHT_X_M, LEFT: LEFT_X_M}[found]
    assert match.lateral_m == pytest.approx(centre_x_m - (LINE_X_M - past_the_line_m))
    assert match.position_m == pytest.approx(50.0)


def test_lanes_of_another_edge_need_no_margin() -> None:
    """Just beyond the stop line the path is nearest, and the lane that ended is left at once."""
    n_out = next(edge for edge in CROSSING.edges if edge.edge_id == "n_out")
    matcher = LaneMatcher(CROSSING, stay_m=5.0)
    front = (RIGHT_X_M, -19.5)
    match = matcher.match((S_IN.index, n_out.index), front, np.pi / 2, RIGHT)
    assert CROSSING.lanes[match.lane].kind is LaneKind.INTERNAL
    assert match.lateral_m == pytest.approx(0.0)


@pytest.mark.parametrize(("outside_m", "found"), [(1.19, True), (1.21, False)])
def test_a_point_belongs_to_a_lane_up_to_1_2_m_outside_its_edge(outside_m: float, found: bool) -> None:
    """To the left of the leftmost lane, whose half width is 1.75 m."""
    front = (LEFT_X_M - 1.75 - outside_m, -70.0)
    match = LaneMatcher(CROSSING).match((S_IN.index,), front, np.pi / 2, NO_LANE)
    assert (match.lane == LEFT) is found
    assert match.lateral_m == pytest.approx(1.75 + outside_m if found else 0.0)


@pytest.mark.parametrize("turned", [1.19, -1.19, 1.21, -1.21])
def test_lanes_count_up_to_1_2_rad_off_the_heading(turned: float) -> None:
    match = LaneMatcher(CROSSING).match((S_IN.index,), (LEFT_X_M, -70.0), np.pi / 2 + turned, NO_LANE)
    assert (match.lane != NO_LANE) is (abs(turned) < 1.2)
