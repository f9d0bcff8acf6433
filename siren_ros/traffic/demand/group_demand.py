"""A template's groups of civilians: rows of vehicles around the interaction."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Final

import numpy as np

from siren_ros.errors import MapError
from siren_ros.numerics.random_streams import random_stream
from siren_ros.roads.road_network import LaneKind, RoadNetwork
from siren_ros.roads.routing import driving_lanes
from siren_ros.roads.sites.site_finder import Site
from siren_ros.scenario.scenario import DemandGroup, GroupAnchor, Placement, Template
from siren_ros.traffic.demand.demand_config import DemandConfig
from siren_ros.traffic.demand.emv_start import EmvStart, unhindered_arrival_s
from siren_ros.traffic.demand.group_rows import GroupRow, group_rows
from siren_ros.traffic.demand.plan import LaneInterval, PlannedVehicle, Spot
from siren_ros.traffic.demand.vehicle_factory import Shares, VehicleFactory

_SEARCH_STEP_M: Final = 1.0
_LEAST_PLACED_SHARE: Final = 0.6
"""Least share of a group's vehicles with which the interaction may still happen; one vehicle is enough that crosses or
arrives together with the EMV."""
_LEAST_QUEUE: Final = 3
"""Vehicles that are a queue, however many there should be."""
_THROUGH_M: Final = 60.0
"""Road behind the site on which vehicles next to the EMV follow its route: 7 s at 30 km/h."""
_WHERE: Final = {
    Placement.EMV_LANE: "in the EMV's lane",
    Placement.ADJACENT_LANE: "in the lane next to it",
    Placement.OTHER_LANES: "in the other lanes",
    Placement.SAME_DIRECTION: "in the EMV's direction",
    Placement.CROSSING: "on crossing roads",
}


@dataclass(frozen=True)
class GroupPlan:
    """All group vehicles, and the road that they need free at the start."""

    vehicles: tuple[PlannedVehicle, ...]
    foremost_m: float
    """Place of the foremost front on the EMV's way, from the beginning of its first lane; 0 without one."""
    crossing_stage: tuple[LaneInterval, ...]
    """Lanes of the crossing rows, off the EMV's way."""
    crossing: tuple[int, ...] = ()
    """Indices of the movements of the vehicles in crossing rows."""


def plan_groups(
    network: RoadNetwork,
    site: Site,
    start: EmvStart,
    template: Template,
    seed: int,
    factory: VehicleFactory,
    config: DemandConfig,
) -> GroupPlan:
    """Place the groups of a template.

    A row that is too short for all of its vehicles gets fewer; the background traffic gets more in turn. A group is
    left out where the site has no lane for it.

    Raises:
        MapError: The lanes of a group are too short for most of its vehicles.
    """
    planner = _GroupPlanner(network, start, template, factory, config, _through(network, site))
    vehicles: list[PlannedVehicle] = []
    crossing: dict[int, None] = {}
    arrival_s = unhindered_arrival_s(network, start, template.emv, config)
    for group in template.demand.groups:
        rng = random_stream(seed, f"demand/group/{group.name}")
        rows = group_rows(network, site, start, group, arrival_s, rng)
        for number in range(group.vehicles if rows else 0):
            row = rows[number % len(rows)]
            vehicle = planner.vehicle(group, number, row, rng)
            if vehicle is not None:
                vehicles.append(vehicle)
                if row.movement is not None:
                    crossing[row.movement] = None
        _check_room(group, len(rows), sum(vehicle.name.startswith(group.name) for vehicle in vehicles))
        if group.placement is Placement.CROSSING:
            planner.keep_crossing_free(rows)
    return GroupPlan(tuple(vehicles), planner.foremost_m, tuple(planner.crossing_stage), tuple(crossing))


def _through(network: RoadNetwork, site: Site) -> tuple[int, ...]:
    """The site's edge and those behind it, until they are long enough."""
    reached_m = accumulate(driving_lanes(network, edge)[-1].length_m for edge in site.beyond)
    short = sum(way_m < _THROUGH_M for way_m in reached_m)
    return (site.site_edge, *site.beyond[: short + 1])


def _check_room(group: DemandGroup, rows: int, placed: int) -> None:
    crossing = group.placement is Placement.CROSSING
    one_is_enough = crossing or group.anchor is GroupAnchor.ARRIVAL
    least = min(1, group.vehicles) if one_is_enough else _LEAST_PLACED_SHARE * group.vehicles
    if group.standing:
        least = min(least, _LEAST_QUEUE)
    if not group.optional and (rows or crossing) and placed < least:
        found = f"{group.vehicles} vehicles {_WHERE[group.placement]}"
        raise MapError(f"group {group.name}", f"a place with road for {found}; {placed} would fit")


@dataclass
class _GroupPlanner:
    network: RoadNetwork
    start: EmvStart
    template: Template
    factory: VehicleFactory
    config: DemandConfig
    through: tuple[int, ...]
    """Edges from the site's on to some way behind it."""
    foremost_m: float = 0.0
    crossing_stage: list[LaneInterval] = field(default_factory=list)
    _reached_m: dict[tuple[tuple[int, ...], bool], tuple[float, float]] = field(default_factory=dict)
    """Rear and front of the last vehicle in each row of lanes and direction of growth."""

    @property
    def _route_m(self) -> float:
        config, template = self.config, self.template
        return config.route_speed_mps * (template.warm_up_s + template.duration_s + config.route_slack_s)

    def vehicle(
        self, group: DemandGroup, number: int, row: GroupRow, rng: np.random.Generator
    ) -> PlannedVehicle | None:
        """The next vehicle of a group in a row; None where the row is full."""
        kinds = {index: self.network.lanes[index].kind for index in row.chain.lanes}
        driving = tuple(index for index, kind in kinds.items() if kind is LaneKind.DRIVING)
        actor_class = self.factory.draw_class(self._classes(group), rng, driving)
        length = self.factory.size(actor_class)[0]
        spacing = group.spacing_m * (1.0 + self.config.spacing_spread * rng.uniform(-1.0, 1.0))
        speed = group.speed_mps * (1.0 + self.config.speed_spread * rng.uniform(-1.0, 1.0))
        place = self._place(row, group.first_gap_m, spacing, length)
        if place is None:
            return None
        front_m, lane, front = place
        self._reached_m[row.chain.lanes, row.forwards] = (front_m - length, front_m)
        if group.placement is not Placement.CROSSING:
            self.foremost_m = max(self.foremost_m, front_m)
        edges = row.edges[row.edges.index(self.network.lanes[lane].edge) :]
        driver = self.factory.draw_driver(actor_class, rng, self.template.demand.speed_factor)
        limit = self.network.lanes[lane].speed_limit_mps
        if group.anchor is GroupAnchor.ARRIVAL:  # a stream that slow drivers hold up would come too late
            driver = replace(driver, speed_factor=max(driver.speed_factor, group.speed_mps / limit))
        speed = min(speed, driver.speed_factor * limit)
        route = self.factory.draw_route(edges, self._route_m, rng, lane, actor_class)
        spot = Spot(lane, front, 0.0 if group.standing else speed)
        return self.factory.civilian(f"{group.name}{number}", actor_class, driver, route, spot, rng)

    def _classes(self, group: DemandGroup) -> Shares:
        """Classes to draw from.

        A stream next to the EMV has no vehicles that must turn off right after the site: on the way to their lane they
        would change in front of the EMV and delay it.
        """
        shares = self.template.demand.classes
        if group.placement is not Placement.SAME_DIRECTION:
            return shares
        return [one for one in shares if self.factory.can_follow(one[0], self.through)] or shares

    def keep_crossing_free(self, rows: Sequence[GroupRow]) -> None:
        """Adds the lanes of crossing rows, from behind their last vehicle on, to the stage."""
        for row in rows:
            line_m = row.chain.end_m
            rear_m, _ = self._reached_m.get((row.chain.lanes, row.forwards), (line_m, line_m))
            behind_m = rear_m - self.config.stage_behind_m
            self.crossing_stage += row.chain.intervals(self.network, behind_m, line_m)

    def _place(
        self, row: GroupRow, first_gap_m: float, spacing_m: float, length_m: float
    ) -> tuple[float, int, float] | None:
        """Place of the front on the row's chain, its lane and the place on that, clear of junctions."""
        reached = self._reached_m.get((row.chain.lanes, row.forwards))
        if row.forwards:
            front_m = row.anchor_m + first_gap_m + length_m
            if reached is not None:
                front_m = max(front_m, reached[1] + spacing_m + length_m)
        else:
            front_m = row.anchor_m - first_gap_m
            if reached is not None:
                front_m = min(front_m, reached[0] - spacing_m)
        step_m = _SEARCH_STEP_M if row.forwards else -_SEARCH_STEP_M
        least_m = row.least_m + self.config.emv_clearance_m if row.least_m > 0.0 else 0.0
        while front_m < min(row.chain.end_m, row.most_m) and front_m - length_m >= least_m:
            place = row.chain.place(self.network, front_m)
            if place is not None and place[1] >= min(length_m, 0.5 * self.network.lanes[place[0]].length_m):
                return front_m, *place
            front_m += step_m
        return None
