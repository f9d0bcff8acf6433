"""Motorcyclists who filter: they ride through the rescue lane behind an EMV, past vehicles that stand next to it.

SUMO drives them: they keep to that edge of their lane at which the rescue lane is, so that others who keep to the other
edge are beside them. Where somebody is too wide for that, they stay behind.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import libsumo
import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.simulation.roads.rescue_lane import rescue_sides
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.traffic.sumo.population import MIRRORS_M
from siren_ros.simulation.traffic.sumo.readings import ANGLE, SumoColumns, X, Y

# These are no parameters: studies vary the share of those who filter.
FASTEST_MPS: Final = 30.0 / 3.6
"""Largest speed of motorcyclists who filter: 30 km/h, where the law permits it (New South Wales, Road Rules 2014,
151A)."""
KEEPS_M: Final = 12.0
"""Distance between the front bumpers that a rider keeps behind an EMV: an ambulance of 6 m and a gap."""
_HEADWAY_S: Final = 1.5
WITHIN_M: Final = 250.0
"""Largest distance behind an EMV at which a rider filters; farther behind, the rescue lane is for the next EMV. A
vehicle moves sideways only while it drives: in stop-and-go traffic half a minute passes until one who stands has the
space to leave the row."""
BESIDE_M: Final = (-10.0, 40.0)
"""Least and greatest distance ahead at which waiting vehicles count. Riders who have come past them drive as usual."""
NEXT_M: Final = 150.0
"""Distance behind a rider within which another EMV forbids filtering."""
ROAD_M: Final = 15.0
"""Lateral distance beyond which a vehicle is on another road, on a straight road."""
BEND: Final = 0.3
"""Share of the distance ahead that is added to it in bends: enough 200 m ahead in a bend of 360 m radius."""
_MARGIN_M: Final = 0.2
"""Margin that is added to a rider's width, which is measured over the mirrors."""
_STEP_MPS: Final = 0.5
"""Speeds are multiples of this, so that they are seldom set."""


def _on_road(riders: Floats, others: Floats) -> tuple[Floats, Flags]:
    """How far ahead of each rider each of the others is, and whether they are on the same road."""
    dx, dy = others[0] - riders[0, :, None], others[1] - riders[1, :, None]
    sin, cos = np.sin(np.radians(riders[2, :, None])), np.cos(np.radians(riders[2, :, None]))
    ahead_m, aside_m = sin * dx + cos * dy, cos * dx - sin * dy
    near = np.abs(aside_m) < ROAD_M + BEND * np.abs(ahead_m)
    return ahead_m, near & (np.cos(np.radians(others[2] - riders[2, :, None])) > 0.5)


def passing(riders: Floats, others: Floats) -> Flags:
    """Which riders have somebody beside them or close ahead, of others who wait; arguments as for the speeds."""
    ahead_m, same = _on_road(riders, others)
    return np.any(same & (ahead_m > BESIDE_M[0]) & (ahead_m < BESIDE_M[1]), axis=1)


def filter_speeds_mps(riders: Floats, emvs: Floats) -> Floats:
    """How fast each rider follows the nearest EMV that has passed, shape ``(N,)``; 0 for those who do not follow one.

    Both are x, y and angle of the front bumper, shape ``(3, N)``; angles are SUMO's: clockwise from north.
    """
    ahead_m, same = _on_road(riders, emvs)
    passed, comes = same & (ahead_m > KEEPS_M), same & (ahead_m <= KEEPS_M) & (ahead_m > -NEXT_M)
    gap_m = np.where(passed, ahead_m, np.inf).min(axis=1, initial=np.inf)
    follows = (gap_m < WITHIN_M) & ~comes.any(axis=1)
    wished = np.clip((np.minimum(gap_m, WITHIN_M) - KEEPS_M) / _HEADWAY_S, 0.0, FASTEST_MPS)
    return np.where(follows, np.maximum(_STEP_MPS * np.floor(wished / _STEP_MPS), _STEP_MPS), 0.0)


class FilteringRiders:
    """Tells SUMO the width and the speed of riders who filter."""

    def __init__(self, network: RoadNetwork) -> None:
        self._limit_mps = np.array([lane.speed_limit_mps for lane in network.lanes])
        self._beside = np.zeros(len(network.lanes) + 1, np.bool_)
        """Whether a lane is beside the rescue lane; the last one is that off the road."""
        leftmost = np.flatnonzero(rescue_sides(network) > 0).tolist()
        for lane in (network.lanes[index] for index in leftmost):
            edge = network.edges[lane.edge].lanes
            self._beside[[index for index in edge if network.lanes[index].position >= lane.position - 1]] = True
        self._told: dict[str, float] = {}
        """Speed factors of those who filter."""

    def apply(
        self, columns: SumoColumns, vehicles: Mapping[str, PlannedVehicle], slow: Flags, emvs: Sequence[str]
    ) -> Flags:
        """Decides who filters in SUMO's next step, among riders who keep to a side in slow traffic (``slow``)."""
        rides = columns.which([name for name, vehicle in vehicles.items() if vehicle.filters])
        rows = np.flatnonzero(rides & slow & self._beside[np.where(columns.lane == NO_LANE, -1, columns.lane)])
        poses = columns.numbers[[X, Y, ANGLE]]
        rows = rows[passing(poses[:, rows], poses[:, slow & ~rides])]
        speeds_mps = filter_speeds_mps(poses[:, rows], poses[:, columns.which(emvs)])
        rows, speeds_mps = rows[speeds_mps > 0.0], speeds_mps[speeds_mps > 0.0]
        factors = (speeds_mps / self._limit_mps[columns.lane[rows]]).tolist()
        now = {columns.names[row]: factor for row, factor in zip(rows.tolist(), factors, strict=True)}
        for name in sorted((now.keys() | self._told.keys()) & columns.row_of.keys()):
            vehicle, factor = vehicles[name], now.get(name)
            if (factor is None) != (name not in self._told):
                libsumo.vehicle.setWidth(name, vehicle.width_m + (MIRRORS_M if factor is None else _MARGIN_M))
            if factor != self._told.get(name):
                libsumo.vehicle.setSpeedFactor(name, vehicle.driver.speed_factor if factor is None else factor)
        self._told = now
        return columns.which(now)
