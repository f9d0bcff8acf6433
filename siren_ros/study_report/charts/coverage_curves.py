"""What more seeds add: coverage of parameters, transitions seen, distance to what there is."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from siren_ros.evaluation.diversity.summary import GroupDiversity
from siren_ros.evaluation.prediction.charts.chart import SMALL_PT, new_figure, quiet
from siren_ros.study_report.charts.style import WIDTH_IN, titled

_HEIGHT_IN: Final = 4.8
_MARK_PT: Final = 2.5


def draw_coverage(found: Sequence[GroupDiversity], colours: Sequence[str]) -> Figure:
    """A line for each group in four panels, against the number of episodes."""
    figure = new_figure(WIDTH_IN, _HEIGHT_IN)
    panels = [figure.add_subplot(2, 2, number + 1) for number in range(4)]
    titles = (
        "share of the parameters' ranges tried",
        "transitions between events seen",
        "distance of one more way to the nearest, m",
        "distance of one more order of events",
    )
    for axes, title in zip(panels, titles, strict=True):
        quiet(axes)
        titled(axes, title)
        axes.set_xlabel("episodes there are")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    for one, colour in zip(found, colours, strict=True):
        name = " ".join(one.group[:2])
        curves = (
            np.mean([part.curve for part in one.parameters], axis=0) if one.parameters else np.zeros(0),
            one.transitions.curve,
            one.ways.curve,
            one.events.curve,
        )
        for axes, curve in zip(panels, curves, strict=True):
            axes.plot(np.arange(1, len(curve) + 1), curve, marker="o", markersize=_MARK_PT, color=colour, label=name)
    panels[0].set_ylim(0.0, 1.0)
    for axes in panels[1:]:
        axes.set_ylim(bottom=0.0)
    figure.legend(*panels[1].get_legend_handles_labels(), loc="outside right upper", frameon=False, fontsize=SMALL_PT)
    return figure
