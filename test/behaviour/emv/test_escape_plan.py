"""The road beside the reference line of an escape, and how the vehicle stands against that line."""

import numpy as np
import pytest

from siren_ros.behaviour.emv import escape_plan
from siren_ros.behaviour.emv.escape_plan import reference_line, road_space, search_gap
from siren_ros.behaviour.paths.lane_path import LaneEnd, path_on_lanes
from siren_ros.world.actors import ActorClass

AMBULANCE = ActorClass.AMBULANCE


def lines_of(space):
    return space.right_m, space.driving_right_m, space.left_m, space.opposite_left_m, space.middle_m


def test_edges_are_those_of_the_shoulder_the_driving_lanes_and_the_opposite_ones(lab):
    road = lab.RoadBuilder()
    road.edge([[0, 0], [100, 0]], 3, ("A", "B"), shoulder=True)
    road.edge([[100, 16.5], [0, 16.5]], 2, ("B", "A"))
    network = road.built()
    for lane, shift in ((1, 0.0), (2, -3.3)):
        reference = path_on_lanes(network, (lane,), LaneEnd.HORIZON, 10.0, 50.0)
        found = lines_of(road_space(network, reference, np.array([0.0, 20.0])))
        expected = np.array([-1.65 - 3.3, -1.65, 4.95, 4.95 + 6.6, 1.65]) + shift
        for line, value in zip(found, expected, strict=True):
            assert line.tolist() == pytest.approx([value, value])


def test_a_road_that_widens_beyond_a_junction_is_bridged_evenly(lab):
    """One lane, 20 m of a junction, two lanes: the left edge goes from 1.65 m to 4.95 m."""
    road = lab.RoadBuilder()
    road.edge([[0, 0], [100, 0]], 1, ("A", "J"))
    road.edge([[100, 0], [120, 0]], 1, ("J", "J"), internal=True)
    road.edge([[120, 0], [200, 0]], 2, ("J", "B"))
    road.connect(0, 2, via=(1,))
    network = road.built()
    reference = path_on_lanes(network, (0, 1, 2), LaneEnd.HORIZON, 90.0, 60.0)
    s = np.array([5.0, 9.0, 20.0, 31.0, 35.0])
    space = road_space(network, reference, s)
    assert space.left_m.tolist() == pytest.approx([1.65, 1.65, 3.3, 4.95, 4.95])
    assert space.right_m.tolist() == pytest.approx([-1.65] * 5)
    assert space.middle_m.tolist() == pytest.approx([0.0, 0.0, 0.825, 1.65, 1.65])


def test_on_a_junction_alone_there_is_space_of_three_lanes(lab):
    network = lab.junction_road()
    reference = path_on_lanes(network, (2,), LaneEnd.HORIZON, 2.0, 20.0)
    space = road_space(network, reference, np.array([0.0, 10.0]))
    for line, widths in zip(lines_of(space), (-1.5, -1.5, 1.5, 1.5, 0.0), strict=True):
        assert line.tolist() == pytest.approx([3.3 * widths] * 2)


def start_of(lab, monkeypatch, *, turn=0.0, left=0.0, turned=0.0, s=100.0, length=400.0):
    """What a search is asked: the vehicle against the line, and the stations."""
    asked = []

    def noted(curve, road, start, obstacles, config):
        asked.append((curve, road, start, obstacles, config))

    monkeypatch.setattr(escape_plan, "search_lattice", noted)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    road = lab.RoadBuilder()
    road.edge([[0.0, 0.0], length * along], 2, ("A", "B"))
    network = road.built()
    poses = np.array([[*(s * along + left * across), turn + turned, 0.0]])
    car = lab.Car(1, 0, s, 0, (0,), AMBULANCE)
    view = lab.view_of(lab.world_of(network, lab.L3), lab.traffic_of(network, [car], poses=poses))
    reference = reference_line(view, 0, 0)
    found = search_gap(reference, view, 0)
    assert found is None
    return asked, reference, along


@pytest.mark.parametrize("turn", np.radians([0.0, 35.0, 130.0, -100.0]))
@pytest.mark.parametrize(("left", "turned"), [(0.4, 0.2), (-0.5, -0.15), (0.0, 1.2)])
def test_the_search_begins_at_the_rear_axle_as_the_vehicle_points(lab, monkeypatch, turn, left, turned):
    asked, reference, along = start_of(lab, monkeypatch, turn=turn, left=left, turned=turned)
    ((curve, road, start, _, config),) = asked
    vehicle = lab.vehicles[AMBULANCE]
    rear = vehicle.centre_ahead_of_rear_axle_m
    assert curve is reference.curve
    assert start.centre_ahead_m == rear
    assert start.left_m == pytest.approx(left - rear * np.sin(turned), abs=1e-6)
    assert start.slope == pytest.approx(np.tan(min(turned, 0.7)))
    assert (start.body.half_length_m, start.body.half_width_m) == (0.5 * vehicle.length_m, 0.5 * vehicle.width_m)
    assert start.wheelbase_m == vehicle.wheelbase_m
    assert start.sharpest_1pm == pytest.approx(np.tan(0.85 * vehicle.max_steer_rad) / vehicle.wheelbase_m)
    rear_axle = curve.at(road.s_m[:1])[0]
    assert rear_axle @ along == pytest.approx(100.0 - rear * np.cos(turned), abs=1e-6)
    assert np.diff(road.s_m) == pytest.approx(config.station_m)
    assert road.s_m[-1] - road.s_m[0] == pytest.approx(config.horizon_m)


@pytest.mark.parametrize(("beyond_m", "stations"), [(20.0, 14), (2.9, 0), (3.1, 3)])
def test_stations_end_where_the_front_is_at_the_lines_end(lab, monkeypatch, beyond_m, stations):
    """One each 1.5 m while the front, which is half a length and the rear axle's distance ahead, is on the line."""
    half = 0.5 * lab.vehicles[AMBULANCE].length_m
    asked, *_ = start_of(lab, monkeypatch, s=100.0, length=100.0 + half + beyond_m)
    assert [len(road.s_m) for _, road, *_ in asked] == ([stations] if stations else [])


def test_others_are_swept_for_as_long_as_they_may_go_and_longer_where_they_come_on(lab, monkeypatch):
    asked = []
    monkeypatch.setattr(escape_plan, "search_lattice", lambda *what: asked.append(what))
    network = lab.straight_road()
    cars = [lab.Car(1, 0, 100, 0, (0,), AMBULANCE), lab.Car(2, 0, 120, 4, (0,)), lab.Car(3, 1, 130, 4, (0,))]
    poses = np.array([[100.0, 0.0, 0.0, 0.0], [120.0, 0.0, 0.1, 4.0], [130.0, 3.3, np.pi, 4.0]])
    view = lab.view_of(lab.world_of(network, lab.L3), lab.traffic_of(network, cars, poses=poses))
    search_gap(reference_line(view, 0, 0), view, 0)
    obstacles, half = asked[0][3], 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    assert obstacles.actor_id.tolist() == [2, 3]
    ways = np.array([4.0 * 1.5, 4.0 * 1.5 * 2.5])
    assert obstacles.half_length_m == pytest.approx(half + 0.5 * ways)
    assert obstacles.x_m == pytest.approx([120.0 + 0.5 * ways[0] * np.cos(0.1), 130.0 - 0.5 * ways[1]])
