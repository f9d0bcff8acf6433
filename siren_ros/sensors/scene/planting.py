"""Places of buildings, trees and street lamps: along the roads, outside the space of traffic."""

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from siren_ros.numerics.arrays import Points
from siren_ros.sensors.meshes.mesh import Mesh
from siren_ros.sensors.scene.buildings import Lot, building
from siren_ros.sensors.scene.config import SceneConfig
from siren_ros.sensors.scene.free_space import FreeSpace, ring_samples
from siren_ros.sensors.scene.poles import street_lamp, turned
from siren_ros.sensors.scene.surfaces import Surfaces, union
from siren_ros.sensors.scene.vegetation import broadleaf, conifer


def street_lamps(surfaces: Surfaces, space: FreeSpace, config: SceneConfig) -> Mesh:
    """Lamps along the carriageway's edge, arms over the road."""
    edge = surfaces.keep_clear.buffer(0.55, quad_segs=4)
    places, tangents = ring_samples(edge, config.lamp_spacing_m)
    lamp = street_lamp(config.lamp_height_m)
    parts = []
    for (x, y), (tx, ty) in zip(places, tangents, strict=True):
        if _within(surfaces, x, y, 0.0) and space.place_disc(x, y, 0.2):
            # The road lies left of the ring's direction.
            parts.append(turned(lamp, x, y, 0.0, float(np.arctan2(tx, -ty))))
    return Mesh.concatenate(parts)


def street_trees(surfaces: Surfaces, space: FreeSpace, config: SceneConfig, rng: np.random.Generator) -> Mesh:
    """A row of trees along every road, with gaps, each crown wholly off the space of traffic."""
    parts: list[Mesh] = []
    row = surfaces.keep_clear.buffer(2.4, quad_segs=4)
    places, _ = ring_samples(row, config.tree_spacing_m)
    for x, y in places:
        radius = float(rng.uniform(1.4, 2.2))
        if rng.random() < 0.72 and _within(surfaces, x, y, 10.0) and space.place_disc(x, y, radius):
            parts.append(broadleaf(x, y, radius, rng))
    return Mesh.concatenate(parts)


def parkland(surfaces: Surfaces, space: FreeSpace, config: SceneConfig, rng: np.random.Generator) -> Mesh:
    """Trees on the grass between and behind the buildings."""
    west, south, east, north = surfaces.bounds_m
    margin = config.skyline_m
    count = int((east - west + 2 * margin) * (north - south + 2 * margin) / 900.0)
    points = rng.uniform((west - margin, south - margin), (east + margin, north + margin), (min(count, 900), 2))
    radii = rng.uniform(1.6, 3.2, len(points))
    clear = space.clear_of_traffic(points, 9.0)
    parts: list[Mesh] = []
    for (x, y), radius in zip(points[clear], radii[clear], strict=True):
        if len(parts) < 260 and space.place_disc(float(x), float(y), float(radius) + 0.3):
            make = conifer if rng.random() < 0.3 else broadleaf
            parts.append(make(float(x), float(y), float(radius), rng))
    return Mesh.concatenate(parts)


def street_buildings(surfaces: Surfaces, space: FreeSpace, config: SceneConfig, rng: np.random.Generator) -> Mesh:
    """A first row of buildings that faces the roads and a second, taller and plainer one behind it."""
    streets = union((surfaces.paved, surfaces.raised, surfaces.verge, surfaces.keep_clear))
    parts = []
    rows = ((config.building_setback_m, True), (config.building_setback_m + 26.0, False))
    for setback, detailed in rows:
        front = streets.buffer(setback, quad_segs=4)
        shapely.prepare(front)
        places, tangents = ring_samples(front.simplify(0.2), 2.0)
        parts.extend(_row(front, places, tangents, space, config, rng, surfaces, detailed=detailed))
    return Mesh.concatenate(parts)


def _row(
    front: BaseGeometry,
    places: Points,
    tangents: Points,
    space: FreeSpace,
    config: SceneConfig,
    rng: np.random.Generator,
    surfaces: Surfaces,
    *,
    detailed: bool,
) -> list[Mesh]:
    parts: list[Mesh] = []
    low, high = config.building_height_m
    position, skip_until = 0, 0
    while position < len(places):
        if position < skip_until:
            position += 1
            continue
        width = float(rng.uniform(11.0, 24.0))
        depth = float(rng.uniform(9.0, 15.0))
        height = float(low + (high - low) * rng.beta(1.4, 2.6 if detailed else 1.6))
        x, y = places[position]
        tx, ty = tangents[position]
        # The streets lie left of the ring's direction, the lot on the right.
        outward = float(np.arctan2(-tx, ty))
        lot = Lot(float(x + tx * width / 2), float(y + ty * width / 2), outward, width, depth, height)
        area = footprint(lot)
        if _within(surfaces, lot.x_m, lot.y_m, config.skyline_m) and _is_free(front, area) and space.is_clear(area):
            space.occupy(area.buffer(0.6))
            parts.append(building(lot, rng, detailed=detailed))
            skip_until = position + int((width + rng.uniform(0.5, 7.0)) / 2.0)
        position += 1
    return parts


def _is_free(front: BaseGeometry, area: Polygon) -> bool:
    """Whether a lot reaches over the building line by no more than a sliver, as on the outside of bends."""
    return not front.intersects(area) or front.intersection(area).area < 0.06 * area.area


def footprint(lot: Lot) -> Polygon:
    """The rectangle of a lot, eaves included."""
    c, s = np.cos(lot.heading_rad), np.sin(lot.heading_rad)
    half, eaves = lot.width_m / 2 + 0.4, 0.4
    corners = np.array([(-eaves, -half), (lot.depth_m + eaves, -half), (lot.depth_m + eaves, half), (-eaves, half)])
    return Polygon(corners @ np.array([[c, s], [-s, c]]) + (lot.x_m, lot.y_m))


def _within(surfaces: Surfaces, x_m: float, y_m: float, margin_m: float) -> bool:
    west, south, east, north = surfaces.bounds_m
    return west - margin_m <= x_m <= east + margin_m and south - margin_m <= y_m <= north + margin_m
