"""Detection and risk: read from the files that their commands write."""

import json
from pathlib import Path

import numpy as np
import pytest
from made_video_sets import small_video_set

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.metrics.devkit_score import ERRORS
from siren_ros.evaluation.paper_comparison.detection_rows import FAMILY, ORDER, detection_rows
from siren_ros.evaluation.paper_comparison.risk_rows import BALANCE, risk_rows
from siren_ros.evaluation.paper_comparison.stored_scores import interval_in, stored


def detector(**more: object) -> dict[str, object]:
    ap = {"value": 0.4, "low": 0.3, "high": 0.5, "episodes": 14}
    template = {"mAP": ap, "NDS": 0.45, "errors": dict.fromkeys(ERRORS, 0.5)}
    return {
        "mean": {"mAP": ap, "NDS": 0.45},
        "templates": {"S1": template, "S2": template},
        "families": {"clearance": ap},
        "order_of_families_share": None,
        **more,
    }


def test_a_detector_of_the_papers_name_stands_next_to_it() -> None:
    rows = {(row.table, row.row, row.column): row for row in detection_rows({"PointPillars": detector()})}
    row = rows["mAP", "PointPillars", "S1"]
    assert (row.paper, row.ours.value, row.inside) == (0.398, 0.4, True)
    assert rows["NDS", "PointPillars", "mean"].ours.value == 0.45
    assert not rows["mAP", "SECOND", "S1"].ours.valid
    assert not rows["mAP", "PointPillars", "S7"].ours.valid
    assert {row.ours.value for row in rows.values() if row.table.startswith("error") and row.ours.valid} == {0.5}


def test_any_detector_is_held_against_the_families() -> None:
    rows = {
        (row.table, row.column): row
        for row in detection_rows({"mine": detector(order_of_families_share=0.25)})
        if row.row == "mine"
    }
    clearance = rows[FAMILY, "clearance"]
    assert clearance.paper == pytest.approx(np.mean([0.398, 0.434, 0.420, 0.388, 0.438, 0.413, 0.424, 0.423]))
    assert clearance.ours.value == 0.4
    order = rows[ORDER, "share of the draws"]
    assert (order.paper, order.ours.value, order.deviation, order.inside) == (1.0, 0.25, None, None)


def test_without_scores_the_papers_numbers_remain() -> None:
    rows = list(detection_rows(None))
    assert len(rows) == 4 * (2 * 8 + 5)
    assert not any(row.ours.valid for row in rows)


def test_the_balance_is_that_of_the_labels(tmp_path: Path) -> None:
    rows = [row for row in risk_rows(small_video_set(tmp_path), None) if row.table == BALANCE]
    assert [row.paper for row in rows] == pytest.approx([74 / 105, 25 / 105, 6 / 105])
    assert [row.ours.value for row in rows] == pytest.approx([3 / 6, 2 / 6, 1 / 6])
    assert rows[0].ours.low < 0.5 < rows[0].ours.high


def test_scores_of_the_papers_models_are_found_by_name() -> None:
    content = {"models": {"Qwen3.5-9B": {"scores": {"accuracy": {"value": 0.6, "low": 0.5, "high": 0.8}}}}}
    rows = {(row.row, row.column): row for row in risk_rows(None, content)}
    assert rows["Qwen3.5-9B", "accuracy"].inside is True
    assert rows["Qwen3.5-9B", "accuracy"].cells()[3] == "0.705"
    assert not rows["Gemma3-12B", "accuracy"].ours.valid


def test_stored_scores_are_a_json_object(tmp_path: Path) -> None:
    assert stored(tmp_path) is None
    file = tmp_path / "scores.json"
    file.write_text("[1]", encoding="utf-8")
    with pytest.raises(InputError, match="siren evaluate"):
        stored(tmp_path)
    file.write_text(json.dumps({"a": 1}), encoding="utf-8")
    assert stored(file) == stored(tmp_path) == {"a": 1}


def test_an_interval_without_bounds_is_a_value() -> None:
    assert not interval_in(None).valid
    assert not interval_in({"value": None}).valid
    single = interval_in({"value": 0.5, "low": None, "high": None})
    assert (single.valid, single.bounded) == (True, False)


def test_an_error_is_the_mean_over_the_templates() -> None:
    ap = {"value": 0.4, "low": 0.3, "high": 0.5, "episodes": 14}
    templates = {
        name: {"mAP": {**ap, "value": value}, "NDS": 2.0 * value, "errors": dict.fromkeys(ERRORS, value)}
        for name, value in (("S1", 0.1), ("S2", 0.3), ("S3", 0.2))
    }
    given = detector(templates=templates, mean={"mAP": ap, "NDS": 0.7})
    rows = {(row.table, row.row, row.column): row for row in detection_rows({"second": given})}
    for error in ERRORS:
        assert rows[f"error {error}", "SECOND", "mean"].ours.value == pytest.approx(0.2)
    assert [rows["NDS", "SECOND", name].ours.value for name in ("S1", "S2", "mean")] == pytest.approx([0.2, 0.6, 0.7])
    assert [rows["mAP", "SECOND", name].ours.value for name in ("S1", "S2", "mean")] == pytest.approx([0.1, 0.3, 0.4])
    assert not rows["NDS", "SECOND", "S1"].ours.bounded


def test_the_share_of_a_class_counts_its_videos(tmp_path: Path) -> None:
    """One of six is a collision: Wilson's bounds."""
    rows = [row for row in risk_rows(small_video_set(tmp_path), None) if row.table == BALANCE]
    assert [row.ours.blocks for row in rows] == [6, 6, 6]
    assert (rows[2].ours.low, rows[2].ours.high) == pytest.approx((0.0301, 0.5635), abs=1e-4)
    assert not any(row.ours.valid for row in risk_rows(None, None))


def test_detections_have_three_digits_as_in_the_paper() -> None:
    cells = {row.cells()[:3]: row.cells()[3:5] for row in detection_rows({"PointPillars": detector()})}
    assert cells["mAP", "PointPillars", "S1"] == ("0.398", "0.400 [0.300, 0.500]")
    assert cells["NDS", "PointPillars", "mean"] == ("0.492", "0.450 [-]")
    assert cells["error ATE", "PointPillars", "mean"] == ("0.553", "0.500 [-]")
    family = next(found for (table, _, column), found in cells.items() if (table, column) == (FAMILY, "clearance"))
    assert family == ("0.417", "0.400 [0.300, 0.500]")


def test_bounds_belong_together_and_are_of_five_episodes_at_least() -> None:
    both = interval_in({"value": 0.5, "low": 0.4, "high": 0.7})
    assert (both.value, both.low, both.high, both.blocks) == (0.5, 0.4, 0.7, 5)
    assert interval_in({"value": 0.5, "low": 0.4, "high": 0.7, "episodes": 9}).blocks == 9
    assert not interval_in({"value": 0.5, "low": 0.4, "high": 0.7, "episodes": 4}).bounded, "of an older command"
    for half in ({"low": 0.4, "high": None}, {"low": None, "high": 0.7}):
        assert not interval_in({"value": 0.5, **half}).bounded
    assert interval_in({"NDS": 0.3}, "NDS").value == 0.3
