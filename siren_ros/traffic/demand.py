"""From a template and a site to a traffic plan: who drives where, decided by the seed alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from siren_ros.traffic.driver_models import DriverPopulation
from siren_ros.traffic.lane_chains import LaneChain, chain_along
from siren_ros.traffic.plan import LaneInterval, PlannedVehicle, Spot, TrafficPlan
from siren_ros.traffic.vehicle_factory import Dimensions, VehicleFactory
from siren_ros.world.actors import ActorClass
from siren_ros.world.errors import MapError
from siren_ros.world.random_streams import random_stream
from siren_ros.world.road_network import Lane, RoadNetwork
from siren_ros.world.routing import driving_lanes
from siren_ros.world.scenario import DemandGroup, Placement, Template
from siren_ros.world.sites import Site
from siren_ros.world.units import steps_from_s

_SEARCH_STEP_M: Final = 1.0
_PLACEMENT_TRIES: Final = 400
_ROUTE_TRIES: Final = 12


@dataclass(frozen=True)
class DemandConfig:
    """How vehicles are spread over the network."""

    placement_gap_m: float = 9.0
    """Least gap between a vehicle's front and the rear of the next one at its first placement."""
    stage_behind_m: float = 25.0
    """Background traffic is kept off this stretch behind the rearmost EMV at the start…"""
    stage_ahead_m: float = 35.0
    """…and off this stretch ahead of the foremost vehicle of the groups."""
    route_slack_s: float = 20.0
    """Routes are this much longer than warm-up and episode take at ``route_speed_mps``."""
    route_speed_mps: float = 16.0
    reserve_factor: float = 4.0
    """Replacement vehicles in reserve, per civilian of the volume."""
    depart_speed_share: float = 0.7
    """Speed at the first placement, as a share of the wished speed."""
    comfortable_decel_mps2: float = 2.5
    """With which a vehicle that has just been placed must be able to stop."""
    spacing_spread: float = 0.15
    """Gaps within a group vary by up to this fraction."""
    speed_spread: float = 0.05
    """Wished speeds within a group vary by up to this fraction."""


@dataclass(frozen=True)
class EmvStart:
    """Where the foremost EMV's front bumper starts, and the edges of its route from there on."""

    lane: int
    front_m: float
    route: tuple[int, ...]


def emv_start(network: RoadNetwork, site: Site, start_m: float) -> EmvStart:
    """The start at a distance from the beginning of the site's edge, negative before it.

    Before the site the lane is one that leads to the site's approach lane without a lane change, where
    there is such a lane, and otherwise the leftmost driving lane.

    Raises:
        MapError: the site's approach or the site itself is too short.
    """
    position = site.site_position
    lane = network.lanes[site.approach_lane]
    while start_m < 0.0 and position > 0:
        position -= 1
        edge, following = site.route[position], site.route[position : site.site_position + 1]
        lanes = driving_lanes(network, edge)
        leading = [one for one in lanes if site.approach_lane in chain_along(network, one, following).lanes]
        lane = (leading or list(lanes))[-1]
        start_m += lane.length_m
    while start_m > lane.length_m and position + 1 < len(site.route):
        chain = chain_along(network, lane, site.route[position : position + 2])
        position, start_m = position + 1, start_m - (chain.start_m[-1] if len(chain.lanes) > 1 else lane.length_m)
        lane = network.lanes[chain.lanes[-1]]
    if not 0.0 <= start_m <= lane.length_m:
        raise MapError(site.name, f"a site with {abs(start_m):.0f} m more of road for the EMV's start")
    return EmvStart(lane.index, start_m, site.route[position:])


def long_enough_route(
    factory: VehicleFactory, route: tuple[int, ...], site: Site, needed_m: float, rng: np.random.Generator
) -> tuple[int, ...]:
    """The route, with another way on after the site where it would leave the map too early.

    Of the ways on, those that keep most of the route come first; where none is long enough, the
    longest way found is taken.
    """
    kept_at_least = max(route.index(edge) for edge in (site.site_edge, *site.stretch) if edge in route) + 1
    best, best_m = route, factory.length_m(route)
    for kept in range(len(route), kept_at_least - 1, -1):
        for _ in range(_ROUTE_TRIES):
            if best_m >= needed_m:
                return best
            way = factory.draw_way(route[:kept], needed_m, rng)
            if factory.length_m(way) > best_m:
                best, best_m = way, factory.length_m(way)
    return best


def plan_traffic(
    network: RoadNetwork,
    site: Site,
    template: Template,
    seed: int,
    drivers: DriverPopulation,
    dimensions: Mapping[ActorClass, Dimensions],
    config: DemandConfig | None = None,
) -> TrafficPlan:
    """Plan all vehicles of an episode.

    The same inputs give the same plan. The level does not enter: episodes of one seed at different
    levels have the same traffic.

    Args:
        network: The map.
        site: The place of the interaction, with the EMV's route.
        template: The scenario with its values.
        seed: The episode's seed.
        drivers: Population from which drivers are drawn.
        dimensions: Length, width and height of each vehicle class in metres.
        config: Constants of the placement.

    Raises:
        MapError: the map has no room for the civilians, or the site none for the EMVs' start.
        InputError: dimensions of a vehicle class are missing.
    """
    factory = VehicleFactory(network, drivers, dimensions)
    config = config or DemandConfig()
    emv = template.emv
    headway_m = factory.size(emv.actor_class)[0] + emv.headway_s * emv.depart_speed_mps
    starts = [emv_start(network, site, emv.start_m - number * headway_m) for number in range(emv.count)]
    needed_m = emv.speed_mps * (template.duration_s + config.route_slack_s)
    way = starts[0].route
    route = long_enough_route(factory, way, site, needed_m, random_stream(seed, "demand/route"))
    starts = [replace(start, route=start.route[: len(start.route) - len(way)] + route) for start in starts]
    return _Planner(network, starts, template, seed, factory, config).plan()


class _Planner:
    def __init__(
        self,
        network: RoadNetwork,
        starts: Sequence[EmvStart],
        template: Template,
        seed: int,
        factory: VehicleFactory,
        config: DemandConfig,
    ) -> None:
        self._network = network
        self._starts = starts
        self._start = starts[0]
        self._template = template
        self._seed = seed
        self._factory = factory
        self._config = config
        self._route_m = config.route_speed_mps * (template.warm_up_s + template.duration_s + config.route_slack_s)
        self._group_front_m: dict[LaneChain, float] = {}
        """Front of the foremost group vehicle so far in each chain of lanes."""

    def plan(self) -> TrafficPlan:
        emvs = self._emvs()
        groups = self._groups()
        stage = self._stage()
        civilians = self._template.demand.background_vehicles
        spares = round(self._config.reserve_factor * civilians)
        return TrafficPlan(
            emvs=emvs,
            groups=groups,
            background=self._scattered("background", civilians - len(groups), (), disjoint=True),
            reserve=self._scattered("reserve", spares, stage, disjoint=False),
            stage=stage,
            civilians=civilians,
            warm_up_steps=steps_from_s(self._template.warm_up_s),
            response_distance_m=self._template.response.response_distance_m,
        )

    def _emvs(self) -> tuple[PlannedVehicle, ...]:
        rng = random_stream(self._seed, "demand/emv")
        demand = self._template.emv
        found = []
        for number, start in enumerate(self._starts):
            route = tuple(self._network.edges[edge].edge_id for edge in start.route)
            driver = self._factory.draw_driver(demand.actor_class, rng)
            limit = self._network.lanes[start.lane].speed_limit_mps
            driver = replace(driver, speed_factor=demand.speed_mps / limit)
            spot = Spot(start.lane, start.front_m, demand.depart_speed_mps)
            found.append(self._factory.emv(f"emv{number}", demand.actor_class, driver, route, spot))
        return tuple(found)

    def _groups(self) -> tuple[PlannedVehicle, ...]:
        found: list[PlannedVehicle] = []
        for group in self._template.demand.groups:
            rng = random_stream(self._seed, f"demand/group/{group.name}")
            chains = self._chains_of(group.placement)
            for number in range(group.vehicles if chains else 0):
                vehicle = self._group_vehicle(group, number, chains[number % len(chains)], rng)
                if vehicle is not None:
                    found.append(vehicle)
        return tuple(found)

    def _chains_of(self, placement: Placement) -> list[LaneChain]:
        lane = self._network.lanes[self._start.lane]
        if placement is Placement.EMV_LANE:
            chosen = [lane]
        else:
            chosen = [
                other for other in driving_lanes(self._network, self._start.route[0]) if other.index != lane.index
            ]
        if placement is Placement.ADJACENT_LANE:
            adjacent = [other for other in chosen if abs(other.position - lane.position) == 1]
            chosen = sorted(adjacent, key=lambda other: -other.position)[:1]
        return [chain_along(self._network, other, self._start.route) for other in chosen]

    def _group_vehicle(
        self, group: DemandGroup, number: int, chain: LaneChain, rng: np.random.Generator
    ) -> PlannedVehicle | None:
        """The next vehicle of a group in a chain, or None where the chain has no more room."""
        actor_class = self._factory.draw_class(self._template.demand.classes, rng)
        length = self._factory.size(actor_class)[0]
        spacing = group.spacing_m * (1.0 + self._config.spacing_spread * rng.uniform(-1.0, 1.0))
        speed = group.speed_mps * (1.0 + self._config.speed_spread * rng.uniform(-1.0, 1.0))
        rear = self._start.front_m + group.first_gap_m
        if chain in self._group_front_m:
            rear = max(rear, self._group_front_m[chain] + spacing)
        place = self._place_on_road(chain, rear + length, length)
        if place is None:
            return None
        self._group_front_m[chain], lane, front = place
        edges = self._start.route[self._start.route.index(self._network.lanes[lane].edge) :]
        driver = self._factory.draw_driver(actor_class, rng)
        driver = replace(driver, speed_factor=speed / self._network.lanes[lane].speed_limit_mps)
        route = self._factory.draw_route(edges, self._route_m, rng)
        spot = Spot(lane, front, speed)
        return self._factory.civilian(f"{group.name}{number}", actor_class, driver, route, spot, rng)

    def _place_on_road(self, chain: LaneChain, distance_m: float, length_m: float) -> tuple[float, int, float] | None:
        """The first distance from the given one on at which a vehicle stands clear of junctions, lane and position."""
        while distance_m < chain.end_m:
            place = chain.place(self._network, distance_m)
            if place is not None and place[1] >= min(length_m, 0.5 * self._network.lanes[place[0]].length_m):
                return distance_m, *place
            distance_m += _SEARCH_STEP_M
        return None

    def _stage(self) -> tuple[LaneInterval, ...]:
        """All lanes of the way from behind the rearmost EMV to ahead of the foremost vehicle of the groups."""
        rearmost = self._starts[-1]
        between_m = self._factory.length_m(rearmost.route[: len(rearmost.route) - len(self._start.route)])
        rear = rearmost.front_m - self._factory.size(self._template.emv.actor_class)[0] - self._config.stage_behind_m
        foremost = max([self._start.front_m, *self._group_front_m.values()])
        reach = between_m + foremost + self._config.stage_ahead_m
        found: list[LaneInterval] = []
        for lane in driving_lanes(self._network, rearmost.route[0]):
            found += chain_along(self._network, lane, rearmost.route).intervals(self._network, rear, reach)
        return tuple(dict.fromkeys(found))

    def _scattered(
        self, purpose: str, count: int, keep_off: Sequence[LaneInterval], *, disjoint: bool
    ) -> tuple[PlannedVehicle, ...]:
        """Vehicles at random places off some stretches; where ``disjoint``, at a distance from each other."""
        rng = random_stream(self._seed, f"demand/{purpose}")
        edges = [edge for edge in range(len(self._network.edges)) if self._factory.leads_on(edge)]
        lanes = [lane for edge in edges for lane in driving_lanes(self._network, edge)]
        if not lanes:
            raise MapError("no driving lanes", "a map with connected driving lanes for civilians")
        occupied: dict[int, list[tuple[float, float]]] = {}
        found = []
        for number in range(count):
            actor_class = self._factory.draw_class(self._template.demand.classes, rng)
            length = self._factory.size(actor_class)[0]
            lane, front = self._free_spot(lanes, length, occupied, keep_off, rng)
            if disjoint:
                occupied.setdefault(lane.index, []).append((front - length, front))
            driver = self._factory.draw_driver(actor_class, rng, self._template.demand.speed_factor)
            route = self._factory.draw_route((lane.edge,), self._route_m, rng)
            wished = min(driver.speed_factor * lane.speed_limit_mps, driver.driving.max_speed_mps)
            spot = Spot(lane.index, front, min(self._config.depart_speed_share * wished, self._stoppable(lane, front)))
            found.append(self._factory.civilian(f"{purpose}{number}", actor_class, driver, route, spot, rng))
        return tuple(found)

    def _stoppable(self, lane: Lane, front_m: float) -> float:
        """Speed from which a vehicle can still stop before the lane's end, or behind one at the least gap."""
        config = self._config
        free_m = min(lane.length_m - front_m, config.placement_gap_m)
        return float(np.sqrt(2.0 * config.comfortable_decel_mps2 * free_m))

    def _free_spot(
        self,
        lanes: Sequence[Lane],
        length_m: float,
        occupied: Mapping[int, Sequence[tuple[float, float]]],
        keep_off: Sequence[LaneInterval],
        rng: np.random.Generator,
    ) -> tuple[Lane, float]:
        gap = self._config.placement_gap_m
        weights = np.array([lane.length_m for lane in lanes])
        for _ in range(_PLACEMENT_TRIES):
            lane = lanes[int(rng.choice(len(lanes), p=weights / weights.sum()))]
            front = float(rng.uniform(0.0, lane.length_m))
            taken = occupied.get(lane.index, ())
            free = all(front + gap < rear or front - length_m - gap > other for rear, other in taken)
            off = all(area.lane != lane.index or not area.from_m <= front <= area.to_m for area in keep_off)
            if front >= length_m and free and off:
                return lane, front
        value = f"{self._template.demand.background_vehicles} civilians"
        raise MapError(value, f"a map with room for them at gaps of {gap:g} m, or a smaller volume")
