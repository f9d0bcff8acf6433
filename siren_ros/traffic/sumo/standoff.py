"""Drivers of SUMO who stand on a junction do not wait for an EMV that stands there as well.

SUMO lets a driver wait for a vehicle that comes to the same lane on the junction, whoever is ahead; an EMV waits for
the body ahead of it. EMVs and those who wait for them would then stand for good. Once such a driver goes, the
rule for vehicles that are driven from outside (``caution``) alone says when to wait.
"""

from collections.abc import Mapping
from typing import Final

import libsumo

from siren_ros.traffic.demand.plan import PlannedVehicle
from siren_ros.world.actors import Owner
from siren_ros.world.traffic_state import TrafficFlags, TrafficState

_STANDING_MPS: Final = 0.1
_IGNORED: Final = "junctionModel.ignoreIDs"


class StandOff:
    """Tells SUMO which drivers need not wait for EMVs any more."""

    def __init__(self, emvs: tuple[str, ...]) -> None:
        self._emvs = " ".join(emvs)
        self._going: frozenset[str] = frozenset()

    def apply(self, traffic: TrafficState | None, vehicles: Mapping[int, PlannedVehicle]) -> None:
        """Let those who stand go, until they have left their junction.

        ``traffic`` is the state before SUMO's next step, None before the first one; ``vehicles`` are those in it.
        """
        going = frozenset() if traffic is None else self._who_goes(traffic, vehicles)
        here = {vehicle.name for vehicle in vehicles.values()}
        for name in sorted((going ^ self._going) & here):
            libsumo.vehicle.setParameter(name, _IGNORED, self._emvs if name in going else "")
        self._going = going

    def _who_goes(self, traffic: TrafficState, vehicles: Mapping[int, PlannedVehicle]) -> frozenset[str]:
        inside = (traffic.flags & TrafficFlags.ON_JUNCTION) != 0
        known = [vehicles[actor_id] for actor_id in traffic.actor_id[inside].tolist()]
        by_sumo = (traffic.owner[inside] == Owner.SUMO).tolist()
        stands = (traffic.speed_mps[inside] < _STANDING_MPS).tolist()
        emv_stands = any(still and vehicle.is_emv for vehicle, still in zip(known, stands, strict=True))
        return frozenset(
            vehicle.name
            for vehicle, mine, still in zip(known, by_sumo, stands, strict=True)
            if mine and not vehicle.is_emv and (vehicle.name in self._going or (still and emv_stands))
        )
