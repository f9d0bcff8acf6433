"""The mirror image of a map: traffic on the other side, the same indices, sides of the map itself."""

import numpy as np

from siren_ros.simulation.roads.mirror_image import mirrored_network, right_hand_image


def test_lanes_run_on_the_other_side_of_the_x_axis(town):
    image = mirrored_network(town)
    assert (image.left_hand, town.left_hand) == (True, False)
    for lane, other in zip(town.lanes, image.lanes, strict=True):
        assert (lane.lane_id, lane.position, lane.length_m) == (other.lane_id, other.position, other.length_m)
        assert np.array_equal(other.centre.points, lane.centre.points * (1.0, -1.0))
    for junction in town.junctions.values():
        other = image.junctions[junction.junction_id]
        assert (other.x_m, other.y_m) == (junction.x_m, -junction.y_m)
        assert np.array_equal(other.outline, junction.outline * (1.0, -1.0))


def test_a_left_turn_is_a_right_turn_of_the_image(town):
    turned = {"l": "r", "r": "l", "s": "s", "t": "t"}
    pairs = zip(town.connections, mirrored_network(town).connections, strict=True)
    assert all(other.direction == turned[movement.direction] for movement, other in pairs)
    assert {movement.direction for movement in town.connections} >= {"l", "r", "s"}


def test_left_and_right_neighbours_are_those_of_the_geometry(town):
    """Position 0 is at the outer kerb: on the left where traffic keeps left."""
    image = mirrored_network(town)
    pairs = [(lane, image.neighbour(lane, 1)) for lane in image.lanes]
    beside = [(lane, left) for lane, left in pairs if left is not None and not image.edges[lane.edge].internal]
    assert len(beside) > 20
    for lane, left in beside:
        assert left.position == lane.position - 1
        assert lane.centre.project(left.centre.at(0.5 * left.length_m))[1] > 0.0
        assert image.neighbour(left, -1) is lane


def test_the_image_of_the_image_is_the_map(town):
    image = mirrored_network(town)
    again = mirrored_network(image)
    assert again.connections == town.connections
    assert not again.left_hand
    assert again.origin_lat_lon_deg == town.origin_lat_lon_deg
    assert all(np.array_equal(a.centre.points, b.centre.points) for a, b in zip(again.lanes, town.lanes, strict=True))
    assert right_hand_image(town) is town
    assert right_hand_image(image) is again, "one image of each map"
