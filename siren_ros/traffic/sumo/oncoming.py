"""Drivers who meet an EMV with a siren on a road that nothing divides slow down and keep right until it has passed.

The EMV may need the middle of such a road, and a driver who sees it come cannot know that it will not.
"""

from collections.abc import Collection, Mapping
from typing import Final

import libsumo
import numpy as np

from siren_ros.numerics.arrays import Rows
from siren_ros.roads.movements import opposite_edges
from siren_ros.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.traffic.demand.plan import PlannedVehicle
from siren_ros.world.actors import Owner
from siren_ros.world.traffic_state import TrafficState

_ROUTE_EDGES: Final = 3
"""Edges of the EMV's route, from its own on, whose other side counts."""
_NO_EDGE: Final = -1


class OncomingDrivers:
    """Tells SUMO which drivers keep right and slow down."""

    def __init__(self, network: RoadNetwork, reach_m: float) -> None:
        """``reach_m`` is how far ahead the siren is noticed."""
        self._edge_of_lane = np.array([lane.edge for lane in network.lanes], np.int32)
        self._opposite = opposite_edges(network)
        self._reach_m = reach_m
        self._slowed: frozenset[int] = frozenset()

    def apply(self, traffic: TrafficState | None, vehicles: Mapping[int, PlannedVehicle]) -> None:
        """Slow down those who meet an EMV, and let those go on who do not any more.

        ``traffic`` is the state before SUMO's next step, None before the first one; ``vehicles`` are those in it.
        """
        emvs = [actor_id for actor_id, vehicle in vehicles.items() if vehicle.is_emv]
        meeting = frozenset() if traffic is None else self.meeting(traffic, emvs)
        for actor_id in sorted(self._slowed ^ meeting):
            vehicle = vehicles.get(actor_id)
            if vehicle is None or vehicle.oncoming_share >= 1.0:
                continue
            slows = actor_id in meeting
            share = vehicle.oncoming_share if slows else 1.0
            libsumo.vehicle.setSpeedFactor(vehicle.name, share * vehicle.driver.speed_factor)
            libsumo.vehicle.setLateralAlignment(vehicle.name, "right" if slows else "center")
        self._slowed = meeting

    def meeting(self, traffic: TrafficState, emvs: Collection[int]) -> frozenset[int]:
        """Ids of the actors that SUMO drives and that come towards an EMV on the other side of its road."""
        rows = np.flatnonzero(np.isin(traffic.actor_id, list(emvs))).tolist()
        return frozenset(actor for row in rows for actor in traffic.actor_id[self._rows(traffic, row)].tolist())

    def _rows(self, traffic: TrafficState, emv: int) -> Rows:
        route = traffic.route_of_row(emv)[:_ROUTE_EDGES].tolist()
        others = [self._opposite[edge] for edge in route if edge in self._opposite]
        edge = np.where(traffic.lane == NO_LANE, _NO_EDGE, self._edge_of_lane[traffic.lane])
        dx, dy = traffic.x_m - traffic.x_m[emv], traffic.y_m - traffic.y_m[emv]
        ahead = np.cos(traffic.yaw_rad[emv]) * dx + np.sin(traffic.yaw_rad[emv]) * dy > 0.0
        near = ahead & (np.hypot(dx, dy) < self._reach_m) & (traffic.owner == Owner.SUMO)
        return np.flatnonzero(near & np.isin(edge, others))
