"""Makes planned vehicles: body, paint, driver and route drawn from a generator."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.roads.routing import EdgeGraph
from siren_ros.traffic.demand.demand_config import DemandConfig
from siren_ros.traffic.demand.driver_models import DriverModel, DriverPopulation
from siren_ros.traffic.demand.plan import PlannedVehicle, Spot
from siren_ros.traffic.demand.route_choice import RouteChooser
from siren_ros.world.actors import ActorClass

Dimensions = tuple[float, float, float]
"""Length, width and height in metres."""
Shares = Sequence[tuple[ActorClass, float]]

_PAINTS: Final = (
    ((236, 236, 234), 0.26),
    ((28, 29, 31), 0.21),
    ((128, 131, 134), 0.19),
    ((186, 189, 192), 0.12),
    ((36, 58, 106), 0.10),
    ((134, 24, 28), 0.07),
    ((52, 82, 58), 0.02),
    ((188, 162, 118), 0.02),
    ((176, 84, 32), 0.01),
)
"""Paints and their shares: white, black, grey, silver, blue, red, green, beige, orange (rounded from the
yearly colour popularity reports of automotive paint makers)."""
_EMV_PAINT: Final = (240, 240, 236)


class VehicleFactory:
    """Draws vehicles for one network, population and table of dimensions."""

    def __init__(
        self,
        network: RoadNetwork,
        drivers: DriverPopulation,
        dimensions: Mapping[ActorClass, Dimensions],
        config: DemandConfig,
    ) -> None:
        self._network = network
        self._drivers = drivers
        self._dimensions = dimensions
        self._config = config
        self._graph = EdgeGraph.of(network)
        self._routes = RouteChooser(network, self._graph, config)
        self._suited: dict[tuple[ActorClass, tuple[int, ...]], tuple[int, ...]] = {}

    def leads_on(self, edge: int) -> bool:
        """Whether civilians can drive on from an edge."""
        return bool(self._graph.successors[edge])

    def size(self, actor_class: ActorClass) -> Dimensions:
        """Dimensions of a class; InputError where they are missing."""
        if actor_class not in self._dimensions:
            raise InputError("dimensions", actor_class.name, "length, width and height of every vehicle class")
        return self._dimensions[actor_class]

    def suited_lanes(self, actor_class: ActorClass, lanes: tuple[int, ...]) -> tuple[int, ...]:
        """The lanes from which a vehicle of a class can drive on without bends too tight for it."""
        found = self._suited.get((actor_class, lanes))
        if found is None:  # asked for every vehicle that is drawn, of the same lanes
            length_m = self.size(actor_class)[0]
            found = tuple(lane for lane in lanes if self._routes.leads_on(lane, length_m))
            self._suited[actor_class, lanes] = found
        return found

    def can_follow(self, actor_class: ActorClass, edges: Sequence[int]) -> bool:
        """Whether a vehicle of a class can drive along edges without bends too tight for it."""
        length_m = self.size(actor_class)[0]
        return all(self._routes.fits(edge, following, None, length_m) for edge, following in pairwise(edges))

    def draw_class(self, shares: Shares, rng: np.random.Generator, lanes: tuple[int, ...] = ()) -> ActorClass:
        """A vehicle class by its share, of those that suit one of the driving lanes; of all where none does."""
        shares = [one for one in shares if self.suited_lanes(one[0], lanes)] or shares
        weights = np.array([share for _, share in shares])
        return shares[int(rng.choice(len(shares), p=weights / weights.sum()))][0]

    def draw_driver(self, actor_class: ActorClass, rng: np.random.Generator, speed_scale: float = 1.0) -> DriverModel:
        """A driver for a vehicle of the class."""
        return self._drivers.draw(actor_class, rng, speed_scale)

    def length_m(self, way: Sequence[int]) -> float:
        """Length of a way along its edges."""
        return self._graph.route_length_m(way)

    def draw_way(self, start: Sequence[int], length_m: float, rng: np.random.Generator) -> tuple[int, ...]:
        """A random way for an EMV of at least ``length_m`` (or to a dead end) that begins with the given edges."""
        return self._routes.draw(start, length_m, rng, 0.0, turn_weight=self._config.emv_turn_weight)

    def draw_route(
        self, start: Sequence[int], length_m: float, rng: np.random.Generator, lane: int, actor_class: ActorClass
    ) -> tuple[str, ...]:
        """Edge ids of a civilian's route from a lane.

        Of the edges that it should begin with, it keeps those to which the lane leads and the vehicle fits.
        """
        vehicle_m = self.size(actor_class)[0]
        kept = list(start[:1])
        for edge, following in pairwise(start):
            if not self._routes.fits(edge, following, lane if len(kept) == 1 else None, vehicle_m):
                break
            kept.append(following)
        way = self._routes.draw(kept, length_m, rng, vehicle_m, lane if len(kept) == 1 else None)
        return tuple(self._network.edges[edge].edge_id for edge in way)

    def civilian(
        self,
        name: str,
        actor_class: ActorClass,
        driver: DriverModel,
        route: tuple[str, ...],
        spot: Spot,
        rng: np.random.Generator,
    ) -> PlannedVehicle:
        """A civilian vehicle in a drawn paint."""
        weights = np.array([share for _, share in _PAINTS])
        paint = _PAINTS[int(rng.choice(len(_PAINTS), p=weights / weights.sum()))][0]
        return PlannedVehicle(name, actor_class, *self.size(actor_class), paint, driver, route, spot)

    def emv(
        self, name: str, actor_class: ActorClass, driver: DriverModel, route: tuple[str, ...], spot: Spot
    ) -> PlannedVehicle:
        """An emergency vehicle."""
        return PlannedVehicle(name, actor_class, *self.size(actor_class), _EMV_PAINT, driver, route, spot, is_emv=True)
