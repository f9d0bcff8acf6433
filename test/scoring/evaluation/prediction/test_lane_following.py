import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.scoring.evaluation.prediction.lane_following import make_ca_lane, make_cv_lane, make_decay_lane
from siren_ros.scoring.evaluation.prediction.samples import (
    HistoryWindow,
    Population,
    SampleBatch,
    future_times_s,
    samples_of,
)

TIMES_S = future_times_s()


def one(network, *values: float) -> SampleBatch:
    return samples_of(record_with({1: moving(*values, steps=161)}, network), HistoryWindow(), Population.ALL).batch


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
