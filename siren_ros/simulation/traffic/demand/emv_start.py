"""The EMVs' starts: lane and place, the way from there to the site, and the time of arrival.

Further EMVs follow the first on its way, or cross it.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import accumulate, count, pairwise
from typing import Final, NamedTuple

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.braking import SAMPLE_M, bend_speeds_mps, speed_before_mps, with_accelerating, with_braking
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import Connection, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import (
    EdgeGraph,
    civilian_movements,
    comes_from_the_side,
    crossing_connections,
    driving_lanes,
    quiet_reach_m,
)
from siren_ros.simulation.roads.site_finder import junction_site
from siren_ros.simulation.roads.sites import SHORTEST_ROAD_M, Lack, Site, SiteKind, way_back
from siren_ros.simulation.scenario.driver_parameters import EmvDriver
from siren_ros.simulation.scenario.presets import Attention
from siren_ros.simulation.scenario.scenario import DemandGroup, EmvDemand, GroupAnchor, StartReference, Template
from siren_ros.simulation.traffic.demand.plan import (
    BEFORE_EMV_S,
    YELLOW_DRIVEN_S,
    PlannedVehicle,
    chain_along,
)
from siren_ros.simulation.traffic.demand.road_users import VehicleFactory

# These are no parameters, because they decide which places of a map serve a template; a site must be the same in every
# study.
_ROUTE_TRIES: Final = 12
_CREEP_MPS: Final = 1.0
_LEAST_APPROACH_SHARE: Final = 0.6
"""Least share of the template's distance to the stop line that remains if the EMV starts after a junction."""
ENTRY_M: Final = 8.0
"""Road behind an EMV's front at the very beginning of its approach, for its own length."""
_RUN_UP_M: Final = 20.0
"""Road before a junction at the EMV's start, because it cannot begin at a stop line at full speed."""
_LEAST_PACE: Final = 0.75
"""Least mean speed on a good way to the site, as a share of the target speed: no sharp bends."""
_LEAST_QUIET_M: Final = 60.0
"""Length of a way without junctions that is enough before a single conflict point: 4 s at 50 km/h."""
ONTO_SHOULDER_M: Final = 40.0
"""Length of the way on which the EMV changes to the shoulder behind a queue."""
SHORT_QUEUE_M: Final = 50.0
"""Length that a queue next to a shoulder gets even where that way is missing."""
LEAST_QUEUE_M: Final = 15.0
"""Least road between the previous junction and the stop line: two cars can wait on it."""
_LEAST_EXIT_M: Final = 100.0
"""Least road behind the site. With less the EMV soon stands at the end of its route: 7 s at 50 km/h."""
LITTLE_BEHIND: Final = "hardly any road behind it"
_CONFLICT_POINTS: Final = frozenset({SiteKind.SIGNAL_JUNCTION, SiteKind.STOP_JUNCTION})


EMV_CLEARANCE_M: Final = 10.0
"""Least gap between the EMV's front and the rear of a vehicle in its lane at the start."""


@dataclass(frozen=True)
class EmvStart:
    """Where the foremost EMV's front bumper starts, and the edges of its route from there on."""

    lane: int
    front_m: float
    route: tuple[int, ...]
    lanes_to_site: tuple[int, ...]
    """Lanes from the start to the end of the site's edge, junction paths included; starts beyond it have their own."""


def start_m_of(network: RoadNetwork, site: Site, emv: EmvDemand) -> float:
    """A template's start of the EMV, counted from the beginning of the site's edge.

    Before a stop line it is as far back as the template wants and the approach reaches, with the EMV's body on the
    lane where its front is. It is after the junction before, where the road from there is long enough, so that the EMV
    meets nobody there.
    """
    if emv.start_from is StartReference.SITE_START:
        return emv.start_m
    lane, reach_m = travel_lane(network, site), 0.0
    quiet_m = _quiet_start(network, site, emv)
    if quiet_m is not None:
        return lane.length_m + quiet_m
    wanted_m = lane.length_m + emv.start_m
    for edge in reversed(site.route[: site.site_position]):
        if reach_m >= -wanted_m:
            break
        lane, via = lane_before(network, lane, edge)
        reach_m += lane.length_m + network.length_m(via)
    return max(wanted_m, ENTRY_M - reach_m)


def _quiet_start(network: RoadNetwork, site: Site, emv: EmvDemand) -> float | None:
    """Where the start after the previous junction is, relative to the stop line.

    None where the road from there is too short.
    """
    quiet_m = quiet_reach_m(network, travel_lane(network, site).index, -emv.start_m) - ENTRY_M
    needed_m = -_LEAST_APPROACH_SHARE * emv.start_m
    if site.kind in _CONFLICT_POINTS:
        needed_m = min(needed_m, _LEAST_QUIET_M)
    return max(emv.start_m, -quiet_m) if quiet_m >= needed_m else None


def travel_lane(network: RoadNetwork, site: Site) -> Lane:
    """The site's approach lane.

    Where that is a shoulder, it is the driving lane next to it, because nobody arrives on a shoulder.
    """
    lane = network.lanes[site.approach_lane]
    if lane.kind is not LaneKind.SHOULDER:
        return lane
    return min(driving_lanes(network, lane.edge), key=lambda other: abs(other.position - lane.position))


def emv_start(network: RoadNetwork, site: Site, start_m: float) -> EmvStart:
    """The start at a distance from the beginning of the site's edge, negative before it.

    A start that would lie inside a junction or right before it is put before it, with a run-up. Before the site the
    lane is one that leads to the site's approach lane without a lane change, where there is such a lane, and otherwise
    the leftmost driving lane.

    Raises:
        MapError: the site's approach or the site itself is too short.
    """
    start = _placed(network, site, start_m)
    if missing_m := _missing_m(network, start):
        raise MapError(site.name, f"a place with {missing_m:.0f} m more of road for the EMV's start")
    return start


def _missing_m(network: RoadNetwork, start: EmvStart) -> float:
    """Length by which a start lies before the first lane of the way to the site or behind the last one."""
    return max(-start.front_m, start.front_m - network.lanes[start.lane].length_m, 0.0)


def _placed(network: RoadNetwork, site: Site, start_m: float) -> EmvStart:
    """The start, beyond the end of the lane where the road is too short."""
    position = site.site_position
    lane = travel_lane(network, site)
    to_site: tuple[int, ...] = (lane.index,)
    while start_m < 0.0 and position > 0:
        position -= 1
        lane, via = lane_before(network, lane, site.route[position])
        to_site = (lane.index, *via, *to_site)
        run_up_m = min(_RUN_UP_M, max(lane.length_m - ENTRY_M, 0.0))
        start_m = min(start_m + network.length_m(via), -run_up_m) + lane.length_m
    while start_m > lane.length_m and position + 1 < len(site.route):
        chain = chain_along(network, lane, site.route[position : position + 2])
        position, start_m = position + 1, start_m - (chain.start_m[-1] if len(chain.lanes) > 1 else lane.length_m)
        lane = network.lanes[chain.lanes[-1]]
        to_site = (lane.index,)
    return EmvStart(lane.index, start_m, site.route[position:], to_site)


def lane_before(network: RoadNetwork, lane: Lane, edge: int) -> tuple[Lane, tuple[int, ...]]:
    """The leftmost lane of an edge that leads to a lane of the same kind, and the junction path between them."""
    leading = [
        (network.lanes[connection.from_lane], connection.via)
        for connection in network.connections_to.get(lane.index, ())
        if network.lanes[connection.from_lane].edge == edge and network.lanes[connection.from_lane].kind is lane.kind
    ]
    if leading:
        return max(leading, key=lambda lane_and_via: lane_and_via[0].position)
    return driving_lanes(network, edge)[-1], ()


def way_to_stop_line_m(network: RoadNetwork, start: EmvStart) -> float:
    """Length of the way from the start to the end of the site's edge."""
    return network.length_m(start.lanes_to_site) - start.front_m


def unhindered_arrival_s(network: RoadNetwork, start: EmvStart, emv: EmvDemand, bound_s: float | None = None) -> float:
    """Time from step 0 to the stop line on a free road: speeding up, and slowing down for bends.

    And for the line itself, if others have the right of way there from ``bound_s`` before the arrival on, and the bends
    beyond it; for neither without ``bound_s``.
    """
    way_m, speed = _speeds_mps(network, start, emv, bound_s)
    driven_m = np.minimum(SAMPLE_M, way_m - start.front_m - SAMPLE_M * np.arange(len(speed)))
    return float(np.sum(driven_m / np.maximum(speed, _CREEP_MPS)))


def depart_speed_mps(network: RoadNetwork, start: EmvStart, emv: EmvDemand) -> float:
    """The template's speed at the start, or a lower one if the bends ahead require it."""
    _, speed = _speeds_mps(network, start, emv)
    return float(speed[0]) if len(speed) else emv.depart_speed_mps


_EMV_QUEUE_BRAKE_MPS2: Final = 2.5
"""Deceleration with which an EMV can stop behind vehicles that stand ahead of it at its start."""
_EMV_QUEUE_GAP_M: Final = 4.0
"""The gap that it leaves to them."""
_EMV: Final = EmvDriver().driving


def behind_queue_mps(network: RoadNetwork, start: EmvStart, others: Sequence[PlannedVehicle]) -> float:
    """The largest speed at the start from which an EMV stops gently, or falls in, behind vehicles ahead in its lanes.

    Infinite where nobody is ahead of it on the way to the site.
    """
    lengths_m = (network.lanes[lane].length_m for lane in start.lanes_to_site)
    begins_m = dict(zip(start.lanes_to_site, accumulate(lengths_m, initial=-start.front_m), strict=False))
    spots = ((vehicle.spot, vehicle.spot.front_m - vehicle.length_m) for vehicle in others)
    gaps_m = [(begins_m[spot.lane] + rear_m, spot.speed_mps) for spot, rear_m in spots if spot.lane in begins_m]
    free_m = [(max(gap_m - _EMV_QUEUE_GAP_M - _EMV.headway_s * mps, 0.0), mps) for gap_m, mps in gaps_m if gap_m > 0.0]
    return min((speed_before_mps(mps**2, _EMV_QUEUE_BRAKE_MPS2, way_m) for way_m, mps in free_m), default=math.inf)


EMV_ACCEL_MPS2: Final = 2.0
"""Acceleration with which an EMV comes to its target speed, in the estimate of its arrival."""
_EMV_BENDS_M: Final = 50.0
"""Road beyond a line whose bends slow an EMV at the line: it stops from 50 km/h on it with this deceleration."""
_AT_LINE: Final = EmvDriver().lines
_LINE_MPS: Final = Attention().emv_line_mps.mean


def bound_s_of(site: Site, template: Template) -> float:
    """Time before the EMV's arrival at the line from which on others have the right of way there."""
    if site.kind is SiteKind.STOP_JUNCTION:
        return math.inf
    return template.signal.red_before_arrival_s if template.signal and site.kind in _CONFLICT_POINTS else 0.0


def _speeds_mps(
    network: RoadNetwork, start: EmvStart, emv: EmvDemand, bound_s: float | None = None
) -> tuple[float, Floats]:
    """Length of the lanes to the stop line, and the largest speeds at samples of the way from the start on.

    They keep the target speed and the limits of lateral acceleration, speeding up and braking. Towards a line they are
    those of an EMV that slows down as soon as others have the right of way there, and for the bends beyond the line.
    """
    way = Polyline.joined([network.lanes[lane].centre for lane in start.lanes_to_site])
    if start.front_m >= way.length_m:
        return way.length_m, np.empty(0)
    ahead = way.cut(start.front_m, way.length_m)
    left_m = ahead.length_m - np.arange(0.0, ahead.length_m, SAMPLE_M)
    last = network.lanes[start.lanes_to_site[-1]]
    if bound_s is not None and last.edge in start.route:
        onward = chain_along(network, last, start.route[start.route.index(last.edge) :][:2]).lanes
        whole = Polyline.joined([way, *(network.lanes[lane].centre for lane in onward[1:])])
        ahead = whole.cut(start.front_m, way.length_m + _EMV_BENDS_M)
    seen_m = emv.speed_mps * (bound_s or 0.0) - left_m
    eased = np.sqrt(np.maximum(emv.speed_mps**2 - 2.0 * _AT_LINE.ease_off_mps2 * np.maximum(seen_m, 0.0), 0.0))
    line = np.maximum(eased, np.sqrt(_LINE_MPS**2 + 2.0 * _AT_LINE.brake_mps2 * left_m))
    bends = np.minimum(emv.speed_mps, bend_speeds_mps(ahead, _EMV.lateral_accel_mps2))
    speed = np.minimum(line, with_braking(bends, _EMV.path_brake_mps2)[: len(line)])
    speed = with_braking(speed, _EMV.path_brake_mps2)
    return way.length_m, with_accelerating(speed, emv.depart_speed_mps, EMV_ACCEL_MPS2)


class Approach(NamedTuple):
    """How well an EMV can drive up to a site."""

    rank: int = 0
    """0 is best. 1: a way with junctions, or before a turn on a shoulder without space for a queue and the way onto
    the shoulder. 2: sharp bends, no space for a queue, or hardly any road behind the site. 3: no road for the start."""
    flaw: Lack | None = None
    """What the approach lacks; None for rank 0."""


def _flawed(rank: int, text: str, missing_m: float | None = None) -> Approach:
    return Approach(rank, Lack(text, missing_m))


def approach_to(network: RoadNetwork, site: Site, emv: EmvDemand) -> Approach:
    """How well an EMV can drive up to a site.

    At a junction before the site others delay the EMV, and in sharp bends it meets oncoming vehicles late. It then
    misses those whom it is to meet at a signal or a stop sign; elsewhere the vehicles that it meets wait. A queue that
    does not fit before the line waits at the junction before, and the EMV behind it. To a shoulder next to a queue the
    EMV changes behind the queue and after the junction before.
    """
    if site.kind is SiteKind.SHOULDER_RIGHT_TURN:
        needed_m = ONTO_SHOULDER_M + SHORT_QUEUE_M
        quiet_m = quiet_reach_m(network, travel_lane(network, site).index, needed_m)
        return Approach() if quiet_m >= needed_m else _flawed(1, f"a junction less than {needed_m:.0f} m before it")
    if site.kind not in _CONFLICT_POINTS:
        return Approach()
    start = _placed(network, site, start_m_of(network, site, emv))
    if missing_m := _missing_m(network, start):
        return _flawed(3, "more road for the EMV's start", missing_m)
    way_m = way_to_stop_line_m(network, start)
    pace_mps = way_m / max(unhindered_arrival_s(network, start, emv), SAMPLE_M)
    queue_m = quiet_reach_m(network, travel_lane(network, site).index, LEAST_QUEUE_M)
    exit_m = sum(driving_lanes(network, edge)[-1].length_m for edge in site.beyond)
    at_entry = start.front_m < min(ENTRY_M, network.lanes[start.lane].length_m)
    flaws = (
        (queue_m < LEAST_QUEUE_M, _flawed(2, f"a junction less than {LEAST_QUEUE_M:.0f} m before it")),
        (exit_m < _LEAST_EXIT_M, _flawed(2, LITTLE_BEHIND)),
        (pace_mps < _LEAST_PACE * emv.speed_mps, _flawed(2, "sharp bends on the way to it")),
        (at_entry, _flawed(2, "an approach without space for the EMV at its start")),
        (_quiet_start(network, site, emv) is None, _flawed(1, "a junction on the way to it")),
    )
    return next((approach for is_so, approach in flaws if is_so), Approach())


_WORTH_M: Final = SHORTEST_ROAD_M
"""A way on must be longer by this, the length of road on which an interaction finds place, to replace another one."""


def long_enough_route(
    factory: VehicleFactory, route: tuple[int, ...], site: Site, needed_m: float, rng: np.random.Generator
) -> tuple[int, ...]:
    """The route; where it would leave the map too early, with another way on after the site.

    Of the ways on, those that keep most of the route come first; where none is long enough, the
    longest way found is taken. One that is hardly longer is not worth a turn.
    """
    # The stretch makes the interaction; at a junction the edge after the EMV's movement belongs to it, too.
    needed = (site.site_edge, *site.stretch, *(() if site.junction is None else site.beyond[:1]))
    kept_at_least = max(route.index(edge) for edge in needed if edge in route) + 1
    best, best_m = route, factory.length_m(route)
    for kept in range(len(route), kept_at_least - 1, -1):
        for _ in range(_ROUTE_TRIES):
            if best_m >= needed_m:
                return best
            way = factory.draw_way(route[:kept], needed_m, rng)
            if factory.length_m(way) > min(best_m + _WORTH_M, needed_m):
                best, best_m = way, factory.length_m(way)
    return best


_CAR_M: Final = 4.5
_INSIDE_M: Final = 8.0
"""Length of a car plus a margin. A car whose rear is this far before the junction's end is inside when the EMV comes to
the line."""


def early_m_of(network: RoadNetwork, site: Site, group: DemandGroup) -> float:
    """By how much a stream's last vehicle is nearer to the EMV than its gap says; negative where it is farther away.

    It has to be inside when the EMV comes to the line, and its light red by then, which counts more.
    """
    inside_m, least_m = _gaps_m(network, site, group)
    return group.first_gap_m - max(min(group.first_gap_m, inside_m), least_m)


def stays_inside(network: RoadNetwork, site: Site, group: DemandGroup) -> bool:
    """Whether the last vehicle of a stream can be inside when the EMV comes; true of other groups."""
    inside_m, least_m = _gaps_m(network, site, group)
    return inside_m >= least_m or group.anchor is not GroupAnchor.ARRIVAL or group.optional


def _gaps_m(network: RoadNetwork, site: Site, group: DemandGroup) -> tuple[float, float]:
    """Largest gap from a stream to the EMV at the line with which it is inside, and the least one with a red light."""
    ways = [network.connections[way] for way in site.connections]
    red_s = max(ways[-1].yellow_s - YELLOW_DRIVEN_S, 0.0) + BEFORE_EMV_S
    least_m = group.speed_mps * red_s - _CAR_M if ways[-1].signal_id is not None else -math.inf
    return max(network.length_m(way.via) for way in ways) - _INSIDE_M, least_m


_NO_CROSSING: Final = "a side street at its junction with enough road for another EMV (emv.crossing is above 0)"
_NEXT_WAY_S: Final = 2.0
_MOST_OFF_S: Final = 5.0
"""Largest difference between the arrivals at the junction with which the two EMVs still meet there."""


def following_starts(network: RoadNetwork, site: Site, emv: EmvDemand, headway_m: float) -> list[EmvStart]:
    """The starts of all EMVs on one route, the foremost first. The approach is made longer as far as they need it.

    Raises:
        MapError: the map has no road that leads to the approach and is long enough.
    """
    start_m = start_m_of(network, site, emv)
    starts = [emv_start(network, site, start_m)]
    for number in range(1, emv.count):
        try:
            starts.append(emv_start(network, site, start_m - number * headway_m))
        except MapError:
            longer = prolonged(network, site, number * headway_m - start_m)
            starts.append(emv_start(network, longer, start_m - number * headway_m))
    return starts


def prolonged(network: RoadNetwork, site: Site, approach_m: float) -> Site:
    """The site with a route that begins at least this far before its edge, where roads lead there."""
    graph = EdgeGraph.of(network)
    missing_m = approach_m - graph.route_length_m(site.route[: site.site_position])
    before = way_back(graph, site.route[: site.site_position + 1], missing_m)
    return replace(site, route=(*before, *site.route), site_position=len(before) + site.site_position)


def arrival_s(
    network: RoadNetwork, site: Site, start: EmvStart, edge: int, emv: EmvDemand, bound_s: float = 0.0
) -> float:
    """Time from step 0 to the end of an edge of the way through a site, as ``unhindered_arrival_s`` gives it."""
    route = start.route
    last = route.index(edge)
    # On a long way, an EMV that starts behind the site's edge may come back to it.
    reached = route.index(site.site_edge) if site.site_edge in route[: last + 1] else 0
    further = route[reached + 1 : last + 1]
    way_m = sum(driving_lanes(network, beyond)[-1].length_m for beyond in further)
    return unhindered_arrival_s(network, start, emv, bound_s) + way_m / emv.speed_mps


def crossing_ways(network: RoadNetwork, site: Site, start: EmvStart) -> tuple[tuple[Site, ...], int]:
    """Ways on which another EMV can cross the first one's way, best first, and the edge at the end of which they cross.

    It is at the site's junction, or for a road at the first junction behind it that has a side street.

    Raises:
        MapError: there is no such junction.
    """
    route = start.route
    first = route.index(site.stretch[-1]) if site.stretch[-1] in route else 0
    for edge, following in pairwise(route[first:]):
        movements = civilian_movements(network, edge, following)
        own = [network.connections[index] for index in site.connections] if edge == site.stretch[-1] else movements
        found = tuple(_side_streets(network, site, own[-1])) if own else ()
        if found:
            return found, edge
        if site.junction is not None:
            break
    raise MapError(site.name, _NO_CROSSING)


def _side_streets(network: RoadNetwork, site: Site, own: Connection) -> Iterator[Site]:
    """Movements from the side whose way crosses another one, or leads to the same road.

    Of them those straight on come first, then those that do not lead off the map soon.
    """
    crossing, exit_edge = crossing_connections(network, own), network.lanes[own.to_lane].edge
    lasting = EdgeGraph.of(network).endless_edges
    ways: dict[tuple[int, int], tuple[bool, bool, bool, int]] = {}
    for index, way in network.connections_at[own.junction]:
        ends = network.lanes[way.from_lane].edge, network.lanes[way.to_lane].edge
        from_side = network.is_civilian(way) and comes_from_the_side(network, own, way) and way.direction != "t"
        if from_side and (index in crossing or ends[1] == exit_edge):
            ways.setdefault(ends, (index not in crossing, way.direction != "s", ends[1] not in lasting, index))
    for edge, following in sorted(ways, key=lambda ends: ways[ends]):
        movements = civilian_movements(network, edge, following)
        yield junction_site(EdgeGraph.of(network), site.kind, movements, (edge,))


def crossing_start(
    network: RoadNetwork,
    sites: Sequence[Site],
    emv: EmvDemand,
    wanted_s: float,
    placed: Sequence[PlannedVehicle],
) -> tuple[Site, EmvStart]:
    """The start from which an EMV comes unhindered to a junction nearest to a time.

    Args:
        network: The map.
        sites: Ways over the junction, best first: a later one has to come nearer by two seconds.
        emv: Speeds of the EMV.
        wanted_s: Time from step 0.
        placed: Vehicles that are there already; the EMV starts clear of them.

    Raises:
        MapError: No way has a place for the start, or the road of all is too short.
    """
    found: list[tuple[float, int, Site, EmvStart]] = []
    for number, site in enumerate(sites):
        way = prolonged(network, site, emv.speed_mps * max(wanted_s, 0.0))
        for start in _starts_back(network, way):
            late_s = unhindered_arrival_s(network, start, emv) - wanted_s
            if start.front_m >= ENTRY_M and _is_clear(start, placed):
                if abs(late_s) < _MOST_OFF_S:
                    found.append((abs(late_s) + _NEXT_WAY_S * number, len(found), way, start))
                if late_s > 0.0:
                    break
    if not found:
        raise MapError(sites[0].name, _NO_CROSSING)
    return min(found)[2:]


def _starts_back(network: RoadNetwork, site: Site) -> Iterator[EmvStart]:
    """Starts before a stop line, each farther back than the one before, as far as the approach reaches."""
    line_m = network.lanes[site.approach_lane].length_m
    with suppress(MapError):
        for before_m in count(EMV_CLEARANCE_M):
            yield emv_start(network, site, line_m - before_m)


def _is_clear(start: EmvStart, placed: Sequence[PlannedVehicle]) -> bool:
    """Whether the start's lane is free of vehicles, up to a clearance ahead and behind."""
    near = (vehicle for vehicle in placed if vehicle.spot.lane == start.lane)
    return all(abs(vehicle.spot.front_m - start.front_m) > 2.0 * EMV_CLEARANCE_M for vehicle in near)
