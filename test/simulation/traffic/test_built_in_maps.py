"""The built-in maps: what they have, and that everybody gets along them."""

from pathlib import Path

import numpy as np
import pytest
from defusedxml import ElementTree
from map_networks import network_of_map

from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes


@pytest.fixture(scope="module")
def town() -> RoadNetwork:
    return network_of_map(None)


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


def test_its_bends_can_be_driven_at_its_limit(motorway):
    for edge in motorway.edges:
        if edge.internal or "ramp" in edge.edge_id:
            continue
        line = driving_lanes(motorway, edge.index)[-1].centre.resampled(50.0)
        turned = np.abs(np.diff(np.unwrap(line.heading_rad(line.arc_m[:-1]))))
        radius_m = 50.0 / turned.max(initial=1e-6)
        assert 36.11**2 / radius_m < 1.0
