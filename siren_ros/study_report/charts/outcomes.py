"""In how many episodes the predicate holds, by template and level."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from siren_ros.evaluation.prediction.charts.chart import new_figure, quiet
from siren_ros.studies.episode_row import EpisodeRow, Status
from siren_ros.study_report.charts.style import (
    LEVEL_COLOURS,
    OF_A_PLACE,
    OTHER_LEVEL,
    WIDTH_IN,
    level_legend,
    titled,
)

_HEIGHT_IN: Final = 2.5
_BAR: Final = 0.86
"""Share of a level's part of a place that its bar is wide."""
_OUTLINE_PT: Final = 0.8


def draw_outcomes(rows: Sequence[EpisodeRow]) -> Figure:
    """Bars by template and level: filled where the predicate holds, an outline for all complete episodes."""
    complete = [row for row in rows if row.status is Status.COMPLETE]
    templates = sorted({row.template for row in rows})
    levels = sorted({row.level for row in rows})
    figure = new_figure(WIDTH_IN, _HEIGHT_IN)
    axes = figure.add_subplot()
    quiet(axes)
    width = OF_A_PLACE / max(len(levels), 1)
    for number, level in enumerate(levels):
        here = [[row for row in complete if (row.template, row.level) == (name, level)] for name in templates]
        places = np.arange(len(templates)) + (number - 0.5 * (len(levels) - 1)) * width
        colour = LEVEL_COLOURS.get(level, OTHER_LEVEL)
        axes.bar(
            places, [len(one) for one in here], width * _BAR, color="none", edgecolor=colour, linewidth=_OUTLINE_PT
        )
        axes.bar(places, [sum(bool(row.predicate_holds) for row in one) for one in here], width * _BAR, color=colour)
    axes.set_xticks(range(len(templates)), templates)
    axes.grid(visible=False, axis="x")
    axes.set_ylabel("episodes")
    titled(axes, "filled: the predicate holds; outline: complete episodes")
    level_legend(axes, levels)
    return figure
