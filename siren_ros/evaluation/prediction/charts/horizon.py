"""Error over the prediction horizon."""

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from siren_ros.evaluation.prediction.charts.chart import TITLE_PT, colour_of_model, legend, new_figure, quiet
from siren_ros.evaluation.prediction.protocol.window import future_times_s
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable

_SIZE_IN: Final = (6.4, 4.0)
_LINE_PT: Final = 1.8


def draw_horizon(table: ScoreTable) -> Figure:
    """Mean distance of the most probable paths from the truth over time, a line for each model with samples."""
    figure = new_figure(*_SIZE_IN)
    axes = figure.add_subplot()
    quiet(axes)
    times = np.concatenate(([0.0], future_times_s()))
    for model in table.models:
        samples = table.samples[model]
        if not len(samples):
            continue
        distance = np.concatenate(([0.0], samples.distance_sum_m / len(samples)))
        colour = colour_of_model(table.models, model)
        axes.plot(times, distance, color=colour, linewidth=_LINE_PT, label=model)
    axes.set_xlim(0.0, times[-1])
    axes.set_ylim(0.0)
    axes.set_xlabel("time after the present, s")
    axes.set_ylabel("mean distance, m")
    axes.set_title(
        f"error over the horizon, all samples of {len(table.episodes)} episodes", fontsize=TITLE_PT, loc="left"
    )
    if axes.lines:
        legend(axes)
    return figure
