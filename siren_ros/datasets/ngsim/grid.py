"""NGSIM's social grid and manoeuvre classes (Deo and Trivedi 2018, ``preprocess_data.m`` of the published loaders)."""

from typing import Final

import numpy as np

from siren_ros.datasets.ngsim.conventions import FOOT_M
from siren_ros.datasets.ngsim.road_frame import Numbers
from siren_ros.numerics.arrays import Floats, Rows

COLUMNS: Final = 3
CELLS_ALONG: Final = 13
CELLS: Final = COLUMNS * CELLS_ALONG
_CELL_FT: Final = 15.0
_REACH_FT: Final = 90.0
OUTSIDE: Final = -1
"""No cell of the grid."""
LATERAL_WINDOW_FRAMES: Final = 40
"""A lane change within 4 s before or after the present makes a manoeuvre."""
HISTORY_FRAMES: Final = 30
FUTURE_FRAMES: Final = 50
_BRAKE: Final = 0.8
_ACCELERATE: Final = 1.25
KEEP, LEFT, RIGHT = 1, 2, 3
NORMAL, BRAKE, ACCELERATE = 1, 2, 3


def grid_cells(lane_offset: Floats, ahead_ft: Floats) -> Rows:
    """Cells of neighbours, 0 to 38, and ``OUTSIDE``; all arrays of shape ``(P,)``.

    Args:
        lane_offset: −1 in the lane to the left, 0 in the own lane, +1 in the lane to the right.
        ahead_ft: How far ahead of the target they are.
    """
    # Halves away from zero, as the published loader rounds.
    along = np.minimum(np.floor((ahead_ft + _REACH_FT) / _CELL_FT + 0.5), CELLS_ALONG - 1)
    outside = (np.abs(lane_offset) > 1.0) | (np.abs(ahead_ft) >= _REACH_FT) | ((lane_offset == 0.0) & (ahead_ft == 0.0))
    return np.where(outside, OUTSIDE, (lane_offset + 1.0) * CELLS_ALONG + along).astype(np.intp)


def neighbour_cells(right_m: Floats, ahead_m: Floats, turned_rad: Floats, width_m: Floats) -> Rows:
    """Cells of vehicles around a target, and ``OUTSIDE``; all arrays of shape ``(P,)``.

    Vehicles of another direction are no neighbours: NGSIM's roads have one.

    Args:
        right_m: How far to the right of the target they are, seen along the target's lane.
        ahead_m: How far ahead of it.
        turned_rad: Their heading against that of the target's lane.
        width_m: Width of the target's lane.
    """
    cells = grid_cells(np.round(right_m / width_m), ahead_m / FOOT_M)
    return np.where(np.cos(turned_rad) > 0.0, cells, OUTSIDE)


def lateral_class(lane_number: Numbers, present: int) -> int:
    """Whether a vehicle keeps its lane, changes to the left or to the right around the present.

    Args:
        lane_number: Lanes of its track, counted to the right.
        present: Index of the present.
    """
    first = lane_number[max(0, present - LATERAL_WINDOW_FRAMES)]
    last = lane_number[min(len(lane_number) - 1, present + LATERAL_WINDOW_FRAMES)]
    now = lane_number[present]
    if last > now or now > first:
        return RIGHT
    return LEFT if last < now or now < first else KEEP


def longitudinal_class(ahead_ft: Floats, present: int) -> int:
    """Whether a vehicle brakes, accelerates or neither: its mean speed in the next 5 s against the last 3 s.

    Args:
        ahead_ft: Distance travelled along its track.
        present: Index of the present.
    """
    first, last = max(0, present - HISTORY_FRAMES), min(len(ahead_ft) - 1, present + FUTURE_FRAMES)
    if present in {first, last}:
        return NORMAL
    past = (ahead_ft[present] - ahead_ft[first]) / (present - first)
    coming = (ahead_ft[last] - ahead_ft[present]) / (last - present)
    if past < 1e-6:
        return ACCELERATE if coming > 1e-3 else NORMAL
    ratio = coming / past
    return BRAKE if ratio < _BRAKE else ACCELERATE if ratio > _ACCELERATE else NORMAL
