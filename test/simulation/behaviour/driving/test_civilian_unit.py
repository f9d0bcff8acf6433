from collections import Counter

import numpy as np
import pytest

from siren_ros.simulation.behaviour.driving.civilian_unit import (
    Compliance,
    EmvView,
    draw_driver,
    emv_fully_passed,
    release_reason,
)
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.world.actors import ActorClass


def test_the_papers_driver_is_deterministic():
    drivers = {draw_driver(load_preset("paper"), seed, actor) for seed in range(3) for actor in range(1, 30)}
    assert len(drivers) == 1
    driver = drivers.pop()
    assert (driver.compliance, driver.delay_s, driver.response_distance_m) == (Compliance.COMPLIES, 0.0, 40.0)


def test_realistic_drivers_differ_and_repeat():
    preset = load_preset("realistic")
    drivers = [draw_driver(preset, 5, actor) for actor in range(1, 400)]
    assert drivers == [draw_driver(preset, 5, actor) for actor in range(1, 400)]
    assert drivers != [draw_driver(preset, 6, actor) for actor in range(1, 400)]
    shares = Counter(driver.compliance for driver in drivers)
    assert shares[Compliance.COMPLIES] / 399 == pytest.approx(0.85, abs=0.06)
    assert shares[Compliance.LATE] > 0
    assert shares[Compliance.NEVER] > 0


def test_late_drivers_take_longer():
    preset = load_preset("realistic")
    drivers = [draw_driver(preset, 0, actor) for actor in range(1, 600)]
    mean = {
        kind: sum(d.delay_s for d in drivers if d.compliance is kind) / sum(d.compliance is kind for d in drivers)
        for kind in (Compliance.COMPLIES, Compliance.LATE)
    }
    assert mean[Compliance.LATE] > mean[Compliance.COMPLIES] + 1.5


AMBULANCE = ActorClass.AMBULANCE


@pytest.mark.parametrize(("ahead", "passed"), [(6.62, False), (6.63, True), (-30.0, False)])
def test_passed_when_the_rear_is_a_metre_ahead_of_the_front(lab, ahead, passed):
    """Half of 6.5 m and half of 4.75 m and 1 m make 6.625 m between the centres."""
    view = lab.view(
        lab.straight_road(), lab.L2, [lab.Car(1, 0, 100 + ahead, 8, (0,), AMBULANCE), lab.Car(2, 1, 100, 2, (0,))]
    )
    assert emv_fully_passed(view.ego(1), 0) is passed


def test_passing_is_measured_along_the_civilians_lane(lab, straight):
    cars = [lab.Car(1, 0, 107, 8, (0,), AMBULANCE), lab.Car(2, 1, 100, 2, (0,))]
    view = lab.view(straight, lab.L2, cars, poses=np.array([[107.0, 0.0, 0.0, 8.0], [100.0, 3.3, 0.5, 2.0]]))
    assert emv_fully_passed(view.ego(1), 0)


@pytest.mark.parametrize("turn", np.radians([30.0, 60.0, 140.0, -100.0]))
@pytest.mark.parametrize(
    ("ahead", "left", "yaw", "passed"),
    [
        *[(6.62, 3.3, 0.0, False), (6.63, 3.3, 0.0, True), (6.63, -3.3, 0.0, True)],
        *[(0.0, 8.0, 0.0, False), (-6.7, 0.0, 0.0, False), (1.0 + 2.375 + 1.04, 5.0, np.pi / 2.0, False)],
        (1.0 + 2.375 + 1.06, 5.0, -np.pi / 2.0, True),
    ],
)
def test_passing_on_a_road_that_points_elsewhere(lab, turn, ahead, left, yaw, passed):
    """On a road through the origin; the EMV is 6.5 m long and 2.1 m wide, the car 4.75 m long."""
    network, along, across = lab.turned_road(turn, length=300.0)
    place, emv = 100.0 * along, (100.0 + ahead) * along + left * across
    poses = np.array([[*emv, turn + yaw, 8.0], [*place, turn + 0.2, 2.0]])
    cars = [lab.Car(1, 0, 100, 8, (0,), AMBULANCE), lab.Car(2, 0, 100, 2, (0,))]
    assert emv_fully_passed(lab.view(network, lab.L2, cars, poses=poses).ego(1), 0) is passed


@pytest.mark.parametrize(
    ("passed", "in_region", "reason"),
    [(False, True, ""), (True, True, "emv_passed"), (True, False, "emv_passed"), (False, False, "emv_gone")],
)
def test_released_when_the_emv_has_passed_or_is_gone(passed, in_region, reason):
    assert release_reason(EmvView(0, passed, in_region, on_path=True, on_road=True)) == reason
