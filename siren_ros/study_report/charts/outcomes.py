"""In how many episodes the predicate holds, by template and level."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from siren_ros.evaluation.prediction.charts.chart import new_figure, quiet
from siren_ros.studies.episode_row import EpisodeRow, Status
from siren_ros.study_report.charts.style import LEVEL_COLOURS, level_legend


def draw_outcomes(rows: Sequence[EpisodeRow]) -> Figure:
    """Bars by template and level: filled where the predicate holds, an outline for all complete episodes."""
    complete = [row for row in rows if row.status is Status.COMPLETE]
    templates = sorted({row.template for row in rows})
    levels = sorted({row.level for row in rows})
    figure = new_figure(9.0, 2.5)
    axes = figure.add_subplot()
    quiet(axes)
    width = 0.8 / max(len(levels), 1)
    for number, level in enumerate(levels):
        here = [[row for row in complete if (row.template, row.level) == (name, level)] for name in templates]
        places = np.arange(len(templates)) + (number - 0.5 * (len(levels) - 1)) * width
        colour = LEVEL_COLOURS.get(level, "#5c6b73")
        axes.bar(places, [len(one) for one in here], width * 0.86, color="none", edgecolor=colour, linewidth=0.8)
        axes.bar(places, [sum(bool(row.predicate_holds) for row in one) for one in here], width * 0.86, color=colour)
    axes.set_xticks(range(len(templates)), templates)
    axes.grid(visible=False, axis="x")
    axes.set_ylabel("episodes")
    axes.set_title("filled: the predicate holds; outline: complete episodes", fontsize=9, loc="left")
    level_legend(axes, levels)
    return figure
