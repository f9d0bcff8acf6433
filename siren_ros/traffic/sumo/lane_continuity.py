"""Keeps SUMO's vehicles where they are when they change to a lane of another length.

SUMO gives all lanes of an edge one length and keeps a vehicle's share of it when it changes lanes. In
and after a bend the lanes' geometries differ, and the vehicle would jump along the road by up to the
difference (2 m and more on maps from OpenDRIVE).
"""

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Any, Final

import libsumo

from siren_ros.numerics.units import STEP_S
from siren_ros.roads.road_network import NO_LANE, RoadNetwork

_TOLERANCE_M: Final = 0.05


@dataclass(frozen=True)
class _Front:
    lane: int
    x_m: float
    y_m: float


class LaneContinuity:
    """Remembers front bumpers of one step, and corrects the next one's where a lane change moved them."""

    def __init__(self, network: RoadNetwork, length_scale: Mapping[str, float]) -> None:
        self._network = network
        self._length_scale = length_scale
        self._fronts: dict[str, _Front] = {}

    def correct(self, results: Mapping[str, dict[int, Any]], skip: Container[str]) -> None:
        """Put vehicles that changed lanes in the last step where their motion leads, in SUMO and in the results.

        Args:
            results: SUMO's subscription results of this step by vehicle; position and lane position of
                corrected vehicles are replaced in place.
            skip: Vehicles that are moved from outside; they stand right already.
        """
        fronts = {}
        offset_x, offset_y = self._network.sumo_offset_m
        for name, result in results.items():
            lane = self._network.lane_by_id.get(result[libsumo.VAR_LANE_ID])
            index = NO_LANE if lane is None else lane.index
            before = self._fronts.get(name)
            if before is not None and name not in skip and self._changed_beside(before.lane, index):
                self._correct_one(name, before, index, result)
            x, y = result[libsumo.VAR_POSITION]
            fronts[name] = _Front(index, x - offset_x, y - offset_y)
        self._fronts = fronts

    def _changed_beside(self, before: int, now: int) -> bool:
        if NO_LANE in (before, now) or before == now:
            return False
        return self._network.lanes[before].edge == self._network.lanes[now].edge

    def _correct_one(self, name: str, before: _Front, now: int, result: dict[int, Any]) -> None:
        lane = self._network.lanes[now]
        scale = self._length_scale[lane.lane_id]
        along, _ = lane.centre.project([before.x_m, before.y_m])
        wanted = float(along) + result[libsumo.VAR_SPEED] / scale * STEP_S
        jump = result[libsumo.VAR_LANEPOSITION] / scale - wanted
        if abs(jump) < _TOLERANCE_M or not 0.0 < wanted < lane.length_m:
            return
        libsumo.vehicle.moveTo(name, lane.lane_id, wanted * scale)
        x, y = lane.centre.offset_points(wanted, result[libsumo.VAR_LANEPOSITION_LAT])
        offset_x, offset_y = self._network.sumo_offset_m
        result[libsumo.VAR_POSITION] = (float(x) + offset_x, float(y) + offset_y)
        result[libsumo.VAR_LANEPOSITION] = wanted * scale
