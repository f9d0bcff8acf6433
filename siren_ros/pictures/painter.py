"""Shapes with smooth edges: drawn larger and then reduced, because Pillow draws without antialiasing."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from siren_ros.numerics.arrays import Points

Colour = tuple[int, ...]
"""Red, green, blue and, where it has one, opacity, 0 to 255 each."""
_OVERSAMPLING: Final = 4


def rgb_of(colour: str | Sequence[float]) -> Colour:
    """``#rrggbb`` or components from 0 to 1 as components from 0 to 255."""
    if isinstance(colour, str):
        return tuple(int(colour[start : start + 2], 16) for start in (1, 3, 5))
    return tuple(round(255 * component) for component in colour)


def font(size_px: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The typeface of matplotlib, so that pictures are the same on every machine."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / name), size_px)


def paint_polygons(picture: Image.Image, shapes: Sequence[tuple[Points, Colour]]) -> None:
    """Fills polygons with smooth edges, later ones over earlier ones.

    Args:
        picture: RGB; is changed.
        shapes: Corners in pixels, shape ``(K, 2)``, each with its colour. Shapes of one call should lie close together.
    """
    corners = np.concatenate([points for points, _ in shapes])
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, picture.size)
    if (high <= low).any():
        return
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    box = (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
    patch = picture.crop(box).resize((size[0] * _OVERSAMPLING, size[1] * _OVERSAMPLING), Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(patch, "RGBA")
    for points, colour in shapes:
        draw.polygon([(float(x), float(y)) for x, y in (points - low) * _OVERSAMPLING], fill=colour)
    picture.paste(patch.resize(size, Image.Resampling.BOX), box[:2])


def ribbon(points: Points, width_px: float) -> Points:
    """Outline of a line of some width through points, shape ``(2K, 2)``."""
    along = np.gradient(points, axis=0)
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    normal = np.stack((-along[:, 1], along[:, 0]), axis=-1) * width_px / 2.0
    return np.concatenate((points + normal, (points - normal)[::-1]))
