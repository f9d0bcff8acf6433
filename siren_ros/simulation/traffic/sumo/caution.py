"""SUMO's drivers wait for vehicles that are driven from outside, where their ways meet, and for people on crossings.

SUMO's own model heeds people before its drivers enter a junction, and not inside.

SUMO lets its drivers give way by the time at which others have announced to arrive at a junction. A vehicle that is
moved from outside announces nothing, and one that runs a red signal is nobody's foe: SUMO would drive through it. So
its drivers are slowed here by the same rule by which the outside ones are driven.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import libsumo
import numpy as np

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, Rows
from siren_ros.base.numerics.compiled import YAW, compiled
from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.conflicts.course import (
    CourseBook,
    Outlook,
    Rights,
    are_in,
    come_to,
    limit_at_mps,
    rank_at,
)
from siren_ros.simulation.conflicts.junction_approach import (
    ID,
    NOBODY,
    Line,
    Outlines,
    Passer,
    least_wait_for_people,
    outlines_of,
)
from siren_ros.simulation.conflicts.yielding import (
    LEAST_WAY_M,
    MOST_BRAKE_MPS2,
    Approach,
    Bends,
    Margins,
    Wait,
    least_wait,
)
from siren_ros.simulation.conflicts.zones import (
    ALONG,
    BLOCKED,
    BLOCKED_ALONG,
    HALF_LENGTH,
    HALF_WIDTH,
    LEFT,
    MET,
    OTHER,
    OTHER_IN,
    OWN,
    OWN_IN,
    PLACE,
    REACH,
    SAME_DIRECTION,
    SPACING,
    STEP_M,
    STRAIGHT_AFTER_M,
    Ways,
    Zone,
    follows_course,
    off_course,
    search_among,
    straight_to_m,
)
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.traffic.demand.plan import PlannedVehicle
from siren_ros.simulation.world.actors import TWO_WHEELED, Owner, TrafficFlags, TrafficState, rows_of_ids

# These are no parameters, but codes of SUMO.
_HARD_BRAKE_MODE: Final = 27
"""SUMO's speed mode 31 without its limit of deceleration (https://sumo.dlr.de/docs/TraCI: speed mode)."""
_FREE_MODE: Final = 31
_SPACE_M: Final = 0.2
"""Free space on both sides of riders. In bends SUMO's lanes are closer to each other than SUMO assumes."""
_LOOK_M: Final = 1.0
"""Distance that drivers look ahead in the direction of their heading, beyond their stopping distance."""
_BY_SUMO: Final = int(Owner.SUMO)
_SPEED, _BRAKE, _FREE = range(3)
"""Columns of waits, as the fields of ``Wait``."""
_ON_JUNCTION: Final = int(TrafficFlags.ON_JUNCTION)


@dataclass(frozen=True)
class Caution:
    """How one of SUMO's drivers has to wait at this step."""

    actor_id: int
    other_id: int
    wait: Wait


_TOWARDS_OUTSIDERS: Final = Margins(after_s=1.0)
"""Margins to vehicles that are driven from outside: behind an EMV, too, nobody passes in less than a second."""
AMONG_THEMSELVES: Final = Margins(before_s=0.0, after_s=0.2, standoff_m=1.3)
"""Among themselves SUMO's drivers keep its own margins; only contact is avoided. The tail of a bus cuts a tight
bend by 1.24 m, which its way along its lane does not show: who waits keeps this distance from it."""
_MARGIN_M: Final = 0.2
"""Margin that is added to each side of a vehicle that is driven from outside."""
WAYS_AHEAD_S: Final = 4.0
"""Time for which ways are predicted at the present speeds."""
WAYS_MORE_M: Final = 12.0
"""Length that is added to the predicted ways."""
WAYS_FAR_M: Final = 70.0
"""Greatest length of the predicted ways."""
_SUMO_ACCEL_MPS2: Final = 2.0
"""Acceleration of SUMO's drivers."""
ROLLING_MPS: Final = 0.3
"""Speed below which a vehicle counts as standing."""
BESIDE_M: Final = 3.0
"""Distance beside the own middle within which bodies ahead count."""
_BEHIND_M: Final = 0.3
"""Distance kept at least from a body ahead; SUMO's own is larger."""
_FIRM_MPS2: Final = 2.5
"""SUMO's drivers brake by themselves until more than this is needed."""
_GENTLE_MPS2: Final = 0.5
"""A driver who brakes for a body ahead goes on braking while more than this is needed."""
_SLOWING_MPS2: Final = -0.3
"""A driver who brakes harder is taken to go on braking."""


class Drivers(NamedTuple):
    """All vehicles of a step as compiled code takes them, row by row those of ``TrafficState``."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    speed_mps: Floats
    """Of SUMO's own vehicles the speed that SUMO has for them."""
    accel_mps2: Floats
    half_length_m: Floats
    inside: Flags
    """Whether SUMO drives a vehicle."""
    counts: Flags
    """Whether it counts wherever it is near: driven from outside, on a junction, or where roads lie over each other."""
    held: Flags
    """Whether its driver waited at the step before."""
    blind: Flags
    """Whether its driver does not see vehicles from outside that come across."""
    rides: Flags
    """Whether its driver is a rider."""


def cautions(
    traffic: TrafficState,
    outlook: Outlook,
    waiting: Collection[int] = (),
    inattentive: Collection[int] = (),
    riders: Collection[int] = (),
) -> tuple[Caution, ...]:
    """Finds which of SUMO's drivers have to wait.

    They wait for vehicles that are driven from outside, and, where their bodies would touch, for each other on
    junctions: SUMO's waiting places there reach into the ways of others. Into bodies ahead they do not drive anywhere:
    SUMO knows of no corner that reaches into the next lane. Drivers who change lanes look where they point, too, for
    vehicles that are driven from outside: these may stand at an angle. Of ``riders`` and others, who stands out of a
    bend leads as well: SUMO's lanes are parallel. Actors who waited at the step before (``waiting``) would go on if
    they need not; ``inattentive`` ones do not see vehicles from outside that come across their way.

    Returns:
        The strictest wait of each, sorted by actor.
    """
    ids = traffic.actor_id
    inside = traffic.owner == _BY_SUMO
    counts = ~inside | ((traffic.flags & _ON_JUNCTION) != 0)
    for lanes in (outlook.rights.overlying, outlook.rights.tight):
        if len(lanes):
            counts |= come_to(outlook.ways, outlook.rights, lanes, WAYS_AHEAD_S * traffic.speed_mps + WAYS_MORE_M)
    poses = traffic.x_m, traffic.y_m, traffic.yaw_rad
    speed_mps = np.where(inside, traffic.sumo_speed_mps, traffic.speed_mps)
    flags = inside, counts, _flags(ids, waiting), _flags(ids, inattentive), _flags(ids, riders)
    drivers = Drivers(*poses, speed_mps, traffic.sumo_accel_mps2, outlook.half_length_m, *flags)
    order, margins = np.argsort(traffic.x_m, kind="stable"), (_TOWARDS_OUTSIDERS, AMONG_THEMSELVES)
    pairs, waits = _strictest_waits(drivers, order, outlook.ways, outlook.rights, *margins, 2.0)
    found = zip(ids[pairs].tolist(), waits.tolist(), strict=True) if len(pairs) else ()
    return tuple(Caution(actor_id, other_id, Wait(*wait)) for (actor_id, other_id), wait in found)


def _flags(ids: Ids, members: Collection[int]) -> Flags:
    """Flags of the actors that are members of a collection; both are sorted by id."""
    flags = np.zeros(len(ids), np.bool_)
    if members:
        rows = rows_of_ids(ids, np.array(sorted(members), np.uint32))
        flags[rows[rows >= 0]] = True
    return flags


@compiled
def near_pairs(drivers: Drivers, order: Rows) -> Rows:
    """Pairs of a vehicle of SUMO and another one, shape ``(P, 2)``, that counts or crosses in reach, or is close ahead.

    Vehicles are looked at in the ``order`` of x, so that the work grows with the neighbours and not with all.
    """
    x_m, y_m, speed_mps, n = drivers.x_m, drivers.y_m, drivers.speed_mps, len(order)
    cos, sin = np.cos(drivers.yaw_rad), np.sin(drivers.yaw_rad)
    place = np.empty(n, np.intp)
    for k in range(n):
        place[order[k]] = k
    widest = BESIDE_M + (drivers.half_length_m.max() if n else 0.0)
    pairs, begin = np.empty((8 * n + 8, 2), np.intp), 0
    count = 0
    for row in range(n):
        if not drivers.inside[row]:
            continue
        farthest = max(WAYS_FAR_M, speed_mps[row] + WAYS_MORE_M + widest) + 1.0
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
            own, their = (cos[row], sin[row], speed_mps[row]), (cos[other], sin[other], speed_mps[other])
            if _is_near(dx, dy, *own, *their, drivers.half_length_m[other], drivers.counts[other]):
                if count == len(pairs):
                    pairs = np.concatenate((pairs, np.empty_like(pairs)))
                _insert(pairs, begin, count, row, other)
                count += 1
    return pairs[:count]


@compiled
def _insert(pairs: Rows, begin: int, end: int, row: int, other: int) -> None:
    """Puts a pair among the row's other ones, ``pairs[begin:end]``, which are sorted by the second one."""
    at = end
    while at > begin and pairs[at - 1, OTHER] > other:
        pairs[at, OWN], pairs[at, OTHER] = pairs[at - 1, OWN], pairs[at - 1, OTHER]
        at -= 1
    pairs[at, OWN], pairs[at, OTHER] = row, other


@compiled
def _is_near(
    dx_m: float,
    dy_m: float,
    cos: float,
    sin: float,
    own_mps: float,
    other_cos: float,
    other_sin: float,
    other_mps: float,
    half_length_m: float,
    counts: bool,
) -> bool:
    """Whether a pair is near, by the way to the other one, the directions and speeds of both, and the other's length.

    Long vehicles at an angle reach far aside: the tail of a bus that changes lanes. Maps have roads that cross before
    their junction begins; so crossing does not ask where it happens.
    """
    apart = np.hypot(dx_m, dy_m)
    reach = min(WAYS_AHEAD_S * (own_mps + other_mps) + 2.0 * WAYS_MORE_M, WAYS_FAR_M)
    ahead = cos * dx_m + sin * dy_m
    if apart < reach:
        along = abs(cos * other_cos + sin * other_sin)
        moving = own_mps > ROLLING_MPS and other_mps > ROLLING_MPS
        if counts or (moving and along < SAME_DIRECTION and ahead > -WAYS_MORE_M):
            return True
    if 0.0 < ahead < own_mps + WAYS_MORE_M:
        return abs(cos * dy_m - sin * dx_m) < BESIDE_M + half_length_m * abs(cos * other_sin - sin * other_cos)
    return False


@compiled
def _look_where_they_point(ways: Ways, pairs: Rows, zones: Floats, inside: Flags, reach_m: Floats) -> None:
    """Lets a vehicle from outside lead a driver who changes lanes and points at it within ``reach_m``, in ``zones``.

    The way along the present lane leads past it.
    """
    for p in range(len(pairs)):
        row, other = pairs[p, OWN], pairs[p, OTHER]
        passed = zones[p, BLOCKED] == np.inf and not inside[other]
        if passed and np.cos(ways.bodies[other, YAW] - ways.bodies[row, YAW]) > 0.0 and not follows_course(ways, row):
            blocked_m = straight_to_m(ways, row, other, reach_m[row])
            if blocked_m < np.inf:
                zones[p, MET], zones[p, BLOCKED], zones[p, BLOCKED_ALONG] = 1.0, blocked_m, 1.0


@compiled
def _cross_where_tight(ways: Ways, rights: Rights, pairs: Rows, zones: Floats, inside: Flags) -> None:
    """Lets ways in tight lanes count as ways that cross: behind the place where they meet they are apart again."""
    if len(rights.tight) == 0:
        return
    for p in range(len(pairs)):
        row, other = pairs[p, OWN], pairs[p, OTHER]
        meeting = zones[p, OWN_IN], zones[p, OTHER_IN]
        merges = zones[p, MET] > 0.0 and zones[p, ALONG] > SAME_DIRECTION
        if merges and inside[other] and are_in(ways, rights, rights.tight, (row, other), meeting):
            zones[p, ALONG] = 0.0


@compiled
def _agree_on_entries(pairs: Rows, zones: Floats, inside: Flags) -> None:
    """Puts each driver's own way to a zone where the other one, who crosses it, has to know it.

    The search finds the own way to an eighth of a metre and the other's to a metre: of two drivers who both took the
    other one to be farther away than it is, both would go first.
    """
    for p in range(len(pairs)):
        row, other = pairs[p, OWN], pairs[p, OTHER]
        if not inside[other] or zones[p, ALONG] > SAME_DIRECTION:
            continue
        for k in range(np.searchsorted(pairs[:, OWN], other), len(pairs)):
            if pairs[k, OWN] != other or pairs[k, OTHER] > row:
                break
            if pairs[k, OTHER] == row and abs(zones[k, OWN_IN] - zones[p, OTHER_IN]) <= STEP_M:
                zones[p, OTHER_IN] = zones[k, OWN_IN]


@compiled
def _wait_behind(drivers: Drivers, row: int, free_m: float, lead_mps: float) -> tuple[float, float, float]:
    """The wait behind a body on the same way: the driver must be as slow as the body before the free way is used up.

    As ``least_wait``. SUMO's drivers brake by themselves until they must do so firmly, or gently if they did already.
    """
    free, closing = max(free_m, 0.0), max(drivers.speed_mps[row] - lead_mps, 0.0)
    brake = closing * closing / (2.0 * max(free, LEAST_WAY_M))
    if free_m > 0.0 and brake <= (_GENTLE_MPS2 if drivers.held[row] else _FIRM_MPS2):
        return np.inf, 0.0, np.inf
    return lead_mps, brake, free


@compiled
def _ahead_m(ways: Ways, row: int, other: int) -> float:
    """How far a body is ahead of another one in its own direction: of two that touch in one direction, it goes on."""
    (x_m, y_m, yaw_rad), (other_x_m, other_y_m) = ways.bodies[row, :3], ways.bodies[other, :2]
    return np.cos(yaw_rad) * (x_m - other_x_m) + np.sin(yaw_rad) * (y_m - other_y_m)


@compiled
def _widened(ways: Ways, drivers: Drivers) -> Ways:
    """The ways as far as they are looked at, with wider bodies of those who are driven from outside."""
    bodies = ways.bodies.copy()
    for row in range(len(bodies)):
        bodies[row, REACH] = WAYS_AHEAD_S * drivers.speed_mps[row] + WAYS_MORE_M
        if not drivers.inside[row]:
            bodies[row, HALF_WIDTH] += _MARGIN_M
    return Ways(ways.points, ways.first, ways.last, bodies)


@compiled
def _drift_where_lying_over(ways: Ways, rights: Rights, inside: Flags) -> None:
    """Lets drivers in lanes that lie over others go on sideways, as they point: there SUMO knows of nobody beside them.

    A heading that comes back to the course evenly over a way moves a body aside by the sine times half of it.
    """
    if len(rights.overlying) == 0:
        return
    there = come_to(ways, rights, rights.overlying, np.zeros(len(inside)))
    for row in range(len(inside)):
        if inside[row] and there[row]:
            ways.bodies[row, LEFT] += 0.5 * STRAIGHT_AFTER_M * np.sin(off_course(ways, row)[1])


@compiled
def _strictest_waits(
    drivers: Drivers,
    order: Rows,
    ways: Ways,
    rights: Rights,
    outsiders: Margins,
    themselves: Margins,
    square: float,
) -> tuple[Rows, Floats]:
    """Rows of drivers who wait, with those for whom they wait most, ``(P, 2)``, and the waits ``(P, 3)``.

    Left out are vehicles that merge among themselves but for riders and where roads lie over each other, and those that
    lead while there is room, which SUMO handles, and those from outside that come across the way of a driver who does
    not look.
    A rider and another one who are beside each other do not go on together where their ways lead to the same place;
    nor do two where roads lie over each other. Of two that almost touch in one direction, the one in front goes on.

    ``order`` are the rows by x. The margins are those towards vehicles from outside, and among SUMO's own. ``square``
    is 2: by a constant, speeds would be squared with another last bit than Python's.
    """
    rides, n = drivers.rides, len(order)
    inside, speed_mps = drivers.inside, drivers.speed_mps
    widened, pairs = _widened(ways, drivers), near_pairs(drivers, order)
    _drift_where_lying_over(widened, rights, inside)
    zones = search_among(widened, pairs)
    _cross_where_tight(ways, rights, pairs, zones, inside)
    _agree_on_entries(pairs, zones, inside)
    _look_where_they_point(widened, pairs, zones, inside, speed_mps**square / (2.0 * _FIRM_MPS2) + _BEHIND_M + _LOOK_M)
    found, waits, count = np.empty((n, 2), np.intp), np.empty((n, 3)), 0
    for p in range(len(pairs)):
        row, other = pairs[p, OWN], pairs[p, OTHER]
        met, own_in, own_out, other_in, other_out, along, blocked, blocked_along = zones[p]
        leads, merges, ridden = blocked_along > SAME_DIRECTION, along > SAME_DIRECTION, rides[row] or rides[other]
        leads = leads or (merges and blocked < np.inf and ridden)
        unknown, meeting = inside[other] and (merges or leads), (blocked, 0.0) if leads else (own_in, other_in)
        unknown = unknown and are_in(ways, rights, rights.overlying, (row, other), meeting)
        ahead_m = _ahead_m(ways, row, other)
        nose_m = ahead_m + drivers.half_length_m[row] - drivers.half_length_m[other]
        beside_it = leads and not ridden and nose_m > 0.0 and follows_course(widened, row)
        if blocked <= 0.0 and (ahead_m > 0.0 if unknown else beside_it):
            continue
        sumos = merges and inside[other] and not ridden and not unknown
        if met == 0.0 or (not leads and ((drivers.blind[row] and not inside[other]) or sumos)):
            continue
        if leads:
            beside = unknown and -ahead_m < drivers.half_length_m[row] + drivers.half_length_m[other]
            lead_mps = 0.0 if beside or (ridden and blocked <= 0.0) else speed_mps[other]
            wait = _wait_behind(drivers, row, blocked - _BEHIND_M, lead_mps)
        else:
            zone = Zone(own_in, own_out, other_in, other_out, along, blocked, blocked_along)
            own, comes = _approaches(zone, row, other, drivers, ways, rights)
            margins = themselves if inside[other] else outsiders
            wait = least_wait(zone, own, comes, speed_mps[other] ** square, margins)
        if wait[_SPEED] == np.inf:
            continue
        if count == 0 or found[count - 1, OWN] != row:
            count += 1
        elif wait[_SPEED] >= waits[count - 1, _SPEED]:
            continue
        found[count - 1, OWN], found[count - 1, OTHER] = row, other
        waits[count - 1, _SPEED], waits[count - 1, _BRAKE], waits[count - 1, _FREE] = wait
    return found[:count], waits[:count]


@compiled
def _approaches(
    zone: Zone, row: int, other: int, drivers: Drivers, ways: Ways, rights: Rights
) -> tuple[Approach, Approach]:
    """How a driver and the other vehicle come to the zone where their ways meet.

    A driver who waited at the step before is not expected to slow down.
    """
    own_mps, other_mps, straight = drivers.speed_mps[row], drivers.speed_mps[other], Bends(np.empty(0), 1.0, 0.0)
    top = max(limit_at_mps(ways, rights, row, zone.own_in_m), own_mps)
    own_rank = rank_at(ways, rights, row, zone.own_in_m)
    rank = rank_at(ways, rights, other, zone.other_in_m)
    gains, slows = drivers.accel_mps2[row], min(drivers.accel_mps2[other], 0.0)
    gains = _SUMO_ACCEL_MPS2 if drivers.held[row] or gains >= _SLOWING_MPS2 else gains
    slows = 0.0 if drivers.held[other] else slows
    own = Approach(own_mps, top, gains, own_rank, straight, 2.0 * drivers.half_length_m[row])
    return own, Approach(other_mps, other_mps, slows, rank, straight, 2.0 * drivers.half_length_m[other])


class CautiousDrivers:
    """Tells SUMO the speeds of drivers who have to wait."""

    def __init__(self, network: RoadNetwork) -> None:
        self._book, self._crossings = CourseBook(network), outlines_of(network)
        self._slowed: dict[str, int] = {}
        self._actor_id: Ids | None = None
        """The vehicles that the following holds for: half lengths and widths, and actors who do not look, or ride."""
        self._half_length_m = self._half_width_m = np.empty(0)
        self._inattentive: list[int] = []
        self._riders: list[int] = []

    def apply(
        self,
        traffic: TrafficState | None,
        vehicles: Mapping[int, PlannedVehicle],
        people: Floats = NOBODY,
        scale_of: Callable[[int], float] = lambda _: 1.0,
    ) -> None:
        """Sets speeds for SUMO's next step, and frees drivers who need not wait any more.

        ``traffic`` is the state before that step, None before the first one; ``vehicles`` are those in it by actor id,
        ``people`` those on foot.
        ``scale_of`` a lane is as ``SumoPopulation.scale_of``.
        """
        self._slowed = {name: actor_id for name, actor_id in self._slowed.items() if actor_id in vehicles}
        slowed = {} if traffic is None else self._speeds(traffic, vehicles, people, scale_of)
        for name in sorted(self._slowed.keys() - slowed.keys()):
            libsumo.vehicle.setSpeed(name, -1.0)
            libsumo.vehicle.setSpeedMode(name, _FREE_MODE)
        for name, (_, speed_mps) in slowed.items():
            libsumo.vehicle.setSpeedMode(name, _HARD_BRAKE_MODE)
            libsumo.vehicle.setSpeed(name, speed_mps)
        self._slowed = {name: actor_id for name, (actor_id, _) in slowed.items()}

    def _know(self, actor_id: Ids, vehicles: Mapping[int, PlannedVehicle]) -> None:
        """Looks up the vehicles of a step, unless they are those of the step before."""
        if self._actor_id is not actor_id:
            known = [vehicles[actor] for actor in actor_id.tolist()]
            self._half_length_m = np.array([0.5 * vehicle.length_m for vehicle in known])
            ridden = np.array([vehicle.actor_class in TWO_WHEELED for vehicle in known], np.bool_)
            widths_m = np.array([0.5 * vehicle.width_m for vehicle in known])
            self._half_width_m = widths_m + np.where(ridden, _SPACE_M, 0.0)
            self._inattentive = [actor for actor in actor_id.tolist() if not vehicles[actor].attentive]
            self._riders, self._actor_id = actor_id[ridden].tolist(), actor_id

    def _speeds(
        self,
        traffic: TrafficState,
        vehicles: Mapping[int, PlannedVehicle],
        people: Floats = NOBODY,
        scale_of: Callable[[int], float] = lambda _: 1.0,
    ) -> dict[str, tuple[int, float]]:
        """Actor and ordered speed of each driver who waits, by the vehicle's name."""
        self._know(traffic.actor_id, vehicles)
        outlook = Outlook(traffic, self._book, self._half_length_m, self._half_width_m)
        speeds: dict[str, tuple[int, float]] = {}
        found = cautions(traffic, outlook, self._slowed.values(), self._inattentive, self._riders)
        if people.shape[1]:
            found = *found, *self._for_people(traffic, outlook, people)
        for caution in found:
            row = int(np.searchsorted(traffic.actor_id, caution.actor_id))
            speed = float(traffic.sumo_speed_mps[row])
            vehicle = vehicles[caution.actor_id]
            brake = max(vehicle.driver.driving.decel_mps2, min(caution.wait.brake_mps2, MOST_BRAKE_MPS2))
            if caution.wait.speed_mps < speed + _SUMO_ACCEL_MPS2 * STEP_S:
                scale = scale_of(int(traffic.lane[row]))
                speed_mps = scale * max(caution.wait.speed_mps, speed - brake * STEP_S, 0.0)
                _, other_mps = speeds.get(vehicle.name, (0, np.inf))
                speeds[vehicle.name] = caution.actor_id, min(speed_mps, other_mps)
        return speeds

    def _for_people(self, traffic: TrafficState, outlook: Outlook, people: Floats) -> list[Caution]:
        """The waits for people on crossings."""
        drivers = traffic.owner, traffic.sumo_speed_mps
        rows, others, waits = _waits_for_people(*drivers, outlook.ways, people, self._crossings)
        ids = traffic.actor_id[rows].tolist()
        found = zip(ids, people[ID, others].astype(int).tolist(), waits.tolist(), strict=True)
        return [Caution(actor_id, other_id, Wait(*wait)) for actor_id, other_id, wait in found]


@compiled
def _waits_for_people(
    owner: Codes, speed_mps: Floats, ways: Ways, people: Floats, outlines: Outlines
) -> tuple[Rows, Rows, Floats]:
    """Rows of SUMO's drivers who wait for people, columns of these, and the waits, ``(P, 3)``."""
    rows, others, waits = np.empty(len(owner), np.intp), np.empty(len(owner), np.intp), np.empty((len(owner), 3))
    count = 0
    for row in range(len(owner)):
        if owner[row] != _BY_SUMO:
            continue
        body = ways.bodies[row]
        way = Line(ways.points, ways.first[row], ways.last[row], body[SPACING])
        lengths = body[HALF_LENGTH], body[HALF_WIDTH]
        own = Passer(body[PLACE], body[LEFT], *lengths, speed_mps[row], np.inf)
        worst, speed, brake, free = least_wait_for_people(way, own, people, outlines)
        if worst >= 0:
            rows[count], others[count] = row, worst
            waits[count, _SPEED], waits[count, _BRAKE], waits[count, _FREE] = speed, brake, free
            count += 1
    return rows[:count], others[:count], waits[:count]
