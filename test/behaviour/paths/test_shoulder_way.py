"""The shoulder as an EMV's way into a right turn."""

import numpy as np
import pytest

from siren_ros.behaviour.paths.shoulder_way import shoulder_into_turn


def road_with_shoulder(lab):
    """West (edge 0), a junction path (1), the edge before the turn (2) of 30 m, the road to the south (3)."""
    road = lab.RoadBuilder()
    road.edge([[0, 0], [100, 0]], 2, ("W", "I"), shoulder=True)
    road.edge([[100, 0], [120, 0]], 2, ("I", "I"), internal=True)
    road.edge([[120, 0], [150, 0]], 2, ("I", "J"), shoulder=True)
    road.edge([[160, -10], [160, -200]], 1, ("J", "S"))
    for lane in (0, 1):
        road.connect(lane, 4 + lane, via=(2 + lane,))
        road.connect(4 + lane, 6, direction="r")
    return road.built()


def route(*edges):
    return np.array(edges, dtype=np.int32)


def test_the_way_is_the_shoulders_up_to_the_turn(lab):
    network = road_with_shoulder(lab)
    far = shoulder_into_turn(network, route(0, 2, 3), 100.0)
    assert (far.lane, far.onward.to_lane, far.edges) == (0, 4, (0, 2))
    near = shoulder_into_turn(network, route(2, 3), 0.0)
    assert (near.lane, near.onward.to_lane, near.edges) == (4, 6, (2,))


@pytest.mark.parametrize(
    ("edges", "reach_m"), [((0, 2, 3), 49.0), ((0, 2), 100.0), ((3,), 100.0), ((2,), 100.0), ((0, 3), 100.0)]
)
def test_no_way_where_the_turn_is_far_or_not_on_the_route(lab, edges, reach_m):
    assert shoulder_into_turn(road_with_shoulder(lab), route(*edges), reach_m) is None
