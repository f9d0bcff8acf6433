"""NGSIM's social grid and manoeuvre classes (Deo and Trivedi 2018, ``preprocess_data.m`` of the published loaders)."""

from typing import Final

import numpy as np

from siren_ros.datasets.ngsim.road_frame import Numbers
from siren_ros.numerics.arrays import Floats

CELLS: Final = 39
_ALONG: Final = 13
_CELL_FT: Final = 15.0
_REACH_FT: Final = 90.0
_COLUMN_OF_LANE: Final = {-1: 0, 0: 13, 1: 26}
"""Where the cells of the lane to the left, the own lane and the lane to the right begin."""
LATERAL_WINDOW_FRAMES: Final = 40
"""A lane change within 4 s before or after the present makes a manoeuvre."""
HISTORY_FRAMES: Final = 30
FUTURE_FRAMES: Final = 50
_BRAKE: Final = 0.8
_ACCELERATE: Final = 1.25
KEEP, LEFT, RIGHT = 1, 2, 3
NORMAL, BRAKE, ACCELERATE = 1, 2, 3


def grid_cell(lane_offset: int, ahead_ft: float) -> int | None:
    """Cell of a neighbour, 0 to 38; None outside the grid.

    Args:
        lane_offset: −1 in the lane to the left, 0 in the own lane, +1 in the lane to the right.
        ahead_ft: How far ahead of the target it is.
    """
    if lane_offset not in _COLUMN_OF_LANE or abs(ahead_ft) >= _REACH_FT or (lane_offset == 0 and ahead_ft == 0.0):
        return None
    place = (ahead_ft + _REACH_FT) / _CELL_FT
    # Halves away from zero, as the published loader rounds.
    return _COLUMN_OF_LANE[lane_offset] + min(int(np.floor(place + 0.5)), _ALONG - 1)


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
