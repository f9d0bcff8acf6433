"""Places the vehicles of a template's groups in their rows, each at its distance from the next one."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Final, TypeAlias

import numpy as np

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.numerics.braking import SAMPLE_M, bend_speeds_mps, braking_distance_m, with_braking
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes, edges_in_lane
from siren_ros.simulation.roads.sites import Site, SiteKind
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.scenario.scenario import DemandGroup, GroupAnchor, Placement, Template, ValueRange
from siren_ros.simulation.traffic.demand.emv_start import (
    EMV_CLEARANCE_M,
    EmvStart,
    bound_s_of,
    travel_lane,
    unhindered_arrival_s,
)
from siren_ros.simulation.traffic.demand.group_rows import (
    BRAKE_MPS2,
    LATERAL_MPS2,
    WHERE,
    GroupRow,
    approach_row,
    emv_follows,
    group_rows,
)
from siren_ros.simulation.traffic.demand.plan import LEAST_HEADWAY_S, LaneInterval, PlannedVehicle, Spot, chain_along
from siren_ros.simulation.traffic.demand.road_users import LONG_VEHICLE_M, Shares, VehicleFactory

# These are no parameters: the templates are designed for these lengths, and vary their own values around them.
_TURN_S: Final = 4.0
"""Time between drivers who stop and go by turns: with one lane, so many leave before the EMV comes, and one more is
left that it meets."""
_RIDERS_TURN_S: Final = 9.6
"""Time between two vehicles of such a queue with somebody on each other approach (Highway Capacity Manual 2000, chapter
17: saturation headway at all-way stops), as with riders around. The EMV takes the turn after the last of them."""
_SEARCH_STEP_M: Final = 1.0
"""Distance between the places that are tried for a vehicle."""
_ROUNDING_M: Final = 1e-6
"""Distances that differ by less are equal."""
_Spans: TypeAlias = tuple[LaneInterval, ...]
_LEAST_PLACED_SHARE: Final = 0.6
"""Least share of a group's vehicles with which the interaction may still happen; one vehicle is enough that crosses or
arrives together with the EMV."""
_LEAST_QUEUE: Final = 3
"""Least number of vehicles that counts as a queue, however many the template asks for."""
_THROUGH_M: Final = 60.0
"""Road behind the site on which vehicles next to the EMV follow its route: 7 s at 30 km/h."""
_OVER_SITE: Final = frozenset({Placement.SAME_DIRECTION, Placement.EMV_LANE, Placement.CROSSING})
"""Placements whose vehicles drive over the site: as the EMV does, or across."""


@dataclass(frozen=True)
class GroupPlan:
    """All group vehicles, and the road that they need free at the start."""

    vehicles: tuple[PlannedVehicle, ...]
    foremost_m: float
    """Place of the foremost vehicle's front on the EMV's way, from the beginning of its first lane; 0 without one."""
    crossing_stage: tuple[LaneInterval, ...]
    """Lanes of the crossing rows, which are not on the EMV's way."""
    crossing: tuple[int, ...] = ()
    """Indices of the movements of the vehicles in crossing rows."""
    on_top: int = 0
    """Number of vehicles that are not counted in the background volume."""
    heads: tuple[str, ...] = ()
    """Name of the foremost vehicle of each row in the groups that fill every lane."""
    late_s: float = 0.0
    """Time by which a stream's light turns yellow before step 0, or its last vehicle comes late at its top speed."""


def plan_groups(
    network: RoadNetwork,
    site: Site,
    start: EmvStart,
    template: Template,
    seed: int,
    factory: VehicleFactory,
    traffic: TrafficDrivers,
) -> GroupPlan:
    """Places the groups of a template.

    A row that is too short for all of its vehicles gets fewer; the background traffic gets more in turn. A group is
    left out where the site has no lane for it.

    Raises:
        MapError: The lanes of a group are too short for most of its vehicles.
    """
    planner = _GroupPlanner(network, start, template, factory, traffic, _through(network, site))
    vehicles: list[PlannedVehicle] = []
    crossing: dict[int, None] = {}
    heads: dict[int, str] = {}
    on_top = 0
    arrival_s = unhindered_arrival_s(network, start, template.emv, bound_s_of(site, template))
    red_before_s = template.signal.red_before_arrival_s if template.signal else 0.0
    held_up = site.kind is SiteKind.STOP_JUNCTION and any(vars(template.demand.people).values())
    most = max(int(template.duration_s / _RIDERS_TURN_S) - 1, 1) if held_up else template.demand.background_vehicles
    if any(group.anchor is GroupAnchor.ARRIVAL and not group.optional for group in template.demand.groups):
        yellow_s = max((network.connections[way].yellow_s for way in site.connections), default=0.0)
        planner.late_s = max(yellow_s + red_before_s - arrival_s, 0.0)
    for asked in template.demand.groups:
        leads = held_up and asked.placement is Placement.EMV_LANE
        group = replace(asked, vehicles=min(asked.vehicles, most)) if leads else asked
        rng = random_stream(seed, f"demand/group/{group.name}")
        rows = group_rows(network, site, start, group, arrival_s, rng, red_before_s)
        every = group.placement is Placement.EVERY_LANE
        wanted = group.vehicles * (len(rows) if every else min(len(rows), 1))
        if not rows and site.kind is SiteKind.STOP_JUNCTION:  # the queue of other lanes is behind the one in this lane
            queue = [approach_row(network, site, start, travel_lane(network, site))]
            in_time = min(math.ceil(arrival_s / _TURN_S) + 1, most)
            wanted = max(min(group.vehicles, in_time - len(vehicles)), 0)
        else:
            queue = rows
        before = len(vehicles)
        for number in range(wanted):
            row = queue[number % len(queue)]
            vehicle = planner.vehicle(group, number, row, rng)
            if vehicle is not None:
                vehicles.append(vehicle)
                if every:
                    heads[number % len(rows)] = vehicle.name
                if row.movement is not None:
                    crossing[row.movement] = None
        placed = len(vehicles) - before
        on_top += placed if every else 0
        _check_room(group, len(rows), placed // len(rows) if every else placed)
        if group.placement is Placement.CROSSING:
            planner.keep_crossing_free(rows)
    stage = tuple(planner.crossing_stage)
    placed_groups = tuple(vehicles), planner.foremost_m, stage, tuple(crossing), on_top, tuple(heads.values())
    return GroupPlan(*placed_groups, late_s=planner.late_s)


def _through(network: RoadNetwork, site: Site) -> tuple[int, ...]:
    """The site's edge and those behind it, until they are long enough."""
    reached_m = accumulate(driving_lanes(network, edge)[-1].length_m for edge in site.beyond)
    short = sum(way_m < _THROUGH_M for way_m in reached_m)
    return (site.site_edge, *site.beyond[: short + 1])


def _check_room(group: DemandGroup, rows: int, placed: int) -> None:
    crossing = group.placement is Placement.CROSSING
    single = crossing or group.anchor is GroupAnchor.ARRIVAL
    least = min(1, group.vehicles) if single else _LEAST_PLACED_SHARE * group.vehicles
    if group.standing:
        least = min(least, _LEAST_QUEUE)
    if not group.optional and (rows or crossing) and placed < least:
        cars = f"{group.vehicles} vehicles {WHERE[group.placement]}"
        raise MapError(f"group {group.name}", f"a place with road for {cars}; {placed} would fit")


ROUTE_SLACK_S: Final = 20.0
"""Time for which routes last beyond warm-up and episode, at ``ROUTE_SPEED_MPS``."""
ROUTE_SPEED_MPS: Final = 16.0


_EDGES_AHEAD: Final = 4
"""Number of edges of a vehicle's route whose bends limit its first speed."""


def before_bends_mps(network: RoadNetwork, lane: Lane, front_m: float, route: Sequence[str], reach_m: float) -> float:
    """Greatest speed of a vehicle that is put on a lane from which it can brake for the bends within a distance."""
    lanes = chain_along(network, lane, [network.edge_by_id[edge].index for edge in route[:_EDGES_AHEAD]]).lanes
    ahead = Polyline.joined([network.lanes[item].centre for item in lanes]).cut(front_m, front_m + reach_m)
    return float(with_braking(bend_speeds_mps(ahead, LATERAL_MPS2), BRAKE_MPS2)[0])


def route_length_m(template: Template) -> float:
    """Length of civilians' routes that lasts for warm-up and episode."""
    return ROUTE_SPEED_MPS * (template.warm_up_s + template.duration_s + ROUTE_SLACK_S)


STAGE_BEHIND_M: Final = 25.0
"""Stretch behind the rearmost EMV at the start on which no background traffic starts."""


@dataclass
class _GroupPlanner:
    network: RoadNetwork
    start: EmvStart
    template: Template
    factory: VehicleFactory
    traffic: TrafficDrivers
    through: tuple[int, ...]
    """Edges from the site's on to some way behind it."""
    foremost_m: float = 0.0
    late_s: float = 0.0
    crossing_stage: list[LaneInterval] = field(default_factory=list)
    _reached_m: dict[tuple[tuple[int, ...], bool], tuple[float, float]] = field(default_factory=dict)
    """Rear and front of the last vehicle in each row of lanes and direction of growth."""
    _taken: list[tuple[GroupRow, _Spans, _Spans]] = field(default_factory=list)
    """Row of each vehicle, the stretches of lanes that it covers, and these with its spacing before and behind."""

    def vehicle(
        self, group: DemandGroup, number: int, row: GroupRow, rng: np.random.Generator
    ) -> PlannedVehicle | None:
        """The next vehicle of a group in a row; None where the row is full."""
        kinds = {index: self.network.lanes[index].kind for index in row.chain.lanes}
        driving = tuple(index for index, kind in kinds.items() if kind is LaneKind.DRIVING)
        actor_class = self.factory.draw_class(self._classes(group, row), rng, driving)
        length = self.factory.size(actor_class)[0]
        spacing = group.spacing_m * (1.0 + self.traffic.spacing_spread * rng.uniform(-1.0, 1.0))
        speed = group.speed_mps * (1.0 + self.traffic.speed_spread * rng.uniform(-1.0, 1.0))
        pace = min(speed, self.network.lanes[row.chain.lanes[-1]].speed_limit_mps)
        spacing = max(spacing, row.headway_s * pace - length)
        driver = self.factory.draw_driver(actor_class, rng, self.template.demand.speed_factor)
        if group.standing and not row.headway_s:  # nobody stops nearer than at the own standing distance
            spacing = max(spacing, driver.driving.min_gap_m)
        nearest = group.anchor is GroupAnchor.ARRIVAL
        last = nearest and (row.chain.lanes, row.forwards) not in self._reached_m
        place = self._place(row, group.first_gap_m, spacing, length, nearest=nearest)
        if place is None:
            return None
        front_m, lane, front = place
        speed = self._in_time_mps(row, group, front_m - length) if last else speed
        self._reached_m[row.chain.lanes, row.forwards] = (front_m - length, front_m)
        self._taken.append((row, *self._spans(row, front_m, length, spacing)))
        if group.placement is not Placement.CROSSING:
            self.foremost_m = max(self.foremost_m, front_m)
        edges = row.edges[row.edges.index(self.network.lanes[lane].edge) :]
        if group.placement is Placement.SAME_DIRECTION:
            # On the way to another lane drivers of a stream would change in front of the EMV.
            edges = self._in_lane(row, edges)
        # A driver who keeps a longer distance than the one at which it starts would brake at once.
        headway_s = max((spacing - driver.driving.min_gap_m) / speed, LEAST_HEADWAY_S)
        driver = replace(driver, tau_s=min(driver.tau_s, headway_s))
        limit = self.network.lanes[lane].speed_limit_mps
        if group.anchor is GroupAnchor.ARRIVAL:
            # The last one of a stream drives as planned: faster it would be too early. Slower ones would delay it.
            factor = speed / limit if last else max(driver.speed_factor, group.speed_mps / limit)
            driver = replace(driver, speed_factor=factor)
        if group.placement is Placement.SAME_DIRECTION:  # in the EMV's lane a stream would hold up the EMV
            driver = replace(driver, speed_gain_eagerness=0.0)
        speed = min(speed, driver.speed_factor * limit)
        # On a very long edge it would end before the site.
        needed_m = max(route_length_m(self.template), front + ROUTE_SLACK_S * ROUTE_SPEED_MPS)
        route = self.factory.draw_route(edges, needed_m, rng, lane, actor_class)
        if group.standing and not row.headway_s:
            speed = 0.0
        else:
            reach_m = braking_distance_m(group.speed_mps * group.speed_mps, BRAKE_MPS2) + SAMPLE_M
            speed = min(speed, before_bends_mps(self.network, self.network.lanes[lane], front, route, reach_m))
        spot = Spot(lane, front, speed)
        return self.factory.civilian(f"{group.name}{number}", actor_class, driver, route, spot, rng)

    def _in_time_mps(self, row: GroupRow, group: DemandGroup, rear_m: float) -> float:
        """Speed with which the last one of a stream comes to the line in time, from a place that may not be its own.

        It is in the template's range, and the lowest there if the EMV follows: a fast one would draw away from it.
        """
        only = ValueRange(group.speed_mps, group.speed_mps)
        speeds = self.template.ranges.get(f"demand.{group.name}.speed_mps", only)
        if emv_follows(self.start, row):
            return speeds.minimum
        wanted_m, way_m = (row.most_m - place_m for place_m in (row.anchor_m + group.first_gap_m, rear_m))
        if not group.optional:
            self.late_s = max(self.late_s, way_m / speeds.maximum - wanted_m / group.speed_mps)
        return min(max(group.speed_mps * way_m / max(wanted_m, 1.0), speeds.minimum), speeds.maximum)

    def _classes(self, group: DemandGroup, row: GroupRow) -> Shares:
        """The vehicle classes from which a group's vehicles in a row are drawn.

        A stream next to the EMV has no vehicles that must turn off right after the site: on the way to their lane they
        would change in front of the EMV and delay it. Nor has the EMV's lane: they would not lead it over the junction.
        In a jam long vehicles are in the rightmost lane.
        """
        shares = self.template.demand.classes
        short = [share for share in shares if self.factory.size(share[0])[0] <= LONG_VEHICLE_M] or shares
        if group.placement is Placement.EVERY_LANE:
            lane = self.network.lanes[row.chain.lanes[0]]
            return shares if lane == driving_lanes(self.network, lane.edge)[0] else short
        if group.placement not in _OVER_SITE:
            return shares
        way = row.edges if group.placement is Placement.CROSSING else self.through
        return [share for share in shares if self.factory.can_follow(share[0], way)] or short

    def _in_lane(self, row: GroupRow, edges: tuple[int, ...]) -> tuple[int, ...]:
        """The EMV's edges, or those that a row's lane leads to, where it leaves the EMV's way at the site."""
        site_edge = self.through[0]
        lane = next((item for item in row.chain.lanes if self.network.lanes[item].edge == site_edge), None)
        if lane is None or site_edge not in edges:
            return edges
        kept = edges.index(site_edge) + 1
        onward = edges_in_lane(self.network, lane, edges[kept:], _THROUGH_M)
        return edges if edges[kept : kept + len(onward)] == onward else (*edges[:kept], *onward)

    def keep_crossing_free(self, rows: Sequence[GroupRow]) -> None:
        """Adds the lanes of crossing rows, from behind their last vehicle on, to the stage, so that they stay free."""
        for row in rows:
            line_m = row.chain.end_m
            rear_m, _ = self._reached_m.get((row.chain.lanes, row.forwards), (line_m, line_m))
            behind_m = rear_m - STAGE_BEHIND_M
            self.crossing_stage += row.chain.intervals(self.network, behind_m, line_m)

    def _place(
        self, row: GroupRow, first_gap_m: float, spacing_m: float, length_m: float, *, nearest: bool
    ) -> tuple[float, int, float] | None:
        """Finds the next free place on a row outside junctions: the front on the chain, its lane and the place on it.

        Where a junction is in the way, the row goes on behind it. With ``nearest`` its first vehicle is where it comes
        nearest to its time, on either side.
        """
        rear_m, reached_m = self._reached_m.get((row.chain.lanes, row.forwards), (math.inf, -math.inf))
        if row.forwards:
            front_m = max(row.anchor_m + first_gap_m + length_m, reached_m + spacing_m + length_m)
        else:
            front_m = min(row.anchor_m - first_gap_m, rear_m - spacing_m)
        lengths = length_m, spacing_m
        found = self._first_place(row, front_m, *lengths, _SEARCH_STEP_M if row.forwards else -_SEARCH_STEP_M)
        if not nearest or not math.isinf(reached_m):
            return found
        before = self._first_place(row, front_m, *lengths, -_SEARCH_STEP_M)
        return min((place for place in (found, before) if place), key=lambda it: abs(it[0] - front_m), default=None)

    def _first_place(
        self, row: GroupRow, front_m: float, length_m: float, spacing_m: float, step_m: float
    ) -> tuple[float, int, float] | None:
        least_m = row.least_m + EMV_CLEARANCE_M if row.least_m > 0.0 else 0.0
        while front_m < min(row.chain.end_m, row.most_m) and front_m - length_m >= least_m:
            place = row.chain.place(self.network, front_m)
            least_front_m = math.inf if place is None else min(length_m, 0.5 * self.network.lanes[place[0]].length_m)
            if place is not None and place[1] >= least_front_m and self._is_free(row, front_m, length_m, spacing_m):
                return front_m, *place
            front_m += step_m
        return None

    def _is_free(self, row: GroupRow, front_m: float, length_m: float, spacing_m: float) -> bool:
        """Whether a place keeps its spacing to vehicles of other rows; lanes of several rows may be the same."""
        body, around = self._spans(row, front_m, length_m, spacing_m)
        return not any(
            _meet(body, their_room) or _meet(around, their_body)
            for other, their_body, their_room in self._taken
            if (other.chain.lanes, other.forwards) != (row.chain.lanes, row.forwards)
        )

    def _spans(self, row: GroupRow, front_m: float, length_m: float, spacing_m: float) -> tuple[_Spans, _Spans]:
        rear_m = front_m - length_m
        body = row.chain.intervals(self.network, rear_m, front_m)
        return body, row.chain.intervals(self.network, rear_m - spacing_m, front_m + spacing_m)


def _meet(spans: _Spans, others: _Spans) -> bool:
    """Whether stretches of lanes have a place in common."""
    return any(
        a.lane == b.lane and a.from_m < b.to_m - _ROUNDING_M and b.from_m < a.to_m - _ROUNDING_M
        for a in spans
        for b in others
    )
