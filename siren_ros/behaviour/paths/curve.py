"""A smooth curve through equally spaced points, with heading and curvature at every point."""

from dataclasses import dataclass
from math import cos as cos_of
from math import sin as sin_of
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.compiled import compiled
from siren_ros.numerics.polyline import Polyline

SPACING_M: Final = 1.0
"""Distance between the points of a curve."""
SMOOTHING_M: Final = 1.5
"""Standard deviation of the Gaussian that rounds the corners of lane centre lines."""
_NEAREST_ITERATIONS: Final = 3


@dataclass(frozen=True, eq=False)
class Curve:
    """Points of shape ``(K, 2)`` at a uniform ``spacing_m``; arrays of shape ``(K,)`` belong to the points."""

    points: npt.NDArray[np.float64]
    spacing_m: float
    heading_rad: Floats
    """Unwrapped, so that it can be interpolated."""
    curvature_1pm: Floats
    """Left turns positive."""

    @classmethod
    def through(cls, points: npt.NDArray[np.float64], smoothing_m: float = 0.0) -> "Curve":
        """The curve through points (shape ``(N, 2)``), resampled and smoothed with both ends kept.

        Raises:
            ValueError: fewer than two distinct points.
        """
        line = Polyline.through(points)
        line = line.resampled(SPACING_M)
        if smoothing_m > 0.0 and len(line.points) > 3:
            line = Polyline.through(_smoothed(line.points, smoothing_m)).resampled(SPACING_M)
        even = line.points
        spacing = line.length_m / (len(even) - 1)
        delta = np.empty_like(even)
        delta[1:-1] = even[2:] - even[:-2]
        delta[0], delta[-1] = even[1] - even[0], even[-1] - even[-2]
        heading = np.unwrap(np.arctan2(delta[:, 1], delta[:, 0]))
        return cls(points=even, spacing_m=spacing, heading_rad=heading, curvature_1pm=np.gradient(heading, spacing))

    @property
    def length_m(self) -> float:
        """Length of the whole curve."""
        return self.spacing_m * (len(self.points) - 1)

    def _cell(self, s_m: float) -> tuple[int, float]:
        place = s_m / self.spacing_m
        i = min(max(int(place), 0), len(self.points) - 2)
        return i, place - i

    def place(self, s_m: float) -> tuple[float, float, float, float]:
        """``(x, y, heading, curvature)`` at an arc length; straight on before the start and after the end."""
        i, fraction = self._cell(s_m)
        x0, y0 = self.points[i].tolist()
        x1, y1 = self.points[i + 1].tolist()
        inside = min(max(fraction, 0.0), 1.0)
        heading = _between(self.heading_rad, i, inside)
        curvature = _between(self.curvature_1pm, i, inside) if inside == fraction else 0.0
        return x0 + fraction * (x1 - x0), y0 + fraction * (y1 - y0), heading, curvature

    def at(self, s_m: Floats) -> npt.NDArray[np.float64]:
        """Points at arc lengths, shape ``(..., 2)``; straight on before the start and after the end."""
        place = s_m / self.spacing_m
        i = np.clip(place.astype(np.intp), 0, len(self.points) - 2)
        start = self.points[i]
        return start + (place - i)[..., None] * (self.points[i + 1] - start)

    def heading_at(self, s_m: Floats) -> Floats:
        """Headings at arc lengths, unwrapped."""
        return np.interp(s_m, self.spacing_m * np.arange(len(self.points)), self.heading_rad)

    def curvature_at(self, s_m: Floats) -> Floats:
        """Curvatures at arc lengths."""
        return np.interp(s_m, self.spacing_m * np.arange(len(self.points)), self.curvature_1pm)

    def offset_at(self, s_m: Floats, left_m: Floats) -> npt.NDArray[np.float64]:
        """Points at arc lengths moved sideways, left positive; shape ``(..., 2)``."""
        heading = self.heading_at(s_m)
        return self.at(s_m) + left_m[..., None] * np.stack((-np.sin(heading), np.cos(heading)), axis=-1)

    def project(
        self, x_m: Floats, y_m: Floats, first: int = 0, last: int | None = None
    ) -> tuple[Floats, Floats, npt.NDArray[np.intp]]:
        """Nearest place of each point: arc length, offset (left positive) and index of the nearest curve point.

        Only curve points ``first`` to ``last`` (excluded) are looked at; beyond them the curve goes straight on.
        """
        nearest = np.empty(len(x_m), np.intp)
        _nearest_points(np.ascontiguousarray(self.points[first:last]), np.array((x_m, y_m)), nearest)
        nearest += first
        dx, dy = x_m - self.points[nearest, 0], y_m - self.points[nearest, 1]
        heading = self.heading_rad[nearest]
        cos, sin = np.cos(heading), np.sin(heading)
        left = cos * dy - sin * dx
        along = (cos * dx + sin * dy) / np.maximum(1.0 - self.curvature_1pm[nearest] * left, 0.2)
        return nearest * self.spacing_m + along, left, nearest

    def project_one(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Nearest place of one point on the whole curve: arc length and offset, left positive."""
        delta = self.points - (x_m, y_m)
        nearest = int(np.argmin(np.einsum("kj,kj->k", delta, delta)))
        return self.nearest_to(nearest * self.spacing_m, x_m, y_m)

    def nearest_to(self, guess_m: float, x_m: float, y_m: float) -> tuple[float, float]:
        """Arc length and offset (left positive) of the place nearest to a point, searched near a guess."""
        s = guess_m
        left = 0.0
        for _ in range(_NEAREST_ITERATIONS):
            px, py, heading, curvature = self.place(s)
            cos, sin = cos_of(heading), sin_of(heading)
            left = cos * (y_m - py) - sin * (x_m - px)
            s += (cos * (x_m - px) + sin * (y_m - py)) / max(1.0 - curvature * left, 0.2)
        return s, left

    def cut(self, from_m: float, to_m: float) -> "Curve":
        """The part between two arc lengths, extended straight on where they lie outside."""
        count = max(2, int(np.ceil((to_m - from_m) / SPACING_M)) + 1)
        return Curve.through(self.at(np.linspace(from_m, to_m, count)))


def _between(values: Floats, i: int, fraction: float) -> float:
    low, high = values[i : i + 2].tolist()
    return float(low + fraction * (high - low))


def _smoothed(points: npt.NDArray[np.float64], sigma_m: float) -> npt.NDArray[np.float64]:
    radius = min(int(np.ceil(3.0 * sigma_m / SPACING_M)), len(points) - 1)
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) * SPACING_M / sigma_m) ** 2)
    taps /= taps.sum()
    padded = np.pad(points, ((radius, radius), (0, 0)), mode="reflect", reflect_type="odd")
    return np.stack([np.convolve(padded[:, axis], taps, mode="valid") for axis in (0, 1)], axis=-1)


@compiled
def _nearest_points(points: Any, places: Any, nearest: Any) -> None:
    """Fill in the row of the point (K, 2) that is nearest to each place (2, N)."""
    for n in range(nearest.shape[0]):
        best, best_square = 0, np.inf
        for k in range(points.shape[0]):
            dx, dy = places[0, n] - points[k, 0], places[1, n] - points[k, 1]
            square = dx * dx + dy * dy
            if square < best_square:
                best, best_square = k, square
        nearest[n] = best
