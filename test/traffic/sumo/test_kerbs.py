from pathlib import Path

import numpy as np
from traffic_helpers import load_map

from siren_ros.roads.road_network import LaneKind
from siren_ros.traffic.sumo.kerbs import Kerbs

CITY = load_map(Path("city"))[1]


def test_those_on_the_road_and_on_no_crossing_are_moved_to_its_edge() -> None:
    lane = next(lane for lane in CITY.lanes if lane.kind is LaneKind.CYCLE and lane.length_m > 60.0)
    s, half = 30.0, lane.width_m / 2.0
    offsets = (-half + 0.3, -half - 0.2, -half - 1.0)
    x_m, y_m = np.array([lane.centre.offset_points(np.array([s]), side)[0] for side in offsets]).T
    for crossing, expected in ((False, (-half - 0.45, -half - 0.45, -half - 1.0)), (True, offsets)):
        poses = np.stack((x_m, y_m))
        Kerbs(CITY).keep_off(poses, np.full(3, crossing))
        _, left = lane.centre.project(poses.T)
        np.testing.assert_allclose(left, expected, atol=0.02)


def test_those_in_the_middle_of_the_road_cross_it() -> None:
    lane = next(lane for lane in CITY.lanes if lane.kind is LaneKind.DRIVING and lane.length_m > 60.0)
    poses, crossing = np.array(lane.centre.at(30.0)).reshape(2, 1), np.array([False])
    before = poses.copy()
    Kerbs(CITY).keep_off(poses, crossing)
    np.testing.assert_array_equal(poses, before)
    assert crossing[0]


def test_the_road_begins_before_those_who_look_at_it_from_the_kerb() -> None:
    lane = next(lane for lane in CITY.lanes if lane.kind is LaneKind.CYCLE and lane.length_m > 60.0)
    heading = float(lane.centre.heading_rad(30.0))
    place = lane.centre.offset_points(np.array([30.0]), -0.5 * lane.width_m - 1.0)[0]
    yaws = np.array([heading + 0.5 * np.pi, heading - 0.5 * np.pi])
    assert Kerbs(CITY).ahead(*np.repeat(place, 2).reshape(2, 2), yaws).tolist() == [True, False]
