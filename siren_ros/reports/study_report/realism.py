"""The page of ``siren evaluate realism``: a study next to published figures, and next to tracks of real traffic."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from siren_ros.base.tables import Table
from siren_ros.reports.study_report.charts import WIDTH_IN, titled_axes
from siren_ros.reports.study_report.page import Page, Picture, Section, figure_uri
from siren_ros.scoring.evaluation.prediction.charts import SMALL_PT, new_figure
from siren_ros.scoring.evaluation.realism.distributions import Distributions, distribution_table
from siren_ros.scoring.evaluation.realism.ledger import (
    AGREES,
    DIFFERS,
    UNDECIDED,
    LedgerResult,
    ledger_table,
    sources_table,
    unanswered_table,
    verdict_counts,
)
from siren_ros.scoring.pictures.plot_parts import FAINT_TEXT, TEXT

_COLOURS: Final = {AGREES: "#12855f", DIFFERS: "#b3121a", UNDECIDED: FAINT_TEXT}
_HEAD_IN, _ROW_IN = 0.8, 0.24
_LEAST, _MOST = 0.1, 10.0
"""Ratios outside stand at the edge."""
_CURVES: Final = "Cumulative distributions of ordinary traffic: simulated (dark) and real (blue)"
_SAME_CODE: Final = (
    "Both sides are measured by the same code, without a map. Speeds are those of the way driven in a second, because "
    "single positions of a tracker are noisy. Limits and streets differ from those of the templates."
)
_COLUMNS: Final = 3
_HOW: Final = (
    "Values are of all episodes at their own level, with 95 % intervals over episodes. A line agrees if its interval "
    "overlaps the published one. In the chart a band is the published interval."
)
_PANEL_IN: Final = 2.2
_REAL: Final = "#1a86b8"


def realism_tables(results: Sequence[LedgerResult], found: Distributions, recordings: int) -> tuple[Table, ...]:
    """The tables of a terminal: published figures, ordinary traffic if there are recordings, and what has no answer."""
    traffic = (distribution_table(found),) if recordings else ()
    return (ledger_table(results), *traffic, unanswered_table(results))


def summary_of(results: Sequence[LedgerResult]) -> str:
    """How many lines agree, as a sentence."""
    counts = verdict_counts(results)
    answered = sum(result.answered for result in results)
    told = (
        f"The study answers {answered} of {len(results)} lines: {counts[AGREES]} agree, "
        f"{counts[DIFFERS]} differ, {counts[UNDECIDED]} cannot be decided with so few episodes."
    )
    held_out = verdict_counts([result for result in results if not result.fitted])
    if held_out == counts:
        return told
    return (
        f"{told} Of those that the drivers were not fitted to, {held_out[AGREES]} agree and {held_out[DIFFERS]} differ."
    )


def realism_page(
    study: str, results: Sequence[LedgerResult], found: Distributions, recordings: int, command: str
) -> Page:
    """The page.

    Args:
        study: Name of the study.
        results: The lines of the ledger.
        found: Ordinary traffic.
        recordings: Number of real recordings; without any the section is left out.
        command: What makes the page again.
    """
    caption = "Predicted value as a multiple of the published one"
    chart = Picture("ratios", caption, figure_uri(_ratios(results)))
    figures = (summary_of(results), _HOW)
    tables = (ledger_table(results),)
    sections = [Section("ledger", "Published figures", figures, (chart,), tables=tables, commands=(command,))]
    if recordings:
        curves = Picture("distributions", _CURVES, figure_uri(_curves(found)))
        tables = (distribution_table(found),)
        sections.append(Section("traffic", "Ordinary traffic", (_SAME_CODE,), (curves,), tables=tables))
    rest = unanswered_table(results), sources_table(results)
    sections.append(Section("unanswered", "What a study cannot answer, and sources", tables=rest))
    return Page("Next to reality", f"How near {study} is to what was measured on streets.", sections)


def _ratios(results: Sequence[LedgerResult]) -> Figure:
    shown = [one for one in results if one.answered and one.line.value > 0.0]
    figure = new_figure(WIDTH_IN, _HEAD_IN + _ROW_IN * max(len(shown), 1))
    axes = titled_axes(figure, "predicted / published")
    axes.axvline(1.0, color=FAINT_TEXT, linewidth=0.8)
    for row, one in enumerate(shown):
        line, colour = one.line, _COLOURS[one.verdict]
        low, high, value = (
            float(np.clip(bound / line.value, _LEAST, _MOST)) for bound in (line.low, line.high, one.predicted.value)
        )
        axes.barh(row, high - low, left=low, height=0.7, color=FAINT_TEXT, alpha=0.25)
        axes.plot(value, row, "o", markersize=4, color=colour)
        if one.predicted.bounded:
            first, last = (
                float(np.clip(end / line.value, _LEAST, _MOST)) for end in (one.predicted.low, one.predicted.high)
            )
            axes.hlines(row, first, last, color=colour, linewidth=1.4)
    axes.set_xscale("log")
    axes.set_xlim(_LEAST, _MOST)
    axes.set_xticks((0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0), ("0.1", "0.2", "0.5", "1", "2", "5", "10"))
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.set_yticks(range(len(shown)), [f"{one.line.line_id}  {one.line.about}" for one in shown], fontsize=SMALL_PT)
    return figure


def _curves(found: Distributions) -> Figure:
    rows = -(-len(found) // _COLUMNS)
    figure = new_figure(WIDTH_IN, _PANEL_IN * rows)
    for place, (name, sides) in enumerate(found.items(), start=1):
        axes = titled_axes(figure, name, rows, _COLUMNS, place)
        for values, colour in zip(sides, (TEXT, _REAL), strict=True):
            ordered = np.sort(values)
            axes.step(ordered, np.arange(1, len(ordered) + 1) / max(len(ordered), 1), where="post", color=colour)
        axes.set_ylim(0.0, 1.02)
    return figure
