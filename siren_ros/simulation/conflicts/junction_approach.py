"""How drivers come to lines without right of way and to crossings with people.

An EMV comes to a line at a speed that each driver draws, limited by the view: how far a driver sees into side streets
before the line. The view follows from the junction's geometry: façades stand at one distance behind all roads, as in
the generated scene. At a stop line itself a driver sees past them.

Where somebody will be near while a vehicle is on a crossing, it comes there at walking pace; where somebody will be in
its way, it stops before the crossing. People are expected to go on as they walk.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Points, Rows, random_stream
from siren_ros.base.numerics.compiled import X, Y, compiled
from siren_ros.simulation.conflicts.yielding import Rank, rank_of
from siren_ros.simulation.conflicts.zones import way_point
from siren_ros.simulation.roads.road_network import Connection, RoadNetwork
from siren_ros.simulation.roads.routing import comes_from_the_side, crossing_connections, movement_path
from siren_ros.simulation.scenario.driver_parameters import JunctionEntryConfig
from siren_ros.simulation.scenario.presets import Attention

SETBACK_M: Final = 3.0
"""Distance of the façades from the roads, as in the 3-D scene (``SceneConfig.building_setback_m``)."""
_EYE_M: Final = 2.0
"""Distance of a driver's eyes behind the front of the vehicle."""
# These are no parameters: the resolution of the search, and a value that keeps quotients finite.
_SIGHT_STEP_M: Final = 0.25
_LEAST_MPS: Final = 0.1


@dataclass(frozen=True)
class SideStreet:
    """The lanes that reach a junction from one side, as a driver before the line sees them."""

    near_m: float
    """Distance from the line to the nearest edge of their lanes."""
    far_m: float
    """Distance from the line to the far edge of their lanes."""
    aside_m: float
    """Distance from the middle of the driver's lane to the façades on this side."""
    limit_mps: float
    """Highest speed limit of these lanes."""

    def seen_m(self, before_m: float) -> float:
        """Length of the street that is visible at a distance before the line; infinite beyond the façades."""
        beyond_m = before_m + _EYE_M - SETBACK_M
        return self.aside_m * (1.0 + (self.near_m + SETBACK_M) / beyond_m) if beyond_m > 0.0 else math.inf


@dataclass(frozen=True)
class Lookout:
    """Assumptions of a driver about vehicles that are not visible yet."""

    horizon_s: float
    """Vehicles that need longer to the crossing do not count."""
    pet_s: float
    """Time that must remain between the two vehicles."""
    brake_mps2: float
    reaction_s: float
    standoff_m: float
    """Distance kept from the nearest lane's edge at a stop."""
    length_m: float
    """Length of the own vehicle."""


def safe_mps(street: SideStreet, before_m: float, lookout: Lookout) -> float:
    """Speed at which the driver can still stop for a vehicle that comes into view.

    It does not matter, and is infinite, where who is not in view yet comes so late that the driver is past before it
    at that speed.
    """
    unseen_s = street.seen_m(before_m) / max(street.limit_mps, _LEAST_MPS)
    if unseen_s >= lookout.horizon_s:
        return math.inf
    free_m = max(before_m + street.near_m - lookout.standoff_m, 0.0)
    brake, reaction_s = lookout.brake_mps2, lookout.reaction_s
    stops_mps = brake * (math.sqrt(reaction_s**2 + 2.0 * free_m / brake) - reaction_s)
    past_m = before_m + street.far_m + lookout.length_m
    return math.inf if stops_mps * (unseen_s - lookout.pet_s) >= past_m else stops_mps


def side_streets(network: RoadNetwork, connection: Connection) -> tuple[SideStreet, ...]:
    """Streets from the left and right whose movements cross a movement; empty if there are none."""
    sides: dict[bool, list[tuple[float, float, float]]] = {}
    for index in crossing_connections(network, connection):
        other = network.connections[index]
        if not comes_from_the_side(network, connection, other):
            continue
        lane, place_m = network.lanes[other.from_lane], _meeting_m(network, connection, other)
        half_m = 0.5 * lane.width_m
        from_left = _turn_rad(network, connection, other) < 0.0
        sides.setdefault(from_left, []).append((place_m - half_m, place_m + half_m, lane.speed_limit_mps))
    return tuple(
        SideStreet(
            near_m=max(min(near for near, _, _ in spans), 0.0),
            far_m=max(far for _, far, _ in spans),
            aside_m=_road_beside_m(network, connection.from_lane, from_left) + SETBACK_M,
            limit_mps=max(limit for *_, limit in spans),
        )
        for from_left, spans in sorted(sides.items())
    )


def _turn_rad(network: RoadNetwork, connection: Connection, other: Connection) -> float:
    lanes = (network.lanes[movement.from_lane].centre for movement in (connection, other))
    own, its = (float(lane.heading_rad(lane.length_m)) for lane in lanes)
    return math.remainder(its - own, 2.0 * math.pi)


def _meeting_m(network: RoadNetwork, connection: Connection, other: Connection) -> float:
    """Arc length on a movement's path where another path crosses it."""
    own, its = movement_path(network, connection), movement_path(network, other)
    arc_m = np.linspace(0.0, own.length_m, max(int(own.length_m / _SIGHT_STEP_M), 2))
    its_m, left_m = its.project(own.at(arc_m))
    away_m = np.where((its_m < 0.0) | (its_m > its.length_m), np.inf, np.abs(left_m))
    return float(arc_m[int(np.argmin(away_m))])


def _road_beside_m(network: RoadNetwork, lane: int, on_left: bool) -> float:
    """Distance from the middle of a lane to the outer edge of its road, with sidewalks and opposite lanes."""
    here = network.lanes[lane]
    edge = network.edges[here.edge]
    at = edge.lanes.index(lane)
    beside = edge.lanes[at + 1 :] if on_left else edge.lanes[:at]
    if on_left:
        ends = (edge.to_junction, edge.from_junction)
        back = (other for other in network.edges if (other.from_junction, other.to_junction) == ends)
        beside += next((other.lanes for other in back), ())
    return 0.5 * here.width_m + sum(network.lanes[index].width_m for index in beside)


def must_give_way(connection: Connection, signals: Mapping[str, str]) -> bool:
    """Whether a movement has a line at which others have the right of way: red light, stop sign, give-way sign.

    A green light that gives way to oncoming traffic is none: that traffic is in view.
    """
    rank = rank_of(connection, signals)
    return rank in {Rank.RED, Rank.STOP_SIGN} or (rank is Rank.GIVES_WAY and connection.gives_way)


_VIEW_M: Final = 40.0
"""Distance before the line from which the view counts."""
_VIEW_STEP_M: Final = 0.5
"""Distance between the places at which the view is computed."""


class LineBook:
    """Caches the speeds at a map's lines; each is computed once."""

    def __init__(self, network: RoadNetwork, config: JunctionEntryConfig, attention: Attention, seed: int) -> None:
        self._network, self._config, self._attention, self._seed = network, config, attention, seed
        self._drivers: dict[int, float] = {}
        self._views: dict[tuple[int, int, float], tuple[Floats, Floats]] = {}

    def driver_mps(self, emv_id: int) -> float:
        """Speed at a line of one EMV's driver; it depends only on preset, seed and actor."""
        if self._config.speed_mps is not None:
            return self._config.speed_mps
        if emv_id not in self._drivers:
            drawn = self._attention.emv_line_mps.draw(random_stream(self._seed, "emv at lines", emv_id))
            self._drivers[emv_id] = drawn
        return self._drivers[emv_id]

    def approach_mps(self, emv_id: int, length_m: float, connection: Connection, ahead_m: float) -> float:
        """Speed at a distance before a line: gentle braking leads to the driver's speed at the line.

        On the way the driver goes no faster than the view of the streets from the side allows. A calibrated driver
        does what was measured.
        """
        energy, brake = self.driver_mps(emv_id) ** 2 + 2.0 * self._config.brake_mps2 * ahead_m, self._config.brake_mps2
        if self._config.speed_mps is None:
            before_m, safe_mps2 = self._view(connection, length_m)
            later = before_m < ahead_m
            energy = min(energy, float((safe_mps2 + 2.0 * brake * (ahead_m - before_m))[later].min(initial=math.inf)))
        return math.sqrt(energy)

    def _view(self, connection: Connection, length_m: float) -> tuple[Floats, Floats]:
        """Places before the line, and the square of the speed that the view allows at each."""
        key = connection.from_lane, connection.to_lane, length_m
        if key not in self._views:
            config, attention = self._config, self._attention
            lookout = Lookout(
                attention.emv_horizon_s,
                attention.emv_pet_s,
                config.stop_mps2,
                config.reaction_s,
                config.standoff_m,
                length_m,
            )
            before_m = np.arange(0.0, _VIEW_M, _VIEW_STEP_M, dtype=np.float64)
            streets = side_streets(self._network, connection)
            least = [min((safe_mps(street, at, lookout) for street in streets), default=math.inf) for at in before_m]
            self._views[key] = before_m, np.square(np.maximum(least, config.least_mps))
        return self._views[key]


# These are no parameters: no driver may choose them.
PACE_MPS: Final = 1.6
"""Walking pace, which with the speed control's error stays below 2 m/s."""
_NEAR_M: Final = 2.4
"""People within this distance of the side of the vehicle's path are near: 2 m and both sides' deviations."""
_IN_WAY_M: Final = 0.6
"""People within this distance of the path's side are in the way."""
_STANDOFF_M: Final = 1.0
"""Distance that a stopping vehicle keeps from the crossing, or from a person on it."""
_EARLY_M: Final = 0.4
"""Drivers have slowed down this far before the crossing, because vehicles respond late."""
_GENTLE_MPS2: Final = 2.0
"""Deceleration that a driver plans with."""
_FIRM_MPS2: Final = 4.0
"""Hardest braking for a person who is only near."""
_FASTER_MPS: Final = 1.5
"""A driver may reach the crossing faster than walking pace by this."""
_SETS_OFF_MPS: Final = 5.0
"""Slower drivers who find a gap in time start to cross."""
_SETS_OFF_MPS2: Final = 1.5
"""Acceleration of a driver who starts to cross."""
_MORE_M: Final = 15.0
"""Additional distance that a driver looks ahead."""
_LONGEST_S: Final = 6.0
"""Time for which people are expected to continue walking."""
_BESIDE_M: Final = 2.0
"""People within this distance of a crossing may step on it."""
_WAY_STEP_M: Final = 0.5
_LEAST_M: Final = 0.3

VX, VY, CROSSING, ON, ID = range(2, 7)
"""Rows of people after ``X`` and ``Y``: velocity, crossing (−1 for none), whether somebody is on it, and id."""
NOBODY: Final = np.empty((7, 0))
"""Array without people."""


class Outlines(NamedTuple):
    """Outlines of crossings, joined in one array."""

    points: Points
    begins: Rows
    """Index at which each outline begins, and the end of the last."""


class Line(NamedTuple):
    """The course that a vehicle takes, among the points of all courses."""

    points: Points
    first: int
    last: int
    """Where its points begin and end."""
    spacing_m: float


class Passer(NamedTuple):
    """A vehicle that comes to a crossing on its course."""

    centre_m: float
    """Place of its centre on the course."""
    left_m: float
    """Offset from the course."""
    half_length_m: float
    half_width_m: float
    speed_mps: float
    beside_mps: float
    """Speed past people who stand beside a crossing; infinite: they do not count."""


def outlines_of(network: RoadNetwork) -> Outlines:
    """The crossings of a map."""
    counts = [len(outline) for outline in network.crossings]
    return Outlines(np.concatenate([np.empty((0, 2)), *network.crossings]), np.cumsum([0, *counts]).astype(np.intp))


def people_at(actor_id: npt.ArrayLike, poses: Iterable[Floats], outlines: Outlines) -> Floats:
    """Make the array of people for ``least_wait_for_people``, shape ``(7, P)``; ``poses`` are x, y, yaw and speed.

    Rows are ``X``, ``Y``, ``VX`` and so on until ``ID``; those who are not on their crossing stand beside it.
    """
    x_m, y_m, yaw_rad, speed_mps = poses
    people = np.empty((7, len(x_m)))
    people[:4] = x_m, y_m, speed_mps * np.cos(yaw_rad), speed_mps * np.sin(yaw_rad)
    people[ID] = actor_id
    _find_crossings(people, *outlines)
    return people


@compiled
def _find_crossings(people: Floats, points: Points, begins: Rows) -> None:
    """Find each person's crossing, and whether the person is on it."""
    for p in range(people.shape[1]):
        people[CROSSING, p], people[ON, p], least = -1.0, 0.0, _BESIDE_M
        for c in range(len(begins) - 1):
            first = points[begins[c]]
            if abs(first[X] - people[X, p]) + abs(first[Y] - people[Y, p]) > 100.0:
                continue
            apart = _apart_m(points[begins[c] : begins[c + 1]], people[X, p], people[Y, p])
            if apart < least:
                people[CROSSING, p], people[ON, p], least = c, 1.0 if apart <= 0.0 else 0.0, apart


@compiled
def _is_inside(outline: Points, x_m: float, y_m: float) -> bool:
    inside = False
    for k in range(len(outline)):
        ax, ay, bx, by = outline[k - 1, X], outline[k - 1, Y], outline[k, X], outline[k, Y]
        if (ay > y_m) != (by > y_m) and x_m < ax + (y_m - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return inside


@compiled
def _apart_m(outline: Points, x_m: float, y_m: float) -> float:
    """Distance of a point from an outline, 0 inside."""
    if _is_inside(outline, x_m, y_m):
        return 0.0
    least = np.inf
    for k in range(len(outline)):
        ax, ay = outline[k - 1, X], outline[k - 1, Y]
        dx, dy = outline[k, X] - ax, outline[k, Y] - ay
        part = ((x_m - ax) * dx + (y_m - ay) * dy) / max(dx * dx + dy * dy, 1e-12)
        part = min(max(part, 0.0), 1.0)
        least = min(least, np.hypot(ax + part * dx - x_m, ay + part * dy - y_m))
    return least


@compiled
def _beside_way(way: Line, own: Passer, reach_m: float, x_m: float, y_m: float) -> tuple[float, float, float, float]:
    """Place on a path nearest to a point, the offset there (positive to the left), and the direction."""
    points, first, last, spacing = way
    centre_m, left_m, half_length = own.centre_m, own.left_m, own.half_length_m
    best, nearest = centre_m, np.inf
    for k in range(int(reach_m + 2.0 * half_length) + 1):
        x, y = way_point(points, first, last, (centre_m - half_length + k) / spacing)
        square = (x - x_m) * (x - x_m) + (y - y_m) * (y - y_m)
        if square < nearest:
            best, nearest = centre_m - half_length + k, square
    xs, ys = way_point(points, first, last, (best - 0.5) / spacing)
    xe, ye = way_point(points, first, last, (best + 0.5) / spacing)
    cos, sin = xe - xs, ye - ys
    norm = np.sqrt(cos * cos + sin * sin) + 1e-9
    cos, sin = cos / norm, sin / norm
    x, y = way_point(points, first, last, best / spacing)
    return best + (x_m - x) * cos + (y_m - y) * sin, cos * (y_m - y) - sin * (x_m - x) - left_m, cos, sin


@compiled
def _over_crossing(way: Line, own: Passer, reach_m: float, outline: Points) -> tuple[float, float]:
    """Distance of a vehicle's front to a crossing (0 on it), and of its rear until it has left it.

    Infinite without one.
    """
    points, first, last, spacing = way
    centre_m, left_m, half_length, half_width, _, _ = own
    enters, leaves, at_m = np.inf, np.inf, centre_m - half_length
    while at_m <= centre_m + half_length + reach_m:
        xs, ys = way_point(points, first, last, (at_m - 0.5) / spacing)
        xe, ye = way_point(points, first, last, (at_m + 0.5) / spacing)
        x, y, inside = 0.5 * (xs + xe), 0.5 * (ys + ye), False
        for side in (-1.0, 0.0, 1.0):
            aside = left_m + side * half_width
            inside = inside or _is_inside(outline, x - aside * (ye - ys), y + aside * (xe - xs))
        if inside:
            enters = min(enters, max(at_m - _WAY_STEP_M - centre_m - half_length, 0.0))
            leaves = at_m + _WAY_STEP_M - centre_m + half_length
        elif leaves < np.inf:
            break
        at_m += _WAY_STEP_M
    return enters, leaves


@compiled
def least_wait_for_people(
    way: Line, own: Passer, people: Floats, outlines: Outlines
) -> tuple[int, float, float, float]:
    """The person that restricts a driver most, with speed, needed deceleration and free distance; −1 without one."""
    (centre_m, _, half_length, half_width, speed, beside_mps), (corners, begins) = own, outlines
    worst, least, hardest, free_m = -1, np.inf, 0.0, np.inf
    reach_m = speed * speed / (2.0 * _GENTLE_MPS2) + _MORE_M
    x, y = way_point(way.points, way.first, way.last, centre_m / way.spacing_m)
    for p in range(people.shape[1]):
        across = people[ON, p] > 0.0
        if people[CROSSING, p] < 0.0 or (not across and beside_mps == np.inf):
            continue
        if np.hypot(people[X, p] - x, people[Y, p] - y) > reach_m + half_length + _MORE_M:
            continue
        place_m, left, cos, sin = _beside_way(way, own, reach_m, people[X, p], people[Y, p])
        drift = cos * people[VY, p] - sin * people[VX, p]
        if abs(left) - half_width > _NEAR_M + abs(drift) * 2.0 * _LONGEST_S:
            continue
        c = int(people[CROSSING, p])
        enters, leaves = _over_crossing(way, own, reach_m, corners[begins[c] : begins[c + 1]])
        if enters == np.inf:
            continue
        begin = min(max(enters - _STANDOFF_M, 0.0) / (max(speed, PACE_MPS) + _FASTER_MPS), _LONGEST_S)
        apart = _least_m(left, drift, begin, _leaves_s(speed, leaves)) - half_width
        if apart > _NEAR_M:
            continue
        if speed > PACE_MPS:  # the vehicle slows down past a person nearby, and is there longer
            paced_s = 2.0 * enters / (speed + PACE_MPS) + (leaves - enters) / PACE_MPS
            apart = _least_m(left, drift, begin, paced_s) - half_width
        limit, brake, free = _past(enters, speed, beside_mps if not across else PACE_MPS)
        if across and apart < _IN_WAY_M and place_m > centre_m + half_length:
            free = enters if enters > 0.0 else place_m - centre_m - half_length
            free = max(free - _STANDOFF_M, 0.0)
            limit, brake = min(limit, np.sqrt(2.0 * _GENTLE_MPS2 * free)), speed * speed / (2.0 * max(free, _LEAST_M))
        if limit < least:
            worst, least, free_m = p, limit, free
        hardest = max(hardest, brake)
    return worst, least, hardest, free_m


@compiled
def _leaves_s(speed_mps: float, leaves_m: float) -> float:
    """Time at which a vehicle has left a crossing if it continues, or starts."""
    going_s = leaves_m / max(speed_mps, PACE_MPS)
    if speed_mps < _SETS_OFF_MPS:
        sets_off_mps = np.sqrt(speed_mps * speed_mps + 2.0 * _SETS_OFF_MPS2 * leaves_m)
        going_s = min(going_s, (sets_off_mps - speed_mps) / _SETS_OFF_MPS2)
    return going_s


@compiled
def _least_m(left_m: float, drift_mps: float, begin_s: float, end_s: float) -> float:
    """Smallest distance of a walking person from the middle of a path, between two times."""
    at_begin, at_end = left_m + drift_mps * begin_s, left_m + drift_mps * min(end_s, begin_s + _LONGEST_S)
    return 0.0 if at_begin * at_end <= 0.0 else min(abs(at_begin), abs(at_end))


@compiled
def _past(enters_m: float, speed_mps: float, at_mps: float) -> tuple[float, float, float]:
    """Speed and deceleration with which a vehicle reaches a crossing at a speed, and the distance to it."""
    limit = np.sqrt(at_mps * at_mps + 2.0 * _GENTLE_MPS2 * max(enters_m - _EARLY_M, 0.0))
    brake = max(speed_mps * speed_mps - at_mps * at_mps, 0.0) / (2.0 * max(enters_m, _LEAST_M))
    return limit, min(brake, _FIRM_MPS2), enters_m
