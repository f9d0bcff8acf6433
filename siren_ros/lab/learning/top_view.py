"""A picture of a step from above, around a driver's vehicle, and a window that shows it."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import ImageDraw

from siren_ros.base.numerics.arrays import Points
from siren_ros.errors import InputError
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
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import ActorDescription

SIZE_PX: Final = (640, 400)
PX_PER_M: Final = 5.0
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
        picture = roads.pixels.crop((left, top, left + SIZE_PX[0], top + SIZE_PX[1]))
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
            if (corner >= 0).all() and (corner + SIZE_PX <= kept.pixels.size).all():
                return kept
        reach_m = 0.5 * np.array(SIZE_PX) / PX_PER_M + _TILE_M
        kept = self._map = draw_map_image(self._network, centre_m - reach_m, centre_m + reach_m, PX_PER_M)
        self._bars = signal_bars(self._network, kept)
        return kept


def _corner(roads: MapImage, centre_m: Points) -> npt.NDArray[np.int_]:
    """Top left corner of the picture around a place, in pixels of the roads' image."""
    return np.round(roads.to_px(centre_m) - 0.5 * np.array(SIZE_PX)).astype(int)


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
