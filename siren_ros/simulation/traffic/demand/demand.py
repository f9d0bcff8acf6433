"""Plans the traffic of an episode from a template and a site. The seed alone decides which vehicle drives where.

One civilian becomes the AV under test where an episode has one.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress, pairwise
from typing import Final

import numpy as np
import numpy.typing as npt
from shapely import LineString, contains_xy

from siren_ros.base.numerics.arrays import Floats, chances, drawn, random_stream
from siren_ros.base.numerics.braking import speed_before_mps, stops_within
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import civilian_movements, driving_lanes
from siren_ros.simulation.roads.sites import Site, SiteKind, overlaps
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.scenario.scenario import DemandGroup, GroupAnchor, Placement, Template
from siren_ros.simulation.traffic.demand.emv_start import (
    EmvStart,
    arrival_s,
    behind_queue_mps,
    bound_s_of,
    crossing_start,
    crossing_ways,
    depart_speed_mps,
    following_starts,
    long_enough_route,
)
from siren_ros.simulation.traffic.demand.group_demand import (
    STAGE_BEHIND_M,
    GroupPlan,
    before_bends_mps,
    plan_groups,
    route_length_m,
)
from siren_ros.simulation.traffic.demand.group_rows import QUEUED_CAR_M
from siren_ros.simulation.traffic.demand.plan import (
    PLACEMENT_GAP_M,
    RED_BEHIND_S,
    DriverPopulation,
    JamHead,
    LaneInterval,
    PlannedVehicle,
    SignalTiming,
    Spot,
    TrafficPlan,
    chain_along,
    least_gap_m,
)
from siren_ros.simulation.traffic.demand.road_users import Dimensions, VehicleFactory, plan_walkers
from siren_ros.simulation.world.actors import ActorClass

_PLACEMENT_TRIES: Final = 400


_COORDINATED_M: Final = 800.0
"""Way along a road within which signals are coordinated: half a mile (MUTCD 2009, 4D.01)."""
EMV_ROUTE_SLACK_S: Final = 5.0
"""The EMV's route is this much longer than the episode takes at its target speed."""


def plan_traffic(
    network: RoadNetwork,
    site: Site,
    template: Template,
    seed: int,
    drivers: DriverPopulation,
    dimensions: Mapping[ActorClass, Dimensions],
) -> TrafficPlan:
    """Plan all vehicles of an episode.

    The same inputs give the same plan. The level does not enter: episodes of one seed at different
    levels have the same traffic.

    Raises:
        MapError: the map is too small for the civilians, or the site's approach too short for the EMVs.
        InputError: dimensions of a vehicle class are missing.
    """
    factory = VehicleFactory(network, drivers, dimensions)
    emv = template.emv
    headway_m = factory.size(emv.actor_class)[0] + emv.headway_s * emv.depart_speed_mps

    def planner_from(start_m: float) -> _Planner:
        starts = following_starts(network, site, replace(emv, start_m=start_m), headway_m)
        needed_m = starts[0].front_m + emv.speed_mps * (template.duration_s + EMV_ROUTE_SLACK_S)
        way = starts[0].route
        route = long_enough_route(factory, way, site, needed_m, random_stream(seed, "demand/route"))
        starts = [replace(start, route=start.route[: len(start.route) - len(way)] + route) for start in starts]
        return _Planner(network, site, starts, template, seed, factory, drivers.traffic)

    planner = planner_from(emv.start_m)
    if planner.groups.late_s > 0.0:  # from farther back the EMV meets the stream that comes in time
        with suppress(MapError):
            planner = planner_from(emv.start_m - planner.groups.late_s * emv.speed_mps)
    return planner.plan()


NEIGHBOURHOOD_M: Final = 150.0
"""Largest distance of starting background traffic from the EMV's way to the site and through it, where there is road
enough. The volume of the paper's table is that of a district of about 200 m by 200 m, whatever the size of the map."""
DISTRICT_M: Final = 300.0
"""Largest distance from that way of the streets around, which have the density of ``demand.district_per_lane_km``."""
NEIGHBOURHOOD_AFTER_M: Final = 250.0
"""Length of the EMV's way beyond the site around which background traffic starts."""
BACKGROUND_SPACING_M: Final = 40.0
"""Lane length that background traffic needs, per vehicle; with less near the EMV's way the whole map is used."""
_STAGE_AHEAD_M: Final = 35.0
"""Stretch ahead of the foremost vehicle of the groups on which no background traffic starts."""
RESERVE_FACTOR: Final = 4.0
"""Replacement vehicles in reserve, per civilian of the volume."""
_PEOPLE_RESERVE_FACTOR: Final = 10.0
"""Pedestrians and riders in reserve, per one that is kept near the EMV: they start along its whole way."""
_DEPART_SPEED_SHARE: Final = 0.7
"""Speed at the first placement, as a share of the wished speed."""
_COMFORTABLE_DECEL_MPS2: Final = 2.5
"""Deceleration with which a vehicle that has just been placed must be able to stop."""


@dataclass
class _Planner:
    _network: RoadNetwork
    _site: Site
    _starts: Sequence[EmvStart]
    _template: Template
    _seed: int
    _factory: VehicleFactory
    _traffic: TrafficDrivers
    _lane_chances: dict[tuple[int, ...], Floats] = field(default_factory=dict)
    """Cumulative chances of the lanes that ``drawn`` uses, by these lanes."""

    @property
    def _start(self) -> EmvStart:
        return self._starts[0]

    @cached_property
    def groups(self) -> GroupPlan:
        """The vehicles of the template's groups."""
        return plan_groups(
            self._network, self._site, self._start, self._template, self._seed, self._factory, self._traffic
        )

    def plan(self) -> TrafficPlan:
        groups = self.groups
        emvs = self._emvs(groups, self._starts)
        crossing, crossed = self._crossing((*emvs, *groups.vehicles))
        groups = self._without_queues_before(crossing, groups)
        emvs += self._emvs(groups, crossing, "crossing_emv")
        stage = self._stage(groups, crossing)
        near, demand = self._near_lanes, self._template.demand
        taken = {lane.index for lane in near}
        around_m = DISTRICT_M if demand.district_per_lane_km else 0.0
        district = [lane for lane in self._lanes_within(around_m) if lane.index not in taken]
        around = round(demand.district_per_lane_km * 1e-3 * sum(lane.length_m for lane in district))
        civilians = demand.background_vehicles + groups.on_top + around
        spares = round(RESERVE_FACTOR * civilians)
        volume = demand.background_vehicles + groups.on_top - len(groups.vehicles)
        background = self._scattered("background", volume, near, self._overlapping, disjoint=True)
        background += self._scattered("district", around, district, self._overlapping, disjoint=True)
        lanes, beside = [*near, *district], self._beside_way()
        elsewhere = self._enough([lane for lane in lanes if all(lane.index != area.lane for area in beside)]) or lanes
        walkers, walkers_kept = plan_walkers(
            *(self._network, self._around_way, demand.people.pedestrians),
            *(_PEOPLE_RESERVE_FACTOR, self._seed, self._factory),
        )
        return TrafficPlan(
            emvs=emvs,
            groups=groups.vehicles,
            background=background,
            reserve=self._scattered("reserve", spares, elsewhere, (*stage, *self._overlapping), disjoint=False),
            stage=tuple(dict.fromkeys((*stage, *beside))),
            civilians=civilians,
            warm_up_steps=steps_from_s(self._template.warm_up_s),
            response_distance_m=self._template.response.response_distance_m,
            signal=self._signal(groups),
            signals_behind=self._signals_behind(),
            crossed=crossed,
            jam=self._jam(groups),
            duty=bool(self._template.response.duty),
            riders=self._riders((*stage, *self._overlapping)),
            riders_kept=self._wanted,
            walkers=walkers,
            walkers_kept=walkers_kept,
            # Drivers at its stop lines would wait for people, one after the other, and the EMV behind them.
            uncrossed=(self._site.junction or "") if self._site.kind is SiteKind.STOP_JUNCTION else "",
            traffic=self._traffic,
        )

    def _jam(self, groups: GroupPlan) -> JamHead | None:
        jam = self._template.jam
        return None if jam is None else JamHead(groups.heads, bool(jam.moves), jam.roll_s, jam.roll_mps, jam.stand_s)

    @cached_property
    def _around_way(self) -> list[Lane]:
        """The driving lanes near the whole way that the EMV may take during the episode."""
        way_m = self._template.emv.speed_mps * self._template.duration_s
        return self._lanes_within(NEIGHBOURHOOD_M, way_m) or self._leading_on

    @property
    def _wanted(self) -> Mapping[ActorClass, int]:
        people = self._template.demand.people
        return {ActorClass.BICYCLE: people.cyclists, ActorClass.MOTORCYCLE: people.motorcycles}

    def _riders(self, stage: Sequence[LaneInterval]) -> tuple[PlannedVehicle, ...]:
        """Plans cyclists and motorcyclists near the EMV's way, with a reserve.

        None starts where the groups and EMVs start.
        """
        near, spares = self._around_way, 1.0 + _PEOPLE_RESERVE_FACTOR
        stage = [replace(area, to_m=self._network.lanes[area.lane].length_m) for area in stage]
        lanes = {ActorClass.MOTORCYCLE: near, ActorClass.BICYCLE: self._cycled(near)}
        return tuple(
            rider
            for kind, count in self._wanted.items()
            for rider in self._scattered(
                *(kind.name.lower(), round(spares * count), lanes[kind], stage),
                disjoint=False,
                kind=kind,
            )
        )

    def _cycled(self, near: Sequence[Lane]) -> list[Lane]:
        """The cycle lanes of some lanes' edges, and the rightmost driving lanes of edges without any.

        Not on the way to the site: cyclists would stand ahead of its queue, and do not make way.
        """
        lanes: list[Lane] = []
        for edge in dict.fromkeys(lane.edge for lane in near):
            on_edge = [self._network.lanes[index] for index in self._network.edges[edge].lanes]
            cycle = [lane for lane in on_edge if lane.kind is LaneKind.CYCLE]
            lanes += cycle or ([] if edge in self._site.stretch else driving_lanes(self._network, edge)[:1])
        return lanes or list(near)

    def _signal(self, groups: GroupPlan) -> SignalTiming | None:
        """Plans when the signal on the EMV's way turns red, and which movements get green then."""
        demand, site = self._template.signal, self._site
        movement = next(reversed(self._movements_at_end), None)
        if demand is None or movement is None or movement.signal_id is None or not movement.alternates:
            return None
        arrives_s = self._arrival_s(site.stretch[-1], bound_s_of(site, self._template))
        red_from_s = arrives_s - demand.red_before_arrival_s
        ways = (self._network.connections[index] for index in groups.crossing)
        bound = [way for way in ways if way.signal_id == movement.signal_id]
        # Where left turns get green first, most of the crossing queue still waits, so the other movements count.
        straight = [way for way in bound if way.direction == "s"]
        crossing = tuple(way.signal_link for way in straight or bound)
        platoon = [vehicle for vehicle in groups.vehicles if self._is_of_stream(vehicle)]
        red_from_s = max((red_from_s, *(time_s + RED_BEHIND_S for time_s in self._too_near_to_stop_s(platoon))))
        names = tuple(vehicle.name for vehicle in platoon)
        link, soonest_s = movement.signal_link, self._arrival_s(site.stretch[-1])
        along = tuple(g.name for g in self._template.demand.groups if g.placement is Placement.SAME_DIRECTION)
        beside = tuple(v.name for v in groups.vehicles if along and v.name.startswith(along) and v not in platoon)
        ways = (
            way
            for lane in self._network.edges[site.stretch[-1]].lanes
            for way in self._network.connections_from.get(lane, ())
        )
        approach = tuple(way.signal_link for way in ways if way.signal_id == movement.signal_id)
        return SignalTiming(movement.signal_id, link, red_from_s, crossing, names, "emv0", soonest_s, approach, beside)

    @property
    def _streams(self) -> tuple[DemandGroup, ...]:
        """Groups that come to the stop line with the EMV."""
        return tuple(group for group in self._template.demand.groups if group.anchor is GroupAnchor.ARRIVAL)

    def _is_of_stream(self, vehicle: PlannedVehicle) -> bool:
        return vehicle.name.startswith(tuple(group.name for group in self._streams))

    def _is_followed(self, vehicle: PlannedVehicle) -> bool:
        """Whether a vehicle stands, or the EMV has to arrive right behind it."""
        return vehicle.spot.speed_mps == 0.0 or self._is_of_stream(vehicle)

    @cached_property
    def _movements_at_end(self) -> tuple[Connection, ...]:
        """The EMV's movements at the site's junction, or at the end of its road, where the EMV may take another way."""
        site, route = self._site, self._start.route
        at = route.index(site.stretch[-1]) if site.junction is None and site.stretch[-1] in route else len(route)
        if turning := route[at : at + 2][1:]:
            return civilian_movements(self._network, site.stretch[-1], turning[0])
        return tuple(self._network.connections[index] for index in site.connections)

    def _signals_behind(self) -> tuple[SignalTiming, ...]:
        """Plans when the signals behind the site turn red.

        Behind a road each does so by the EMV's arrival, as that at its end. Behind a junction a stream passes those
        before which it has no room, in a green wave: who does not stands in the EMV's junction, or before it.
        """
        demand, site, route, streams = self._template.signal, self._site, self._start.route, self._streams
        at_junction = site.junction is not None
        if demand is None or site.stretch[-1] not in route or (at_junction and not streams):
            return ()
        room_m = QUEUED_CAR_M * sum(group.vehicles for group in streams) if at_junction else _COORDINATED_M
        known = {movement.signal_id for movement in self._movements_at_end}
        timings: list[SignalTiming] = []
        behind = route[route.index(site.stretch[-1]) + 1 :]
        for number, (edge, following) in enumerate(pairwise(behind)):
            if self._factory.length_m(behind[:number]) > room_m:
                break
            if at_junction:
                way_m = self._factory.length_m(behind[: number + 1])
                red_from_s = self._arrival_s(site.stretch[-1]) + way_m / max(group.speed_mps for group in streams)
            else:
                red_from_s = self._arrival_s(edge) - demand.red_before_arrival_s
            for movement in civilian_movements(self._network, edge, following)[-1:]:
                if movement.signal_id is not None and movement.alternates and movement.signal_id not in known:
                    timings.append(SignalTiming(movement.signal_id, movement.signal_link, red_from_s))
                    known.add(movement.signal_id)
        return tuple(timings)

    def _too_near_to_stop_s(self, vehicles: Sequence[PlannedVehicle]) -> list[float]:
        """Times at which vehicles pass the stop line that start too near to it to stop gently for a red."""
        times_s, route, end = [], self._start.route, self._site.stretch[-1]
        for vehicle in vehicles:
            spot, edge = vehicle.spot, self._network.lanes[vehicle.spot.lane].edge
            if edge not in route or end not in route or spot.speed_mps <= 0.0:
                continue
            way_m = self._factory.length_m(route[route.index(edge) : route.index(end) + 1]) - spot.front_m
            if not stops_within(spot.speed_mps**2, vehicle.driver.driving.decel_mps2, way_m):
                times_s.append(max(way_m, 0.0) / spot.speed_mps)
        return times_s

    def _arrival_s(self, edge: int, bound_s: float = 0.0) -> float:
        """Time at which the first EMV would reach the end of an edge of its way on a free road."""
        return arrival_s(self._network, self._site, self._start, edge, self._template.emv, bound_s)

    def _crossing(self, placed: Sequence[PlannedVehicle]) -> tuple[list[EmvStart], str]:
        """Places the EMVs that cross the first one's way, and names the junction where they cross."""
        emv = self._template.emv
        if not emv.crossing:
            return [], ""
        ways, edge = crossing_ways(self._network, self._site, self._start)
        wanted_s = self._arrival_s(edge) + emv.crossing_after_s
        others = [vehicle for vehicle in placed if not vehicle.name.startswith(self._crossing_groups)]
        way, start = crossing_start(self._network, ways, emv, wanted_s, others)
        needed_m = start.front_m + emv.speed_mps * (self._template.duration_s + EMV_ROUTE_SLACK_S)
        rng = random_stream(self._seed, "demand/crossing_route")
        route = long_enough_route(self._factory, start.route, way, needed_m, rng)
        return [replace(start, route=route)], way.junction or ""

    @property
    def _crossing_groups(self) -> tuple[str, ...]:
        """The beginnings of the names of vehicles in crossing groups."""
        return tuple(g.name for g in self._template.demand.groups if g.placement is Placement.CROSSING)

    def _without_queues_before(self, crossing: Sequence[EmvStart], groups: GroupPlan) -> GroupPlan:
        """The groups without the crossing ones that would stand in front of EMVs from a side street."""
        lanes = {lane for start in crossing for lane in start.lanes_to_site}
        kept = (v for v in groups.vehicles if v.spot.lane not in lanes or not v.name.startswith(self._crossing_groups))
        return replace(groups, vehicles=tuple(kept))

    def _emvs(self, groups: GroupPlan, starts: Sequence[EmvStart], name: str = "emv") -> tuple[PlannedVehicle, ...]:
        rng = random_stream(self._seed, f"demand/{name}")
        demand = self._template.emv
        emvs = []
        for number, start in enumerate(starts):
            route = tuple(self._network.edges[edge].edge_id for edge in start.route)
            driver = self._factory.draw_driver(demand.actor_class, rng)
            limit = self._network.lanes[start.lane].speed_limit_mps
            driver = replace(driver, speed_factor=demand.speed_mps / limit)
            depart_mps = min(
                depart_speed_mps(self._network, start, demand),
                behind_queue_mps(self._network, start, [*filter(self._is_followed, groups.vehicles)]),
            )
            spot = Spot(start.lane, start.front_m, depart_mps)
            emvs.append(self._factory.emv(f"{name}{number}", demand.actor_class, driver, route, spot))
        return tuple(emvs)

    def _stage(self, groups: GroupPlan, crossing: Sequence[EmvStart]) -> tuple[LaneInterval, ...]:
        """The stretches that background vehicles leave free at the start: around EMVs, groups and crossing rows.

        Around EMVs that cross it is the road from behind to ahead of each.
        """
        rearmost = self._starts[-1]
        between_m = self._factory.length_m(rearmost.route[: len(rearmost.route) - len(self._start.route)])
        rear = rearmost.front_m - self._factory.size(self._template.emv.actor_class)[0] - STAGE_BEHIND_M
        foremost = max(self._start.front_m, groups.foremost_m)
        reach = between_m + foremost + _STAGE_AHEAD_M
        stage: list[LaneInterval] = []
        for lane in driving_lanes(self._network, rearmost.route[0]):
            stage += chain_along(self._network, lane, rearmost.route).intervals(self._network, rear, reach)
        stage += sharing_junction_paths(self._network, stage)
        for start in crossing:
            rear, reach = start.front_m - STAGE_BEHIND_M, start.front_m + _STAGE_AHEAD_M
            for lane in driving_lanes(self._network, start.route[0]):
                stage += chain_along(self._network, lane, start.route).intervals(self._network, rear, reach)
        return tuple(dict.fromkeys((*stage, *self._way_to_site(), *groups.crossing_stage)))

    @cached_property
    def _overlapping(self) -> tuple[LaneInterval, ...]:
        """Stretches of roads that lie over each other: who starts there would stand in others."""
        stretches = overlaps(self._network).items()
        rear_m = self._factory.size(ActorClass.BUS)[0]
        return tuple(LaneInterval(lane, from_m, to_m + rear_m) for (lane, _), (from_m, to_m) in stretches)

    def _way_to_site(self) -> tuple[LaneInterval, ...]:
        """The EMV's lanes up to the stop line, which must be free of standing vehicles if the template asks for it."""
        blocked = any(group.placement is Placement.EMV_LANE for group in self._template.demand.groups)
        if self._site.junction is None or blocked:
            return ()
        lanes = self._start.lanes_to_site
        return tuple(LaneInterval(lane, 0.0, self._network.lanes[lane].length_m) for lane in lanes)

    def _beside_way(self) -> tuple[LaneInterval, ...]:
        """The lanes beside these: vehicles would change from there into the EMV's lane, and stand ahead of it."""
        edges = dict.fromkeys(self._network.lanes[area.lane].edge for area in self._way_to_site())
        lanes = (lane for edge in edges for lane in driving_lanes(self._network, edge))
        return tuple(LaneInterval(lane.index, 0.0, lane.length_m) for lane in lanes)

    def _scattered(
        self,
        purpose: str,
        count: int,
        lanes: Sequence[Lane],
        keep_off: Sequence[LaneInterval],
        *,
        disjoint: bool,
        kind: ActorClass | None = None,
    ) -> tuple[PlannedVehicle, ...]:
        """Plans vehicles at random places of lanes outside some stretches.

        With ``disjoint`` they keep a distance from each other.

        Their class is drawn from the template's shares, unless it is given.
        """
        rng = random_stream(self._seed, f"demand/{purpose}")
        route_m = route_length_m(self._template)
        by_index = {lane.index: lane for lane in lanes}
        candidates = tuple(by_index)
        occupied: dict[int, list[tuple[float, float]]] = {}
        vehicles = []
        for number in range(count):
            actor_class = kind or self._factory.draw_class(self._template.demand.classes, rng, candidates)
            length = self._factory.size(actor_class)[0]
            wide = [by_index[index] for index in self._factory.suited_lanes(actor_class, candidates)]
            lane, front = self._free_spot(wide or lanes, length, occupied, keep_off, rng)
            if disjoint:
                occupied.setdefault(lane.index, []).append((front - length, front))
            driver = self._factory.draw_driver(actor_class, rng, self._template.demand.speed_factor)
            route = self._factory.draw_route((lane.edge,), route_m, rng, lane.index, actor_class)
            wished = min(driver.speed_factor * lane.speed_limit_mps, driver.driving.max_speed_mps)
            safe_mps = self._safe_mps(lane, front, route)
            spot = Spot(lane.index, front, min(_DEPART_SPEED_SHARE * wished, safe_mps))
            vehicles.append(self._factory.civilian(f"{purpose}{number}", actor_class, driver, route, spot, rng))
        return tuple(vehicles)

    def _safe_mps(self, lane: Lane, front_m: float, route: Sequence[str]) -> float:
        """The largest safe speed of a vehicle that is put on a lane.

        It can still stop before the lane's end, or behind another one at the least gap. Out of town it goes on beyond
        the lane's end, and can brake for the bends ahead.
        """
        gap_m = least_gap_m(lane.speed_limit_mps)
        if gap_m <= PLACEMENT_GAP_M:
            return speed_before_mps(0.0, _COMFORTABLE_DECEL_MPS2, min(lane.length_m - front_m, gap_m))
        bends_mps = before_bends_mps(self._network, lane, front_m, route, 2.0 * gap_m)
        return min(speed_before_mps(0.0, _COMFORTABLE_DECEL_MPS2, gap_m), bends_mps)

    @cached_property
    def _leading_on(self) -> list[Lane]:
        """Driving lanes from which vehicles can drive on."""
        edges = [edge for edge in range(len(self._network.edges)) if self._factory.leads_on(edge)]
        lanes = [lane for edge in edges for lane in driving_lanes(self._network, edge)]
        if not lanes:
            raise MapError("no driving lanes", "a map with connected driving lanes for civilians")
        return lanes

    def _lanes_within(self, distance_m: float, beyond_m: float | None = None) -> list[Lane]:
        """The driving lanes with their middle within a distance of the EMV's way, to the site and beyond."""
        after_m = NEIGHBOURHOOD_AFTER_M if beyond_m is None else beyond_m
        around = LineString(self._way_points(after_m)).buffer(distance_m)
        middles = np.array([lane.centre.at(0.5 * lane.length_m) for lane in self._leading_on])
        return [*compress(self._leading_on, contains_xy(around, *middles.T))]

    @cached_property
    def _near_lanes(self) -> list[Lane]:
        """The lanes on which the background volume starts: those near the EMV's way, or all where these are short."""
        return self._enough(self._lanes_within(NEIGHBOURHOOD_M)) or self._leading_on

    def _enough(self, lanes: list[Lane]) -> list[Lane]:
        """The lanes, or none where they are too short for the background volume."""
        needed_m = self._template.demand.background_vehicles * BACKGROUND_SPACING_M
        return lanes if sum(lane.length_m for lane in lanes) >= needed_m else []

    def _way_points(self, after_m: float) -> npt.NDArray[np.float64]:
        """Points of the EMV's way from its start to beyond the site, shape ``(N, 2)``."""
        route, points, beyond_m = self._start.route, [], 0.0
        through = route.index(self._site.site_edge) if self._site.site_edge in route else 0
        for position, edge in enumerate(route):
            centre = driving_lanes(self._network, edge)[-1].centre
            points.append(centre.points)
            beyond_m += centre.length_m if position > through else 0.0
            if beyond_m > after_m:
                break
        return np.concatenate(points)

    def _free_spot(
        self,
        lanes: Sequence[Lane],
        length_m: float,
        occupied: Mapping[int, Sequence[tuple[float, float]]],
        keep_off: Sequence[LaneInterval],
        rng: np.random.Generator,
    ) -> tuple[Lane, float]:
        key = tuple([lane.index for lane in lanes])
        if key not in self._lane_chances:
            self._lane_chances[key] = chances(lane.length_m for lane in lanes)
        for _ in range(_PLACEMENT_TRIES):
            lane = lanes[drawn(self._lane_chances[key], rng)]
            gap = least_gap_m(lane.speed_limit_mps)
            front = float(rng.uniform(0.0, lane.length_m))
            taken = occupied.get(lane.index, ())
            free = all(front + gap < rear or front - length_m - gap > other for rear, other in taken)
            off = all(area.lane != lane.index or not area.from_m <= front <= area.to_m for area in keep_off)
            if front >= length_m and free and off:
                return lane, front
        value = f"{self._template.demand.background_vehicles} civilians"
        raise MapError(value, f"a map with room for them at gaps of {PLACEMENT_GAP_M:g} m, or a smaller volume")


def sharing_junction_paths(network: RoadNetwork, stage: Sequence[LaneInterval]) -> list[LaneInterval]:
    """Junction paths that share an end with the stage: vehicles that turn off there are ahead of the EMV, too."""
    ways = [way for area in stage for way in network.connections_over.get(area.lane, ())]
    leaving = [movement for way in ways for movement in network.connections_from.get(way.from_lane, ())]
    joining = [movement for way in ways for movement in network.connections_to.get(way.to_lane, ())]
    lanes = dict.fromkeys(lane for movement in (*leaving, *joining) for lane in movement.via)
    return [LaneInterval(lane, 0.0, network.lanes[lane].length_m) for lane in lanes]
