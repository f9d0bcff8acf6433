"""Populations of drivers: where each number of a file goes, and what a draw changes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.scenario.presets import TruncatedNormal
from siren_ros.traffic.demand.driver_models import ClassDriving, load_drivers
from siren_ros.world.actors import ActorClass

CLASSES = "\n".join(
    f"  {member.name.lower()}: {{accel_mps2: {1.0 + 0.1 * member}, decel_mps2: {2.0 + 0.1 * member}, "
    f"min_gap_m: {3.0 + 0.1 * member}, max_speed_mps: {40.0 + member}}}"
    for member in ActorClass
)
TEXT = f"""title: made
car_following: Krauss
speed_factor: {{mean: 0.9, std: 0.0, min: 0.5, max: 1.5}}
tau_s: {{mean: 1.1, std: 0.0, min: 0.4, max: 4.0}}
max_lateral_speed_mps: 1.3
speed_gain_eagerness: 0.7
cooperation: 0.6
classes:
{CLASSES}
"""


def load(tmp_path: Path, was: str = "", becomes: str = "") -> object:
    path = tmp_path / "drivers.yaml"
    path.write_text(TEXT.replace(was, becomes) if was else TEXT)
    return load_drivers(str(path))


def test_every_number_has_its_place(tmp_path: Path) -> None:
    path = tmp_path / "drivers.yaml"
    path.write_text(TEXT)
    found = load_drivers(str(path))
    assert found.car_following == "Krauss"
    assert found.speed_factor == TruncatedNormal(0.9, 0.0, 0.5, 1.5)
    assert found.tau_s == TruncatedNormal(1.1, 0.0, 0.4, 4.0)
    assert (found.max_lateral_speed_mps, found.speed_gain_eagerness, found.cooperation) == (1.3, 0.7, 0.6)
    assert set(found.classes) == set(ActorClass)
    for member in ActorClass:
        expected = (1.0 + 0.1 * member, 2.0 + 0.1 * member, 3.0 + 0.1 * member, 40.0 + member)
        assert found.classes[member] == ClassDriving(*(pytest.approx(value) for value in expected))
    driver = found.draw(ActorClass.BUS, np.random.default_rng(0), 1.2)
    assert driver.speed_factor == pytest.approx(0.9 * 1.2)
    assert driver.tau_s == 1.1
    assert driver.driving == found.classes[ActorClass.BUS]
    assert (driver.max_lateral_speed_mps, driver.speed_gain_eagerness, driver.cooperation) == (1.3, 0.7, 0.6)
    assert driver.car_following == "Krauss"


def test_speed_and_headway_are_drawn_one_after_the_other(tmp_path: Path) -> None:
    path = tmp_path / "drivers.yaml"
    path.write_text(TEXT)
    wide = replace(load_drivers(str(path)), speed_factor=TruncatedNormal(1.0, 0.1, 0.0, 2.0))
    wide = replace(wide, tau_s=TruncatedNormal(1.0, 0.2, 0.0, 2.0))
    driver, rng = wide.draw(ActorClass.SEDAN, np.random.default_rng(5)), np.random.default_rng(5)
    assert (driver.speed_factor, driver.tau_s) == pytest.approx((rng.normal(1.0, 0.1), rng.normal(1.0, 0.2)))


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        ("Krauss", "Wiedemann"),
        ("mean: 0.9, std: 0.0, min: 0.5", "mean: 0.9, std: 0.0, min: 0.05"),
        ("min: 0.5, max: 1.5", "min: 0.5, max: 2.1"),
        ("min: 0.4, max: 4.0", "min: 0.2, max: 4.0"),
        ("min: 0.4, max: 4.0", "min: 0.4, max: 5.5"),
        ("  bus:", "  tram:"),
        ("cooperation: 0.6", "cooperation: 1.1"),
        ("cooperation: 0.6", "cooperation: 0.6\nunknown: 1"),
        ("min_gap_m: 3.0", "min_gap_m: 3.0, unknown: 1"),
    ],
)
def test_mistakes_are_refused(tmp_path: Path, was: str, becomes: str) -> None:
    assert was in TEXT
    with pytest.raises(InputError):
        load(tmp_path, was, becomes)
