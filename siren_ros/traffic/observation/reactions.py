"""Who reacts to which EMV's siren, and the flags that say so."""

from collections.abc import Mapping, Sequence

import numpy as np

from siren_ros.numerics.arrays import Codes
from siren_ros.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.scenario.levels import LEVEL_POLICIES, EmergencyLevel
from siren_ros.traffic.demand.plan import TrafficPlan
from siren_ros.traffic.sumo.advice import ahead_on_route, intent_flags, rescued_names
from siren_ros.traffic.sumo.config import TrafficConfig
from siren_ros.traffic.sumo.readings import Readings
from siren_ros.world.traffic_state import TrafficFlags


class Reactions:
    """Derives reactions and flags of one step; holds nothing from step to step."""

    def __init__(self, network: RoadNetwork, plan: TrafficPlan, level: EmergencyLevel, config: TrafficConfig) -> None:
        self._internal = np.array([lane.kind is LaneKind.INTERNAL for lane in network.lanes])
        self._emvs = tuple(vehicle.name for vehicle in plan.emvs)
        self._reach_m = plan.response_distance_m
        self._advice_range_m = config.advice_range_m
        self._siren = LEVEL_POLICIES[level].siren
        self._device = level in config.bluelight_levels

    def rescued(
        self, names: Sequence[str], readings: Readings, routes: Sequence[Sequence[int]]
    ) -> dict[str, list[str]]:
        """Vehicles that react to each EMV's siren: from SUMO's device, or by its criterion where it does not run."""
        if not self._siren:
            return {emv: [] for emv in self._emvs}
        if self._device:
            return rescued_names(names, self._emvs)
        points = np.stack((readings.x_m, readings.y_m), axis=-1)
        present = np.array([route[0] if route else -1 for route in routes], dtype=np.int32)
        civilian = np.array([name not in self._emvs for name in names])
        found: dict[str, list[str]] = {emv: [] for emv in self._emvs}
        for emv in self._emvs:
            if emv in names:
                row = names.index(emv)
                yaw = float(readings.yaw_rad[row])
                hears = ahead_on_route(points[row], yaw, routes[row], points, present, self._reach_m)
                found[emv] = [names[other] for other in np.flatnonzero(hears & civilian)]
        return found

    def flags(self, names: Sequence[str], readings: Readings, rescued: Mapping[str, Sequence[str]]) -> Codes:
        """Flags of every vehicle; lane-change wishes only near an EMV."""
        flags = np.zeros(len(names), dtype=np.uint8)
        on_junction = (readings.lane != NO_LANE) & self._internal[readings.lane]
        flags[on_junction] |= np.uint8(TrafficFlags.ON_JUNCTION)
        reacting = {name for listed in rescued.values() for name in listed}
        flags[[name in reacting for name in names]] |= np.uint8(TrafficFlags.RESCUE_LANE)
        near = np.zeros(len(names), dtype=np.bool_)
        for row, name in enumerate(names):
            if name in self._emvs:
                distance = np.hypot(readings.x_m - readings.x_m[row], readings.y_m - readings.y_m[row])
                near |= distance <= self._advice_range_m
        for row in np.flatnonzero(near):
            flags[row] |= np.uint8(intent_flags(names[row]))
        return flags
