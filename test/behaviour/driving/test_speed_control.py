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


def test_feed_forward_covers_the_resistances_at_steady_speed(vehicle):
    pedals = press_pedals(13.89, 13.89, 0.0, 0.0, vehicle, CONFIG)
    drive = pedals.throttle * min(vehicle.max_drive_accel_mps2, vehicle.drive_power_w / vehicle.mass_kg / 13.89)
    resistance = 0.5 * 1.225 * vehicle.drag_area_m2 * 13.89**2 / vehicle.mass_kg + vehicle.rolling_resistance * 9.80665
    assert drive == pytest.approx(resistance, rel=1e-6)
