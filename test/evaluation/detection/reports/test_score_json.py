"""The scores as JSON types."""

import json

import pytest
from made_detector_scores import detector_scores

from siren_ros.evaluation.detection.reports.score_json import scores_as_json


def test_a_detector_with_intervals() -> None:
    found = scores_as_json([detector_scores("mine", {"S1": 0.4, "S3": 0.6})])
    json.dumps(found, allow_nan=False)
    one = found["mine"]
    assert (one["format"], one["velocity_known"]) == ("nuScenes", True)
    expected = {"value": 0.5, "low": 0.45, "high": 0.55, "episodes": 6}
    assert one["mean"] == {"mAP": pytest.approx(expected), "NDS": pytest.approx(0.25)}
    assert one["families"] == {"clearance": pytest.approx(expected), "red light": None}
    assert (one["order_of_families_share"], one["order_of_families_steps"]) == (0.25, {"clearance < stop sign": 0.75})
    held = {"value": 0.25, "low": pytest.approx(0.2), "high": pytest.approx(0.3), "episodes": 6}
    assert one["parts"][0] == {"of": "behaviour", "name": "held", "labels": 7, "mAP": held}
    assert one["parts"][1]["mAP"] is None


def test_a_template() -> None:
    one = scores_as_json([detector_scores("mine", {"S1": 0.4, "S3": 0.6})])["mine"]["templates"]["S3"]
    assert (one["frames"], one["labels"], one["detections"]) == (40, 10, 20)
    assert one["NDS"] == pytest.approx(0.3)
    assert one["mAP"] == pytest.approx({"value": 0.6, "low": 0.55, "high": 0.65, "episodes": 6})
    assert one["AP"] == pytest.approx({"0.5": 0.45, "1": 0.55, "2": 0.65, "4": 0.75})
    assert one["errors"] == pytest.approx({"ATE": 0.6, "ASE": 1.6, "AOE": 2.6, "AVE": 3.6, "AAE": 4.6})
    curves = one["precision_at_recall_0_to_1"]
    assert [len(curve) for curve in curves] == [101] * 4
    # From 1 down to 0.3 in a hundred steps, to six digits.
    assert [curves[3][place] for place in (0, 1, 100)] == [1.0, 0.993, 0.3]


def test_without_intervals_their_bounds_are_null() -> None:
    one = scores_as_json([detector_scores("mine", {"S1": 0.4}, bounded=False)])["mine"]
    assert one["mean"]["mAP"] == {"value": 0.4, "low": None, "high": None, "episodes": 1}
    assert (one["order_of_families_share"], one["order_of_families_steps"]) == (None, None)
