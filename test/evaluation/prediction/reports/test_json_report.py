"""The JSON report; ``reported_scores`` says what its numbers follow from."""

from typing import Any

import numpy as np
import pytest
from made_scores import episode_scores, five_episodes, model_scores, reported_scores

from siren_ros.evaluation.prediction.reports.differences import differences
from siren_ros.evaluation.prediction.reports.json_report import json_report
from siren_ros.evaluation.prediction.reports.score_table import score_table


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    table = score_table(reported_scores())
    return json_report(table, differences(table))


def test_an_episode(report: dict[str, Any]) -> None:
    assert report["task"] == "prediction"
    assert report["population"] == "region"
    assert report["intervals"] == {"confidence": 0.95, "method": "jackknife", "block": "episode", "stratum": "template"}
    one = report["episodes"][1]
    assert {name: one[name] for name in ("name", "template", "level", "seed", "map", "parameters")} == {
        "name": "S1_seed1", "template": "S1", "level": "L3", "seed": 1, "map": "town", "parameters": {"speed_mps": 9.0}
    }  # fmt: skip
    cv, net = one["models"]["cv"], one["models"]["net:v_1"]
    assert (cv["samples"], cv["wanted"], net["samples"], net["wanted"]) == (3, 3, 2, 3)
    assert (cv["ade_m"], cv["miss_rate_6"], net["fde_m"]) == pytest.approx((2.5, 2 / 3, 12.0))
    assert cv["brier_score"] is None
    # The paper has no best of six of its own for CV, and says that it is the ADE.
    expected = {"ade_m": 1.63, "fde_m": 4.30, "rmse_5s_m": 5.61, "min_ade_6_m": 1.63, "min_fde_6_m": 4.30}
    assert cv["paper"] == expected
    assert net["paper"] == {}
    assert report["episodes"][3]["models"]["cv"]["paper"] == {}


def test_a_model(report: dict[str, Any]) -> None:
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


def test_a_difference(report: dict[str, Any]) -> None:
    found = {(one["metric"], one["name"]): one for one in report["differences"]}
    one = found["ade_m", "S1"]
    assert (one["first"], one["second"], one["samples"]) == ("cv", "net:v_1", 3)
    assert [one[name] for name in ("value", "low", "high")] == [pytest.approx(-5 / 3), None, None]
    assert (one["p"], one["p_holm"]) == (0.5, 0.5)
    alone = found["ade_m", "own"]
    assert [alone[name] for name in ("value", "low", "high")] == [-8.0, None, None]


def test_five_episodes_have_bounds() -> None:
    table = score_table(five_episodes())
    found = json_report(table, differences(table))
    one = found["models"]["cv"]["rows"]["template"]["S1"]["ade_m"]
    assert [one[name] for name in ("value", "low", "high")] == pytest.approx([3.0, 1.0368, 4.9632], abs=1e-4)
    assert [found["differences"][0][name] for name in ("low", "high")] == pytest.approx([-4.9632, -1.0368], abs=1e-4)


def test_a_model_without_an_answer() -> None:
    table = score_table([episode_scores("S1", {"cv": model_scores(np.ones(0), wanted=4)})])
    found = json_report(table, [])["models"]["cv"]
    assert (found["samples"], found["coverage"], found["distance_over_time_m"]) == (0, 0.0, {})


def test_a_ranking_is_written_with_its_numbers() -> None:
    scores = [episode_scores(name, {"cv": model_scores(np.array([value]))}) for name, value in
              (("S1", 1.6), ("S2", 1.1), ("S3", 1.0), ("S4", 0.7))]  # fmt: skip
    ranking = json_report(score_table(scores), [])["models"]["cv"]["paper"]["ade_m"]["ranking"]
    # Two of the 24 orders of four are as far from 0.
    assert ranking == {"rho": pytest.approx(1.0), "p_value": pytest.approx(2 / 24), "pairs": 4}
