import numpy as np
import pytest
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
