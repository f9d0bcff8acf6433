"""How far two episodes are apart: their EMVs' ways, and the order of their events."""

from collections.abc import Callable, Sequence

import numpy as np

from siren_ros.evaluation.diversity.profile import InteractionProfile
from siren_ros.numerics.arrays import Floats


def way_distance_m(one: InteractionProfile, other: InteractionProfile) -> float:
    """Mean distance between the places of both EMVs at the same times, as far as both were recorded.

    The mean over pairs is the average self distance of Y. Yuan and K. Kitani (DLow, ECCV 2020), of whole episodes.
    """
    points = min(len(one.way_m), len(other.way_m))
    return float(np.hypot(*(one.way_m[:points] - other.way_m[:points]).T).mean())


def event_distance(one: InteractionProfile, other: InteractionProfile) -> float:
    """Edits that turn one order of events into the other, as a share of the longer one (Levenshtein); 0 to 1."""
    first, second = one.happenings, other.happenings
    if not first and not second:
        return 0.0
    return _edits(first, second) / max(len(first), len(second))


def _edits(first: Sequence[str], second: Sequence[str]) -> int:
    row = list(range(len(second) + 1))
    for count, left in enumerate(first, start=1):
        before, row[0] = row[0], count
        for place, right in enumerate(second, start=1):
            kept = before + (left != right)
            before = row[place]
            row[place] = min(kept, before + 1, row[place - 1] + 1)
    return row[-1]


def distance_matrix(
    profiles: Sequence[InteractionProfile], distance: Callable[[InteractionProfile, InteractionProfile], float]
) -> Floats:
    """Distances between all pairs, shape ``(N, N)``, zero on the diagonal."""
    matrix = np.zeros((len(profiles), len(profiles)))
    for row, one in enumerate(profiles):
        for column in range(row):
            matrix[row, column] = matrix[column, row] = distance(one, profiles[column])
    return matrix
