"""All files of a report, from scores made by hand."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from made_scores import episode_scores, model_scores

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.reports.differences import differences
from siren_ros.evaluation.prediction.reports.report_files import new_folder, write_report
from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.evaluation.prediction.reports.text_report import text_report
from siren_ros.evaluation.prediction.scoring.categories import Category
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores


def some_scores() -> list[EpisodeScores]:
    """Two models over three templates of two episodes; one model misses a sample, one template is not the paper's."""
    scores = []
    for number, template in enumerate(("S1", "S2", "my_own")):
        for seed in range(2):
            base = np.array([1.0, 2.0]) + number + 0.1 * seed
            models = {"cv": model_scores(base), "net:v_1": model_scores(base[:1], wanted=2)}
            scores.append(episode_scores(template, models, seed, speed_mps=8.0 + seed))
    return scores


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "deep" / "out"
    table = score_table(some_scores())
    found = differences(table)
    new_folder(path)
    write_report(path, table, found, "\n".join(text_report(table, found, compare_paper=True)), compare_paper=True)
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_csv_has_a_row_for_each_value(folder: Path) -> None:
    rows = {(row["model"], row["name"], row["metric"]): row for row in rows_of(folder / "scores.csv")}
    row = rows["cv", "S1", "ade_m"]
    assert float(row["value"]) == pytest.approx(1.55)
    assert (row["low"], row["high"]) == ("", ""), "of two episodes"
    assert (row["samples"], row["episodes"], row["paper"]) == ("4", "2", "1.63")
    assert rows["cv", "emv", "ade_m"]["value"] == ""
    assert float(rows["cv", "S1 speed_mps 9", "ade_m"]["value"]) == pytest.approx(1.6)
    assert ("cv", "S1 speed_mps 9", "brier_score") not in rows
    assert len(rows_of(folder / "episodes.csv")) == 6 * 2 * 9
    assert {row["group"] if "group" in row else row["name"] for row in rows_of(folder / "differences.csv")} == {
        "all", "S1", "S2", "my_own"
    }  # fmt: skip


def test_json_is_strict_and_says_all(folder: Path) -> None:
    def refuse(name: str) -> None:
        raise AssertionError(name)

    read = json.loads((folder / "scores.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert read["models"]["net:v_1"]["coverage"] == pytest.approx(0.5)
    assert read["models"]["cv"]["rows"]["template"]["S2"]["fde_m"]["value"] == pytest.approx(2.55)
    assert read["models"]["cv"]["rows"]["category"]["held"]["ade_m"]["value"] is None
    assert read["models"]["cv"]["paper"]["ade_m"]["paper_mean"] == 1.44
    assert read["models"]["net:v_1"]["paper"] == {}
    assert read["episodes"][0]["models"]["cv"]["paper"]["ade_m"] == 1.63
    assert {one["metric"] for one in read["differences"]} == {"ade_m", "fde_m", "min_ade_6_m", "min_fde_6_m"}


def test_latex_tables_are_like_the_papers(folder: Path) -> None:
    lines = (folder / "prediction.tex").read_text(encoding="utf-8").splitlines()
    assert r"Model & S1 & S2 & S3 & S4 & S5 & S6 & S7 & my\_own & Mean \\" in lines
    (own,) = [line for line in lines if line.startswith("CV &")]
    assert own.startswith("CV & 1.55/1.55 & 2.55/2.55 & -/- &")
    assert r"net v\_1 & 1.05/1.05" in "\n".join(lines)
    papers = [line for line in lines if "(paper)" in line]
    assert len(papers) == 9
    assert papers[0].startswith("CV (paper) & 1.63/4.30 & 1.17/3.11")
    assert papers[-1].endswith(r"1.88/5.42 \\")
    assert all(line.count("&") == 9 for line in [own, *papers])
    assert (folder / "best_of_six.tex").read_text(encoding="utf-8").count("(paper)") == 9
    assert (folder / "miss_rate.tex").read_text(encoding="utf-8").count("(paper)") == 0


def test_the_terminal_shows_all_nine_rows_of_the_paper(folder: Path) -> None:
    lines = (folder / "report.txt").read_text(encoding="utf-8").splitlines()
    assert sum("(paper)" in line for line in lines) == 8, "the ninth stands below ours"
    place = next(number for number, line in enumerate(lines) if line.startswith("cv "))
    (main,) = [number for number, line in enumerate(lines) if line.startswith("ADE/FDE in m by template")]
    rows = lines[main + 2 :]
    assert rows[0].split()[:3] == ["cv", "1.55/1.55", "2.55/2.55"]
    assert rows[1].split()[:3] == ["paper", "1.63/4.30", "1.17/3.11"]
    assert rows[2].split()[0] == "net:v_1"
    assert rows[2].split()[-1] == "50.0%"
    assert place
    assert any(line.startswith("cv - net:v_1") for line in lines)


def test_intervals_are_the_ades_and_not_the_fdes() -> None:
    """Mean ADE 1.1 with the error 0.05·√(2.5 / 5), FDE 3.2; the first of two categories has them all."""
    scores = []
    for seed in range(5):
        ade_m, fde_m = 1.0 + 0.05 * seed, 3.0 + 0.1 * seed
        values = {"ade_m": np.full(2, ade_m), "fde_m": np.full(2, fde_m)}
        scores.append(episode_scores("S1", {"cv": model_scores(values, Category.EMV)}, seed))
    lines = text_report(score_table(scores), [], compare_paper=False)
    (category,) = [number for number, line in enumerate(lines) if line.startswith("ADE/FDE in m by category")]
    assert lines[category + 2].split() == ["emv", "10", "1.10/3.20", "[1.00,", "1.20]"]
    (level,) = [number for number, line in enumerate(lines) if line.startswith("ADE/FDE in m by level")]
    assert lines[level + 2].split() == ["L2", "10", "1.10/3.20", "[1.00,", "1.20]"]
    (main,) = [number for number, line in enumerate(lines) if line.startswith("ADE/FDE in m by template")]
    assert lines[main + 2].split() == ["cv", "1.10/3.20", "1.10/3.20", "[1.00,", "1.20]", "10", "all"]
    (metrics,) = [number for number, line in enumerate(lines) if line.startswith("all metrics")]
    assert lines[metrics + 2].split()[:3] == ["cv", "1.10", "3.20"]
    (bags,) = [number for number, line in enumerate(lines) if line.startswith("bag")]
    assert [line.split() for line in lines[bags + 1 : bags + 3]] == [
        ["S1_seed0", "S1", "L2", "2", "1.00/3.00"],
        ["S1_seed1", "S1", "L2", "2", "1.05/3.10"],
    ]


def test_without_the_comparison_there_is_nothing_of_the_paper() -> None:
    table = score_table(some_scores())
    assert "paper" not in "\n".join(text_report(table, differences(table), compare_paper=False))


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="out"):
        new_folder(tmp_path / "file" / "out")
