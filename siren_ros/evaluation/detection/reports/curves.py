"""Precision over recall of one detector, a line for each distance, a panel for each template."""

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from siren_ros.errors import whole_file
from siren_ros.evaluation.detection.metrics.matching import DISTANCES_M
from siren_ros.evaluation.detection.scoring import DetectorScores

_COLUMNS: Final = 4
_PANEL_IN: Final = (3.2, 3.0)
_TITLE_PT: Final = 9
_LEGEND_PT: Final = 6
_HIGHEST: Final = 1.02
"""A line at 1 is seen."""
_DPI: Final = 120


def draw_curves(scores: DetectorScores, path: Path) -> None:
    """Writes a picture."""
    rows = -(-len(scores.templates) // _COLUMNS)
    columns = min(_COLUMNS, len(scores.templates))
    figure = Figure(figsize=(_PANEL_IN[0] * columns, _PANEL_IN[1] * rows), layout="constrained")
    FigureCanvasAgg(figure)
    recall = np.linspace(0.0, 1.0, 101)
    for number, (name, score) in enumerate(scores.templates.items()):
        axes = figure.add_subplot(rows, columns, number + 1)
        for distance_m, precision in zip(DISTANCES_M, score.precision, strict=True):
            axes.plot(recall, precision, label=f"{distance_m:g} m, AP {score.average_precision[distance_m]:.2f}")
        axes.set_title(f"{name}: mAP {score.mean_average_precision:.3f}", fontsize=_TITLE_PT)
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, _HIGHEST), xlabel="recall", ylabel="precision")
        axes.legend(fontsize=_LEGEND_PT, loc="lower left")
    figure.suptitle(f"{scores.name}: Car, for each largest distance of a match", fontsize=_TITLE_PT)
    with whole_file(path) as file:
        figure.savefig(file, dpi=_DPI, metadata={"Software": None})
