"""Which cells the tables have."""

import json
from dataclasses import replace

import pytest
from made_detections import detector_scores

from siren_ros.base.tables import BLOCKS_MIN, Interval, Table
from siren_ros.scoring.evaluation.detection.scoring import DetectorScores, GroupScore
from siren_ros.scoring.evaluation.detection.tables import MEAN, PAPER, paper_rows, scores_as_json, tables_of
from siren_ros.simulation.scenario.paper import TEMPLATES

BOTH = (
    detector_scores("mine", {"S1": 0.4, "S3": 0.6}),
    detector_scores("second", {"S1": 0.25, "S3": 1.0}, bounded=False),
)
"""Means of 0.5 and 0.625; NDS is half of the mAP."""


def tables(*scores: DetectorScores, compare_paper: bool = False) -> tuple[Table, ...]:
    """By template, errors, errors by template, parts."""
    return tables_of(scores_as_json(scores), compare_paper=compare_paper)


def cells(table: Table) -> dict[str, tuple[str, ...]]:
    return {row[0]: row[1:] for row in table.cells()}


def test_map_and_nds_stand_by_template_with_the_intervals_below() -> None:
    by_template, _, *_ = tables(*BOTH)
    assert by_template.head == ("detector", "S1", "S3", "mean")
    assert by_template.cells() == [
        ("mine", "0.400/0.200", "0.600/0.300", "0.500/0.250"),
        ("second", "0.250/0.125", "1.000/0.500", "0.625/0.312"),
        ("mine, 95 % of mAP", "[0.350, 0.450]", "[0.550, 0.650]", "[0.450, 0.550]"),
        ("second, 95 % of mAP", "[–]", "[–]", "[–]"),
    ]


def test_without_any_interval_there_are_no_rows_of_them() -> None:
    by_template, _, *_ = tables(*BOTH[1:])
    assert list(cells(by_template)) == ["second"]


def test_the_papers_rows_stand_below_ours() -> None:
    """The paper has a detector of one of the names: its row. For the other all of its four are of interest, once."""
    by_template, errors, *_ = tables(*BOTH[1:], compare_paper=True)
    assert cells(by_template)["SECOND (paper)"] == ("0.420/0.420", "0.631/0.563", "0.521/0.510")
    assert list(cells(by_template)) == list(cells(errors)) == ["second", "SECOND (paper)"]
    assert cells(errors)["SECOND (paper)"] == ("0.565", "0.214", "0.207", "3.196", "0.514")
    by_template, _, *_ = tables(*BOTH, compare_paper=True)
    papers = [name for name in cells(by_template) if "(paper)" in name]
    assert papers == [f"{row.name} (paper)" for row in PAPER.values()]


def test_a_template_that_the_paper_does_not_have_is_a_dash() -> None:
    by_template, *_ = tables(detector_scores("second", {"S1": 0.4, "own": 0.6}), compare_paper=True)
    assert cells(by_template)["SECOND (paper)"] == ("0.420/0.420", "–", "0.521/0.510")


def test_errors_are_means_over_the_templates() -> None:
    """ATE of the made scores is the mAP, and each of the next errors one more."""
    _, errors, by_template, _ = tables(*BOTH)
    assert errors.head == ("detector", "ATE m", "ASE", "AOE rad", "AVE m/s", "AAE")
    assert cells(errors)["mine"] == ("0.500", "1.500", "2.500", "3.500", "4.500")
    assert by_template.cells()[0] == ("mine", "S1", "0.400", "1.400", "2.400", "3.400", "4.400")


def test_parts_have_a_row_where_somebody_has_labels_of_them() -> None:
    *_, parts = tables(*BOTH)
    assert parts.head == ("of", "labels that are", "labels", "mine", "second")
    assert parts.cells() == [
        ("behaviour family", "clearance", "", "0.500 [0.450, 0.550]", "0.625 [–]"),
        ("behaviour family", "red light", "", "–", "–"),
        ("behaviour", "held", "7", "0.250 [0.200, 0.300]", "0.250 [–]"),
        ("distance", "0-15 m", "8/9", "1.000 [0.950, 1.050]", "1.000 [–]"),
    ]


@pytest.mark.parametrize("named_first", [True, False])
def test_detectors_with_different_parts_have_the_rows_of_all(named_first: bool) -> None:
    one = detector_scores("pillars", {"S1": 0.4})
    named = replace(
        one, groups=(*one.groups, GroupScore("found by name", "bus", 3, Interval(0.5, 0.4, 0.6, BLOCKS_MIN)))
    )
    other = replace(detector_scores("classical", {"S1": 0.4}), families={})
    given = [named, other] if named_first else [other, named]
    *_, parts = tables(*given)
    column = {name: place for place, name in enumerate(parts.head)}
    rows = {row[:2]: row for row in parts.cells()}
    assert list(rows) == [
        ("behaviour family", "clearance"),
        ("behaviour family", "red light"),
        ("behaviour", "held"),
        ("distance", "0-15 m"),
        ("found by name", "bus"),
    ]
    bus = rows["found by name", "bus"]
    assert (bus[column["labels"]], bus[column["pillars"]], bus[column["classical"]]) == (
        "3",
        "0.500 [0.400, 0.600]",
        "–",
    )
    clearance = rows["behaviour family", "clearance"]
    assert (clearance[column["pillars"]], clearance[column["classical"]]) == ("0.400 [0.350, 0.450]", "–")


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("PointPillars", ["PointPillars"]),
        ("transfusion", ["TransFusion-L"]),
        ("TransFusion_L", ["TransFusion-L"]),
        ("voxelnext", ["VoxelNeXt"]),
        ("mine", ["PointPillars", "SECOND", "VoxelNeXt", "TransFusion-L"]),
    ],
)
def test_the_papers_row_of_a_detector(name: str, rows: list[str]) -> None:
    assert [row.name for row in paper_rows(name)] == rows


@pytest.mark.parametrize("name", PAPER)
def test_the_papers_means_are_those_of_its_templates(name: str) -> None:
    pairs = PAPER[name].ap_and_nds
    for place in (0, 1):
        mean = sum(pairs[template][place] for template in TEMPLATES) / len(TEMPLATES)
        assert pairs[MEAN][place] == pytest.approx(mean, abs=0.0011)


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
