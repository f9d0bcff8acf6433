"""Free places for objects: outside the space of traffic, and not inside one another."""

from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from siren_ros.numerics.arrays import Points
from siren_ros.sensors.scene.surfaces import Surfaces

_CELL_M: Final = 20.0


class FreeSpace:
    """The plane without the space of traffic and without the objects placed so far."""

    def __init__(self, surfaces: Surfaces) -> None:
        self.keep_clear = surfaces.keep_clear
        shapely.prepare(self.keep_clear)
        self._placed: dict[tuple[int, int], list[BaseGeometry]] = {}

    def is_clear(self, area: BaseGeometry) -> bool:
        """Whether an area touches neither traffic's space nor anything placed."""
        near = (other for cell in _cells(area) for other in self._placed.get(cell, ()))
        return not any(other.intersects(area) for other in near) and not self.keep_clear.intersects(area)

    def clear_of_traffic(self, points: Points, radius_m: float) -> npt.NDArray[np.bool_]:
        """For each point ``(N, 2)`` whether a disc around it lies outside traffic's space."""
        return ~np.asarray(shapely.dwithin(self.keep_clear, shapely.points(points), radius_m), dtype=np.bool_)

    def occupy(self, area: BaseGeometry) -> None:
        """Marks an area as taken."""
        for cell in _cells(area):
            self._placed.setdefault(cell, []).append(area)

    def place_disc(self, x_m: float, y_m: float, radius_m: float) -> bool:
        """Takes a disc where it is clear; says whether it was."""
        disc = Point(x_m, y_m).buffer(radius_m, quad_segs=4)
        if not self.is_clear(disc):
            return False
        self.occupy(disc)
        return True

    def first_clear(self, candidates: Points, radius_m: float) -> tuple[float, float] | None:
        """The first of some points ``(N, 2)`` around which a disc is clear; the disc is taken."""
        for x, y in candidates[self.clear_of_traffic(candidates, radius_m)]:
            if self.place_disc(float(x), float(y), radius_m):
                return float(x), float(y)
        return None


def _cells(area: BaseGeometry) -> list[tuple[int, int]]:
    """Cells of a square grid that an area's bounds touch."""
    west, south, east, north = (int(value // _CELL_M) for value in area.bounds)
    return [(i, j) for i in range(west, east + 1) for j in range(south, north + 1)]


def ring_samples(area: BaseGeometry, spacing_m: float) -> tuple[Points, Points]:
    """Points along an area's boundary and the unit tangents there, the area on the left; each of shape ``(N, 2)``."""
    places: list[Points] = []
    tangents: list[Points] = []
    for part in shapely.get_parts(area):
        oriented = shapely.geometry.polygon.orient(Polygon(part))
        for ring in (oriented.exterior, *oriented.interiors):
            count = int(ring.length // spacing_m)
            if count == 0:
                continue
            s = np.arange(count) * (ring.length / count)
            here = shapely.get_coordinates(shapely.line_interpolate_point(ring, s))
            ahead = shapely.get_coordinates(shapely.line_interpolate_point(ring, (s + 0.2) % ring.length))
            step = ahead - here
            places.append(here)
            tangents.append(step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9))
    if not places:
        return np.empty((0, 2)), np.empty((0, 2))
    return np.concatenate(places), np.concatenate(tangents)
