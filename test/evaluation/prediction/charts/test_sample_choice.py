from dataclasses import replace

import numpy as np
from made_scores import episode_scores, model_scores

from siren_ros.evaluation.prediction.charts.sample_choice import chosen_samples
from siren_ros.evaluation.prediction.reports.score_table import score_table


def test_best_median_and_worst_of_all_episodes_of_a_template() -> None:
    first, second = model_scores(np.array([5.0, 1.0, 3.0])), model_scores(np.array([2.0, 9.0]))
    table = score_table([episode_scores("S1", {"cv": first}), episode_scores("S1", {"cv": second}, 1)])
    found = list(chosen_samples(table))
    assert [(one.rank, one.ade_m, one.episode, one.step) for one in found] == [
        ("best", 1.0, 0, 2),
        ("median", 3.0, 0, 4),
        ("worst", 9.0, 1, 2),
    ]
    assert {one.actor_id for one in found} == {1}


def test_vehicles_that_stand_are_not_drawn() -> None:
    scores = replace(model_scores(np.array([0.0, 4.0, 6.0])), moved_m=np.array([0.0, 5.0, 30.0]))
    still = replace(model_scores(np.array([0.0])), moved_m=np.array([4.9]))
    table = score_table([episode_scores("S1", {"cv": scores}), episode_scores("S2", {"cv": still})])
    assert [(one.template, one.rank, one.ade_m) for one in chosen_samples(table)] == [
        ("S1", "best", 4.0),
        ("S1", "median", 6.0),
        ("S1", "worst", 6.0),
    ]
