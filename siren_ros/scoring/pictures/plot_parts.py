"""Parts of plots: colours, roads, vehicles, annotations beside points, and the timeline of events.

The colours are muted roads, a speed scale, and one colour per yield state.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.transforms import Bbox

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.geometry import footprint_corners
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces.boxes import EMV_COLOUR, MODE_COLOURS
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.errors import InputError, whole_file, writing
from siren_ros.simulation.roads.road_network import Lane, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import ActorDescription, ActorStates, EventKind, Lights, Mode

Rgba = tuple[float, float, float, float]

GROUND: Final = "#f3f1ea"
JUNCTION: Final = "#c3c7cc"
LANE_FILL: Final = {
    LaneKind.DRIVING: "#c9cdd2",
    LaneKind.INTERNAL: "#c3c7cc",
    LaneKind.SHOULDER: "#d9d4c5",
    LaneKind.CYCLE: "#dfc4b4",
    LaneKind.KERB: "#b9b3a6",
    LaneKind.SIDEWALK: "#e6e0d2",
    LaneKind.CROSSING: "#d7dade",
}
MARKING: Final = "#ffffff"
ROAD_EDGE: Final = "#8f959c"
TEXT: Final = "#22262b"
FAINT_TEXT: Final = "#6b7178"
SPEED_MAP: Final = "plasma"
CIVILIAN: Final[Rgba] = (0.42, 0.46, 0.51, 1.0)

MODE_NAMES: Final = {
    Mode.NOMINAL: "driving in traffic",
    Mode.ROUTE_FOLLOW: "following its route",
    Mode.FORCED_LANE_CHANGE: "forcing a lane change",
    Mode.COPY_SUMO: "in the corridor",
    Mode.GAP_ESCAPE: "escaping through a gap",
    Mode.YIELD_REACTING: "reacting",
    Mode.YIELD_DEFERRED: "deferred",
    Mode.YIELD_LANE_CHANGE: "changing lane",
    Mode.YIELD_KEEP_LANE: "lane cleared",
    Mode.YIELD_PULL_OVER: "pulling over",
    Mode.YIELD_HOLD: "holding",
    Mode.REJOIN: "rejoining",
    Mode.EXTERNAL: "driven by the AV's program",
    Mode.STOPPED: "stopped after contact",
}
"""Name of each mode in pictures and pages."""
STATE_NAMES: Final = {mode: name for mode, name in MODE_NAMES.items() if mode in MODE_COLOURS}
"""Names of the modes in which a civilian has its own colour."""
EMV_MODE_COLOURS: Final = {
    Mode.NOMINAL: "#b9bec4",
    Mode.ROUTE_FOLLOW: "#e9a3a3",
    Mode.FORCED_LANE_CHANGE: "#d95a20",
    Mode.COPY_SUMO: "#8f3fa8",
    Mode.GAP_ESCAPE: "#1f1f24",
    Mode.STOPPED: "#d40000",
}
EVENT_STYLES: Final[dict[EventKind, tuple[str, str, str]]] = {
    EventKind.YIELD_STARTED: (">", "#1a86b8", "yield starts"),
    EventKind.YIELD_COMPLETED: ("o", "#12855f", "lane cleared"),
    EventKind.YIELD_HELD: ("s", "#4a3590", "holds"),
    EventKind.LANE_CHANGE_STARTED: ("^", "#b3121a", "EMV changes lane"),
    EventKind.CORRIDOR_ENTERED: ("P", "#8f3fa8", "EMV enters corridor"),
    EventKind.GAP_ESCAPE_ENTERED: ("D", "#1f1f24", "EMV escapes through a gap"),
    EventKind.STOP_LINE_CROSSED: ("d", "#b3121a", "EMV crosses stop line"),
    EventKind.COLLISION: ("X", "#d40000", "collision"),
}
"""Marker, colour and legend text of the events that a picture shows."""
EMV_EVENTS: Final = frozenset(
    {
        EventKind.LANE_CHANGE_STARTED,
        EventKind.CORRIDOR_ENTERED,
        EventKind.GAP_ESCAPE_ENTERED,
        EventKind.STOP_LINE_CROSSED,
    }
)
"""Kinds of events that are shown for emergency vehicles only, because they are too frequent for civilians."""


def colour_of(mode: int, is_emv: bool) -> Rgba:
    """Fill colour of a vehicle: red for an EMV, its state's colour for a yielding civilian, otherwise grey."""
    if is_emv:
        return EMV_COLOUR
    return MODE_COLOURS.get(Mode(mode), CIVILIAN)


_PAVED = (LaneKind.DRIVING, LaneKind.SHOULDER)
_PADDING = 0.7
"""Padding of a label, both sides together, as a share of the font size; the letter # is wider than others."""
_CHARACTER_WIDTH = 0.56
"""Mean width of a character relative to the font size."""
KMH = 3.6
Box = tuple[float, float, float, float]
"""x from, x to, y from, y to, in metres."""


def frame_box(axes: Axes, box: Box) -> None:
    """Set the axes to a box, extended about its centre to their shape, with equal scales."""
    x0, x1, y0, y1 = box
    shape = axes.bbox.width / axes.bbox.height
    width = max(x1 - x0, (y1 - y0) * shape)
    height = width / shape
    axes.set_xlim((x0 + x1 - width) / 2.0, (x0 + x1 + width) / 2.0)
    axes.set_ylim((y0 + y1 - height) / 2.0, (y0 + y1 + height) / 2.0)
    axes.set_aspect("equal", adjustable="box")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_color("#c4c8cd")


def save_png(path: Path, draw: Callable[[], Figure]) -> Path:
    """Draw a figure into a PNG file; the same figure gives the same bytes.

    Raises InputError where the name does not end in .png, or the place cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise InputError("out", str(path), "a file name that ends in .png")
    figure = draw()
    with writing(path, "place"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            figure.savefig(file, format="png", metadata={"Software": None})
    return path


def draw_roads(axes: Axes, network: RoadNetwork, line_width: float) -> None:
    """Draw lane surfaces, junctions, crossings and markings; ``line_width`` of the markings is in points."""
    axes.set_facecolor(GROUND)
    order = (LaneKind.SIDEWALK, LaneKind.KERB, LaneKind.CYCLE, LaneKind.SHOULDER, LaneKind.DRIVING)
    for level, kind in enumerate(order):
        outlines = [lane_outline(lane) for lane in network.lanes if lane.kind is kind]
        area = PolyCollection(outlines, facecolors=LANE_FILL[kind], edgecolors="none", zorder=1 + level / 10)
        axes.add_collection(area)
    junctions = [junction.outline for junction in network.junctions.values() if len(junction.outline) >= 3]
    axes.add_collection(PolyCollection(junctions, facecolors=JUNCTION, edgecolors="none", zorder=1.5))
    stripes: dict[str, Any] = {"edgecolors": MARKING, "hatch": "|||", "linewidths": 0.0}
    axes.add_collection(PolyCollection(list(network.crossings), facecolors="none", zorder=1.6, **stripes))
    _draw_markings(axes, network, line_width)


def lane_outline(lane: Lane) -> Points:
    """Corners of a lane's surface, shape ``(2K, 2)``: along its left border, then back along the right one."""
    return np.concatenate((_border(lane, 1), _border(lane, -1)[::-1]))


def _border(lane: Lane, side: int) -> Points:
    """The left (+1) or right (−1) border of a lane; at inner points along the mean of both headings."""
    points = lane.centre.points
    headings = lane.centre.heading_rad(lane.centre.arc_m)
    before = np.concatenate((headings[:1], headings[:-1]))
    normal = np.stack((-np.sin(headings) - np.sin(before), np.cos(headings) + np.cos(before)), axis=-1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return points + side * lane.width_m / 2.0 * normal / np.maximum(length, 1e-6)


def _draw_markings(axes: Axes, network: RoadNetwork, line_width: float) -> None:
    dashed: list[Points] = []
    solid: list[Points] = []
    inwards = -1 if network.left_hand else 1
    for edge in network.edges:
        lanes = [network.lanes[index] for index in edge.lanes if network.lanes[index].kind in _PAVED]
        if edge.internal or not lanes:
            continue
        for outer, inner in pairwise(lanes):
            both_driven = outer.kind is inner.kind is LaneKind.DRIVING
            (dashed if both_driven else solid).append(_border(outer, inwards))
        solid += [_border(lanes[0], -inwards), _border(lanes[-1], inwards)]
    axes.add_collection(LineCollection(solid, colors=ROAD_EDGE, linewidths=line_width * 0.8, zorder=1.7))
    dashes = [(0, (6, 6))]
    axes.add_collection(LineCollection(dashed, colors=MARKING, linewidths=line_width, linestyles=dashes, zorder=1.7))


@dataclass
class LabelPlacer:
    """Places small labels next to points without overlaps; leaves a label out where no place is free."""

    axes: Axes
    font_size: float
    farthest_pt: float = 64.0
    """Labels are at most this far from their points."""
    taken: list[Bbox] = field(default_factory=list)

    def place(self, x_m: float, y_m: float, text: str, colour: str) -> bool:
        """Draw a label near a point with a thin leader line; False if no place is free."""
        dots = self.axes.figure.dpi / 72.0
        width, height = (_CHARACTER_WIDTH * len(text) + _PADDING) * self.font_size * dots, 1.5 * self.font_size * dots
        anchor_x, anchor_y = self.axes.transData.transform((x_m, y_m))
        frame = self.axes.bbox
        for radius in (radius for radius in (11.0, 19.0, 28.0, 38.0, 50.0, 64.0) if radius <= self.farthest_pt):
            for direction in (90, -90, 60, 120, -60, -120, 30, 150, -30, -150):
                dx = radius * math.cos(math.radians(direction)) * 1.3
                dy = radius * math.sin(math.radians(direction))
                centre_x, centre_y = anchor_x + dx * dots, anchor_y + dy * dots
                box = Bbox.from_bounds(centre_x - width / 2.0, centre_y - height / 2.0, width, height)
                inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
                if inside and not any(box.overlaps(other) for other in self.taken):
                    self.taken.append(box)
                    self._draw((x_m, y_m), (dx, dy), text, colour)
                    return True
        return False

    def block(self, x_m: float, y_m: float, radius_points: float) -> None:
        """Keep labels away from a marker."""
        reach = radius_points * self.axes.figure.dpi / 72.0
        x, y = self.axes.transData.transform((x_m, y_m))
        self.taken.append(Bbox.from_extents(x - reach, y - reach, x + reach, y + reach))

    def _draw(self, point: tuple[float, float], offset: tuple[float, float], text: str, colour: str) -> None:
        place: dict[str, Any] = {"xytext": offset, "textcoords": "offset points", "ha": "center", "va": "center"}
        box: dict[str, Any] = {"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none", "alpha": 0.78}
        leader: dict[str, Any] = {"arrowstyle": "-", "color": colour, "linewidth": 0.5, "shrinkA": 0.0, "shrinkB": 2.0}
        look: dict[str, Any] = {"fontsize": self.font_size, "color": colour, "zorder": 9}
        self.axes.annotate(text, point, **place, **look, bbox=box, arrowprops=leader)


def draw_scale_bar(axes: Axes) -> None:
    """Draw a bar of 1, 2 or 5 × 10ⁿ m, about a sixth of the picture wide, in the lower left corner."""
    (x0, x1), (y0, _) = axes.get_xlim(), axes.get_ylim()
    longest = (x1 - x0) / 6.0
    power = 10.0 ** math.floor(math.log10(longest))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest)
    dots_per_m = axes.bbox.width / (x1 - x0)
    point_m = axes.figure.dpi / 72.0 / dots_per_m
    left, bottom = x0 + 12 * point_m, y0 + 10 * point_m
    rim: dict[str, Any] = {"edgecolor": TEXT, "linewidth": 0.6, "zorder": 10}
    for start, colour in ((left, TEXT), (left + length / 2.0, "white")):
        axes.add_patch(Rectangle((start, bottom), length / 2.0, 3.5 * point_m, facecolor=colour, **rim))
    box: dict[str, Any] = {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.7}
    place = (left + length + 4 * point_m, bottom + 1.75 * point_m)
    axes.text(*place, f"{length:g} m", fontsize=7, color=FAINT_TEXT, va="center", zorder=10, bbox=box)


def draw_vehicles(axes: Axes, states: ActorStates, actors: Mapping[int, ActorDescription], line_width: float) -> None:
    """Draw footprints at one step with windscreens that show their headings; EMVs on top."""
    described = [actors[int(key)] for key in states.actor_id]
    length = np.array([actor.length_m for actor in described])
    width = np.array([actor.width_m for actor in described])
    colours = [colour_of(int(mode), actor.is_emv) for mode, actor in zip(states.mode, described, strict=True)]
    bodies = footprint_corners(states.x_m, states.y_m, states.yaw_rad, length, width)
    ahead = 0.18 * length
    glass_x, glass_y = states.x_m + ahead * np.cos(states.yaw_rad), states.y_m + ahead * np.sin(states.yaw_rad)
    glass = footprint_corners(glass_x, glass_y, states.yaw_rad, 0.14 * length, 0.78 * width)
    axes.add_collection(PolyCollection([*bodies], facecolors=colours, edgecolors=TEXT, linewidths=line_width, zorder=6))
    axes.add_collection(PolyCollection(list(glass), facecolors=(1.0, 1.0, 1.0, 0.75), edgecolors="none", zorder=6.1))
    sounding = (states.lights & Lights.SIREN) != 0
    axes.scatter(states.x_m[sounding], states.y_m[sounding], s=14, marker="*", c="white", linewidths=0.0, zorder=6.2)


def draw_path(
    axes: Axes, track: StateRows, speeds: Normalize, width: float, casing: str | None = None, level: float = 3.0
) -> LineCollection | None:
    """Draw a path coloured by speed in km/h, outlined in ``casing``; None if it has fewer than two states."""
    if len(track) < 2:
        return None
    segments = segments_of(track.xy_m)
    if casing is not None:
        axes.add_collection(
            LineCollection(segments, colors=casing, linewidths=width + 1.8, capstyle="round", zorder=level - 0.1)
        )
    lines = LineCollection(segments, cmap=SPEED_MAP, norm=speeds, linewidths=width, capstyle="round", zorder=level)
    lines.set_array(track.speed_mps[1:] * KMH)
    axes.add_collection(lines)
    return lines


def segments_of(xy_m: Floats) -> Sequence[Floats]:
    """Pairs of consecutive points, each of shape ``(2, 2)``."""
    return list(np.stack((xy_m[:-1], xy_m[1:]), axis=1))


def title_of(record: EpisodeRecord) -> str:
    """Template, level, seed and map of an episode."""
    described = record.description
    return f"{described.template} · {described.level.name} · seed {described.seed} · {described.map_name}"


def yielding_actors(record: EpisodeRecord) -> tuple[int, ...]:
    """Civilians that yield, sorted by when they begin."""
    rows = record.rows
    yielding = rows.select((rows.mode >= Mode.YIELD_REACTING) & (rows.mode <= Mode.YIELD_HOLD))
    first: dict[int, int] = {}
    for actor_id, step in zip(yielding.actor_id.tolist(), yielding.step.tolist(), strict=True):
        first.setdefault(actor_id, step)
    return tuple(sorted(first, key=lambda actor_id: (first[actor_id], actor_id)))


def mode_runs(track: StateRows) -> list[tuple[int, int, Mode]]:
    """First and last step of every run of equal mode."""
    if len(track) == 0:
        return []
    edges = np.flatnonzero(np.diff(track.mode.astype(np.int64)) != 0)
    starts, ends = np.concatenate(([0], edges + 1)), np.concatenate((edges, [len(track) - 1]))
    return [
        (int(track.step[first]), int(track.step[last]), Mode(int(track.mode[first])))
        for first, last in zip(starts, ends, strict=True)
    ]


def draw_states(axes: Axes, record: EpisodeRecord, actors: Sequence[int], moments: Sequence[int]) -> None:
    """Draw one bar per vehicle with its mode over time; markers show events, lines the snapshots."""
    for row, actor_id in enumerate(actors):
        is_emv = record.actors[actor_id].is_emv
        for first, last, mode in mode_runs(record.track(actor_id)):
            colour, height = EMV_MODE_COLOURS.get(mode, "#b9bec4") if is_emv else colour_of(mode, False), 0.62
            if not is_emv and mode is Mode.NOMINAL:
                colour, height = "#d5d8dc", 0.24
            start_s, length_s = first * STEP_S, (last + 1 - first) * STEP_S
            axes.barh(row, length_s, left=start_s, height=height, color=colour, linewidth=0.0)
    position = {actor_id: row for row, actor_id in enumerate(actors)}
    rim: dict[str, Any] = {"markersize": 4.5, "markeredgecolor": "white", "markeredgewidth": 0.5}
    for event in record.events:
        if event.kind in EVENT_STYLES and event.actor_id in position:
            marker, colour, _ = EVENT_STYLES[event.kind]
            axes.plot(event.step * STEP_S, position[event.actor_id], marker=marker, color=colour, **rim)
    above: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "ha": "center", "va": "bottom"}
    for number, step in enumerate(moments, start=1):
        axes.axvline(step * STEP_S, color=FAINT_TEXT, linewidth=0.7, linestyle=":", zorder=0)
        axes.annotate(str(number), (step * STEP_S, 1.0), fontsize=7, **above)
    drawn = [(actor_id, record.actors[actor_id]) for actor_id in actors]
    names = ["EMV" if actor.is_emv else f"#{key} {actor.actor_class.name.lower()}" for key, actor in drawn]
    axes.set_yticks(range(len(actors)), names, fontsize=7)
    axes.set_ylim(len(actors) - 0.45, -0.55)
    _plain(axes)


def draw_speeds(axes: Axes, record: EpisodeRecord, actors: Sequence[int]) -> None:
    """Draw speeds over time: the EMV's in red, collisions as crosses."""
    for actor_id in actors:
        track, is_emv = record.track(actor_id), record.actors[actor_id].is_emv
        colour, width, alpha, level = ("#d41a1f", 1.8, 1.0, 3) if is_emv else ("#7d838b", 0.8, 0.7, 2)
        speed_kmh = track.speed_mps * KMH
        axes.plot(track.time_s, speed_kmh, color=colour, linewidth=width, alpha=alpha, zorder=level)
    for event in record.events_of(EventKind.COLLISION):
        axes.axvline(event.step * STEP_S, color="#d40000", linewidth=1.0)
    axes.set_ylabel("speed, km/h", fontsize=7.5, color=TEXT)
    axes.set_xlabel("simulated time, s", fontsize=7.5, color=TEXT)
    axes.set_ylim(bottom=0.0)
    axes.grid(axis="y", linewidth=0.4, color="#dcdfe3")
    _plain(axes)


def _plain(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#9aa0a7")
    axes.tick_params(labelsize=7, colors=TEXT, length=2.5)
