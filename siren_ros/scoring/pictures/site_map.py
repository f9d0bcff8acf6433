"""A map from above with each template's sites, and what unsuitable places lack."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from siren_ros.base.numerics.arrays import Points
from siren_ros.scoring.pictures.palette import FAINT_TEXT, TEXT
from siren_ros.scoring.pictures.plot_parts import Box, LabelPlacer, draw_roads, draw_scale_bar, frame_box, save_png
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes
from siren_ros.simulation.roads.site_finder import places_without_site
from siren_ros.simulation.roads.sites import REQUIREMENTS, Site
from siren_ros.simulation.scenario.scenario import Template

_GOOD: Final = "#12855f"
_LACKING: Final = ("#d9820f", "#c2185b", "#7b3fa0", "#1f77b4", "#8c5a2b", "#d4b106", "#3aa6a6", "#e0603c")
"""Colours of unsuitable places by what they lack; with more reasons the colours repeat."""
_COLUMNS: Final = 2
_PANEL_IN: Final = 8.0
_LEAST_IN, _MOST_IN = 2.0, 11.0
"""Limits of the height of a map."""
_TITLE_IN: Final = 0.75
_LINE_IN: Final = 0.2
_DPI: Final = 120
_MARGIN: Final = 0.03


Survey = tuple[Template, Mapping[Site, Sequence[str]]]
"""A template with all sites of its kind, best first, and what each lacks (empty for suitable ones)."""


def save_site_map(network: RoadNetwork, surveys: Sequence[Survey], path: Path) -> Path:
    """Draw the map once per template into a PNG file with ``save_png``."""
    return save_png(path, lambda: draw_site_map(network, surveys))


def draw_site_map(network: RoadNetwork, surveys: Sequence[Survey]) -> Figure:
    """Draw one panel per template: suitable sites with their numbers in ``siren sites``, and other places."""
    box = _box_around(network)
    colours = [_colours(network, survey) for survey in surveys]
    legends = [_legend(network, *each) for each in zip(surveys, colours, strict=True)]
    columns = min(_COLUMNS, len(surveys))
    rows = -(-len(surveys) // columns)
    shape = (box[3] - box[2]) / (box[1] - box[0])
    map_in = min(max(_PANEL_IN * shape, _LEAST_IN), _MOST_IN)
    text_in = _TITLE_IN + _LINE_IN * (1 + max(map(len, legends)))
    size_in = np.array([columns * _PANEL_IN, rows * (map_in + text_in)])
    figure = Figure(figsize=(float(size_in[0]), float(size_in[1])), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    for place, legend in enumerate(legends):
        row, column = divmod(place, columns)
        corner_in = np.array([column * _PANEL_IN, size_in[1] - row * (map_in + text_in) - _TITLE_IN - map_in])
        (left, bottom), (width, height) = corner_in / size_in, np.array([_PANEL_IN, map_in]) / size_in
        axes = figure.add_axes((left + _MARGIN * width, bottom, (1.0 - 2.0 * _MARGIN) * width, height))
        _draw_panel(axes, network, surveys[place], colours[place], box)
        axes.legend(
            handles=legend, loc="upper left", bbox_to_anchor=(0.0, -0.01), fontsize=8, frameon=False, labelcolor=TEXT
        )
    return figure


def _draw_panel(axes: Axes, network: RoadNetwork, survey: Survey, colours: Mapping[str, str], box: Box) -> None:
    frame_box(axes, box)
    draw_roads(axes, network, line_width=0.3)
    template, found = survey
    good = [site for site, lacking in found.items() if not lacking]
    for site, lacking in reversed([*found.items()]):
        colour, width = (colours[lacking[0]], 2.0) if lacking else (_GOOD, 4.0)
        axes.plot(*_way_of(network, site).T, color=colour, linewidth=width, solid_capstyle="butt", zorder=4)
    for place in places_without_site(network, template.site_kind):
        x, y = driving_lanes(network, place.edge)[-1].centre.points[-1]
        axes.plot(x, y, marker="x", markersize=4, color=colours[place.lacking], linestyle="none", zorder=3)
    labels = LabelPlacer(axes, 7.0)
    for number, site in enumerate(good, start=1):
        x, y = _way_of(network, site)[-1].tolist()
        labels.place(x, y, str(number), _GOOD)
    draw_scale_bar(axes)
    count = f"{len(good)} good of {len(found)} sites" if found else "no site"
    look: dict[str, Any] = {"transform": axes.transAxes, "va": "bottom"}
    axes.text(0.0, 1.045, f"{template.template_id}: {count}", fontsize=11, fontweight="bold", color=TEXT, **look)
    needs = REQUIREMENTS[template.site_kind].removeprefix("a map with ")
    axes.text(0.0, 1.01, f"It needs {needs}.", fontsize=7, color=FAINT_TEXT, **look)


def _way_of(network: RoadNetwork, site: Site) -> Points:
    """Leftmost driving lanes of a site's stretch of road, shape ``(K, 2)``."""
    return np.concatenate([driving_lanes(network, edge)[-1].centre.points for edge in site.stretch])


def _legend(network: RoadNetwork, survey: Survey, colours: Mapping[str, str]) -> list[Line2D]:
    """Legend of the colours, with the number of places for each."""
    template, found = survey
    good = sum(not lacking for lacking in found.values())
    handles = [Line2D([], [], color=_GOOD, linewidth=4.0, label=f"good: {good}")] if good else []
    sites = Counter(lacking[0] for lacking in found.values() if lacking)
    for text, count in sites.items():
        handles.append(Line2D([], [], color=colours[text], linewidth=2.0, label=f"site with {text}: {count}"))
    others = Counter(place.lacking for place in places_without_site(network, template.site_kind))
    for text, count in others.items():
        look: dict[str, Any] = {"linestyle": "none", "marker": "x", "markersize": 5}
        handles.append(Line2D([], [], color=colours[text], label=f"no site, {text}: {count}", **look))
    return handles


def _colours(network: RoadNetwork, survey: Survey) -> dict[str, str]:
    """Colour by what a place lacks."""
    template, found = survey
    texts = [lacking[0] for lacking in found.values() if lacking]
    texts += [place.lacking for place in places_without_site(network, template.site_kind)]
    return {text: _LACKING[place % len(_LACKING)] for place, text in enumerate(dict.fromkeys(texts))}


def _box_around(network: RoadNetwork) -> Box:
    """Bounding box of all lanes."""
    points = np.concatenate([lane.centre.points for lane in network.lanes])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.02 * float((high - low).max()) + 5.0
    (x0, y0), (x1, y1) = (low - margin).tolist(), (high + margin).tolist()
    return x0, x1, y0, y1
