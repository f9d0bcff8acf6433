"""A template's groups of civilians: rows of vehicles around the interaction, and the lanes in which they start."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate
from operator import itemgetter
from typing import Final, TypeAlias

import numpy as np

from siren_ros.base.numerics.arrays import Floats, random_stream
from siren_ros.base.numerics.braking import SAMPLE_M, bend_speeds_mps, braking_distance_m, with_braking
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes, edges_in_lane, quiet_reach_m
from siren_ros.simulation.roads.sites import Site, SiteKind
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.scenario.scenario import DemandGroup, GroupAnchor, Placement, Template, ValueRange
from siren_ros.simulation.traffic.demand.emv_start import (
    EMV_CLEARANCE_M,
    ONTO_SHOULDER_M,
    SHORT_QUEUE_M,
    EmvStart,
    bound_s_of,
    early_m_of,
    travel_lane,
    unhindered_arrival_s,
    way_to_stop_line_m,
)
from siren_ros.simulation.traffic.demand.plan import (
    LEAST_HEADWAY_S,
    LaneChain,
    LaneInterval,
    PlannedVehicle,
    Spot,
    chain_along,
    chain_of,
)
from siren_ros.simulation.traffic.demand.road_users import LONG_VEHICLE_M, Shares, VehicleFactory

# These are no parameters: the templates are designed for these lengths, and vary their own values around them.
_FOLLOWING_M: Final = 6.0
"""Length by which a stream starts nearer to the EMV if the EMV follows it than if the EMV drives up to it."""
_IN_TURN_M: Final = 8.0
"""Length by which every other queue at a stop sign begins farther back. Drivers who stop and go then drive by turns
from the two sides, about 4 s apart, and do not leave the junction empty for as long between them."""
_TURN_S: Final = 4.0
"""That time: with one lane, so many leave before the EMV comes, and one more is left that it meets."""
_RIDERS_TURN_S: Final = 9.6
"""Time between two vehicles of such a queue with somebody on each other approach (Highway Capacity Manual 2000, chapter
17: saturation headway at all-way stops), as with riders around. The EMV takes the turn after the last of them."""
_OVERTAKEN: Final = 1.0 / 3.0
"""Share of the EMV's way to the stop line on which vehicles next to it start. At 30 km/h instead of 50 they do not come
to a queue at red before the EMV has passed them, and change into its lane."""
LATERAL_MPS2: Final = 3.0
BRAKE_MPS2: Final = 1.5
"""Deceleration of traffic before bends and in them (``traffic/sumo/driving_corrections.py``)."""
_BENDS_M: Final = 25.0
"""Road beyond a stop line whose bends slow a stream at the line: it stops from 30 km/h on it with this deceleration."""
CROSSING_REACH_M: Final = 300.0
"""Largest distance from the stop line at which crossing traffic is placed: 20 s at 50 km/h."""
_SATURATION_S: Final = 2.0
"""Time between two vehicles of a dense stream or of a queue that drives off (HCM: 1,900 vehicles per hour and lane)."""
_DRIVE_OFF_S: Final = 1.6
"""Time that a driver loses who comes to 30 km/h with 2.6 m/s² (SUMO's acceleration of cars)."""
_CAR_M: Final = 5.0
"""Length of road that a car takes in a queue, without the gap."""
QUEUED_CAR_M: Final = 7.6
"""Length of road that a car takes in a queue with the gap (Highway Capacity Manual 2000, chapter 16)."""
_LEAST_IN_ROW: Final = 4
"""Vehicles of the first crossing row, of as many as there are: they cross for 8 s. It lasts until the EMV comes."""


@dataclass(frozen=True)
class GroupRow:
    """A row of consecutive lanes, and the stretch of them on which vehicles may be put."""

    chain: LaneChain
    edges: tuple[int, ...]
    """Edges of the chain's lanes, and those on which its vehicles drive on."""
    anchor_m: float
    """Place on the chain from which the first gap is counted."""
    forwards: bool
    """Whether the row grows in driving direction."""
    least_m: float = 0.0
    """No vehicle's rear may be before this place."""
    most_m: float = math.inf
    """No vehicle's front may be beyond this place."""
    movement: int | None = None
    """Index of the movement with which a crossing row goes over the junction."""
    headway_s: float = 0.0
    """Time between the fronts of vehicles of a group that would stand, but drive on this row; 0 where they stand."""


def group_rows(
    network: RoadNetwork,
    site: Site,
    start: EmvStart,
    group: DemandGroup,
    arrival_s: float,
    rng: np.random.Generator,
    red_before_s: float = 0.0,
) -> list[GroupRow]:
    """The rows of a group, in the order in which they are filled.

    The foremost EMV begins at ``start`` and arrives at the stop line ``arrival_s`` after step 0, ``red_before_s`` after
    its light turned red. ``rng`` draws the way on of crossing rows, where a lane has several.
    """
    if group.placement is Placement.CROSSING:
        in_row = max(_LEAST_IN_ROW, math.ceil(red_before_s / _SATURATION_S))
        rows = _crossing_rows(network, site, rng)[: max((group.vehicles - 1) // (in_row - 1), 1)]
        return [_timed(network, row, group, arrival_s, len(rows)) for row in rows]
    if site.junction is None or site.site_edge not in start.route:
        return [
            GroupRow(chain_along(network, lane, start.route), start.route, start.front_m, forwards=True)
            for lane in _chosen(network, network.lanes[start.lane], start.route[0], group.placement, ())
        ]
    same = [network.connections[index].from_lane for index in site.connections]
    approach = travel_lane(network, site)
    lanes = _chosen(network, approach, site.site_edge, group.placement, same)
    if group.optional:
        # On a road with one lane the EMV could not pass.
        lanes = [lane for lane in lanes if lane.index != approach.index]
    rows = [approach_row(network, site, start, lane) for lane in lanes]
    if group.placement is Placement.TURNING_LANES:
        rows = [_beside_emv(network, row, start) for row in rows if start.lanes_to_site[-1] not in row.chain.lanes]
    elif group.standing and group.placement is not Placement.EMV_LANE:
        # A lane that branches off from the EMV's lane may be the one that the EMV takes.
        rows = [row for row in rows if not set(row.chain.lanes) & set(start.lanes_to_site)]
    if group.anchor is GroupAnchor.STOP_LINE:
        return rows
    way_m = way_to_stop_line_m(network, start)
    if group.anchor is GroupAnchor.EMV:
        most_m = (_OVERTAKEN - 1.0) * way_m if group.placement is Placement.SAME_DIRECTION else math.inf
        anchors_m = [row.anchor_m - way_m for row in rows]
    else:  # beyond the stop line a stream would only hold up vehicles of its own that follow
        most_m = 0.0
        early_m = 0.0 if group.optional else early_m_of(network, site, group)
        anchors_m = [_together_m(network, row, start, group, arrival_s, early_m) for row in rows]
        rows = [replace(row, headway_s=_bend_headway_s(network, row, group.speed_mps)) for row in rows]
    return [
        replace(row, anchor_m=anchor_m, forwards=True, most_m=row.anchor_m + most_m)
        for row, anchor_m in zip(rows, anchors_m, strict=True)
    ]


def _beside_emv(network: RoadNetwork, row: GroupRow, start: EmvStart) -> GroupRow:
    """A row as far as it is beside the EMV's lane: behind the place at which its lane branches off, if it does."""
    shared = [place for place, lane in enumerate(row.chain.lanes) if lane in start.lanes_to_site]
    branch_m = network.length_m(row.chain.lanes[: shared[-1] + 1]) if shared else 0.0
    return replace(row, least_m=max(row.least_m, branch_m))


def _together_m(
    network: RoadNetwork, row: GroupRow, start: EmvStart, group: DemandGroup, arrival_s: float, early_m: float
) -> float:
    """Place on a row from which a vehicle comes to the stop line together with the EMV, less ``early_m``.

    In the EMV's own lane the EMV follows that vehicle from the start on, at the distance that it keeps. Where the lane
    fans out on the way, the EMV comes up next to it before that distance is reached.
    """
    if _follows(start, row):
        nearer_m = min(_FOLLOWING_M, group.first_gap_m - EMV_CLEARANCE_M)
        return row.anchor_m - way_to_stop_line_m(network, start) - nearer_m
    return _reached_from_m(network, row, group.speed_mps, arrival_s) - early_m


def _follows(start: EmvStart, row: GroupRow) -> bool:
    """Whether the EMV drives behind a row in its own lane."""
    return {start.lane, start.lanes_to_site[-1]} <= set(row.chain.lanes)


def _reached_from_m(network: RoadNetwork, row: GroupRow, speed_mps: float, arrival_s: float) -> float:
    """Place on a row from which a vehicle comes to the row's anchor after a time; negative beyond the row's begin."""
    left_s = np.cumsum((SAMPLE_M / _speeds_mps(network, row, speed_mps))[::-1])[::-1]
    late = np.flatnonzero(left_s >= arrival_s)
    return float(late[-1]) * SAMPLE_M if len(late) else row.anchor_m - speed_mps * arrival_s


def _speeds_mps(network: RoadNetwork, row: GroupRow, speed_mps: float) -> Floats:
    """Speeds at samples of a row up to its anchor, with those bends behind that slow a vehicle before it."""
    way = Polyline.joined([network.lanes[lane].centre for lane in row.chain.lanes]).cut(0.0, row.anchor_m + _BENDS_M)
    speed = np.minimum(speed_mps, bend_speeds_mps(way, LATERAL_MPS2))
    return with_braking(speed, BRAKE_MPS2)[: math.ceil(row.anchor_m / SAMPLE_M)]


def _bend_headway_s(network: RoadNetwork, row: GroupRow, speed_mps: float) -> float:
    """Least time between vehicles of a stream that a bend slows at the line, or each would delay those behind it."""
    line_mps = float(_speeds_mps(network, row, speed_mps)[-1])
    return _SATURATION_S + QUEUED_CAR_M * (1.0 / line_mps - 1.0 / speed_mps) if line_mps < speed_mps else 0.0


def _runs_free(movement: Connection) -> bool:
    """Whether neither a signal nor a stop sign holds a queue at a movement's line."""
    return not movement.must_stop and movement.signal_id is None


def _timed(network: RoadNetwork, row: GroupRow, group: DemandGroup, arrival_s: float, rows: int) -> GroupRow:
    """A crossing row at step 0: a queue at its line, or a stream in whose middle the EMV comes where nothing holds it.

    On a street that is too short for the stream, the row is a queue that drives off as far back as it fits.
    """
    if row.movement is None or not _runs_free(network.connections[row.movement]):
        return row
    vehicles, limit = group.vehicles / rows, network.lanes[row.chain.lanes[-1]].speed_limit_mps
    speed_mps, half_s = min(group.speed_mps, limit), 0.5 * _SATURATION_S * vehicles
    first_m = _reached_from_m(network, row, speed_mps, max(arrival_s - half_s, 0.0))
    if first_m >= 2.0 * half_s * speed_mps:
        return replace(row, anchor_m=first_m, headway_s=_SATURATION_S)
    queue_m = vehicles * (group.spacing_m + _CAR_M)
    later_s = max(arrival_s - half_s - _DRIVE_OFF_S, 0.0)
    return replace(row, anchor_m=min(max(_reached_from_m(network, row, speed_mps, later_s), queue_m), row.anchor_m))


def _chosen(
    network: RoadNetwork, travelled: Lane, edge: int, placement: Placement, same_direction: Sequence[int]
) -> list[Lane]:
    if placement is Placement.EMV_LANE:
        return [travelled]
    if placement is Placement.EVERY_LANE:
        return list(driving_lanes(network, edge))
    others = [lane for lane in driving_lanes(network, edge) if lane.index != travelled.index]
    if placement is Placement.ADJACENT_LANE:
        adjacent = [lane for lane in others if abs(lane.position - travelled.position) == 1]
        return sorted(adjacent, key=lambda lane: (lane.index not in same_direction, -lane.position))[:1]
    if placement is Placement.TURNING_LANES:
        return [lane for lane in others if lane.index not in same_direction]
    if placement is Placement.SAME_DIRECTION:
        return [lane for lane in others if lane.index in same_direction] or [travelled]
    return others


def approach_row(network: RoadNetwork, site: Site, start: EmvStart, lane: Lane) -> GroupRow:
    """The row that leads to a lane of the site's edge, from the stop line back to the edge of the EMV's start."""
    lanes: tuple[int, ...] = (lane.index,)
    first = position = start.route.index(site.site_edge)
    while first > 0:
        before = connection_from(network, lanes[0], start.route[first - 1])
        if before is None:
            break
        first -= 1
        lanes = (before.from_lane, *before.via, *lanes)
    stop_line_m = network.length_m(lanes)
    onward = chain_along(network, lane, start.route[position:])
    whole = chain_of(network, (*lanes, *onward.lanes[1:]))
    least_m = stop_line_m - way_to_stop_line_m(network, start) if start.lane in lanes else 0.0
    if network.lanes[site.approach_lane].kind is LaneKind.SHOULDER:
        queue_m = max(quiet_reach_m(network, lane.index, stop_line_m) - ONTO_SHOULDER_M, SHORT_QUEUE_M)
        least_m = max(least_m + ONTO_SHOULDER_M, stop_line_m - queue_m)
    return GroupRow(whole, start.route[first:], stop_line_m, forwards=False, least_m=least_m)


def _crossing_rows(network: RoadNetwork, site: Site, rng: np.random.Generator) -> list[GroupRow]:
    """The rows of crossing lanes: first those to other roads than the EMV's, those straight on, each side in turn."""
    exits = {network.lanes[network.connections[index].to_lane].edge for index in site.connections}

    def merges(index: int) -> bool:
        return network.lanes[network.connections[index].to_lane].edge in exits

    ways: dict[int, list[int]] = {}
    for index in site.crossing:
        ways.setdefault(network.connections[index].from_lane, []).append(index)
    rows: list[tuple[tuple[bool, bool, int], GroupRow]] = []
    approaches = list(dict.fromkeys(network.lanes[lane].edge for lane in ways))
    for lane, movements in ways.items():
        # A vehicle that leaves the map right behind the junction would disappear in view of the EMV.
        choices = [index for index in movements if _leads_on(network, network.connections[index].to_lane)] or movements
        choices = [index for index in choices if not merges(index)] or choices
        movement = choices[int(rng.integers(len(choices)))]
        free = _runs_free(network.connections[movement])
        lanes: tuple[int, ...] = (lane,)
        length_m = network.lanes[lane].length_m
        while length_m < CROSSING_REACH_M:
            before = _plain_connection_to(network, lanes[0])
            if before is None or before.from_lane in lanes or (free and before.gives_way):
                break
            lanes = (before.from_lane, *before.via, *lanes)
            length_m += network.length_m((before.from_lane, *before.via))
        edges = [network.lanes[index].edge for index in lanes if network.lanes[index].kind is not LaneKind.INTERNAL]
        beyond = network.lanes[network.connections[movement].to_lane].edge
        way = (*dict.fromkeys(edges), beyond)
        stands_back_m = _IN_TURN_M * (approaches.index(network.lanes[lane].edge) % 2)
        anchor_m = length_m - (stands_back_m if network.connections[movement].must_stop else 0.0)
        row = GroupRow(chain_of(network, lanes), way, anchor_m, forwards=False, movement=movement)
        beside = sum(other.chain.lanes[-1] in network.edges[edges[-1]].lanes for _, other in rows)
        rows.append(((merges(movement), network.connections[movement].direction != "s", beside), row))
    return [row for _, row in sorted(rows, key=itemgetter(0))]


def _leads_on(network: RoadNetwork, lane: int) -> bool:
    """Whether civilians can drive on from the edge of a lane."""
    on_edge = network.edges[network.lanes[lane].edge].lanes
    return any(network.is_civilian(way) for item in on_edge for way in network.connections_from.get(item, ()))


def connection_from(network: RoadNetwork, lane: int, edge: int) -> Connection | None:
    """The movement from a driving lane of an edge to a lane; of several, from the leftmost."""
    connections = [
        connection
        for connection in network.connections_to.get(lane, ())
        if network.lanes[connection.from_lane].edge == edge
        and network.lanes[connection.from_lane].kind is LaneKind.DRIVING
    ]
    return max(connections, key=lambda connection: network.lanes[connection.from_lane].position, default=None)


def _plain_connection_to(network: RoadNetwork, lane: int) -> Connection | None:
    """The movement to a lane from another road piece, without signal and stop sign; straight on where there is one."""
    free = [
        connection
        for connection in network.connections_to.get(lane, ())
        if connection.signal_id is None and not connection.must_stop
        if network.lanes[connection.from_lane].kind is LaneKind.DRIVING
    ]
    return min(free, key=lambda connection: connection.direction != "s", default=None)


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
_WITH_EMV: Final = frozenset({Placement.SAME_DIRECTION, Placement.EMV_LANE})
"""Placements whose vehicles drive over the site as the EMV does."""
_WHERE: Final = {
    Placement.EMV_LANE: "in the EMV's lane",
    Placement.ADJACENT_LANE: "in the lane next to it",
    Placement.OTHER_LANES: "in the other lanes",
    Placement.TURNING_LANES: "in the turning lanes",
    Placement.SAME_DIRECTION: "in the EMV's direction",
    Placement.CROSSING: "on crossing roads",
    Placement.EVERY_LANE: "in every lane",
}


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
    jam = on_top, tuple(heads.values())
    return GroupPlan(tuple(vehicles), planner.foremost_m, tuple(planner.crossing_stage), tuple(crossing), *jam)


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
        cars = f"{group.vehicles} vehicles {_WHERE[group.placement]}"
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
        driver = self.factory.draw_driver(actor_class, rng, self.template.demand.speed_factor)
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
        if _follows(self.start, row):
            return speeds.minimum
        wanted_m, way_m = (row.most_m - place_m for place_m in (row.anchor_m + group.first_gap_m, rear_m))
        return min(max(group.speed_mps * way_m / max(wanted_m, 1.0), speeds.minimum), speeds.maximum)

    def _classes(self, group: DemandGroup, row: GroupRow) -> Shares:
        """The vehicle classes from which a group's vehicles in a row are drawn.

        A stream next to the EMV has no vehicles that must turn off right after the site: on the way to their lane they
        would change in front of the EMV and delay it. Nor has the EMV's lane: they would not lead it over the junction.
        In a jam long vehicles are in the rightmost lane.
        """
        shares = self.template.demand.classes
        if group.placement is Placement.EVERY_LANE:
            lane = self.network.lanes[row.chain.lanes[0]]
            if lane != driving_lanes(self.network, lane.edge)[0]:
                most_m = LONG_VEHICLE_M
                return [share for share in shares if self.factory.size(share[0])[0] <= most_m] or shares
        if group.placement not in _WITH_EMV:
            return shares
        return [share for share in shares if self.factory.can_follow(share[0], self.through)] or shares

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
