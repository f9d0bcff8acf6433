"""Computes the light that static surfaces reflect under a look, and the constants that all shaders share.

The sun does not move, so reflected light is computed once and shaders only add it up. Constants stand in the shaders'
text, because a software rasteriser would load each uniform anew for every few pixels.
"""

from collections.abc import Iterable
from enum import IntEnum
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import Material


class Shading(IntEnum):
    """The shader programs of the static scene."""

    GLASS = 0
    """Windows; like DETAIL not drawn where they are smaller than a pixel or two."""
    DETAIL = 1
    """Poles, lamps, signs, trunks."""
    PLAIN = 2
    WALL_SUNNY = 3
    WALL_SHADY = 4
    """Walls that face away from the sun: nothing can shade them."""
    FOLIAGE = 5
    PAVING = 6
    GROUND = 7
    BEDROCK = 8
    """The plane below everything; it shows only through cracks between surfaces."""


STATIC_VERTEX: Final = np.dtype([("position", "<f4", 3), ("sun", "<f2", 4), ("shade", "<f2", 4), ("normal", "<f2", 4)])
"""Record of a static triangle's last vertex, 36 bytes: it holds the values of the whole triangle.

``sun``: reflected sunlight; w: grain (ground; above 1 where water soaks away), 1 for bricks (walls), sun on the crown
(foliage).
``shade``: reflected light of sky and ground, and what shines by itself; w: semantic class / 255.
``normal``; w: gloss, or how worn a road marking is.
"""
STATIC_FORMAT: Final = "3f 4f2 4f2 4f2"
STATIC_NAMES: Final = ("in_position", "in_sun", "in_shade", "in_normal")
GROUND_AMBIENT: Final = (0.20, 0.19, 0.17)
"""Light that the ground reflects upwards, as a share of the ambient strength."""

_DETAIL: Final = (
    Material.METAL_POLE,
    Material.SIGNAL_HOUSING,
    Material.SIGNAL_RED,
    Material.SIGNAL_YELLOW,
    Material.SIGNAL_GREEN,
    Material.STOP_SIGN,
    Material.STREET_LAMP,
    Material.TREE_TRUNK,
    Material.FENCE,
)
_ROAD: Final = (Material.ASPHALT, Material.SHOULDER_ASPHALT)
_GREEN: Final = (Material.GROUND, Material.GRASS, Material.MEDIAN)
_MARKING: Final = (Material.MARKING_WHITE, Material.MARKING_YELLOW)
_GROUND: Final = (*_ROAD, *_GREEN, *_MARKING, Material.KERB)
_LENS: Final = (Material.SIGNAL_RED, Material.SIGNAL_YELLOW, Material.SIGNAL_GREEN)
_GREEN_BASE: Final = 0.72
_OPEN_SKY: Final = 0.72
"""Share of the ambient light that reaches shaded ground, where an object hides part of the sky."""
_WET_ROAD: Final = 0.55
"""Albedo of soaked asphalt relative to dry (0.05 against 0.09: Oke, Boundary Layer Climates, table 1.1, rounded)."""
_LAMPS_ASIDE: Final = 0.55
"""Share of a lamp's light on the ground that also reaches walls beside it."""
_CROWN_AT_NIGHT: Final = 0.45
_LUMINAIRE: Final = (6.0, 4.8, 3.0)
_ROOM_COLOUR: Final = (1.0, 0.72, 0.40)
_ROOM_GLOW: Final = 2.2
"""Factor on the brightness of lit rooms: curtains let less light out than bare glass, and it is warmer."""


def _table(default: float, *entries: tuple[tuple[Material, ...], float]) -> Floats:
    table = np.full(len(Material), default)
    for materials, value in entries:
        table[[int(material) for material in materials]] = value
    return table


_SHADING: Final = _table(
    Shading.PLAIN,
    (_DETAIL, Shading.DETAIL),
    (_GROUND, Shading.GROUND),
    ((Material.GROUND,), Shading.BEDROCK),
    ((Material.SIDEWALK,), Shading.PAVING),
    ((Material.BUILDING_GLASS,), Shading.GLASS),
    ((Material.BUILDING_WALL,), Shading.WALL_SUNNY),
    ((Material.FOLIAGE,), Shading.FOLIAGE),
)
_GRAIN: Final = _table(0.3, (_ROAD, 0.42), (_GREEN, 1.1 / _GREEN_BASE), (_MARKING, 0.35))
_BASE: Final = _table(1.0, (_GREEN, _GREEN_BASE), (_LENS, 0.10))
_WETTED: Final = _table(0.0, ((*_ROAD, *_MARKING, Material.KERB, Material.SIDEWALK), 1.0))


def shading_of(material: npt.NDArray[np.uint8], normals: Floats32, look: Look) -> npt.NDArray[np.int64]:
    """Program of each triangle, shape ``(T,)``; normals have shape ``(T, 3)``."""
    shading = _SHADING[material].astype(np.int64)
    shady = (shading == Shading.WALL_SUNNY) & (_towards_sun(normals, look) <= 0.0) & (not look.lamps_lit)
    shading[shady] = Shading.WALL_SHADY
    return shading


def _towards_sun(normals: npt.NDArray[np.floating[Any]], look: Look) -> Floats:
    x, y, z = (float(value) for value in look.towards_sun)
    n = normals.astype(np.float64)
    return n[:, 0] * x + n[:, 1] * y + n[:, 2] * z


def ambient_light(normals: npt.NDArray[np.floating[Any]], look: Look) -> Floats:
    """Light of sky and ground on surfaces of these normals, linear RGB, shape ``(N, 3)``."""
    sky = 0.525 * (np.array(look.zenith_colour) + np.array(look.horizon_colour))
    up = normals[:, 2:3].astype(np.float64) * 0.5 + 0.5
    return look.ambient * (np.array(GROUND_AMBIENT) * (1.0 - up) + sky * up)


def _full_light(look: Look) -> Floats:
    """Light on a surface that faces its source: the sun, or at night the maximum of the lamps' texture."""
    return np.ones(3) if look.lamps_lit else np.array(look.sun_colour)


def _direct(normals: Floats32, look: Look) -> Floats:
    """Direct light of the sun or of lamps on surfaces with these normals, shape ``(N, 3)``."""
    if look.lamps_lit:
        facing = _LAMPS_ASIDE + (1.0 - _LAMPS_ASIDE) * normals[:, 2].astype(np.float64)
    else:
        facing = np.maximum(_towards_sun(normals, look), 0.0)
    return np.asarray(facing[:, None] * _full_light(look))


def _night_glow(material: npt.NDArray[np.uint8], colour: Floats, look: Look) -> Floats:
    """Light that street lamps and lit windows emit, shape ``(N, 3)``."""
    glow = np.zeros_like(colour)
    if look.lamps_lit:
        glow[material == Material.STREET_LAMP] = _LUMINAIRE
        rooms = (material == Material.BUILDING_GLASS) & (colour[:, 0] > colour[:, 2])
        glow[rooms] = _ROOM_GLOW * colour[rooms] * np.array(_ROOM_COLOUR)
    return glow


def static_vertices(vertices: npt.NDArray[np.void], look: Look, *, lit: bool = False) -> npt.NDArray[np.void]:
    """Vertices (``vertices.VERTEX``) with their light (``STATIC_VERTEX``); ``lit``: lenses of lamps that are on."""
    material = vertices["normal_material"][:, 3].astype(np.uint8)
    normals = vertices["normal_material"][:, :3].astype(np.float32)
    colour = (vertices["colour"][:, :3].astype(np.float64) / 255.0) ** 2
    emission = colour * 2.6 + 0.10 if lit else _night_glow(material, colour, look)
    albedo = colour * (1.0 if lit else _BASE[material][:, None])
    albedo *= 1.0 - (1.0 - _WET_ROAD) * look.wetness * _WETTED[material][:, None]
    shading = _SHADING[material]
    sun = _direct(normals, look)
    sky = ambient_light(normals, look)
    ground = np.isin(shading, (Shading.GROUND, Shading.PAVING, Shading.BEDROCK))[:, None]
    foliage = shading == Shading.FOLIAGE
    out = np.zeros(len(vertices), STATIC_VERTEX)
    out["position"] = vertices["position"]
    out["shade"][:, :3] = albedo * sky * np.where(ground, _OPEN_SKY, 1.0) + emission
    direct = np.where(foliage[:, None], _full_light(look), sun)
    out["sun"][:, :3] = albedo * (direct + np.where(ground, 1.0 - _OPEN_SKY, 0.0) * sky)
    crown = np.full(len(normals), _CROWN_AT_NIGHT) if look.lamps_lit else 0.75 * _towards_sun(normals, look) + 0.25
    bricks = colour[:, 0] > 1.3 * colour[:, 2]
    wall = shading == Shading.WALL_SUNNY
    out["sun"][:, 3] = np.where(ground[:, 0], _GRAIN[material], np.where(foliage, crown, wall & bricks))
    out["shade"][:, 3] = vertices["colour"][:, 3] / 255.0
    out["normal"][:, :3] = normals
    worn = np.isin(material, [int(kind) for kind in _MARKING])
    gloss = np.where(material == Material.BUILDING_GLASS, 0.55, np.where(worn, 0.5, 0.0))
    out["normal"][:, 3] = gloss
    return out


LIGHT_HALF_M: Final = 120.0
"""Half the side of the square with shadows or lamps. Outside it everything is in the sun by day, in the dark at
night."""
LIGHT_TEXELS: Final = 2048
LIGHT_GRID_M: Final = 40.0
"""The square moves in steps of this length, a multiple of the noise's period."""
_NOISE_PER_M: Final = 0.3
_FOG_HAZE_PER_M: Final = 0.004
"""With more haze than this, interpolation over a triangle is too coarse, so that haze is computed per pixel."""
_MIRRORED_GROUND: Final = (0.168, 0.163, 0.158)
"""Light of streets and houses that mirroring surfaces reflect, as a share of the ambient strength."""
_VERSION: Final = "#version 330 core\n"


def preamble(look: Look) -> str:
    """GLSL text with the preprocessor names and constants of a look."""
    names = (
        *(("FOG",) if look.haze_per_m > _FOG_HAZE_PER_M else ()),
        *(("WET",) if look.wetness > 0.0 else ()),
        *(("NIGHT",) if look.lamps_lit else ()),
    )
    vectors = {
        "towards_sun": tuple(float(value) for value in look.towards_sun),
        "sun_colour": look.direct_colour,
        "zenith_colour": look.zenith_colour,
        "horizon_colour": look.horizon_colour,
        "GROUND_AMBIENT": GROUND_AMBIENT,
        "MIRRORED_GROUND": tuple(look.ambient * value for value in _MIRRORED_GROUND),
    }
    scalars = {
        "AMBIENT": look.ambient,
        "HAZE_PER_M": look.haze_per_m,
        "CLOUD_COVER": look.cloud_cover,
        "WETNESS": look.wetness,
        "NOISE_PER_LIGHT": 2.0 * LIGHT_HALF_M * _NOISE_PER_M,
    }
    return "".join(
        (
            *_defines(names),
            *(
                f"const vec3 {name} = vec3({', '.join(f'{v:.8f}' for v in value)});\n"
                for name, value in vectors.items()
            ),
            *(f"const float {name} = {value:.8f};\n" for name, value in scalars.items()),
        )
    )


def defined(source: str, constants: str, *names: str) -> str:
    """A shader's source with the constants of a look and further preprocessor names."""
    return source.replace(_VERSION, _VERSION + "".join(_defines(names)) + constants, 1)


def _defines(names: Iterable[str]) -> list[str]:
    return [f"#define {name}\n" for name in names]
