"""The built-in motorway: what it has, and that everybody gets along it."""

from pathlib import Path

import numpy as np
import pytest
from map_networks import network_of_map

from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph, driving_lanes
from siren_ros.simulation.roads.site_finder import wide_stretch_back


@pytest.fixture(scope="module")
def motorway() -> RoadNetwork:
    return network_of_map(Path("motorway"))


def test_lanes_and_limits(motorway):
    for lane in motorway.lanes:
        edge = motorway.edges[lane.edge]
        if lane.kind is LaneKind.SHOULDER:
            assert (lane.width_m, lane.civilian_allowed, lane.emergency_allowed) == (3.0, False, True)
        elif lane.kind is LaneKind.DRIVING:
            assert lane.width_m == 3.75
            assert round(lane.speed_limit_mps * 3.6) == (80 if "ramp" in edge.edge_id else 130)
    counts = {len(driving_lanes(motorway, edge.index)) for edge in motorway.edges if not edge.internal}
    assert counts == {1, 2, 3, 4}


def test_nobody_waits_for_anybody(motorway):
    assert {junction.kind for junction in motorway.junctions.values()} == {JunctionKind.PRIORITY, JunctionKind.DEAD_END}
    assert {connection.direction for connection in motorway.connections} == {"s"}
    assert not any(connection.must_stop or connection.signal_id for connection in motorway.connections)
    targets = [connection.to_lane for connection in motorway.connections]
    assert len(targets) == len(set(targets)), "no two lanes become one"


@pytest.mark.parametrize("direction", ["e", "w"])
def test_one_can_drive_from_one_end_to_the_other(motorway, direction):
    graph = EdgeGraph.of(motorway)
    ends = {"e": ("e_a", "e_e"), "w": ("w_e", "w_a")}[direction]
    first, last = (motorway.edge_by_id[name].index for name in ends)
    reached, front = {first}, [first]
    while front:
        new = [way for way in graph.successors[front.pop()] if way not in reached]
        reached.update(new)
        front += new
    assert last in reached
    stretch = wide_stretch_back(graph, last)
    assert stretch[0] == first
    assert 5900.0 < graph.route_length_m(stretch) < 6400.0


def test_its_bends_can_be_driven_at_its_limit(motorway):
    for edge in motorway.edges:
        if edge.internal or "ramp" in edge.edge_id:
            continue
        line = driving_lanes(motorway, edge.index)[-1].centre.resampled(50.0)
        turned = np.abs(np.diff(np.unwrap(line.heading_rad(line.arc_m[:-1]))))
        radius_m = 50.0 / turned.max(initial=1e-6)
        assert 36.11**2 / radius_m < 1.0
