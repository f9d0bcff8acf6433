"""Distributions of yield metrics: a point for each episode, a curve for the drivers of each level."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from siren_ros.evaluation.prediction.charts.chart import new_figure, quiet
from siren_ros.evaluation.yielding.metrics import EpisodeMetric
from siren_ros.evaluation.yielding.summary import ScoredEpisode
from siren_ros.numerics.arrays import Floats
from siren_ros.study_report.charts.style import (
    HIGHEST_SHARE,
    LEVEL_COLOURS,
    OF_A_PLACE,
    OTHER_LEVEL,
    WIDTH_IN,
    level_legend,
    titled,
)

_METRIC_IN: Final = 2.3
_DRIVERS_IN: Final = 2.8
_POINT_PT2: Final = 11
_OPAQUE: Final = 0.85
_MEDIAN_PT: Final = 2
_CURVE_PT: Final = 1.6
_SPREAD: Final = 0.55
_MEDIAN: Final = 0.42
"""Shares of a level's part of a place: that its points are spread over, and half the length of the bar."""


def draw_metric(episodes: Sequence[ScoredEpisode], metric: EpisodeMetric) -> Figure:
    """One metric: a point for each episode by template and level, a bar at the median."""
    templates = sorted({episode.template for episode in episodes})
    levels = sorted({episode.level for episode in episodes})
    figure = new_figure(WIDTH_IN, _METRIC_IN)
    axes = figure.add_subplot()
    quiet(axes)
    axes.grid(visible=False, axis="x")
    width = OF_A_PLACE / max(len(levels), 1)
    for place, template in enumerate(templates):
        for number, level in enumerate(levels):
            values = _values(episodes, template, level, metric.name)
            if not len(values):
                continue
            middle = place + (number - 0.5 * (len(levels) - 1)) * width
            colour = LEVEL_COLOURS.get(level, OTHER_LEVEL)
            spread = (np.arange(len(values)) / max(len(values) - 1, 1) - 0.5) * _SPREAD * width
            axes.scatter(middle + spread, values, s=_POINT_PT2, color=colour, edgecolors="none", alpha=_OPAQUE)
            axes.hlines(
                float(np.median(values)),
                middle - _MEDIAN * width,
                middle + _MEDIAN * width,
                color=colour,
                linewidth=_MEDIAN_PT,
            )
    axes.set_xticks(range(len(templates)), templates)
    axes.set_xlim(-0.5, len(templates) - 0.5)
    axes.set_ylabel(metric.name)
    titled(axes, metric.meaning)
    level_legend(axes, levels)
    return figure


def _values(episodes: Sequence[ScoredEpisode], template: str, level: str, metric: str) -> Floats:
    found = [
        episode.scores.metrics[metric] for episode in episodes if (episode.template, episode.level) == (template, level)
    ]
    return np.array([one.value for one in found if one.valid])


def draw_drivers(episodes: Sequence[ScoredEpisode], marks: Sequence[tuple[str, str]]) -> Figure:
    """Share of the drivers in the EMV's way who have done something within a time, a curve for each level.

    Drivers who had not by the end of the episode count in the share's denominator.

    Args:
        episodes: The episodes.
        marks: Names of driver metrics in seconds, with their titles.
    """
    levels = sorted({episode.level for episode in episodes})
    figure = new_figure(WIDTH_IN, _DRIVERS_IN)
    for column, (name, title) in enumerate(marks):
        axes = figure.add_subplot(1, len(marks), column + 1)
        quiet(axes)
        for level in levels:
            found = [
                driver.marks[name]
                for episode in episodes
                if episode.level == level
                for driver in episode.scores.drivers
                if driver.in_the_way and driver.marks[name].valid
            ]
            done = np.sort([mark.value for mark in found if not mark.at_least])
            if found:
                share = np.arange(1, len(done) + 1) / len(found)
                axes.step(done, share, where="post", color=LEVEL_COLOURS.get(level, OTHER_LEVEL), linewidth=_CURVE_PT)
        axes.set_xlabel(f"{name}")
        axes.set_ylim(0.0, HIGHEST_SHARE)
        axes.set_xlim(left=0.0)
        axes.set_ylabel("share of drivers")
        titled(axes, title)
        if column == len(marks) - 1:
            level_legend(axes, levels)
    return figure
