"""A small study of synthetic episodes, and its page."""

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from siren_ros.base.tables import Interval
from siren_ros.reports.study_report.build import assembled
from siren_ros.reports.study_report.page import html_of
from siren_ros.reports.study_report.study import PageOptions, measure_study, read_rows
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import PlannedEpisode, Study
from siren_ros.running.studies.study_folder import LocalFolder, write_study, write_table
from siren_ros.scoring.evaluation.detection.metrics import ERRORS, DevkitScore
from siren_ros.scoring.evaluation.detection.scoring import DetectorScores
from siren_ros.scoring.evaluation.detection.tables import scores_as_json
from siren_ros.scoring.evaluation.risk.report import scores_as_json as risk_scores_as_json
from siren_ros.scoring.evaluation.risk.scoring import ModelScores
from siren_ros.scoring.evaluation.scores import Score, single
from siren_ros.simulation.scenario.episode import EpisodeRequest


def row_of(level: str, seed: int, status: Status = Status.COMPLETE, reason: str = "") -> EpisodeRow:
    name = f"S2_{level}_seed{seed}"
    planned = PlannedEpisode(name, f"S2_{level}", EpisodeRequest("S2", level, seed), -1, "ab" * 32)
    known = {"simulated_s": 9.0, "cpu_s": 3.0, "predicate_holds": level == "L2", "bag": f"episodes/S2_{level}/{name}"}
    return EpisodeRow.planned(planned, status, reason, **known if status is Status.COMPLETE else {})


def detector_scores() -> DetectorScores:
    """Scores as `siren evaluate detection` has them; what is not written to its file is left empty."""
    score = DevkitScore(40, 50, {0.5: 0.2, 4.0: 0.4}, dict.fromkeys(ERRORS, 0.25), 0.3125, 0.4375, np.zeros((2, 101)))
    interval = Interval(0.3125, 0.25, 0.375, 6)
    nothing: Any = None
    rows = [
        Score("made", *group, metric, value, 40)
        for group in (("all", "all"), ("template", "S2"))
        for metric, value in {"mAP": interval, "NDS": single(0.4375), **dict.fromkeys(ERRORS, single(0.25))}.items()
    ]
    rows += [Score("made", "EMV", name, "mAP", interval, count) for name, count in (("the EMV", 12), ("none", 0))]
    return DetectorScores("made", "topic", True, {"S2": 9}, {"S2": score}, {}, tuple(rows), {}, *[nothing] * 3)


def risk_scores() -> ModelScores:
    """Two of four videos right."""
    counts = np.array([[2, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    return ModelScores("made", 5, 4, counts, {"S2": counts})


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    """Two seeds at two levels, one row that the table lacks, and one episode that is missing."""
    root = tmp_path_factory.mktemp("reported") / "small study"
    rows = [row_of(level, seed) for level in ("L1", "L2") for seed in (0, 1)]
    for row in rows:
        (root / row.bag).parent.mkdir(parents=True, exist_ok=True)
        changing = 4 if row.level == "L2" else 1
        write_bag(root / row.bag, duration_s=9.0, level=row.level, seed=row.seed, changing=changing)
    folder = LocalFolder(root)
    write_study(folder, Study(("S2",), ("L1", "L2"), (0, 1)).to_json())
    write_table(folder, [*rows[:-1], row_of("L3", 0, Status.REFUSED, "no site on <this> map")])
    folder.note(rows[-1])
    for task, scores in (
        ("detection", scores_as_json([detector_scores()])),
        ("risk", risk_scores_as_json([risk_scores()])),
    ):
        (root / task).mkdir()
        (root / task / "scores.json").write_text(json.dumps(scores), encoding="utf-8")
    return root


@pytest.fixture(scope="session")
def made(study: Path, tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """The page's content and file, and the measures behind it."""
    rows = read_rows(study)
    measures = measure_study([study / row.bag for row in rows.rows if row.bag], ("cv", "idm"), 1)
    file = tmp_path_factory.mktemp("page") / "page.html"
    options = PageOptions(("cv", "idm"), film_s=1.0, pages=2, pages_folder=file.with_name("my #1 pages"))
    page, pages = assembled(rows, measures, options)
    file.write_text(html_of(page), encoding="utf-8")
    assert pages.write(1) == (2, sum(path.stat().st_size for path in options.pages_folder.iterdir()), ())
    tables = {f"{section.key}_{table.key}": table for section in page.sections for table in section.tables}
    return SimpleNamespace(rows=rows, measures=measures, page=page, file=file, tables=tables)
