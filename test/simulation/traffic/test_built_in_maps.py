"""The built-in maps: what they have, and that everybody gets along them."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from defusedxml import ElementTree
from map_networks import network_of_map

from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph, driving_lanes
from siren_ros.simulation.roads.site_finder import wide_stretch_back


@pytest.fixture(scope="module")
def town() -> RoadNetwork:
    return network_of_map(None)


def test_what_the_town_has(town):
    kinds = Counter(junction.kind for junction in town.junctions.values())
    stops = kinds[JunctionKind.ALL_WAY_STOP], kinds[JunctionKind.PRIORITY_STOP]
    assert (kinds[JunctionKind.SIGNAL], *stops, kinds[JunctionKind.DEAD_END]) == (3, 2, 2, 9)
    assert len(town.crossings) == 22
    assert town.sumo_offset_m == (0.0, 0.0)
    assert "t" not in {connection.direction for connection in town.connections}


def test_signal_programs_never_give_green_to_two_crossing_straight_movements(town):
    programs = {
        logic.get("id"): [(float(phase.get("duration")), phase.get("state")) for phase in logic.iterfind("phase")]
        for logic in ElementTree.fromstring(compile_map(None).read_bytes()).iterfind("tlLogic")
    }
    assert set(programs) == {"main_west", "main_east", "north_west"}
    for name, phases in programs.items():
        links = [c for c in town.connections if c.signal_id == name]
        assert max(c.signal_link for c in links) < len(phases[0][1])
        for _, state in phases:
            protected = {_street(town, c) for c in links if c.direction == "s" and state[c.signal_link] == "G"}
            assert len(protected) <= 1
        for (_, before), (duration, after) in zip(phases, phases[1:] + phases[:1], strict=True):
            vehicles = range(max(c.signal_link for c in links) + 1)
            assert all(after[i] != "r" or before[i] in "ry" for i in vehicles), "red without yellow"
            if any(after[i] == "y" for i in vehicles):
                assert duration == 3.0
        assert 60.0 <= sum(duration for duration, _ in phases) <= 120.0


def _street(town, connection):
    return town.edges[town.lanes[connection.from_lane].edge].name


@pytest.fixture(scope="module")
def motorway() -> RoadNetwork:
    return network_of_map(Path("motorway"))


def test_lanes_and_limits_of_the_motorway_and_that_nobody_waits_there(motorway):
    for lane in motorway.lanes:
        edge = motorway.edges[lane.edge]
        if lane.kind is LaneKind.SHOULDER:
            assert (lane.width_m, lane.civilian_allowed, lane.emergency_allowed) == (3.0, False, True)
        elif lane.kind is LaneKind.DRIVING:
            assert lane.width_m == 3.75
            assert round(lane.speed_limit_mps * 3.6) == (80 if "ramp" in edge.edge_id else 130)
    counts = {len(driving_lanes(motorway, edge.index)) for edge in motorway.edges if not edge.internal}
    assert counts == {1, 2, 3, 4}
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
