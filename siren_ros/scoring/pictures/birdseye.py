"""Pictures from above: of an episode, and of a map with each template's sites.

The picture of an episode has the map with all paths, snapshots of the interaction, and modes over time. The map of
sites also shows what unsuitable places lack.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces.boxes import EMV_COLOUR, MODE_COLOURS
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, SirenError
from siren_ros.scoring.judging.outcome import evaluate_predicate
from siren_ros.scoring.pictures.plot_parts import (
    CIVILIAN,
    EMV_EVENTS,
    EVENT_STYLES,
    FAINT_TEXT,
    GROUND,
    KMH,
    LANE_FILL,
    STATE_NAMES,
    TEXT,
    Box,
    LabelPlacer,
    draw_path,
    draw_roads,
    draw_scale_bar,
    draw_speeds,
    draw_states,
    draw_vehicles,
    frame_box,
    save_png,
    title_of,
    yielding_actors,
)
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes
from siren_ros.simulation.roads.site_finder import places_without_site
from siren_ros.simulation.roads.sites import REQUIREMENTS, Lack, Site
from siren_ros.simulation.scenario.scenario import Template
from siren_ros.simulation.world.actors import EventKind, Mode

SNAPSHOTS = 3
"""Number of snapshots, one in each part of the interaction's time."""
_SEEN_M = 60.0
"""Civilians farther than this from the EMV are not in snapshots."""
_TIMED_LABELS = 16
"""With more events than this, labels on the map show only the actor, once; the timeline has the times."""
WIDTH_IN = 13.0
DPI = 150
_MARGIN_M = 12.0
_MIN_SIZE_M = (70.0, 40.0)
_PADDING_STEPS = 40
_CROSSING_STEPS = 100
_TRAIL_STEPS = 40


def interaction_steps(record: EpisodeRecord) -> tuple[int, int]:
    """First and last step of the interaction.

    The yields with 2 s around them; without a yield 5 s on both sides of the EMV's first stop line; without one the
    whole episode.
    """
    last_step = max(record.steps - 1, 0)
    rows = record.rows
    yielding = rows.step[(rows.mode >= Mode.YIELD_REACTING) & (rows.mode <= Mode.YIELD_HOLD)]
    if len(yielding):
        return max(int(yielding.min()) - _PADDING_STEPS, 0), min(int(yielding.max()) + _PADDING_STEPS, last_step)
    lines = record.events_of(EventKind.STOP_LINE_CROSSED)
    if crossed := [event.step for event in lines if event.actor_id in record.emv_ids]:
        return max(min(crossed) - _CROSSING_STEPS, 0), min(min(crossed) + _CROSSING_STEPS, last_step)
    return 0, last_step


def interaction_box(record: EpisodeRecord) -> Box:
    """Part of the map that the EMVs and the yielding civilians cover during the interaction."""
    first, last = interaction_steps(record)
    rows = record.rows
    within = (rows.step >= first) & (rows.step <= last)
    taking_part = np.isin(rows.actor_id, [*record.emv_ids, *yielding_actors(record)])
    chosen = within & taking_part
    places = rows.xy_m[chosen] if chosen.any() else rows.xy_m
    low, high = places.min(axis=0) - _MARGIN_M, places.max(axis=0) + _MARGIN_M
    more = np.maximum(np.array(_MIN_SIZE_M) - (high - low), 0.0) / 2.0
    (x0, y0), (x1, y1) = (low - more).tolist(), (high + more).tolist()
    return x0, x1, y0, y1


def snapshot_steps(record: EpisodeRecord) -> list[int]:
    """In each third of the interaction, the step at which most civilians yield close to an EMV.

    Where several are alike, and where nobody yields, it is the one nearest to the middle of the third.
    """
    first, last = interaction_steps(record)
    rows, active = record.rows, np.zeros(record.steps, np.int64)
    yields = rows.select((rows.mode >= Mode.YIELD_REACTING) & (rows.mode <= Mode.YIELD_HOLD))
    for emv_id in record.emv_ids:
        track, places = record.track(emv_id), np.full((record.steps, 2), np.inf)
        places[track.step] = track.xy_m
        near = np.linalg.norm(yields.xy_m - places[yields.step], axis=1) < _SEEN_M
        active += np.bincount(yields.step[near], minlength=record.steps)
    bounds = np.linspace(first, last + 1, SNAPSHOTS + 1).round().astype(np.int64)
    chosen = []
    for begin, end in pairwise(bounds.tolist()):
        steps = np.arange(begin, max(end, begin + 1)).clip(max=last)
        best = steps[active[steps] == active[steps].max()]
        chosen.append(int(best[np.argmin(np.abs(best - (begin + end) / 2.0))]))
    return chosen


def draw_episode(record: EpisodeRecord) -> Figure:
    """Draw the whole picture; InputError for a record without states."""
    if not record.states or len(record.rows) == 0:
        raise InputError("bag", record.description.template, "an episode with at least one recorded actor state")
    box = interaction_box(record)
    actors = (*[key for key in record.emv_ids if key in record.actors], *yielding_actors(record))
    map_in = float(np.clip(WIDTH_IN * (box[3] - box[2]) / (box[1] - box[0]), 3.2, 8.5))
    heights = (map_in, 2.9, 0.5 + 0.19 * max(len(actors), 3), 1.1)
    height = sum(heights) + 2.0
    figure = Figure(figsize=(WIDTH_IN, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    margins: dict[str, Any] = {"left": 0.075, "right": 0.985, "top": 1.0 - 0.85 / height, "bottom": 0.045}
    grid = figure.add_gridspec(4, SNAPSHOTS, height_ratios=heights, **margins, hspace=0.2, wspace=0.03)
    moments = snapshot_steps(record)
    speeds = Normalize(0.0, max(float(np.percentile(record.rows.speed_mps, 99.5)) * KMH * 1.12, 10.0))
    _draw_map(figure.add_subplot(grid[0, :]), record, box, speeds, moments)
    for column, step in enumerate(moments):
        _draw_snapshot(figure.add_subplot(grid[1, column]), record, step, column + 1)
    timeline = figure.add_subplot(grid[2, :])
    draw_states(timeline, record, actors, moments)
    lower = figure.add_subplot(grid[3, :], sharex=timeline)
    draw_speeds(lower, record, actors)
    lower.set_xlim(0.0, record.duration_s)
    timeline.tick_params(labelbottom=False)
    _draw_title(figure, record)
    return figure


def _draw_map(axes: Axes, record: EpisodeRecord, box: Box, speeds: Normalize, moments: list[int]) -> None:
    frame_box(axes, box)
    draw_roads(axes, record.network, line_width=0.9)
    yielding = yielding_actors(record)
    for actor_id in record.actors:
        if actor_id not in record.emv_ids:
            responds = actor_id in yielding
            draw_path(axes, record.track(actor_id), speeds, 1.5 if responds else 0.8, level=3.4 if responds else 3.0)
    labels = LabelPlacer(axes, 6.2)
    emv_lines = None
    for emv_id in record.emv_ids:
        emv_lines = draw_path(axes, record.track(emv_id), speeds, 3.6, casing="#1b1d21", level=4.0) or emv_lines
    for number, step in enumerate(moments, start=1):
        emvs = record.states[step].select(np.isin(record.states[step].actor_id, record.emv_ids))
        draw_vehicles(axes, emvs, record.actors, 0.5)
        for x_m, y_m in zip(emvs.x_m.tolist(), emvs.y_m.tolist(), strict=True):
            labels.block(x_m, y_m, 5.0)
            labels.place(x_m, y_m, str(number), "#b3121a")
    kinds = _draw_events(axes, record, labels)
    draw_scale_bar(axes)
    _draw_legends(axes, record, kinds)
    if emv_lines is not None:
        bar = axes.figure.colorbar(emv_lines, cax=axes.inset_axes((0.78, 0.055, 0.2, 0.022)), orientation="horizontal")
        bar.ax.set_title("speed, km/h", fontsize=7, color=TEXT, pad=3)
        bar.ax.tick_params(labelsize=6.5, length=2)


def _draw_events(axes: Axes, record: EpisodeRecord, labels: LabelPlacer) -> list[Any]:
    """Draw the events' markers and then their labels; returns the kinds of events drawn."""
    shown = [
        event
        for event in record.events
        if event.kind in EVENT_STYLES and (event.kind not in EMV_EVENTS or event.actor_id in record.emv_ids)
    ]
    visible = [event for event in shown if axes.viewLim.contains(event.x_m, event.y_m)]
    for event in visible:
        marker, colour, _ = EVENT_STYLES[event.kind]
        look: dict[str, Any] = {"color": colour, "markersize": 6.5, "markeredgecolor": "white", "markeredgewidth": 0.6}
        axes.plot(event.x_m, event.y_m, marker=marker, linestyle="none", zorder=8, **look)
        labels.block(event.x_m, event.y_m, 4.0)
    timed = len(visible) <= _TIMED_LABELS
    labelled = visible if timed else list({event.actor_id: event for event in reversed(visible)}.values())[::-1]
    for event in labelled:
        who = "EMV" if event.actor_id in record.emv_ids else f"#{event.actor_id}"
        text = f"{who} {event.step * STEP_S:.1f} s" if timed else who
        labels.place(event.x_m, event.y_m, text, EVENT_STYLES[event.kind][1])
    return sorted({event.kind for event in visible}, key=list(EVENT_STYLES).index)


def _draw_legends(axes: Axes, record: EpisodeRecord, kinds: list[Any]) -> None:
    present = {Mode(int(mode)) for mode in np.unique(record.rows.mode)}
    modes = [(name, MODE_COLOURS[mode]) for mode, name in STATE_NAMES.items() if mode in present]
    fills = [("EMV", EMV_COLOUR), *modes, ("other civilian", CIVILIAN)]
    handles: list[Any] = [Patch(facecolor=fill, edgecolor=TEXT, linewidth=0.4, label=name) for name, fill in fills]
    for marker, colour, name in (EVENT_STYLES[kind] for kind in kinds):
        look: dict[str, Any] = {"linestyle": "none", "markersize": 6, "markeredgecolor": "white"}
        handles.append(Line2D([], [], marker=marker, color=colour, label=name, **look))
    place: dict[str, Any] = {
        "loc": "upper center",
        "bbox_to_anchor": (0.5, -0.012),
        "ncols": len(handles),
        "borderaxespad": 0.2,
    }
    spacing: dict[str, Any] = {"handlelength": 1.2, "handletextpad": 0.5, "columnspacing": 1.4}
    axes.legend(handles=handles, fontsize=7, frameon=False, **place, **spacing)


def _draw_snapshot(axes: Axes, record: EpisodeRecord, step: int, number: int) -> None:
    """Draw the vehicles at one step, around the EMV and the yielding civilians."""
    state = record.states[step]
    frame_box(axes, _snapshot_box(record, step))
    draw_roads(axes, record.network, line_width=1.1)
    for emv_id in record.emv_ids:
        trail = record.track(emv_id)
        recent = trail.select((trail.step <= step) & (trail.step >= step - _TRAIL_STEPS))
        if len(recent) > 1:
            axes.plot(recent.x_m, recent.y_m, color="#d41a1f", linewidth=2.2, alpha=0.35, zorder=5)
    draw_vehicles(axes, state, record.actors, 0.5)
    above: dict[str, Any] = {"xytext": (0, 7), "textcoords": "offset points", "ha": "center"}
    for row in np.flatnonzero((state.mode >= Mode.YIELD_REACTING) & (state.mode <= Mode.REJOIN)):
        place = float(state.x_m[row]), float(state.y_m[row])
        if axes.viewLim.contains(*place):
            axes.annotate(f"#{state.actor_id[row]}", place, **above, fontsize=6.5, color=TEXT, zorder=9)
    text = f"{number}   {step * STEP_S:.1f} s"
    look: dict[str, Any] = {"fontsize": 8, "fontweight": "bold", "color": TEXT, "va": "top", "zorder": 10}
    box: dict[str, Any] = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none"}
    axes.text(0.015, 0.965, text, transform=axes.transAxes, bbox=box, **look)


def _snapshot_box(record: EpisodeRecord, step: int) -> Box:
    state = record.states[step]
    emv = np.isin(state.actor_id, record.emv_ids)
    active = (state.mode >= Mode.YIELD_REACTING) & (state.mode <= Mode.YIELD_HOLD)
    xy = np.stack((state.x_m, state.y_m), axis=-1)
    centre, spread = xy.mean(axis=0), np.array(_MIN_SIZE_M)
    if emv.any():
        near = np.linalg.norm(xy - xy[emv][0], axis=1) < 60.0
        chosen = xy[emv | (active & near)]
        centre, spread = (chosen.min(axis=0) + chosen.max(axis=0)) / 2.0, np.ptp(chosen, axis=0) + 2.0 * _MARGIN_M
    half_y = max(spread[1], spread[0] * 0.62, 26.0) / 2.0
    half_x = half_y / 0.62
    return centre[0] - half_x, centre[0] + half_x, centre[1] - half_y, centre[1] + half_y


def _draw_title(figure: Figure, record: EpisodeRecord) -> None:
    height_in, title = figure.get_size_inches()[1], title_of(record)
    figure.text(0.075, 1.0 - 0.3 / height_in, title, fontsize=14, fontweight="bold", color=TEXT, va="center")
    try:
        verdict = evaluate_predicate(record)
    except SirenError:
        return
    word, colour = ("interaction verified", "#12855f") if verdict.holds else ("interaction not found", "#b3121a")
    look: dict[str, Any] = {"fontsize": 11, "fontweight": "bold", "ha": "right", "va": "center"}
    figure.text(0.985, 1.0 - 0.3 / height_in, word, color=colour, **look)
    figure.text(0.075, 1.0 - 0.6 / height_in, verdict.text, fontsize=9, color=FAINT_TEXT, va="center")


def save_episode_picture(record: EpisodeRecord, path: Path) -> Path:
    """Draw an episode into a PNG file with ``save_png``; the same record gives the same bytes."""
    return save_png(path, lambda: draw_episode(record))


_GOOD: Final = "#12855f"
_LACKING: Final = ("#d9820f", "#c2185b", "#7b3fa0", "#1f77b4", "#8c5a2b", "#d4b106", "#3aa6a6", "#e0603c")
"""Colours of unsuitable places by what they lack; with more reasons the colours repeat."""
_COLUMNS: Final = 2
_LEAST_PANEL_IN, _MOST_PANEL_IN = 8.0, 16.0
_M_PER_IN: Final = 400.0
"""Scale from which panels become larger: a block of 100 m is then a quarter of an inch long."""
_LEAST_IN: Final = 2.0
"""Least height of a map."""
_HIGHEST: Final = 1.4
"""Largest height of a map over its width."""
_GOOD_PT: Final = 4.0
"""Width of the line of a good site; others have half of it, and markers this size."""
_GOOD_M: Final = 12.0
"""Width of this line in the map, where that is thinner: a street. It has at least a third of its points."""
_MOST_LABELLED: Final = 60
"""Good sites of a panel that have their number; more would hide the map."""
_TITLE_IN: Final = 0.75
_LINE_IN: Final = 0.2
_DPI: Final = 120
_MARGIN: Final = 0.03


Survey = tuple[Template, Mapping[Site, Sequence[Lack]]]
"""A template with all sites of its kind, best first, and what each lacks (empty for suitable ones)."""


def save_site_map(networks: Sequence[RoadNetwork], surveys: Sequence[Survey], path: Path) -> Path:
    """Draw the map once per template into a PNG file with ``save_png``."""
    return save_png(path, lambda: draw_site_map(networks, surveys))


def draw_site_map(networks: Sequence[RoadNetwork], surveys: Sequence[Survey]) -> Figure:
    """Draw one panel per template: suitable sites with their numbers in ``siren sites``, and other places.

    ``networks`` has the roads as each template uses them.
    """
    box = _box_around(networks)
    panel_in = float(np.clip((box[1] - box[0]) / _M_PER_IN, _LEAST_PANEL_IN, _MOST_PANEL_IN))
    colours = [*map(_colours, networks, surveys)]
    legends = [*map(_legend, networks, surveys, colours)]
    columns = min(_COLUMNS, len(surveys))
    rows = -(-len(surveys) // columns)
    shape = (box[3] - box[2]) / (box[1] - box[0])
    map_in = min(max(panel_in * shape, _LEAST_IN), _HIGHEST * panel_in)
    text_in = _TITLE_IN + _LINE_IN * (1 + max(map(len, legends)))
    size_in = np.array([columns * panel_in, rows * (map_in + text_in)])
    figure = Figure(figsize=(float(size_in[0]), float(size_in[1])), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    for place, legend in enumerate(legends):
        row, column = divmod(place, columns)
        corner_in = np.array([column * panel_in, size_in[1] - row * (map_in + text_in) - _TITLE_IN - map_in])
        (left, bottom), (width, height) = corner_in / size_in, np.array([panel_in, map_in]) / size_in
        axes = figure.add_axes((left + _MARGIN * width, bottom, (1.0 - 2.0 * _MARGIN) * width, height))
        _draw_panel(axes, networks[place], surveys[place], colours[place], box)
        axes.legend(
            handles=legend, loc="upper left", bbox_to_anchor=(0.0, -0.01), fontsize=8, frameon=False, labelcolor=TEXT
        )
    return figure


def _draw_panel(axes: Axes, network: RoadNetwork, survey: Survey, colours: Mapping[str, str], box: Box) -> None:
    frame_box(axes, box)
    axes.set_facecolor(GROUND)
    template, found = survey
    pt_per_m = axes.bbox.width * 72.0 / axes.figure.dpi / np.ptp(axes.get_xlim())
    lanes = [lane for lane in network.lanes if lane.kind in {LaneKind.SHOULDER, LaneKind.DRIVING, LaneKind.INTERNAL}]
    look: dict[str, Any] = {"linewidths": [max(lane.width_m * pt_per_m, 0.6) for lane in lanes], "capstyle": "butt"}
    look["colors"] = [LANE_FILL[lane.kind] for lane in lanes]
    axes.add_collection(LineCollection([lane.centre.points for lane in lanes], zorder=1, **look))
    good_pt = float(np.clip(_GOOD_M * pt_per_m, _GOOD_PT / 3.0, _GOOD_PT))
    good = [site for site, lacking in found.items() if not lacking]
    aside_m = 0.6 * good_pt / pt_per_m * (1.0 if network.left_hand else -1.0)
    ways = {site: _way_of(network, site, aside_m) for site in found}
    for text in [*colours, ""]:
        lines = [ways[site].points for site, lacks in found.items() if (lacks[0].text if lacks else "") == text]
        colour, width = (colours[text], good_pt / 2.0) if text else (_GOOD, good_pt)
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=width, capstyle="butt", zorder=4))
        places = [place.edge for place in places_without_site(network, template.site_kind) if place.lacking == text]
        ends = np.array([driving_lanes(network, edge)[-1].centre.points[-1] for edge in places]).reshape(-1, 2)
        axes.plot(*ends.T, marker="x", markersize=good_pt, color=colour, linestyle="none", zorder=3)
    labels, shown = LabelPlacer(axes, 7.5, 28.0), [ways[site] for site in good[:_MOST_LABELLED]]
    for way in shown:
        for x, y in way.at(0.5 * way.length_m + np.arange(-32.0, 33.0, 8.0) / pt_per_m):
            labels.block(x, y, 0.6 * good_pt)
    for number, way in enumerate(shown, start=1):
        x, y = way.at(0.5 * way.length_m).tolist()
        labels.place(x, y, str(number), _GOOD)
    draw_scale_bar(axes)
    count = f"{len(good)} good of {len(found)} sites" if found else "no site"
    look = {"xy": (0.0, 1.0), "xycoords": "axes fraction", "textcoords": "offset points"}
    axes.annotate(
        f"{template.template_id}: {count}", xytext=(0, 22), fontsize=11, fontweight="bold", color=TEXT, **look
    )
    needs = REQUIREMENTS[template.site_kind].removeprefix("a map with ")
    axes.annotate(f"It needs {needs}.", xytext=(0, 6), fontsize=7, color=FAINT_TEXT, **look)


def _way_of(network: RoadNetwork, site: Site, aside_m: float) -> Polyline:
    """A line beside the leftmost driving lanes of a site's stretch of road, so that both directions are seen."""
    points = np.concatenate([driving_lanes(network, edge)[-1].centre.points for edge in site.stretch])
    way = Polyline.through(points)
    return Polyline.through(way.offset_points(way.arc_m, aside_m))


def _legend(network: RoadNetwork, survey: Survey, colours: Mapping[str, str]) -> list[Line2D]:
    """Legend of the colours, with the number of places for each."""
    template, found = survey
    good = sum(not lacking for lacking in found.values())
    handles = [Line2D([], [], color=_GOOD, linewidth=4.0, label=f"good: {good}")] if good else []
    sites = Counter(lacking[0].text for lacking in found.values() if lacking)
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
    texts = [lacking[0].text for lacking in found.values() if lacking]
    texts += [place.lacking for place in places_without_site(network, template.site_kind)]
    return {text: _LACKING[place % len(_LACKING)] for place, text in enumerate(dict.fromkeys(texts))}


def _box_around(networks: Sequence[RoadNetwork]) -> Box:
    """Bounding box of all lanes."""
    points = np.concatenate([lane.centre.points for network in networks for lane in network.lanes])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.02 * float((high - low).max()) + 5.0
    (x0, y0), (x1, y1) = (low - margin).tolist(), (high + margin).tolist()
    return x0, x1, y0, y1
