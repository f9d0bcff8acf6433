import numpy as np
import pytest
from made_scores import episode_scores, five_episodes, model_scores

from siren_ros.evaluation.prediction.reports.paper_comparison import compare_with_paper
from siren_ros.evaluation.prediction.reports.paper_results import PAPER, TEMPLATES
from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.evaluation.prediction.scoring.categories import Category
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores


def with_ade(template: str, *values: float, seed: int = 0) -> EpisodeScores:
    """An episode with a sample for each value."""
    return episode_scores(template, {"cv": model_scores(np.array(values))}, seed)


def test_samples_are_pooled_within_templates_and_templates_count_once() -> None:
    table = score_table([with_ade("S1", 1.0, 1.0, 1.0), with_ade("S1", 5.0, seed=1), with_ade("S2", 10.0)])
    assert table.value("cv", "S1", "ade_m") == pytest.approx(2.0)
    assert table.value("cv", "S2", "ade_m") == pytest.approx(10.0)
    assert table.value("cv", "all", "ade_m") == pytest.approx(6.0)
    cell = table.cells["cv", "all", "ade_m"]
    assert (cell.samples, cell.interval.blocks) == (5, 3)
    assert not cell.interval.bounded, "S2 has one episode"
    assert not table.cells["cv", "S2", "ade_m"].interval.bounded, "one episode"


def test_an_interval_is_over_episodes() -> None:
    found = score_table(five_episodes()).cells["cv", "S1", "ade_m"].interval
    assert (found.low, found.high) == pytest.approx((1.0368, 4.9632), abs=1e-4)


def test_roots_are_taken_by_template() -> None:
    table = score_table([with_ade("S1", 9.0), with_ade("S2", 1.0, 31.0)])
    assert table.value("cv", "all", "rmse_5s_m") == pytest.approx(3.5)


def test_categories_count_their_samples_alone() -> None:
    models = [{"cv": model_scores(np.array([value]), category)} for value, category in ((1.0, 1), (4.0, 2), (8.0, 2))]
    table = score_table([episode_scores("S1", one, seed) for seed, one in enumerate(models)])
    assert table.value("cv", Category.YIELDING.name.lower(), "ade_m") == 1.0
    assert table.value("cv", Category.HELD.name.lower(), "ade_m") == 6.0
    assert table.value("cv", Category.EMV.name.lower(), "ade_m") is None


def test_an_episode_without_samples_does_not_count() -> None:
    table = score_table([with_ade("S1"), with_ade("S2", 2.0)])
    assert table.value("cv", "S1", "ade_m") is None
    assert table.value("cv", "all", "ade_m") == 2.0


def test_coverage_is_the_share_of_the_population() -> None:
    table = score_table([episode_scores("S1", {"net": model_scores(np.ones(3), wanted=4)})])
    assert table.samples["net"].coverage == 0.75
    assert table.samples["net"].wanted == 4


def test_the_papers_own_values_agree_with_the_paper() -> None:
    values = PAPER["cv", "ade_m"].by_template
    found = compare_with_paper(score_table([with_ade(name, values[name]) for name in TEMPLATES]), "cv", "ade_m")
    assert found is not None
    assert found.mean == pytest.approx(1.44, abs=0.005)
    assert found.deviation == pytest.approx(0.0, abs=0.003)
    assert found.paper_mean == found.paper_mean_same_templates == 1.44
    assert found.ranking is not None
    assert found.ranking.rho == pytest.approx(1.0)


def test_templates_that_the_paper_does_not_have() -> None:
    table = score_table([with_ade("S1", 2.0), with_ade("S2", 5.0), with_ade("mine", 9.0)])
    found = compare_with_paper(table, "cv", "ade_m")
    assert found is not None
    assert found.deviation == pytest.approx(16.0 / 3.0 / 1.44 - 1.0)
    assert found.paper_mean_same_templates == pytest.approx(1.40)
    assert found.deviation_same_templates == pytest.approx(3.5 / 1.4 - 1.0)
    assert found.ranking is None, "two templates in common are no ranking"
    assert compare_with_paper(table, "cv", "miss_rate_6") is None
