"""Stated probability against frequency."""

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from siren_ros.evaluation.prediction.charts.chart import colour_of_model, legend, new_figure, quiet
from siren_ros.evaluation.prediction.metrics.calibration import calibration_error
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable

_SIZE_IN: Final = (4.8, 4.6)
_DIAGONAL_PT: Final = 1.0
_LINE_PT: Final = 1.5
_DOT_PT2: Final = 8.0
_DOTS_PT2: Final = 90.0
"""Area of a dot for no hypothesis, and what is added for all of them."""


def draw_reliability(table: ScoreTable) -> Figure | None:
    """A reliability diagram of the models that state probabilities; None where no model does."""
    stating = [model for model in table.models if table.samples[model].reliability.count.any()]
    if not stating:
        return None
    figure = new_figure(*_SIZE_IN)
    axes = figure.add_subplot()
    quiet(axes)
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#9aa0a6", linewidth=_DIAGONAL_PT, linestyle="--")
    for model in stating:
        counts = table.samples[model].reliability
        there = counts.count > 0
        stated, found = counts.probability[there] / counts.count[there], counts.best[there] / counts.count[there]
        colour = colour_of_model(table.models, model)
        label = f"{model} (error {calibration_error(counts).value:.2f})"
        axes.plot(stated, found, color=colour, linewidth=_LINE_PT, label=label)
        # The area of a dot says how many hypotheses it stands for.
        areas = _DOT_PT2 + _DOTS_PT2 * np.sqrt(counts.count[there] / counts.count.sum())
        axes.scatter(stated, found, s=areas, color=colour)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_aspect("equal")
    axes.set_xlabel("stated probability of a hypothesis")
    axes.set_ylabel("share that was the best")
    legend(axes)
    return figure
