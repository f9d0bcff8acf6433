"""What the page's charts share."""

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from siren_ros.pictures.palette import TEXT

LEVEL_COLOURS: Final = {"L0": "#8a9099", "L1": "#e08e1b", "L2": "#1a86b8", "L3": "#12855f"}
"""One colour for each level, in every chart."""


def level_legend(axes: Axes, levels: Sequence[str]) -> None:
    """Names the levels' colours above the axes, at the right."""
    handles = [
        Line2D([], [], color=LEVEL_COLOURS.get(level, TEXT), marker="o", linestyle="", markersize=5, label=level)
        for level in levels
    ]
    axes.legend(
        handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(levels), frameon=False, fontsize=8
    )


def titled(axes: Axes, title: str) -> None:
    """A title above the axes, at the left."""
    axes.set_title(title, fontsize=9, color=TEXT, loc="left")
