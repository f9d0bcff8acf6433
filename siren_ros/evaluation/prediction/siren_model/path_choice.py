"""Which paths each sample gets, and their points ahead of it."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.siren_model.lane_candidates import lane_candidates
from siren_ros.evaluation.prediction.siren_model.road_paths import RoadPath, RoadPaths
from siren_ros.numerics.arrays import Flags, Floats, Points, Rows
from siren_ros.roads.road_network import RoadNetwork

PATHS: Final = 4
"""Paths of a sample; fewer where the road offers fewer."""
PATH_POINTS: Final = 32
_LANES: Final = 3
"""Lanes that a vehicle may be in."""
_REACHES_M: Final = np.array([0.0, 15.0, 30.0, 50.0, 75.0, 120.0])
"""Paths are searched in these steps beyond the end of a lane, so that vehicles share them."""
_TURN_COST_PER_RAD: Final = 0.7
_HORIZON_S: Final = 6.0
_STANDING_REACH_M: Final = 30.0
_REACH_MAX_M: Final = 120.0


@dataclass(frozen=True)
class PathChoice:
    """Up to ``PATHS`` paths of each of N samples, the likeliest first.

    A path begins at the sample's place and keeps its offset from the centre line of the lane, so that a vehicle that
    follows it does not jump.
    """

    known: tuple[RoadPath, ...]
    """All paths that occur."""
    index: Rows
    """Which of them, −1 where a sample has no more; shape ``(N, PATHS)``."""
    arc_m: Floats
    """Arc length of the sample's centre on the path, shape ``(N, PATHS)``."""
    offset_m: Floats
    """Of the centre from the centre line, left positive; shape ``(N, PATHS)``."""
    turned_rad: Floats
    """Heading of the vehicle minus that of the lane, shape ``(N, PATHS)``."""
    spacing_m: Floats
    """Between consecutive points, shape ``(N,)``: a fast vehicle is shown more of the road."""

    @property
    def there(self) -> Flags:
        """Where there is a path, shape ``(N, PATHS)``."""
        return self.index >= 0

    def points(self) -> Points:
        """Points along the paths in the frame ``map``, 0 where there is no path; ``(N, PATHS, PATH_POINTS, 2)``."""
        found = np.zeros((*self.index.shape, PATH_POINTS, 2))
        steps = np.arange(PATH_POINTS)
        for path, row, column in self.groups():
            arc = self.arc_m[row, column, None] + self.spacing_m[row, None] * steps
            found[row, column] = path.curve.offset_points(arc, self.offset_m[row, column, None])
        return found

    def groups(self) -> list[tuple[RoadPath, Rows, Rows]]:
        """Each path that occurs, with the samples and columns that it stands in."""
        row, column = np.nonzero(self.there)
        index = self.index[row, column]
        order = np.argsort(index, kind="stable")
        row, column = row[order], column[order]
        counts = np.bincount(index, minlength=len(self.known))
        ends = np.cumsum(counts)
        return [
            (path, row[start:end], column[start:end])
            for path, start, end in zip(self.known, (ends - counts).tolist(), ends.tolist(), strict=True)
        ]


def choose_paths(network: RoadNetwork, xy_m: Floats, yaw_rad: Floats, speed_mps: Floats) -> PathChoice:
    """The likeliest paths of some vehicles: little offset, little angle, few turns.

    Args:
        network: The map.
        xy_m: Footprint centres, shape ``(N, 2)``.
        yaw_rad: Headings, shape ``(N,)``.
        speed_mps: Shape ``(N,)``.
    """
    count = len(xy_m)
    reach = np.minimum(_HORIZON_S * speed_mps + _STANDING_REACH_M, _REACH_MAX_M)
    found = lane_candidates(network, xy_m, yaw_rad)
    kept = np.flatnonzero(_rank_within(found.row) < _LANES)
    row, lane, arc = found.row[kept], found.lane[kept], found.arc_m[kept]
    lengths = np.array([each.length_m for each in network.lanes])
    beyond = arc + reach[row] - lengths[lane]
    step = np.searchsorted(_REACHES_M, np.minimum(beyond, _REACHES_M[-1]))
    roads, pairs = RoadPaths(network), []
    known: list[RoadPath] = []
    for code in np.unique(lane.astype(np.int64) * len(_REACHES_M) + step).tolist():
        first, steps = divmod(code, len(_REACHES_M))
        members = np.flatnonzero((lane == first) & (step == steps))
        for path in roads.ahead(first, float(_REACHES_M[steps])):
            pairs.append((members, np.full(len(members), len(known)), np.full(len(members), path.turn_rad)))
            known.append(path)
    shape = (count, PATHS)
    choice = PathChoice(
        known=tuple(known),
        index=np.full(shape, -1, dtype=np.intp),
        arc_m=np.zeros(shape),
        offset_m=np.zeros(shape),
        turned_rad=np.zeros(shape),
        spacing_m=reach / (PATH_POINTS - 1),
    )
    if pairs:
        member, path_index, turn = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        # Rounded, so that the order of paths of equal cost does not depend on where the scene is.
        cost = np.round(found.cost[kept][member] + _TURN_COST_PER_RAD * turn, 3)
        order = np.lexsort((path_index, cost, row[member]))
        member, path_index = member[order], path_index[order]
        place = _rank_within(row[member])
        few = place < PATHS
        member, path_index, at = member[few], path_index[few], (row[member[few]], place[few])
        choice.index[at], choice.arc_m[at] = path_index, arc[member]
        choice.offset_m[at], choice.turned_rad[at] = found.offset_m[kept][member], found.turned_rad[kept][member]
    return choice


def _rank_within(group: Rows) -> Rows:
    """Position of each element within its group; equal numbers stand next to each other."""
    first = np.flatnonzero(np.concatenate(([True], group[1:] != group[:-1]))) if len(group) else np.empty(0, np.intp)
    return np.arange(len(group)) - np.repeat(first, np.diff(np.concatenate((first, [len(group)]))))
