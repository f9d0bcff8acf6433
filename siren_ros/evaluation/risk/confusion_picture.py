"""Confusion matrices as a picture: overall and for each template."""

from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from siren_ros.errors import whole_file
from siren_ros.evaluation.risk.labels import TITLES
from siren_ros.evaluation.risk.scoring import ModelScores

_COLUMNS: Final = 4
_PANEL_IN: Final = (3.1, 2.9)
_TITLE_PT: Final = 10
_TEXT_PT: Final = 8
_ANSWERS_PT: Final = 7
_DARK: Final = 0.6
"""Share from which on a number is white."""
_DPI: Final = 110


def save_confusions(model: ModelScores, path: Path) -> None:
    """Draws all confusion matrices of a model; shades are shares of each label's videos, numbers are counts."""
    groups = [("all templates", model.overall), *model.by_template.items()]
    rows = -(-len(groups) // _COLUMNS)
    figure = Figure(figsize=(_PANEL_IN[0] * _COLUMNS, _PANEL_IN[1] * rows), layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for panel, (name, counts) in zip(panels, groups, strict=False):
        totals = counts.sum(axis=1, keepdims=True)
        panel.imshow(counts / totals.clip(1), vmin=0.0, vmax=1.0, cmap="Blues")
        for row, values in enumerate(counts.tolist()):
            for column, count in enumerate(values):
                dark = count >= _DARK * max(1, int(totals[row, 0]))
                panel.text(column, row, str(count), ha="center", va="center", color="white" if dark else "black")
        panel.set_title(f"{name} (n = {int(counts.sum())})", fontsize=_TITLE_PT)
        panel.set_xticks(range(len(TITLES) + 1), [*TITLES, "none"], fontsize=_ANSWERS_PT)
        panel.set_yticks(range(len(TITLES)), TITLES, fontsize=_TEXT_PT, rotation=90, va="center")
        panel.set_xlabel("answer", fontsize=_TEXT_PT)
        panel.set_ylabel("label", fontsize=_TEXT_PT)
    for panel in panels[len(groups) :]:
        panel.set_visible(False)
    figure.suptitle(model.name)
    with whole_file(path) as file:
        figure.savefig(file, dpi=_DPI)
