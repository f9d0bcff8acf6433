"""The wheel angle: closed form on lines and circles that point anywhere."""

import math

import numpy as np
import pytest

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.path_tracking import steer_along
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.world.actors import ActorClass

CONFIG = NavigatorConfig()
TURNS = np.radians([0.0, 50.0, 175.0, -120.0])


@pytest.fixture
def vehicle(lab):
    return lab.vehicles[ActorClass.AMBULANCE]


def line(turn):
    return TrackedPath.of(Curve.through(np.array([[0.0, 0.0], [100.0 * np.cos(turn), 100.0 * np.sin(turn)]])), CONFIG)


def expected(vehicle, left, turned, speed):
    length = max(CONFIG.preview_min_m, CONFIG.preview_time_s * speed)
    wanted = -max(-1.0, min(1.0, left)) / length**2 - 2.0 * CONFIG.damping * math.sin(turned) / length
    return math.atan(vehicle.wheelbase_m * wanted) + vehicle.understeer_gradient_s2pm * wanted * speed**2


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(
    ("left", "turned", "speed"),
    [(0.5, 0.0, 10.0), (-0.5, 0.0, 10.0), (0.0, 0.1, 3.0), (0.0, -0.1, 12.0), (0.8, 0.2, 8.0)],
)
def test_on_a_line_offset_and_heading_are_steered_back(vehicle, turn, left, turned, speed):
    steer = steer_along(line(turn), 40.0, left, turn + turned, speed, vehicle, CONFIG)
    assert steer == pytest.approx(expected(vehicle, left, turned, speed), abs=1e-9)
    if left * turned >= 0.0:
        assert np.sign(steer) == -np.sign(left + turned)


@pytest.mark.parametrize("speed", [3.0, 9.0])
def test_large_offsets_are_corrected_no_more_steeply_than_one_metre(vehicle, speed):
    for left in (4.0, -4.0):
        one = steer_along(line(0.3), 40.0, math.copysign(1.0, left), 0.3, speed, vehicle, CONFIG)
        assert steer_along(line(0.3), 40.0, left, 0.3, speed, vehicle, CONFIG) == one


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_wheels_turn_no_farther_than_they_can(vehicle, side):
    steer = steer_along(line(0.0), 40.0, 0.0, -side * 1.4, 0.5, vehicle, CONFIG)
    assert steer == side * vehicle.max_steer_rad


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("speed", [4.0, 9.0])
def test_on_a_circle_the_steady_cornering_angle_and_sideslip(vehicle, side, speed):
    """The footprint's centre runs on the circle; its heading differs from the path's by the sideslip."""
    radius = 40.0
    a = np.linspace(0.0, 2.0, 800)
    circle = np.stack((radius * np.sin(a), side * radius * (1.0 - np.cos(a))), axis=-1)
    path = TrackedPath.of(Curve.through(circle), CONFIG)
    bend = side / radius
    slip = vehicle.mass_kg * vehicle.cg_to_front_axle_m / (vehicle.wheelbase_m * vehicle.cornering_stiffness_rear_npr)
    sideslip = math.atan(vehicle.centre_ahead_of_rear_axle_m * bend) - slip * bend * speed**2
    yaw = side * 40.0 / radius - sideslip
    steer = steer_along(path, 40.0, 0.0, yaw, speed, vehicle, CONFIG)
    steady = math.atan(vehicle.wheelbase_m * bend) + vehicle.understeer_gradient_s2pm * bend * speed**2
    assert steer == pytest.approx(steady, abs=2e-3)
