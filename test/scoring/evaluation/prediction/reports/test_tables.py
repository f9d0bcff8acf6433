"""The tables of made scores as a terminal shows them, with and without the paper."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from made_scores import episode_scores, model_scores, reported_scores

from siren_ros.base.tables.table import UNBOUNDED_NOTE, Table
from siren_ros.scoring.evaluation.prediction.reports.paper_results import PAPER, TEMPLATES
from siren_ros.scoring.evaluation.prediction.reports.report import (
    BAGS_MAX,
    NO_SAMPLES_TEXT,
    prediction_tables,
    text_report,
)
from siren_ros.scoring.evaluation.prediction.reports.score_table import differences, score_table
from siren_ros.scoring.evaluation.prediction.samples import Population
from siren_ros.scoring.evaluation.prediction.scoring import Category, EpisodeScores

REPORT = """
population: region (vehicles within 40 m in, 50 m out around the EMV for the whole window)
4 episodes; [95% intervals] over whole episodes

ADE/FDE in m by bag
bag        template  samples  cv          net:v_1
S1_seed0   S1 L3     1        1.50/4.50   2.00/6.00
S1_seed1   S1 L3     2        2.50/7.50   4.00/12.00
S2_seed0   S2 L2     2        4.00/12.00  6.00/18.00
own_seed0  own L2    1        8.00/24.00  16.00/48.00

ADE/FDE in m by template, [ADE's interval]
model    S1          S2          own          mean            samples  coverage
cv       2.10/6.30   4.00/12.00  8.00/24.00   4.70/14.10 [–]  10       all
net:v_1  3.33/10.00  6.00/18.00  16.00/48.00  8.44/25.33 [–]  6        60.0%

metrics of samples, mean over the templates
model    ADE   FDE    minADE6  minFDE6  RMSE@5s  MR6   b-minFDE6  Brier  collisions  calibration error
cv       4.70  14.10  2.35     7.05     19.45    0.87  –          –      –           –
net:v_1  8.44  25.33  4.22     12.67    34.51    1.00  –          –      –           0.25

ADE/FDE in m by category, [ADE's interval]
category  samples  cv              net:v_1
emv       6        4.67/14.00 [–]  7.50/22.50 [–]
other     4        4.75/14.25 [–]  6.50/19.50 [–]

ADE/FDE in m by subset, [ADE's interval]
subset     samples  cv              net:v_1
civilians  4        4.75/14.25 [–]  6.50/19.50 [–]

ADE/FDE in m by level, [ADE's interval]
level  samples  cv              net:v_1
L2     5        6.00/18.00 [–]  11.00/33.00 [–]
L3     5        2.10/6.30 [–]   3.33/10.00 [–]

ADE in m against the best simple baseline: the model minus the baseline, [interval]
model    template  best simple  its ADE  difference  share  p (Holm)
net:v_1  all       cv           4.70     +4.22 [–]   +90%   0.5
net:v_1  S1        cv           2.10     +1.67 [–]   +79%   1
net:v_1  S2        cv           4.00     +3.00 [–]   +75%   1
net:v_1  own       cv           8.00     +8.00 [–]   +100%  1

differences of ADE in m, on the samples that both models have
models        difference  p (Holm)  common samples
cv - net:v_1  -4.22 [–]   0.125     6
"""
WITH_THE_PAPER = """
ADE/FDE in m by template, [ADE's interval]
model                    S1          S2          S3          S4          S5         S6          S7         own          mean            samples  coverage
cv                       2.10/6.30   4.00/12.00  –/–         –/–         –/–        –/–         –/–        8.00/24.00   4.70/14.10 [–]  10       all
net:v_1                  3.33/10.00  6.00/18.00  –/–         –/–         –/–        –/–         –/–        16.00/48.00  8.44/25.33 [–]  6        60.0%
CV (paper)               1.63/4.30   1.17/3.11   0.96/2.40   0.68/1.65   1.95/5.03  2.86/7.56   0.85/2.08  –/–          1.44/3.73
IDM (paper)              2.23/5.14   1.58/3.75   1.18/2.69   1.04/2.18   2.68/6.49  3.29/8.34   1.06/2.55  –/–          1.86/4.45
CSP (paper)              2.63/6.12   3.57/7.79   2.92/6.65   2.54/5.83   3.25/7.10  4.63/9.69   1.82/4.02  –/–          3.05/6.74
STDAN (paper)            3.99/8.12   6.02/12.13  4.20/9.14   3.11/6.81   4.58/9.94  7.87/15.41  2.38/5.93  –/–          4.59/9.64
BAT (paper)              9.14/17.35  9.55/16.14  8.17/15.75  6.06/10.52  4.80/7.85  8.40/13.16  3.42/5.06  –/–          7.08/12.26
EMP-M (paper)            1.79/4.73   1.55/4.38   2.71/8.24   1.88/5.92   3.47/9.44  3.24/8.86   2.05/6.50  –/–          2.38/6.87
EMP-D (paper)            1.67/4.44   1.32/3.57   2.41/7.39   1.39/4.60   2.13/6.21  3.50/9.68   1.63/5.83  –/–          2.01/5.96
DeMo (paper)             1.65/4.47   1.58/4.60   2.26/7.00   1.26/4.08   2.72/7.80  3.57/9.96   1.05/4.03  –/–          2.01/5.99
DeMo+RealMotion (paper)  1.62/4.29   1.43/4.22   2.35/6.95   1.64/4.83   2.41/7.03  2.50/6.85   1.23/3.77  –/–          1.88/5.42
"""  # noqa: E501 - a table as a terminal shows it
PAPER_LINE = (
    "map: town (4); the paper's is Town10HD_Opt\n"
    "cv: mean ADE 4.70 m, +226% from the paper's 1.44 m, +118% from its 1.40 m over the same templates; "
    "Spearman rank correlation over the templates: needs 3 templates"
)


def tables_of(scores: Sequence[EpisodeScores], *, compare_paper: bool = False) -> dict[str, Table]:
    """The tables by their keys."""
    table = score_table(scores)
    return {of_key.key: of_key for of_key in prediction_tables(table, differences(table), compare_paper=compare_paper)}


def report(scores: Sequence[EpisodeScores], *, compare_paper: bool = False) -> str:
    tables = list(tables_of(scores, compare_paper=compare_paper).values())
    return "\n".join(text_report(score_table(scores), tables, compare_paper=compare_paper))


def test_without_the_paper() -> None:
    assert report(reported_scores()) == f"{REPORT.strip()}\n{UNBOUNDED_NOTE}"
    assert "the paper" not in report(reported_scores())


def test_with_the_paper() -> None:
    parts = REPORT.strip().split("\n\n")
    parts[2], parts[-1] = WITH_THE_PAPER.strip(), f"{parts[-1]}\n{UNBOUNDED_NOTE}"
    assert report(reported_scores(), compare_paper=True) == "\n\n".join([*parts, PAPER_LINE])


def test_the_papers_own_values_are_ranked_as_its_own() -> None:
    """A model without a row in the paper comes first, and is passed over; of the others all templates are there."""
    scores = []
    for place, template in enumerate(TEMPLATES):
        other = PAPER["idm", "ade_m"].by_template[template]
        values = (9.0 + place, PAPER["cv", "ade_m"].by_template[template], 2.0 * other)
        models = {
            name: model_scores(np.array([value])) for name, value in zip(("net", "cv", "idm"), values, strict=True)
        }
        scores.append(episode_scores(template, models))
    *_, cv, idm = report(scores, compare_paper=True).splitlines()
    assert cv == (
        "cv: mean ADE 1.44 m, +0% from the paper's 1.44 m; Spearman rank correlation over the templates: "
        "1.00 (p 0.0004)"
    )
    assert idm.startswith("idm: mean ADE 3.73 m, +101% from the paper's 1.86 m; Spearman")


@pytest.mark.parametrize(("count", "shown"), [(1, False), (2, True), (BAGS_MAX, True), (BAGS_MAX + 1, False)])
def test_bags_have_rows_where_they_are_several_and_not_many(count, shown) -> None:
    text = report([episode_scores("S1", {"cv": model_scores(np.ones(2))}, seed) for seed in range(count)])
    assert (f"\nS1_seed{count - 1} " in text) == shown


def test_a_bags_name_is_that_of_its_folder() -> None:
    scores = [replace(episode, name=f"some/where/{episode.name}/") for episode in reported_scores()]
    assert report(scores) == report(reported_scores())


@pytest.mark.parametrize(("population_size", "coverage"), [(3, "all"), (4, "75.0%")])
def test_a_model_with_all_samples_covers_all(population_size, coverage) -> None:
    """A population of one sample more is not covered."""
    scores = episode_scores("S1", {"cv": model_scores(np.ones(3), population_size=population_size)})
    assert tables_of([scores])["prediction"].rows[0][-2:] == (3, coverage)


@pytest.mark.parametrize(
    ("models", "pairs"),
    [
        (("cv", "idm", "net"), ["cv - net", "idm - net"]),
        (("cv", "idm:slow", "imm"), ["cv - idm:slow", "cv - imm", "idm:slow - imm"]),
    ],
)
def test_pairs_of_simple_baselines_are_shown_where_there_are_no_others(models, pairs) -> None:
    scores = [episode_scores("S1", {name: model_scores(np.full(2, float(len(name)))) for name in models})]
    assert [row[0] for row in tables_of(scores)["prediction_differences"].rows] == pairs


def test_without_common_samples_no_difference_is_shown() -> None:
    models = {"a": model_scores(np.ones(2)), "b": model_scores(np.ones(0), population_size=2)}
    assert "differences" not in report([episode_scores("S1", models)])


def test_populations_have_their_words() -> None:
    scores = [replace(episode, population=Population.ALL) for episode in reported_scores()]
    assert report(scores).splitlines()[0] == "population: all vehicles on the map"
    assert "region" in NO_SAMPLES_TEXT[Population.REGION]
    assert "logged" in NO_SAMPLES_TEXT[Population.ALL]


def test_intervals_are_the_ades_and_not_the_fdes() -> None:
    """Mean ADE 1.1 with the error 0.05·√(2.5 / 5), FDE 3.2; the first of two categories has them all."""
    scores = []
    for seed in range(5):
        values = {"ade_m": np.full(2, 1.0 + 0.05 * seed), "fde_m": np.full(2, 3.0 + 0.1 * seed)}
        scores.append(episode_scores("S1", {"cv": model_scores(values, Category.EMV)}, seed))
    cells = {key: table.cells() for key, table in tables_of(scores).items()}
    mean = "1.10/3.20 [1.00, 1.20]"
    assert cells["prediction_category"] == [("emv", "10", mean)]
    assert cells["prediction_level"] == [("L2", "10", mean)]
    assert cells["prediction"] == [("cv", "1.10/3.20", mean, "10", "all")]
    assert cells["prediction_metrics"][0][:3] == ("cv", "1.10", "3.20")
    bags = [("S1_seed0", "S1 L2", "2", "1.00/3.00"), ("S1_seed1", "S1 L2", "2", "1.05/3.10")]
    assert cells["prediction_bags"][:2] == bags
