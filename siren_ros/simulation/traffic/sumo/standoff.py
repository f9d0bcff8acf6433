"""Lets SUMO's drivers on a junction go who would wait for a vehicle from outside that waits there, too.

SUMO lets a driver wait for a vehicle that comes to the same lane on the junction, whoever is ahead. An EMV waits for
the body ahead of it, and civilians who make room for an EMV stay on the junction: they and those who wait for them
would then stand for good. Once such a driver goes, the rule for vehicles that are driven from outside (``caution``)
alone says when to wait.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import libsumo

from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.world.actors import Owner
from siren_ros.simulation.world.traffic_state import TrafficFlags, TrafficState

_IGNORED: Final = "junctionModel.ignoreIDs"
"""SUMO's parameter for ignored vehicles; stand-offs and people at kerbs both add to it."""
_STANDING_MPS: Final = 0.1
_ON_JUNCTION: Final = int(TrafficFlags.ON_JUNCTION)
_BY_SUMO: Final = int(Owner.SUMO)

Passed = Mapping[str, frozenset[str]]
"""For each driver, the vehicles for which the driver need not wait any more, by SUMO's names."""


def drivers_who_go(
    before: Passed, traffic: TrafficState, vehicles: Mapping[int, PlannedVehicle], emvs: frozenset[str]
) -> Passed:
    """The drivers who go, for the next step. A driver who has begun goes on until the junction lies behind.

    ``traffic`` is the state before SUMO's next step, ``vehicles`` are those in it.
    """
    inside = (traffic.flags & _ON_JUNCTION) != 0
    stands, by_sumo = traffic.speed_mps < _STANDING_MPS, traffic.owner == _BY_SUMO
    still = frozenset(vehicles[actor_id].name for actor_id in traffic.actor_id[inside & stands & ~by_sumo].tolist())
    passed = still | emvs if still else still
    mine = inside & by_sumo
    going = {}
    for actor_id, waits in zip(traffic.actor_id[mine].tolist(), stands[mine].tolist(), strict=True):
        name = vehicles[actor_id].name
        if earlier := before.get(name, passed if waits else None):
            going[name] = earlier | passed
    return going


class IgnoredFoes:
    """Tells SUMO which vehicles and people its drivers ignore on junctions."""

    def __init__(self) -> None:
        self._told: dict[str, str] = {}

    def apply(self, drivers: Sequence[str], by_all: Sequence[str], by_driver: Mapping[str, frozenset[str]]) -> None:
        """Tells SUMO the changes since the last call.

        ``drivers`` are SUMO's names of all vehicles, ``by_all`` those for whom none of them waits, ``by_driver`` those
        for whom single drivers do not wait either.
        """
        if not (by_all or by_driver or self._told):
            return
        everybody, told = " ".join(by_all), {}
        for driver in drivers:
            own = by_driver.get(driver)
            names = " ".join((*by_all, *sorted(own))) if own else everybody
            if names != self._told.get(driver, ""):
                libsumo.vehicle.setParameter(driver, _IGNORED, names)
            if names:
                told[driver] = names
        self._told = told


class StandOffs:
    """Tells SUMO's drivers for whom they need not wait: those in a stand-off, and all for people at kerbs."""

    def __init__(self, emvs: frozenset[str] | None) -> None:
        """Takes the EMVs that run red lights; with None no stand-off is looked for."""
        self._emvs = emvs
        self._going: Passed = {}
        self._foes = IgnoredFoes()

    def apply(
        self,
        last: TrafficState | None,
        vehicles: Mapping[int, PlannedVehicle],
        drivers: Sequence[str],
        at_kerbs: Sequence[str],
    ) -> None:
        """Gives the orders for SUMO's next step.

        ``last`` is the state before it, with ``vehicles``; ``drivers`` are all in SUMO.
        """
        if self._emvs is not None and last is not None:
            self._going = drivers_who_go(self._going, last, vehicles, self._emvs)
        self._foes.apply(drivers, at_kerbs, self._going)
