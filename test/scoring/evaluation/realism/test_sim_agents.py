"""Terms of the Sim Agents Challenge: closed-form likelihoods, features of plain motions, an independent reference."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.realism.sim_agents import TERMS, AgentTracks, features_of, score_sim_agents

ROAD = shapely.box(-500.0, -10.0, 500.0, 10.0)
STEPS = 40


def tracks(*lines: tuple[float, float, float], steps: int = STEPS) -> AgentTracks:
    """Cars of 4 by 2 m that drive along x: start, offset, speed."""
    times = 0.1 * np.arange(steps)
    x = np.stack([start + speed * times for start, _, speed in lines])
    y = np.stack([np.full(steps, offset) for _, offset, _ in lines])
    size = np.ones_like(x)
    return AgentTracks(x, y, np.zeros_like(x), 4.0 * size, 2.0 * size, np.ones(x.shape, dtype=bool))


BOTH = np.array([True, True])


def test_features_of_a_car_that_comes_up_to_another() -> None:
    found = features_of(tracks((0.0, 0.0, 10.0), (30.0, 0.0, 5.0)), BOTH, ROAD)
    inner = slice(1, -1)
    assert found["linear_speed"][0, inner] == pytest.approx(10.0)
    assert np.isnan(found["linear_speed"][:, [0, -1]]).all()
    assert found["linear_acceleration"][0, 2:-2] == pytest.approx(0.0, abs=1e-9)
    assert found["distance_to_nearest_object"][0, 0] == pytest.approx(26.0)
    gap_m = 26.0 - 5.0 * 0.1 * np.arange(STEPS)
    assert found["time_to_collision"][0, inner] == pytest.approx(np.minimum(gap_m / 5.0, 5.0)[inner])
    assert found["time_to_collision"][1] == pytest.approx(5.0)
    assert found["distance_to_road_edge"][0, 5] == pytest.approx(-9.0)
    assert found["collision_indication"].tolist() == found["offroad_indication"].tolist() == [0.0, 0.0]


def test_bodies_that_overlap_and_corners_off_the_road_are_seen() -> None:
    found = features_of(tracks((0.0, 9.5, 0.0), (3.0, 9.5, 0.0)), BOTH, ROAD)
    assert found["distance_to_nearest_object"][0, 0] == pytest.approx(-1.0)
    assert found["collision_indication"].tolist() == [1.0, 1.0]
    assert found["distance_to_road_edge"][0, 0] == pytest.approx(0.5)
    assert found["offroad_indication"].tolist() == [1.0, 1.0]
    met = tracks((0.0, 0.0, 0.0), (3.0, 0.0, 0.0))
    gone = replace(met, present=np.stack((met.present[0], np.zeros(STEPS, dtype=bool))))
    assert features_of(gone, np.array([True, False]), ROAD)["collision_indication"].tolist() == [0.0]


def test_likelihood_of_the_record_under_itself_is_that_of_full_bins() -> None:
    """One of 10 bins holds all of 38 x 2 speeds of both rollouts: (76 + 0.1) / (76 + 1)."""
    logged = tracks((0.0, 0.0, 11.0), (60.0, 0.0, 11.0))
    scores = score_sim_agents(logged, [logged, logged], BOTH, ROAD)
    assert scores["linear_speed"] == pytest.approx(76.1 / 77.0)
    assert scores["collision_indication"] == pytest.approx(2.001 / 2.002)
    assert scores["min_ade_m"] == 0.0
    assert scores["score"] == pytest.approx(sum(histogram.weight * scores[name] for name, histogram in TERMS.items()))
    weights = {"distance_to_nearest_object": 0.1, "collision_indication": 0.25, "time_to_collision": 0.1}
    weighted = sum(weight * scores[name] for name, weight in weights.items())
    assert scores["interactive"] == pytest.approx(weighted / 0.45)
    assert sum(histogram.weight for histogram in TERMS.values()) == pytest.approx(1.0)


def test_another_speed_and_a_red_line_that_nobody_crossed_cost_their_terms_alone() -> None:
    logged = tracks((0.0, 0.0, 11.0), (60.0, 0.0, 11.0))
    own = score_sim_agents(logged, [logged], BOTH, ROAD)
    red = np.zeros(logged.present.shape, dtype=bool)
    red[:, 7] = True
    crossing = score_sim_agents(logged, [replace(logged, red_crossed=red)], BOTH, ROAD)
    assert crossing["traffic_light_violation"] == pytest.approx(0.001 / 1.002)
    assert {name for name in TERMS if own[name] != crossing[name]} == {"traffic_light_violation"}
    faster = score_sim_agents(logged, [tracks((0.0, 0.0, 16.0), (60.0, 0.0, 16.0))], BOTH, ROAD)
    assert faster["linear_speed"] == pytest.approx(0.1 / 39.0)
    assert faster["angular_speed"] == own["angular_speed"]


def test_rollouts_of_another_shape_are_refused() -> None:
    logged = tracks((0.0, 0.0, 10.0))
    for rollouts in ([], [tracks((0.0, 0.0, 10.0), steps=3)]):
        with pytest.raises(InputError):
            score_sim_agents(logged, rollouts, np.array([True]), ROAD)
    with pytest.raises(InputError):
        score_sim_agents(logged, [logged], np.array([False]), ROAD)
    with pytest.raises(InputError):
        replace(logged, y_m=logged.y_m[:, :-1])


def reference(logged: AgentTracks, rollouts: list[AgentTracks]) -> dict[str, float]:
    """The kinematic terms once more, with NumPy's own histograms."""

    def rate(values: np.ndarray) -> np.ndarray:
        return np.pad((values[:, 2:] - values[:, :-2]) / 0.2, ((0, 0), (1, 1)), constant_values=np.nan)

    def of(one: AgentTracks) -> dict[str, np.ndarray]:
        speed, turn = np.hypot(rate(one.x_m), rate(one.y_m)), rate(np.unwrap(one.yaw_rad))
        rates = {"linear_speed": speed, "linear_acceleration": rate(speed)}
        return {**rates, "angular_speed": turn, "angular_acceleration": rate(turn)}

    real, made = of(logged), [of(one) for one in rollouts]
    terms = {}
    for name, values in real.items():
        histogram, logs = TERMS[name], []
        edges = np.linspace(histogram.low, histogram.high, histogram.bins + 1)
        for agent in range(len(values)):
            pool = np.concatenate([one[name][agent] for one in made])
            counts = np.histogram(np.clip(pool[~np.isnan(pool)], edges[0], edges[-1]), edges)[0] + histogram.smoothing
            for value in np.clip(values[agent][~np.isnan(values[agent])], edges[0], edges[-1]):
                bin_of = int(np.flatnonzero(np.histogram([value], edges)[0])[0])
                logs.append(np.log(counts[bin_of] / counts.sum()))
        terms[name] = float(np.exp(np.mean(logs)))
    return terms


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31))
def test_kinematic_terms_equal_an_independent_computation(seed: int) -> None:
    rng = np.random.default_rng(seed)

    def walk() -> AgentTracks:
        one = tracks((0.0, 0.0, 8.0), (40.0, 3.0, 6.0))
        x, y = (column + np.cumsum(rng.normal(scale=0.1, size=column.shape), axis=1) for column in (one.x_m, one.y_m))
        return replace(one, x_m=x, y_m=y, yaw_rad=np.cumsum(rng.normal(scale=0.02, size=x.shape), axis=1))

    logged, rollouts = walk(), [walk() for _ in range(4)]
    found = score_sim_agents(logged, rollouts, BOTH, ROAD)
    for name, value in reference(logged, rollouts).items():
        assert found[name] == pytest.approx(value, abs=1e-6), name
