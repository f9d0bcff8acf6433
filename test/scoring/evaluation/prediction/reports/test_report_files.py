"""The files of a report; ``reported_scores`` says what their numbers follow from."""

import csv
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_scores import episode_scores, five_episodes, model_scores, reported_scores

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.metrics import METRICS
from siren_ros.scoring.evaluation.prediction.reports.report import (
    csv_files,
    json_report,
    latex_files,
    new_folder,
    prediction_tables,
    text_report,
    write_report,
)
from siren_ros.scoring.evaluation.prediction.reports.score_table import differences, score_table


@pytest.fixture(scope="module")
def files() -> Mapping[str, str]:
    table = score_table(reported_scores())
    return csv_files(table, differences(table))


def rows_of(content: str | Path) -> list[dict[str, str]]:
    """The rows of a CSV file or of its content."""
    text = content if isinstance(content, str) else content.read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text)))


def test_scores(files) -> None:
    lines = files["scores.csv"].splitlines()
    assert lines[0] == "model,rows,name,metric,value,low,high,samples,episodes,paper"
    assert "cv,all,all,ade_m,4.7,,,10,4,1.44" in lines
    assert "cv,template,S1,ade_m,2.1,,,5,2,1.63" in lines
    assert "cv,template,own,ade_m,8.0,,,2,1," in lines
    assert "cv,all,all,brier_score,,,,0,0," in lines
    assert "net:v_1,level,L3,fde_m,10.0,,,3,2," in lines
    # Of a part of the samples the paper says nothing.
    assert "cv,category,emv,ade_m,4.666666666666667,,,6,4," in lines


def test_episodes(files) -> None:
    lines = files["episodes.csv"].splitlines()
    assert lines[0] == "episode,template,level,seed,map,model,metric,value,samples"
    assert lines[1] == "S1_seed0,S1,L3,0,town,cv,ade_m,1.5,2"
    assert "S1_seed1,S1,L3,1,town,net:v_1,fde_m,12.0,2" in lines
    assert "S2_seed0,S2,L2,0,town,cv,brier_score,,0" in lines
    assert len(lines) == 1 + 4 * 2 * len(METRICS)


def test_differences(files) -> None:
    rows = {(row["metric"], row["name"]): row for row in rows_of(files["differences.csv"])}
    assert len(rows) == 4 * 4
    row = rows["fde_m", "S1"]
    assert (row["first"], row["second"], row["samples"]) == ("cv", "net:v_1", "3")
    # Of the samples that both have, the second is worse by ADE itself: 1.0; 1.5 and 2.5. Two episodes have no bounds.
    assert float(row["difference"]) == pytest.approx(-5.0)
    assert (row["low"], row["high"]) == ("", "")
    assert (row["p"], row["p_holm"]) == ("0.5", "0.5")
    assert [rows["ade_m", "own"][name] for name in ("difference", "low", "high", "p")] == ["-8.0", "", "", "1.0"]


def test_claims(files, report) -> None:
    rows = {(row["metric"], row["name"]): row for row in rows_of(files["claims.csv"])}
    assert len(rows) == 2 * 4
    row = rows["fde_m", "S1"]
    assert (row["model"], row["best_simple"], row["samples"]) == ("net:v_1", "cv", "3")
    assert (float(row["best_simple_value"]), float(row["difference"])) == pytest.approx((6.3, 5.0))
    claim = next(claim for claim in report["claims"] if (claim["metric"], claim["name"]) == ("fde_m", "S1"))
    assert (claim["model"], claim["best_simple"]) == ("net:v_1", "cv")
    assert (claim["value"], claim["share"], claim["p"]) == pytest.approx((5.0, 5.0 / 6.3, 0.5))


def test_five_episodes_have_bounds() -> None:
    table = score_table(five_episodes())
    files = csv_files(table, differences(table))
    cv = next(row for row in rows_of(files["scores.csv"]) if (row["name"], row["metric"]) == ("S1", "ade_m"))
    assert (cv["model"], cv["rows"]) == ("cv", "template")
    assert [float(cv[name]) for name in ("value", "low", "high")] == pytest.approx([3.0, 1.0368, 4.9632], abs=1e-4)
    (row, *_) = rows_of(files["differences.csv"])
    bounds = pytest.approx([-3.0, -4.9632, -1.0368], abs=1e-4)
    assert [float(row[name]) for name in ("difference", "low", "high")] == bounds
    report = json_report(table, differences(table))
    cell = report["models"]["cv"]["rows"]["template"]["S1"]["ade_m"]
    assert [cell[name] for name in ("value", "low", "high")] == pytest.approx([3.0, 1.0368, 4.9632], abs=1e-4)
    assert [report["differences"][0][name] for name in ("value", "low", "high")] == bounds


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
    assert report["task"] == "prediction"
    assert report["population"] == "region"
    assert report["intervals"] == {"confidence": 0.95, "method": "jackknife", "block": "episode", "stratum": "template"}
    episode = report["episodes"][1]
    assert {name: episode[name] for name in ("name", "template", "level", "seed", "map", "parameters")} == {
        "name": "S1_seed1", "template": "S1", "level": "L3", "seed": 1, "map": "town", "parameters": {"speed_mps": 9.0}
    }  # fmt: skip
    cv, net = episode["models"]["cv"], episode["models"]["net:v_1"]
    assert (cv["samples"], cv["wanted"], net["samples"], net["wanted"]) == (3, 3, 2, 3)
    assert (cv["ade_m"], cv["miss_rate_6"], net["fde_m"]) == pytest.approx((2.5, 2 / 3, 12.0))
    assert cv["brier_score"] is None
    # The paper has no best of six of its own for CV, and says that it is the ADE.
    expected = {"ade_m": 1.63, "fde_m": 4.30, "rmse_5s_m": 5.61, "min_ade_6_m": 1.63, "min_fde_6_m": 4.30}
    assert cv["paper"] == expected
    assert net["paper"] == {}
    assert report["episodes"][3]["models"]["cv"]["paper"] == {}


def test_a_model(report) -> None:
    assert list(report["models"]) == ["cv", "net:v_1"]
    cv, net = report["models"]["cv"], report["models"]["net:v_1"]
    assert (net["samples"], net["wanted"], net["coverage"]) == (6, 10, pytest.approx(0.6))
    assert cv["calibration_error"] is None
    assert net["calibration_error"] == pytest.approx(0.25)
    assert cv["distance_over_time_m"]["0.2"] == 0.0
    assert cv["distance_over_time_m"]["5.0"] == pytest.approx(24.0)
    assert len(net["distance_over_time_m"]) == 25
    assert cv["rows"]["template"]["S1"]["ade_m"] == {
        "value": pytest.approx(2.1), "low": None, "high": None, "samples": 5, "episodes": 2
    }  # fmt: skip
    alone = {"value": 8.0, "low": None, "high": None, "samples": 2, "episodes": 1}
    assert cv["rows"]["template"]["own"]["ade_m"] == alone
    assert cv["rows"]["category"]["held"]["ade_m"]["value"] is None
    assert set(cv["rows"]["parameter"]["S1 speed_mps 9"]) == {"ade_m", "fde_m"}
    assert net["paper"] == {}
    paper = cv["paper"]["ade_m"]
    assert (paper["mean"], paper["deviation"]) == pytest.approx((4.7, 4.7 / 1.44 - 1.0))
    assert paper["deviation_same_templates"] == pytest.approx(3.05 / 1.40 - 1.0)
    assert paper["ranking"] is None
    assert set(cv["paper"]) == {"ade_m", "fde_m", "rmse_5s_m", "min_ade_6_m", "min_fde_6_m"}


def test_a_difference(report) -> None:
    by_group = {(pair["metric"], pair["name"]): pair for pair in report["differences"]}
    pair = by_group["ade_m", "S1"]
    assert (pair["first"], pair["second"], pair["samples"]) == ("cv", "net:v_1", 3)
    assert [pair[name] for name in ("value", "low", "high")] == [pytest.approx(-5 / 3), None, None]
    assert (pair["p"], pair["p_holm"]) == (0.5, 0.5)
    alone = by_group["ade_m", "own"]
    assert [alone[name] for name in ("value", "low", "high")] == [-8.0, None, None]


def test_a_model_without_an_answer() -> None:
    table = score_table([episode_scores("S1", {"cv": model_scores(np.ones(0), population_size=4)})])
    report = json_report(table, [])["models"]["cv"]
    assert (report["samples"], report["coverage"], report["distance_over_time_m"]) == (0, 0.0, {})


def test_a_ranking_is_written_with_its_numbers() -> None:
    scores = [episode_scores(name, {"cv": model_scores(np.array([value]))}) for name, value in
              (("S1", 1.6), ("S2", 1.1), ("S3", 1.0), ("S4", 0.7))]  # fmt: skip
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


def test_latex_without_the_paper() -> None:
    files = latex_files(prediction_tables(score_table(reported_scores())), "4 episodes")
    assert list(files) == ["prediction.tex", "rmse.tex", "best_of_six.tex", "miss_rate.tex"]
    assert files["rmse.tex"] == RMSE.lstrip()
    assert "\nCV & 2.10/6.30 & 4.00/12.00 & 8.00/24.00 & 4.70/14.10 [--] & 10 & all \\\\\n" in files["prediction.tex"]
    assert "\nCV & 1.05/3.15 & 2.00/6.00 & 4.00/12.00 & 2.35/7.05 [--] &" in files["best_of_six.tex"]
    assert "\nCV & 0.60 & 1.00 & 1.00 & 0.87 [--] &" in files["miss_rate.tex"]


def test_latex_with_the_paper() -> None:
    files = latex_files(prediction_tables(score_table(reported_scores()), compare_paper=True), "4 episodes")
    lines = files["prediction.tex"].splitlines()
    assert lines[1] == r"\begin{tabular}{lccccccccccc}"
    assert lines[3] == r"model & S1 & S2 & S3 & S4 & S5 & S6 & S7 & own & mean & samples & coverage \\"
    cv = "CV & 2.10/6.30 & 4.00/12.00 & --/-- & --/-- & --/-- & --/-- & --/-- & 8.00/24.00 & 4.70"
    assert lines[5].startswith(cv)
    assert lines[7] == r"\midrule"
    values = "1.63/4.30 1.17/3.11 0.96/2.40 0.68/1.65 1.95/5.03 2.86/7.56 0.85/2.08 --/-- 1.44/3.73"
    assert lines[8] == " & ".join(["CV (paper)", *values.split()]) + r" &  &  \\"
    assert lines[17:] == [r"\bottomrule", r"\end{tabular}"]
    assert r"DeMo (paper) & 0.53/1.12 & 0.47/1.24 &" in files["best_of_six.tex"]
    # The paper has no miss rates: nothing stands between our rows and the end.
    assert files["miss_rate.tex"].splitlines()[-3].startswith(r"net v\_1 &")


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
