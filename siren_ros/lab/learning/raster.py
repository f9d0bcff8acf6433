"""Observations of kind ``raster``: a small picture from above in the own frame, with the own heading up."""

import math
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from siren_ros.base.numerics.geometry import footprint_corners
from siren_ros.lab.learning.seat_state import SeatState
from siren_ros.scoring.pictures.plot_parts import lane_outline
from siren_ros.simulation.roads.road_network import MAPS_KEPT, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import Lights

SIDE_PX: Final = 64
PX_PER_M: Final = 1.0
"""Scale of the picture, which covers 64 m by 64 m."""
BEHIND_SHARE: Final = 0.5
"""Share of the picture behind the own centre."""
SHAPE: Final = (SIDE_PX, SIDE_PX, 3)
_ROAD, _WAY, _OTHER, _SIREN, _OWN = 90, 180, 255, 255, 120
_PAVED: Final = frozenset({LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL})
_LARGEST_PX: Final = 36_000_000
_MARGIN_M: Final = SIDE_PX / PX_PER_M

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
                (0.5 * SIDE_PX - left * PX_PER_M, (1.0 - BEHIND_SHARE) * SIDE_PX - ahead * PX_PER_M), axis=-1
            )

        # From picture pixels to map pixels: left = (c − column) / PX, ahead = (r − row) / PX.
        k, middle, base = self._scale / PX_PER_M, 0.5 * SIDE_PX, (1.0 - BEHIND_SHARE) * SIDE_PX
        a, b = k * sin, -k * cos
        c = (x - self._west_m) * self._scale - a * middle - b * base
        d, e = k * cos, k * sin
        f = (self._north_m - y) * self._scale - d * middle - e * base
        first = self._roads.transform((SIDE_PX, SIDE_PX), Image.Transform.AFFINE, (a, b, c, d, e, f))
        way, s_m = state.sight.way.curve, state.sight.s_m
        ahead_m = np.arange(0.0, SIDE_PX / PX_PER_M, 2.0)
        ImageDraw.Draw(first).line([tuple(point) for point in to_px(way.at(s_m + ahead_m)).tolist()], fill=_WAY)
        second, third = (Image.new("L", (SIDE_PX, SIDE_PX)) for _ in range(2))
        near = np.flatnonzero(np.hypot(states.x_m - x, states.y_m - y) < SIDE_PX / PX_PER_M)
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
    scale = min(2.0 * PX_PER_M, math.sqrt(_LARGEST_PX / (width * height)))
    picture = Image.new("L", (math.ceil(width * scale), math.ceil(height * scale)))
    pen = ImageDraw.Draw(picture)
    for outline in outlines:
        px = (outline - (low[0], high[1])) * (scale, -scale)
        pen.polygon([tuple(point) for point in px.tolist()], fill=_ROAD)
    return picture, float(low[0]), float(high[1]), scale
