"""A moment of ``seen_on_crossing``."""

from typing import Any

from seen_on_crossing import EMV, seen

from siren_ros.lab.learning.moment import Moment

WANTED_MPS = 15.0


def moment_of(*args: Any, **known: Any) -> Moment:
    """The second of the two steps of ``seen``."""
    before, sight = seen(*args, **known)
    return Moment(sight, before, EMV, WANTED_MPS, contact=False, red_lines=0)
