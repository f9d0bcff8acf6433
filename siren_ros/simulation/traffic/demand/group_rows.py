"""The rows of a template's groups: lanes around the interaction, and the place on them from which vehicles are put."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.braking import SAMPLE_M, bend_speeds_mps, with_braking
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes, quiet_reach_m
from siren_ros.simulation.roads.sites import Site
from siren_ros.simulation.scenario.scenario import DemandGroup, GroupAnchor, Placement
from siren_ros.simulation.traffic.demand.emv_start import (
    EMV_CLEARANCE_M,
    ONTO_SHOULDER_M,
    SHORT_QUEUE_M,
    EmvStart,
    early_m_of,
    travel_lane,
    way_to_stop_line_m,
)
from siren_ros.simulation.traffic.demand.plan import LaneChain, chain_along, chain_of

# These are no parameters: the templates are designed for these lengths, and vary their own values around them.
_FOLLOWING_M: Final = 6.0
"""Length by which a stream starts nearer to the EMV if the EMV follows it than if the EMV drives up to it."""
_IN_TURN_M: Final = 8.0
"""Length by which every other queue at a stop sign begins farther back. Drivers who stop and go then drive by turns
from the two sides, about 4 s apart, and do not leave the junction empty for as long between them."""
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

WHERE: Final = {
    Placement.EMV_LANE: "in the EMV's lane",
    Placement.ADJACENT_LANE: "in the lane next to it",
    Placement.OTHER_LANES: "in the other lanes",
    Placement.TURNING_LANES: "in the turning lanes",
    Placement.SAME_DIRECTION: "in the EMV's direction",
    Placement.CROSSING: "on crossing roads",
    Placement.EVERY_LANE: "in every lane",
}
"""Where a placement's vehicles are, for messages."""


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
    if emv_follows(start, row):
        nearer_m = min(_FOLLOWING_M, group.first_gap_m - EMV_CLEARANCE_M)
        return row.anchor_m - way_to_stop_line_m(network, start) - nearer_m
    return _reached_from_m(network, row, group.speed_mps, arrival_s) - early_m


def emv_follows(start: EmvStart, row: GroupRow) -> bool:
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
    first_m = _reached_from_m(network, row, speed_mps, arrival_s - half_s)
    if first_m >= 2.0 * half_s * speed_mps:
        return replace(row, anchor_m=first_m, headway_s=_SATURATION_S)
    queue_m = vehicles * (group.spacing_m + _CAR_M)
    begins_m = _reached_from_m(network, row, speed_mps, arrival_s - half_s - _DRIVE_OFF_S)
    return replace(row, anchor_m=min(max(begins_m, queue_m), row.anchor_m))


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
