"""Charts of scores: error over the horizon, stated probability against frequency, and the style that charts share."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from siren_ros.errors import whole_file, writing
from siren_ros.evaluation.prediction.metrics import calibration_error
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable
from siren_ros.evaluation.prediction.samples import future_times_s
from siren_ros.pictures.palette import FAINT_TEXT, TEXT

DPI: Final = 150
SMALL_PT: Final = 8
"""Text of legends, ticks and titles of panels."""
TITLE_PT: Final = 9
_GRID_PT: Final = 0.7
_COLOURS: Final = ("#e08e1b", "#1a86b8", "#12855f", "#c2358f", "#6b4fc0", "#7a5230", "#4fb3bf", "#9aa51c", "#5c6b73")
"""Distinct from each other, from the roads and from the EMV's red."""


def colour_of_model(models: Sequence[str], model: str) -> str:
    """The same colour in every chart of a report."""
    return _COLOURS[list(models).index(model) % len(_COLOURS)]


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def quiet(axes: Axes) -> None:
    """Thin lines, no box."""
    axes.grid(color="#e3e5e8", linewidth=_GRID_PT)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(colors=FAINT_TEXT, labelsize=SMALL_PT)
    axes.xaxis.label.set_color(TEXT)
    axes.yaxis.label.set_color(TEXT)


def legend(axes: Axes) -> None:
    """Small, without a box."""
    axes.legend(frameon=False, fontsize=SMALL_PT)


def save(figure: Figure, path: Path) -> None:
    """Writes a figure as PNG.

    Raises:
        InputError: The file cannot be written.
    """
    with writing(path), whole_file(path) as file:
        figure.savefig(file)


_HORIZON_SIZE_IN: Final = (6.4, 4.0)
_HORIZON_LINE_PT: Final = 1.8


def draw_horizon(table: ScoreTable) -> Figure:
    """Mean distance of the most probable paths from the truth over time, a line for each model with samples."""
    figure = new_figure(*_HORIZON_SIZE_IN)
    axes = figure.add_subplot()
    quiet(axes)
    times = np.concatenate(([0.0], future_times_s()))
    for model in table.models:
        samples = table.samples[model]
        if not len(samples):
            continue
        distance = np.concatenate(([0.0], samples.distance_sum_m / len(samples)))
        colour = colour_of_model(table.models, model)
        axes.plot(times, distance, color=colour, linewidth=_HORIZON_LINE_PT, label=model)
    axes.set_xlim(0.0, times[-1])
    axes.set_ylim(0.0)
    axes.set_xlabel("time after the present, s")
    axes.set_ylabel("mean distance, m")
    title = f"error over the horizon, all samples of {len(table.episodes)} episodes"
    axes.set_title(title, fontsize=TITLE_PT, loc="left")
    if axes.lines:
        legend(axes)
    return figure


_RELIABILITY_SIZE_IN: Final = (4.8, 4.6)
_DIAGONAL_PT: Final = 1.0
_RELIABILITY_LINE_PT: Final = 1.5
_DOT_PT2: Final = 8.0
_DOTS_PT2: Final = 90.0
"""Area of a dot for no hypothesis, and what is added for all of them."""


def draw_reliability(table: ScoreTable) -> Figure | None:
    """A reliability diagram of the models that state probabilities; None where no model does."""
    stating = [model for model in table.models if table.samples[model].reliability.count.any()]
    if not stating:
        return None
    figure = new_figure(*_RELIABILITY_SIZE_IN)
    axes = figure.add_subplot()
    quiet(axes)
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#9aa0a6", linewidth=_DIAGONAL_PT, linestyle="--")
    for model in stating:
        counts = table.samples[model].reliability
        there = counts.count > 0
        stated, best = counts.probability[there] / counts.count[there], counts.best[there] / counts.count[there]
        colour = colour_of_model(table.models, model)
        label = f"{model} (error {calibration_error(counts).value:.2f})"
        axes.plot(stated, best, color=colour, linewidth=_RELIABILITY_LINE_PT, label=label)
        # The area of a dot says how many hypotheses it stands for.
        areas = _DOT_PT2 + _DOTS_PT2 * np.sqrt(counts.count[there] / counts.count.sum())
        axes.scatter(stated, best, s=areas, color=colour)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_aspect("equal")
    axes.set_xlabel("stated probability of a hypothesis")
    axes.set_ylabel("share that was the best")
    legend(axes)
    return figure
