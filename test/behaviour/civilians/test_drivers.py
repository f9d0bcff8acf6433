from collections import Counter

import pytest

from siren_ros.behaviour.civilians.drivers import Compliance, draw_driver
from siren_ros.scenario.presets import load_preset


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
