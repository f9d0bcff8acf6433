"""Charts of the study's page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from siren_ros.base.numerics.arrays import Floats
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.scoring.evaluation.diversity import GroupDiversity
from siren_ros.scoring.evaluation.prediction.charts import SMALL_PT, TITLE_PT, new_figure, quiet
from siren_ros.scoring.evaluation.scores import ALL, Score
from siren_ros.scoring.evaluation.yielding.metrics import Metric
from siren_ros.scoring.evaluation.yielding.scoring import ScoredEpisode
from siren_ros.scoring.pictures.plot_parts import FAINT_TEXT, TEXT

LEVEL_COLOURS: Final = {"L0": "#8a9099", "L1": "#e08e1b", "L2": "#1a86b8", "L3": "#12855f"}
"""Colour of each level in all charts."""
OTHER_LEVEL: Final = "#5c6b73"
WIDTH_IN: Final = 9.0
"""Width of all charts, that of the page."""
OF_A_PLACE: Final = 0.8
"""Share of a template's space that the bars of its levels cover."""
HIGHEST_SHARE: Final = 1.02
"""Upper limit of the axis, so that a line at 1 is visible."""
_LEGEND_MARK_PT: Final = 5


def _colour(level: str) -> str:
    return LEVEL_COLOURS.get(level, OTHER_LEVEL)


def level_legend(axes: Axes, levels: Sequence[str]) -> None:
    """Draw a legend of the levels' colours above the axes, at the right."""
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "markersize": _LEGEND_MARK_PT}
    handles = [Line2D([], [], color=_colour(level), label=level, **dot) for level in levels]
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
    axes.legend(handles=handles, ncols=len(levels), frameon=False, fontsize=SMALL_PT, **place)


def titled_axes(figure: Figure, title: str, rows: int = 1, columns: int = 1, place: int = 1, **options: Any) -> Axes:
    """Add axes in a grid of panels with a title above them at the left; ``options`` as of ``add_subplot``."""
    axes: Axes = figure.add_subplot(rows, columns, place, **options)
    quiet(axes)
    axes.set_title(title, fontsize=TITLE_PT, color=TEXT, loc="left")
    return axes


@dataclass(frozen=True)
class _Places:
    """Positions of the levels of each template on an axis."""

    templates: list[str]
    levels: list[str]

    @classmethod
    def of(cls, rows: Sequence[EpisodeRow] | Sequence[ScoredEpisode]) -> Self:
        return cls(sorted({row.template for row in rows}), sorted({row.level for row in rows}))

    @property
    def width(self) -> float:
        return OF_A_PLACE / max(len(self.levels), 1)

    def middles(self, level: str) -> Floats:
        """Position of a level, for each template."""
        aside = (self.levels.index(level) - 0.5 * (len(self.levels) - 1)) * self.width
        return np.arange(len(self.templates)) + aside

    def label(self, axes: Axes) -> None:
        axes.grid(visible=False, axis="x")
        axes.set_xticks(range(len(self.templates)), self.templates)
        level_legend(axes, self.levels)


_HEAD_IN, _ROW_IN = 0.9, 0.2
_MARK_PT, _LINE_PT, _ZERO_PT = 4, 1.4, 0.8
_ALL_TEMPLATES: Final = "#b3121a"


def draw_forest(effects: Sequence[Score], outcome: str) -> Figure:
    """Draw the effects on one outcome: a panel per pair of levels, a row per template."""
    contrasts = list(dict.fromkeys((effect.model, effect.against) for effect in effects))
    names = {effect.group for effect in effects}
    templates = sorted(names - {ALL}) + [ALL] * (ALL in names)
    figure = new_figure(WIDTH_IN, _HEAD_IN + _ROW_IN * len(templates))
    leftmost = None
    for column, (first, second) in enumerate(contrasts):
        axes = titled_axes(figure, f"{first} − {second}", 1, len(contrasts), column + 1, sharey=leftmost)
        leftmost = leftmost or axes
        axes.axvline(0.0, color=FAINT_TEXT, linewidth=_ZERO_PT)
        for effect in effects:
            if (effect.model, effect.against) != (first, second) or not effect.interval.valid:
                continue
            difference, row = effect.interval, templates.index(effect.group)
            colour = _ALL_TEMPLATES if effect.group == ALL else TEXT
            axes.plot(difference.value, row, "o", markersize=_MARK_PT, color=colour)
            if difference.bounded:
                axes.hlines(row, difference.low, difference.high, color=colour, linewidth=_LINE_PT)
        axes.set_ylim(len(templates) - 0.5, -0.5)
        axes.set_yticks(range(len(templates)), templates)
        axes.tick_params(labelleft=column == 0)
    figure.supxlabel(f"effect on {outcome}", fontsize=TITLE_PT, color=TEXT)
    return figure


_METRIC_IN, _DRIVERS_IN = 2.3, 2.8
_POINT_PT2, _OPAQUE = 11, 0.85
_MEDIAN_PT, _CURVE_PT = 2, 1.6
_SPREAD, _MEDIAN = 0.55, 0.42
"""Shares of a level's space: width of the scattered points, and half the length of the median's bar."""


def draw_metric(episodes: Sequence[ScoredEpisode], metric: Metric) -> Figure:
    """Draw one metric: a point per episode by template and level, and a bar at the median."""
    places = _Places.of(episodes)
    half = _MEDIAN * places.width
    figure = new_figure(WIDTH_IN, _METRIC_IN)
    axes = titled_axes(figure, metric.meaning)
    for place, template in enumerate(places.templates):
        for level in places.levels:
            here = [episode for episode in episodes if (episode.template, episode.level) == (template, level)]
            measures = [episode.scores.metrics[metric.name] for episode in here]
            values = np.array([measure.value for measure in measures if measure.valid])
            if not len(values):
                continue
            middle = places.middles(level)[place]
            spread = (np.arange(len(values)) / max(len(values) - 1, 1) - 0.5) * _SPREAD * places.width
            axes.scatter(middle + spread, values, s=_POINT_PT2, color=_colour(level), edgecolors="none", alpha=_OPAQUE)
            median = float(np.median(values))
            axes.hlines(median, middle - half, middle + half, color=_colour(level), linewidth=_MEDIAN_PT)
    places.label(axes)
    axes.set_xlim(-0.5, len(places.templates) - 0.5)
    axes.set_ylabel(metric.name)
    return figure


def draw_drivers(episodes: Sequence[ScoredEpisode], marks: Mapping[str, str]) -> Figure:
    """Draw the share of drivers in the EMV's way that have acted within a time; a curve per level.

    Drivers who had not by the end of the episode count in the share's denominator. ``marks`` holds the titles of driver
    metrics in seconds by their names.
    """
    levels = sorted({episode.level for episode in episodes})
    figure = new_figure(WIDTH_IN, _DRIVERS_IN)
    for column, (name, title) in enumerate(marks.items()):
        axes = titled_axes(figure, title, 1, len(marks), column + 1)
        for level in levels:
            values = [
                driver.marks[name]
                for episode in episodes
                if episode.level == level
                for driver in episode.scores.drivers
                if driver.in_the_way and driver.marks[name].valid
            ]
            done = np.sort([mark.value for mark in values if not mark.at_least])
            if values:
                share = np.arange(1, len(done) + 1) / len(values)
                axes.step(done, share, where="post", color=_colour(level), linewidth=_CURVE_PT)
        axes.set(xlabel=name, ylabel="share of drivers", ylim=(0.0, HIGHEST_SHARE))
        axes.set_xlim(left=0.0)
        if column == len(marks) - 1:
            level_legend(axes, levels)
    return figure


_COVERAGE_IN: Final = 4.8
_CURVE_MARK_PT: Final = 2.5


def draw_coverage(groups: Sequence[GroupDiversity], colours: Sequence[str]) -> Figure:
    """Draw coverage over the number of episodes: four panels, a line per group."""
    figure = new_figure(WIDTH_IN, _COVERAGE_IN)
    titles = (
        "share of the parameters' ranges tried",
        "transitions between events seen",
        "distance of one more way to the nearest, m",
        "distance of one more order of events",
    )
    panels = [titled_axes(figure, title, 2, 2, place) for place, title in enumerate(titles, start=1)]
    for axes in panels:
        axes.set_xlabel("episodes there are")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    for diverse, colour in zip(groups, colours, strict=True):
        name = " ".join(diverse.group[:2])
        tried = np.mean([part.curve for part in diverse.parameters], axis=0) if diverse.parameters else np.zeros(0)
        curves = (tried, diverse.transitions.curve, diverse.ways.curve, diverse.events.curve)
        style: dict[str, Any] = {"marker": "o", "markersize": _CURVE_MARK_PT, "color": colour, "label": name}
        for axes, curve in zip(panels, curves, strict=True):
            axes.plot(np.arange(1, len(curve) + 1), curve, **style)
    panels[0].set_ylim(0.0, 1.0)
    for axes in panels[1:]:
        axes.set_ylim(bottom=0.0)
    figure.legend(*panels[1].get_legend_handles_labels(), loc="outside right upper", frameon=False, fontsize=SMALL_PT)
    return figure


_OUTCOMES_IN: Final = 2.5
_BAR: Final = 0.86
"""Width of a bar as a share of its level's space."""
_OUTLINE_PT: Final = 0.8


def draw_outcomes(rows: Sequence[EpisodeRow]) -> Figure:
    """Draw outcomes by template and level: filled bars if the predicate holds, outlines for all complete episodes."""
    complete = [row for row in rows if row.status is Status.COMPLETE]
    places = _Places.of(rows)
    figure = new_figure(WIDTH_IN, _OUTCOMES_IN)
    axes = titled_axes(figure, "filled: the predicate holds; outline: complete episodes")
    bar = places.width * _BAR
    for level in places.levels:
        here = [[row for row in complete if (row.template, row.level) == (name, level)] for name in places.templates]
        middles, colour = places.middles(level), _colour(level)
        axes.bar(middles, [*map(len, here)], bar, color="none", edgecolor=colour, linewidth=_OUTLINE_PT)
        axes.bar(middles, [sum(bool(row.predicate_holds) for row in episodes) for episodes in here], bar, color=colour)
    places.label(axes)
    axes.set_ylabel("episodes")
    return figure
