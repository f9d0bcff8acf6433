"""Rows of made scores: where ours are the paper's, where they are not, where there are none."""

import numpy as np
import pytest
from made_scores import episode_scores, model_scores

from siren_ros.evaluation.paper_comparison.compared import HEAD, Compared, measured
from siren_ros.evaluation.paper_comparison.prediction_rows import (
    RANKING,
    RATIO,
    SAMPLES,
    own_level_only,
    prediction_rows,
)
from siren_ros.evaluation.prediction.reports.paper_results import PAPER_SAMPLES, TEMPLATES, paper_row
from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores
from siren_ros.evaluation.statistics.interval import NOTHING, Interval
from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.scenario.templates import load_template

ROW = paper_row("cv", "ade_m")


def own(template: str) -> str:
    return load_template(template).level.name


def episode(template: str, value: float, seed: int, samples: int = 4) -> EpisodeScores:
    """CV with one error everywhere, IDM with twice that."""
    models = {name: model_scores(np.full(samples, factor * value)) for name, factor in (("cv", 1.0), ("idm", 2.0))}
    return episode_scores(template, models, seed, EmergencyLevel[own(template)])


def rows_of(scores: list[EpisodeScores]) -> dict[tuple[str, str, str], Compared]:
    return {(row.table, row.row, row.column): row for row in prediction_rows(score_table(scores))}


def test_the_papers_own_values_give_no_deviation_and_its_ranking() -> None:
    assert ROW is not None
    rows = rows_of(
        [
            episode(name, ROW.by_template[name] + shift, seed)
            for name in TEMPLATES
            for seed, shift in enumerate((-0.1, -0.05, 0.0, 0.05, 0.1))
        ]
    )
    for name in TEMPLATES:
        row = rows["ADE in m", "CV", name]
        assert row.ours.value == pytest.approx(row.paper)
        assert row.inside is True
        assert row.deviation == pytest.approx(0.0, abs=1e-9)
    ranking = rows[RANKING, "CV", "Spearman"].ours
    assert ranking.value == pytest.approx(1.0)
    assert ranking.high == pytest.approx(1.0)
    assert ranking.low < 1.0, "S3's and S7's means are 0.11 m apart, and their intervals overlap"
    ratio = rows[RATIO, "IDM", "mean"]
    assert ratio.paper == pytest.approx(1.86 / 1.44)
    assert (ratio.ours.value, ratio.ours.low, ratio.ours.high) == pytest.approx((2.0, 2.0, 2.0))


def test_samples_are_those_of_an_episode() -> None:
    rows = rows_of([episode("S2", 1.0, seed, 900 + 50 * seed) for seed in range(5)])
    row = rows[SAMPLES, "all vehicles", "S2"]
    assert (row.paper, row.ours.value) == (PAPER_SAMPLES["S2"], 1000.0)
    assert row.cells()[3:6] == ("1371", "1000 [902, 1098]", "-27%"), "t of 4 is 2.776, the error 50·√(2.5 / 5)"
    assert not rows[SAMPLES, "all vehicles", "S1"].ours.valid


def test_what_was_not_measured_is_still_told() -> None:
    rows = rows_of([episode("S2", 1.0, 0)])
    assert rows["ADE in m", "BAT", "S1"].cells()[3:] == ("9.14", "-", "", "")
    assert rows["minADE6 in m", "EMP-M", "mean"].paper == 0.74
    assert ("minADE6 in m", "CV", "mean") not in rows, "the paper's table has the predictors with several paths only"
    assert not rows[RANKING, "CV", "Spearman"].ours.valid, "one template has no rank"
    shown = measured(list(rows.values()))
    assert {row.column for row in shown} == {"S2", "mean"}
    assert len(HEAD) == len(shown[0].cells())


def test_the_papers_numbers_of_all_tables_are_there() -> None:
    rows = rows_of([episode("S2", 1.0, 0)])
    tables = [key[0] for key in rows]
    # Nine models with seven templates and a mean; four models in the tables of minima.
    assert [tables.count(name) for name in ("ADE in m", "FDE in m", "RMSE at 5 s in m")] == [72, 72, 72]
    assert [tables.count(name) for name in ("minADE6 in m", "minFDE6 in m")] == [32, 32]
    assert sum(PAPER_SAMPLES.values()) == 7062


def test_an_episode_without_samples_does_not_count() -> None:
    scores = [episode(name, 1.0 + place, seed) for place, name in enumerate(TEMPLATES[:3]) for seed in (0, 1)]
    found = rows_of([*scores, episode("S4", 9.0, 0, samples=0)])
    assert found[RANKING, "IDM", "Spearman"].ours.blocks == 6
    assert found[RATIO, "IDM", "mean"].ours.value == pytest.approx(2.0)


def test_only_episodes_at_their_own_level_count() -> None:
    at_other = episode_scores("S2", {"cv": model_scores(np.ones(2))}, 0, EmergencyLevel.L3)
    not_in_the_paper = episode_scores("S9", {"cv": model_scores(np.ones(2))}, 0, EmergencyLevel.L2)
    kept = episode("S2", 1.0, 0)
    assert own_level_only([at_other, kept, not_in_the_paper], own) == [kept]


def test_a_row_says_nothing_that_it_cannot() -> None:
    assert Compared("t", "r", "c", 0.0, Interval(1.0, 0.5, 1.5, 3)).deviation is None
    assert Compared("t", "r", "c", 1.0, Interval(0.5, 0.4, 0.6, 3), relative=False).deviation is None
    single = Compared("t", "r", "c", 1.0, Interval(0.5, 0.5, 0.5, 1))
    assert (single.inside, single.deviation) == (None, -0.5)
    assert Compared("t", "r", "c", 1.0, NOTHING).to_json()["ours"] is None


def unequal(template: str, cv: list[float], idm: list[float], seed: int = 0) -> EpisodeScores:
    """An episode with an error for each sample of both."""
    models = {"cv": model_scores(np.array(cv)), "idm": model_scores(np.array(idm))}
    return episode_scores(template, models, seed, EmergencyLevel[own(template)])


def test_the_ratio_is_that_of_means_over_templates_of_means_over_their_samples() -> None:
    """CV: 2 in S1, and 4 in S2; IDM: 5 and 4. An episode in which IDM has no sample counts for neither."""
    scores = [
        unequal("S1", [1.0, 1.0], [4.0, 4.0]),
        unequal("S1", [4.0], [7.0], 1),
        unequal("S2", [4.0, 4.0, 4.0], [4.0, 4.0, 4.0]),
        unequal("S2", [90.0], [], 1),
    ]
    rows = rows_of(scores)
    ratio = rows[RATIO, "IDM", "mean"]
    assert ratio.ours.value == pytest.approx((5.0 + 4.0) / (2.0 + 4.0))
    assert ratio.ours.blocks == 3
    assert not rows[RATIO, "CSP", "mean"].ours.valid
    assert rows["ADE in m", "CV", "S1"].ours.value == pytest.approx(2.0)


def test_a_ranking_that_is_the_papers_upside_down() -> None:
    assert ROW is not None
    scores = [
        unequal(name, [10.0 - ROW.by_template[name]], [ROW.by_template[name] ** 2], seed)
        for name in TEMPLATES[:4]
        for seed in (0, 1)
    ]
    rows = rows_of(scores)
    assert rows[RANKING, "CV", "Spearman"].ours.value == pytest.approx(-1.0)
    # The paper's own IDM has S3 before S4, as CV has.
    assert rows[RANKING, "IDM", "Spearman"].ours.value == pytest.approx(1.0)
    assert rows[RANKING, "CV", "Spearman"].deviation is None
