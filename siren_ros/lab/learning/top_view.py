"""Pictures of a step from above: observations of kind ``raster``, and a view for people in a window.

A raster is small, in the own frame, with the own heading up.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from siren_ros.base.numerics.arrays import Points
from siren_ros.base.numerics.geometry import footprint_corners
from siren_ros.errors import InputError
from siren_ros.lab.learning.rollout import SeatState
from siren_ros.running.generation.closed_loop import LoopStep
from siren_ros.scoring.pictures.moving_birdseye import (
    MapImage,
    SignalBar,
    draw_map_image,
    paint_signals,
    paint_vehicles,
    rgb_of,
    signal_bars,
)
from siren_ros.scoring.pictures.plot_parts import lane_outline
from siren_ros.simulation.roads.road_network import MAPS_KEPT, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import ActorDescription, Lights

RASTER_PX: Final = 64
RASTER_PX_PER_M: Final = 1.0
"""Scale of the picture, which covers 64 m by 64 m."""
BEHIND_SHARE: Final = 0.5
"""Share of the picture behind the own centre."""
RASTER_SHAPE: Final = (RASTER_PX, RASTER_PX, 3)
_ROAD, _WAY, _OTHER, _SIREN, _OWN = 90, 180, 255, 255, 120
_PAVED: Final = frozenset({LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL})
_LARGEST_PX: Final = 36_000_000
_MARGIN_M: Final = RASTER_PX / RASTER_PX_PER_M

Raster = npt.NDArray[np.uint8]


class RasterView:
    """Draws the states of one episode. Channel 0: roads and own path; 1: other vehicles; 2: EMVs and own vehicle.

    Roads are 90 and the way 180; other vehicles 255; EMVs 255 with a siren and 180 without, the own vehicle 120.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self._roads, self._west_m, self._north_m, self._scale = _roads(network)

    def draw(self, state: SeatState) -> Raster:
        """The picture of a state, shape ``(64, 64, 3)``."""
        states, own = state.sight.states, state.sight.row
        x, y, yaw = float(states.x_m[own]), float(states.y_m[own]), float(states.yaw_rad[own])
        cos, sin = math.cos(yaw), math.sin(yaw)

        def to_px(xy: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
            dx, dy = xy[..., 0] - x, xy[..., 1] - y
            ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
            return np.stack(
                (0.5 * RASTER_PX - left * RASTER_PX_PER_M, (1.0 - BEHIND_SHARE) * RASTER_PX - ahead * RASTER_PX_PER_M),
                axis=-1,
            )

        # From picture pixels to map pixels: left = (c − column) / PX, ahead = (r − row) / PX.
        k, middle, base = self._scale / RASTER_PX_PER_M, 0.5 * RASTER_PX, (1.0 - BEHIND_SHARE) * RASTER_PX
        a, b = k * sin, -k * cos
        c = (x - self._west_m) * self._scale - a * middle - b * base
        d, e = k * cos, k * sin
        f = (self._north_m - y) * self._scale - d * middle - e * base
        first = self._roads.transform((RASTER_PX, RASTER_PX), Image.Transform.AFFINE, (a, b, c, d, e, f))
        way, s_m = state.sight.way.curve, state.sight.s_m
        ahead_m = np.arange(0.0, RASTER_PX / RASTER_PX_PER_M, 2.0)
        ImageDraw.Draw(first).line([tuple(point) for point in to_px(way.at(s_m + ahead_m)).tolist()], fill=_WAY)
        second, third = (Image.new("L", (RASTER_PX, RASTER_PX)) for _ in range(2))
        near = np.flatnonzero(np.hypot(states.x_m - x, states.y_m - y) < RASTER_PX / RASTER_PX_PER_M)
        bodies = [state.sight.bodies[actor_id] for actor_id in states.actor_id[near].tolist()]
        sizes = (np.array([getattr(body, name) for body in bodies]) for name in ("length_m", "width_m"))
        corners = to_px(footprint_corners(states.x_m[near], states.y_m[near], states.yaw_rad[near], *sizes))
        pens = ImageDraw.Draw(second), ImageDraw.Draw(third)
        for k_near, (row, body) in enumerate(zip(near.tolist(), bodies, strict=True)):
            points = [tuple(point) for point in corners[k_near].tolist()]
            if row == own:
                pens[1].polygon(points, fill=_OWN)
            elif body.is_emv:
                pens[1].polygon(points, fill=_SIREN if states.lights[row] & Lights.SIREN else _WAY)
            else:
                pens[0].polygon(points, fill=_OTHER)
        return np.stack([np.asarray(channel) for channel in (first, second, third)], axis=-1)


@lru_cache(maxsize=MAPS_KEPT)
def _roads(network: RoadNetwork) -> tuple[Image.Image, float, float, float]:
    """Draw the paved lanes of a map from above; also gives its west and north edges and pixels per metre."""
    outlines = [lane_outline(lane) for lane in network.lanes if lane.kind in _PAVED]
    outlines += [junction.outline for junction in network.junctions.values() if len(junction.outline) >= 3]
    points = np.concatenate(outlines)
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    width, height = (high - low).tolist()
    scale = min(2.0 * RASTER_PX_PER_M, math.sqrt(_LARGEST_PX / (width * height)))
    picture = Image.new("L", (math.ceil(width * scale), math.ceil(height * scale)))
    pen = ImageDraw.Draw(picture)
    for outline in outlines:
        px = (outline - (low[0], high[1])) * (scale, -scale)
        pen.polygon([tuple(point) for point in px.tolist()], fill=_ROAD)
    return picture, float(low[0]), float(high[1]), scale


VIEW_PX: Final = (640, 400)
VIEW_PX_PER_M: Final = 5.0
"""Scale of the picture, which covers 128 m by 80 m."""
_RING: Final = "#1a86b8"
_RING_PX: Final = 20
"""Radius of the ring around the driver's vehicle."""
_TILE_M: Final = 100.0
"""Roads are drawn this far beyond the picture, and again when a vehicle reaches that edge."""


class TopView:
    """Draws the steps of one episode; the drawn roads are reused."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._map: MapImage | None = None
        self._bars: list[SignalBar] = []
        self._centre_m = np.zeros(2)

    def draw(self, step: LoopStep, actors: Mapping[int, ActorDescription], actor_id: int) -> npt.NDArray[np.uint8]:
        """Draw a step around an actor, or around its last place, shape ``(400, 640, 3)``."""
        states = step.states
        row = states.row_of(actor_id)
        if row is not None:
            self._centre_m = np.array([states.x_m[row], states.y_m[row]])
        roads = self._roads(self._centre_m)
        left, top = (int(value) for value in _corner(roads, self._centre_m))
        picture = roads.pixels.crop((left, top, left + VIEW_PX[0], top + VIEW_PX[1]))
        origin = np.array([left, top], np.float64)
        paint_signals(picture, self._bars, origin, step.traffic.signals)
        paint_vehicles(picture, roads, origin, states, actors)
        x, y = (roads.to_px(self._centre_m) - origin).tolist()
        ring = (x - _RING_PX, y - _RING_PX, x + _RING_PX, y + _RING_PX)
        ImageDraw.Draw(picture).ellipse(ring, outline=rgb_of(_RING), width=2)
        return np.array(picture)

    def _roads(self, centre_m: Points) -> MapImage:
        """Image of the roads; it is drawn again if the present one does not cover this place."""
        kept = self._map
        if kept is not None:
            corner = _corner(kept, centre_m)
            if (corner >= 0).all() and (corner + VIEW_PX <= kept.pixels.size).all():
                return kept
        reach_m = 0.5 * np.array(VIEW_PX) / VIEW_PX_PER_M + _TILE_M
        kept = self._map = draw_map_image(self._network, centre_m - reach_m, centre_m + reach_m, VIEW_PX_PER_M)
        self._bars = signal_bars(self._network, kept)
        return kept


def _corner(roads: MapImage, centre_m: Points) -> npt.NDArray[np.int_]:
    """Top left corner of the picture around a place, in pixels of the roads' image."""
    return np.round(roads.to_px(centre_m) - 0.5 * np.array(VIEW_PX)).astype(int)


class Window:
    """A window that shows pictures."""

    def __init__(self, title: str) -> None:
        """Prepare; the window opens later.

        Raises:
            InputError: pygame is missing.
        """
        try:
            import pygame  # noqa: PLC0415 - a window's, which few need
        except ModuleNotFoundError as error:
            raise InputError("render_mode", "human", "the extra learn, which has pygame") from error
        self._pygame: Any = pygame
        self._title, self._surface = title, None

    def show(self, picture: npt.NDArray[np.uint8], fps: int) -> None:
        """Show a picture, shape ``(H, W, 3)``, at most ``fps`` per second."""
        pygame = self._pygame
        if self._surface is None:
            pygame.display.init()
            self._surface = pygame.display.set_mode((picture.shape[1], picture.shape[0]))
            pygame.display.set_caption(self._title)
            self._clock = pygame.time.Clock()
        pygame.surfarray.blit_array(self._surface, picture.swapaxes(0, 1))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(fps)

    def close(self) -> None:
        """Close the window."""
        if self._surface is not None:
            self._pygame.display.quit()
            self._surface = None
