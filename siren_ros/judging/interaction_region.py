"""The moving interaction region around the EMV: the vehicles that the paper's platform simulates and logs."""

from collections.abc import Iterable, Iterator

import numpy as np

from siren_ros.numerics.arrays import Flags, Ids
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.paper_constants import PAPER_CONSTANTS
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


def regions_of(states: Iterable[ActorStates], emv_ids: Iterable[int]) -> Iterator[Ids]:
    """Members after each of consecutive steps."""
    members, emvs = np.empty(0, dtype=np.uint32), tuple(emv_ids)
    for state in states:
        members = region_members(members, state, emvs)
        yield members


def rows_in_region(record: EpisodeRecord) -> Flags:
    """Which of ``record.rows`` are of vehicles in the region at that step, shape ``(M,)``."""
    rows = record.rows
    inside = np.zeros(len(rows), dtype=np.bool_)
    if len(rows) == 0:
        return inside
    # Rows are sorted by actor and then by step, so that one number orders them.
    span = int(rows.step.max()) + 1
    keys = rows.actor_id.astype(np.int64) * span + rows.step
    states = sorted(record.states, key=lambda state: state.step)
    for state, members in zip(states, regions_of(states, record.emv_ids), strict=True):
        inside[np.searchsorted(keys, members.astype(np.int64) * span + state.step)] = True
    return inside
