"""Predictors that continue a motion: kinematic ones, along the lane, and Kalman filters."""

import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.scoring.evaluation.prediction.kalman import Imm, ImmPredictor, filtered
from siren_ros.scoring.evaluation.prediction.kinematic import (
    acceleration_of,
    make_ca,
    make_ca_lane,
    make_ctra,
    make_cv_lane,
    make_decay_lane,
    turn_rate_of,
)
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


def one(network: RoadNetwork, *values: float) -> SampleBatch:
    return samples_of(record_with({1: moving(*values, steps=161)}, network), HistoryWindow(), Population.ALL).batch


def circling(radius_m: float, speed_mps: float) -> SampleBatch:
    """A vehicle on a circle around the origin, counter-clockwise, now at angle 0 and heading north."""
    batch = one(NOWHERE, 0.0, 0.0, speed_mps)
    angle = speed_mps / radius_m * batch.window.times_s
    actors = batch.actors
    heading = angle + 0.5 * np.pi
    actors.xy_m[:] = radius_m * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    actors.yaw_rad[:] = heading
    actors.velocity_mps[:] = speed_mps * np.stack((np.cos(heading), np.sin(heading)), axis=-1)
    return batch


@pytest.mark.parametrize(("radius_m", "speed_mps"), [(20.0, 6.0), (-15.0, 8.0), (200.0, 12.0)])
def test_ctra_stays_on_a_circle(radius_m, speed_mps) -> None:
    batch = circling(radius_m, speed_mps)
    angle = speed_mps / radius_m * TIMES_S
    xy_m = make_ctra().predict(batch).xy_m[0, 0]
    assert turn_rate_of(batch)[0] == pytest.approx(speed_mps / radius_m)
    assert xy_m == pytest.approx(radius_m * np.stack((np.cos(angle), np.sin(angle)), axis=-1), abs=1e-3)


def test_ca_leaves_the_circle_along_its_tangent() -> None:
    xy_m = make_ca().predict(circling(20.0, 6.0)).xy_m[0, 0]
    assert xy_m == pytest.approx(np.stack((np.full(25, 20.0), 6.0 * TIMES_S), axis=-1), abs=1e-6)


@pytest.mark.parametrize("make", [make_ca, make_ctra])
def test_an_acceleration_goes_on(make) -> None:
    batch = one(NOWHERE, 0.0, 0.0, 5.0, 0.8, 0.3)
    assert acceleration_of(batch)[0] == pytest.approx(0.8)
    way = batch.speed_mps[0] * TIMES_S + 0.4 * TIMES_S**2
    expected = batch.xy_m[0] + way[:, None] * np.array([np.cos(0.3), np.sin(0.3)])
    assert make().predict(batch).xy_m[0, 0] == pytest.approx(expected, abs=1e-3)


def test_a_vehicle_that_brakes_stops() -> None:
    batch = one(NOWHERE, 0.0, 0.0, 8.0, -2.0)
    now = batch.speed_mps[0]
    assert 0.0 < now < 4.0
    away_m = make_ctra().predict(batch).xy_m[0, 0, :, 0] - batch.xy_m[0, 0]
    assert away_m[-1] == pytest.approx(now**2 / 4.0, abs=1e-2)
    assert (np.diff(away_m) >= 0.0).all()


def test_a_vehicle_that_stands_stays() -> None:
    batch = one(NOWHERE, 3.0, 4.0, 0.0)
    assert make_ctra().predict(batch).xy_m[0, 0] == pytest.approx(np.tile([3.0, 4.0], (25, 1)))


@pytest.mark.parametrize(
    ("make", "gained_m"),
    [
        (make_cv_lane, 0.0 * TIMES_S),
        (make_ca_lane, 0.5 * TIMES_S**2),
        (make_decay_lane, TIMES_S - 1.0 + np.exp(-TIMES_S)),
    ],
)
def test_ways_along_a_straight_lane(straight_road, make, gained_m) -> None:
    """Of a vehicle that gains 1 m/s in each second: the integral of its speed, twice of the acceleration."""
    batch = one(straight_road, 10.0, -5.0, 2.0, 1.0)
    away_m = make().predict(batch).xy_m[0, 0] - batch.xy_m[0]
    assert away_m[:, 0] == pytest.approx(batch.speed_mps[0] * TIMES_S + gained_m, abs=2e-3)
    assert away_m[:, 1] == pytest.approx(0.0, abs=1e-9), "the offset from the centre line stays"


def test_braking_ends_in_a_stop_unless_it_decays_before(straight_road) -> None:
    """At 2 m/s and −2 m/s²: constant braking stops after 1 m; decayed braking takes 2 m/s off in all time."""
    batch = one(straight_road, 10.0, -5.0, 8.0, -2.0)
    assert batch.speed_mps[0] == pytest.approx(2.0)
    ends_m = [
        float(make().predict(batch).xy_m[0, 0, -1, 0] - batch.xy_m[0, 0]) for make in (make_ca_lane, make_decay_lane)
    ]
    assert ends_m == pytest.approx([1.0, 10.0 - 2.0 * (4.0 + np.exp(-5.0))], abs=1e-2)


def test_a_vehicle_follows_the_bend_of_its_lane(crossroads) -> None:
    """In no lane it goes straight ahead; in one it stays at its offset."""
    batch = one(crossroads, 500.0, 500.0, 5.0, 0.0, 0.5)
    expected = batch.xy_m[0] + 5.0 * TIMES_S[:, None] * np.array([np.cos(0.5), np.sin(0.5)])
    assert make_cv_lane().predict(batch).xy_m[0, 0] == pytest.approx(expected, abs=1e-6)


def sample(*values: float) -> SampleBatch:
    return samples_of(record_with({1: moving(*values, steps=161)}, NOWHERE), HistoryWindow(), Population.ALL).batch


def test_constant_velocity_is_found_and_continued() -> None:
    batch = sample(0.0, 0.0, 7.0, 0.0, 0.4)
    answer = ImmPredictor().predict(batch)
    expected = batch.xy_m[0] + 7.0 * TIMES_S[:, None] * np.array([np.cos(0.4), np.sin(0.4)])
    assert answer.xy_m[0] == pytest.approx(np.stack((expected, expected)), abs=1e-6)


def test_a_strong_acceleration_is_found_and_is_the_more_probable_model() -> None:
    batch = sample(0.0, 0.0, 2.0, 4.0)
    answer = ImmPredictor().predict(batch)
    assert answer.probability[0, 0] > 0.7
    speed = batch.speed_mps[0]
    assert answer.xy_m[0, 0, -1, 0] - batch.xy_m[0, 0] == pytest.approx(5.0 * speed + 0.5 * 4.0 * 25.0, rel=0.1)


def test_braking_ends_in_a_stop() -> None:
    batch = sample(0.0, 0.0, 13.0, -4.0)
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
