"""The best, the median and the worst sample of each model in one template."""

from collections.abc import Sequence
from typing import Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from siren_ros.evaluation.prediction.charts.chart import DPI, colour_of_model
from siren_ros.evaluation.prediction.charts.sample_choice import RANKS
from siren_ros.evaluation.prediction.charts.sample_panel import PAST, TRUTH, SamplePanel, draw_sample
from siren_ros.pictures.palette import TEXT

_PANEL_IN: Final = 3.5
_HEAD_IN: Final = 0.55


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
        left=0.03,
        right=0.995,
        top=1.0 - (_HEAD_IN + 0.05) / height_in,
        bottom=0.06 / height_in,
        wspace=0.03,
        hspace=0.09,
    )
    for panel in panels:
        row, column = shown.index(panel.chosen.model), RANKS.index(panel.chosen.rank)
        axes = figure.add_subplot(grid[row, column])
        draw_sample(axes, panel, colour_of_model(models, panel.chosen.model))
        if column == 0:
            axes.set_ylabel(panel.chosen.model, fontsize=10, color=TEXT)
    figure.suptitle(
        f"{template}: samples by ADE, of vehicles that move",
        x=0.03,
        y=1.0 - 0.1 / height_in,
        ha="left",
        va="top",
        fontsize=11,
        color=TEXT,
    )
    figure.legend(
        handles=[
            Line2D([], [], color=PAST, linewidth=1.4, label="past"),
            Line2D([], [], color=TRUTH, linewidth=3.4, marker="o", label="truth"),
            *(
                Line2D([], [], color=colour_of_model(models, model), linewidth=1.7, marker="D", label=model)
                for model in shown
            ),
        ],
        loc="upper right",
        bbox_to_anchor=(0.995, 1.0 - 0.02 / height_in),
        ncols=len(shown) + 2,
        frameon=False,
        fontsize=8,
    )  # fmt: skip
    return figure
