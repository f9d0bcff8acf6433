"""What the charts share: figures without a display, a colour for each model, files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from siren_ros.errors import whole_file, writing
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
