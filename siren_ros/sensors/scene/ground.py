"""The ground's triangles: every region at its height, kerbs between them, no gaps and no overlaps."""

import itertools
from typing import Final

import numpy as np
import shapely
from shapely.geometry import box as rectangle
from shapely.geometry.base import BaseGeometry

from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh
from siren_ros.sensors.meshes.primitives import Rgb, flat_polygons, walls
from siren_ros.sensors.scene.config import SceneConfig
from siren_ros.sensors.scene.markings import Markings
from siren_ros.sensors.scene.surfaces import Surfaces, difference, intersection, polygons, union

ASPHALT_RGB: Final[Rgb] = (74, 75, 78)
SHOULDER_RGB: Final[Rgb] = (92, 92, 93)
WHITE_RGB: Final[Rgb] = (226, 226, 222)
YELLOW_RGB: Final[Rgb] = (222, 176, 44)
KERB_RGB: Final[Rgb] = (158, 156, 150)
SIDEWALK_RGB: Final[Rgb] = (146, 142, 136)
MEDIAN_RGB: Final[Rgb] = (98, 124, 62)
VERGE_RGB: Final[Rgb] = (132, 118, 94)
GRASS_RGB: Final[Rgb] = (92, 122, 58)
_BEDROCK_DEPTH_M: Final = 0.05
"""A plane below everything catches rays that slip between two surfaces."""


def ground_mesh(surfaces: Surfaces, markings: Markings, config: SceneConfig) -> Mesh:
    """Carriageway with markings cut in at z 0, sidewalks and medians a kerb's height above it, grass around."""
    west, south, east, north = surfaces.bounds_m
    margin = config.ground_margin_m
    land = rectangle(west - margin, south - margin, east + margin, north + margin)
    painted = union((markings.white, markings.yellow))
    paved, raised = surfaces.paved, intersection(surfaces.raised, land)
    kerb = intersection(raised, paved.buffer(config.kerb_width_m))
    grass = difference(land, union((paved, raised, surfaces.verge)))
    top = config.kerb_height_m
    flat: tuple[tuple[BaseGeometry, float, Material, Rgb], ...] = (
        (difference(surfaces.carriageway, painted), 0.0, Material.ASPHALT, ASPHALT_RGB),
        (difference(surfaces.shoulder, painted), 0.0, Material.SHOULDER_ASPHALT, SHOULDER_RGB),
        (markings.white, 0.0, Material.MARKING_WHITE, WHITE_RGB),
        (markings.yellow, 0.0, Material.MARKING_YELLOW, YELLOW_RGB),
        (kerb, top, Material.KERB, KERB_RGB),
        (difference(intersection(surfaces.sidewalk, land), kerb), top, Material.SIDEWALK, SIDEWALK_RGB),
        (difference(intersection(surfaces.median, land), kerb), top, Material.MEDIAN, MEDIAN_RGB),
        (surfaces.verge, 0.0, Material.GROUND, VERGE_RGB),
        (grass, 0.0, Material.GRASS, GRASS_RGB),
    )
    parts = [_tiled(area, z, material, colour, config.tile_m) for area, z, material, colour in flat]
    parts.extend(walls(part, 0.0, top, Material.KERB, KERB_RGB) for part in polygons(raised))
    parts.append(flat_polygons([land], -_BEDROCK_DEPTH_M, Material.GROUND, VERGE_RGB))
    return Mesh.concatenate(parts)


def _tiled(area: BaseGeometry, z_m: float, material: Material, colour: Rgb, tile_m: float) -> Mesh:
    tiles = [tile for part in polygons(area) for tile in _cut(part, tile_m)]
    return flat_polygons(tiles, z_m, material, colour)


def _cut(area: BaseGeometry, tile_m: float) -> list[shapely.Polygon]:
    """Pieces of an area along the lines of a square grid."""
    columns = [area]
    for axis in (0, 1):
        pieces: list[shapely.Polygon] = []
        for piece in columns:
            low, high = piece.bounds[axis], piece.bounds[axis + 2]
            lines = np.arange(np.floor(low / tile_m), np.ceil(high / tile_m) + 1) * tile_m
            if len(lines) <= 2:
                pieces.append(piece)
                continue
            for start, end in itertools.pairwise(lines):
                limits = (start, -1e6, end, 1e6) if axis == 0 else (-1e6, start, 1e6, end)
                pieces.extend(polygons(shapely.clip_by_rect(piece, *limits)))
        columns = pieces
    return columns
