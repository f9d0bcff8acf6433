"""A near-miss that a person would call one: a short PET after hard braking, or by chance alone."""

import numpy as np
import pytest
from evaluation.made_records import moving, record_with

from siren_ros.evaluation.risk.labels import (
    DEFINITIONS,
    Camera,
    Evidence,
    Moments,
    RiskClass,
    SeenEncroachment,
    evidence_of,
    label_of,
)
from siren_ros.sensors.specification import Mount

NOTHING = Moments(*(np.zeros(0) for _ in range(6)))
CAMERA = Camera(Mount(2.0, 0.0, 1.5), 1.75)
EMV, CAR = 1, 5


@pytest.mark.parametrize(
    ("time_s", "braked", "needed", "near"),
    [
        (0.6, 0.0, 0.0, False),
        (0.6, 3.39, 8.44, False),
        (0.6, 3.4, 0.0, True),
        (0.6, 0.0, 8.45, True),
        (1.0, 9.0, 9.0, False),
        (0.6, None, None, True),
    ],
)
def test_a_controlled_passing_is_normal(time_s, braked, needed, near):
    evidence = Evidence(NOTHING, (SeenEncroachment(5, 50, time_s, braked, needed),), ())
    label = label_of(evidence, DEFINITIONS["near_crash"])
    assert label.risk is (RiskClass.NEAR_MISS if near else RiskClass.NORMAL)
    assert label_of(evidence, DEFINITIONS["paper"]).risk is (RiskClass.NEAR_MISS if time_s < 1.0 else RiskClass.NORMAL)


def crossing(emv_mps, car_mps, later_s, accel_mps2=0.0, road=None):
    """The EMV drives along x through the origin at 3 s and the car along y so many seconds before it."""
    tracks = {
        EMV: moving(-3.0 * emv_mps, 0.0, emv_mps, accel_mps2=accel_mps2, steps=121, is_emv=True),
        CAR: moving(0.0, -(3.0 - later_s) * car_mps, car_mps, yaw_rad=np.pi / 2, steps=121),
    }
    return evidence_of(record_with(tracks, road), EMV, CAMERA, (0, 121)).encroachments


@pytest.mark.parametrize("emv_mps", [4.0, 8.0, 16.0])
def test_the_needed_braking_at_constant_speed_is_half_the_speed_by_the_pet(emv_mps, straight_road):
    (found,) = crossing(emv_mps, 8.0, 1.6, road=straight_road)
    assert found.time_s > 0.1
    assert found.needed_mps2 == pytest.approx(emv_mps / (2.0 * found.time_s))
    assert found.braked_mps2 == 0.0


def test_the_hardest_braking_of_both_counts(straight_road):
    (found,) = crossing(12.0, 8.0, 1.6, accel_mps2=-2.0, road=straight_road)
    assert found.braked_mps2 == pytest.approx(2.0)
    (gaining,) = crossing(8.0, 8.0, 1.6, accel_mps2=1.0, road=straight_road)
    assert gaining.braked_mps2 == 0.0
