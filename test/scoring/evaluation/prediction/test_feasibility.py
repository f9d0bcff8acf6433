import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.scoring.evaluation.prediction.feasibility import ACCELERATION_MAX_MPS2, RADIUS_MIN_M, infeasible
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, future_times_s, samples_of

TIMES_S = future_times_s()


@pytest.fixture(scope="module")
def samples(straight_road):
    """A vehicle at (30, −5.25) that drives 10 m/s along x."""
    one = samples_of(
        record_with({1: moving(0.0, -5.25, 10.0, steps=161)}, straight_road), HistoryWindow(), Population.ALL
    )
    return one.select(np.array([0]))


def value(samples, x_m, y_m) -> float:
    path = samples.batch.xy_m[:, None] + np.stack((x_m, y_m), axis=-1)[None]
    return float(infeasible(Hypotheses.certain(path), samples)[0])


def speed_change(acceleration: float):
    """The way of a vehicle that brakes to a standstill, or speeds up."""
    until = np.minimum(TIMES_S, 10.0 / -acceleration) if acceleration < 0.0 else TIMES_S
    return 10.0 * until + 0.5 * acceleration * until**2


@pytest.mark.parametrize(("acceleration", "expected"), [(0.0, 0.0), (-8.0, 0.0), (5.0, 0.0), (-10.0, 1.0), (9.5, 1.0)])
def test_tyres_carry_so_much(samples, acceleration, expected) -> None:
    assert value(samples, speed_change(acceleration), 0.0 * TIMES_S) == expected


@pytest.mark.parametrize(("radius", "expected"), [(1.05 * 100.0 / ACCELERATION_MAX_MPS2, 0.0), (10.0, 1.0)])
def test_a_bend_at_speed_needs_acceleration_too(samples, radius, expected) -> None:
    """At 10 m/s the smallest circle has 11.3 m."""
    angle = 10.0 * TIMES_S / radius
    assert value(samples, radius * np.sin(angle), radius * (1.0 - np.cos(angle))) == expected


@pytest.mark.parametrize(("radius", "expected"), [(1.1 * RADIUS_MIN_M, 0.0), (0.8 * RADIUS_MIN_M, 1.0)])
def test_a_slow_car_turns_no_tighter_than_its_steering(straight_road, radius, expected) -> None:
    slow = samples_of(
        record_with({1: moving(0.0, -5.25, 3.0, steps=161)}, straight_road), HistoryWindow(), Population.ALL
    )
    angle = 3.0 * TIMES_S / radius
    assert value(slow.select(np.array([0])), radius * np.sin(angle), radius * (1.0 - np.cos(angle))) == expected


def test_a_path_that_begins_with_another_velocity_is_none(samples) -> None:
    assert value(samples, 14.0 * TIMES_S, 0.0 * TIMES_S) == 1.0
    assert value(samples, 10.2 * TIMES_S, 0.0 * TIMES_S) == 0.0
