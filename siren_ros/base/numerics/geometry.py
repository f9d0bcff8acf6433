"""Plane geometry: poses, vehicle footprints, and curves given by points and addressed by arc length."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.compiled import X, Y, compiled

_SAME_M: Final = 1e-6
"""Points nearer than this count as equal."""
_S, _LEFT = range(2)
"""Rows of projections."""


def wrap_angle(angle_rad: npt.ArrayLike) -> Floats:
    """Wrap angles to (−π, π]."""
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
    """Find the overlapping pairs among ``N`` oriented boxes: two rows (smaller first) and the depth in metres."""
    radius = 0.5 * np.hypot(length_m, width_m)
    apart = np.hypot(x_m[:, None] - x_m, y_m[:, None] - y_m)
    first, second = np.nonzero(np.triu(apart < radius[:, None] + radius, 1))
    corners = footprint_corners(x_m, y_m, yaw_rad, length_m, width_m)
    gap = separation_m(corners[first], corners[second])
    inside = gap < 0.0
    return first[inside], second[inside], -gap[inside]


@dataclass(frozen=True, eq=False)
class Polyline:
    """A curve through ``points`` (shape ``(K, 2)``, K ≥ 2, consecutive points distinct), in metres.

    Arc lengths outside ``[0, length_m]`` extend the first or last segment straight on.
    """

    points: Points
    arc_m: npt.NDArray[np.float64]
    """Arc length at each point, shape ``(K,)``, from 0."""

    @classmethod
    def through(cls, points: npt.ArrayLike) -> "Polyline":
        """Make the curve through points, without repeated ones; ValueError with fewer than two distinct points."""
        array = np.asarray(points, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 2:
            raise ValueError(f"points of shape (K, 2) are needed, not {array.shape}")
        array, arc = through_points(np.ascontiguousarray(array))
        if len(array) < 2:
            raise ValueError("a polyline needs two distinct points")
        return cls(points=array, arc_m=arc)

    @classmethod
    def joined(cls, parts: Sequence["Polyline"]) -> "Polyline":
        """Make one curve through all points of the parts, in order."""
        return cls.through(np.concatenate([part.points for part in parts]))

    @property
    def length_m(self) -> float:
        """Length of the whole curve."""
        return float(self.arc_m[-1])

    def _segment(self, s_m: npt.ArrayLike) -> npt.NDArray[np.intp]:
        return np.clip(np.searchsorted(self.arc_m, s_m, side="right") - 1, 0, len(self.points) - 2)

    def at(self, s_m: npt.ArrayLike) -> Points:
        """Points at arc lengths; the shape of ``s_m`` plus a last axis of 2."""
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
        """Points at arc lengths, shifted to the left by ``left_m``."""
        heading = self.heading_rad(s_m)
        normal = np.stack((-np.sin(heading), np.cos(heading)), axis=-1)
        return self.at(s_m) + np.asarray(left_m, dtype=np.float64)[..., None] * normal

    def project(self, points: npt.ArrayLike) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Project points (shape ``(..., 2)``) onto the curve: arc length, and offset positive to the left.

        Before the start and past the end the first and last segments are extended.
        """
        query = np.asarray(points, dtype=np.float64)
        places = np.empty((2, query.size // 2))
        _project(self.points, self.arc_m, query.reshape(-1, 2), places)
        s_m, left_m = places.reshape(2, *query.shape[:-1])
        return s_m, left_m

    def project_near(
        self, points: npt.ArrayLike, near_m: float, reach_m: float
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """``project`` limited to a part around an arc length, for curves that return to the same place."""
        first = max(int(np.searchsorted(self.arc_m, near_m - reach_m)) - 1, 0)
        first = min(first, len(self.points) - 2)
        last = max(int(np.searchsorted(self.arc_m, near_m + reach_m)) + 1, first + 2)
        return Polyline(self.points[first:last], self.arc_m[first:last]).project(points)

    def cut(self, from_m: float, to_m: float) -> "Polyline":
        """The part between two arc lengths (extended straight on where they lie outside)."""
        return Polyline.through(cut_points(self.points, self.arc_m, from_m, to_m))

    def resampled(self, spacing_m: float) -> "Polyline":
        """The same curve through equally spaced points, at most ``spacing_m`` apart; its ends stay."""
        return Polyline(*resampled_points(self.points, self.arc_m, spacing_m))


@compiled
def through_points(points: Points) -> tuple[Points, Floats]:
    """Points without repeated ones, and the arc length at each; the compiled part of ``Polyline.through``."""
    kept, arc_m = np.empty((len(points), 2)), np.zeros(len(points))
    count = 0
    for k in range(len(points)):
        if k > 0:
            dx, dy = points[k, X] - points[k - 1, X], points[k, Y] - points[k - 1, Y]
            if np.sqrt(dx * dx + dy * dy) <= _SAME_M:
                continue
        kept[count, X], kept[count, Y] = points[k, X], points[k, Y]
        if count > 0:
            dx, dy = kept[count, X] - kept[count - 1, X], kept[count, Y] - kept[count - 1, Y]
            arc_m[count] = arc_m[count - 1] + np.sqrt(dx * dx + dy * dy)
        count += 1
    return kept[:count].copy(), arc_m[:count].copy()


@compiled
def _point_at(points: Points, arc_m: Floats, s_m: float) -> tuple[float, float]:
    """``Polyline.at`` for one arc length."""
    i = min(max(int(np.searchsorted(arc_m, s_m, side="right")) - 1, 0), len(points) - 2)
    fraction = (s_m - arc_m[i]) / (arc_m[i + 1] - arc_m[i])
    x_m, y_m = points[i, X], points[i, Y]
    return x_m + fraction * (points[i + 1, X] - x_m), y_m + fraction * (points[i + 1, Y] - y_m)


@compiled
def cut_points(points: Points, arc_m: Floats, from_m: float, to_m: float) -> Points:
    """The points of ``Polyline.cut``."""
    kept = np.empty((len(points) + 2, 2))
    kept[0, X], kept[0, Y] = _point_at(points, arc_m, from_m)
    count = 1
    for k in range(len(points)):
        if from_m + _SAME_M < arc_m[k] < to_m - _SAME_M:
            kept[count, X], kept[count, Y] = points[k, X], points[k, Y]
            count += 1
    kept[count, X], kept[count, Y] = _point_at(points, arc_m, to_m)
    return kept[: count + 1]


@compiled
def resampled_points(points: Points, arc_m: Floats, spacing_m: float) -> tuple[Points, Floats]:
    """Points and arc lengths of ``Polyline.resampled``."""
    count = max(2, int(np.ceil(arc_m[-1] / spacing_m)) + 1)
    even, step_m = np.empty((count, 2)), arc_m[-1] / (count - 1)
    for k in range(count):
        even[k, X], even[k, Y] = _point_at(points, arc_m, arc_m[-1] if k == count - 1 else k * step_m)
    return through_points(even)


@compiled
def project_on(points: Points, arc_m: Floats, x_m: float, y_m: float) -> tuple[float, float]:
    """``Polyline.project`` for one point, for compiled loops."""
    last, least, s_m, left_m = len(points) - 2, np.inf, 0.0, 0.0
    for k in range(last + 1):
        dx, dy = points[k + 1, X] - points[k, X], points[k + 1, Y] - points[k, Y]
        from_x, from_y = x_m - points[k, X], y_m - points[k, Y]
        fraction = (from_x * dx + from_y * dy) / (dx * dx + dy * dy)
        fraction = max(fraction, 0.0) if k > 0 else fraction
        fraction = min(fraction, 1.0) if k < last else fraction
        miss_x, miss_y = from_x - fraction * dx, from_y - fraction * dy
        square = miss_x * miss_x + miss_y * miss_y
        if square < least:
            length = arc_m[k + 1] - arc_m[k]
            least, s_m = square, arc_m[k] + fraction * length
            left_m = (dx * miss_y - dy * miss_x) / length
    return s_m, left_m


@compiled
def _project(points: Points, arc_m: Floats, queries: Points, places: Floats) -> None:
    for n in range(len(queries)):
        places[_S, n], places[_LEFT, n] = project_on(points, arc_m, queries[n, X], queries[n, Y])
