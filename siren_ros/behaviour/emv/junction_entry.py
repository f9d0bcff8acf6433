"""The siren asks for the right of way and does not give it: the EMV enters on red slowly enough to stop."""

import math

from siren_ros.behaviour.config import JunctionEntryConfig
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.conflicts.right_of_way import Rank, rank_of


def entry_limit_mps(view: StepView, row: int) -> float:
    """Speed towards the red lights ahead; infinite where there is none.

    Crossing traffic has green there and does not slow down. At a stop sign it starts from the line or is seen to come,
    and the collision handling is enough, as inside the junction.

    The EMV comes to the entry speed by gentle braking in good time. Where the light turns red late it slows down as
    far as gentle braking gets it.
    """
    outlook, config = view.seen.outlook, view.world.junction_entry
    if outlook is None:
        return math.inf
    front = outlook.front_m(row)
    limit = math.inf
    for entry in outlook.course(row).entries:
        ahead = entry.start_m - front
        if ahead > 0.0 and rank_of(entry.connection, outlook.signals) is Rank.RED:
            limit = min(limit, approach_mps(ahead, config))
    easing = float(view.seen.speed_mps[row]) - config.ease_off_mps2 / view.world.config.emv.navigator.speed_gain_1ps
    return max(limit, easing)


def approach_mps(ahead_m: float, config: JunctionEntryConfig) -> float:
    """Speed at a distance before the line from which the entry speed is reached at the line."""
    return math.sqrt(config.speed_mps**2 + 2.0 * config.brake_mps2 * ahead_m)
