"""For whom SUMO's drivers do not wait on junctions: one parameter of SUMO, to which several rules add."""

from collections.abc import Mapping, Sequence
from typing import Final

import libsumo

_IGNORED: Final = "junctionModel.ignoreIDs"


class IgnoredFoes:
    """What SUMO was told."""

    def __init__(self) -> None:
        self._told: dict[str, str] = {}

    def apply(self, drivers: Sequence[str], by_all: Sequence[str], by_driver: Mapping[str, frozenset[str]]) -> None:
        """Tell SUMO about the drivers for whom something has changed.

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
