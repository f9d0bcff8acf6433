"""Orders to single vehicles: EMVs that SUMO drives stop where their route ends, and the head of a jam blocks traffic.

SUMO takes a vehicle out of traffic at the end of its route, and an EMV's sensors would go with it. EMVs that are driven
from outside stop there as well. What causes a jam is beyond the map: SUMO's foremost drivers would go on.
"""

from collections.abc import Collection, Sequence
from typing import Final

import libsumo

from siren_ros.base.numerics.braking import braking_distance_m
from siren_ros.simulation.traffic.demand.jam import JamHead
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle

# This is no parameter: it decides where a driver begins to stop at the end of the road.
_BRAKE_MPS2: Final = 1.5
_EARLIER_M: Final = 20.0
_END_M: Final = 1.0
"""Length of road that is left in front of the bumper at the end of a route."""
_FOR_GOOD_S: Final = 1e6


class RouteEnds:
    """Tells each EMV to stop at the end of its route once the end is near.

    An earlier order would influence its choice of lanes.
    """

    def __init__(self, emvs: Sequence[PlannedVehicle]) -> None:
        self._driving = {emv.name: emv.route for emv in emvs}

    def apply(self, present: Collection[str]) -> None:
        """Gives the orders for SUMO's next step; ``present`` are the vehicles in SUMO."""
        for name in [name for name in self._driving if name in present]:
            route = self._driving[name]
            if libsumo.vehicle.getRouteIndex(name) < len(route) - 1:
                continue
            end_m = libsumo.lane.getLength(libsumo.vehicle.getLaneID(name)) - _END_M
            speed_mps = libsumo.vehicle.getSpeed(name)
            left_m = end_m - libsumo.vehicle.getLanePosition(name)
            if left_m < braking_distance_m(speed_mps * speed_mps, _BRAKE_MPS2) + _EARLIER_M:
                libsumo.vehicle.setStop(name, route[-1], end_m, libsumo.vehicle.getLaneIndex(name), _FOR_GOOD_S)
                del self._driving[name]


class JamOrders:
    """Tells the head of a jam how fast to go."""

    def __init__(self, jam: JamHead) -> None:
        self._jam = jam

    def apply(self, step: int, present: Collection[str]) -> None:
        """Orders speeds for SUMO's next step, and withdraws the last order once the jam is over.

        ``step`` is the one that SUMO comes to next, ``present`` are the vehicles that SUMO drives; those that are moved
        from outside are left alone.
        """
        if step > 0 and self._jam.speed_mps(step - 1) < 0.0:
            return
        for name in self._jam.names:
            if name in present:
                libsumo.vehicle.setSpeed(name, self._jam.speed_mps(step))
