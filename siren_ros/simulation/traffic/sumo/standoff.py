"""Drivers of SUMO who stand on a junction do not wait for vehicles driven from outside that stand there as well.

SUMO lets a driver wait for a vehicle that comes to the same lane on the junction, whoever is ahead. An EMV waits for
the body ahead of it, and civilians who make room for an EMV stay on the junction: they and those who wait for them
would then stand for good. Once such a driver goes, the rule for vehicles that are driven from outside (``caution``)
alone says when to wait.
"""

from collections.abc import Mapping
from typing import Final

from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.world.actors import Owner
from siren_ros.simulation.world.traffic_state import TrafficFlags, TrafficState

_STANDING_MPS: Final = 0.1
_ON_JUNCTION: Final = int(TrafficFlags.ON_JUNCTION)
_BY_SUMO: Final = int(Owner.SUMO)

Passed = Mapping[str, frozenset[str]]
"""For whom drivers need not wait any more, by SUMO's names."""


def drivers_who_go(
    before: Passed, traffic: TrafficState, vehicles: Mapping[int, PlannedVehicle], emvs: frozenset[str]
) -> Passed:
    """Those who go, one step later: who begins goes on until the junction lies behind.

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
