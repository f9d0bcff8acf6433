"""Who meets whom: the states of one vehicle with the states of all others at the same steps."""

from dataclasses import dataclass

import numpy as np

from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Floats, Ids, Rows
from siren_ros.recording.episode_record import EpisodeRecord, StateRows, Steps


@dataclass(frozen=True)
class Encounters:
    """The states of a subject and of others at the same steps: N pairs, sorted by the other actor and then by step."""

    subject: StateRows
    """The subject's state of each pair."""
    other: StateRows
    """The other's state of each pair."""
    subject_size_m: tuple[float, float]
    """Length and width."""
    other_size_m: Floats
    """Length and width of each pair's other, shape ``(N, 2)``."""

    def __len__(self) -> int:
        return len(self.other)

    @property
    def step(self) -> Steps:
        """Step of each pair."""
        return self.other.step

    @property
    def actor_id(self) -> Ids:
        """The other actor of each pair."""
        return self.other.actor_id

    @property
    def reach_m(self) -> Floats:
        """Distance of the centres beyond which the two footprints cannot touch, shape ``(N,)``."""
        return np.asarray(0.5 * (np.hypot(*self.subject_size_m) + np.hypot(*self.other_size_m.T)))


def encounters_of(record: EpisodeRecord, subject_id: int) -> Encounters:
    """One actor together with every other actor at every step at which both are there.

    Raises:
        InputError: The record has no state of the subject, or does not describe it.
    """
    rows = record.rows
    mine = record.rows_of(subject_id)
    if not len(mine) or subject_id not in record.actors:
        raise InputError("actor", subject_id, "an actor of the episode")
    others = np.flatnonzero(np.isin(rows.actor_id, [key for key in record.actors if key != subject_id]))
    place = np.searchsorted(rows.step[mine], rows.step[others])
    together = place < len(mine)
    together[together] = rows.step[mine][place[together]] == rows.step[others[together]]
    others, place = others[together], place[together]
    subject = record.actors[subject_id]
    return Encounters(
        rows.select(mine[place]), rows.select(others), (subject.length_m, subject.width_m), _sizes(record, others)
    )


def _sizes(record: EpisodeRecord, rows: Rows) -> Floats:
    ids, column = np.unique(record.rows.actor_id[rows], return_inverse=True)
    known = [record.actors[int(key)] for key in ids]
    sizes = np.array([(actor.length_m, actor.width_m) for actor in known], dtype=np.float64).reshape(-1, 2)
    return np.asarray(sizes[column])
