import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.scoring.evaluation.prediction.kalman import Imm, ImmPredictor, filtered
from siren_ros.scoring.evaluation.prediction.samples import (
    HistoryWindow,
    Population,
    SampleBatch,
    future_times_s,
    samples_of,
)
from siren_ros.simulation.roads.road_network import RoadNetwork

TIMES_S = future_times_s()
NOWHERE = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")


def one(*values: float) -> SampleBatch:
    return samples_of(record_with({1: moving(*values, steps=161)}, NOWHERE), HistoryWindow(), Population.ALL).batch


def test_constant_velocity_is_found_and_continued() -> None:
    batch = one(0.0, 0.0, 7.0, 0.0, 0.4)
    answer = ImmPredictor().predict(batch)
    expected = batch.xy_m[0] + 7.0 * TIMES_S[:, None] * np.array([np.cos(0.4), np.sin(0.4)])
    assert answer.xy_m[0] == pytest.approx(np.stack((expected, expected)), abs=1e-6)


def test_a_strong_acceleration_is_found_and_is_the_more_probable_model() -> None:
    batch = one(0.0, 0.0, 2.0, 4.0)
    answer = ImmPredictor().predict(batch)
    assert answer.probability[0, 0] > 0.7
    speed = batch.speed_mps[0]
    assert answer.xy_m[0, 0, -1, 0] - batch.xy_m[0, 0] == pytest.approx(5.0 * speed + 0.5 * 4.0 * 25.0, rel=0.1)


def test_braking_ends_in_a_stop() -> None:
    batch = one(0.0, 0.0, 13.0, -4.0)
    speed = batch.speed_mps[0]
    away_m = ImmPredictor().predict(batch).xy_m[0, 0, :, 0] - batch.xy_m[0, 0]
    assert away_m[-1] == pytest.approx(speed**2 / 8.0, abs=0.3)
    assert (np.diff(away_m) >= -1e-9).all()


def test_noise_is_smoothed() -> None:
    """The filter's velocity is nearer to the true one than the last measurement, in the mean over many tracks."""
    random, imm = np.random.default_rng(1), Imm()
    times = HistoryWindow().times_s
    truth = np.concatenate((times[:, None] * [6.0, 0.0], np.tile([6.0, 0.0], (16, 1))), axis=1)
    noise = random.normal(size=(400, 16, 4)) * ([imm.position_m] * 2 + [imm.velocity_mps] * 2)
    state, share = filtered(imm, truth + noise, 0.2)
    velocity = (state[..., 2:4] * share[..., None]).sum(axis=1)
    errors = [np.hypot(*(values - [6.0, 0.0]).T).mean() for values in (velocity, (truth + noise)[:, -1, 2:])]
    assert errors[0] < 0.8 * errors[1]
    assert share.sum(axis=1) == pytest.approx(1.0)


def test_one_model_alone_is_the_plain_filter_of_a_still_vehicle() -> None:
    """Measured n times with variance r and no process noise, the position has the variance r / n: the mean."""
    imm = Imm(accelerations_mps2=1e-9, jerk_mps3=1e-9, velocity_mps=1e-6)
    measured = np.zeros((1, 16, 4))
    measured[0, :, 0] = np.arange(16)
    state, _ = filtered(imm, measured, 0.2)
    assert state[0, 0, 0] == pytest.approx(7.5, abs=1e-3)
