"""The paper's numbers next to ours."""

import json
from collections.abc import Iterable

import numpy as np
import pytest
from made_scores import episode_scores, model_scores
from made_video_sets import small_video_set

from siren_ros.base.tables import NOTHING, Interval
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.metrics import ERRORS
from siren_ros.scoring.evaluation.paper_comparison import (
    BALANCE,
    FAMILY,
    ORDER,
    RANKING,
    RATIO,
    SAMPLES,
    Compared,
    at_template_level,
    comparison_tables,
    detection_rows,
    measured,
    prediction_rows,
    risk_rows,
    stored,
)
from siren_ros.scoring.evaluation.prediction.reports.paper_results import PAPER, PAPER_SAMPLES
from siren_ros.scoring.evaluation.prediction.reports.score_table import score_table
from siren_ros.scoring.evaluation.prediction.scoring import EpisodeScores
from siren_ros.scoring.evaluation.scores import Score, single
from siren_ros.simulation.scenario.paper import TEMPLATES, EmergencyLevel
from siren_ros.simulation.scenario.templates import load_template

AROUND = Interval(3.0, 1.5, 4.5, 6)


def row(paper: float, ours: Interval = AROUND, digits: int = 2, *, relative: bool = True) -> Compared:
    return Compared("ADE in m", "CV", "S1", paper, ours, digits, relative)


@pytest.mark.parametrize(
    ("compared", "inside", "deviation", "cells"),
    [
        (row(2.0), True, 0.5, ["2.00", "3.00", "[1.50, 4.50]", "+50% *"]),
        (row(4.0, digits=1), True, -0.25, ["4.0", "3.0", "[1.5, 4.5]", "-25% *"]),
        (row(1.5), True, 1.0, ["1.50", "3.00", "[1.50, 4.50]", "+100% *"]),
        (row(4.5), True, -1 / 3, ["4.50", "3.00", "[1.50, 4.50]", "-33% *"]),
        (row(1.49), False, 1.51 / 1.49, ["1.49", "3.00", "[1.50, 4.50]", "+101%"]),
        (row(4.51), False, -1.51 / 4.51, ["4.51", "3.00", "[1.50, 4.50]", "-33%"]),
        (row(0.0), False, None, ["0.00", "3.00", "[1.50, 4.50]", "–"]),
        (row(2.0, relative=False), True, None, ["2.00", "3.00", "[1.50, 4.50]", "*"]),
        (row(2.0, NOTHING), None, None, ["2.00", "–"]),
        (row(1.0, Interval(0.5, 0.5, 0.5, 1)), None, -0.5, ["1.00", "0.50", "[–]", "-50%"]),
    ],
)
def test_a_row_says_whether_the_papers_value_lies_inside_and_how_far_ours_is_from_it(
    compared, inside, deviation, cells
) -> None:
    """The bounds belong to the interval; a star says that the paper's value lies inside."""
    assert compared.inside is inside
    assert compared.deviation == (None if deviation is None else pytest.approx(deviation))
    (table,) = comparison_tables([compared])
    assert (table.key, table.caption, table.head) == ("paper_0", "ADE in m", ("", "S1"))
    assert [value for _, value in table.cells()] == cells
    assert measured([compared]) == ([] if compared.ours is NOTHING else [compared])


def test_the_papers_rows_and_ours() -> None:
    rows = [
        Compared("ADE in m", "CV", "S1", 1.63, Interval(1.5, 1.4, 1.7, 5)),
        Compared("ADE in m", "CV", "mean", 1.44, Interval(2.0, 1.9, 2.1, 5)),
        Compared("ADE in m", "IDM", "S1", 2.23, Interval(2.23, 2.23, 2.23, 1)),
        Compared("mAP", "SECOND", "S3", 0.631, Interval(0.6, 0.5, 0.7, 6), digits=3),
        Compared("error ATE", "SECOND", "mean", 0.565, digits=3),
    ]
    first, second, third = comparison_tables(rows)
    assert (first.key, first.caption, first.head) == ("paper_0", "ADE in m", ("", "S1", "mean"))
    assert first.cells() == [
        ("CV, paper", "1.63", "1.44"),
        ("CV, here", "1.50", "2.00"),
        ("CV, 95 %", "[1.40, 1.70]", "[1.90, 2.10]"),
        ("CV, deviation", "-8% *", "+39%"),
        ("IDM, paper", "2.23", "–"),
        ("IDM, here", "2.23", "–"),
        ("IDM, 95 %", "[–]", "–"),
        ("IDM, deviation", "+0%", "–"),
    ]
    assert (second.key, second.head, second.cells()[1]) == ("paper_1", ("", "S3"), ("SECOND, here", "0.600"))
    assert (third.caption, third.cells()[1]) == ("Error ATE", ("SECOND, here", "–"))


def test_without_bounds_or_value_json_says_nothing() -> None:
    content = row(2.0).to_json()
    values = {"paper": 2.0, "ours": 3.0, "low": 1.5, "high": 4.5, "episodes": 6, "paper_inside": True}
    assert content.items() >= {**values, "deviation": pytest.approx(0.5)}.items()
    single = row(2.0, Interval(3.0, 3.0, 3.0, 14, scatter_known=False)).to_json()
    assert (single["ours"], single["low"], single["high"], single["episodes"]) == (3.0, None, None, 14)
    nothing = row(2.0, NOTHING).to_json()
    assert [nothing[name] for name in ("ours", "low", "high", "deviation", "paper_inside")] == [None] * 5


CV_ADE_M = PAPER["cv", "ade_m"]


def template_level(template: str) -> str:
    return load_template(template).level.name


def episode(template: str, value: float, seed: int, samples: int = 4) -> EpisodeScores:
    """CV with one error everywhere, IDM with twice that."""
    models = {name: model_scores(np.full(samples, factor * value)) for name, factor in (("cv", 1.0), ("idm", 2.0))}
    return episode_scores(template, models, seed, EmergencyLevel[template_level(template)])


def by_place(rows: Iterable[Compared]) -> dict[tuple[str, str, str], Compared]:
    return {(row.table, row.row, row.column): row for row in rows}


def rows_of(scores: list[EpisodeScores]) -> dict[tuple[str, str, str], Compared]:
    return by_place(prediction_rows(score_table(scores)))


def test_the_papers_own_values_give_no_deviation_and_its_ranking() -> None:
    shifts = enumerate((-0.1, -0.05, 0.0, 0.05, 0.1))
    rows = rows_of([episode(name, CV_ADE_M[name] + shift, seed) for seed, shift in shifts for name in TEMPLATES])
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


def test_samples_are_those_of_an_episode_and_one_without_does_not_count() -> None:
    rows = rows_of([episode("S2", 1.0, seed, 900 + 50 * seed) for seed in range(5)])
    row = rows[SAMPLES, "all vehicles", "S2"]
    assert (row.paper, row.ours.value) == (PAPER_SAMPLES["S2"], 1000.0)
    assert (row.ours.low, row.ours.high) == pytest.approx((902.0, 1098.0), abs=0.5), "t is 2.776, 50·√(2.5 / 5)"
    assert not rows[SAMPLES, "all vehicles", "S1"].ours.valid
    scores = [episode(name, 1.0 + place, seed) for place, name in enumerate(TEMPLATES[:3]) for seed in (0, 1)]
    rows = rows_of([*scores, episode("S4", 9.0, 0, samples=0)])
    assert rows[RANKING, "IDM", "Spearman"].ours.blocks == 6


def test_the_papers_numbers_of_all_tables_are_there_measured_or_not() -> None:
    """Nine models with seven templates and a mean; four models in the tables of minima: those with several paths."""
    rows = rows_of([episode("S2", 1.0, 0)])
    tables = [key[0] for key in rows]
    assert [tables.count(name) for name in ("ADE in m", "FDE in m", "RMSE at 5 s in m")] == [72, 72, 72]
    assert [tables.count(name) for name in ("minADE6 in m", "minFDE6 in m")] == [32, 32]
    assert sum(PAPER_SAMPLES.values()) == 7062
    assert (rows["ADE in m", "BAT", "S1"].paper, rows["minADE6 in m", "EMP-M", "mean"].paper) == (9.14, 0.74)
    assert not rows[RANKING, "CV", "Spearman"].ours.valid, "one template has no rank"
    shown = measured(list(rows.values()))
    assert {row.column for row in shown} == {"S2", "mean"}
    assert {table.head for table in comparison_tables(shown)} <= {("", "S2", "mean"), ("", "S2"), ("", "mean")}


def test_only_episodes_at_the_levels_of_their_templates_count() -> None:
    at_other = episode_scores("S2", {"cv": model_scores(np.ones(2))}, 0, EmergencyLevel.L3)
    not_in_the_paper = episode_scores("S9", {"cv": model_scores(np.ones(2))}, 0, EmergencyLevel.L2)
    kept = episode("S2", 1.0, 0)
    assert at_template_level([at_other, kept, not_in_the_paper], template_level) == [kept]


def unequal(template: str, cv: list[float], idm: list[float], seed: int = 0) -> EpisodeScores:
    """An episode with an error for each sample of both."""
    models = {"cv": model_scores(np.array(cv)), "idm": model_scores(np.array(idm))}
    return episode_scores(template, models, seed, EmergencyLevel[template_level(template)])


def test_the_ratio_is_that_of_means_over_templates_of_means_over_their_samples() -> None:
    """CV: 2 in S1, and 4 in S2; IDM: 5 and 4. An episode in which IDM has no sample counts for neither."""
    of_s1 = unequal("S1", [1.0, 1.0], [4.0, 4.0]), unequal("S1", [4.0], [7.0], 1)
    of_s2 = unequal("S2", [4.0, 4.0, 4.0], [4.0, 4.0, 4.0]), unequal("S2", [90.0], [], 1)
    rows = rows_of([*of_s1, *of_s2])
    ratio = rows[RATIO, "IDM", "mean"]
    assert ratio.ours.value == pytest.approx((5.0 + 4.0) / (2.0 + 4.0))
    assert ratio.ours.blocks == 3
    assert not rows[RATIO, "CSP", "mean"].ours.valid
    assert rows["ADE in m", "CV", "S1"].ours.value == pytest.approx(2.0)


def test_a_ranking_that_is_the_papers_upside_down() -> None:
    values = [(name, CV_ADE_M[name], seed) for name in TEMPLATES[:4] for seed in (0, 1)]
    rows = rows_of([unequal(name, [10.0 - value], [value**2], seed) for name, value, seed in values])
    assert rows[RANKING, "CV", "Spearman"].ours.value == pytest.approx(-1.0)
    # The paper's own IDM has S3 before S4, as CV has.
    assert rows[RANKING, "IDM", "Spearman"].ours.value == pytest.approx(1.0)
    assert rows[RANKING, "CV", "Spearman"].deviation is None


AP = Interval(0.4, 0.3, 0.5, 14)


def content_of(*rows: Score) -> dict[str, object]:
    return {"rows": [row.json() for row in rows]}


def detector(name: str, **values: float) -> list[Score]:
    """mAP, NDS and errors over all and of S1 and S2, by their metrics, and the mAP of a family."""
    groups = (("all", "all"), ("template", "S1"), ("template", "S2"))
    metrics = {"mAP": AP, "NDS": single(0.45), **dict.fromkeys(ERRORS, single(0.5))}
    metrics |= {metric: single(value) for metric, value in values.items()}
    rows = [Score(name, *group, metric, value, 10) for group in groups for metric, value in metrics.items()]
    return [*rows, Score(name, "family", "clearance", "mAP", AP, 10)]


def test_a_detector_of_the_papers_name_stands_next_to_it() -> None:
    rows = by_place(detection_rows(content_of(*detector("pointpillars", ATE=0.2, NDS=0.7))))
    row = rows["mAP", "PointPillars", "S1"]
    assert (row.paper, row.ours.value, row.inside) == (0.398, 0.4, True)
    assert [rows["NDS", "PointPillars", name].ours.value for name in ("S1", "S2", "mean")] == [0.7] * 3
    assert not rows["NDS", "PointPillars", "S1"].ours.bounded
    assert [rows[f"error {name}", "PointPillars", "mean"].ours.value for name in ("ATE", "ASE")] == [0.2, 0.5]
    assert not rows["mAP", "SECOND", "S1"].ours.valid
    assert not rows["mAP", "PointPillars", "S7"].ours.valid


def test_any_detector_is_held_against_the_families() -> None:
    rows = by_place(
        detection_rows(content_of(*detector("mine"), Score("mine", "order", "all", "share", single(0.25), 1000)))
    )
    clearance = rows[FAMILY, "mine", "clearance"]
    assert clearance.paper == pytest.approx(np.mean([0.398, 0.434, 0.420, 0.388, 0.438, 0.413, 0.424, 0.423]))
    assert clearance.ours.value == 0.4
    order = rows[ORDER, "mine", "share of the draws"]
    assert (order.paper, order.ours.value, order.deviation, order.inside) == (1.0, 0.25, None, None)


def test_without_scores_the_papers_numbers_remain_and_scores_without_rows_are_refused() -> None:
    rows = list(detection_rows(None))
    assert len(rows) == 4 * (2 * 8 + 5)
    assert not any(row.ours.valid for row in rows)
    for read in (detection_rows, lambda content: risk_rows(None, content)):
        with pytest.raises(InputError, match="rows of scores"):
            list(read({"pillars": {"mean": {}}}))


def test_the_balance_is_that_of_the_labels(tmp_path) -> None:
    rows = [row for row in risk_rows(small_video_set(tmp_path), None) if row.table == BALANCE]
    assert [row.paper for row in rows] == pytest.approx([74 / 105, 25 / 105, 6 / 105])
    assert [row.ours.value for row in rows] == pytest.approx([3 / 6, 2 / 6, 1 / 6])
    assert rows[0].ours.low < 0.5 < rows[0].ours.high
    assert [row.ours.blocks for row in rows] == [6, 6, 6]
    assert (rows[2].ours.low, rows[2].ours.high) == pytest.approx((0.0301, 0.5635), abs=1e-4), "Wilson's bounds"


def test_scores_of_the_papers_models_are_found_by_name() -> None:
    content = content_of(Score("Qwen3.5-9B", "all", "all", "accuracy", Interval(0.6, 0.5, 0.8, 20), 20))
    rows = {(row.row, row.column): row for row in risk_rows(None, content)}
    assert rows["Qwen3.5-9B", "accuracy"].inside is True
    (table,) = comparison_tables([rows["Qwen3.5-9B", "accuracy"]])
    assert table.cells()[0] == ("Qwen3.5-9B, paper", "0.705")
    assert not rows["Gemma3-12B", "accuracy"].ours.valid


def test_stored_scores_are_a_json_object(tmp_path) -> None:
    assert stored(tmp_path) is None
    file = tmp_path / "scores.json"
    file.write_text("[1]", encoding="utf-8")
    with pytest.raises(InputError, match="siren evaluate"):
        stored(tmp_path)
    file.write_text(json.dumps({"a": 1}), encoding="utf-8")
    assert stored(file) == stored(tmp_path) == {"a": 1}
