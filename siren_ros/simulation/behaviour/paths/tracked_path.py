"""A path for the navigator, with lanes and speed limit, and how it leads from a pose onto a line."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.braking import squares_with_braking
from siren_ros.simulation.behaviour.paths.curve import SPACING_M, Curve
from siren_ros.simulation.behaviour.paths.lane_path import LanePath
from siren_ros.simulation.conflicts.yielding import Margins
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.scenario.driver_parameters import NavigatorConfig
from siren_ros.simulation.world.traffic_state import Indices

# These are no parameters: weights of a mean, and a speed that keeps times finite.
_THREE: Final = np.full(3, 1.0 / 3.0)
_LEAST_MPS: Final = 0.5
"""Near its end, where a path stops, the speed for timing is at least this."""


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


def quintic_offsets(u: Floats, start: float, slope: float, end: float) -> Floats:
    """Lateral offsets of a transition between two straight lines; at its end it is parallel to the reference.

    It is the quintic polynomial of the place ``u`` along the blend (0–1; beyond 1 the end value) with the given offsets
    at both ends and the given slope at 0, with no slope at 1 and no second derivative at both ends.
    """
    u = np.clip(u, 0.0, 1.0)
    cubic = u**3
    change = end - start
    rise = cubic * (10.0 - 15.0 * u + 6.0 * u * u)
    lead = u - cubic * (6.0 - 8.0 * u + 3.0 * u * u)
    return start + change * rise + slope * lead


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
