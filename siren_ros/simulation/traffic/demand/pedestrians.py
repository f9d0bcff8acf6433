"""Plans pedestrians, who start on sidewalks near the EMV's way and walk from one street to the next."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import chances, drawn, random_stream
from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import Lane, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.presets import TruncatedNormal
from siren_ros.simulation.traffic.demand.plan import PlannedWalker
from siren_ros.simulation.traffic.demand.vehicle_factory import VehicleFactory
from siren_ros.simulation.world.actors import ActorClass

PACE_MPS: Final = TruncatedNormal(mean=1.34, std=0.26, minimum=0.7, maximum=2.0)
"""Free walking speeds (Weidmann 1993: 1.34 m/s with a standard deviation of 0.26 m/s)."""
_GOALS: Final = 5
"""Number of streets that a pedestrian walks to in turn, where a way leads: more than an episode lasts."""
_ROOM_M: Final = 4.0
"""Least length of sidewalk for each pedestrian, so that fewer walk on a map with few sidewalks."""
_CLOTHES: Final = (
    (44, 52, 74),
    (122, 40, 44),
    (60, 92, 70),
    (196, 186, 164),
    (92, 92, 98),
    (188, 132, 52),
    (32, 34, 38),
)


def plan_walkers(
    network: RoadNetwork, near: Sequence[Lane], count: int, spares: float, seed: int, factory: VehicleFactory
) -> tuple[tuple[PlannedWalker, ...], int]:
    """Plans pedestrians evenly on the sidewalks along some driving lanes, and how many of them walk at once.

    There are ``spares`` more for each of these.

    Raises:
        MapError: No street there has a sidewalk.
    """
    if count == 0:
        return (), 0
    edges = dict.fromkeys(lane.edge for lane in near)
    beside = [network.lanes[index] for edge in edges for index in network.edges[edge].lanes]
    walks = [lane for lane in beside if lane.kind is LaneKind.SIDEWALK]
    if not walks:
        raise MapError(f"{count} pedestrians", "a map with sidewalks near the EMV's way")
    rng = random_stream(seed, "demand/pedestrians")
    ends, size = chances(lane.length_m for lane in walks), factory.size(ActorClass.PEDESTRIAN)
    kept = min(count, max(1, int(sum(lane.length_m for lane in walks) / _ROOM_M)))
    names = (f"pedestrian{number}" for number in range(round((1.0 + spares) * kept)))
    return tuple(_walker(network, walks, ends, name, size, rng) for name in names), kept


def _walker(
    network: RoadNetwork,
    walks: Sequence[Lane],
    ends: np.ndarray[tuple[int], np.dtype[np.float64]],
    name: str,
    size: tuple[float, float, float],
    rng: np.random.Generator,
) -> PlannedWalker:
    lane = walks[drawn(ends, rng)]
    place_m = float(rng.uniform(0.0, lane.length_m))
    goals = (network.edges[walks[drawn(ends, rng)].edge].edge_id for _ in range(_GOALS))
    clothes = _CLOTHES[int(rng.integers(len(_CLOTHES)))]
    return PlannedWalker(
        name, *size, clothes, PACE_MPS.draw(rng), network.edges[lane.edge].edge_id, place_m, tuple(goals)
    )
