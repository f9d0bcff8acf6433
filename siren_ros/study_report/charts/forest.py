"""Effects with their intervals, template by template."""

from collections.abc import Sequence
from typing import Final

from matplotlib.figure import Figure

from siren_ros.evaluation.prediction.charts.chart import TITLE_PT, new_figure, quiet
from siren_ros.evaluation.yielding.counterfactual import ALL, Effect
from siren_ros.pictures.palette import FAINT_TEXT, TEXT
from siren_ros.study_report.charts.style import WIDTH_IN, titled

_HEAD_IN: Final = 0.9
_ROW_IN: Final = 0.2
_MARK_PT: Final = 4
_LINE_PT: Final = 1.4
_ZERO_PT: Final = 0.8
_ALL_TEMPLATES: Final = "#b3121a"


def draw_forest(found: Sequence[Effect], outcome: str) -> Figure:
    """Effects on one outcome: a panel for each pair of levels, a row for each template."""
    contrasts = list(dict.fromkeys((one.first, one.second) for one in found))
    templates = sorted({one.template for one in found} - {ALL}) + [ALL] * any(one.template == ALL for one in found)
    figure = new_figure(WIDTH_IN, _HEAD_IN + _ROW_IN * len(templates))
    first = None
    for column, (one, other) in enumerate(contrasts):
        axes = figure.add_subplot(1, len(contrasts), column + 1, sharey=first)
        first = first or axes
        quiet(axes)
        axes.axvline(0.0, color=FAINT_TEXT, linewidth=_ZERO_PT)
        for effect in found:
            if (effect.first, effect.second) != (one, other) or not effect.found.difference.valid:
                continue
            difference, row = effect.found.difference, templates.index(effect.template)
            colour = _ALL_TEMPLATES if effect.template == ALL else TEXT
            axes.plot(difference.value, row, "o", markersize=_MARK_PT, color=colour)
            if difference.bounded:
                axes.hlines(row, difference.low, difference.high, color=colour, linewidth=_LINE_PT)
        axes.set_ylim(len(templates) - 0.5, -0.5)
        axes.set_yticks(range(len(templates)), templates)
        axes.tick_params(labelleft=column == 0)
        titled(axes, f"{one} − {other}")
    figure.supxlabel(f"effect on {outcome}", fontsize=TITLE_PT, color=TEXT)
    return figure
