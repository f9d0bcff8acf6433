"""Drivers who open a rescue lane in slow traffic, before any siren, and keep it open.

SUMO drives them: they keep to the side of their lane, and do not change lanes across the corridor. Motorcyclists who
filter keep to the other side of theirs, behind an EMV.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import libsumo
import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.simulation.roads.rescue_lane import rescue_sides
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.traffic.sumo.filtering import FilteringRiders
from siren_ros.simulation.traffic.sumo.mirror import DEFAULT_LANE_CHANGE_MODE, KEEP_LANE_CHANGE_MODE
from siren_ros.simulation.traffic.sumo.readings import ANGLE, SPEED, SumoColumns, X, Y

Sides = npt.NDArray[np.int8]

# These are no parameters: the law says at which pace the corridor has to be open.
FORMS_BELOW_MPS: Final = 11.1
"""Speed below which drivers open the rescue lane. Drivers who slow down to 40 km/h out of town come to a jam, in which
the corridor has to be open at walking pace; a vehicle moves sideways only while it drives."""
ENDS_ABOVE_MPS: Final = 16.7
"""Speed above which traffic flows again, so that vehicles go back to the middle of their lanes: 60 km/h."""
COMES_WITHIN_M: Final = 150.0
"""Distance to slow vehicles ahead within which faster drivers open the rescue lane and stay in their lane: nobody
drives past the end of a jam into the corridor. From 130 km/h one comes to a stand within it at 4.3 m/s²."""
_ROAD_M: Final = 15.0
"""Lateral distance beyond which vehicles are on another carriageway, or far behind a bend."""
_ALIGNMENTS: Final = {1: "left", -1: "right", 0: "center"}


def kept_sides(side: Sides, before: Sides, speed_mps: Floats, comes: Flags) -> Sides:
    """The side to which each driver keeps: that of its lane in slow traffic, and as before between the two speeds.

    ``side`` is that of each driver's lane, ``before`` the one kept at the step before; 0 is the middle. ``comes`` says
    who has a jam close ahead.
    """
    slow = speed_mps < np.where(before != 0, ENDS_ABOVE_MPS, FORMS_BELOW_MPS)
    return np.where(slow | comes, side, np.int8(0))


def coming_to_jam(x_m: Floats, y_m: Floats, angle_deg: Floats, speed_mps: Floats, on_road: Flags) -> Flags:
    """Which vehicles have a slow one close ahead on their road; ``on_road`` is who is on a road with the duty.

    Angles are SUMO's: clockwise from north.
    """
    slow = np.flatnonzero(on_road & (speed_mps < FORMS_BELOW_MPS))
    fast = np.flatnonzero(on_road & (speed_mps >= FORMS_BELOW_MPS))
    dx, dy = x_m[slow] - x_m[fast, None], y_m[slow] - y_m[fast, None]
    sin, cos = np.sin(np.radians(angle_deg[fast, None])), np.cos(np.radians(angle_deg[fast, None]))
    ahead_m, aside_m = sin * dx + cos * dy, cos * dx - sin * dy
    same = np.cos(np.radians(angle_deg[slow] - angle_deg[fast, None])) > 0.5
    near = same & (ahead_m > 0.0) & (ahead_m < COMES_WITHIN_M) & (np.abs(aside_m) < _ROAD_M)
    comes = np.zeros(len(x_m), np.bool_)
    comes[fast] = np.any(near, axis=1)
    return comes


class RescueLane:
    """Tells SUMO which drivers keep to the side."""

    def __init__(self, network: RoadNetwork, *, filtering: bool) -> None:
        """Takes the road network and whether a motorcyclist of the episode may filter (``filtering``)."""
        self._side_of_lane = np.append(rescue_sides(network), np.int8(0))
        """By lane; the last one is that off the road."""
        self._kept: dict[str, int] = {}
        """The side of the drivers who keep to one."""
        self._riders = FilteringRiders(network) if filtering else None

    def apply(
        self, columns: SumoColumns, vehicles: Mapping[str, PlannedVehicle], outside: Flags, emvs: Sequence[str]
    ) -> None:
        """Moves drivers to the side when they slow down, and back to the middle when they drive on.

        Vehicles that are moved from outside, and EMVs, are left alone; whoever comes back from there is told again.
        """
        names, kept = columns.names, self._kept
        before = np.array([kept.get(name, 0) for name in names], np.int8)
        side = self._side_of_lane[np.where(columns.lane == NO_LANE, -1, columns.lane)]
        numbers = columns.numbers
        comes = coming_to_jam(numbers[X], numbers[Y], numbers[ANGLE], numbers[SPEED], side != 0)
        sides = kept_sides(side, before, numbers[SPEED], comes)
        sides[outside | columns.which(emvs)] = 0
        if self._riders is not None:
            sides = np.where(self._riders.apply(columns, vehicles, sides != 0, emvs), -sides, sides)
        for row in np.flatnonzero(sides != before).tolist():
            name, now = names[row], int(sides[row])
            if not outside[row]:
                libsumo.vehicle.setLateralAlignment(name, _ALIGNMENTS[now])
                libsumo.vehicle.setLaneChangeMode(name, KEEP_LANE_CHANGE_MODE if now else DEFAULT_LANE_CHANGE_MODE)
        self._kept = {names[row]: int(sides[row]) for row in np.flatnonzero(sides).tolist()}
