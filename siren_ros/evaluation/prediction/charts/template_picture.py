"""The best, the median and the worst sample of each model in one template."""

from collections.abc import Sequence
from typing import Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from siren_ros.evaluation.prediction.charts.chart import DPI, SMALL_PT, colour_of_model
from siren_ros.evaluation.prediction.charts.sample_choice import RANKS
from siren_ros.evaluation.prediction.charts.sample_panel import (
    PAST,
    PAST_PT,
    PATH_PT,
    TRUTH,
    TRUTH_PT,
    SamplePanel,
    draw_sample,
)
from siren_ros.pictures.palette import TEXT

_PANEL_IN: Final = 3.5
_HEAD_IN: Final = 0.55
_GAP_IN: Final = 0.05
_TITLE_IN: Final = 0.1
_LEGEND_IN: Final = 0.02
"""From the upper edge of the figure."""
_LEFT: Final = 0.03
_RIGHT: Final = 0.995
_BETWEEN: Final = {"wspace": 0.03, "hspace": 0.09}
_TITLE_PT: Final = 11
_MODEL_PT: Final = 10


def draw_template(template: str, panels: Sequence[SamplePanel], models: Sequence[str]) -> Figure:
    """A row for each model, a column for each rank.

    Args:
        template: Name, for the title.
        panels: Any number for each model, in the order of the ranks.
        models: All models of the report, which set the colours.
    """
    shown = [model for model in models if any(panel.chosen.model == model for panel in panels)]
    height_in = _PANEL_IN * len(shown) + _HEAD_IN
    figure = Figure(figsize=(_PANEL_IN * len(RANKS), height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        len(shown),
        len(RANKS),
        left=_LEFT,
        right=_RIGHT,
        top=1.0 - (_HEAD_IN + _GAP_IN) / height_in,
        bottom=_GAP_IN / height_in,
        **_BETWEEN,
    )
    for panel in panels:
        row, column = shown.index(panel.chosen.model), RANKS.index(panel.chosen.rank)
        axes = figure.add_subplot(grid[row, column])
        draw_sample(axes, panel, colour_of_model(models, panel.chosen.model))
        if column == 0:
            axes.set_ylabel(panel.chosen.model, fontsize=_MODEL_PT, color=TEXT)
    figure.suptitle(
        f"{template}: samples by ADE, of vehicles that move",
        x=_LEFT,
        y=1.0 - _TITLE_IN / height_in,
        ha="left",
        va="top",
        fontsize=_TITLE_PT,
        color=TEXT,
    )
    figure.legend(
        handles=[
            Line2D([], [], color=PAST, linewidth=PAST_PT, label="past"),
            Line2D([], [], color=TRUTH, linewidth=TRUTH_PT, marker="o", label="truth"),
            *(
                Line2D([], [], color=colour_of_model(models, model), linewidth=PATH_PT, marker="D", label=model)
                for model in shown
            ),
        ],
        loc="upper right",
        bbox_to_anchor=(_RIGHT, 1.0 - _LEGEND_IN / height_in),
        ncols=len(shown) + 2,
        frameon=False,
        fontsize=SMALL_PT,
    )  # fmt: skip
    return figure
