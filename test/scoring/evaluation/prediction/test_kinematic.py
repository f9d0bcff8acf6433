import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.scoring.evaluation.prediction.kinematic import acceleration_of, make_ca, make_ctra, turn_rate_of
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


def circling(radius_m: float, speed_mps: float) -> SampleBatch:
    """A vehicle on a circle around the origin, counter-clockwise, now at angle 0 and heading north."""
    batch = one(0.0, 0.0, speed_mps)
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
    batch = one(0.0, 0.0, 5.0, 0.8, 0.3)
    assert acceleration_of(batch)[0] == pytest.approx(0.8)
    way = batch.speed_mps[0] * TIMES_S + 0.4 * TIMES_S**2
    expected = batch.xy_m[0] + way[:, None] * np.array([np.cos(0.3), np.sin(0.3)])
    assert make().predict(batch).xy_m[0, 0] == pytest.approx(expected, abs=1e-3)


def test_a_vehicle_that_brakes_stops() -> None:
    batch = one(0.0, 0.0, 8.0, -2.0)
    now = batch.speed_mps[0]
    assert 0.0 < now < 4.0
    away_m = make_ctra().predict(batch).xy_m[0, 0, :, 0] - batch.xy_m[0, 0]
    assert away_m[-1] == pytest.approx(now**2 / 4.0, abs=1e-2)
    assert (np.diff(away_m) >= 0.0).all()


def test_a_vehicle_that_stands_stays() -> None:
    batch = one(3.0, 4.0, 0.0)
    assert make_ctra().predict(batch).xy_m[0, 0] == pytest.approx(np.tile([3.0, 4.0], (25, 1)))
