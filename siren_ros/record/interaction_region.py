"""The moving interaction region around the EMV: the vehicles that the paper's CARLA controls."""

from collections.abc import Iterable

import numpy as np

from siren_ros.numerics.arrays import Flags, Ids
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.paper import PAPER_CONSTANTS
from siren_ros.world.actors import ActorStates


def region_members(before: Ids, states: ActorStates, emv_ids: Iterable[int]) -> Ids:
    """Who is in the region after a step (paper, table of thresholds: 40 m in, 50 m out, EMV-centred).

    A vehicle enters when its centre comes closer than 40 m to an EMV's, and leaves when it is farther than 50 m from
    all of them. The EMVs themselves are members while they are there; without one nobody is.

    Args:
        before: Members at the step before, sorted; empty at the first step.
        states: All actors at the step.
        emv_ids: The emergency vehicles.

    Returns:
        Sorted ids.
    """
    is_emv = np.isin(states.actor_id, np.fromiter(emv_ids, dtype=np.uint32))
    if not is_emv.any():
        return np.empty(0, dtype=np.uint32)
    xy = np.stack((states.x_m, states.y_m), axis=-1)
    distance = np.hypot(*(xy[:, None] - xy[is_emv]).transpose(2, 0, 1)).min(axis=1)
    inside = distance < PAPER_CONSTANTS.region_enter_m
    inside |= (distance <= PAPER_CONSTANTS.region_leave_m) & np.isin(states.actor_id, before)
    return states.actor_id[inside | is_emv]


def rows_in_region(record: EpisodeRecord) -> Flags:
    """Which of ``record.rows`` are of vehicles in the region at that step, as ``region_members`` says; ``(M,)``."""
    rows = record.rows
    is_emv = np.isin(rows.actor_id, np.array(record.emv_ids, dtype=np.uint32))
    # Steps are counted as they were recorded, so that a gap in the record is none in the membership.
    steps = np.unique(np.array([state.step for state in record.states], dtype=np.int64))
    place = np.searchsorted(steps, rows.step)
    distance = np.full(len(rows), np.inf)
    for emv in record.emv_ids:
        own = record.rows_of(emv)
        track = np.full((len(steps), 2), np.inf)
        track[place[own]] = rows.xy_m[own]
        distance = np.minimum(distance, np.hypot(*(rows.xy_m - track[place]).T))
    enters, leaves = distance < PAPER_CONSTANTS.region_enter_m, distance > PAPER_CONSTANTS.region_leave_m
    begins = np.ones(len(rows), dtype=np.bool_)
    begins[1:] = (np.diff(rows.actor_id) != 0) | (np.diff(place) != 1)
    # In between a vehicle is what it last was: inside after an entry, outside after it left or appeared.
    decided = np.where(enters | leaves | begins, np.arange(len(rows)), 0)
    return np.asarray(enters[np.maximum.accumulate(decided)] | is_emv)
