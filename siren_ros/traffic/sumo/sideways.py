"""Vehicles move sideways by driving: SUMO's lateral speed follows the speed, also where a lane change is urgent.

SUMO's own limits (``lcMaxSpeedLatStanding``, ``lcMaxSpeedLatFactor``) do not bind urgent changes: vehicles that
stand before the end of a lane slide sideways and turn on the spot, which no car can follow. A mirrored vehicle is not
to be moved sideways by SUMO at all: the angle that SUMO gives it for that would show once SUMO drives it again.
"""

from collections.abc import Container, Mapping
from typing import Any, Final

import libsumo

from siren_ros.traffic.demand.plan import PlannedVehicle

SIDEWAYS_SHARE: Final = 0.3
"""Lateral speed at most, as a share of the speed: a course 17° off the lane's."""
_LEAST_MPS: Final = 1e-3
"""SUMO divides by the lateral speed."""
_STEP_MPS: Final = 0.1
"""Limits are multiples of this, so that they are seldom set."""


class SidewaysLimits:
    """The limits that are in force in SUMO."""

    def __init__(self) -> None:
        self._limits: dict[str, float] = {}

    def apply(
        self,
        results: Mapping[str, Mapping[int, Any]],
        vehicles: Mapping[str, PlannedVehicle],
        mirrored: Container[str],
    ) -> None:
        """Set the limits for SUMO's next step.

        Args:
            results: SUMO's subscription results by vehicle.
            vehicles: The vehicles by name.
            mirrored: Vehicles that are moved from outside.
        """
        limits = {}
        for name, result in results.items():
            own = vehicles[name].driver.max_lateral_speed_mps
            limit = 0.0 if name in mirrored else _STEP_MPS * int(SIDEWAYS_SHARE * result[libsumo.VAR_SPEED] / _STEP_MPS)
            limits[name] = min(max(limit, _LEAST_MPS), own)
            if limits[name] != self._limits.get(name, own):
                libsumo.vehicle.setMaxSpeedLat(name, limits[name])
        self._limits = limits
