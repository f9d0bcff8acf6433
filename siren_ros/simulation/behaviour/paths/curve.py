"""A smooth curve through equally spaced points, with heading and curvature at every point."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Points, Rows
from siren_ros.base.numerics.compiled import X, Y, compiled
from siren_ros.base.numerics.geometry import Polyline

# These are no parameters: compiled loops contain the resolution of curves as constants.
SPACING_M: Final = 1.0
"""Distance between the points of a curve."""
SMOOTHING_M: Final = 1.5
"""Standard deviation of the Gaussian that smooths the corners of lane centre lines."""
_NEAREST_ITERATIONS: Final = 3


class Curve(NamedTuple):
    """Points of shape ``(K, 2)`` at a uniform ``spacing_m``; arrays of shape ``(K,)`` have a value per point.

    Compiled loops take a curve as it is.
    """

    points: npt.NDArray[np.float64]
    spacing_m: float
    heading_rad: Floats
    """Heading without jumps of 2π, so that it can be interpolated."""
    curvature_1pm: Floats
    """Curvature, positive in left turns."""

    @classmethod
    def through(cls, points: npt.NDArray[np.float64], smoothing_m: float = 0.0) -> "Curve":
        """Make the curve through points (shape ``(N, 2)``), resampled and smoothed; both ends stay.

        Raises:
            ValueError: fewer than two distinct points.
        """
        even = Polyline.through(points).resampled(SPACING_M).points
        if smoothing_m > 0.0 and len(even) > 3:
            even = Polyline.through(_smoothed(even, smoothing_m)).resampled(SPACING_M).points
        return cls(even, *_shape_of(even))

    @property
    def length_m(self) -> float:
        """Length of the whole curve."""
        return self.spacing_m * (len(self.points) - 1)

    def place(self, s_m: float) -> tuple[float, float, float, float]:
        """``(x, y, heading, curvature)`` at an arc length; straight on before the start and after the end."""
        return curve_place(self.points, self.heading_rad, self.curvature_1pm, self.spacing_m, s_m)

    def at(self, s_m: Floats) -> npt.NDArray[np.float64]:
        """Points at arc lengths, shape ``(..., 2)``; straight on before the start and after the end."""
        place = s_m / self.spacing_m
        i = np.clip(place.astype(np.intp), 0, len(self.points) - 2)
        start = self.points[i]
        return start + (place - i)[..., None] * (self.points[i + 1] - start)

    def heading_at(self, s_m: Floats) -> Floats:
        """Headings at arc lengths, without jumps of 2π."""
        return np.interp(s_m, self.spacing_m * np.arange(len(self.points)), self.heading_rad)

    def offset_at(self, s_m: Floats, left_m: Floats) -> npt.NDArray[np.float64]:
        """Points at arc lengths moved sideways, left positive; shape ``(..., 2)``."""
        heading = self.heading_at(s_m)
        return self.at(s_m) + left_m[..., None] * np.stack((-np.sin(heading), np.cos(heading)), axis=-1)

    def project(
        self, x_m: Floats, y_m: Floats, first: int = 0, last: int | None = None
    ) -> tuple[Floats, Floats, npt.NDArray[np.intp]]:
        """Nearest place for each point: arc length, offset (positive to the left), index of the nearest curve point.

        Only curve points ``first`` to ``last`` (excluded) are looked at; beyond them the curve goes straight on.
        """
        s, left, nearest = np.empty(len(x_m)), np.empty(len(x_m)), np.empty(len(x_m), np.intp)
        end = len(self.points) if last is None else min(last, len(self.points))
        _project(self, x_m, y_m, first, end, s, left, nearest)
        return s, left, nearest

    def project_one(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Nearest place of one point on the whole curve: arc length and offset, left positive."""
        delta = self.points - (x_m, y_m)
        nearest = int(np.argmin(np.einsum("kj,kj->k", delta, delta)))
        return self.nearest_to(nearest * self.spacing_m, x_m, y_m)

    def nearest_to(self, guess_m: float, x_m: float, y_m: float) -> tuple[float, float]:
        """Arc length and offset (positive to the left) of the place nearest to a point, searched from a guess."""
        return _nearest(self.points, self.heading_rad, self.curvature_1pm, self.spacing_m, guess_m, x_m, y_m)


def _smoothed(points: npt.NDArray[np.float64], sigma_m: float) -> npt.NDArray[np.float64]:
    radius = min(int(np.ceil(3.0 * sigma_m / SPACING_M)), len(points) - 1)
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) * SPACING_M / sigma_m) ** 2)
    taps /= taps.sum()
    padded = _reflected(points, radius)
    return np.stack([np.convolve(padded[axis], taps, mode="valid") for axis in (0, 1)], axis=-1)


@compiled
def _reflected(points: Points, radius: int) -> Floats:
    """X and y of the points, shape ``(2, K)``, extended at both ends by mirrored points."""
    n = len(points)
    padded = np.empty((2, n + 2 * radius))
    for axis in range(2):
        for k in range(n):
            padded[axis, radius + k] = points[k, axis]
        for k in range(1, radius + 1):
            padded[axis, radius - k] = 2.0 * points[0, axis] - points[k, axis]
            padded[axis, radius + n - 1 + k] = 2.0 * points[n - 1, axis] - points[n - 1 - k, axis]
    return padded


@compiled
def _shape_of(points: Points) -> tuple[float, Floats, Floats]:
    """Spacing of evenly spaced points, heading and curvature at each."""
    n, length = len(points), 0.0
    heading, curvature, before = np.empty(n), np.empty(n), 0.0
    for k in range(n):
        if k > 0:
            dx, dy = points[k, X] - points[k - 1, X], points[k, Y] - points[k - 1, Y]
            length += np.sqrt(dx * dx + dy * dy)
        first, last = max(k - 1, 0), min(k + 1, n - 1)
        heading[k] = np.arctan2(points[last, Y] - points[first, Y], points[last, X] - points[first, X])
    spacing, turns, before = length / (n - 1), 0.0, heading[0]
    for k in range(1, n):  # removes jumps by a full turn
        change = heading[k] - before
        before = heading[k]
        if abs(change) >= np.pi:
            within = (change + np.pi) % (2.0 * np.pi) - np.pi
            turns += (np.pi if within == -np.pi and change > 0.0 else within) - change
        heading[k] += turns
    for k in range(n):
        first, last = max(k - 1, 0), min(k + 1, n - 1)
        curvature[k] = (heading[last] - heading[first]) / ((last - first) * spacing)
    return spacing, heading, curvature


@compiled
def curve_place(
    points: Points, heading_rad: Floats, curvature_1pm: Floats, spacing_m: float, s_m: float
) -> tuple[float, float, float, float]:
    """``Curve.place`` for compiled loops."""
    place = s_m / spacing_m
    i = min(max(int(place), 0), points.shape[0] - 2)
    fraction = place - i
    inside = min(max(fraction, 0.0), 1.0)
    heading = heading_rad[i] + inside * (heading_rad[i + 1] - heading_rad[i])
    curvature = curvature_1pm[i] + inside * (curvature_1pm[i + 1] - curvature_1pm[i]) if inside == fraction else 0.0
    x = points[i, X] + fraction * (points[i + 1, X] - points[i, X])
    return x, points[i, Y] + fraction * (points[i + 1, Y] - points[i, Y]), heading, curvature


@compiled
def _nearest(
    points: Points, heading_rad: Floats, curvature_1pm: Floats, spacing_m: float, guess_m: float, x_m: float, y_m: float
) -> tuple[float, float]:
    """Arc length and offset of the place nearest to a point, searched from a guess."""
    s, left = guess_m, 0.0
    for _ in range(_NEAREST_ITERATIONS):
        px, py, heading, curvature = curve_place(points, heading_rad, curvature_1pm, spacing_m, s)
        cos, sin = np.cos(heading), np.sin(heading)
        left = cos * (y_m - py) - sin * (x_m - px)
        s += (cos * (x_m - px) + sin * (y_m - py)) / max(1.0 - curvature * left, 0.2)
    return s, left


@compiled
def nearest_point(curve: Curve, x_m: float, y_m: float, first: int, end: int) -> tuple[float, float, int]:
    """``Curve.project`` of one place for compiled loops."""
    points = curve.points
    best, best_square = first, np.inf
    for k in range(first, end):
        dx, dy = x_m - points[k, X], y_m - points[k, Y]
        square = dx * dx + dy * dy
        if square < best_square:
            best, best_square = k, square
    dx, dy = x_m - points[best, X], y_m - points[best, Y]
    cos, sin = np.cos(curve.heading_rad[best]), np.sin(curve.heading_rad[best])
    left = cos * dy - sin * dx
    along = (cos * dx + sin * dy) / max(1.0 - curve.curvature_1pm[best] * left, 0.2)
    return best * curve.spacing_m + along, left, best


@compiled
def _project(
    curve: Curve, xs_m: Floats, ys_m: Floats, first: int, end: int, s_m: Floats, left_m: Floats, nearest: Rows
) -> None:
    """Compute arc length, offset and nearest curve point of each place."""
    for n in range(nearest.shape[0]):
        s_m[n], left_m[n], nearest[n] = nearest_point(curve, xs_m[n], ys_m[n], first, end)
