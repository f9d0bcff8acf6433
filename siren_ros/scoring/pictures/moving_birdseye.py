"""A film of an episode from above: the camera follows the EMV over roads that are drawn once.

Shapes are drawn larger and then reduced to get smooth edges, because Pillow draws without antialiasing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.geometry import footprint_corners
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces.boxes import MODE_COLOURS
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.scoring.pictures.plot_parts import (
    CIVILIAN,
    EMV_MODE_COLOURS,
    STATE_NAMES,
    TEXT,
    colour_of,
    draw_roads,
    title_of,
)
from siren_ros.simulation.roads.road_network import Lane, RoadNetwork
from siren_ros.simulation.world.actors import NO_ACTOR, ActorDescription, ActorStates, Lights, Mode, SignalState

SignalBar = tuple[str, int, Points]
"""Bar of a signal: its id, the link, and the bar's corners in the map image."""
Colour = tuple[int, ...]
"""Red, green, blue and, where it has one, opacity, 0 to 255 each."""
_OVERSAMPLING: Final = 4
_DPI: Final = 100
_MARKING_M: Final = 0.13
"""Width of lane markings: 12 cm on urban roads in most of Europe."""
_STOP_BAR_M: Final = 0.5
"""Thickness of a stop line: 50 cm in most of Europe."""
MOST_PIXELS: Final = 36_000_000
"""Largest image (144 MB while it is drawn); larger areas get a smaller scale."""
SIZE_PX: Final = (1280, 720)
PX_PER_M: Final = 9.0
"""Scale of the film; a frame shows 142 m by 80 m."""
_TRAIL_STEPS: Final = 60
_CAMERA_STEPS: Final = 40
"""Half width, in steps, of the window that smooths the camera's path."""
_BEACON_STEPS: Final = 4
_LEFT_TO_RIGHT: Final = "lLsRr"
_GLASS: Final = (255, 255, 255, 190)
_TRAIL: Final = (212, 26, 31, 80)
_PANEL: Final = (255, 255, 255, 225)
_ON_ONE_LINE: Final = 2
"""Up to this many EMVs, their states fit beside the title."""
_LINE_PX: Final = 24
"""Height of a text line for more EMVs."""


def rgb_of(colour: str | Sequence[float]) -> Colour:
    """Convert ``#rrggbb`` or components from 0 to 1 to components from 0 to 255."""
    if isinstance(colour, str):
        return tuple(int(colour[start : start + 2], 16) for start in (1, 3, 5))
    return tuple(round(255 * component) for component in colour)


def font(size_px: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Matplotlib's font, so that pictures are the same on every machine."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / name), size_px)


def paint_polygons(picture: Image.Image, shapes: Sequence[tuple[Points, Colour]]) -> None:
    """Fill polygons (corners in pixels ``(K, 2)``, colour) that are close together, with smooth edges."""
    corners = np.concatenate([points for points, _ in shapes])
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, picture.size)
    if (high <= low).any():
        return
    size, (left, top) = tuple((high - low).tolist()), low.tolist()
    patch = picture.crop((left, top, *high.tolist()))
    patch = patch.resize((size[0] * _OVERSAMPLING, size[1] * _OVERSAMPLING), Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(patch, "RGBA")
    for points, colour in shapes:
        draw.polygon([(x, y) for x, y in ((points - low) * _OVERSAMPLING).tolist()], fill=colour)
    picture.paste(patch.resize(size, Image.Resampling.BOX), (left, top))


def ribbon(points: Points, width_px: float) -> Points:
    """Outline of a line of some width through points, shape ``(2K, 2)``."""
    along = np.gradient(points, axis=0)
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    normal = np.stack((-along[:, 1], along[:, 0]), axis=-1) * width_px / 2.0
    return np.concatenate((points + normal, (points - normal)[::-1]))


_STOP_BAR: Final = rgb_of("#a8323a")


@dataclass(frozen=True)
class MapImage:
    """The roads from above, north up."""

    pixels: Image.Image
    west_m: float
    north_m: float
    px_per_m: float

    def to_px(self, xy_m: npt.ArrayLike) -> Points:
        """Places of the map (shape ``(..., 2)``) in the image, in pixels from its top left corner."""
        offset = np.asarray(xy_m, dtype=np.float64) - (self.west_m, self.north_m)
        return np.asarray(offset * (self.px_per_m, -self.px_per_m))


def draw_map_image(network: RoadNetwork, low_m: Points, high_m: Points, px_per_m: float) -> MapImage:
    """Draw roads and stop lines between two corners (south-west first); at most ``MOST_PIXELS``."""
    size_m = high_m - low_m
    scale = min(px_per_m, float(np.sqrt(MOST_PIXELS / np.prod(size_m))))
    width, height = (int(np.ceil(side * scale)) for side in size_m)
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(low_m[0], low_m[0] + width / scale), ylim=(high_m[1] - height / scale, high_m[1]))
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    draw_roads(axes, network, line_width=max(_MARKING_M * scale, 0.8) * 72.0 / _DPI)
    canvas.draw()  # type: ignore[no-untyped-call] # matplotlib's canvas has no annotations
    rgba = canvas.buffer_rgba()  # type: ignore[no-untyped-call] # the same
    pixels = Image.fromarray(np.ascontiguousarray(np.asarray(rgba)[..., :3]))
    image = MapImage(pixels, float(low_m[0]), float(high_m[1]), scale)
    for lane in sorted({connection.from_lane for connection in network.connections if connection.must_stop}):
        paint_polygons(image.pixels, [(image.to_px(stop_bar(network.lanes[lane], 0.0, 1.0)), _STOP_BAR)])
    return image


def stop_bar(lane: Lane, from_share: float, to_share: float) -> Points:
    """Corners of a bar across a lane's end, ``(4, 2)``, between two shares of its width from the left border."""
    end = lane.length_m
    left, right = ((0.5 - share) * lane.width_m for share in (from_share, to_share))
    along = np.array([end - _STOP_BAR_M, end, end, end - _STOP_BAR_M])
    return lane.centre.offset_points(along, np.array([left, left, right, right]))


_SIGNAL_HEX: Final = {"r": "#d8232a", "u": "#ef7d1a", "y": "#f4c20d", "g": "#2f9e44", "G": "#2f9e44", "s": "#7ab87f"}
_SIGNAL_COLOURS: Final = {letter: rgb_of(colour) for letter, colour in _SIGNAL_HEX.items()}
_SIGNAL_OFF: Final = rgb_of("#777b80")
_BEACONS: Final = (rgb_of("#2f6bff"), rgb_of("#ffffff"))
_BRAKE: Final = rgb_of("#ff2a1f")
_OUTLINE: Final = rgb_of(TEXT)


class BirdseyeFilm:
    """Makes the frames of one episode's film."""

    def __init__(self, record: EpisodeRecord, steps: Sequence[int]) -> None:
        """Draw the roads for frames at indices of ``record.states``; InputError for a record without states."""
        if not record.states or len(record.rows) == 0:
            raise InputError("bag", record.description.template, "an episode with at least one recorded actor state")
        self._record = record
        self._steps = steps
        self._camera_m = _camera_way(record)
        way = self._camera_m[list(steps)] if len(steps) else self._camera_m[:1]
        half = np.array(SIZE_PX) / PX_PER_M / 2.0 + 2.0
        self._map = draw_map_image(record.network, way.min(axis=0) - half, way.max(axis=0) + half, PX_PER_M)
        self._bars = signal_bars(record.network, self._map)
        self._tracks = {emv_id: record.track(emv_id) for emv_id in record.emv_ids}
        self._legend = _legend(record)

    def frames(self) -> Iterator[npt.NDArray[np.uint8]]:
        """Yield the frames, RGB, shape ``(720, 1280, 3)``."""
        for step in self._steps:
            yield np.asarray(self.frame(step))

    def frame(self, step: int) -> Image.Image:
        """Picture of one step (index in ``record.states``)."""
        corner = np.round(self._map.to_px(self._camera_m[step]) - np.array(SIZE_PX) / 2.0).astype(int)
        limit = np.maximum(np.array(self._map.pixels.size) - SIZE_PX, 0)
        left, top = (int(value) for value in np.clip(corner, 0, limit))
        picture = self._map.pixels.crop((left, top, left + SIZE_PX[0], top + SIZE_PX[1]))
        origin = np.array([left, top], dtype=np.float64)
        for paint in (self._paint_signals, self._paint_trails, self._paint_vehicles):
            paint(picture, origin, step)
        self._write(picture, step)
        return picture

    def _paint_signals(self, picture: Image.Image, origin: Floats, step: int) -> None:
        if step < len(self._record.traffic):
            paint_signals(picture, self._bars, origin, self._record.traffic[step].signals)

    def _paint_trails(self, picture: Image.Image, origin: Floats, step: int) -> None:
        last = self._record.states[step].step
        for track in self._tracks.values():
            recent = track.select((track.step <= last) & (track.step >= last - _TRAIL_STEPS))
            moved = np.hypot(np.diff(recent.x_m, prepend=np.inf), np.diff(recent.y_m, prepend=np.inf)) > 0.02
            points = self._map.to_px(recent.xy_m[moved]) - origin
            if len(points) > 2:
                paint_polygons(picture, [(ribbon(points, 0.7 * self._map.px_per_m), _TRAIL)])

    def _paint_vehicles(self, picture: Image.Image, origin: Floats, step: int) -> None:
        paint_vehicles(picture, self._map, origin, self._record.states[step], self._record.actors)

    def _write(self, picture: Image.Image, step: int) -> None:
        """Write title, state and time of each EMV, and the legend; more than two EMVs get lines of their own."""
        record, state = self._record, self._record.states[step]
        draw = ImageDraw.Draw(picture, "RGBA")
        emvs = np.flatnonzero(np.isin(state.actor_id, record.emv_ids))
        line_px = _LINE_PX if len(emvs) > _ON_ONE_LINE else 0
        draw.rectangle((0, 0, SIZE_PX[0], 40 + max(len(emvs) - 1, 0) * line_px), fill=_PANEL)
        draw.text((16, 20), title_of(record), _OUTLINE, font(18, bold=True), anchor="lm")
        draw.text((SIZE_PX[0] - 16, 20), f"{state.step * STEP_S:5.1f} s", _OUTLINE, font(18, bold=True), anchor="rm")
        right = SIZE_PX[0] - 130.0
        for number, row in reversed([*enumerate(emvs)]):
            middle = 20 + number * line_px
            mode = Mode(int(state.mode[row]))
            siren = "siren" if int(state.lights[row]) & Lights.SIREN else "no siren"
            name = mode.name.lower().replace("_", " ")
            text = f"EMV {state.actor_id[row]}: {state.speed_mps[row] * 3.6:3.0f} km/h, {name}, {siren}"
            draw.text((right, middle), text, _OUTLINE, font(16), anchor="rm")
            left = right - draw.textlength(text, font(16))
            mark = left - 20, middle - 7, left - 7, middle + 7
            draw.rectangle(mark, fill=rgb_of(EMV_MODE_COLOURS.get(mode, TEXT)))
            right = right if line_px else left - 40.0
        picture.paste(self._legend, (0, SIZE_PX[1] - self._legend.height))
        _scale_bar(draw, self._map.px_per_m)


def paint_signals(
    picture: Image.Image, bars: Sequence[SignalBar], origin: Floats, signals: Sequence[SignalState]
) -> None:
    """Paint signal bars in their present colours; ``origin`` is the picture's corner in the map image."""
    states = {signal.signal_id: signal.state for signal in signals}
    for signal_id, link, corners in bars:
        state = states.get(signal_id, "")
        letter = state[link] if 0 <= link < len(state) else ""
        paint_polygons(picture, [(corners - origin, _SIGNAL_COLOURS.get(letter, _SIGNAL_OFF))])


def paint_vehicles(
    picture: Image.Image,
    image: MapImage,
    origin: Floats,
    state: ActorStates,
    described: Mapping[int, ActorDescription],
) -> None:
    """Paint all actors in a part of the map image, with lights and the numbers of yielding vehicles.

    Args:
        picture: The part, which is painted on.
        image: The map.
        origin: The part's top left corner in the map image, in pixels.
        state: The step.
        described: Descriptions of the actors.
    """
    actors = [described[int(key)] for key in state.actor_id]
    length, width = (np.array([getattr(actor, name) for actor in actors]) for name in ("length_m", "width_m"))

    def boxes(ahead: float, size: float, across: float = 1.0) -> Floats:
        """Boxes on the vehicles. Offset and size are shares of the length, ``across`` is a share of the width."""
        x = state.x_m + ahead * length * np.cos(state.yaw_rad)
        y = state.y_m + ahead * length * np.sin(state.yaw_rad)
        return image.to_px(footprint_corners(x, y, state.yaw_rad, size * length, across * width)) - origin

    rim = 1.2 / image.px_per_m
    outline = footprint_corners(state.x_m, state.y_m, state.yaw_rad, length + 2 * rim, width + 2 * rim)
    outer, body = image.to_px(outline) - origin, boxes(0.0, 1.0)
    glass, tail, beacon = boxes(0.18, 0.14, 0.78), boxes(-0.46, 0.08), boxes(-0.05, 0.12, 0.6)
    draw = ImageDraw.Draw(picture)
    for row in np.argsort([actor.is_emv for actor in actors], kind="stable"):
        if (outer[row].max(axis=0) <= 0.0).any() or (outer[row].min(axis=0) >= picture.size).any():
            continue
        lights = int(state.lights[row])
        fill = rgb_of(colour_of(int(state.mode[row]), actors[row].is_emv))
        shapes = [(outer[row], _OUTLINE), (body[row], fill), (glass[row], _GLASS)]
        if lights & Lights.BRAKE:
            shapes.append((tail[row], _BRAKE))
        if lights & (Lights.BEACON | Lights.SIREN):
            shapes.append((beacon[row], _BEACONS[state.step // _BEACON_STEPS % 2]))
        paint_polygons(picture, shapes)
        if Mode(int(state.mode[row])).is_yielding:
            place = (float(body[row][:, 0].mean()), float(body[row][:, 1].min()) - 3.0)
            number = str(state.actor_id[row])
            draw.text(place, number, _OUTLINE, font(12), anchor="mb", stroke_width=2, stroke_fill="white")


def _camera_way(record: EpisodeRecord) -> Floats:
    """Centre of the picture at each state: the first EMV's smoothed path, ``(steps, 2)``."""
    track = record.rows.select(record.rows_of(record.emv_ids[0] if record.emv_ids else NO_ACTOR))
    steps = np.array([state.step for state in record.states], dtype=np.int64)
    if len(track) == 0:
        return np.tile(record.rows.xy_m.mean(axis=0), (len(steps), 1))
    way = np.stack([np.interp(steps, track.step, track.xy_m[:, axis]) for axis in (0, 1)], axis=-1)
    weights = np.hanning(2 * _CAMERA_STEPS + 3)[1:-1]
    padded = np.pad(way, ((_CAMERA_STEPS, _CAMERA_STEPS), (0, 0)), mode="edge")
    smooth = [np.convolve(padded[:, axis], weights / weights.sum(), mode="valid") for axis in (0, 1)]
    return np.stack(smooth, axis=-1)


def signal_bars(network: RoadNetwork, image: MapImage) -> list[SignalBar]:
    """One bar per movement with a signal."""
    bars = []
    sides = f"{_LEFT_TO_RIGHT}t" if network.left_hand else f"t{_LEFT_TO_RIGHT}"
    for lane, connections in network.connections_from.items():
        signalled = [movement for movement in connections if movement.signal_id is not None]
        signalled.sort(key=lambda movement: (sides.find(movement.direction), movement.signal_link))
        for number, movement in enumerate(signalled):
            part = (number / len(signalled), (number + 1) / len(signalled))
            corners = image.to_px(stop_bar(network.lanes[lane], *part))
            bars.append((str(movement.signal_id), movement.signal_link, corners))
    return bars


def _legend(record: EpisodeRecord) -> Image.Image:
    present = {Mode(int(mode)) for mode in np.unique(record.rows.mode)}
    entries = [("EMV", rgb_of(colour_of(Mode.NOMINAL, is_emv=True))), ("other civilian", rgb_of(CIVILIAN))]
    entries += [(name, rgb_of(MODE_COLOURS[mode])) for mode, name in STATE_NAMES.items() if mode in present]
    picture = Image.new("RGB", (SIZE_PX[0], 32), (255, 255, 255))
    draw = ImageDraw.Draw(picture)
    left = 200.0
    for name, colour in entries:
        draw.rectangle((left, 10, left + 20, 22), fill=colour, outline=_OUTLINE)
        draw.text((left + 27, 16), name, _OUTLINE, font(14), anchor="lm")
        left += 50.0 + draw.textlength(name, font(14))
    return picture


def _scale_bar(draw: ImageDraw.ImageDraw, px_per_m: float) -> None:
    left, right, bottom = 16.0, 16.0 + 10.0 * px_per_m, SIZE_PX[1] - 13.0
    draw.rectangle((left, bottom - 5, right, bottom), fill=_OUTLINE)
    draw.text((right + 8, bottom - 2), "10 m", _OUTLINE, font(13), anchor="lm")
