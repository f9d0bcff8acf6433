"""Effects with their intervals, template by template."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from siren_ros.evaluation.prediction.charts.chart import new_figure, quiet
from siren_ros.evaluation.yielding.counterfactual import ALL, Effect
from siren_ros.pictures.palette import FAINT_TEXT, TEXT
from siren_ros.study_report.charts.style import titled


def draw_forest(found: Sequence[Effect], outcome: str) -> Figure:
    """Effects on one outcome: a panel for each pair of levels, a row for each template."""
    contrasts = list(dict.fromkeys((one.first, one.second) for one in found))
    templates = sorted({one.template for one in found} - {ALL}) + [ALL] * any(one.template == ALL for one in found)
    figure = new_figure(9.0, 0.9 + 0.2 * len(templates))
    first = None
    for column, (one, other) in enumerate(contrasts):
        axes = figure.add_subplot(1, len(contrasts), column + 1, sharey=first)
        first = first or axes
        quiet(axes)
        axes.axvline(0.0, color=FAINT_TEXT, linewidth=0.8)
        for effect in found:
            if (effect.first, effect.second) != (one, other) or not effect.found.difference.valid:
                continue
            difference, row = effect.found.difference, templates.index(effect.template)
            colour = "#b3121a" if effect.template == ALL else TEXT
            axes.plot(difference.value, row, "o", markersize=4, color=colour)
            if difference.bounded:
                axes.hlines(row, difference.low, difference.high, color=colour, linewidth=1.4)
        axes.set_ylim(len(templates) - 0.5, -0.5)
        axes.set_yticks(range(len(templates)), templates)
        axes.tick_params(labelleft=column == 0)
        titled(axes, f"{one} − {other}")
    figure.supxlabel(f"effect on {outcome}", fontsize=9, color=TEXT)
    return figure
