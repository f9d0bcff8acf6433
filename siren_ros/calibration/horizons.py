"""How much of the trajectories is fitted: their first seconds, then more and more, then all."""

from collections.abc import Sequence
from typing import Final

from siren_ros.calibration.simulate import Target

WHOLE: Final = float("inf")
"""The horizon of the whole trajectories."""
FIRST_S: Final = 6.0
GROWTH: Final = 1.5
"""Each horizon is longer than the one before by this factor …"""
LAST: Final = 1.2
"""… and one that leaves out less than this factor is left out itself."""


def horizons_of(targets: Sequence[Target]) -> tuple[float, ...]:
    """Lengths of the trajectories' beginnings that are fitted one after the other, the last one ``WHOLE``.

    The traffic answers the EMV, and the EMV the traffic: a small difference grows over time, and a decision that falls
    the other way ends in another place. So the error over a long time has many valleys, and over a short time few.

    Args:
        targets: What is fitted; the longest trajectory counts.
    """
    length_s = max(target.trajectory.length_s for target in targets)
    found, horizon_s = [], FIRST_S
    while horizon_s * LAST < length_s:
        found.append(horizon_s)
        horizon_s *= GROWTH
    return (*found, WHOLE)
