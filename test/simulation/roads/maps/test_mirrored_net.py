"""The mirror image of a SUMO net is the net of the mirrored road network."""

import numpy as np
import pytest
from roads.test_net_parser import NET

from siren_ros.simulation.roads.maps.map_compiler import compile_map, mirrored_map
from siren_ros.simulation.roads.maps.mirrored_net import mirrored_net
from siren_ros.simulation.roads.mirror_image import mirrored_network
from siren_ros.simulation.roads.net_parser import parse_road_network


@pytest.mark.parametrize("name", ["made", "town"])
def test_it_is_the_net_of_the_mirrored_network(name):
    net = NET.encode() if name == "made" else compile_map(None).read_bytes()
    read, expected = parse_road_network(mirrored_net(net)), mirrored_network(parse_road_network(net))
    assert read.left_hand
    assert read.sumo_offset_m == expected.sumo_offset_m
    assert read.connections == expected.connections
    assert read.edges == expected.edges
    assert len(read.crossings) == len(expected.crossings)
    for lane, other in zip(read.lanes, expected.lanes, strict=True):
        assert np.array_equal(lane.centre.points, other.centre.points)
    for junction, other in zip(read.junctions.values(), expected.junctions.values(), strict=True):
        assert (junction.x_m, junction.y_m) == (other.x_m, other.y_m)
        assert np.array_equal(junction.outline, other.outline)


def test_the_image_of_the_image_has_the_bytes_of_the_net():
    town = compile_map(None).read_bytes()
    assert mirrored_net(town) != town
    assert mirrored_net(mirrored_net(town)) == town


def test_numbers_keep_their_digits():
    assert b'netOffset="100.00,-50.00" convBoundary="0,-100,300,0"' in mirrored_net(NET.encode())


def test_a_mirrored_map_is_kept_in_the_cache():
    town = compile_map(None)
    image = mirrored_map(town)
    assert image.net_path.parent == town.net_path.parent
    assert image.read_bytes() == mirrored_net(town.read_bytes())
    assert image.sha256 != town.sha256
