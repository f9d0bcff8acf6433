"""Paths that vehicles follow: smooth curves, the lanes along them, and how a path leads from a pose onto a line.

A curve has equally spaced points, with heading and curvature at every point. The navigator tracks a path with lanes and
a speed limit.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any, Final, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Points, Rows
from siren_ros.base.numerics.braking import squares_with_braking
from siren_ros.base.numerics.compiled import X, Y, compiled
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.conflicts.yielding import Margins
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.scenario.driver_parameters import NavigatorConfig
from siren_ros.simulation.world.actors import Indices

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

    def project(self, x_m: Floats, y_m: Floats) -> tuple[Floats, Floats, npt.NDArray[np.intp]]:
        """Nearest place for each point: arc length, offset (positive to the left), index of the nearest curve point."""
        s, left, nearest = np.empty(len(x_m)), np.empty(len(x_m)), np.empty(len(x_m), np.intp)
        _project(self, x_m, y_m, s, left, nearest)
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
def _project(curve: Curve, xs_m: Floats, ys_m: Floats, s_m: Floats, left_m: Floats, nearest: Rows) -> None:
    """Compute arc length, offset and nearest curve point of each place."""
    for n in range(nearest.shape[0]):
        s_m[n], left_m[n], nearest[n] = nearest_point(curve, xs_m[n], ys_m[n], 0, len(curve.points))


# These are no parameters: weights of a mean, and a speed that keeps times finite.
_THREE: Final = np.full(3, 1.0 / 3.0)
_LEAST_MPS: Final = 0.5
"""Near its end, where a path stops, the speed for timing is at least this."""


class LaneEnd(StrEnum):
    """Reason why a reference line ends."""

    HORIZON = "horizon"
    """The path has the requested length."""
    ROUTE = "route"
    """The path ends because the route ends."""
    ASTRAY = "astray"
    """The lane does not lead to the route's next edge."""
    JUNCTION = "junction"
    """A junction begins at which traffic rules decide."""


@dataclass(frozen=True, eq=False)
class LanePath:
    """A reference line along consecutive lanes, including internal ones."""

    lanes: tuple[int, ...]
    """Lanes in order."""
    start_m: Floats
    """Arc length on the curve at which each lane begins; negative if it begins before the curve."""
    curve: Curve
    end: LaneEnd

    def lane_at(self, s_m: Floats) -> Indices:
        """Lanes at arc lengths."""
        order = np.clip(np.searchsorted(self.start_m, s_m, side="right") - 1, 0, len(self.lanes) - 1)
        return np.asarray(self.lanes, dtype=np.int32)[order]


@dataclass(frozen=True)
class Navigation(NavigatorConfig):
    """How one vehicle is driven: parameters of its driver, and values that do not depend on the driver."""

    curvature_rate_1pms: float = 0.1
    """Largest change of curvature per time, from the vehicle's steering."""
    conflicts: Margins = field(default_factory=Margins)
    """Parameters for places where paths of others meet the own path."""

    @classmethod
    def by(cls, driver: NavigatorConfig, **others: Any) -> Self:
        """Navigation of a driver, with ``others`` as further fields."""
        return cls(**{**vars(driver), **others})


@dataclass(frozen=True, eq=False)
class TrackedPath:
    """A path of the footprint's centre."""

    curve: Curve
    lane: Indices
    """Lane at each point of the curve, ``NO_LANE`` off the lanes; shape ``(K,)``."""
    speed_cap_sq: Floats
    """Square of the speed allowed by curves ahead and the path's end, shape ``(K,)``, m²/s²."""
    settled_m: float
    """Arc length from which the path follows its reference line without lateral movement."""

    @property
    def length_m(self) -> float:
        """Length of the path."""
        return self.curve.length_m

    def index_at(self, s_m: float) -> int:
        """Point of the curve nearest to an arc length."""
        return min(max(round(s_m / self.curve.spacing_m), 0), len(self.lane) - 1)

    def lane_at(self, s_m: float) -> int:
        """Lane at an arc length."""
        return int(self.lane[self.index_at(s_m)])

    def speed_cap_mps(self, s_m: float) -> float:
        """Speed allowed at an arc length; beyond the end the value at the end."""
        place = min(max(s_m / self.curve.spacing_m, 0.0), len(self.speed_cap_sq) - 1.0)
        i = min(int(place), len(self.speed_cap_sq) - 2)
        low, high = self.speed_cap_sq[i : i + 2].tolist()
        return float(max(low + (place - i) * (high - low), 0.0)) ** 0.5

    @cached_property
    def times_s(self) -> Floats:
        """Time from the path's start to each point at the allowed speed, shape ``(K,)``."""
        speed = np.sqrt(np.maximum(self.speed_cap_sq, _LEAST_MPS**2))
        slowness = 0.5 * (1.0 / speed[1:] + 1.0 / speed[:-1])
        return np.concatenate(([0.0], np.cumsum(slowness) * self.curve.spacing_m))

    @classmethod
    def of(
        cls,
        curve: Curve,
        config: Navigation,
        lane: Indices | None = None,
        settled_m: float = 0.0,
        stop_at_end: bool = True,
    ) -> "TrackedPath":
        """Make a path along a curve, slow enough for its bends and, with ``stop_at_end``, for a stop at its end.

        The speed limit solves v² ≤ a_lat/κ, v ≤ κ̇/κ' (what the steering can follow) and
        v²(s) ≤ v²(s') + 2·b·(s' − s) for all s' ≥ s.
        """
        bend = np.abs(curve.curvature_1pm)
        local = config.lateral_accel_mps2 / np.maximum(bend, 1e-4)
        winding = np.convolve(np.abs(np.gradient(curve.curvature_1pm, curve.spacing_m)), _THREE, mode="same")
        steered = config.curvature_rate_1pms / np.maximum(winding, 1e-5)
        local = np.minimum(local, np.maximum(steered, config.path_creep_mps) ** 2)
        if stop_at_end:
            local = np.concatenate((local[:-1], [0.0]))
        cap = squares_with_braking(local, config.path_brake_mps2, curve.spacing_m)
        if lane is None:
            lane = np.full(len(cap), NO_LANE, dtype=np.int32)
        return cls(curve=curve, lane=lane, speed_cap_sq=cap, settled_m=settled_m)


# This is no parameter: a property of quintic polynomials.
PEAK_CURVATURE: Final = 10.0 / math.sqrt(3.0)
"""Peak curvature of a quintic blend with level ends, times length² over lateral distance."""


def quintic_offsets(u: Floats, start: float, slope: float, end: float, bend: float = 0.0) -> Floats:
    """Lateral offsets of a transition between two straight lines; at its end it is parallel to the reference.

    It is the quintic polynomial of the place ``u`` along the blend (0–1; beyond 1 the end value) with the given offsets
    at both ends and the given slope and second derivative (``bend``) at 0, with neither of them at 1.
    """
    u = np.clip(u, 0.0, 1.0)
    cubic = u**3
    change = end - start
    rise = cubic * (10.0 - 15.0 * u + 6.0 * u * u)
    lead = u - cubic * (6.0 - 8.0 * u + 3.0 * u * u)
    turn = 0.5 * u * u - cubic * (1.5 - 1.5 * u + 0.5 * u * u)
    return start + change * rise + slope * lead + bend * turn


_WINDING: Final = 40.0
"""Curvature change for which the length of a lateral move is planned, multiplied by length³ over lateral distance."""


def blend_length_m(
    offset_change_m: float, speed_mps: float, duration_s: float, least_m: float, config: Navigation
) -> float:
    """Length of a lateral move. ``duration_s`` and ``least_m`` are for a lane's width (3.5 m).

    It is no shorter than the steering can follow: the curvature of a quintic changes by up to 60·d/l³ per metre at its
    ends, where the path's speed limit takes care of it, and by a third less on the way.
    """
    offset = abs(offset_change_m)
    share = math.sqrt(min(offset / 3.5, 1.0))
    steerable = (_WINDING * offset * speed_mps / config.curvature_rate_1pms) ** (1.0 / 3.0)
    return max(least_m * share, duration_s * speed_mps * share, steerable, 3.0)


_STEEPEST: Final = 0.6
"""Largest tangent of the angle between pose and reference line at the start of a lateral move."""


def path_onto(
    reference: LanePath,
    pose: tuple[float, float, float],
    merge_m: float,
    config: Navigation,
    offset_m: float = 0.0,
    stop_at_end: bool = True,
    shorten_m: float = 0.0,
) -> TrackedPath:
    """Path from a pose (x, y, yaw) onto a line parallel to a reference line, and along it.

    The line lies ``offset_m`` to the left, and the lateral move is ``merge_m`` long. ``shorten_m`` is left out at the
    end of the reference line (the front of the vehicle).
    """
    curve = reference.curve
    s0, d0 = curve.project_one(pose[0], pose[1])
    heading = float(curve.heading_at(np.array([s0]))[0])
    turned = math.remainder(pose[2] - heading, 2.0 * math.pi)
    slope = max(-_STEEPEST, min(_STEEPEST, math.tan(max(-1.0, min(1.0, turned)))))
    end_m = max(curve.length_m - shorten_m, s0 + 2.0)
    s = np.linspace(s0, end_m, max(3, math.ceil((end_m - s0) / SPACING_M) + 1))
    offsets = quintic_offsets((s - s0) / merge_m, d0, slope * merge_m, offset_m)
    path = Curve.through(curve.offset_at(s, offsets))
    return along_reference(path, reference, s, config, merge_m, stop_at_end)


def on_reference(reference: LanePath, config: Navigation, stop_at_end: bool, shorten_m: float) -> TrackedPath:
    """The reference line itself as a path; its last ``shorten_m`` are left out."""
    curve = reference.curve
    end_m = max(curve.length_m - shorten_m, 2.0)
    s = np.linspace(0.0, end_m, max(3, math.ceil(end_m / SPACING_M) + 1))
    return along_reference(Curve.through(curve.at(s)), reference, s, config, 0.0, stop_at_end)


def along_reference(
    curve: Curve, reference: LanePath, s_m: Floats, config: Navigation, settled_m: float, stop_at_end: bool
) -> TrackedPath:
    """A tracked path whose points belong to arc lengths ``s_m`` of a reference line, evenly from end to end."""
    evenly_m = np.linspace(s_m[0], s_m[-1], len(curve.points))
    return TrackedPath.of(curve, config, reference.lane_at(evenly_m), settled_m, stop_at_end)
