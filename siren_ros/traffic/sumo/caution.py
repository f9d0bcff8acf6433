"""SUMO's drivers wait for vehicles that are driven from outside, where their ways meet.

SUMO lets its drivers give way by the time at which others have announced to arrive at a junction. A vehicle that is
moved from outside announces nothing, and one that runs a red signal is nobody's foe: SUMO would drive through it. So
its drivers are slowed here by the same rule by which the outside ones are driven.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final

import libsumo
import numpy as np

from siren_ros.conflicts.course import CourseBook, Outlook
from siren_ros.conflicts.yielding import LEAST_WAY_M, Approach, Wait, YieldingConfig, wait_for
from siren_ros.conflicts.zones import SAME_DIRECTION, Zone, search_among
from siren_ros.numerics.arrays import Flags, Floats, Ids
from siren_ros.numerics.compiled import compiled
from siren_ros.numerics.units import STEP_S
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.traffic.config import CautionConfig
from siren_ros.traffic.demand.plan import PlannedVehicle
from siren_ros.world.actors import Owner, rows_of_ids
from siren_ros.world.traffic_state import TrafficFlags, TrafficState

# No parameters: SUMO's codes.
_HARD_BRAKE_MODE: Final = 27
"""SUMO's speed mode 31 without its limit of deceleration (https://sumo.dlr.de/docs/TraCI: speed mode)."""
_FREE_MODE: Final = 31


@dataclass(frozen=True)
class Caution:
    """What one driver of SUMO does at this step."""

    actor_id: int
    other_id: int
    wait: Wait


def cautions(
    traffic: TrafficState,
    outlook: Outlook,
    config: CautionConfig,
    waiting: Collection[int] = (),
    inattentive: Collection[int] = (),
) -> tuple[Caution, ...]:
    """The waits of SUMO's drivers.

    They wait for vehicles that are driven from outside, and, where their bodies would touch, for each other on
    junctions: SUMO's waiting places there reach into the ways of others. Into bodies ahead they do not drive anywhere:
    SUMO knows of no corner that reaches into the next lane. Actors who waited at the step before (``waiting``) would go
    on if they need not; ``inattentive`` ones do not see vehicles from outside that come across their way.

    Returns:
        The strictest wait of each, sorted by actor.
    """
    inside = traffic.owner == Owner.SUMO
    speed = np.where(inside, traffic.sumo_speed_mps, traffic.speed_mps)
    held, blind = _flags(traffic.actor_id, waiting), _flags(traffic.actor_id, inattentive)
    accel = np.where(held, np.maximum(traffic.sumo_accel_mps2, 0.0), traffic.sumo_accel_mps2)
    counts = ~inside | ((traffic.flags & TrafficFlags.ON_JUNCTION) != 0)
    ways = outlook.ways
    bodies = ways.bodies.copy()
    bodies[:, 6] = config.ahead_s * speed + config.more_m
    bodies[~inside, 8] += config.margin_m
    poses = traffic.x_m, traffic.y_m, np.cos(traffic.yaw_rad), np.sin(traffic.yaw_rad)
    near = config.ahead_s, config.more_m, config.far_m, config.rolling_mps, config.beside_m
    late = config.behind_m, config.firm_mps2, config.gentle_mps2
    drivers = speed, outlook.half_length_m, inside, counts, held, blind
    pairs, zones, brakes = _meetings(poses, drivers, ways._replace(bodies=bodies), near, late)
    strictest: dict[int, tuple[int, Wait]] = {}
    for (row, other), values, brake_mps2 in zip(pairs.tolist(), zones.tolist(), brakes.tolist(), strict=True):
        zone = Zone(*values[1:])
        if zone.leads:
            wait = Wait(float(speed[other]), brake_mps2, _free_behind_m(zone.blocked_m, config.behind_m))
        else:
            margins = config.among if inside[other] else config.yielding
            crossing = _wait_across(row, other, zone, (speed, accel), outlook, config, margins)
            if crossing is None:
                continue
            wait = crossing
        if row not in strictest or wait.speed_mps < strictest[row][1].speed_mps:
            strictest[row] = other, wait
    ids = traffic.actor_id
    return tuple(Caution(int(ids[row]), int(ids[other]), wait) for row, (other, wait) in strictest.items())


def _flags(ids: Ids, members: Collection[int]) -> Flags:
    """Which of the actors, sorted by id, are among some."""
    flags = np.zeros(len(ids), np.bool_)
    if members:
        rows = rows_of_ids(ids, np.array(sorted(members), np.uint32))
        flags[rows[rows >= 0]] = True
    return flags


@compiled
def _near_pairs(poses: Any, speed_mps: Any, half_length_m: Any, inside: Any, counts: Any, limits: Any) -> Any:
    """Pairs of a vehicle of SUMO and another one, shape ``(P, 2)``, that counts or crosses in reach, or is close ahead.

    ``poses`` holds x, y, and the yaw's cosine and sine; ``limits`` the fields of ``CautionConfig`` that count here.
    Vehicles are looked at in the order of x, so that the work grows with the neighbours and not with all.
    """
    x_m, y_m, cos, sin = poses
    _, more_m, far_m, _, beside_m = limits
    n = len(x_m)
    order = np.argsort(x_m, kind="mergesort")
    place = np.empty(n, np.intp)
    for k in range(n):
        place[order[k]] = k
    widest = beside_m + (half_length_m.max() if n else 0.0)
    pairs, begin = np.empty((8 * n + 8, 2), np.intp), 0
    count = 0
    for row in range(n):
        if not inside[row]:
            continue
        farthest = max(far_m, speed_mps[row] + more_m + widest) + 1.0
        first, last = place[row], place[row] + 1
        while first > 0 and x_m[row] - x_m[order[first - 1]] < farthest:
            first -= 1
        while last < n and x_m[order[last]] - x_m[row] < farthest:
            last += 1
        begin = count
        for k in range(first, last):
            other = order[k]
            dx, dy = x_m[other] - x_m[row], y_m[other] - y_m[row]
            if other == row or abs(dy) > farthest:
                continue
            pose = dx, dy, cos[row], sin[row], cos[other], sin[other]
            if _is_near(pose, speed_mps[row], speed_mps[other], half_length_m[other], counts[other], limits):
                if count == len(pairs):
                    grown = np.empty((2 * count, 2), np.intp)
                    grown[:count] = pairs
                    pairs = grown
                pairs[count, 0], pairs[count, 1] = row, other
                count += 1
        pairs[begin:count, 1].sort()
    return pairs[:count]


@compiled
def _is_near(pose: Any, own_mps: float, other_mps: float, half_length_m: float, counts: bool, limits: Any) -> bool:
    """Whether a pair is near; ``pose`` holds the way to the other one, and the directions of both.

    Long vehicles at an angle reach far aside: the tail of a bus that changes lanes. Maps have roads that cross before
    their junction begins; so crossing does not ask where it happens.
    """
    dx, dy, cos, sin, other_cos, other_sin = pose
    ahead_s, more_m, far_m, rolling_mps, beside_m = limits
    apart = np.hypot(dx, dy)
    reach = min(ahead_s * (own_mps + other_mps) + 2.0 * more_m, far_m)
    ahead = cos * dx + sin * dy
    if apart < reach:
        along = abs(cos * other_cos + sin * other_sin)
        cross = own_mps > rolling_mps and other_mps > rolling_mps and along < SAME_DIRECTION and ahead > -more_m
        if counts or cross:
            return True
    if 0.0 < ahead < own_mps + more_m:
        return abs(cos * dy - sin * dx) < beside_m + half_length_m * abs(cos * other_sin - sin * other_cos)
    return False


@compiled
def _meetings(poses: Any, drivers: Any, ways: Any, near: Any, late: Any) -> tuple[Any, Any, Any]:
    """What SUMO's drivers may have to wait for: pairs ``(P, 2)`` as in ``_near_pairs``, zones, and braking.

    Left out are vehicles that merge among themselves and those that lead while there is room, which SUMO handles, and
    those from outside that come across the way of a driver who does not look. ``near`` and ``late`` are fields of
    ``CautionConfig``, ``drivers`` arrays over all vehicles. The deceleration is that behind a body that leads.
    """
    speed_mps, half_length_m, inside, counts, held, blind = drivers
    behind_m, firm_mps2, gentle_mps2 = late
    pairs = _near_pairs(poses, speed_mps, half_length_m, inside, counts, near)
    zones = search_among(ways, pairs)
    brakes = np.zeros(len(pairs))
    count = 0
    for p in range(len(pairs)):
        row, other = pairs[p, 0], pairs[p, 1]
        leads, merges = zones[p, 7] > SAME_DIRECTION, zones[p, 5] > SAME_DIRECTION
        if (
            zones[p, 0] == 0.0
            or not (inside[other] or leads or not blind[row])
            or (merges and inside[other] and not leads)
        ):
            continue
        brake = 0.0
        if leads:
            free = _free_behind_m(zones[p, 6], behind_m)
            closing = max(speed_mps[row] - speed_mps[other], 0.0)
            brake = closing * closing / (2.0 * max(free, LEAST_WAY_M))
            if free > 0.0 and brake <= (gentle_mps2 if held[row] else firm_mps2):
                continue
        pairs[count], zones[count], brakes[count] = pairs[p], zones[p], brake
        count += 1
    return pairs[:count], zones[:count], brakes[:count]


@compiled
def _free_behind_m(blocked_m: float, behind_m: float) -> float:
    """Way to a body ahead, without the distance that is kept from it."""
    return max(blocked_m - behind_m, 0.0)


def _wait_across(
    row: int,
    other: int,
    zone: Zone,
    motion: tuple[Floats, Floats],
    outlook: Outlook,
    settings: CautionConfig,
    margins: YieldingConfig,
) -> Wait | None:
    """How the driver in a row has to wait for another vehicle whose way it crosses or joins; None where it need not.

    ``motion`` holds the speeds and accelerations of all.
    """
    speed_mps, accel_mps2 = motion
    own_mps, slowing, other_mps = float(speed_mps[row]), float(accel_mps2[row]), float(speed_mps[other])
    top = max(outlook.limit_mps(row, zone.own_in_m), own_mps)
    accel = slowing if slowing < settings.slowing_mps2 else settings.accel_mps2
    return wait_for(
        zone,
        Approach(own_mps, top, accel, outlook.rank(row, zone.own_in_m)),
        Approach(other_mps, other_mps, min(float(accel_mps2[other]), 0.0), outlook.rank(other, zone.other_in_m)),
        margins,
    )


class CautiousDrivers:
    """The speeds that are imposed on SUMO's drivers."""

    def __init__(self, network: RoadNetwork, config: CautionConfig) -> None:
        self._book = CourseBook(network)
        self._config = config
        self._slowed: dict[str, int] = {}
        self._bodies: tuple[Ids, Floats, Floats] | None = None

    def apply(self, traffic: TrafficState | None, vehicles: Mapping[int, PlannedVehicle]) -> None:
        """Impose speeds for SUMO's next step, and free those who need not wait any more.

        ``traffic`` is the state before that step, None before the first one.
        """
        slowed = {} if traffic is None else self._speeds(traffic, vehicles)
        for name in sorted(self._slowed.keys() - slowed.keys()):
            libsumo.vehicle.setSpeed(name, -1.0)
            libsumo.vehicle.setSpeedMode(name, _FREE_MODE)
        for name, (_, speed_mps) in slowed.items():
            libsumo.vehicle.setSpeedMode(name, _HARD_BRAKE_MODE)
            libsumo.vehicle.setSpeed(name, speed_mps)
        self._slowed = {name: actor_id for name, (actor_id, _) in slowed.items()}

    def forget(self, name: str) -> None:
        """Drop a vehicle that has left SUMO, or that is driven from outside from now on."""
        self._slowed.pop(name, None)

    def _sizes_m(self, actor_id: Ids, vehicles: Mapping[int, PlannedVehicle]) -> tuple[Floats, Floats]:
        """Half lengths and half widths of actors; those of the call before where these are the same actors."""
        if self._bodies is None or not np.array_equal(self._bodies[0], actor_id):
            known = [vehicles[actor] for actor in actor_id.tolist()]
            half_length_m = np.array([0.5 * vehicle.length_m for vehicle in known])
            self._bodies = actor_id, half_length_m, np.array([0.5 * vehicle.width_m for vehicle in known])
        return self._bodies[1:]

    def _speeds(self, traffic: TrafficState, vehicles: Mapping[int, PlannedVehicle]) -> dict[str, tuple[int, float]]:
        """Actor and speed by the vehicle's name."""
        outlook = Outlook(traffic, self._book, *self._sizes_m(traffic.actor_id, vehicles))
        speeds = {}
        inattentive = [actor_id for actor_id, vehicle in vehicles.items() if not vehicle.attentive]
        for caution in cautions(traffic, outlook, self._config, self._slowed.values(), inattentive):
            row = int(np.searchsorted(traffic.actor_id, caution.actor_id))
            speed = float(traffic.sumo_speed_mps[row])
            vehicle = vehicles[caution.actor_id]
            brake = vehicle.driver.driving.decel_mps2
            if caution.wait.brake_mps2 > brake:
                brake = min(caution.wait.brake_mps2, self._config.most_brake_mps2)
            if caution.wait.speed_mps < speed + self._config.accel_mps2 * STEP_S:
                speed_mps = max(caution.wait.speed_mps, speed - brake * STEP_S, 0.0)
                speeds[vehicle.name] = caution.actor_id, speed_mps
        return speeds
