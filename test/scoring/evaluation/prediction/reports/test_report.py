"""The tables of made scores as a terminal shows them, with and without the paper, and the files of a report.

``reported_scores`` says what their numbers follow from.
"""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_scores import episode_scores, five_episodes, model_scores, reported_scores

from siren_ros.base.tables import UNBOUNDED_NOTE, Table
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.metrics import METRICS
from siren_ros.scoring.evaluation.prediction.reports.paper_results import PAPER, TEMPLATES
from siren_ros.scoring.evaluation.prediction.reports.report import (
    BAGS_MAX,
    csv_files,
    json_report,
    latex_files,
    new_folder,
    prediction_tables,
    text_report,
    write_report,
)
from siren_ros.scoring.evaluation.prediction.reports.score_table import differences, score_table
from siren_ros.scoring.evaluation.prediction.scoring import Category, EpisodeScores
from siren_ros.scoring.evaluation.scores import Scores

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
PAPER_LINE = (
    "map: town (4); the paper's is Town10HD_Opt\n"
    "cv: mean ADE 4.70 m, +226% from the paper's 1.44 m, +118% from its 1.40 m over the same templates; "
    "Spearman rank correlation over the templates: needs 3 templates"
)


def tables_of(scores: Sequence[EpisodeScores], *, compare_paper: bool = False) -> dict[str, Table]:
    """The tables by their keys."""
    table = score_table(scores)
    return {of_key.key: of_key for of_key in prediction_tables(table, differences(table), compare_paper=compare_paper)}


def report_text(scores: Sequence[EpisodeScores], *, compare_paper: bool = False) -> str:
    tables = list(tables_of(scores, compare_paper=compare_paper).values())
    return "\n".join(text_report(score_table(scores), tables, compare_paper=compare_paper))


def test_the_text_of_a_report() -> None:
    """A bag's name is that of its folder."""
    scores = [replace(episode, name=f"some/where/{episode.name}/") for episode in reported_scores()]
    assert report_text(scores) == f"{REPORT.strip()}\n{UNBOUNDED_NOTE}"
    assert report_text(scores, compare_paper=True).endswith(f"\n\n{PAPER_LINE}")


def test_the_papers_own_values_are_ranked_as_its_own() -> None:
    """A model without a row in the paper comes first, and is passed over; of the others all templates are there."""
    scores = []
    for place, template in enumerate(TEMPLATES):
        other = PAPER["idm", "ade_m"][template]
        values = (9.0 + place, PAPER["cv", "ade_m"][template], 2.0 * other)
        models = {
            name: model_scores(np.array([value])) for name, value in zip(("net", "cv", "idm"), values, strict=True)
        }
        scores.append(episode_scores(template, models))
    *_, cv, idm = report_text(scores, compare_paper=True).splitlines()
    assert cv == (
        "cv: mean ADE 1.44 m, +0% from the paper's 1.44 m; Spearman rank correlation over the templates: "
        "1.00 (p 0.0004)"
    )
    assert idm.startswith("idm: mean ADE 3.73 m, +101% from the paper's 1.86 m; Spearman")


@pytest.mark.parametrize(("count", "shown"), [(1, False), (2, True), (BAGS_MAX, True), (BAGS_MAX + 1, False)])
def test_bags_have_rows_where_they_are_several_and_not_many(count, shown) -> None:
    text = report_text([episode_scores("S1", {"cv": model_scores(np.ones(2))}, seed) for seed in range(count)])
    assert (f"\nS1_seed{count - 1} " in text) == shown


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
    apart = {"a": model_scores(np.ones(2)), "b": model_scores(np.ones(0), population_size=2)}
    assert "prediction_differences" not in tables_of([episode_scores("S1", apart)]), "without common samples"


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


@pytest.fixture(scope="module")
def files() -> Mapping[str, str]:
    table = score_table(reported_scores())
    return csv_files(table, differences(table))


def rows_of(content: str | Path) -> list[dict[str, str]]:
    """The rows of a CSV file or of its content."""
    text = content if isinstance(content, str) else content.read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text)))


def test_scores_and_episodes(files) -> None:
    lines = files["scores.csv"].splitlines()
    assert lines[0] == "model,kind,group,metric,value,low,high,episodes,samples"
    expected = {"cv,all,all,ade_m,4.7,,,4,10", "cv,template,S1,ade_m,2.1,,,2,5", "cv,all,all,brier_score,,,,0,0"}
    assert {*lines} > {*expected, "net:v_1,level,L3,fde_m,10.0,,,2,3", "cv,category,emv,ade_m,4.666666666666667,,,4,6"}
    lines = files["episodes.csv"].splitlines()
    assert lines[0] == "episode,template,level,seed,map,model,metric,value,samples"
    assert lines[1] == "S1_seed0,S1,L3,0,town,cv,ade_m,1.5,2"
    assert {*lines} > {"S1_seed1,S1,L3,1,town,net:v_1,fde_m,12.0,2", "S2_seed0,S2,L2,0,town,cv,brier_score,,0"}
    assert len(lines) == 1 + 4 * 2 * len(METRICS)


def test_differences_and_claims_are_the_same_in_both_files(files, report) -> None:
    """Of the samples that both have, the second is worse by ADE itself: 1.0; 1.5 and 2.5. Two episodes: no bounds."""
    for name, count, model, against, worse in (
        ("differences", 4 * 4, "cv", "net:v_1", -1.0),
        ("claims", 2 * 4, "net:v_1", "cv", 1.0),
    ):
        rows = {(row["metric"], row["group"]): row for row in rows_of(files[f"{name}.csv"])}
        told = {(row["metric"], row["group"]): row for row in report[name]}
        assert len(rows) == len(told) == count
        for group, metric, value, p_value in (
            ("S1", "fde_m", 5.0, 0.5),
            ("S1", "ade_m", 5 / 3, 0.5),
            ("own", "ade_m", 8.0, 1.0),
        ):
            row, pair = rows[metric, group], told[metric, group]
            assert (row["model"], row["against"]) == (pair["model"], pair["against"]) == (model, against)
            assert float(row["value"]) == pair["value"] == pytest.approx(worse * value)
            assert (row["low"], row["high"], pair["low"], pair["high"]) == ("", "", None, None)
            assert float(row["p"]) == pair["p"] == p_value
            assert int(row["samples"]) == pair["samples"] == (3 if group == "S1" else 1)
    assert rows_of(files["differences.csv"])[0].keys() >= {"p_holm"}
    claim = next(claim for claim in report["claims"] if (claim["metric"], claim["group"]) == ("fde_m", "S1"))
    assert (claim["against_value"], claim["share"]) == pytest.approx((6.3, 5.0 / 6.3))


def test_five_episodes_have_bounds() -> None:
    table = score_table(five_episodes())
    pairs = differences(table)
    files, report = csv_files(table, pairs), json_report(table, pairs)
    bounds = "value", "low", "high"
    cv = next(row for row in rows_of(files["scores.csv"]) if (row["group"], row["metric"]) == ("S1", "ade_m"))
    cell = Scores.of_json(report).interval("cv", "template", "S1", "ade_m")
    for found in ([float(cv[name]) for name in bounds], [getattr(cell, name) for name in bounds]):
        assert found == pytest.approx([3.0, 1.0368, 4.9632], abs=1e-4)
    for row in (rows_of(files["differences.csv"])[0], report["differences"][0]):
        assert [float(row[name]) for name in bounds] == pytest.approx([-3.0, -4.9632, -1.0368], abs=1e-4)


def test_the_error_over_the_horizon_is_a_mean(files) -> None:
    """All samples of ``cv`` and ``net:v_1`` are off by 0 at the first point, 1 m at the second, and so on."""
    rows = rows_of(files["horizon.csv"])
    assert [row["time_s"] for row in rows[:3]] == ["0.2", "0.4", "0.6"]
    for model in ("cv", "net:v_1"):
        of_model = [row for row in rows if row["model"] == model]
        assert of_model[-1]["time_s"] == "5.0"
        assert [float(row["distance_m"]) for row in of_model] == pytest.approx(range(25))


def test_calibration_is_by_bins_of_a_tenth(files) -> None:
    assert files["calibration.csv"].splitlines() == [
        "model,from,to,hypotheses,mean_probability,share_best",
        "net:v_1,0.2,0.3,16,0.25,0.5",
        "net:v_1,0.7,0.8,16,0.75,0.5",
    ]


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    table = score_table(reported_scores())
    return json_report(table, differences(table))


def test_an_episode(report) -> None:
    about = report["task"], report["population"], report["intervals"]["block"], report["intervals"]["stratum"]
    assert about == ("prediction", "region", "episode", "template")
    episode = report["episodes"][1]
    known = {"name": "S1_seed1", "template": "S1", "level": "L3", "seed": 1, "map": "town"}
    assert episode.items() >= {**known, "parameters": {"speed_mps": 9.0}}.items()
    cv, net = episode["models"]["cv"], episode["models"]["net:v_1"]
    assert (cv["samples"], cv["wanted"], net["samples"], net["wanted"]) == (3, 3, 2, 3)
    assert (cv["ade_m"], cv["miss_rate_6"], net["fde_m"]) == pytest.approx((2.5, 2 / 3, 12.0))
    assert cv["brier_score"] is None
    # The paper has no best of six of its own for CV, and says that it is the ADE.
    expected = {"ade_m": 1.63, "fde_m": 4.30, "rmse_5s_m": 5.61, "min_ade_6_m": 1.63, "min_fde_6_m": 4.30}
    assert (cv["paper"], net["paper"], report["episodes"][3]["models"]["cv"]["paper"]) == (expected, {}, {})


def test_a_model(report) -> None:
    assert list(report["models"]) == ["cv", "net:v_1"]
    cv, net = report["models"]["cv"], report["models"]["net:v_1"]
    assert (net["samples"], net["wanted"], net["coverage"]) == (6, 10, pytest.approx(0.6))
    assert cv["calibration_error"] is None
    assert net["calibration_error"] == pytest.approx(0.25)
    assert cv["distance_over_time_m"]["5.0"] == pytest.approx(24.0)
    rows = {(row["kind"], row["group"], row["metric"]): row for row in report["rows"] if row["model"] == "cv"}
    alone = {"value": 8.0, "samples": 2, "episodes": 1, "low": None, "high": None}
    assert rows["template", "own", "ade_m"].items() >= alone.items()
    assert rows["category", "held", "ade_m"]["value"] is None
    assert {metric for kind, group, metric in rows if group == "S1 speed_mps 9"} == {"ade_m", "fde_m"}
    assert net["paper"] == {}
    paper = cv["paper"]["ade_m"]
    assert (paper["mean"], paper["deviation"]) == pytest.approx((4.7, 4.7 / 1.44 - 1.0))
    assert paper["deviation_same_templates"] == pytest.approx(3.05 / 1.40 - 1.0)
    assert paper["ranking"] is None
    assert set(cv["paper"]) == {"ade_m", "fde_m", "rmse_5s_m", "min_ade_6_m", "min_fde_6_m"}


def test_a_model_without_an_answer() -> None:
    table = score_table([episode_scores("S1", {"cv": model_scores(np.ones(0), population_size=4)})])
    report = json_report(table, [])["models"]["cv"]
    assert (report["samples"], report["coverage"], report["distance_over_time_m"]) == (0, 0.0, {})


def test_a_ranking_is_written_with_its_numbers() -> None:
    values = enumerate((1.6, 1.1, 1.0, 0.7), start=1)
    scores = [episode_scores(f"S{number}", {"cv": model_scores(np.array([value]))}) for number, value in values]
    ranking = json_report(score_table(scores), [])["models"]["cv"]["paper"]["ade_m"]["ranking"]
    # Two of the 24 orders of four are as far from 0.
    assert ranking == {"rho": pytest.approx(1.0), "p_value": pytest.approx(2 / 24), "pairs": 4}


RMSE = r"""
% RMSE in m at the 5-s horizon by template; 4 episodes
\begin{tabular}{lcccccc}
\toprule
model & S1 & S2 & own & mean & samples & coverage \\
\midrule
CV & 9.08 & 17.28 & 32.00 & 19.45 [--] & 10 & all \\
net v\_1 & 14.24 & 25.30 & 64.00 & 34.51 [--] & 6 & 60.0\% \\
\bottomrule
\end{tabular}
"""


def test_latex_without_and_with_the_paper() -> None:
    files = latex_files(prediction_tables(score_table(reported_scores())), "4 episodes")
    assert list(files) == ["prediction.tex", "rmse.tex", "best_of_six.tex", "miss_rate.tex"]
    assert files["rmse.tex"] == RMSE.lstrip()
    with_paper = latex_files(prediction_tables(score_table(reported_scores()), compare_paper=True), "4 episodes")
    lines = with_paper["prediction.tex"].splitlines()
    assert lines[3] == r"model & S1 & S2 & S3 & S4 & S5 & S6 & S7 & own & mean & samples & coverage \\"
    values = "1.63/4.30 1.17/3.11 0.96/2.40 0.68/1.65 1.95/5.03 2.86/7.56 0.85/2.08 --/-- 1.44/3.73"
    assert lines[7:9] == [r"\midrule", " & ".join(["CV (paper)", *values.split()]) + r" &  &  \\"]
    assert r"DeMo (paper) & 0.53/1.12 & 0.47/1.24 &" in with_paper["best_of_six.tex"]
    assert "\nCV & 2.10/6.30 & 4.00/12.00 & 8.00/24.00 & 4.70/14.10 [--] & 10 & all \\\\\n" in files["prediction.tex"]
    assert "\nCV & 1.05/3.15 & 2.00/6.00 & 4.00/12.00 & 2.35/7.05 [--] &" in files["best_of_six.tex"]
    assert "\nCV & 0.60 & 1.00 & 1.00 & 0.87 [--] &" in files["miss_rate.tex"]


def test_a_report_is_in_its_files(tmp_path) -> None:
    """The nine rows of the paper stand in the tables that it has, too; JSON is strict."""
    table = score_table(reported_scores())
    pairs = differences(table)
    tables = prediction_tables(table, pairs, compare_paper=True)
    text = "\n".join(text_report(table, tables, compare_paper=True))
    new_folder(tmp_path / "deep" / "out")
    write_report(tmp_path / "deep" / "out", table, pairs, tables, text)
    content = {file.name: file.read_text(encoding="utf-8") for file in (tmp_path / "deep" / "out").iterdir()}
    report = json.loads(content.pop("scores.json"), parse_constant=pytest.fail)
    assert report == json.loads(json.dumps(json_report(table, pairs)))
    latex = latex_files(tables, "population: region; 4 episodes")
    assert content == {"report.txt": f"{text}\n", **csv_files(table, pairs), **latex}
    papers = {name: content[name].count("(paper)") for name in (*latex, "report.txt")}
    assert papers == {"prediction.tex": 9, "rmse.tex": 9, "best_of_six.tex": 9, "miss_rate.tex": 0, "report.txt": 9}


def test_a_place_that_cannot_be_written(tmp_path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="out"):
        new_folder(tmp_path / "file" / "out")
