import numpy as np
import pytest
from made_scores import episode_scores, model_scores

from siren_ros.evaluation.prediction.reports.groups import GroupKind, groups_of
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores
from siren_ros.scenario.levels import EmergencyLevel

ONE = {"cv": model_scores(np.ones(3))}


def names(scores: list[EpisodeScores], kind: GroupKind) -> dict[str, list[bool]]:
    return {group.name: group.episodes.tolist() for group in groups_of(scores) if group.kind is kind}


def test_templates_and_levels_part_the_episodes() -> None:
    scores = [
        episode_scores("S2", ONE, level=EmergencyLevel.L2),
        episode_scores("S1", ONE, level=EmergencyLevel.L3),
        episode_scores("S2", ONE, 1, EmergencyLevel.L1),
    ]
    assert names(scores, GroupKind.TEMPLATE) == {"S1": [False, True, False], "S2": [True, False, True]}
    assert list(names(scores, GroupKind.LEVEL)) == ["L1", "L2", "L3"]
    assert list(names(scores, GroupKind.CATEGORY)) == ["emv", "yielding", "held", "other"]


def test_a_parameter_with_few_values_has_a_row_for_each() -> None:
    scores = [episode_scores("S2", ONE, seed, vehicles=value) for seed, value in enumerate((3.0, 4.0, 3.0))]
    scores.append(episode_scores("S1", ONE, vehicles=9.0))
    assert names(scores, GroupKind.PARAMETER) == {
        "S2 vehicles 3": [True, False, True, False],
        "S2 vehicles 4": [False, True, False, False],
    }


def test_a_parameter_with_many_values_has_three_ranges() -> None:
    scores = [episode_scores("S2", ONE, seed, speed_mps=float(seed)) for seed in range(9)]
    found = names(scores, GroupKind.PARAMETER)
    assert list(found) == ["S2 speed_mps 0 to 2", "S2 speed_mps 3 to 5", "S2 speed_mps 6 to 8"]
    assert np.sum(list(found.values()), axis=0).tolist() == [1] * 9


@pytest.mark.parametrize("values", [(4.0, 4.0, 4.0), (4.0,)])
def test_a_parameter_that_does_not_vary_has_none(values: tuple[float, ...]) -> None:
    scores = [episode_scores("S2", ONE, seed, speed_mps=value) for seed, value in enumerate(values)]
    assert names(scores, GroupKind.PARAMETER) == {}
