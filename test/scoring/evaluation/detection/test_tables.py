"""Which cells the tables have."""

import json
from dataclasses import replace

import pytest
from made_detections import detector_scores

from siren_ros.base.tables import BLOCKS_MIN, Interval, Table
from siren_ros.scoring.evaluation.detection.scoring import DetectorScores
from siren_ros.scoring.evaluation.detection.tables import PAPER, papers_of, scores_as_json, tables_of
from siren_ros.scoring.evaluation.scores import Score, Scores
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


def test_the_papers_rows_stand_below_ours() -> None:
    """The paper has a detector of one of the names: its row. For the other all of its four are of interest, once."""
    by_template, errors, *_ = tables(*BOTH[1:], compare_paper=True)
    assert cells(by_template)["SECOND (paper)"] == ("0.420/0.420", "0.631/0.563", "0.521/0.510")
    assert list(cells(by_template)) == list(cells(errors)) == ["second", "SECOND (paper)"]
    assert cells(errors)["SECOND (paper)"] == ("0.565", "0.214", "0.207", "3.196", "0.514")
    by_template, _, *_ = tables(*BOTH, compare_paper=True)
    papers = [name for name in cells(by_template) if "(paper)" in name]
    assert papers == [f"{name} (paper)" for name in PAPER]
    by_template, *_ = tables(detector_scores("second", {"S1": 0.4, "own": 0.6}), compare_paper=True)
    assert cells(by_template)["SECOND (paper)"] == ("0.420/0.420", "–", "0.521/0.510"), "it has no such template"
    by_template, *_ = tables(*BOTH[1:])
    assert list(cells(by_template)) == ["second"], "without any interval, and without the paper"


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
        one,
        rows=(*one.rows, Score("pillars", "found by name", "bus", "mAP", Interval(0.5, 0.4, 0.6, BLOCKS_MIN), 3)),
    )
    other = detector_scores("classical", {"S1": 0.4})
    other = replace(other, rows=tuple(row for row in other.rows if row.kind != "family"))
    given = [named, other] if named_first else [other, named]
    *_, parts = tables(*given)
    column = {name: place for place, name in enumerate(parts.head)}
    rows = {row[:2]: row for row in parts.cells()}
    names = ["clearance", "red light", "held", "0-15 m", "bus"]
    assert [name for _, name in rows] == names
    bus, clearance = rows["found by name", "bus"], rows["behaviour family", "clearance"]
    shown = [bus[column[name]] for name in ("labels", "pillars", "classical")]
    assert shown == ["3", "0.500 [0.400, 0.600]", "–"]
    assert (clearance[column["pillars"]], clearance[column["classical"]]) == ("0.400 [0.350, 0.450]", "–")


def test_the_papers_row_of_a_detector() -> None:
    names = {"PointPillars": "PointPillars", "transfusion": "TransFusion-L", "TransFusion_L": "TransFusion-L"}
    for name, row in {**names, "voxelnext": "VoxelNeXt"}.items():
        assert list(papers_of(name)) == [row]
    assert list(papers_of("mine")) == ["PointPillars", "SECOND", "VoxelNeXt", "TransFusion-L"]


@pytest.mark.parametrize("name", PAPER)
def test_the_papers_means_are_those_of_its_templates(name: str) -> None:
    for metric in ("mAP", "NDS"):
        mean = sum(PAPER[name][metric, template] for template in TEMPLATES) / len(TEMPLATES)
        assert PAPER[name][metric, "all"] == pytest.approx(mean, abs=0.0011)


def test_a_detector_and_its_templates_as_json() -> None:
    found = scores_as_json([detector_scores("mine", {"S1": 0.4, "S3": 0.6})])
    json.dumps(found, allow_nan=False)
    scores, model = Scores.of_json(found), found["models"]["mine"]
    assert (model["format"], model["velocity_known"], model["frames"]) == ("nuScenes", True, {"S1": 40, "S3": 40})
    ap = scores.interval("mine", "all", "all", "mAP")
    assert (ap.value, ap.low, ap.high, ap.blocks) == pytest.approx((0.5, 0.45, 0.55, 6))
    assert scores.interval("mine", "family", "clearance", "mAP") == ap
    assert not scores.interval("mine", "family", "red light", "mAP").valid
    assert scores.value("mine", "all", "all", "NDS") == pytest.approx(0.25)
    order = [scores.value("mine", "order", step, "share") for step in ("all", "clearance < stop sign")]
    assert order == [0.25, 0.75]
    held = {"model": "mine", "kind": "behaviour", "group": "held", "metric": "mAP", "samples": 7}
    interval = {"value": 0.25, "low": pytest.approx(0.2), "high": pytest.approx(0.3), "episodes": 6}
    assert {**held, **interval} in found["rows"]
    errors = [scores.value("mine", "template", "S3", error) for error in ("NDS", "ATE", "ASE", "AOE", "AVE", "AAE")]
    assert errors == pytest.approx([0.3, 0.6, 1.6, 2.6, 3.6, 4.6])
    one = model["curves"]["S3"]
    assert (one["labels"], one["detections"]) == (10, 20)
    assert one["AP"] == pytest.approx({"0.5": 0.45, "1": 0.55, "2": 0.65, "4": 0.75})
    curves = one["precision_at_recall_0_to_1"]
    assert [len(curve) for curve in curves] == [101] * 4
    # From 1 down to 0.3 in a hundred steps, to six digits.
    assert [curves[3][place] for place in (0, 1, 100)] == [1.0, 0.993, 0.3]
    rows = scores_as_json([detector_scores("mine", {"S1": 0.4}, bounded=False)])["rows"]
    (ap,) = (row for row in rows if (row["kind"], row["metric"]) == ("all", "mAP"))
    assert [ap[name] for name in ("value", "low", "high", "episodes")] == [0.4, None, None, 1]
    assert not [row for row in rows if row["kind"] == "order"]
