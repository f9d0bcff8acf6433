import math
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.behaviour.driving.collision_watch import CollisionSnapshot
from siren_ros.behaviour.driving.navigator import NavigatorState
from siren_ros.behaviour.emv.escape_plan import reference_line, road_space
from siren_ros.behaviour.emv.passage import UNLIMITED, free_way, passage_blocker, passage_limit
from siren_ros.behaviour.emv.unit import EmvUnit
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.world.actors import ActorClass


def scene(lab, *others, speed=5.0, corridor=True):
    network = lab.straight_road()
    cars = [lab.Car(1, 0, 100, speed, (0,), ActorClass.AMBULANCE), *others]
    view = lab.view_of(lab.world_of(network, lab.L3), lab.traffic_of(network, cars))
    path = TrackedPath.of(Curve.through(np.array([[95.0, 0.0], [180.0, 0.0]])), view.navigator_config(0))
    return EmvUnit(1, NavigatorState().following(path, 100.0, 0.0), corridor=corridor), view


def test_only_the_corridor_and_the_gap_escape_are_limited(lab):
    unit, view = scene(lab, lab.Car(2, 0, 120, 0, (0,)), corridor=False)
    assert passage_limit(unit, view, 0) == UNLIMITED
    assert passage_limit(EmvUnit(1, corridor=True), view, 0) == UNLIMITED
    for mode in ({"corridor": True}, {"gap_escape_active": True}):
        assert passage_limit(replace(unit, **mode), view, 0).speed_mps < 10.0


def test_stops_before_a_vehicle_that_stands_on_the_path(lab):
    unit, view = scene(lab, lab.Car(2, 0, 120, 0, (0,)))
    bumpers = 20.0 - 0.5 * (lab.vehicles[ActorClass.AMBULANCE].length_m + lab.vehicles[ActorClass.SEDAN].length_m)
    assert free_way(unit, view, 0).free_m == pytest.approx(bumpers, abs=0.6)
    limit = passage_limit(unit, view, 0)
    assert limit.blocker_id == 2
    free = limit.free_m - view.world.config.corridor.stop_short_m
    assert limit.speed_mps == pytest.approx(math.sqrt(2.0 * view.world.config.gap_escape.brake_mps2 * free))


def test_vehicles_ahead_that_move_leave_way_and_crossing_ones_count_only_in_the_gap_escape(lab):
    standing, view = scene(lab, lab.Car(2, 0, 120, 0, (0,)))
    moving, moving_view = scene(lab, lab.Car(2, 0, 120, 6, (0,)))
    gain = free_way(moving, moving_view, 0).free_m - free_way(standing, view, 0).free_m
    assert gain == pytest.approx(6.0**2 / 8.0)
    network = lab.straight_road()
    cars = [lab.Car(1, 0, 100, 5, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 115, 5, (0,))]
    poses = np.array([[100.0, 0.0, 0.0, 5.0], [115.0, -3.0, math.pi / 2.0, 5.0]])
    crossing = lab.view_of(lab.world_of(network, lab.L3), lab.traffic_of(network, cars, poses=poses))
    assert math.isinf(free_way(standing, crossing, 0).free_m)
    assert free_way(replace(standing, gap_escape_active=True), crossing, 0).free_m < 12.0


def test_the_vehicle_that_cannot_be_passed_is_the_blocker(lab):
    unit, view = scene(lab, lab.Car(2, 0, 110, 0, (0,)))
    limit = passage_limit(unit, view, 0)
    assert passage_blocker(None, limit) == CollisionSnapshot(2, limit.free_m, 0.0)
    seen = CollisionSnapshot(7, 1.0, 0.0)
    assert passage_blocker(seen, limit) is seen
    assert passage_blocker(None, UNLIMITED) is None


def test_road_space_bridges_a_junction(lab):
    network = lab.junction_road()
    cars = [lab.Car(1, 0, 140, 0, (0, 2), ActorClass.AMBULANCE)]
    view = lab.view_of(lab.world_of(network, lab.L3), lab.traffic_of(network, cars))
    reference = reference_line(view, 0, 0)
    s = np.arange(0.0, 40.0, 1.0)
    space = road_space(network, reference, s)
    np.testing.assert_allclose(space.right_m, -1.65)
    np.testing.assert_allclose(space.left_m, 4.95)
    np.testing.assert_allclose(space.opposite_left_m, 4.95)
    np.testing.assert_allclose(space.middle_m, 1.65)
