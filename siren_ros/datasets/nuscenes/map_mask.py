"""nuScenes' map layer: a picture of where one can drive, 0.1 m a pixel, its lower left corner at the frame's origin."""

import io
from typing import Final

import numpy as np
from PIL import Image, ImageDraw
from shapely.geometry import LineString

from siren_ros.numerics.arrays import Floats
from siren_ros.roads.road_network import LaneKind, RoadNetwork

RESOLUTION_M: Final = 0.1
_MARGIN_M: Final = 60.0
_DRIVEN: Final = frozenset({LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL})


def map_corners(network: RoadNetwork) -> tuple[Floats, Floats]:
    """Lower left and upper right corner of a map with a margin, whole metres in the ``map`` frame, shape ``(2,)``.

    The lower left corner is the origin of nuScenes' global frame, which has no negative places.
    """
    points = np.concatenate([lane.centre.points for lane in network.lanes])
    low: Floats = np.floor(points.min(axis=0) - _MARGIN_M)
    high: Floats = np.ceil(points.max(axis=0) + _MARGIN_M)
    return low, high


def mask_png(network: RoadNetwork) -> bytes:
    """The mask as PNG: 255 on lanes, shoulders and junctions."""
    low, high = map_corners(network)
    width, height = np.round((high - low) / RESOLUTION_M).astype(int).tolist()
    image = Image.new("L", (width, height), 0)
    draw = ImageDraw.Draw(image)

    def pixels(xy: Floats) -> list[tuple[float, float]]:
        place = (np.asarray(xy) - low) / RESOLUTION_M
        return [(float(x), float(height - y)) for x, y in place]

    for lane in network.lanes:
        if lane.kind in _DRIVEN:
            body = LineString(lane.centre.points).buffer(lane.width_m / 2.0, cap_style="flat")
            for polygon in getattr(body, "geoms", [body]):
                if not polygon.is_empty:
                    draw.polygon(pixels(np.array(polygon.exterior.coords)), fill=255)
    for junction in network.junctions.values():
        if len(junction.outline) >= 3:
            draw.polygon(pixels(junction.outline), fill=255)
    packed = io.BytesIO()
    image.save(packed, "PNG")
    return packed.getvalue()
