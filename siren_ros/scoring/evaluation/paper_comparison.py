"""Compares all numbers of the paper's tables with our measurements."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.params import plain_files
from siren_ros.base.tables import NOTHING, Bounds, Interval, Row, Table, share_interval
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.metrics import ERRORS
from siren_ros.scoring.evaluation.detection.scoring import FAMILIES, MEAN_AP
from siren_ros.scoring.evaluation.detection.tables import PAPER
from siren_ros.scoring.evaluation.prediction.metrics import METRIC_OF
from siren_ros.scoring.evaluation.prediction.reports.paper_results import PAPER as PREDICTION
from siren_ros.scoring.evaluation.prediction.reports.paper_results import PAPER_NAMES, PAPER_SAMPLES, paper_row
from siren_ros.scoring.evaluation.prediction.reports.score_table import ScoreTable, strata, sums_of
from siren_ros.scoring.evaluation.prediction.scoring import EpisodeScores
from siren_ros.scoring.evaluation.risk.labels import TITLES, RiskClass
from siren_ros.scoring.evaluation.risk.report import PAPER_BALANCE, PAPER_SCORES
from siren_ros.scoring.evaluation.risk.video_set import VideoSet
from siren_ros.scoring.evaluation.scores import ALL, TEMPLATE, Scores
from siren_ros.scoring.evaluation.statistics import (
    RANKED_MIN,
    BlockSums,
    block_sums,
    estimate_of_mean,
    interval_of_mean,
    jackknife,
    ranking_interval,
)
from siren_ros.simulation.scenario.paper import TEMPLATES


@dataclass(frozen=True)
class Compared:
    """One number of the paper with our measurement."""

    table: str
    """Table of the paper, or the subject in its text: ``ADE in m``."""
    row: str
    """Row of the table: ``CV``, ``PointPillars``."""
    column: str
    """Column of the table: ``S1``, ``mean``."""
    paper: float
    ours: Interval = NOTHING
    """Our value with its interval; not valid if it was not measured."""
    digits: int = 2
    relative: bool = True
    """Whether the ratio of both values is meaningful, which is not the case for a rank correlation."""
    map: str = ""
    """Map of our episodes, several separated by commas; empty if the scores do not say."""

    @property
    def deviation(self) -> float | None:
        """Relative deviation of our value from the paper's: +0.4 is 40 % above.

        None if not meaningful or the paper has 0.
        """
        return self.ours.value / self.paper - 1.0 if self.relative and self.ours.valid and self.paper else None

    @property
    def inside(self) -> bool | None:
        """Whether the paper's value lies in our interval; None without an interval."""
        return self.ours.low <= self.paper <= self.ours.high if self.ours.bounded else None

    @property
    def deviation_text(self) -> str | None:
        """The deviation as text, ``+4%``, with a star if the paper's value lies in our interval.

        None without a deviation.
        """
        text = f"{'' if self.deviation is None else f'{self.deviation:+.0%}'}{' *' if self.inside else ''}".strip()
        return text or None

    def to_json(self) -> dict[str, Any]:
        """The row as JSON types; null where there is no value."""
        interval = self.ours.json()
        return {
            "table": self.table,
            "row": self.row,
            "column": self.column,
            "map": self.map,
            "paper": self.paper,
            "ours": interval.pop("value"),
            **interval,
            "deviation": self.deviation,
            "paper_inside": self.inside,
        }


def measured(rows: Sequence[Compared]) -> list[Compared]:
    """Rows for which we have a value."""
    return [row for row in rows if row.ours.valid]


def comparison_tables(rows: Sequence[Compared]) -> tuple[Table, ...]:
    """One table for each of the paper's; below each row of the paper are our value, its interval and the deviation.

    A star behind the deviation says that the paper's value lies in our interval.
    """
    tables = []
    for number, name in enumerate(dict.fromkeys(row.table for row in rows)):
        of_table = [row for row in rows if row.table == name]
        columns = dict.fromkeys(row.column for row in of_table)
        lines: list[Row] = []
        for model in dict.fromkeys(row.row for row in of_table):
            by_column = {row.column: row for row in of_table if row.row == model}
            cells = [by_column.get(column) for column in columns]
            ours = [row.ours if row else NOTHING for row in cells]
            lines.append((f"{model}, paper", *(row.paper if row else None for row in cells)))
            lines.append((f"{model}, here", *(interval.value if interval.valid else None for interval in ours)))
            if any(interval.valid for interval in ours):
                lines.append((f"{model}, 95 %", *map(Bounds, ours)))
                lines.append((f"{model}, deviation", *(row.deviation_text if row else None for row in cells)))
        lead, space, others = name.partition(" ")
        title = f"{lead.capitalize()}{space}{others}" if lead.islower() else name
        tables.append(Table(f"paper_{number}", title, ("", *columns), tuple(lines), f".{of_table[0].digits}f"))
    return tuple(tables)


FILE: Final = "scores.json"


def stored(folder: Path) -> Mapping[str, Any] | None:
    """Scores stored in a folder or file; None if there are none.

    Raises:
        InputError: Something else than a JSON object.
    """
    file = folder if folder.is_file() else folder / FILE
    if not file.is_file():
        return None
    try:
        content = plain_files.read_json(file)
    except (OSError, ValueError) as error:
        raise InputError("scores", str(file), f"the scores that `siren evaluate` wrote ({error})") from error
    if not isinstance(content, dict):
        raise InputError("scores", str(file), "the scores that `siren evaluate` wrote, a JSON object")
    return content


PREDICTION_ERRORS: Final = {
    "ade_m": "ADE in m",
    "fde_m": "FDE in m",
    "rmse_5s_m": "RMSE at 5 s in m",
    "min_ade_6_m": "minADE6 in m",
    "min_fde_6_m": "minFDE6 in m",
}
"""Errors in the paper's three tables of prediction."""
_SINGLE_PATH: Final = {"min_ade_6_m": "ade_m", "min_fde_6_m": "fde_m"}
"""Metric that equals the minimum over paths for a predictor with one path; the paper's table leaves such rows out."""
MEAN_COLUMN: Final = "mean"
RANKING: Final = "rank correlation of the templates' ADE"
RATIO: Final = "mean ADE over that of CV"
SAMPLES: Final = "samples of an episode"


def at_template_level(scores: Sequence[EpisodeScores], level_of: Callable[[str], str]) -> list[EpisodeScores]:
    """Select the episodes at their template's own level; the paper has one level per template."""
    return [
        episode
        for episode in scores
        if episode.template in TEMPLATES and episode.level.name == level_of(episode.template)
    ]


def prediction_rows(table: ScoreTable) -> Iterator[Compared]:
    """All rows for prediction, also those that we did not measure.

    The episodes are at the levels of their templates, the vehicles those of the interaction region.
    """
    maps = ",".join(sorted({episode.map_name for episode in table.episodes}))
    for row in (*_errors(table), *_samples(table), *_ratios(table), *_rankings(table)):
        yield replace(row, map=maps)


def _errors(table: ScoreTable) -> Iterator[Compared]:
    for (metric, title), (model, name) in product(PREDICTION_ERRORS.items(), PAPER_NAMES.items()):
        row = PREDICTION[model, metric]
        if row is paper_row(model, _SINGLE_PATH.get(metric, "")):
            continue
        for group, paper in row.items():
            cell = table.cells.get((model, group, metric))
            yield Compared(title, name, _column(group), paper, NOTHING if cell is None else cell.interval)


def _column(group: str) -> str:
    return MEAN_COLUMN if group == ALL else group


def _samples(table: ScoreTable) -> Iterator[Compared]:
    """Mean number of samples per episode, with the interval over episodes."""
    template = np.array([episode.template for episode in table.episodes])
    counts = np.array([episode.samples for episode in table.episodes], dtype=np.float64)
    for name in TEMPLATES:
        of_template = counts[template == name]
        blocks = np.arange(len(of_template))
        mean = interval_of_mean(block_sums(of_template, blocks, 0 * blocks))
        yield Compared(SAMPLES, "all vehicles", name, float(PAPER_SAMPLES[name]), mean, digits=0)


def _sums(table: ScoreTable, *models: str) -> tuple[list[str], list[BlockSums]]:
    """Sums of the ADE over the episodes in which all of some models have a sample, with the names of the strata."""
    templates = np.array([episode.template for episode in table.episodes])
    ade, stratum = METRIC_OF["ade_m"], strata(table.episodes)
    tables = [table.samples[model] for model in models]
    sums = [sums_of(samples, ade, np.arange(len(samples)), stratum) for samples in tables]
    common = np.logical_and.reduce([of_model.count > 0 for of_model in sums])
    names, stratum = np.unique(templates[common], return_inverse=True)
    return names.tolist(), [replace(of_model.select(common), stratum=stratum) for of_model in sums]


def _ratios(table: ScoreTable) -> Iterator[Compared]:
    for model, name in PAPER_NAMES.items():
        if model == "cv":
            continue
        paper, ratio = PREDICTION[model, "ade_m"][ALL] / PREDICTION["cv", "ade_m"][ALL], NOTHING
        if {model, "cv"} <= set(table.models):
            _, (ours, of_cv) = _sums(table, model, "cv")
            if len(ours):
                left_out = ours.left_out() / of_cv.left_out()
                ratio = jackknife(ours.value() / of_cv.value(), left_out, ours.stratum).interval()
        yield Compared(RATIO, name, MEAN_COLUMN, paper, ratio)


def _rankings(table: ScoreTable) -> Iterator[Compared]:
    """Spearman's ρ between our ranking of templates and the paper's; the paper's own is 1."""
    for model, name in PAPER_NAMES.items():
        row, ranking = PREDICTION[model, "ade_m"], NOTHING
        if model in table.models:
            names, (sums,) = _sums(table, model)
            if len(names) >= RANKED_MIN:
                estimates = [estimate_of_mean(sums.select(sums.stratum == number)) for number in range(len(names))]
                ranking = ranking_interval(estimates, [row[template] for template in names])
        yield Compared(RANKING, name, "Spearman", 1.0, ranking, relative=False)


FAMILY: Final = "mAP of a family; paper: mean of its four"
ORDER: Final = "order of the families by mAP as in the paper"


def detection_rows(content: Mapping[str, Any] | None) -> Iterator[Compared]:
    """All rows for detection, also unmeasured ones, from ``scores.json`` of ``siren evaluate detection``."""
    scores = _scores_in(content)
    named = {name.lower(): name for name in scores.models}
    for name, row in PAPER.items():
        model = named.get(name.lower(), "")
        for (metric, group), value in row.items():
            ours = scores.interval(model, ALL if group == ALL else TEMPLATE, group, metric)
            table = f"error {metric}" if metric in ERRORS else metric
            yield Compared(table, name, _column(group), value, ours, digits=3)
    # A detector with another name is compared with the mean of the paper's four.
    for name in scores.models:
        for family, templates in FAMILIES.items():
            paper = float(np.mean([row[MEAN_AP, template] for row in PAPER.values() for template in templates]))
            yield Compared(FAMILY, name, family, paper, scores.interval(name, "family", family, MEAN_AP), digits=3)
        order = scores.interval(name, "order", ALL, "share")
        if order.valid:
            yield Compared(ORDER, name, "share of the draws", 1.0, order, relative=False)


BALANCE: Final = "share of the videos"


def risk_rows(videos: VideoSet | None, content: Mapping[str, Any] | None) -> Iterator[Compared]:
    """All rows for risk, also unmeasured ones, from a set and ``scores.json`` of ``siren evaluate risk``."""
    labels = [] if videos is None else [video.label.risk for video in videos.videos.values()]
    for risk, count in zip(RiskClass, PAPER_BALANCE, strict=True):
        share = share_interval(labels.count(risk), len(labels))
        yield Compared(BALANCE, "labels", TITLES[risk], count / sum(PAPER_BALANCE), share)
    ours = _scores_in(content)
    for name, scores in PAPER_SCORES.items():
        for score, value in scores.items():
            yield Compared("risk scores", name, score, value, ours.interval(name, ALL, ALL, score), digits=3)


def _scores_in(content: Mapping[str, Any] | None) -> Scores:
    return Scores(()) if content is None else Scores.of_json(content)
