"""The section about how traffic made way."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from siren_ros.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.evaluation.yielding.scoring import DriverMarks, ScoredEpisode, YieldScores
from siren_ros.evaluation.yielding.thresholds import Measure
from siren_ros.study_report import traffic_sections as making_way
from siren_ros.study_report.study import StudyMeasures, StudyRows
from siren_ros.study_report.traffic_sections import making_way_section

NOTHING = {metric.name: Measure.lacking("nothing") for metric in EPISODE_METRICS}


def measures(*episodes: tuple[str, str, float], in_the_way: bool = False) -> StudyMeasures:
    """Episodes by level and map with their delays; nothing else has a value but the EMV's stops."""
    bags: list[Any] = []
    for seed, (level, map_name, delay_s) in enumerate(episodes):
        metrics = {**NOTHING, "emv_delay_s": Measure(delay_s), "emv_stops": Measure(1.0)}
        drivers = (DriverMarks(3, 0.0, in_the_way, True, False, {}),)
        scores = YieldScores(metrics, drivers)
        bags.append(SimpleNamespace(yielding=ScoredEpisode(f"b{seed}", "S2", level, seed, map_name, "", "", scores)))
    return StudyMeasures(tuple(bags), ())


@pytest.fixture(autouse=True)
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the metrics that are drawn."""
    names: list[str] = []
    monkeypatch.setattr(making_way, "figure_uri", lambda _: "data:")
    monkeypatch.setattr(making_way, "draw_metric", lambda _, metric: names.append(metric.name))
    monkeypatch.setattr(making_way, "draw_drivers", lambda *_: names.append("drivers"))
    return names


@pytest.mark.parametrize("in_the_way", [True, False])
def test_metrics_of_interest_that_have_a_value_are_drawn(drawn: list[str], *, in_the_way: bool) -> None:
    study = StudyRows(Path("s"), {}, (), "")
    section = making_way_section(study, measures(("L1", "town", 3.0), in_the_way=in_the_way))
    assert drawn == ["emv_delay_s"] + ["drivers"] * in_the_way
    assert [figure.key for figure in section.figures] == ["metric_emv_delay_s"] + ["drivers"] * in_the_way


def test_means_by_level_and_map() -> None:
    study = StudyRows(Path("s"), {}, (), "")
    given = measures(*(("L2", "town", delay_s) for delay_s in (1.0, 1.5, 2.0, 2.5, 3.0)), ("L0", "town", 9.0))
    (table,) = making_way_section(study, given).tables
    assert (table.key, table.head) == ("S2", ("metric", "L0", "L2", "meaning"))
    rows = {row[0]: row[1:3] for row in table.cells()}
    assert rows["emv_delay_s"] == ("9.00 [–]", "2.00 [1.02, 2.98]")
    assert rows["compliance"] == ("–", "–")
    assert len(rows) == len(EPISODE_METRICS)
    one, other = making_way_section(study, measures(("L2", "town", 1.0), ("L2", "Town04", 5.0))).tables
    assert [one.key, other.key] == ["S2_Town04", "S2_town"]
    assert one.caption == "Yield metrics of S2 on Town04"
    assert {row[0]: row[1] for row in one.cells()}["emv_delay_s"] == "5.00 [–]"
