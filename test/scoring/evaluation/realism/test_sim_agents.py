"""Terms of the Sim Agents Challenge: closed-form likelihoods, and features of plain motions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from busy_record import busy_record
from known_outputs import assert_known

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.realism.sim_agent_scenes import means_of_scenes, scores_of_episode
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


def test_rollouts_of_another_shape_are_refused() -> None:
    logged = tracks((0.0, 0.0, 10.0))
    for rollouts in ([], [tracks((0.0, 0.0, 10.0), steps=3)]):
        with pytest.raises(InputError):
            score_sim_agents(logged, rollouts, np.array([True]), ROAD)
    with pytest.raises(InputError):
        score_sim_agents(logged, [logged], np.array([False]), ROAD)
    with pytest.raises(InputError):
        replace(logged, y_m=logged.y_m[:, :-1])


def test_steps_at_which_an_agent_is_absent_do_not_count() -> None:
    """At 11 m/s while it is there, and at 16 m/s then; of three rollouts of 38 speeds each one is at 16 m/s."""
    there = np.arange(STEPS)[None] < 20
    logged, fast = tracks((0.0, 0.0, 11.0)), tracks((0.0, 0.0, 16.0))
    gone = replace(logged, x_m=np.where(there, logged.x_m, fast.x_m), present=there)
    scores = score_sim_agents(gone, [logged, fast, logged], BOTH[:1], ROAD)
    assert scores["linear_speed"] == pytest.approx(76.1 / 115.0)
    assert scores["linear_acceleration"] == pytest.approx(108.1 / 109.1)
    assert scores["min_ade_m"] == 0.0


def test_every_score_of_a_busy_episode() -> None:
    assert_known(
        Path(__file__).parent / "known" / "sim_agents.json", means_of_scenes(scores_of_episode(busy_record())), digits=5
    )
