"""Makes planned vehicles and pedestrians: body, paint, driver and route drawn from a generator.

At junctions civilians go mostly straight on, from their own lane, on bends that the vehicle can take. Sizes of vehicles
vary within their class where a study asks for it. Pedestrians start on sidewalks near the EMV's way and walk from one
street to the next.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, chances, drawn, random_stream
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.errors import InputError, MapError
from siren_ros.simulation.roads.road_network import MAPS_KEPT, Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph, civilian_movements
from siren_ros.simulation.scenario.presets import TruncatedNormal
from siren_ros.simulation.traffic.demand.plan import (
    DriverModel,
    DriverPopulation,
    PlannedVehicle,
    PlannedWalker,
    Spot,
    TrafficPlan,
)
from siren_ros.simulation.world.actors import ActorClass

_BEND_M: Final = 6.0
"""Length over which the bend of a lane is measured: a wheelbase of the longest vehicles."""
_TURNS: Final = frozenset({"l", "r", "t"})
"""SUMO's letters of left turns, right turns and turnarounds; partial turns follow the road."""


@dataclass(frozen=True)
class _Way:
    """The ways from an edge to one following edge, taken together."""

    edge: int
    lanes: tuple[int, ...]
    """Driving lanes that lead there."""
    turns: bool
    """Whether it is a turn, not the way straight on."""
    left: bool
    """Whether it is a left turn."""
    radius_m: float
    """Radius of the tightest bend, on the widest of the paths."""


_TURN_WEIGHT: Final = 0.35
"""Chance of a turn at a junction, per lane that leads there, relative to straight on: about three of four drivers
go straight on where three lanes lead straight, left and right (typical value of urban turning counts)."""
_CAR_RADIUS_M: Final = 5.5
"""No vehicle takes a tighter bend than this where there is another way: the turning circle of cars."""
_STEERED_RADIUS_M: Final = 4.1
"""Radius of the middle of a car whose outer front wheel is on its turning circle, with a wheelbase of 2.7 m."""
LONG_VEHICLE_M: Final = 8.0
"""Length from which a vehicle counts as long, so that it avoids tight bends."""
LONG_VEHICLE_RADIUS_M: Final = 12.5
"""Least radius of bends for long vehicles: the centre of a turning lane that a 12 m bus follows without swinging out
(Directive 97/27/EC: outer turning radius of 12.5 m at most)."""


class RouteChooser:
    """Draws routes at random. It looks up the ways from each edge only once."""

    def __init__(self, network: RoadNetwork, graph: EdgeGraph) -> None:
        self._network = network
        self._graph = graph
        self._ways: dict[int, tuple[_Way, ...]] = {}
        self._lasting: dict[float, frozenset[int]] = {}
        self._choices: dict[tuple[int, bool, int | None, float, bool], tuple[tuple[int, ...], list[float], Floats]] = {}
        """Edges to choose from, weights, chances: by edge, whether the vehicle is long, lane, weight of turns, and
        whether left turns are among them."""
        self._endless = graph.endless_edges

    def leads_on(self, lane: int, vehicle_m: float) -> bool:
        """Whether a long vehicle can drive on from a lane without coming to where all ways are too tight for it.

        Other vehicles lead on from everywhere: what is too tight for them, they drive slowly.
        """
        edge = self._network.lanes[lane].edge
        if vehicle_m <= LONG_VEHICLE_M or not self._ways_from(edge):
            return True
        return any(lane in way.lanes for way in self._wide_ways(edge, vehicle_m))

    def fits(self, edge: int, following: int, lane: int | None, vehicle_m: float) -> bool:
        """Whether a lane (None: any) leads from an edge to another one, without a bend too tight for a vehicle."""
        least_m = self._least_radius_m(vehicle_m)
        return any(
            way.edge == following and (lane is None or lane in way.lanes) and way.radius_m >= least_m
            for way in self._ways_from(edge)
        )

    def draw(
        self,
        start: Sequence[int],
        length_m: float,
        rng: np.random.Generator,
        vehicle_m: float,
        lane: int | None = None,
        *,
        turn_weight: float | None = None,
        lasting_m: float = 0.0,
        turns_left: bool = True,
    ) -> tuple[int, ...]:
        """A random route of at least ``length_m``, or to where the map ends.

        It leaves the map within ``lasting_m`` only where there is no other way. At each junction a way is as likely as
        it has lanes, and turns less likely than straight on by the weight of a turn. Long vehicles keep off tight
        bends, and off roads that lead to nothing else, as bus lines and lorry routes do, wherever there is another way.

        The length includes the given edges. The way on begins in ``lane`` of the last given edge, on which the vehicle
        stands, unless all its ways are too tight for the vehicle. Without a weight, turns have that of civilians. Who
        does not turn left does so only where there is no other way.
        """
        route = list(start)
        driven_m = self._graph.route_length_m(start)
        turn_weight = _TURN_WEIGHT if turn_weight is None else turn_weight
        while driven_m < length_m:
            key = route[-1], vehicle_m > LONG_VEHICLE_M, lane, turn_weight, turns_left
            if key not in self._choices:
                ways = self._open_ways(route[-1], vehicle_m, lane)
                ways = tuple(way for way in ways if turns_left or not way.left) or ways
                weights = [len(way.lanes) * (turn_weight if way.turns else 1.0) for way in ways]
                self._choices[key] = tuple(way.edge for way in ways), weights, chances(weights) if ways else np.empty(0)
            edges, weights, ends = self._choices[key]
            if not edges:
                break
            lasting = [place for place, edge in enumerate(edges) if self._lasts(edge, lasting_m - driven_m)]
            if 0 < len(lasting) < len(edges):
                edges, ends = tuple(edges[place] for place in lasting), chances([weights[place] for place in lasting])
            route.append(edges[drawn(ends, rng)])
            driven_m += self._graph.length_m[route[-1]]
            lane = None
        return tuple(route)

    def _lasts(self, edge: int, missing_m: float) -> bool:
        """Whether a route over an edge can be as long as it has to be."""
        return edge in self._endless or self._graph.length_m[edge] >= missing_m

    def _open_ways(self, edge: int, vehicle_m: float, lane: int | None) -> tuple[_Way, ...]:
        """The ways to choose from: those that are wide enough and start in the lane.

        Without any, those that meet one condition: a short vehicle turns slowly in its lane where it can, others leave
        it.
        """
        ways, least_m = self._ways_from(edge), self._least_radius_m(vehicle_m)
        mine = tuple(way for way in ways if lane is None or lane in way.lanes)
        slow = tuple(way for way in mine if vehicle_m <= LONG_VEHICLE_M and way.radius_m >= _STEERED_RADIUS_M)
        for wide in (self._wide_ways(edge, vehicle_m), tuple(way for way in ways if way.radius_m >= least_m)):
            both = tuple(way for way in wide if way in mine)
            if both or (wide and not slow):
                return both or wide
        return slow or mine or ways

    def _wide_ways(self, edge: int, vehicle_m: float) -> tuple[_Way, ...]:
        """The ways that are wide enough, and lead to others that are."""
        least_m = self._least_radius_m(vehicle_m)
        wide = tuple(way for way in self._ways_from(edge) if way.radius_m >= least_m)
        if vehicle_m <= LONG_VEHICLE_M:
            return wide
        return tuple(way for way in wide if way.edge in self._lasting_edges(least_m))

    def _lasting_edges(self, least_m: float) -> frozenset[int]:
        """Edges from which a vehicle can drive for ever or off the map without a tighter bend than a radius."""
        if least_m not in self._lasting:
            kept = set(range(len(self._graph.successors)))
            gone = {-1}
            while gone:
                gone = {
                    edge
                    for edge in kept
                    if self._ways_from(edge)
                    and not any(way.radius_m >= least_m and way.edge in kept for way in self._ways_from(edge))
                }
                kept -= gone
            self._lasting[least_m] = frozenset(kept)
        return self._lasting[least_m]

    def _least_radius_m(self, vehicle_m: float) -> float:
        return LONG_VEHICLE_RADIUS_M if vehicle_m > LONG_VEHICLE_M else _CAR_RADIUS_M

    def _ways_from(self, edge: int) -> tuple[_Way, ...]:
        if edge not in self._ways:
            self._ways[edge] = tuple(self._way(edge, following) for following in self._graph.successors[edge])
        return self._ways[edge]

    def _way(self, edge: int, following: int) -> _Way:
        movements = civilian_movements(self._network, edge, following)
        lanes = tuple(dict.fromkeys(movement.from_lane for movement in movements))
        radius_m = max(self.radius_m(movement) for movement in movements)
        return _Way(following, lanes, movements[0].direction in _TURNS, movements[0].direction == "l", radius_m)

    def radius_m(self, movement: Connection) -> float:
        """Radius of a movement's tightest bend, on the junction and 6 m before and behind it; infinite if straight."""
        before, after = (self._network.lanes[lane].centre for lane in (movement.from_lane, movement.to_lane))
        across = [self._network.lanes[lane].centre for lane in movement.via]
        parts = [before.cut(max(before.length_m - _BEND_M, 0.0), before.length_m), *across]
        return tightest_radius_m(Polyline.joined([*parts, after.cut(0.0, min(_BEND_M, after.length_m))]))


def tightest_radius_m(path: Polyline) -> float:
    """Radius of a path's tightest bend, measured over the length of a wheelbase; infinite where it is straight."""
    end_m = path.length_m
    from_m = np.arange(0.0, max(end_m - _BEND_M, 0.0) + 1.0)
    to_m = np.minimum(from_m + _BEND_M, end_m)
    turned = np.abs(wrap_angle(path.heading_rad(to_m) - path.heading_rad(from_m)))
    bend_1pm = np.max(turned / np.maximum(to_m - from_m, 1e-6))
    return float(1.0 / bend_1pm) if bend_1pm > 0.0 else np.inf


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
_PAINT_ENDS: Final = chances(share for _, share in _PAINTS)


def draw_paint(rng: np.random.Generator) -> tuple[int, int, int]:
    """A paint by its share."""
    return _PAINTS[drawn(_PAINT_ENDS, rng)][0]


_EMV_PAINT: Final = (240, 240, 236)


@lru_cache(maxsize=MAPS_KEPT)
def _route_chooser(network: RoadNetwork) -> RouteChooser:
    return RouteChooser(network, EdgeGraph.of(network))


_LASTING_SHARE: Final = 0.5
"""Part of a route within which it leaves the map only where there is no other way: what is driven at 30 km/h. Who
leaves the map earlier is gone before the EMV's eyes."""
_EMV_TURN_WEIGHT: Final = 0.1
"""Chance of a turn of an EMV beyond the site, defined as for civilians: the fastest way follows main roads."""


class VehicleFactory:
    """Draws vehicles for one road network, driver population and table of dimensions."""

    def __init__(
        self,
        network: RoadNetwork,
        drivers: DriverPopulation,
        dimensions: Mapping[ActorClass, Dimensions],
    ) -> None:
        self._network = network
        self._drivers = drivers
        self._dimensions = dimensions
        self._graph = EdgeGraph.of(network)
        self._routes = _route_chooser(network)
        self._suited: dict[tuple[ActorClass, tuple[int, ...]], tuple[int, ...]] = {}
        self._classes: dict[tuple[Shares, tuple[int, ...]], tuple[list[ActorClass], Floats]] = {}

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
        key = actor_class, lanes
        if key not in self._suited:  # the same lanes are asked for again with every drawn vehicle
            length_m = self.size(actor_class)[0]
            self._suited[key] = tuple(lane for lane in lanes if self._routes.leads_on(lane, length_m))
        return self._suited[key]

    def can_follow(self, actor_class: ActorClass, edges: Sequence[int]) -> bool:
        """Whether a vehicle of a class can drive along edges without bends too tight for it."""
        length_m = self.size(actor_class)[0]
        return all(self._routes.fits(edge, following, None, length_m) for edge, following in pairwise(edges))

    def draw_class(self, shares: Shares, rng: np.random.Generator, lanes: tuple[int, ...] = ()) -> ActorClass:
        """A vehicle class by its share, of those that suit one of the driving lanes; of all where none does."""
        key = tuple(shares), lanes
        if key not in self._classes:
            suited = [share for share in shares if self.suited_lanes(share[0], lanes)] or shares
            self._classes[key] = [kind for kind, _ in suited], chances(share for _, share in suited)
        classes, ends = self._classes[key]
        return classes[drawn(ends, rng)]

    def draw_driver(self, actor_class: ActorClass, rng: np.random.Generator, speed_scale: float = 1.0) -> DriverModel:
        """A driver for a vehicle of the class."""
        return self._drivers.draw(actor_class, rng, speed_scale)

    def length_m(self, way: Sequence[int]) -> float:
        """Length of a way along its edges."""
        return self._graph.route_length_m(way)

    def draw_way(self, start: Sequence[int], length_m: float, rng: np.random.Generator) -> tuple[int, ...]:
        """A random way for an EMV of at least ``length_m`` (or to a dead end) that begins with the given edges."""
        return self._routes.draw(start, length_m, rng, 0.0, turn_weight=_EMV_TURN_WEIGHT, lasting_m=length_m)

    def draw_route(
        self, start: Sequence[int], length_m: float, rng: np.random.Generator, lane: int, actor_class: ActorClass
    ) -> tuple[str, ...]:
        """Edge ids of a civilian's route from a lane.

        Of the edges that it should begin with, it keeps those to which the lane leads and the vehicle fits. Cyclists,
        who keep to the right, do not turn left where they can go on otherwise.
        """
        vehicle_m = self.size(actor_class)[0]
        kept = list(start[:1])
        for edge, following in pairwise(start):
            if not self._routes.fits(edge, following, lane if len(kept) == 1 else None, vehicle_m):
                break
            kept.append(following)
        first, lasting_m = lane if len(kept) == 1 else None, _LASTING_SHARE * length_m
        left = actor_class is not ActorClass.BICYCLE
        way = self._routes.draw(kept, length_m, rng, vehicle_m, first, lasting_m=lasting_m, turns_left=left)
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
        paint = draw_paint(rng)
        return PlannedVehicle(name, actor_class, *self.size(actor_class), paint, driver, route, spot)

    def emv(
        self, name: str, actor_class: ActorClass, driver: DriverModel, route: tuple[str, ...], spot: Spot
    ) -> PlannedVehicle:
        """Makes an emergency vehicle for the plan."""
        return PlannedVehicle(name, actor_class, *self.size(actor_class), _EMV_PAINT, driver, route, spot, is_emv=True)


WIDEST_M: Final = 2.55
"""No vehicle is wider, unless its whole class is (Directive 96/53/EC)."""


def largest(dimensions: Mapping[ActorClass, Dimensions], spread: float) -> dict[ActorClass, Dimensions]:
    """The largest sizes that can be drawn.

    Traffic is planned for them, so that every drawn vehicle has enough space.
    """
    more = 1.0 + spread
    return {kind: (more * length, more * width, more * height) for kind, (length, width, height) in dimensions.items()}


def varied_size(size: Dimensions, spread: float, seed: int, name: str) -> Dimensions:
    """A size that is drawn about that of the class: each dimension up to the share ``spread`` smaller or larger."""
    draws = random_stream(seed, f"sizes/{name}").uniform(1.0 - spread, 1.0 + spread, 3)
    length, width, height = (round(of_class * float(draw), 2) for of_class, draw in zip(size, draws, strict=True))
    return length, min(width, max(WIDEST_M, size[1])), height


def with_sizes(plan: TrafficPlan, dimensions: Mapping[ActorClass, Dimensions], spread: float, seed: int) -> TrafficPlan:
    """The plan whose vehicles have sizes drawn about those of their classes, whatever else is drawn."""

    def drawn(vehicles: tuple[PlannedVehicle, ...]) -> tuple[PlannedVehicle, ...]:
        sizes = [varied_size(dimensions[one.actor_class], spread, seed, one.name) for one in vehicles]
        return tuple(
            replace(one, length_m=length, width_m=width, height_m=height)
            for one, (length, width, height) in zip(vehicles, sizes, strict=True)
        )

    return replace(
        plan,
        emvs=drawn(plan.emvs),
        groups=drawn(plan.groups),
        background=drawn(plan.background),
        reserve=drawn(plan.reserve),
        riders=drawn(plan.riders),
    )


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
