"""Decides who waits where two paths meet: by time windows, right of way, and the ability to stop.

It also tells how far a vehicle may go onto a junction before it blocks vehicles from elsewhere.
"""

import math
from collections import defaultdict
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from enum import IntEnum
from functools import lru_cache
from itertools import permutations, product
from typing import Final, NamedTuple

import numpy as np

from siren_ros.base.numerics import braking
from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.compiled import compiled
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.conflicts.zones import MET, SAME_DIRECTION, STEP_M, Way, Ways, Zone, search_among
from siren_ros.simulation.roads.road_network import MAPS_KEPT, Connection, RoadNetwork
from siren_ros.simulation.roads.routing import movement_path
from siren_ros.simulation.scenario.driver_parameters import ConflictConfig


class Rank(IntEnum):
    """Right of way; the higher rank goes first, equal ones in the order of arrival."""

    RED = 0
    """A vehicle that can stop will not come."""
    STOP_SIGN = 1
    CLEARING = 2
    """Yellow: a vehicle that cannot stop continues."""
    GIVES_WAY = 3
    """Green that gives way to oncoming traffic, or a minor road."""
    PRIORITY = 4
    """Green without conditions, a major road, or no junction at all."""


_STATES: Final = {Rank.PRIORITY: "GO", Rank.GIVES_WAY: "gso", Rank.CLEARING: "yY", Rank.RED: "ur"}
_OF_SIGNAL: Final[Mapping[str, Rank]] = {state: rank for rank, states in _STATES.items() for state in states}
"""SUMO's signal states (https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html, Signal state definitions)."""


def rank_of(connection: Connection, signals: Mapping[str, str]) -> Rank:
    """Present rank of a movement; a signal's state has one character per link."""
    state = signals.get(connection.signal_id or "", "")
    if 0 <= connection.signal_link < len(state):
        return _OF_SIGNAL.get(state[connection.signal_link], Rank.RED)
    if connection.must_stop:
        return Rank.STOP_SIGN
    return Rank.GIVES_WAY if connection.gives_way else Rank.PRIORITY


_RED: Final = int(Rank.RED)
_GIVES_WAY: Final = int(Rank.GIVES_WAY)
_PRIORITY: Final = int(Rank.PRIORITY)


@compiled
def rank_inside(rank: int, privileged: bool) -> int:
    """Rank of a vehicle on the junction: others leave it clear, unless it gives way there and has no privilege."""
    return rank if rank == _GIVES_WAY and not privileged else _PRIORITY


# These are no parameters: they keep quotients finite.
LEAST_WAY_M: Final = 0.3
_LEAST_TIME_S: Final = 0.1

MOST_BRAKE_MPS2: Final = 8.0
"""An emergency brake on a dry road."""

_USUAL: Final = ConflictConfig()


class Margins(NamedTuple):
    """Margins and decelerations at conflicts, as compiled code takes them; the first ones as ``ConflictConfig``."""

    before_s: float = _USUAL.before_s
    after_s: float = _USUAL.after_s or 0.0
    merge_s: float = _USUAL.merge_s
    commit_mps2: float = _USUAL.commit_mps2
    brake_mps2: float = _USUAL.brake_mps2
    early_mps2: float = _USUAL.early_mps2
    standoff_m: float = _USUAL.standoff_m
    room_m: float = _USUAL.room_m
    horizon_s: float = 8.0
    """Vehicles that arrive later do not count yet."""
    standing_mps: float = 0.3
    """Slower vehicles count as standing."""
    clearing_mps: float = 0.5
    """A moving vehicle is assumed to clear a zone at least at this speed."""

    @classmethod
    def of(cls, driver: ConflictConfig, after_s: float, horizon_s: float) -> "Margins":
        """The margins of a driver; ``after_s`` stands where the driver has none of its own."""
        own = vars(driver) | ({"after_s": after_s} if driver.after_s is None else {})
        return cls(**own, horizon_s=horizon_s)


class Bends(NamedTuple):
    """Least time along a path because of its bends."""

    times_s: Floats
    """Time from the path's start to each of its points; empty without a path."""
    spacing_m: float
    place_m: float
    """Start position on the path. Beyond the path's end its last speed continues."""


NO_BENDS: Final = Bends(np.empty(0), 1.0, 0.0)


class Approach(NamedTuple):
    """One of two vehicles whose paths meet."""

    speed_mps: float
    top_mps: float
    """Speed that it will not exceed."""
    accel_mps2: float
    """Acceleration up to that speed; negative if it slows down anyway."""
    rank: int
    bends: Bends = NO_BENDS
    length_m: float = 0.0
    """Length of the body behind its front."""


class Wait(NamedTuple):
    """Motion of a vehicle that lets another pass first."""

    speed_mps: float
    brake_mps2: float
    """Deceleration to stop before the zone, or to reach it after the other has left."""
    free_m: float
    """Distance to the zone, or to the place of the vehicle that merges in front."""


_braking_distance_m = compiled(braking.braking_distance_m)
_needed_brake_mps2 = compiled(braking.needed_brake_mps2)
_speed_before_mps = compiled(braking.speed_before_mps)


@compiled
def time_to_go_s(way_m: float, speed_mps: float, top_mps: float, accel_mps2: float) -> float:
    """Time for a distance from a speed, with an acceleration up to a top speed; infinite if it is never reached."""
    if way_m <= 0.0:
        return 0.0
    square = speed_mps * speed_mps + 2.0 * accel_mps2 * way_m
    top = max(top_mps, speed_mps)
    if math.isinf(way_m) or square < 0.0 or speed_mps == accel_mps2 == 0.0 or top == 0.0:
        return math.inf
    if accel_mps2 < 0.0:
        return (speed_mps - math.sqrt(square)) / -accel_mps2
    if accel_mps2 == 0.0 or speed_mps >= top:
        return way_m / speed_mps
    to_top = _braking_distance_m(top * top - speed_mps * speed_mps, accel_mps2)
    if way_m <= to_top:
        return (math.sqrt(square) - speed_mps) / accel_mps2
    return (top - speed_mps) / accel_mps2 + (way_m - to_top) / top


@compiled
def _time_at_s(bends: Bends, s_m: float) -> float:
    place = max(s_m / bends.spacing_m, 0.0)
    i = int(min(place, len(bends.times_s) - 2.0))
    low, high = bends.times_s[i], bends.times_s[i + 1]
    return low + (place - i) * (high - low)


@compiled
def bend_time_s(bends: Bends, way_m: float) -> float:
    """Least time for a distance, at the path's allowed speed."""
    if len(bends.times_s) == 0:
        return 0.0
    return _time_at_s(bends, bends.place_m + way_m) - _time_at_s(bends, bends.place_m)


@compiled
def approach_time_s(approach: Approach, way_m: float) -> float:
    """Time of an approach for a distance."""
    time_s = time_to_go_s(way_m, approach.speed_mps, approach.top_mps, approach.accel_mps2)
    return max(time_s, bend_time_s(approach.bends, way_m))


@compiled
def stop_brake_mps2(speed_mps: float, way_m: float) -> float:
    """Constant deceleration that stops within a distance."""
    return _needed_brake_mps2(speed_mps * speed_mps, max(way_m, LEAST_WAY_M))


@compiled
def later_brake_mps2(speed_mps: float, way_m: float, time_s: float) -> float:
    """Least constant deceleration with which a distance is not covered before a time."""
    if 2.0 * way_m < speed_mps * time_s:  # the vehicle stops before the time is over
        return stop_brake_mps2(speed_mps, way_m)
    return max(2.0 * (speed_mps * time_s - way_m) / (time_s * time_s), 0.0)


def wait_for(zone: Zone, own: Approach, other: Approach, config: Margins) -> Wait | None:
    """How the own vehicle must wait for the other; None if it need not. As ``least_wait``."""
    approaches = own._replace(rank=int(own.rank)), other._replace(rank=int(other.rank))
    wait = Wait(*least_wait(zone, *approaches, other.speed_mps**2, config))
    return None if math.isinf(wait.speed_mps) else wait


@compiled
def least_wait(
    zone: Zone, own: Approach, other: Approach, other_sq: float, config: Margins
) -> tuple[float, float, float]:
    """How the own vehicle must wait for the other, as a ``Wait``; its speed is infinite if it need not.

    It need not where both are in the zone at different times; where it has the right of way, or arrives first among
    equals, and the other one can still stop; and where only the other one can, be it by an emergency brake. A vehicle
    that can stop at a red signal does, and one that stands in the zone leaves it. ``zone`` is as the own vehicle sees
    it. ``other_sq`` is the square of the other one's speed.
    """
    need_not = np.inf, 0.0, np.inf
    merges = zone.along > SAME_DIRECTION
    if other.speed_mps < config.standing_mps and zone.other_in_m > 0.0:
        return need_not
    other_first = approach_time_s(other, zone.other_in_m)
    if other_first > config.horizon_s:
        return need_not
    leaving = max(min(other.speed_mps, other.top_mps), config.clearing_mps)
    other_last = np.inf if merges else zone.other_out_m / leaving
    stopping = own.accel_mps2 < 0.0 and not merges  # the vehicle keeps the distance of those who wait
    own_first = approach_time_s(own, zone.own_in_m - config.standoff_m if stopping else zone.own_in_m)
    if merges:
        ahead = own_first + config.merge_s < other_first
    else:
        ahead = approach_time_s(own, zone.own_out_m) + config.before_s < other_first
    if ahead or own_first > other_last + config.after_s:
        return need_not
    if _goes_first(zone, own, other, own_first < other_first, config):
        return need_not
    return _waiting(zone, own, other, other_sq, other_last + config.after_s, config)


@compiled
def _goes_first(zone: Zone, own: Approach, other: Approach, own_earlier: bool, config: Margins) -> bool:
    if zone.own_in_m <= 0.0:
        return math.isinf(zone.blocked_m)
    merges = zone.along > SAME_DIRECTION
    theirs = _yield_brake_mps2(zone.other_in_m, other, zone.own_in_m, own, merges, config)
    mine = _yield_brake_mps2(zone.own_in_m, own, zone.other_in_m, other, merges, config)
    if theirs > config.commit_mps2 and not merges:
        return mine > MOST_BRAKE_MPS2 >= theirs and zone.other_in_m > 0.0
    if max(theirs, mine) > config.commit_mps2:
        return mine > theirs and zone.other_in_m > 0.0
    return own.rank > other.rank or (own.rank == other.rank and (own_earlier or other.rank == _RED))


@compiled
def _yield_brake_mps2(
    way_m: float, own: Approach, first_way_m: float, first: Approach, merges: bool, config: Margins
) -> float:
    """Deceleration to let another vehicle go first: by a stop, or by merging behind it.

    Ways are those to the zone.
    """
    if not merges:
        return stop_brake_mps2(own.speed_mps, way_m - config.standoff_m)
    gap_m = way_m - first_way_m - first.length_m - STEP_M - config.standoff_m
    return fall_in_brake_mps2(own.speed_mps - first.speed_mps, gap_m, approach_time_s(first, first_way_m))


@compiled
def fall_in_brake_mps2(closing_mps: float, gap_m: float, time_s: float) -> float:
    """Least constant deceleration that keeps a gap behind another vehicle at a time.

    ``gap_m`` is what is left of the way between the two, negative where it has to grow. ``time_s`` is when the other
    vehicle merges, infinite where it never does.
    """
    if gap_m > 0.0 and 2.0 * gap_m < closing_mps * time_s:  # the vehicle is as slow as the other one before that time
        return stop_brake_mps2(closing_mps, gap_m)
    if math.isinf(time_s):
        return 0.0
    time = max(time_s, _LEAST_TIME_S)
    return max(2.0 * (closing_mps * time - gap_m) / (time * time), 0.0)


@compiled
def _gap_m(zone: Zone, other: Approach) -> float:
    """Distance to the rear of the body that merges in front; negative next to it.

    Its front comes to the zone first. What of it follows is less the more it already is in line.
    """
    turns = min((1.0 - zone.blocked_along) / (1.0 - SAME_DIRECTION), 1.0)
    return zone.own_in_m - zone.other_in_m - turns * other.length_m - STEP_M


@compiled
def _waiting(
    zone: Zone, own: Approach, other: Approach, other_sq: float, free_s: float, config: Margins
) -> tuple[float, float, float]:
    if zone.along > SAME_DIRECTION:
        gap = _gap_m(zone, other)
        spare = gap - config.standoff_m
        speed = _speed_before_mps(other_sq, config.brake_mps2, max(spare, 0.0))
        speed = max(speed + min(spare, 0.0) / config.merge_s, 0.0)
        closing, time = own.speed_mps - other.speed_mps, max(approach_time_s(other, zone.other_in_m), _LEAST_TIME_S)
        brake = stop_brake_mps2(max(closing, 0.0), gap)
        if 2.0 * gap < closing * time:  # this vehicle may have to be slower by the time the other one merges
            brake = min(brake, 2.0 * (closing * time - gap) / (time * time))
        return speed, brake, max(gap, 0.0)
    way = zone.own_in_m if zone.own_in_m > 0.0 else zone.blocked_m
    free = max(way - config.standoff_m, 0.0)
    wanted = max(free - config.room_m, 0.0)
    speed = max(wanted / free_s, _speed_before_mps(0.0, config.brake_mps2, wanted))
    return speed, later_brake_mps2(own.speed_mps, free, free_s), free


# These are no parameters: resolution and width of the paths.
_SPACING_M: Final = 0.5
_CLEAR_M: Final = 1.0
"""Distance kept between the middle of a body and the edge of others' paths."""


class JunctionRoom:
    """Caches where the paths of others begin on each movement of a map."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._starts: dict[tuple[int, int, int], tuple[tuple[Connection, float], ...]] = {}

    def beyond_line_m(
        self,
        movement: Connection,
        signals: Mapping[str, str],
        occupied: AbstractSet[int],
        quiet: AbstractSet[int] = frozenset(),
        side: int = 0,
    ) -> float:
        """Distance beyond the stop line that a vehicle's front may go without blocking others.

        Infinite if none may come. ``side`` is the edge of its lane at which the vehicle is, +1 left, -1 right, 0 none:
        those who are on the junction already need the space, as they cannot wait before their line any more.

        Others come from other approaches. They may come where no red light holds them, or if they are on the junction
        already: ``occupied`` are the lanes with vehicles. From the lanes in ``quiet`` nobody comes.
        """
        coming = [
            start_m
            for other, start_m in self._others(movement, 0)
            if rank_of(other, signals) is not Rank.RED and other.from_lane not in quiet
        ]
        coming += [start_m for other, start_m in self._others(movement, side) if not occupied.isdisjoint(other.via)]
        return min(coming, default=math.inf)

    def _others(self, movement: Connection, side: int) -> tuple[tuple[Connection, float], ...]:
        key = movement.from_lane, movement.to_lane, side
        if key not in self._starts:
            network, approach = self._network, self._network.lanes[movement.from_lane].edge
            others = (
                other
                for _, other in network.connections_at.get(movement.junction, ())
                if network.lanes[other.from_lane].edge != approach and network.is_civilian(other)
            )
            starts = ((other, self._start_m(movement, other, side)) for other in others)
            self._starts[key] = tuple((other, start_m) for other, start_m in starts if start_m < math.inf)
        return self._starts[key]

    def _start_m(self, movement: Connection, other: Connection, side: int) -> float:
        """Where the path of another movement, as wide as its lane, begins on a movement.

        Infinite if they do not meet.
        """
        own, its = (movement_path(self._network, item).resampled(_SPACING_M) for item in (movement, other))
        lanes = self._network.lanes
        aside_m = side * max(0.5 * lanes[movement.from_lane].width_m - _CLEAR_M, 0.0)
        points = own.offset_points(own.arc_m, aside_m)
        apart_m = np.linalg.norm(points[:, None] - its.points[None], axis=-1).min(axis=1)
        near = np.flatnonzero(apart_m < 0.5 * lanes[other.to_lane].width_m + _CLEAR_M)
        return float(own.arc_m[near[0]]) if len(near) else math.inf


_BUS_M: Final = 12.0, 2.55
"""Length and width of the largest vehicles (Directive 96/53/EC)."""


@lru_cache(maxsize=MAPS_KEPT)
def tight_lanes(network: RoadNetwork) -> frozenset[tuple[int, int]]:
    """Pairs of lanes, both ways round, that lead side by side across a junction, and in which two buses would touch.

    SUMO takes bodies in them for apart. In a swerve such lanes are nearer to each other than they are wide, and the
    tail of a bus cuts it.
    """
    beside = defaultdict(list)
    for way in network.connections:
        if way.via and network.is_civilian(way):
            beside[network.lanes[way.from_lane].edge, network.lanes[way.to_lane].edge].append(way)
    tight: set[tuple[int, int]] = set()
    for ways in beside.values():
        pairs = [
            (at, other)
            for at, other in permutations(range(len(ways)), 2)
            if ways[at].from_lane != ways[other].from_lane and ways[at].to_lane != ways[other].to_lane
        ]
        if pairs:
            zones = search_among(Ways.of([_bus_on(network, way) for way in ways]), np.array(pairs))
            for number in np.flatnonzero(zones[:, MET]).tolist():
                (via, onto), (other_via, other_onto) = ((ways[way].via, ways[way].to_lane) for way in pairs[number])
                tight.update(product((*via, onto), (*other_via, other_onto)))
                tight.remove((onto, other_onto))
    return frozenset(tight)


def _bus_on(network: RoadNetwork, way: Connection) -> Way:
    """A bus that comes to a junction and leaves it."""
    length_m, width_m = _BUS_M
    lanes = [network.lanes[lane].centre for lane in (way.from_lane, *way.via, way.to_lane)]
    line, start_m = Polyline.joined(lanes).resampled(STEP_M), max(lanes[0].length_m - 0.5 * length_m, 0.0)
    pose = (*line.at(start_m).tolist(), float(line.heading_rad(start_m)))
    spacing_m, reach_m = line.length_m / (len(line.points) - 1), network.length_m(way.via) + length_m
    half_m = 0.5 * length_m
    return Way(line.points, spacing_m, start_m, 0.0, pose, reach_m, half_m, 0.5 * width_m, half_m)
