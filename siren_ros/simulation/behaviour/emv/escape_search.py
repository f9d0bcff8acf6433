"""Searches a drivable path through free space on a lattice of offsets and directions along a reference line."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats
from siren_ros.simulation.behaviour.driving.navigator import Obstacles, clearances_m, separations_m
from siren_ros.simulation.behaviour.driving.speed_mechanisms import ESCAPE_HORIZON_M, ESCAPE_TOUCH_M
from siren_ros.simulation.behaviour.driving.step_view import Body
from siren_ros.simulation.behaviour.driving.tracked_path import Curve
from siren_ros.simulation.scenario.driver_parameters import GapEscapeConfig

# This is no parameter: a tolerance of the measurement.
_NEAR_M: Final = 0.3
"""Vehicles nearer than this at the start count only at poses that are even nearer."""


@dataclass(frozen=True, eq=False)
class RoadSpace:
    """The road along a reference line at stations ``s_m``; offsets are positive to the left, each of shape ``(S,)``."""

    s_m: Floats
    right_m: Floats
    driving_right_m: Floats
    left_m: Floats
    opposite_left_m: Floats
    """Left edge of the opposite lane, which may be used at a cost."""
    middle_m: Floats
    """Preferred line if all else is equal."""


@dataclass(frozen=True)
class Start:
    """Pose of the vehicle relative to the reference line, and its steering limits."""

    left_m: float
    """Offset of the rear axle, which moves in the vehicle's direction."""
    slope: float
    body: Body
    centre_ahead_m: float
    """Distance from the rear axle to the footprint's centre."""
    wheelbase_m: float
    sharpest_1pm: float


@dataclass(frozen=True, eq=False)
class Lattice:
    """Lattice whose nodes are offsets ``left_m`` (D) and slopes (H), one layer per station (S)."""

    curve: Curve
    """Reference line."""
    road: RoadSpace
    """Stations at multiples of ``STATION_M`` from the rear axle's position."""
    vehicle: Start
    obstacles: Obstacles
    """Vehicles, extended along their motion."""
    left_m: Floats
    slope: Floats
    start: tuple[int, tuple[int, ...]]
    """Start node: offset, and the slopes on both sides of the vehicle's slope."""
    present_m: Floats
    """Distance from each obstacle at the start, infinite for distant ones, shape ``(M,)``."""
    clearance_m: Floats
    """Distance from obstacles at each node, shape ``(S, D, H)``; −inf outside the road."""
    between_m: Floats
    """The same distance half way from each station to the next."""
    price: Floats
    """Cost per station and offset, shape ``(S, D)``."""
    turns: tuple[range, ...]
    """Changes of slope, in steps, that the vehicle can steer from each station to the next."""


STATION_M: Final = 1.5
"""Distance between stations of the search."""
SLOPE_STEP: Final = 0.1
"""Step of the path's slope relative to the road."""
_STEEPEST: Final = 0.8
"""Largest slope of a path against the reference line."""


def lattice_of(curve: Curve, road: RoadSpace, start: Start, obstacles: Obstacles, config: GapEscapeConfig) -> Lattice:
    """Make the lattice at the stations of a road, with the clearance of each node."""
    grain = 0.5 * STATION_M * SLOPE_STEP
    reach = start.body.half_width_m
    low = min(float(road.right_m.min()) + reach, start.left_m)
    high = max(float(road.opposite_left_m.max()) - reach, start.left_m)
    below, above = math.ceil((start.left_m - low) / grain), math.ceil((high - start.left_m) / grain)
    left = start.left_m + grain * np.arange(-below, above + 1)
    slopes = round(_STEEPEST / SLOPE_STEP)
    slope = SLOPE_STEP * np.arange(-slopes, slopes + 1)
    steps = min(max(start.slope / SLOPE_STEP, -slopes), slopes) + slopes
    heading = curve.heading_at(road.s_m)
    bend = np.gradient(heading, road.s_m)
    turns = tuple(
        range(
            min(math.ceil((-start.sharpest_1pm - k) * STATION_M / SLOPE_STEP), 0),
            max(math.floor((start.sharpest_1pm - k) * STATION_M / SLOPE_STEP), 0) + 1,
        )
        for k in bend.tolist()
    )
    present = _present_m(curve, road, start, obstacles)
    half_stations = np.arange(2 * len(road.s_m) - 1) / 2.0
    halved = RoadSpace(*(np.interp(half_stations, np.arange(len(line)), line) for line in vars(road).values()))
    clearance = _clearances(curve, halved, (left, slope), start, obstacles, present, config.edge_overhang_m)
    node = below, tuple(sorted({math.floor(steps), math.ceil(steps)}))
    prices = _prices(road, left, start.body, config)
    given = curve, road, start, obstacles
    return Lattice(*given, left, slope, node, present, clearance[::2], clearance[1::2], prices, turns)


def _present_m(curve: Curve, road: RoadSpace, start: Start, obstacles: Obstacles) -> Floats:
    ahead, yaw = start.centre_ahead_m, float(curve.heading_at(road.s_m[:1])[0]) + math.atan(start.slope)
    x, y = curve.offset_at(road.s_m[:1], np.array([start.left_m]))[0]
    centre = np.array([x + ahead * math.cos(yaw)]), np.array([y + ahead * math.sin(yaw)])
    present = separations_m(*centre, np.array([yaw]), start.body, obstacles)[0]
    return np.where(present < _NEAR_M, present, np.inf)


def _clearances(
    curve: Curve, road: RoadSpace, nodes: tuple[Floats, Floats], start: Start, obstacles: Obstacles, present: Floats,
    edge_overhang_m: float,
) -> Floats:  # fmt: skip
    """Distance from the nearest obstacle at every node, offsets times slopes."""
    left, slope = nodes
    body, turned, ahead = start.body, np.arctan(slope), start.centre_ahead_m
    heading, place = curve.heading_at(road.s_m), curve.at(road.s_m)
    near = math.hypot(body.half_length_m, body.half_width_m) + ahead + 1.0
    reach_right, reach_left = _wheels_m(start, turned)
    start_right, start_left = _wheels_m(start, np.arctan(np.array([start.slope])))
    over_right = max(float(road.right_m[0] - start.left_m + start_right[0]), edge_overhang_m)
    over_left = max(float(start.left_m + start_left[0] - road.opposite_left_m[0]), edge_overhang_m)
    clearance = np.empty((len(road.s_m), len(left), len(slope)))
    extent = np.hypot(obstacles.half_length_m, obstacles.half_width_m)
    for k, angle in enumerate(heading.tolist()):
        cos, sin = math.cos(angle), math.sin(angle)
        along = cos * (obstacles.x_m - place[k, 0]) + sin * (obstacles.y_m - place[k, 1])
        picked = np.abs(along) < near + extent
        yaw = angle + turned
        x = (place[k, 0] - sin * left)[:, None] + ahead * np.cos(yaw)
        y = (place[k, 1] + cos * left)[:, None] + ahead * np.sin(yaw)
        clearance[k] = clearances_m(x, y, yaw, body, obstacles.select(picked), present[picked])
        off = left[:, None] - reach_right < road.right_m[k] - over_right
        off |= left[:, None] + reach_left > road.opposite_left_m[k] + over_left
        clearance[k][off] = -np.inf
    return clearance


def _wheels_m(start: Start, turned_rad: Floats) -> tuple[Floats, Floats]:
    """Distances of the wheels to the right and left of the rear axle's middle, at angles to the road."""
    half = start.body.half_width_m * np.cos(turned_rad)
    front = start.wheelbase_m * np.sin(turned_rad)
    return half + np.maximum(-front, 0.0), half + np.maximum(front, 0.0)


OFFSET_COST: Final = 0.02
"""Cost per metre of distance from the preferred line, per station."""


def _prices(road: RoadSpace, left: Floats, body: Body, config: GapEscapeConfig) -> Floats:
    """Cost of a station at every offset, in metres of distance."""
    half = body.half_width_m
    on_shoulder = left - half < road.driving_right_m[:, None] - 1e-6
    beyond = np.clip(left + half - road.left_m[:, None], 0.0, 1.0)
    opposite = np.where(beyond > 0.0, np.maximum(beyond, 0.2), 0.0)
    share = STATION_M / ESCAPE_HORIZON_M
    aside = OFFSET_COST * np.minimum(np.abs(left - road.middle_m[:, None]), 4.0)
    return np.asarray(share * (config.shoulder_cost_m * on_shoulder + config.opposite_cost_m * opposite) + aside)


# This is no parameter: distance between samples of a path.
_FINE_M: Final = 0.5

Ints = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class EscapePath:
    """A path relative to the reference line: offsets ``left_m`` of the rear axle at arc lengths ``s_m``."""

    s_m: Floats
    left_m: Floats
    clearance_m: float
    """Margin that the path keeps."""
    complete: bool
    """Whether the path reaches the horizon."""

    @property
    def length_m(self) -> float:
        """Length along the reference line."""
        return float(self.s_m[-1] - self.s_m[0])

    def centre_line(self, curve: Curve, centre_ahead_m: float) -> Floats:
        """Path of the footprint's centre, shape ``(K, 2)``; in bends it is outside the rear axle's path."""
        rear = curve.offset_at(self.s_m, self.left_m)
        along = np.gradient(rear, axis=0)
        return rear + centre_ahead_m * along / np.linalg.norm(along, axis=1, keepdims=True)


_SQUEEZE_COST_M: Final = 6.0
"""Additional distance that a smaller margin must gain."""


def search_lattice(
    curve: Curve, road: RoadSpace, start: Start, obstacles: Obstacles, config: GapEscapeConfig
) -> EscapePath | None:
    """Find the cheapest path that the footprint clears, by dynamic programming from station to station.

    Paths change their slope against the reference line by what the vehicle can steer; between two stations the
    offset is a parabola. Wider margins are preferred to tight ones, long paths to short ones, the EMV's road to the
    shoulder and this to the opposite lane. Arguments as ``Lattice`` has them.

    Returns:
        The path, or None where no path is long enough to be worth driving.
    """
    lattice = lattice_of(curve, road, start, obstacles, config)
    best: tuple[float, EscapePath] | None = None
    for level, (clearance, _) in enumerate(config.squeezes):
        cheapest = _cheapest_clear(lattice, clearance)
        if cheapest is None:
            continue
        price, path = cheapest
        price += level * _SQUEEZE_COST_M
        if best is None or price < best[0]:
            best = price, path
        if path.complete:
            break
    return best[1] if best is not None else None


_ATTEMPTS: Final = 5
"""Number of paths with one margin that are checked as a whole before the next margin."""


def _cheapest_clear(lattice: Lattice, clearance_m: float) -> tuple[float, EscapePath] | None:
    """Find the cheapest path with a margin that is also clear between the nodes."""
    between = lattice.between_m.copy()
    for _ in range(_ATTEMPTS):
        cheapest = _cheapest(lattice, between, clearance_m)
        if cheapest is None:
            return None
        price, way, path = cheapest
        blocked = _blocked_cell(lattice, path)
        if blocked is None:
            return price, path
        (row, slope), (_, after) = way[blocked : blocked + 2]
        half = min(max(row + slope - len(lattice.slope) // 2, 0), len(lattice.left_m) - 1)
        between[blocked, half, slope + (after - slope) // 2] = -np.inf
    return None


def _blocked_cell(lattice: Lattice, path: EscapePath) -> int | None:
    """First station after which a path is too near to an obstacle; None if it is clear."""
    centre = path.centre_line(lattice.curve, lattice.vehicle.centre_ahead_m)
    ahead = centre - lattice.curve.offset_at(path.s_m, path.left_m)
    yaw, others = np.arctan2(ahead[:, 1], ahead[:, 0]), (lattice.obstacles, lattice.present_m)
    gap = clearances_m(centre[:, 0], centre[:, 1], yaw, lattice.vehicle.body, *others)
    near = np.flatnonzero(gap < ESCAPE_TOUCH_M)
    if not len(near):
        return None
    return max(int(np.searchsorted(lattice.road.s_m, path.s_m[near[0]], side="left")) - 1, 0)


_PROGRESS_MIN_M: Final = 8.0
"""Length of the shortest free path that is worth driving."""
WAY_WORTH: Final = 2.0
"""Value of a metre of distance, compared with the costs below."""
_SLOPE_COST: Final = 0.5
"""Cost of a slope relative to the road, per station."""
_TURN_COST: Final = 0.15
"""Cost of a change of slope, per step."""
_LEVEL: Final = 0.11
"""Largest slope at the end of a path that stops before the horizon, so that it can be continued."""


def _cheapest(lattice: Lattice, between_m: Floats, clearance_m: float) -> tuple[float, Ints, EscapePath] | None:
    """Cheapest path with a margin: its cost minus the value of its length, its nodes, and the path."""
    road = lattice.road
    stations, offsets, slopes = lattice.clearance_m.shape
    cost = np.full((offsets, slopes), np.inf)
    offset, directions = lattice.start
    cost[offset, list(directions)] = 0.0
    costs = np.full(lattice.clearance_m.shape, np.inf)
    turned = np.zeros(lattice.clearance_m.shape, dtype=np.int8)
    steepness = _SLOPE_COST * np.abs(lattice.slope)
    for k in range(1, stations):
        best = np.full((offsets, slopes), np.inf)
        for turn in lattice.turns[k - 1]:
            moved = moved_costs(cost, turn, between_m[k - 1] < clearance_m) + _TURN_COST * turn * turn
            better = moved < best
            best[better] = moved[better]
            turned[k][better] = turn
        best += lattice.price[k][:, None] + steepness
        best[lattice.clearance_m[k] < clearance_m] = np.inf
        costs[k] = cost = best
        if not np.isfinite(cost).any():
            break
    length = road.s_m - road.s_m[0]
    worth = costs - WAY_WORTH * length[:, None, None]
    worth[length < _PROGRESS_MIN_M] = np.inf
    worth[:-1, :, np.abs(lattice.slope) > _LEVEL] = np.inf
    flat = int(np.argmin(worth))
    if not np.isfinite(worth.flat[flat]):
        return None
    last, i, j = (int(item) for item in np.unravel_index(flat, worth.shape))
    nodes = [(i, j)]
    for k in range(last, 0, -1):
        before = j - int(turned[k, i, j])
        i, j = i - (before - slopes // 2) - (j - slopes // 2), before
        nodes.append((i, j))
    way = np.array(nodes[::-1])
    return float(worth.flat[flat]), way, _path_through(lattice, way, clearance_m)


def _path_through(lattice: Lattice, way: Ints, clearance_m: float) -> EscapePath:
    """The path through lattice nodes as parabolas, finely sampled, with the vehicle's direction at its start."""
    s, left, slope = lattice.road.s_m[: len(way)], lattice.left_m[way[:, 0]], lattice.slope[way[:, 1]]
    fine = np.linspace(s[0], s[-1], max(3, round((s[-1] - s[0]) / _FINE_M) + 1))
    cell = np.clip(np.searchsorted(s, fine, side="right") - 1, 0, len(s) - 2)
    into, width, along = fine - s[cell], s[cell + 1] - s[cell], fine - fine[0]
    offsets = left[cell] + slope[cell] * into + 0.5 * (slope[cell + 1] - slope[cell]) * into**2 / width
    offsets = offsets + (lattice.vehicle.slope - float(slope[0])) * along * np.exp(-along)
    return EscapePath(fine, offsets, clearance_m, complete=len(way) == len(lattice.road.s_m))


def moved_costs(cost: Floats, turn: int, blocked: npt.NDArray[np.bool_]) -> Floats:
    """Costs after one station with a change of slope: nodes move by the mean of both slopes, in steps of offset.

    Half way they have moved by their first slope, and a quarter of the change that is less than a grain; there they
    must not be ``blocked``, at neither of the two slopes between which theirs is.
    """
    offsets, slopes = cost.shape
    middle = slopes // 2
    target = np.arange(max(0, turn), min(slopes, slopes + turn))
    source = target - turn
    rise = (source - middle) + (target - middle)
    rows = np.arange(offsets)[:, None] - rise
    inside = (rows >= 0) & (rows < offsets)
    half = np.clip(rows + source - middle, 0, offsets - 1)
    free = ~(blocked[half, source + turn // 2] | blocked[half, source - (-turn // 2)])
    moved = np.full_like(cost, np.inf)
    moved[:, target] = np.where(inside & free, cost[np.clip(rows, 0, offsets - 1), source], np.inf)
    return moved
