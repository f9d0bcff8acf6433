"""Plane geometry: poses, vehicle footprints, and curves given by points and addressed by arc length."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats, Points
from siren_ros.numerics.compiled import compiled


def wrap_angle(angle_rad: npt.ArrayLike) -> Floats:
    """The same direction within (−π, π]."""
    wrapped = np.mod(np.asarray(angle_rad, dtype=np.float64) + np.pi, 2.0 * np.pi) - np.pi
    return np.where(wrapped == -np.pi, np.pi, wrapped)


def footprint_corners(x_m: Floats, y_m: Floats, yaw_rad: Floats, length_m: Floats, width_m: Floats) -> Floats:
    """Corners of oriented boxes, shape ``(N, 4, 2)``: front left, rear left, rear right, front right."""
    along = np.stack((np.cos(yaw_rad), np.sin(yaw_rad)), axis=-1)
    left = np.stack((-along[..., 1], along[..., 0]), axis=-1)
    half_along = along * (np.asarray(length_m) / 2.0)[..., None]
    half_left = left * (np.asarray(width_m) / 2.0)[..., None]
    centre = np.stack((x_m, y_m), axis=-1)
    corners = (half_along + half_left, half_left - half_along, -half_along - half_left, half_along - half_left)
    return np.stack([centre + corner for corner in corners], axis=-2)


def separation_m(corners_a: Floats, corners_b: Floats) -> Floats:
    """Largest gap along a separating axis between pairs of boxes, shape ``(N,)``; ≤ 0 where they overlap.

    Both inputs have shape ``(N, 4, 2)`` as ``footprint_corners`` gives them. For overlapping boxes the value is minus
    the penetration depth (separating axis theorem); for separate boxes it is a lower bound of their distance.
    """
    sides = [corners[:, (1, 3)] - corners[:, :1] for corners in (corners_a, corners_b)]
    axes = np.concatenate(sides, axis=1)
    axes = (axes / np.hypot(axes[..., 0], axes[..., 1])[..., None]).transpose(0, 2, 1)
    a, b = corners_a @ axes, corners_b @ axes
    gaps = np.maximum(b.min(axis=1) - a.max(axis=1), a.min(axis=1) - b.max(axis=1))
    return np.asarray(gaps.max(axis=1))


def overlapping_pairs(
    x_m: Floats, y_m: Floats, yaw_rad: Floats, length_m: Floats, width_m: Floats
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Floats]:
    """Which of ``N`` oriented boxes overlap: rows of both, the smaller first, and the depth of each pair in metres."""
    radius = 0.5 * np.hypot(length_m, width_m)
    apart = np.hypot(x_m[:, None] - x_m, y_m[:, None] - y_m)
    first, second = np.nonzero(np.triu(apart < radius[:, None] + radius, 1))
    corners = footprint_corners(x_m, y_m, yaw_rad, length_m, width_m)
    gap = separation_m(corners[first], corners[second])
    inside = gap < 0.0
    return first[inside], second[inside], -gap[inside]


def rotate(points: Floats, yaw_rad: float) -> Floats:
    """Points (shape ``(..., 2)``) turned counter-clockwise about the origin."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return points @ np.array([[cos, sin], [-sin, cos]])


@dataclass(frozen=True, eq=False)
class Polyline:
    """A curve through ``points`` (shape ``(K, 2)``, K ≥ 2, consecutive points distinct), in metres.

    Arc lengths outside ``[0, length_m]`` extend the first or last segment straight on.
    """

    points: Points
    arc_m: npt.NDArray[np.float64]
    """Arc length at each point, shape ``(K,)``, starting at 0."""

    @classmethod
    def through(cls, points: npt.ArrayLike) -> "Polyline":
        """The curve through points, repeated ones dropped; ValueError with fewer than two distinct points."""
        array = np.asarray(points, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 2:
            raise ValueError(f"points of shape (K, 2) are needed, not {array.shape}")
        steps = np.linalg.norm(np.diff(array, axis=0), axis=1)
        array = array[np.concatenate(([True], steps > 1e-6))]
        if len(array) < 2:
            raise ValueError("a polyline needs two distinct points")
        arc = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(array, axis=0), axis=1))))
        return cls(points=array, arc_m=arc)

    @classmethod
    def joined(cls, parts: Sequence["Polyline"]) -> "Polyline":
        """One curve through all points of the parts, in order."""
        return cls.through(np.concatenate([part.points for part in parts]))

    @property
    def length_m(self) -> float:
        """Length of the whole curve."""
        return float(self.arc_m[-1])

    def _segment(self, s_m: npt.ArrayLike) -> npt.NDArray[np.intp]:
        return np.clip(np.searchsorted(self.arc_m, s_m, side="right") - 1, 0, len(self.points) - 2)

    def at(self, s_m: npt.ArrayLike) -> Points:
        """Points at arc lengths; shape of ``s_m`` plus a last axis of 2."""
        s = np.asarray(s_m, dtype=np.float64)
        i = self._segment(s)
        start, arc = self.points[i], self.arc_m[i]
        fraction = (s - arc) / (self.arc_m[i + 1] - arc)
        return start + fraction[..., None] * (self.points[i + 1] - start)

    def heading_rad(self, s_m: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Direction of travel at arc lengths, counter-clockwise from the x axis."""
        i = self._segment(np.asarray(s_m, dtype=np.float64))
        delta = self.points[i + 1] - self.points[i]
        return np.arctan2(delta[..., 1], delta[..., 0])

    def offset_points(self, s_m: npt.ArrayLike, left_m: npt.ArrayLike) -> Points:
        """Points at arc lengths, moved sideways by ``left_m``."""
        heading = self.heading_rad(s_m)
        normal = np.stack((-np.sin(heading), np.cos(heading)), axis=-1)
        return self.at(s_m) + np.asarray(left_m, dtype=np.float64)[..., None] * normal

    def project(self, points: npt.ArrayLike) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Nearest place on the curve of each point (shape ``(..., 2)``): arc length and offset, left positive.

        Before the start and past the end the first and last segments are extended.
        """
        query = np.asarray(points, dtype=np.float64)
        arc, left = _projected(query.reshape(-1, 2), self.points, self.arc_m)
        return arc.reshape(query.shape[:-1])[()], left.reshape(query.shape[:-1])[()]

    def cut(self, from_m: float, to_m: float) -> "Polyline":
        """The part between two arc lengths (extended straight on where they lie outside)."""
        inside = (self.arc_m > from_m + 1e-6) & (self.arc_m < to_m - 1e-6)
        return Polyline.through(np.concatenate((self.at([from_m]), self.points[inside], self.at([to_m]))))

    def resampled(self, spacing_m: float) -> "Polyline":
        """The same curve through equally spaced points, at most ``spacing_m`` apart, ends kept."""
        count = max(2, int(np.ceil(self.length_m / spacing_m)) + 1)
        return Polyline.through(self.at(np.linspace(0.0, self.length_m, count)))


@compiled
def _projected(queries: Points, points: Points, arc_m: Floats) -> tuple[Floats, Floats]:
    """``Polyline.project`` of points, shape ``(M, 2)``; of places at equal distances the first."""
    arcs, lefts = np.empty(len(queries)), np.empty(len(queries))
    last = len(points) - 2
    for row in range(len(queries)):
        least = np.inf
        for segment in range(last + 1):
            dx, dy = points[segment + 1, 0] - points[segment, 0], points[segment + 1, 1] - points[segment, 1]
            x, y = queries[row, 0] - points[segment, 0], queries[row, 1] - points[segment, 1]
            fraction = (x * dx + y * dy) / (dx * dx + dy * dy)
            if segment > 0:
                fraction = max(fraction, 0.0)
            if segment < last:
                fraction = min(fraction, 1.0)
            x, y = x - fraction * dx, y - fraction * dy
            away = x * x + y * y
            if away < least:
                least = away
                length = arc_m[segment + 1] - arc_m[segment]
                arcs[row] = arc_m[segment] + fraction * length
                lefts[row] = (dx * y - dy * x) / length
    return arcs, lefts
