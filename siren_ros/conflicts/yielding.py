"""Yielding where two ways meet: by time windows, right of way, and the ability to stop."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from siren_ros.conflicts.zones import STEP_M, Zone
from siren_ros.numerics.braking import braking_distance_m, needed_brake_mps2, speed_before_mps
from siren_ros.roads.road_network import Connection


class Rank(IntEnum):
    """The higher one has the right of way; equals go in the order in which they arrive."""

    RED = 0
    """A vehicle that can stop will not come."""
    STOP_SIGN = 1
    CLEARING = 2
    """Yellow: a vehicle that cannot stop goes on."""
    GIVES_WAY = 3
    """Green that gives way to oncoming traffic, or a minor road."""
    PRIORITY = 4
    """Green without conditions, a major road, or no junction at all."""


_STATES: Final = {Rank.PRIORITY: "GO", Rank.GIVES_WAY: "gso", Rank.CLEARING: "yY", Rank.RED: "ur"}
_OF_SIGNAL: Final[Mapping[str, Rank]] = {state: rank for rank, states in _STATES.items() for state in states}
"""SUMO's signal states (https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html, Signal state definitions)."""


def rank_of(connection: Connection, signals: Mapping[str, str]) -> Rank:
    """The present rank of a movement; the state of a signal has one character per controlled link."""
    state = signals.get(connection.signal_id or "", "")
    if 0 <= connection.signal_link < len(state):
        return _OF_SIGNAL.get(state[connection.signal_link], Rank.RED)
    if connection.must_stop:
        return Rank.STOP_SIGN
    return Rank.GIVES_WAY if connection.gives_way else Rank.PRIORITY


def rank_inside(rank: Rank) -> Rank:
    """The rank of a vehicle on the junction: others leave it clear, unless the vehicle gives way on it."""
    return rank if rank is Rank.GIVES_WAY else Rank.PRIORITY


# No parameters: they keep quotients finite.
LEAST_WAY_M: Final = 0.3
_LEAST_TIME_S: Final = 0.1


@dataclass(frozen=True)
class YieldingConfig:
    """Margins and decelerations at conflicts."""

    before_s: float = 1.0
    """Post-encroachment time that the first vehicle keeps; conflicts below it are counted as serious (Allen, Shin and
    Cooper, "Analysis of traffic conflicts and collisions", 1978)."""
    after_s: float = 0.4
    """The same of the second vehicle, which sees the first one leave."""
    merge_s: float = 1.5
    """Headway of a vehicle that merges ahead of another one."""
    commit_mps2: float = 3.0
    """A vehicle that would have to brake harder than this to stop before the zone is expected to go on."""
    brake_mps2: float = 2.0
    """Deceleration that a waiting driver plans with."""
    early_mps2: float = 1.0
    """Acceleration that another vehicle may have up to the zone."""
    standoff_m: float = 1.0
    """Distance that a waiting vehicle keeps from the zone."""
    room_m: float = 0.0
    """More of it where that takes no hard braking: from there it is not in the zone before the other one is away."""
    horizon_s: float = 8.0
    """Vehicles that arrive later do not count yet."""
    standing_mps: float = 0.3
    """Slower vehicles stand."""
    clearing_mps: float = 0.5
    """A vehicle that moves at all is taken to clear a zone at this speed or faster."""


def _no_bends(way_m: float) -> float:  # noqa: ARG001 - stands for a function of the way
    return 0.0


@dataclass(frozen=True)
class Approach:
    """One of two vehicles whose ways meet."""

    speed_mps: float
    top_mps: float
    """Speed that it will not exceed."""
    accel_mps2: float
    """Acceleration that it may have up to that speed; negative where it slows down anyway."""
    rank: Rank
    bend_time_s: Callable[[float], float] = _no_bends
    """Time that a way takes at the least because of its bends."""

    def time_s(self, way_m: float) -> float:
        """Time for a way."""
        return max(time_to_go_s(way_m, self.speed_mps, self.top_mps, self.accel_mps2), self.bend_time_s(way_m))


@dataclass(frozen=True)
class Wait:
    """The motion of a vehicle that lets another one pass first."""

    speed_mps: float
    brake_mps2: float
    """Deceleration needed to stop before the zone, or to come to it when the other one has left it."""
    free_m: float
    """Way to the zone, or to the place of the vehicle that merges ahead."""


def time_to_go_s(way_m: float, speed_mps: float, top_mps: float, accel_mps2: float) -> float:
    """Time for a way from a speed with an acceleration up to a top speed; infinite where it is never reached."""
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
    to_top = braking_distance_m(top * top - speed_mps * speed_mps, accel_mps2)
    if way_m <= to_top:
        return (math.sqrt(square) - speed_mps) / accel_mps2
    return (top - speed_mps) / accel_mps2 + (way_m - to_top) / top


def stop_brake_mps2(speed_mps: float, way_m: float) -> float:
    """Constant deceleration that stops within a way."""
    return needed_brake_mps2(speed_mps * speed_mps, max(way_m, LEAST_WAY_M))


def later_brake_mps2(speed_mps: float, way_m: float, time_s: float) -> float:
    """Least constant deceleration with which a way is not covered before a time."""
    if 2.0 * way_m < speed_mps * time_s:  # stands before the time is over
        return stop_brake_mps2(speed_mps, way_m)
    return max(2.0 * (speed_mps * time_s - way_m) / (time_s * time_s), 0.0)


def wait_for(zone: Zone, own: Approach, other: Approach, config: YieldingConfig) -> Wait | None:
    """How the own vehicle has to wait for the other one, None where it need not.

    It need not where both are in the zone at different times; where it has the right of way, or arrives first among
    equals, and the other one can still stop; and where only the other one can. A vehicle that can stop at a red signal
    does, and one that stands in the zone leaves it. ``zone`` is as the own vehicle sees it.
    """
    if other.speed_mps < config.standing_mps and zone.other_in_m > 0.0:
        return None
    other_first = other.time_s(zone.other_in_m)
    if other_first > config.horizon_s:
        return None
    leaving = max(min(other.speed_mps, other.top_mps), config.clearing_mps)
    other_last = math.inf if zone.merges else zone.other_out_m / leaving
    stopping = own.accel_mps2 < 0.0 and not zone.merges  # keeps the distance of those who wait
    own_first = own.time_s(zone.own_in_m - config.standoff_m if stopping else zone.own_in_m)
    if zone.merges:
        ahead = own_first + config.merge_s < other_first
    else:
        ahead = own.time_s(zone.own_out_m) + config.before_s < other_first
    if ahead or own_first > other_last + config.after_s:
        return None
    if _goes_first(zone, own, other, own_first < other_first, config):
        return None
    return _waiting(zone, own, other, other_last + config.after_s, config)


def _goes_first(zone: Zone, own: Approach, other: Approach, own_earlier: bool, config: YieldingConfig) -> bool:
    if zone.own_in_m <= 0.0:
        return math.isinf(zone.blocked_m)
    if _yield_brake_mps2((zone.other_in_m, other), (zone.own_in_m, own), zone.merges, config) > config.commit_mps2:
        return False
    if _yield_brake_mps2((zone.own_in_m, own), (zone.other_in_m, other), zone.merges, config) > config.commit_mps2:
        return True
    return own.rank > other.rank or (own.rank == other.rank and (own_earlier or other.rank is Rank.RED))


def _yield_brake_mps2(
    second: tuple[float, Approach], first: tuple[float, Approach], merges: bool, config: YieldingConfig
) -> float:
    """Deceleration with which a vehicle lets another one go first: by a stop, or by falling in behind it.

    ``second`` and ``first`` hold the way to the zone and the approach of each.
    """
    way_m, own = second
    if not merges:
        return stop_brake_mps2(own.speed_mps, way_m - config.standoff_m)
    first_way_m, other = first
    gap_m = _gap_m(way_m, first_way_m) - config.standoff_m
    return fall_in_brake_mps2(own.speed_mps - other.speed_mps, gap_m, other.time_s(first_way_m))


def fall_in_brake_mps2(closing_mps: float, gap_m: float, time_s: float) -> float:
    """Least constant deceleration with which a gap is kept behind another vehicle at a time.

    ``gap_m`` is what is left of the way between the two, negative where it has to grow. ``time_s`` is when the other
    vehicle merges, infinite where it never does.
    """
    if gap_m > 0.0 and 2.0 * gap_m < closing_mps * time_s:  # is as slow as the other one before
        return stop_brake_mps2(closing_mps, gap_m)
    if math.isinf(time_s):
        return 0.0
    time = max(time_s, _LEAST_TIME_S)
    return max(2.0 * (closing_mps * time - gap_m) / (time * time), 0.0)


def _gap_m(way_m: float, first_way_m: float) -> float:
    """Way that is left to the body that merges ahead, from both ways to the zone; negative beside it."""
    return way_m - first_way_m - STEP_M


def _waiting(zone: Zone, own: Approach, other: Approach, free_s: float, config: YieldingConfig) -> Wait:
    if zone.merges:
        gap = _gap_m(zone.own_in_m, zone.other_in_m)
        spare = gap - config.standoff_m
        speed = speed_before_mps(other.speed_mps**2, config.brake_mps2, max(spare, 0.0))
        speed = max(speed + min(spare, 0.0) / config.merge_s, 0.0)
        brake = stop_brake_mps2(max(own.speed_mps - other.speed_mps, 0.0), gap)
        return Wait(speed, brake, max(gap, 0.0))
    way = zone.own_in_m if zone.own_in_m > 0.0 else zone.blocked_m
    free = max(way - config.standoff_m, 0.0)
    wanted = max(free - config.room_m, 0.0)
    speed = max(wanted / free_s, speed_before_mps(0.0, config.brake_mps2, wanted))
    return Wait(speed, later_brake_mps2(own.speed_mps, free, free_s), free)
