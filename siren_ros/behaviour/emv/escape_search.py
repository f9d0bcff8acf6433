"""Search of a drivable path through free space: a lattice of offsets and directions beside a reference line."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.behaviour.config import GapEscapeConfig
from siren_ros.behaviour.driving.free_space import Obstacles, clearances_m
from siren_ros.behaviour.emv.escape_lattice import Lattice, RoadSpace, Start, lattice_of
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.numerics.arrays import Floats

_LEVEL: Final = 0.11
"""A path that ends before the horizon may end with this slope at most, so that it can be continued."""
_FINE_M: Final = 0.5
_ATTEMPTS: Final = 5
"""Paths with one margin that are looked at as a whole before the next margin is tried."""

Ints = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class FoundPath:
    """A path beside the reference line: offsets ``left_m`` of the rear axle at arc lengths ``s_m``."""

    s_m: Floats
    left_m: Floats
    clearance_m: float
    """Margin that was kept."""
    complete: bool
    """Whether it reaches the horizon."""

    @property
    def length_m(self) -> float:
        """Length along the reference line."""
        return float(self.s_m[-1] - self.s_m[0])

    def centre_line(self, curve: Curve, centre_ahead_m: float) -> Floats:
        """The way of the footprint's centre, shape ``(K, 2)``, which runs wide of the rear axle's in bends."""
        rear = curve.offset_at(self.s_m, self.left_m)
        along = np.gradient(rear, axis=0)
        return rear + centre_ahead_m * along / np.linalg.norm(along, axis=1, keepdims=True)


def search_lattice(
    curve: Curve, road: RoadSpace, start: Start, obstacles: Obstacles, config: GapEscapeConfig
) -> FoundPath | None:
    """The cheapest path that the footprint clears, by dynamic programming from station to station.

    Paths change their slope against the reference line by what the vehicle can steer; between two stations the
    offset is a parabola. Wider margins are preferred to tight ones, long paths to short ones, the own road to the
    shoulder and this to the opposite lane.

    Args:
        curve: Reference line.
        road: Stations at multiples of ``config.station_m`` from the rear axle's place on.
        start: The vehicle.
        obstacles: Vehicles, swept along their motion.
        config: Lattice, margins and prices.

    Returns:
        The path, or None where none is long enough to be worth driving.
    """
    lattice = lattice_of(curve, road, start, obstacles, config)
    best: tuple[float, FoundPath] | None = None
    for level, (clearance, _) in enumerate(config.squeezes):
        found = _cheapest_clear(lattice, (curve, road), start, obstacles, clearance, config)
        if found is None:
            continue
        price, path = found
        price += level * config.squeeze_cost_m
        if best is None or price < best[0]:
            best = price, path
        if path.complete:
            break
    return best[1] if best is not None else None


def _cheapest_clear(
    lattice: Lattice,
    where: tuple[Curve, RoadSpace],
    start: Start,
    obstacles: Obstacles,
    clearance_m: float,
    config: GapEscapeConfig,
) -> tuple[float, FoundPath] | None:
    """The cheapest path with a margin that is also clear between the nodes, where the search has not looked."""
    curve, road = where
    between = lattice.between_m.copy()
    searched = replace(lattice, between_m=between)
    for _ in range(_ATTEMPTS):
        found = _cheapest(searched, road, clearance_m, config)
        if found is None:
            return None
        price, way, path = found
        joined = _joined(path, start, float(lattice.slope[way[0, 1]]))
        blocked = _blocked_cell(joined, road, (curve, start), obstacles, lattice.present_m, config.touch_m)
        if blocked is None:
            return price, joined
        (row, slope), (_, after) = way[blocked : blocked + 2]
        half = min(max(row + slope - len(lattice.slope) // 2, 0), len(lattice.left_m) - 1)
        between[blocked, half, slope + (after - slope) // 2] = -np.inf
    return None


def _blocked_cell(
    path: FoundPath,
    road: RoadSpace,
    vehicle: tuple[Curve, Start],
    obstacles: Obstacles,
    present_m: Floats,
    touch_m: float,
) -> int | None:
    """The station after which a path first comes nearer to an obstacle than a margin, None where it does not."""
    curve, start = vehicle
    centre = path.centre_line(curve, start.centre_ahead_m)
    ahead = centre - curve.offset_at(path.s_m, path.left_m)
    yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
    gap = clearances_m(centre[:, 0], centre[:, 1], yaw, start.body, obstacles, present_m)
    near = np.flatnonzero(gap < touch_m)
    if not len(near):
        return None
    return max(int(np.searchsorted(road.s_m, path.s_m[near[0]], side="left")) - 1, 0)


def _cheapest(
    lattice: Lattice, road: RoadSpace, clearance_m: float, config: GapEscapeConfig
) -> tuple[float, Ints, FoundPath] | None:
    """The cheapest path with a margin: its price less what its length is worth, its nodes, and itself."""
    stations, offsets, slopes = lattice.clearance_m.shape
    cost = np.full((offsets, slopes), np.inf)
    offset, directions = lattice.start
    cost[offset, list(directions)] = 0.0
    costs = np.full(lattice.clearance_m.shape, np.inf)
    turned = np.zeros(lattice.clearance_m.shape, dtype=np.int8)
    steepness = config.slope_cost * np.abs(lattice.slope)
    for k in range(1, stations):
        best = np.full((offsets, slopes), np.inf)
        for turn in lattice.turns[k - 1]:
            moved = _moved(cost, turn, lattice.between_m[k - 1] < clearance_m) + config.turn_cost * turn * turn
            better = moved < best
            best[better] = moved[better]
            turned[k][better] = turn
        best += lattice.price[k][:, None] + steepness
        best[lattice.clearance_m[k] < clearance_m] = np.inf
        costs[k] = cost = best
        if not np.isfinite(cost).any():
            break
    length = road.s_m - road.s_m[0]
    worth = costs - config.way_worth * length[:, None, None]
    worth[length < config.progress_min_m] = np.inf
    worth[:-1, :, np.abs(lattice.slope) > _LEVEL] = np.inf
    flat = int(np.argmin(worth))
    if not np.isfinite(worth.flat[flat]):
        return None
    last, i, j = (int(item) for item in np.unravel_index(flat, worth.shape))
    way = _walked_back(lattice, turned, (last, i, j))
    left, slope = lattice.left_m[way[:, 0]], lattice.slope[way[:, 1]]
    path = _smooth_offsets(road.s_m[: last + 1], left, slope, clearance_m, complete=last + 1 == stations)
    return float(worth.flat[flat]), way, path


def _moved(cost: Floats, turn: int, blocked: npt.NDArray[np.bool_]) -> Floats:
    """Costs after one station with a change of slope: nodes move by the mean of both slopes, in grains of offset.

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


def _walked_back(lattice: Lattice, turned: npt.NDArray[np.int8], end: tuple[int, int, int]) -> Ints:
    """Offset and slope of each node on the way to one, shape ``(K, 2)``."""
    last, i, j = end
    middle = len(lattice.slope) // 2
    nodes = [(i, j)]
    for k in range(last, 0, -1):
        before = j - int(turned[k, i, j])
        i, j = i - (before - middle) - (j - middle), before
        nodes.append((i, j))
    return np.array(nodes[::-1])


def _smooth_offsets(s: Floats, left: Floats, slope: Floats, clearance_m: float, *, complete: bool) -> FoundPath:
    """The parabolas between the nodes, sampled finely."""
    fine = np.linspace(s[0], s[-1], max(3, round((s[-1] - s[0]) / _FINE_M) + 1))
    cell = np.clip(np.searchsorted(s, fine, side="right") - 1, 0, len(s) - 2)
    into, width = fine - s[cell], s[cell + 1] - s[cell]
    offsets = left[cell] + slope[cell] * into + 0.5 * (slope[cell + 1] - slope[cell]) * into**2 / width
    return FoundPath(fine, offsets, clearance_m, complete)


def _joined(path: FoundPath, start: Start, slope: float) -> FoundPath:
    """The path with the vehicle's own direction at its start, in place of the lattice's."""
    miss = start.slope - slope
    way = path.s_m - path.s_m[0]
    return FoundPath(path.s_m, path.left_m + miss * way * np.exp(-way), path.clearance_m, path.complete)
