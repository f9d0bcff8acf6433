"""Rows of lanes in which a template's groups of civilians start."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.bend_speeds import SAMPLE_M, bend_speeds_mps, with_braking
from siren_ros.roads.movements import quiet_reach_m
from siren_ros.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.roads.routing import driving_lanes
from siren_ros.roads.sites.site_finder import Site
from siren_ros.scenario.scenario import DemandGroup, GroupAnchor, Placement
from siren_ros.traffic.demand.emv_start import (
    ONTO_SHOULDER_M,
    SHORT_QUEUE_M,
    EmvStart,
    travel_lane,
    way_to_stop_line_m,
)
from siren_ros.traffic.demand.lane_chains import LaneChain, chain_along

_FOLLOWING_M: Final = 6.0
"""By how much nearer to the EMV a stream is that it follows than one that it drives up to."""
_COMING_UP_M: Final = 32.0
"""By how much farther ahead it is where the EMV comes up next to it on its last metres."""
_IN_STREAM: Final = 0.93
"""Mean speed in a stream over the speed that its drivers wish for: the intelligent driver model follows more slowly."""
_IN_TURN_M: Final = 8.0
"""By how much farther back every other queue at a stop sign begins. Drivers who stop and go then drive by turns from
the two sides, about 4 s apart, and do not leave the junction empty for as long between them."""
_OVERTAKEN: Final = 1.0 / 3.0
"""Part of the EMV's way to the stop line on which those start who drive next to it: at 30 km/h instead of 50 they do
not come to a queue at red before the EMV has passed them, and change into its lane."""
_LATERAL_MPS2: Final = 3.0
_BRAKE_MPS2: Final = 1.5
"""With which traffic drives through bends and brakes before them (``traffic/sumo/bend_limits.py``)."""
CROSSING_REACH_M: Final = 120.0
"""How far back from the stop line crossing traffic may be placed."""


@dataclass(frozen=True)
class GroupRow:
    """One row: consecutive lanes, and where on them vehicles may be put."""

    chain: LaneChain
    edges: tuple[int, ...]
    """Edges of the chain's lanes and those that its vehicles drive on to."""
    anchor_m: float
    """Place on the chain from which the first gap counts."""
    forwards: bool
    """Whether the row grows in driving direction."""
    least_m: float = 0.0
    """No vehicle's rear may be before this place."""
    most_m: float = math.inf
    """No vehicle's front may be beyond this place."""
    movement: int | None = None
    """Index of the movement with which a crossing row goes over the junction."""


def group_rows(
    network: RoadNetwork,
    site: Site,
    start: EmvStart,
    group: DemandGroup,
    arrival_s: float,
    rng: np.random.Generator,
) -> list[GroupRow]:
    """The rows of a group, in the order in which they are filled.

    Args:
        network: The map.
        site: The place of the interaction.
        start: The foremost EMV's start.
        group: Which lanes, and counted from where.
        arrival_s: Time from step 0 to the EMV's unhindered arrival at the stop line.
        rng: Draws the way on of crossing rows, where a lane has several.
    """
    if group.placement is Placement.CROSSING:
        return _crossing_rows(network, site, rng)
    if site.junction is None or site.site_edge not in start.route:
        return [
            GroupRow(chain_along(network, lane, start.route), start.route, start.front_m, forwards=True)
            for lane in _chosen(network, network.lanes[start.lane], start.route[0], group.placement, ())
        ]
    same = [network.connections[index].from_lane for index in site.connections]
    approach = travel_lane(network, site)
    lanes = _chosen(network, approach, site.site_edge, group.placement, same)
    if group.optional:
        lanes = [lane for lane in lanes if lane.index != approach.index]  # the EMV could not pass on one lane
    rows = [_approach_row(network, site, start, lane) for lane in lanes]
    if group.standing and group.placement is not Placement.EMV_LANE:
        # A lane that branches off from the EMV's on the way may be the one that the EMV takes.
        rows = [row for row in rows if not set(row.chain.lanes) & set(start.lanes_to_site)]
    if group.anchor is GroupAnchor.STOP_LINE:
        return rows
    way_m = way_to_stop_line_m(network, start)
    if group.anchor is GroupAnchor.EMV:
        most_m = (_OVERTAKEN - 1.0) * way_m if group.placement is Placement.SAME_DIRECTION else math.inf
        return [
            replace(row, anchor_m=row.anchor_m - way_m, forwards=True, most_m=row.anchor_m + most_m) for row in rows
        ]
    # Beyond the stop line a stream would only hold up its own vehicles that come after.
    together = [_together_m(network, row, start, group, arrival_s) for row in rows]
    return [
        replace(row, anchor_m=anchor_m, forwards=True, most_m=row.anchor_m)
        for row, anchor_m in zip(rows, together, strict=True)
    ]


def _together_m(network: RoadNetwork, row: GroupRow, start: EmvStart, group: DemandGroup, arrival_s: float) -> float:
    """Place on a row from which a vehicle at the group's speed comes to the stop line together with the EMV.

    In the EMV's own lane the EMV follows that vehicle from the start on, at the distance that it keeps. Where the lane
    fans out on the way, the EMV comes up next to it: the vehicle then starts farther ahead.
    """
    if start.lane in row.chain.lanes:
        follows = start.lanes_to_site[-1] in row.chain.lanes
        lead_m = -_FOLLOWING_M if follows else _COMING_UP_M
        return row.anchor_m - way_to_stop_line_m(network, start) + lead_m
    lanes = [network.lanes[lane].centre for lane in row.chain.lanes]
    way = Polyline.joined(lanes).cut(0.0, row.anchor_m)
    speed = np.minimum(_IN_STREAM * group.speed_mps, bend_speeds_mps(way, _LATERAL_MPS2))
    speed = with_braking(speed, _BRAKE_MPS2)
    left_s = np.cumsum((SAMPLE_M / speed)[::-1])[::-1]
    late = np.flatnonzero(left_s >= arrival_s)
    return float(late[-1]) * SAMPLE_M if len(late) else row.anchor_m - group.speed_mps * arrival_s


def _chosen(
    network: RoadNetwork, own: Lane, edge: int, placement: Placement, same_direction: Sequence[int]
) -> list[Lane]:
    if placement is Placement.EMV_LANE:
        return [own]
    others = [lane for lane in driving_lanes(network, edge) if lane.index != own.index]
    if placement is Placement.ADJACENT_LANE:
        adjacent = [lane for lane in others if abs(lane.position - own.position) == 1]
        return sorted(adjacent, key=lambda lane: (lane.index not in same_direction, -lane.position))[:1]
    if placement is Placement.SAME_DIRECTION:
        return [lane for lane in others if lane.index in same_direction] or [own]
    return others


def _approach_row(network: RoadNetwork, site: Site, start: EmvStart, lane: Lane) -> GroupRow:
    """The row that leads to a lane of the site's edge, from the stop line back to the edge of the EMV's start."""
    position = start.route.index(site.site_edge)
    lanes: tuple[int, ...] = (lane.index,)
    first = position
    while first > 0:
        before = _connection_from(network, lanes[0], start.route[first - 1])
        if before is None:
            break
        first -= 1
        lanes = (before.from_lane, *before.via, *lanes)
    stop_line_m = sum(network.lanes[index].length_m for index in lanes)
    onward = chain_along(network, lane, start.route[position:])
    whole = _chain(network, (*lanes, *onward.lanes[1:]))
    least_m = 0.0
    if start.lane in lanes:
        least_m = stop_line_m - way_to_stop_line_m(network, start)
    if network.lanes[site.approach_lane].kind is LaneKind.SHOULDER:
        queue_m = max(quiet_reach_m(network, lane.index, stop_line_m) - ONTO_SHOULDER_M, SHORT_QUEUE_M)
        least_m = max(least_m + ONTO_SHOULDER_M, stop_line_m - queue_m)
    return GroupRow(whole, start.route[first:], stop_line_m, forwards=False, least_m=least_m)


def _crossing_rows(network: RoadNetwork, site: Site, rng: np.random.Generator) -> list[GroupRow]:
    ways: dict[int, list[int]] = {}
    for index in site.crossing:
        ways.setdefault(network.connections[index].from_lane, []).append(index)
    rows = []
    approaches = list(dict.fromkeys(network.lanes[lane].edge for lane in ways))
    for lane, movements in ways.items():
        movement = movements[int(rng.integers(len(movements)))]
        lanes: tuple[int, ...] = (lane,)
        length_m = network.lanes[lane].length_m
        while length_m < CROSSING_REACH_M:
            before = _plain_connection_to(network, lanes[0])
            if before is None or before.from_lane in lanes:
                break
            lanes = (before.from_lane, *before.via, *lanes)
            length_m += sum(network.lanes[index].length_m for index in (before.from_lane, *before.via))
        edges = [network.lanes[index].edge for index in lanes if network.lanes[index].kind is not LaneKind.INTERNAL]
        beyond = network.lanes[network.connections[movement].to_lane].edge
        way = (*dict.fromkeys(edges), beyond)
        stands_back_m = _IN_TURN_M * (approaches.index(network.lanes[lane].edge) % 2)
        anchor_m = length_m - (stands_back_m if network.connections[movement].must_stop else 0.0)
        rows.append(GroupRow(_chain(network, lanes), way, anchor_m, forwards=False, movement=movement))
    return rows


def _connection_from(network: RoadNetwork, lane: int, edge: int) -> Connection | None:
    """The movement from a driving lane of an edge to a lane; of several, from the leftmost."""
    found = [
        connection
        for connection in network.connections_to.get(lane, ())
        if network.lanes[connection.from_lane].edge == edge
        and network.lanes[connection.from_lane].kind is LaneKind.DRIVING
    ]
    return max(found, key=lambda connection: network.lanes[connection.from_lane].position, default=None)


def _plain_connection_to(network: RoadNetwork, lane: int) -> Connection | None:
    """The movement to a lane straight on from another road piece, with neither signal nor stop sign."""
    for connection in network.connections_to.get(lane, ()):
        source = network.lanes[connection.from_lane]
        free = connection.signal_id is None and not connection.must_stop and connection.direction == "s"
        if free and source.kind is LaneKind.DRIVING:
            return connection
    return None


def _chain(network: RoadNetwork, lanes: Sequence[int]) -> LaneChain:
    lengths = [network.lanes[lane].length_m for lane in lanes]
    starts = [sum(lengths[:number]) for number in range(len(lanes))]
    return LaneChain(tuple(lanes), tuple(starts), sum(lengths))
