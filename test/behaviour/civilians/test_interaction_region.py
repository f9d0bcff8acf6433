import numpy as np
import pytest

from siren_ros.behaviour.civilians.interaction_region import EmvAhead, emv_fully_passed, free_way_m, region_members
from siren_ros.behaviour.paths.nearest_on_lane import lane_foot, lane_heading
from siren_ros.numerics.polyline import Polyline
from siren_ros.world.actors import ActorClass

AMBULANCE = ActorClass.AMBULANCE


def view_of(lab, cars, network=None):
    network = network or lab.straight_road()
    return lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars))


@pytest.mark.parametrize(("ahead", "passed"), [(6.62, False), (6.63, True), (-30.0, False)])
def test_passed_when_the_rear_is_a_metre_ahead_of_the_front(lab, ahead, passed):
    """Half of 6.5 m and half of 4.75 m and 1 m make 6.625 m between the centres."""
    view = view_of(lab, [lab.Car(1, 0, 100 + ahead, 8, (0,), AMBULANCE), lab.Car(2, 1, 100, 2, (0,))])
    assert emv_fully_passed(view, 1, 0) is passed


def test_passing_is_measured_along_the_civilians_lane(lab):
    network = lab.straight_road()
    cars = [lab.Car(1, 0, 107, 8, (0,), AMBULANCE), lab.Car(2, 1, 100, 2, (0,))]
    poses = np.array([[107.0, 0.0, 0.0, 8.0], [100.0, 3.3, 0.5, 2.0]])
    view = lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars, poses=poses))
    assert emv_fully_passed(view, 1, 0)


def test_region_has_hysteresis(lab):
    def members(distance, before):
        view = view_of(lab, [lab.Car(1, 0, 50, 8, (0,), AMBULANCE), lab.Car(2, 0, 50 + distance, 2, (0,))])
        return region_members(view.seen, 0, np.array(before, dtype=np.uint32), 40.0, 50.0).tolist()

    assert members(39.9, []) == [2]
    assert members(40.1, []) == []
    assert members(40.1, [2]) == [2]
    assert members(50.0, [2, 9]) == [2]
    assert members(50.1, [2]) == []


def test_free_way_is_along_the_emvs_path(lab):
    network = lab.junction_road()
    cars = [
        lab.Car(1, 0, 100, 8, (0, 4), AMBULANCE),
        lab.Car(2, 7, 20, 5, (0, 4)),
        lab.Car(3, 1, 130, 5, (0, 2)),
        lab.Car(4, 4, 20, 5, (2,)),
    ]
    view = view_of(lab, cars, network)
    ahead = EmvAhead.seen(view, 0, None)
    way = free_way_m(view, 0, ahead.lane_start_m)
    turn = network.lanes[6].length_m
    assert way[1] == pytest.approx(50.0 + turn + 20.0 - 4.75 / 2.0 - 6.5 / 2.0, abs=0.05)
    assert np.isinf(way[2:]).all()
    beside = free_way_m(view, 0, ahead.road_start_m)
    assert beside[2] == pytest.approx(30.0 - 4.75 / 2.0 - 6.5 / 2.0, abs=0.01)
    assert np.isinf(beside[3])
    assert ahead.road[[0, 4]].all()
    assert not ahead.road[2]


def test_road_is_kept_while_lane_and_route_stay(lab):
    view = view_of(lab, [lab.Car(1, 0, 100, 8, (0,), AMBULANCE)])
    ahead = EmvAhead.seen(view, 0, None)
    assert EmvAhead.seen(view, 0, ahead) is ahead
    other = view_of(lab, [lab.Car(1, 1, 100, 8, (0,), AMBULANCE)])
    assert EmvAhead.seen(other, 0, ahead) is not ahead


@pytest.mark.parametrize("point", [(-5.0, 2.0), (4.0, 1.0), (9.0, 0.5), (11.0, 3.0), (12.0, 20.0)])
def test_lane_foot_agrees_with_the_polyline(point):
    line = Polyline.through(np.array([[0.0, 0.0], [10.0, 0.0], [12.0, 6.0], [12.0, 15.0]]))
    s, left, heading = lane_foot(line, *point)
    expected_s, expected_left = line.project(point)
    assert (s, left) == pytest.approx((float(expected_s), float(expected_left)))
    if 0.1 < s < line.length_m - 0.1 and min(abs(s - line.arc_m)) > 0.01:
        assert heading == pytest.approx(float(line.heading_rad(s)))
    assert lane_heading(line, 11.0) == pytest.approx(float(line.heading_rad(11.0)))
