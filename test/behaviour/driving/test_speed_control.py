import numpy as np
import pytest

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.driving.speed_control import press_pedals
from siren_ros.world.actors import ActorClass

CONFIG = NavigatorConfig()


@pytest.fixture
def vehicle(lab):
    return lab.vehicles[ActorClass.AMBULANCE]


def test_never_both_pedals(vehicle):
    for speed in (0.0, 3.0, 14.0):
        for wanted in (0.0, 2.0, 14.0, 20.0):
            pedals = press_pedals(speed, wanted, 0.0, 0.0, vehicle, CONFIG)
            assert pedals.throttle == 0.0 or pedals.brake == 0.0
            assert 0.0 <= pedals.throttle <= 1.0
            assert 0.0 <= pedals.brake <= 1.0


def test_holds_still_with_brake_and_without_integral(vehicle):
    pedals = press_pedals(0.05, 0.0, 0.0, 0.5, vehicle, CONFIG)
    assert (pedals.throttle, pedals.integral_mps2) == (0.0, 0.0)
    assert pedals.brake > 0.4


def test_integral_does_not_wind_up(vehicle):
    integral = 0.0
    for _ in range(400):
        integral = press_pedals(0.0, 14.0, 0.0, integral, vehicle, CONFIG).integral_mps2
    assert integral == 0.0
    for _ in range(4000):
        integral = press_pedals(13.5, 14.0, 0.0, integral, vehicle, CONFIG).integral_mps2
    assert integral <= 0.8


def test_necessary_braking_wins(vehicle):
    soft = press_pedals(10.0, 9.5, 0.0, 0.0, vehicle, CONFIG)
    hard = press_pedals(10.0, 9.5, 6.0, 0.0, vehicle, CONFIG)
    assert hard.brake > soft.brake + 0.4
    assert press_pedals(10.0, 0.0, 50.0, 0.0, vehicle, CONFIG).brake == 1.0


@pytest.mark.parametrize(("speed", "wanted", "holds"), [(0.3, 0.0, True), (0.31, 0.0, False), (0.1, 0.06, False)])
def test_the_brake_holds_only_at_a_standstill_that_is_wanted(vehicle, speed, wanted, holds):
    assert (press_pedals(speed, wanted, 0.0, 0.0, vehicle, CONFIG).brake == 0.6) is holds


def accel_of(pedals, speed, vehicle):
    """What the pedals do to the speed: drive and brakes against drag and rolling resistance."""
    most = min(vehicle.max_drive_accel_mps2, vehicle.drive_power_w / (vehicle.mass_kg * max(speed, 1.0)))
    drag = 0.5 * 1.225 * vehicle.drag_area_m2 * speed**2 / vehicle.mass_kg
    resistance = drag + vehicle.rolling_resistance * 9.80665
    return pedals.throttle * most - pedals.brake * vehicle.max_brake_decel_mps2 - resistance


@pytest.mark.parametrize(
    ("wanted", "must", "accel"),
    [
        (6.3, 0.0, 0.6 + 0.1),
        (5.4, 0.0, -1.2 + 0.1),
        (9.0, 0.0, 2.5),
        (0.0, 0.0, -1.3 * 3.0),
        (6.3, 2.0, -2.0),
        (0.0, 2.0, -1.3 * 3.0),
    ],
)
def test_pedals_give_the_acceleration_that_is_asked_for_within_comfort(vehicle, wanted, must, accel):
    pedals = press_pedals(6.0, wanted, must, 0.1, vehicle, CONFIG)
    assert accel_of(pedals, 6.0, vehicle) == pytest.approx(accel, abs=1e-9)


@pytest.mark.parametrize(("wanted", "grows"), [(6.5, 0.3 * 0.5 * 0.05), (5.5, -0.3 * 0.5 * 0.05)])
def test_the_integral_grows_with_the_error(vehicle, wanted, grows):
    assert press_pedals(6.0, wanted, 0.0, 0.2, vehicle, CONFIG).integral_mps2 == pytest.approx(0.2 + grows)
    assert press_pedals(6.0, wanted, 1.0, 0.2, vehicle, CONFIG).integral_mps2 == 0.2
    assert press_pedals(6.0, wanted + np.sign(grows), 0.0, 0.2, vehicle, CONFIG).integral_mps2 == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_integral_is_bounded_on_both_sides(vehicle, side):
    assert press_pedals(6.0, 6.0 + 0.5 * side, 0.0, 0.8 * side, vehicle, CONFIG).integral_mps2 == 0.8 * side


def test_feed_forward_covers_the_resistances_at_steady_speed(vehicle):
    pedals = press_pedals(13.89, 13.89, 0.0, 0.0, vehicle, CONFIG)
    drive = pedals.throttle * min(vehicle.max_drive_accel_mps2, vehicle.drive_power_w / vehicle.mass_kg / 13.89)
    resistance = 0.5 * 1.225 * vehicle.drag_area_m2 * 13.89**2 / vehicle.mass_kg + vehicle.rolling_resistance * 9.80665
    assert drive == pytest.approx(resistance, rel=1e-6)
