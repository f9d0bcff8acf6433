import numpy as np
import pytest
from made_scores import episode_scores, model_scores

from siren_ros.evaluation.prediction.reports.differences import Difference, common_rows, differences
from siren_ros.evaluation.prediction.reports.sample_table import sample_table
from siren_ros.evaluation.prediction.reports.score_table import score_table


def found(values: dict[str, list[list[float]]], metric: str = "ade_m", group: str = "all") -> list[Difference]:
    """Differences of models, whose values are given by episode."""
    count = len(next(iter(values.values())))
    scores = [
        episode_scores("S1", {model: model_scores(np.array(given[number])) for model, given in values.items()}, number)
        for number in range(count)
    ]
    return [one for one in differences(score_table(scores)) if one.metric == metric and one.group == group]


def test_a_model_that_is_always_better() -> None:
    base = [[float(seed), seed + 2.0] for seed in range(8)]
    (one,) = found({"a": base, "b": [[value + 0.5 for value in row] for row in base]})
    assert (one.first, one.second, one.samples) == ("a", "b", 16)
    assert (one.difference.value, one.difference.low, one.difference.high) == pytest.approx((-0.5, -0.5, -0.5))
    assert one.p_value == pytest.approx(2.0 / 256.0)


def test_models_are_compared_on_the_samples_that_both_have() -> None:
    """The second has no more than the first sample of each episode."""
    (one,) = found({"a": [[1.0, 9.0], [1.0, 9.0]], "b": [[2.0], [2.0]]})
    assert one.difference.value == pytest.approx(-1.0)
    assert one.samples == 2


def test_without_common_samples_there_is_no_difference() -> None:
    (one,) = found({"a": [[1.0], [1.0]], "b": [[], []]})
    assert not one.difference.valid
    assert one.p_value == 1.0


def test_three_models_are_three_tests() -> None:
    base = np.arange(10.0)
    models = {name: [[value + shift] for value in base] for name, shift in (("a", 0.0), ("b", 1.0), ("c", 2.0))}
    pairs = found(models)
    assert [(one.first, one.second) for one in pairs] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert all(one.adjusted_p_value == pytest.approx(3.0 * one.p_value) for one in pairs)


def test_rows_of_common_samples_are_in_the_same_order() -> None:
    scores = [
        episode_scores("S1", {"a": model_scores(np.arange(3.0)), "b": model_scores(np.arange(2.0))}, 0),
        episode_scores("S1", {"a": model_scores(np.arange(1.0)), "b": model_scores(np.arange(4.0))}, 1),
    ]
    one, two = sample_table(scores, "a"), sample_table(scores, "b")
    rows = common_rows(one, two)
    assert [side.tolist() for side in rows] == [[0, 1, 3], [0, 1, 2]]
    assert np.array_equal(one.key[rows[0]], two.key[rows[1]])
