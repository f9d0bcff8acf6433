"""Buildings: rectangular houses with windows, shop fronts and flat or gabled roofs."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh
from siren_ros.sensors.meshes.primitives import Rgb, box

_WALL_RGB: Final = np.array(
    [(196, 178, 150), (168, 110, 86), (206, 200, 188), (150, 148, 144), (188, 150, 112), (214, 192, 140),
     (132, 96, 80), (176, 184, 186), (222, 214, 200), (156, 134, 116)]
)  # fmt: skip
_GLASS_RGB: Final[Rgb] = (66, 84, 98)
_CURTAIN_RGB: Final = np.array([(138, 134, 122), (148, 138, 116), (126, 122, 114), (142, 128, 110)])
"""Panes with curtains behind them; at night, rooms with a light on."""
_CURTAINED: Final = 0.4
_STOREY_M: Final = 3.2
_PROUD_M: Final = 0.03
"""Window panes stand this far in front of the wall."""


@dataclass(frozen=True)
class Lot:
    """A building's footprint: its front's middle, the direction from front to back, and its size."""

    x_m: float
    y_m: float
    heading_rad: float
    width_m: float
    depth_m: float
    height_m: float


def building(lot: Lot, rng: np.random.Generator, *, detailed: bool) -> Mesh:
    """A building on a lot; front at the street. ``detailed`` ones have windows in every storey and on both sides."""
    tone = np.clip(_WALL_RGB[rng.integers(len(_WALL_RGB))] + rng.integers(-10, 11, 3), 0, 255)
    colour: Rgb = (int(tone[0]), int(tone[1]), int(tone[2]))
    storeys = max(1, int(lot.height_m / _STOREY_M))
    gabled = lot.height_m < 10.5 and rng.random() < 0.6
    half, depth, height = lot.width_m / 2, lot.depth_m, lot.height_m
    parts = [box((0.0, -half, 0.0), (depth, half, height), Material.BUILDING_WALL, colour)]
    parts.extend(_gable(half, depth, height, rng) if gabled else _flat_roof(half, depth, height, colour, rng))
    ribbons, shop = storeys >= 4 and rng.random() < 0.4, storeys >= 2 and rng.random() < 0.55
    faces = [((0.0, half), (0.0, -half))]
    if detailed:
        faces += [((0.0, -half), (depth, -half)), ((depth, half), (0.0, half)), ((depth, -half), (depth, half))]
    rooms = np.random.Generator(np.random.PCG64([abs(int(8.0 * lot.x_m)), abs(int(8.0 * lot.y_m))]))
    for number, (start, end) in enumerate(faces):
        parts.append(_facade(start, end, storeys, height, rooms, ribbons=ribbons, shop=shop and number == 0))
    c, s = float(np.cos(lot.heading_rad)), float(np.sin(lot.heading_rad))
    turn = np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)])
    return Mesh.concatenate(parts).transformed(turn, (lot.x_m, lot.y_m, 0.0))


def _facade(
    start: tuple[float, float],
    end: tuple[float, float],
    storeys: int,
    height_m: float,
    rooms: np.random.Generator,
    *,
    ribbons: bool,
    shop: bool,
) -> Mesh:
    """Window panes along a wall from ``start`` to ``end`` as seen from outside, left to right."""
    a, b = np.array(start), np.array(end)
    length = float(np.linalg.norm(b - a))
    spans: list[tuple[float, float, float, float]] = []
    for storey in range(storeys):
        low = storey * (height_m / storeys)
        if storey == 0 and shop:
            count = max(2, round(length / 3.6))
            spans.extend((k * length / count + 0.25, (k + 1) * length / count - 0.25, 0.35, 2.75) for k in range(count))
        elif ribbons:
            spans.append((0.5, length - 0.5, low + 0.95, low + 2.45))
        else:
            count = max(1, round((length - 0.8) / 2.9))
            step = (length - 0.8) / count
            spans.extend(
                (0.4 + (k + 0.27) * step, 0.4 + (k + 0.73) * step, low + 0.95, low + 2.4) for k in range(count)
            )
    span = np.array(spans)
    along = (b - a) / length
    outward = np.array((along[1], -along[0])) * _PROUD_M
    return _panes(a + outward, along, span, rooms)


def _panes(
    origin: npt.NDArray[np.float64],
    along: npt.NDArray[np.float64],
    span: npt.NDArray[np.float64],
    rooms: np.random.Generator,
) -> Mesh:
    left, right, low, high = span.T
    corners = np.empty((len(span), 4, 3))
    for k, (s, z) in enumerate(((left, low), (right, low), (right, high), (left, high))):
        corners[:, k, :2] = origin + s[:, None] * along
        corners[:, k, 2] = z
    base = np.arange(len(span))[:, None] * 4
    triangles = np.concatenate((base + np.array((0, 1, 2)), base + np.array((0, 2, 3))))
    panes = Mesh.uniform(corners.reshape(-1, 3), triangles, Material.BUILDING_GLASS, _GLASS_RGB)
    curtained = rooms.random(len(span))[:, None] < _CURTAINED
    curtains = np.where(curtained, _CURTAIN_RGB[rooms.integers(len(_CURTAIN_RGB), size=len(span))], _GLASS_RGB)
    return replace(panes, colour_rgb=np.concatenate((curtains, curtains)).astype(np.uint8))


def _flat_roof(half_m: float, depth_m: float, height_m: float, wall: Rgb, rng: np.random.Generator) -> list[Mesh]:
    grey = int(rng.integers(92, 132))
    roof: Rgb = (grey, grey, grey + 4)
    low, high = (-0.15, -half_m - 0.15, height_m - 0.45), (depth_m + 0.15, half_m + 0.15, height_m)
    inner_low, inner_high = (0.1, -half_m + 0.1, height_m - 0.2), (depth_m - 0.1, half_m - 0.1, height_m + 0.04)
    parts = [
        box(low, high, Material.BUILDING_WALL, _darker(wall)),
        box(inner_low, inner_high, Material.BUILDING_ROOF, roof),
    ]
    if height_m > 11 and half_m > 4:
        y = float(rng.uniform(-half_m + 2.5, half_m - 2.5))
        x = float(rng.uniform(0.4, 0.7)) * depth_m
        parts.append(
            box((x - 1.6, y - 1.8, height_m), (x + 1.6, y + 1.8, height_m + 2.2), Material.BUILDING_ROOF, roof)
        )
    return parts


def _gable(half_m: float, depth_m: float, height_m: float, rng: np.random.Generator) -> list[Mesh]:
    """A saddle roof with its ridge along the street, eaves 0.4 m out."""
    eaves, rise = 0.4, depth_m * 0.28
    shade = int(rng.integers(-14, 15))
    colour: Rgb = (138 + shade, 74 + shade, 58 + shade)
    x0, x1, y0, y1 = -eaves, depth_m + eaves, -half_m - eaves, half_m + eaves
    ridge = (depth_m / 2, height_m + rise)
    points = [(x0, y0, height_m), (x1, y0, height_m), (x1, y1, height_m), (x0, y1, height_m),
              (ridge[0], y0, ridge[1]), (ridge[0], y1, ridge[1])]  # fmt: skip
    faces = [(0, 4, 5), (0, 5, 3), (1, 2, 5), (1, 5, 4), (0, 1, 4), (2, 3, 5), (0, 3, 2), (0, 2, 1)]
    return [Mesh.uniform(points, faces, Material.BUILDING_ROOF, colour)]


def _darker(colour: Rgb) -> Rgb:
    return (int(0.82 * colour[0]), int(0.82 * colour[1]), int(0.82 * colour[2]))
