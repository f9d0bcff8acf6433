"""A path that the navigator can follow: a smooth curve with the lanes below it and its speed limit."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.numerics.arrays import Floats
from siren_ros.roads.road_network import NO_LANE
from siren_ros.world.traffic_state import Indices

_THREE: Final = np.full(3, 1.0 / 3.0)
_CREEP_MPS: Final = 1.5
"""The steering keeps up with any path at this speed well enough."""
_LEAST_MPS: Final = 0.5
"""Towards its end, where a path stops, it is driven no slower than this."""


@dataclass(frozen=True, eq=False)
class TrackedPath:
    """Where the footprint's centre shall go."""

    curve: Curve
    lane: Indices
    """Lane below each point of the curve, ``NO_LANE`` off the lanes; shape ``(K,)``."""
    speed_cap_sq: Floats
    """Square of the speed that curves ahead and the path's end allow, shape ``(K,)``, m²/s²."""
    settled_m: float
    """Arc length from which the path follows its reference line without lateral movement."""

    @property
    def length_m(self) -> float:
        """Length of the path."""
        return self.curve.length_m

    def lane_at(self, s_m: float) -> int:
        """Lane below an arc length."""
        i = min(max(round(s_m / self.curve.spacing_m), 0), len(self.lane) - 1)
        return int(self.lane[i])

    def speed_cap_mps(self, s_m: float) -> float:
        """Speed allowed at an arc length; beyond the end that of the end."""
        place = min(max(s_m / self.curve.spacing_m, 0.0), len(self.speed_cap_sq) - 1.0)
        i = min(int(place), len(self.speed_cap_sq) - 2)
        low, high = self.speed_cap_sq[i : i + 2].tolist()
        return float(max(low + (place - i) * (high - low), 0.0)) ** 0.5

    def least_time_s(self, from_m: float, way_m: float) -> float:
        """Time that a way takes at the least: at the speed that the path allows everywhere.

        Beyond the path's end that of its end goes on.
        """
        return self._time_at(from_m + way_m) - self._time_at(from_m)

    def _time_at(self, s_m: float) -> float:
        times, place = self._times_s, max(s_m / self.curve.spacing_m, 0.0)
        i = int(min(place, len(times) - 2.0))
        low, high = times[i : i + 2].tolist()
        return float(low + (place - i) * (high - low))

    @cached_property
    def _times_s(self) -> Floats:
        """Time from the path's start to each point at the speed that is allowed there, shape ``(K,)``."""
        speed = np.sqrt(np.maximum(self.speed_cap_sq, _LEAST_MPS**2))
        slowness = 0.5 * (1.0 / speed[1:] + 1.0 / speed[:-1])
        return np.concatenate(([0.0], np.cumsum(slowness) * self.curve.spacing_m))

    @classmethod
    def of(
        cls,
        curve: Curve,
        config: NavigatorConfig,
        lane: Indices | None = None,
        settled_m: float = 0.0,
        stop_at_end: bool = True,
    ) -> "TrackedPath":
        """The path along a curve, slow enough for its bends and, where wanted, to stop at its end.

        The speed limit solves v² ≤ a_lat/κ, v ≤ κ̇/κ' (what the steering can follow) and
        v²(s) ≤ v²(s') + 2·b·(s' − s) for all s' ≥ s.
        """
        bend = np.abs(curve.curvature_1pm)
        local = config.lateral_accel_mps2 / np.maximum(bend, 1e-4)
        winding = np.convolve(np.abs(np.gradient(curve.curvature_1pm, curve.spacing_m)), _THREE, mode="same")
        steered = config.curvature_rate_1pms / np.maximum(winding, 1e-5)
        local = np.minimum(local, np.maximum(steered, _CREEP_MPS) ** 2)
        if stop_at_end:
            local = np.concatenate((local[:-1], [0.0]))
        braking = 2.0 * config.path_brake_mps2 * curve.spacing_m * np.arange(len(local))
        cap = np.minimum.accumulate((local + braking)[::-1])[::-1] - braking
        if lane is None:
            lane = np.full(len(cap), NO_LANE, dtype=np.int32)
        return cls(curve=curve, lane=lane, speed_cap_sq=cap, settled_m=settled_m)
