"""SUMO alone with its own bluelight device on the EMVs, for comparison: nobody tells SUMO's drivers how to move."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo.population import MIRRORS_M
from siren_ros.simulation.traffic.sumo.rules import RULES, Moment

_OURS: Final = re.compile(rb' lcMaxSpeedLat(Standing|Factor)="[^"]*"')
"""Finds the parameters of lateral motion, because SUMO's own values let vehicles move sideways while they stand."""
_EMV_TYPE: Final = re.compile(rb'(vClass="emergency"[^>]*latAlignment=)"center"')
"""Finds the alignment in an EMV's type, because an EMV with the device needs the whole width of its lane."""


class BluelightSimulation(SumoSimulation):
    """Runs an episode's plan in SUMO alone, which also drives the EMVs and forms their corridor."""

    _rules = tuple(rule for rule in RULES if rule.moment in {Moment.ORDERS, Moment.CORRECTION})

    def _types(self, vehicles: Sequence[PlannedVehicle]) -> bytes:
        bare = [v if v.is_emv else replace(v, width_m=v.width_m - MIRRORS_M) for v in vehicles]
        return _EMV_TYPE.sub(rb'\1"arbitrary"', _OURS.sub(b"", super()._types(bare)))

    def _more_options(self) -> Mapping[str, str]:
        return {"--device.bluelight.explicit": ",".join(vehicle.name for vehicle in self._plan.emvs)}
