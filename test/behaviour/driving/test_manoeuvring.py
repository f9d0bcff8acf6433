"""Drivers who go to the lane's edge, and the outlines of those at their side."""

import math

import numpy as np
import pytest

from siren_ros.behaviour.config import ManoeuvringConfig, NavigatorConfig
from siren_ros.behaviour.driving.manoeuvring import manoeuvring_limit
from siren_ros.behaviour.driving.navigator import NavigatorState
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.world.actors import ActorClass

CONFIG = ManoeuvringConfig()
SEDAN, SUV = ActorClass.SEDAN, ActorClass.SUV


def state_on(*points):
    path = TrackedPath.of(Curve.through(np.array(points, dtype=float)), NavigatorConfig())
    return NavigatorState(path, 0.0, 0.0)


def limit(lab, state, *cars, kind=SEDAN, speed=1.5):
    network = lab.straight_road()
    own = lab.Car(2, 0, 80.0, speed, (0,), kind)
    view = lab.view_of(lab.world_of(network, lab.L3), lab.traffic_of(network, [own, *cars]))
    return manoeuvring_limit(state, view, 0)


def sideways(slope):
    return state_on(*((80.0 + s, slope * s) for s in np.arange(0.0, 20.0, 0.5)))


def test_nobody_near_or_no_path_leaves_the_speed_free(lab):
    assert math.isinf(limit(lab, sideways(0.0)).speed_mps)
    assert math.isinf(limit(lab, NavigatorState(), lab.Car(3, 1, 81.0, 0.0, (0,))).speed_mps)


def test_a_vehicle_alongside_is_not_driven_into_sideways(lab):
    """The strip ahead is free, and the vehicle alongside is behind the own front bumper."""
    width = 0.5 * (lab.vehicles[SEDAN].width_m + lab.vehicles[SUV].width_m)
    beside = lab.Car(3, 1, 82.0, 0.0, (0,), SUV, left=width + 0.6 - 3.3)
    found = limit(lab, sideways(0.2), beside)
    assert found.blocker_id == 3
    assert 0.0 < found.free_m < (0.6 - 0.1) / 0.2 + 0.3
    assert found.speed_mps == pytest.approx(math.sqrt(2.0 * CONFIG.brake_mps2 * (found.free_m - CONFIG.stop_short_m)))
    assert math.isinf(limit(lab, sideways(0.0), beside).speed_mps)


def test_who_comes_on_at_the_side_counts_where_it_will_be_in_a_moment(lab):
    """An EMV 12 m behind in the next lane at 10 m/s will be alongside in a second; a standing one stays behind."""
    coming, standing = (lab.Car(3, 1, 68.0, speed, (0,), ActorClass.AMBULANCE, left=-1.0) for speed in (10.0, 0.0))
    assert limit(lab, sideways(0.25), coming).blocker_id == 3
    assert math.isinf(limit(lab, sideways(0.25), standing).free_m)


def test_a_leader_that_drives_leaves_the_way_that_it_needs_to_stop(lab):
    length = lab.vehicles[SEDAN].length_m
    near = 80.0 + length + 3.0
    standing, driving = (limit(lab, sideways(0.0), lab.Car(3, 0, near, speed, (0,))) for speed in (0.0, 4.0))
    assert driving.free_m - standing.free_m == pytest.approx(4.0**2 / (2.0 * CONFIG.leader_brake_mps2), abs=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_flank_of_a_leader_in_the_next_lane_counts_as_far_as_it_reaches(lab, side):
    """Its rear is just ahead of the own front; the own path leads into its side, some metres farther on."""
    width = 0.5 * (lab.vehicles[SEDAN].width_m + lab.vehicles[ActorClass.BUS].width_m)
    length = 0.5 * (lab.vehicles[SEDAN].length_m + lab.vehicles[ActorClass.BUS].length_m)
    state = sideways(side * 0.2)
    standing, driving = (
        limit(lab, state, lab.Car(3, 0, 80.0 + length + 0.2, speed, (0,), ActorClass.BUS, left=side * (width + 0.8)))
        for speed in (0.0, 4.0)
    )
    assert standing.free_m < 8.0
    assert driving.free_m - standing.free_m == pytest.approx(4.0**2 / (2.0 * CONFIG.leader_brake_mps2), abs=1e-6)
