"""A state of ``seen_on_crossing``."""

from typing import Any

from seen_on_crossing import EMV, seen

from siren_ros.lab.learning.rollout import SeatState

WANTED_MPS = 15.0


def state_of(*args: Any, **known: Any) -> SeatState:
    """The second of the two steps of ``seen``."""
    before, sight = seen(*args, **known)
    return SeatState(sight, before, EMV, WANTED_MPS, contact=False, red_lines=0)
