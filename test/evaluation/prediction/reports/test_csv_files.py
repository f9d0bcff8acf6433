"""Lines of the CSV files; ``reported_scores`` says what their numbers follow from."""

import csv
import io
from collections.abc import Mapping

import pytest
from made_scores import five_episodes, reported_scores

from siren_ros.evaluation.prediction.reports.csv_files import csv_files
from siren_ros.evaluation.prediction.reports.differences import differences
from siren_ros.evaluation.prediction.reports.score_table import score_table


@pytest.fixture(scope="module")
def files() -> Mapping[str, str]:
    table = score_table(reported_scores())
    return csv_files(table, differences(table))


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_scores(files: Mapping[str, str]) -> None:
    lines = files["scores.csv"].splitlines()
    assert lines[0] == "model,rows,name,metric,value,low,high,samples,episodes,paper"
    assert "cv,all,all,ade_m,4.7,,,10,4,1.44" in lines
    assert "cv,template,S1,ade_m,2.1,,,5,2,1.63" in lines
    assert "cv,template,own,ade_m,8.0,,,2,1," in lines
    assert "cv,all,all,brier_score,,,,0,0," in lines
    assert "net:v_1,level,L3,fde_m,10.0,,,3,2," in lines
    # Of a part of the samples the paper says nothing.
    assert "cv,category,emv,ade_m,4.666666666666667,,,6,4," in lines


def test_episodes(files: Mapping[str, str]) -> None:
    lines = files["episodes.csv"].splitlines()
    assert lines[0] == "episode,template,level,seed,map,model,metric,value,samples"
    assert lines[1] == "S1_seed0,S1,L3,0,town,cv,ade_m,1.5,2"
    assert "S1_seed1,S1,L3,1,town,net:v_1,fde_m,12.0,2" in lines
    assert "S2_seed0,S2,L2,0,town,cv,brier_score,,0" in lines
    assert len(lines) == 1 + 4 * 2 * 9


def test_differences(files: Mapping[str, str]) -> None:
    rows = {(row["metric"], row["name"]): row for row in rows_of(files["differences.csv"])}
    assert len(rows) == 4 * 4
    row = rows["fde_m", "S1"]
    assert (row["first"], row["second"], row["samples"]) == ("cv", "net:v_1", "3")
    # Of the samples that both have, the second is worse by ADE itself: 1.0; 1.5 and 2.5. Two episodes have no bounds.
    assert float(row["difference"]) == pytest.approx(-5.0)
    assert (row["low"], row["high"]) == ("", "")
    assert (row["p"], row["p_holm"]) == ("0.5", "0.5")
    assert [rows["ade_m", "own"][name] for name in ("difference", "low", "high", "p")] == ["-8.0", "", "", "1.0"]


def test_five_episodes_have_bounds() -> None:
    table = score_table(five_episodes())
    files = csv_files(table, differences(table))
    (own,) = [
        row for row in rows_of(files["scores.csv"]) if tuple(row.values())[:4] == ("cv", "template", "S1", "ade_m")
    ]
    assert [float(own[name]) for name in ("value", "low", "high")] == pytest.approx([3.0, 1.0368, 4.9632], abs=1e-4)
    (row, *_) = rows_of(files["differences.csv"])
    assert [float(row[name]) for name in ("difference", "low", "high")] == pytest.approx(
        [-3.0, -4.9632, -1.0368], abs=1e-4
    )


def test_the_error_over_the_horizon_is_a_mean(files: Mapping[str, str]) -> None:
    """All samples of ``cv`` and ``net:v_1`` are off by 0 at the first point, 1 m at the second, and so on."""
    rows = rows_of(files["horizon.csv"])
    assert [row["time_s"] for row in rows[:3]] == ["0.2", "0.4", "0.6"]
    for model in ("cv", "net:v_1"):
        own = [row for row in rows if row["model"] == model]
        assert own[-1]["time_s"] == "5.0"
        assert [float(row["distance_m"]) for row in own] == pytest.approx(range(25))


def test_calibration_is_by_bins_of_a_tenth(files: Mapping[str, str]) -> None:
    assert files["calibration.csv"].splitlines() == [
        "model,from,to,hypotheses,mean_probability,share_best",
        "net:v_1,0.2,0.3,16,0.25,0.5",
        "net:v_1,0.7,0.8,16,0.75,0.5",
    ]
