"""Puts planned vehicles into SUMO and keeps the number of civilians."""

from collections import deque
from collections.abc import Iterable, Mapping
from functools import cached_property

import libsumo
import numpy as np

from siren_ros.numerics.geometry import overlapping_pairs
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.traffic.demand.plan import LaneInterval, PlannedVehicle, Spot, TrafficPlan
from siren_ros.traffic.sumo.config import TrafficConfig
from siren_ros.traffic.sumo.readings import SUBSCRIBED
from siren_ros.traffic.sumo.sumo_frames import map_from_sumo
from siren_ros.traffic.sumo.vehicle_types import type_id


def route_id(name: str) -> str:
    """Name of a vehicle's planned route in SUMO."""
    return f"route.{name}"


class Population:
    """The vehicles in SUMO by name, in order of entry."""

    def __init__(self, network: RoadNetwork, plan: TrafficPlan, config: TrafficConfig) -> None:
        self._network = network
        self._plan = plan
        self._config = config
        self._reserve = deque(plan.reserve)
        self.vehicles: dict[str, PlannedVehicle] = {}
        """Vehicles that have entered and not left."""

    @cached_property
    def length_scale(self) -> Mapping[str, float]:
        """SUMO's length of each lane over the length of its centre line; maps from OpenDRIVE differ."""
        lanes = self._network.lanes
        return {lane.lane_id: libsumo.lane.getLength(lane.lane_id) / lane.length_m for lane in lanes}

    def enter_background(self) -> None:
        """Enter the vehicles of the warm-up."""
        self._enter_all(self._plan.background)

    def enter_stage(self) -> None:
        """Clear the stage, enter groups and EMVs on it, and fill up the background elsewhere."""
        entering = [self._centre_of(vehicle) for vehicle in (*self._plan.emvs, *self._plan.groups)]
        for name in list(self.vehicles):
            if self._on_stage(name, self._plan.stage) or self._touches(name, entering):
                self._remove(name)
        for name in self._overlapping():
            self._remove(name)
        self._enter_all(self._plan.emvs)
        self._enter_all(self._plan.groups)
        emv_points = {vehicle.name: self._point_of(vehicle.spot) for vehicle in self._plan.emvs}
        self.refill(emv_points, self._plan.civilians)

    def refill(self, emv_points: Mapping[str, tuple[float, float]], wanted: int) -> None:
        """Enter replacements from the reserve until there are as many civilians as wanted.

        Args:
            emv_points: Points of the EMVs in the ``map`` frame; replacements keep their distance.
            wanted: Number of civilians.
        """
        missing = wanted - sum(not vehicle.is_emv for vehicle in self.vehicles.values())
        for _ in range(len(self._reserve) if missing > 0 else 0):
            vehicle = self._reserve.popleft()
            if self._spot_is_free(vehicle, emv_points.values()):
                self._enter_all((vehicle,))
                missing -= 1
                if missing <= 0:
                    return
            else:
                self._reserve.append(vehicle)

    def drop_departed(self) -> tuple[str, ...]:
        """Forget vehicles that left SUMO in the last step; their names, in order of entry."""
        arrived = set(libsumo.simulation.getArrivedIDList())
        gone = tuple(name for name in self.vehicles if name in arrived)
        for name in gone:
            del self.vehicles[name]
        return gone

    def _enter_all(self, vehicles: Iterable[PlannedVehicle]) -> None:
        for vehicle in vehicles:
            lane = self._network.lanes[vehicle.spot.lane]
            libsumo.route.add(route_id(vehicle.name), vehicle.route)
            # An EMV without privilege enters no faster than its driver may go: SUMO refuses more.
            allowed_mps = lane.speed_limit_mps * float(libsumo.vehicletype.getSpeedFactor(type_id(vehicle)))
            libsumo.vehicle.add(
                vehicle.name,
                route_id(vehicle.name),
                typeID=type_id(vehicle),
                depart="now",
                departLane=str(lane.position),
                departPos=repr(vehicle.spot.front_m * self.length_scale[lane.lane_id]),
                departSpeed=repr(min(vehicle.spot.speed_mps, allowed_mps)),
            )
            if not vehicle.attentive:  # SUMO's drivers wait for whoever is on the junction already
                emvs = " ".join(sorted({type_id(emv) for emv in self._plan.emvs}))
                libsumo.vehicle.setParameter(vehicle.name, "junctionModel.ignoreTypes", emvs)
            libsumo.vehicle.subscribe(vehicle.name, SUBSCRIBED)
            self.vehicles[vehicle.name] = vehicle

    def _remove(self, name: str) -> None:
        libsumo.vehicle.unsubscribe(name)
        libsumo.vehicle.remove(name)
        del self.vehicles[name]

    def _overlapping(self) -> list[str]:
        """The vehicles without which no two bodies overlap: of each such pair the one that entered later.

        SUMO's vehicles have the width of their lane: side by side, while one changes lanes, they may overlap.
        """
        names = [name for name in self.vehicles if libsumo.vehicle.getLaneID(name)]  # not those that wait to enter
        if not names:
            return []
        poses = np.array([self._pose_of(name) for name in names])
        sizes = np.array([(self.vehicles[name].length_m, self.vehicles[name].width_m) for name in names])
        _, later, _ = overlapping_pairs(*poses.T, *sizes.T)
        return [names[row] for row in dict.fromkeys(later.tolist())]

    def _pose_of(self, name: str) -> tuple[float, float, float]:
        """Centre and yaw of a vehicle that is in SUMO, in the ``map`` frame."""
        front, angle_deg = libsumo.vehicle.getPosition(name), libsumo.vehicle.getAngle(name)
        length_m, offset_m = self.vehicles[name].length_m, self._network.sumo_offset_m
        x, y, yaw = map_from_sumo(front[0], front[1], angle_deg, length_m, offset_m)
        return float(x), float(y), float(yaw)

    def _on_stage(self, name: str, stage: Iterable[LaneInterval]) -> bool:
        lane_id = libsumo.vehicle.getLaneID(name)
        lane = self._network.lane_by_id.get(lane_id)
        if lane is None:
            return False
        front = libsumo.vehicle.getLanePosition(name) / self.length_scale[lane_id]
        rear = front - self.vehicles[name].length_m
        return any(area.lane == lane.index and rear <= area.to_m and front >= area.from_m for area in stage)

    def _touches(self, name: str, entering: Iterable[tuple[float, float, float]]) -> bool:
        """Whether a vehicle may overlap one that enters, on whatever lanes the two stand: by their outer circles."""
        length_m = self.vehicles[name].length_m
        x, y, _ = self._pose_of(name)
        return any(np.hypot(x - ex, y - ey) < 0.5 * (length_m + other_m) for ex, ey, other_m in entering)

    def _centre_of(self, vehicle: PlannedVehicle) -> tuple[float, float, float]:
        """Centre at the place of entry, and the vehicle's length."""
        centre_line = self._network.lanes[vehicle.spot.lane].centre
        x, y = centre_line.at(vehicle.spot.front_m)
        yaw = float(centre_line.heading_rad(vehicle.spot.front_m))
        half = 0.5 * vehicle.length_m
        return float(x) - half * np.cos(yaw), float(y) - half * np.sin(yaw), vehicle.length_m

    def _point_of(self, spot: Spot) -> tuple[float, float]:
        x, y = self._network.lanes[spot.lane].centre.at(spot.front_m)
        return float(x), float(y)

    def _spot_is_free(self, vehicle: PlannedVehicle, emv_points: Iterable[tuple[float, float]]) -> bool:
        x, y = self._point_of(vehicle.spot)
        reach = self._config.replacement_distance_m
        if any((x - ex) ** 2 + (y - ey) ** 2 < reach**2 for ex, ey in emv_points):
            return False
        lane = self._network.lanes[vehicle.spot.lane]
        gap = self._config.replacement_gap_m
        offset_x, offset_y = self._network.sumo_offset_m
        around: Polyline = lane.centre.cut(vehicle.spot.front_m - vehicle.length_m - gap, vehicle.spot.front_m + gap)
        for name, other in self.vehicles.items():
            ox, oy = libsumo.vehicle.getPosition(name)
            if ox == libsumo.INVALID_DOUBLE_VALUE:
                px, py = self._point_of(other.spot)
            else:
                px, py = ox - offset_x, oy - offset_y
            along, left = around.project([px, py])
            if -gap < along < around.length_m + other.length_m and abs(left) < lane.width_m:
                return False
        return True
