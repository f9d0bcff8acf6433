"""Corrections of how SUMO's vehicles move.

* They slow down for bends: SUMO knows a lane's speed limit, not its shape.
* They stay where they are when they change to a lane of another length.
* They move sideways by driving, also where a lane change is urgent.
"""

from collections import deque
from collections.abc import Container, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple, TypeAlias

import libsumo
import numpy as np

from siren_ros.numerics.braking import SAMPLE_M, bend_speeds_mps, with_braking
from siren_ros.numerics.geometry import Polyline
from siren_ros.numerics.units import STEP_S
from siren_ros.roads.road_network import NO_LANE, Lane, LaneKind, RoadNetwork
from siren_ros.traffic.demand.plan import PlannedVehicle, connection_onward

# No parameters: they make SUMO's motion one that a car can follow, and are calibrated with the vehicle model.
LATERAL_ACCEL_MPS2: Final = 3.0
"""With which drivers take bends: the 85th percentile of drivers in urban turns is 2.5 to 3 m/s² (AASHTO, A Policy on
Geometric Design, side friction at low speeds); the drivers of the behaviour model have the same limit."""
BRAKING_MPS2: Final = 1.5
"""With which they slow down before a bend (Treiber and Kesting, comfortable deceleration of the IDM in towns)."""
_AHEAD_M: Final = 90.0
"""How far ahead a bend counts: 16 m/s come down to walking speed within it."""
_EDGES_AHEAD: Final = 4
_STEP_MPS: Final = 0.05
"""A limit is told to SUMO when it has changed by this much."""


Results: TypeAlias = Mapping[str, Mapping[int, Any]]
"""SUMO's subscription results by vehicle."""


class _Profile(NamedTuple):
    """Speeds at each metre of a lane."""

    scale: float
    """SUMO's length of the lane over that of its centre line."""
    bend_mps: Sequence[float]
    """Of the place itself."""
    allowed_mps: Sequence[float]
    """From which a vehicle still slows down in time for what follows."""


class BendLimits:
    """Sets the greatest speed of SUMO's vehicles, step by step, from the shapes of the lanes ahead."""

    def __init__(self, network: RoadNetwork, length_scale: Mapping[str, float]) -> None:
        """``length_scale`` is SUMO's length of each lane over that of its centre line."""
        self._network = network
        self._length_scale = length_scale
        lanes_of = ((*connection.via, connection.to_lane) for connection in network.connections)
        self._onward = dict(pair for lanes in lanes_of for pair in pairwise(lanes))
        """The lane that follows each internal lane."""
        self._profiles: dict[tuple[int, tuple[int, ...]], _Profile] = {}
        self._routes: dict[str, tuple[int, ...]] = {}
        self._present: dict[str, tuple[str, int, _Profile | None]] = {}
        """Lane and place on the route of each vehicle, and its profile there."""
        self._passed: dict[str, deque[tuple[float, float]]] = {}
        """Places where each front bumper was: distance driven until there, and the speed of the bend."""
        self._limits: dict[str, float] = {}

    def apply(self, results: Results, vehicles: Mapping[str, PlannedVehicle], mirrored: Container[str]) -> None:
        """Set the limits for SUMO's next step; ``mirrored`` vehicles are moved from outside and have no limit."""
        limits = {}
        for name, result in results.items():
            vehicle = vehicles[name]
            wished_mps = limit = vehicle.driver.driving.max_speed_mps
            profile = None if name in mirrored else self._profile_of(name, vehicle, result)
            if profile is not None:
                scale, bend_mps, allowed_mps = profile
                at = min(max(int(result[libsumo.VAR_LANEPOSITION] / scale / SAMPLE_M), 0), len(bend_mps) - 1)
                held_mps = self._held(name, vehicle.length_m, result[libsumo.VAR_SPEED] / scale * STEP_S, bend_mps[at])
                limit = min(wished_mps, scale * min(held_mps, allowed_mps[at]))
            before = self._limits.get(name, wished_mps)
            changed = abs(limit - before) >= _STEP_MPS or (limit != before and wished_mps in {limit, before})
            limits[name] = limit if changed else before
            if changed:
                libsumo.vehicle.setMaxSpeed(name, limit)
        self._limits = limits
        if len(self._present) > len(results):
            self._passed = {name: passed for name, passed in self._passed.items() if name in results}
            self._present = {name: present for name, present in self._present.items() if name in results}

    def _held(self, name: str, length_m: float, moved_m: float, bend_mps: float) -> float:
        """The slowest bend that some part of a vehicle is in, when its front bumper has come to another place."""
        passed = self._passed.setdefault(name, deque())
        at_m = (passed[-1][0] if passed else 0.0) + moved_m
        # Earlier places that are no slower leave the outline first and never count again: speeds ascend.
        while passed and passed[-1][1] >= bend_mps:
            passed.pop()
        passed.append((at_m, bend_mps))
        while passed[0][0] < at_m - length_m:
            passed.popleft()
        return passed[0][1]

    def _profile_of(self, name: str, vehicle: PlannedVehicle, result: Mapping[int, Any]) -> _Profile | None:
        """The speeds of the lane that a vehicle is on, None off the road."""
        lane_id, index = result[libsumo.VAR_LANE_ID], result[libsumo.VAR_ROUTE_INDEX]
        present = self._present.get(name)
        if present is None or present[0] != lane_id or present[1] != index:
            lane = self._network.lane_by_id.get(lane_id)
            profile = None if lane is None else self._profile(lane, self._route_ahead(name, vehicle, index))
            present = self._present[name] = (lane_id, index, profile)
        return present[2]

    def _route_ahead(self, name: str, vehicle: PlannedVehicle, index: int) -> tuple[int, ...]:
        """The edge that a vehicle is on, or comes from inside a junction, and the next ones of its route."""
        if name not in self._routes:
            self._routes[name] = tuple(self._network.edge_by_id[edge].index for edge in vehicle.route)
        return self._routes[name][max(index, 0) :][:_EDGES_AHEAD]

    def _profile(self, lane: Lane, edges: tuple[int, ...]) -> _Profile:
        """The speeds of a lane, with regard to what follows it on the route."""
        key = (lane.index, edges)
        if key not in self._profiles:
            path = Polyline.joined([self._network.lanes[index].centre for index in self._lanes_ahead(lane, edges)])
            reach = path.cut(0.0, min(path.length_m, lane.length_m + _AHEAD_M))
            bend, count = bend_speeds_mps(reach, LATERAL_ACCEL_MPS2), int(np.ceil(lane.length_m / SAMPLE_M)) + 1
            speeds = (bend[:count].tolist(), with_braking(bend, BRAKING_MPS2)[:count].tolist())
            self._profiles[key] = _Profile(self._length_scale[lane.lane_id], *speeds)
        return self._profiles[key]

    def _lanes_ahead(self, lane: Lane, edges: Sequence[int]) -> list[int]:
        """The lane and those that follow it on the route, at least as far as a bend counts."""
        lanes, ahead_m, current = [lane.index], 0.0, lane
        while current.kind is LaneKind.INTERNAL and current.index in self._onward:
            current = self._network.lanes[self._onward[current.index]]
            lanes.append(current.index)
            ahead_m += current.length_m
        left = list(edges[edges.index(current.edge) + 1 :]) if current.edge in edges else []
        while left and ahead_m < _AHEAD_M:
            step = connection_onward(self._network, current, left.pop(0))
            if step is None:
                break
            current = self._network.lanes[step.to_lane]
            lanes += [*step.via, current.index]
            ahead_m += sum(self._network.lanes[index].length_m for index in (*step.via, current.index))
        return lanes


# No parameter: smaller jumps are rounding.
_TOLERANCE_M: Final = 0.05


class LaneContinuity:
    """Remembers front bumpers of one step, and corrects the next one's where a lane change moved them."""

    def __init__(self, network: RoadNetwork, length_scale: Mapping[str, float]) -> None:
        self._network = network
        self._length_scale = length_scale
        self._fronts: dict[str, tuple[int, float, float]] = {}
        """Lane, x and y of each front bumper."""

    def correct(self, results: Mapping[str, dict[int, Any]], skip: Container[str]) -> None:
        """Put vehicles that changed lanes in the last step where their motion leads, in SUMO and in the results.

        In SUMO's results of this step, their position and lane position are replaced in place. Vehicles that are moved
        from outside (``skip``) stand right already.
        """
        fronts = {}
        offset_x, offset_y = self._network.sumo_offset_m
        for name, result in results.items():
            lane = self._network.lane_by_id.get(result[libsumo.VAR_LANE_ID])
            index = NO_LANE if lane is None else lane.index
            before = self._fronts.get(name)
            if before is not None and name not in skip and self._changed_beside(before[0], index):
                self._correct_vehicle(name, before[1:], index, result)
            x, y = result[libsumo.VAR_POSITION]
            fronts[name] = (index, x - offset_x, y - offset_y)
        self._fronts = fronts

    def _changed_beside(self, before: int, now: int) -> bool:
        if NO_LANE in (before, now) or before == now:
            return False
        return self._network.lanes[before].edge == self._network.lanes[now].edge

    def _correct_vehicle(self, name: str, front_m: tuple[float, float], now: int, result: dict[int, Any]) -> None:
        lane = self._network.lanes[now]
        scale = self._length_scale[lane.lane_id]
        along, _ = lane.centre.project(front_m)
        at_m = float(along) + result[libsumo.VAR_SPEED] / scale * STEP_S
        jump = result[libsumo.VAR_LANEPOSITION] / scale - at_m
        if abs(jump) < _TOLERANCE_M or not 0.0 < at_m < lane.length_m:
            return
        libsumo.vehicle.moveTo(name, lane.lane_id, at_m * scale)
        x, y = lane.centre.offset_points(at_m, result[libsumo.VAR_LANEPOSITION_LAT])
        offset_x, offset_y = self._network.sumo_offset_m
        result[libsumo.VAR_POSITION] = (float(x) + offset_x, float(y) + offset_y)
        result[libsumo.VAR_LANEPOSITION] = at_m * scale


# No parameters: see above.
SIDEWAYS_SHARE: Final = 0.3
"""Lateral speed at most, as a share of the speed: a course 17° off the lane's."""
_LEAST_MPS: Final = 1e-3
"""SUMO divides by the lateral speed."""
_SIDEWAYS_STEP_MPS: Final = 0.1
"""Limits are multiples of this, so that they are seldom set."""


class SidewaysLimits:
    """The limits that are in force in SUMO."""

    def __init__(self) -> None:
        self._limits: dict[str, float] = {}

    def apply(self, results: Results, vehicles: Mapping[str, PlannedVehicle], mirrored: Container[str]) -> None:
        """Set the limits for SUMO's next step; ``mirrored`` vehicles are moved from outside."""
        limits = {}
        for name, result in results.items():
            wished_mps = vehicles[name].driver.max_lateral_speed_mps
            speed_mps = 0.0 if name in mirrored else result[libsumo.VAR_SPEED]
            limit = _SIDEWAYS_STEP_MPS * int(SIDEWAYS_SHARE * speed_mps / _SIDEWAYS_STEP_MPS)
            limits[name] = min(max(limit, _LEAST_MPS), wished_mps)
            if limits[name] != self._limits.get(name, wished_mps):
                libsumo.vehicle.setMaxSpeedLat(name, limits[name])
        self._limits = limits
