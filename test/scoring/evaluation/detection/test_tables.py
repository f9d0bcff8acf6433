"""Which cells the tables have."""

from dataclasses import replace

import pytest
from made_detections import detector_scores

from siren_ros.base.tables import BLOCKS_MIN, Interval, Table
from siren_ros.scoring.evaluation.detection.scoring import DetectorScores
from siren_ros.scoring.evaluation.detection.tables import PAPER, papers_of, scores_as_json, tables_of
from siren_ros.scoring.evaluation.scores import Score
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
