"""What the page's charts share."""

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from siren_ros.evaluation.prediction.charts.chart import SMALL_PT, TITLE_PT
from siren_ros.pictures.palette import TEXT

LEVEL_COLOURS: Final = {"L0": "#8a9099", "L1": "#e08e1b", "L2": "#1a86b8", "L3": "#12855f"}
"""One colour for each level, in every chart."""


WIDTH_IN: Final = 9.0
"""Of every chart: the page's."""
OTHER_LEVEL: Final = "#5c6b73"
OF_A_PLACE: Final = 0.8
"""Share of a template's place that the bars of its levels take."""
HIGHEST_SHARE: Final = 1.02
"""A line at 1 is seen."""
_MARK_PT: Final = 5


def level_legend(axes: Axes, levels: Sequence[str]) -> None:
    """Names the levels' colours above the axes, at the right."""
    handles = [
        Line2D([], [], color=LEVEL_COLOURS.get(level, TEXT), marker="o", linestyle="", markersize=_MARK_PT, label=level)
        for level in levels
    ]
    axes.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=len(levels),
        frameon=False,
        fontsize=SMALL_PT,
    )


def titled(axes: Axes, title: str) -> None:
    """A title above the axes, at the left."""
    axes.set_title(title, fontsize=TITLE_PT, color=TEXT, loc="left")
