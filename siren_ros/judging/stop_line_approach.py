"""How an EMV approaches a stop line: its least speed while nobody ahead keeps it from the line."""

from typing import Final

import numpy as np

from siren_ros.judging.junction_traversal import Traversal
from siren_ros.recording.episode_record import EpisodeRecord

APPROACH_M: Final = 15.0
"""Way before the stop line on which a driver who obeys the sign stops: two to three car lengths."""


def least_free_speed_mps(record: EpisodeRecord, traversal: Traversal) -> float:
    """The least speed over the last 15 m before a stop line and at the line, with nobody ahead in the lane up to it.

    A vehicle that stands behind another one at the line does not count as stopping for the sign; from the moment
    at which the way to the line is free it does.

    Args:
        record: The episode.
        traversal: Across the junction behind the stop line.
    """
    track = record.track(traversal.actor_id)
    enter = int(np.searchsorted(track.step, traversal.enter_step))
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(track.x_m), np.diff(track.y_m)))))
    first = int(np.searchsorted(driven, driven[min(enter, len(driven) - 1)] - APPROACH_M))
    free = [row for row in range(first, enter) if not _is_blocked(record, traversal, int(track.step[row]))]
    return min([traversal.enter_speed_mps, *(float(track.speed_mps[row]) for row in free)])


def _is_blocked(record: EpisodeRecord, traversal: Traversal, step: int) -> bool:
    """Whether somebody is ahead of the vehicle in its approach lane at a step."""
    states = record.states[step - record.states[0].step]
    lane = record.network.lanes[record.network.connections[traversal.connection].from_lane]
    s_m, left_m = lane.centre.project(np.column_stack((states.x_m, states.y_m)))
    own = int(np.searchsorted(states.actor_id, traversal.actor_id))
    half_m = np.array([0.5 * record.actors[int(actor)].length_m for actor in states.actor_id])
    ahead = (s_m > s_m[own]) & (s_m - half_m < lane.length_m) & (np.abs(left_m) < 0.5 * lane.width_m)
    ahead[own] = False
    return bool(ahead.any())
