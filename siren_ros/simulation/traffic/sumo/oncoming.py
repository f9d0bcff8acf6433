"""Oncoming drivers slow down and keep right for an EMV with a siren on undivided roads, until it has passed.

The EMV may need the middle of such a road, and a driver who sees it come cannot know that it will not.
"""

from collections.abc import Collection, Mapping
from typing import Final

import libsumo
import numpy as np

from siren_ros.base.numerics.arrays import Codes, Floats, Rows
from siren_ros.base.numerics.compiled import compiled
from siren_ros.simulation.roads.movements import opposite_edges
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.world.actors import Owner, rows_of_ids
from siren_ros.simulation.world.traffic_state import Indices, TrafficState

_ROUTE_EDGES: Final = 3
"""Number of edges of the EMV's route, from its own on, whose opposite side is searched for drivers."""
_NO_EDGE: Final = -1
_BY_SUMO: Final = int(Owner.SUMO)


class OncomingDrivers:
    """Tells SUMO which drivers keep right and slow down."""

    def __init__(self, network: RoadNetwork, reach_m: float) -> None:
        """Takes the distance ahead of the EMV at which drivers notice the siren (``reach_m``)."""
        self._edge_of_lane = np.array([lane.edge for lane in network.lanes], np.int32)
        self._opposite = np.full(len(network.edges), _NO_EDGE, np.int32)
        for edge, other in opposite_edges(network).items():
            self._opposite[edge] = other
        self._reach_m = reach_m
        self._slowed: frozenset[int] = frozenset()

    def apply(self, traffic: TrafficState | None, vehicles: Mapping[int, PlannedVehicle]) -> None:
        """Slows down drivers who meet an EMV, and frees those who do not meet it any more.

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
        rows = rows_of_ids(traffic.actor_id, np.array(sorted(emvs), np.uint32))
        met = (self._rows(traffic, row) for row in rows[rows >= 0].tolist())
        return frozenset(actor for others in met for actor in traffic.actor_id[others].tolist())

    def _rows(self, traffic: TrafficState, emv: int) -> Rows:
        edges = self._opposite[traffic.route_of_row(emv)[:_ROUTE_EDGES]]
        drivers = traffic.owner, traffic.lane, self._edge_of_lane
        poses = traffic.x_m, traffic.y_m, traffic.yaw_rad
        return _ahead_on(edges, drivers, poses, emv, self._reach_m)


@compiled
def _ahead_on(
    edges: Indices,
    drivers: tuple[Codes, Indices, Indices],
    poses: tuple[Floats, Floats, Floats],
    emv: int,
    reach_m: float,
) -> Rows:
    """Rows of SUMO's vehicles that are on some edges, within reach ahead of the EMV in a row."""
    (owner, lane, edge_of_lane), (x_m, y_m, yaw_rad) = drivers, poses
    cos, sin = np.cos(yaw_rad[emv]), np.sin(yaw_rad[emv])
    rows, count = np.empty(len(lane), np.intp), 0
    for row in range(len(lane)):
        dx, dy = x_m[row] - x_m[emv], y_m[row] - y_m[emv]
        if owner[row] != _BY_SUMO or lane[row] == NO_LANE or not cos * dx + sin * dy > 0.0:
            continue
        edge = edge_of_lane[lane[row]]
        if np.hypot(dx, dy) < reach_m and np.any(edges == edge):
            rows[count] = row
            count += 1
    return rows[:count]
