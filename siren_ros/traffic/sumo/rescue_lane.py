"""Drivers who open a rescue lane in slow traffic, before any siren, and keep it open.

SUMO drives them: they keep to the side of their lane, and do not change lanes across the corridor.
"""

from collections.abc import Sequence
from typing import Final

import libsumo
import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Flags, Floats
from siren_ros.roads.rescue_lane import rescue_sides
from siren_ros.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.traffic.sumo.mirror import DEFAULT_LANE_CHANGE_MODE, KEEP_LANE_CHANGE_MODE
from siren_ros.traffic.sumo.readings import SPEED, SumoColumns

Sides = npt.NDArray[np.int8]

# No parameters: the law says at which pace the corridor has to be open.
FORMS_BELOW_MPS: Final = 5.5
"""Drivers who slow down to 20 km/h expect to come to walking pace, at which the corridor has to be open; a vehicle
moves sideways only while it drives."""
ENDS_ABOVE_MPS: Final = 8.3
"""Above 30 km/h traffic flows again: vehicles go back to the middle of their lanes."""
_ALIGNMENTS: Final = {1: "left", -1: "right", 0: "center"}


def kept_sides(side: Sides, before: Sides, speed_mps: Floats) -> Sides:
    """The side to which each driver keeps: that of its lane in slow traffic, and as before between the two speeds.

    ``side`` is that of each driver's lane, ``before`` the one kept at the step before; 0 is the middle.
    """
    slow = speed_mps < np.where(before != 0, ENDS_ABOVE_MPS, FORMS_BELOW_MPS)
    return np.where(slow, side, np.int8(0))


class RescueLane:
    """Tells SUMO which drivers keep to the side."""

    def __init__(self, network: RoadNetwork) -> None:
        self._side_of_lane = np.append(rescue_sides(network), np.int8(0))
        """By lane; the last one is that off the road."""
        self._kept: dict[str, int] = {}
        """The side of the drivers who keep to one."""

    def apply(self, columns: SumoColumns, outside: Flags, emvs: Sequence[str]) -> None:
        """Move those to the side who come to a slow pace, and those back to the middle who drive on.

        Vehicles that are moved from outside, and EMVs, are left alone; whoever comes back from there is told again.
        """
        names, kept = columns.names, self._kept
        before = np.array([kept.get(name, 0) for name in names], np.int8)
        side = self._side_of_lane[np.where(columns.lane == NO_LANE, -1, columns.lane)]
        sides = kept_sides(side, before, columns.numbers[SPEED])
        sides[outside | columns.which(emvs)] = 0
        for row in np.flatnonzero(sides != before).tolist():
            name, now = names[row], int(sides[row])
            if not outside[row]:
                libsumo.vehicle.setLateralAlignment(name, _ALIGNMENTS[now])
                libsumo.vehicle.setLaneChangeMode(name, KEEP_LANE_CHANGE_MODE if now else DEFAULT_LANE_CHANGE_MODE)
        self._kept = {names[row]: int(sides[row]) for row in np.flatnonzero(sides).tolist()}
