"""Checks whether a move to the side is free."""

from typing import Final

from siren_ros.running.seat.sight import Sight

COMES_S: Final = 2.5
"""Time for which approaching vehicles are predicted."""
_BESIDE_M: Final = 0.5
"""Lateral distance kept to other vehicles."""
_BEHIND_M: Final = 5.0
"""Distance kept to vehicles behind."""
_AHEAD_M: Final = 1.0
"""Distance kept to vehicles ahead at the same speed."""


def is_free(wanted_m: float, sight: Sight, comes_s: float = COMES_S) -> bool:
    """Whether no other vehicle is beside the own one on a move to the side, or will come there.

    Args:
        wanted_m: Where the move ends across the way, left positive.
        sight: The step.
        comes_s: How far ahead in time others are looked for.
    """
    least, greatest = sorted((sight.left_m, wanted_m))
    for other in sight.others:
        comes_m = comes_s * (other.speed_mps - sight.speed_mps)
        beside = -sight.length_m - _BEHIND_M - max(comes_m, 0.0) < other.gap_m < _AHEAD_M - min(comes_m, 0.0)
        away_m = abs(min(max(other.left_m, least), greatest) - other.left_m)
        nearer = away_m < abs(sight.left_m - other.left_m) - 0.02
        if beside and nearer and away_m < other.half_width_m + 0.5 * sight.width_m + _BESIDE_M:
            return False
    return True
