"""The roads of an area as one image. It is drawn once; the frames of a video are cut from it."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from siren_ros.numerics.arrays import Points
from siren_ros.pictures.painter import paint_polygons, rgb_of
from siren_ros.pictures.roads import draw_roads
from siren_ros.roads.road_network import Lane, RoadNetwork

_DPI: Final = 100
_MARKING_M: Final = 0.13
"""Width of lane markings: 12 cm on urban roads in most of Europe."""
_STOP_BAR_M: Final = 0.5
"""Thickness of a stop line: 50 cm in most of Europe."""
_STOP_BAR: Final = rgb_of("#a8323a")
MOST_PIXELS: Final = 36_000_000
"""Largest image (144 MB while it is drawn); larger areas are drawn at a smaller scale."""


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
        scaled: Points = offset * (self.px_per_m, -self.px_per_m)
        return scaled


def draw_map_image(network: RoadNetwork, low_m: Points, high_m: Points, px_per_m: float) -> MapImage:
    """Draws the roads between two corners, with the stop lines of stop signs.

    Args:
        network: The map.
        low_m: South-west corner, shape ``(2,)``.
        high_m: North-east corner.
        px_per_m: Wanted scale; it becomes smaller where the image would pass ``MOST_PIXELS``.
    """
    size_m = high_m - low_m
    scale = min(px_per_m, float(np.sqrt(MOST_PIXELS / np.prod(size_m))))
    width, height = (int(np.ceil(side * scale)) for side in size_m)
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(low_m[0], low_m[0] + width / scale)
    axes.set_ylim(high_m[1] - height / scale, high_m[1])
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    draw_roads(axes, network, line_width=max(_MARKING_M * scale, 0.8) * 72.0 / _DPI)
    canvas.draw()  # type: ignore[no-untyped-call] # matplotlib's canvas has no annotations
    rgba = canvas.buffer_rgba()  # type: ignore[no-untyped-call] # the same
    pixels = Image.fromarray(np.ascontiguousarray(np.asarray(rgba)[..., :3]))
    image = MapImage(pixels, float(low_m[0]), float(high_m[1]), scale)
    stops = sorted({connection.from_lane for connection in network.connections if connection.must_stop})
    for lane in stops:
        paint_polygons(image.pixels, [(image.to_px(stop_bar(network.lanes[lane], 0.0, 1.0)), _STOP_BAR)])
    return image


def stop_bar(lane: Lane, from_share: float, to_share: float) -> Points:
    """Corners of a bar across the end of a lane, shape ``(4, 2)``, or of a part of it.

    Args:
        lane: The lane.
        from_share: Where the part begins, as a share of the lane's width from its left border.
        to_share: Where the part ends.
    """
    end = lane.length_m
    left, right = ((0.5 - share) * lane.width_m for share in (from_share, to_share))
    along = np.array([end - _STOP_BAR_M, end, end, end - _STOP_BAR_M])
    return lane.centre.offset_points(along, np.array([left, left, right, right]))
