"""A bias is the same however a step is reached, and it is the sum of its increments."""

import numpy as np
import pytest

from siren_ros.numerics.units import STEP_S
from siren_ros.sensors.navigation.bias_walk import BiasWalk
from siren_ros.sensors.suite.noise import sensor_generator

PER_SQRT_S = np.array([0.1, 0.0, 0.02])


def test_a_bias_is_the_sum_of_the_increments_up_to_its_step() -> None:
    draws = [sensor_generator(4, "gyro bias", step).standard_normal(3) for step in range(1, 4)]
    expected = np.sum(draws, axis=0) * PER_SQRT_S * np.sqrt(STEP_S)
    assert BiasWalk(4, "gyro", PER_SQRT_S).at(3) == pytest.approx(expected)


@pytest.mark.parametrize("asked", [[1, 2, 3, 4, 5], [5, 2, 5, 0, 3], [3, 3, 1, 4, 2]])
def test_steps_can_be_asked_for_in_any_order(asked: list[int]) -> None:
    walk = BiasWalk(4, "gyro", PER_SQRT_S)
    for step in asked:
        assert walk.at(step) == pytest.approx(BiasWalk(4, "gyro", PER_SQRT_S).at(step), abs=0.0)


def test_a_walk_begins_at_zero_and_lends_no_array() -> None:
    walk = BiasWalk(4, "gyro", PER_SQRT_S)
    assert walk.at(0).tolist() == [0.0, 0.0, 0.0]
    walk.at(2)[:] = 7.0
    assert np.abs(walk.at(2)).max() < 1.0
    assert BiasWalk(4, "gyro", np.zeros(2)).at(9).tolist() == [0.0, 0.0]
