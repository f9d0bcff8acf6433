"""Drivers who could not stop gently at yellow drive on.

SUMO lets a driver react for a second, and then stop before the line as hard as the vehicle can where that is just
enough. On streets such a driver goes: yellow times are computed so that it comes to the line before the red.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import libsumo
import numpy as np

from siren_ros.base.numerics.braking import braking_distance_m
from siren_ros.simulation.roads.road_network import Connection, RoadNetwork
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.traffic.sumo.population import YELLOW_REACTION_S
from siren_ros.simulation.world.actors import Owner, SignalState, TrafficState, rows_of_ids

_GENTLE_STOP_MPS2: Final = 3.05
"""Deceleration with which drivers stop at yellow, 10 ft/s² (ITE, Traffic Engineering Handbook: yellow times)."""
_BEFORE_LINE_M: Final = 2.0
"""Distance from the stop line at which SUMO's drivers come to a stand."""
HEEDS_LIGHTS: Final = 16
"""The part of SUMO's speed mode by which a driver stops at yellow and red lights."""


def goes_at_yellow(ahead_m: float, mps: float, yellow_s: float) -> bool:
    """Whether a driver reaches the line while it is yellow, and after reacting could not stop gently before it."""
    stop_m = mps * YELLOW_REACTION_S + braking_distance_m(mps * mps, _GENTLE_STOP_MPS2) + _BEFORE_LINE_M
    return ahead_m < min(stop_m, mps * yellow_s)


class DriversAtYellow:
    """Tells SUMO which drivers do not stop at yellow, and until when."""

    def __init__(self, network: RoadNetwork) -> None:
        self._lanes = network.lanes
        self.movements: dict[str, list[Connection]] = {}
        """Those with a yellow, by their signal."""
        for way in network.connections:
            if way.signal_id is not None and way.yellow_s > 0.0:
                self.movements.setdefault(way.signal_id, []).append(way)
        self._shown: dict[str, str] = {}
        """Each signal's state in the step before."""
        self._going: dict[int, Connection] = {}
        """Those who drive on, and their movements."""

    def apply(self, traffic: TrafficState | None, vehicles: Mapping[int, PlannedVehicle]) -> None:
        """Set what they heed in SUMO's next step.

        ``traffic`` is the state before that step, None before the first one; ``vehicles`` are those in it by actor id.
        """
        if traffic is None:
            return
        inside = traffic.owner == Owner.SUMO
        for way in self._turned_yellow(traffic.signals):
            for row in np.flatnonzero(inside & (traffic.lane == way.from_lane)).tolist():
                ahead_m = self._lanes[way.from_lane].length_m - float(traffic.lane_position_m[row])
                follows = self._lanes[way.to_lane].edge in traffic.route_of_row(row)[1:2]
                if follows and goes_at_yellow(ahead_m, float(traffic.sumo_speed_mps[row]), way.yellow_s):
                    self._going[int(traffic.actor_id[row])] = way
        rows = rows_of_ids(traffic.actor_id, np.array([*self._going], np.uint32)).tolist()
        for row, (actor_id, way) in zip(rows, [*self._going.items()], strict=True):
            there, light = row >= 0 and inside[row], way.letter_in(self._shown[str(way.signal_id)])
            if not there or traffic.lane[row] != way.from_lane or light.lower() != "y":
                del self._going[actor_id]
            if there:
                name, heeds = vehicles[actor_id].name, 0 if actor_id in self._going else HEEDS_LIGHTS
                libsumo.vehicle.setSpeedMode(name, libsumo.vehicle.getSpeedMode(name) & ~HEEDS_LIGHTS | heeds)

    def _turned_yellow(self, signals: Sequence[SignalState]) -> Iterator[Connection]:
        """The movements that were green in the step before and are yellow now."""
        for signal in signals:
            before, self._shown[signal.signal_id] = self._shown.get(signal.signal_id, ""), signal.state
            for way in self.movements.get(signal.signal_id, ()) if before != signal.state else ():
                if (way.letter_in(before) + way.letter_in(signal.state)).lower() == "gy":
                    yield way
