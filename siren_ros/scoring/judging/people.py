"""Counts people in an episode (pedestrians, cyclists, motorcyclists): how many are near, how many interact.

A person *meets* a driver where their ways cross with a post-encroachment time (PET) of at most 5 s, or where they
would touch within 1.5 s if both went on as they do now (TTC). These are the limits of the surrogate safety
assessment model (Gettman et al., FHWA-HRT-08-051, 2008); PETs up to 5 s are also the interactions of Zangenehpour et
al., Accident Analysis and Prevention 86 (2016) 161. An encounter counts with an EMV, and with a civilian while that
one makes way.
"""

from dataclasses import asdict, dataclass
from typing import Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Ids, Points
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.scoring.judging.surrogate_safety import encounters_of, post_encroachment, predicted_contacts
from siren_ros.simulation.world.actors import ActorClass, Mode, rows_of_ids

NAMES: Final = {
    ActorClass.PEDESTRIAN: "pedestrians",
    ActorClass.BICYCLE: "cyclists",
    ActorClass.MOTORCYCLE: "motorcycles",
}
"""Names of the classes of people in a template's demand."""
NEAR_M: Final = 150.0
"""A person is near an EMV within this distance of the centres; the demand places people up to this far."""
_BODIES_M: Final = 10.0
"""Larger than half the diagonals of two bodies together."""
PET_MAX_S: Final = 5.0
TTC_MAX_S: Final = 1.5


@dataclass(frozen=True)
class PeopleOfClass:
    """Counts of people of one class in an episode."""

    near: int
    """Number of people that come within ``NEAR_M`` of an EMV."""
    near_median: int
    """Number of people present at once, as median over the steps."""
    with_emv: int
    """Number of people that meet an EMV."""
    with_yielding: int
    """Number of people that meet a yielding civilian."""
    met: int
    """Number of people that meet an EMV or a yielding civilian."""


def people_of(record: EpisodeRecord) -> dict[ActorClass, PeopleOfClass]:
    """Counts by class; empty for an episode without people."""
    people = _People.of(record)
    if people is None:
        return {}
    with_emv, with_yielding = set[int](), set[int]()
    near = np.zeros((len(people.ids), record.steps), np.bool_)
    for emv_id in record.emv_ids:
        if len(track := record.track(emv_id)):
            pairs = encounters_of(record, emv_id, people.ids.tolist())
            close = pairs.select(pairs.distance_m <= NEAR_M)
            near[rows_of_ids(people.ids, close.actor_id), close.step - record.states[0].step] = True
            with_emv |= people.met_by(emv_id, track)
    for actor_id in sorted(record.actors.keys() - set(record.emv_ids)):
        track = record.track(actor_id)
        yields = (track.mode >= Mode.YIELD_REACTING) & (track.mode <= Mode.YIELD_HOLD)
        if yields.any():
            with_yielding |= people.met_by(actor_id, track.select(yields))
    found = {}
    for kind in NAMES:
        of_kind = np.array([record.actors[key].actor_class is kind for key in people.ids.tolist()])
        own = set(people.ids[of_kind].tolist())
        found[kind] = PeopleOfClass(
            near=int(near[of_kind].any(axis=1).sum()),
            near_median=int(np.median(near[of_kind].sum(axis=0))),
            with_emv=len(own & with_emv),
            with_yielding=len(own & with_yielding),
            met=len(own & (with_emv | with_yielding)),
        )
    return found


def people_measures(record: EpisodeRecord) -> dict[str, int]:
    """Counts as an episode's outcome stores them; empty for an episode without people."""
    found = people_of(record)
    measures = {f"people.{NAMES[kind]}.{name}": n for kind, own in found.items() for name, n in asdict(own).items()}
    return measures | ({"people.met": sum(own.met for own in found.values())} if found else {})


@dataclass(frozen=True)
class _People:
    """All people of a record, with each one's bounding box and top speed."""

    record: EpisodeRecord
    ids: Ids
    low_m: Points
    high_m: Points
    top_mps: Floats

    @classmethod
    def of(cls, record: EpisodeRecord) -> Self | None:
        """Collect the people of a record; None if there are none."""
        rows = record.rows.select(np.isin(record.rows.actor_id, record.people_ids))
        ids, first = np.unique(rows.actor_id, return_index=True)
        if not len(ids):
            return None
        low, high = (function.reduceat(rows.xy_m, first) for function in (np.minimum, np.maximum))
        return cls(record, ids, low, high, np.maximum.reduceat(rows.speed_mps, first))

    def met_by(self, subject_id: int, mine: StateRows) -> set[int]:
        """People whom a driver meets on a part of its own track."""
        body = self.record.actors[subject_id]
        size_m, xy = (body.length_m, body.width_m), mine.xy_m
        gap_m = np.maximum(xy.min(axis=0) - self.high_m, self.low_m - xy.max(axis=0)).max(axis=1)
        way_m = (self.top_mps + mine.speed_mps.max()) * TTC_MAX_S
        around = (gap_m <= _BODIES_M + way_m) & (self.ids != subject_id)
        if not around.any():
            return set()
        pairs = encounters_of(self.record, subject_id, self.ids[around].tolist())
        on_course = pairs.distance_m <= pairs.reach_m + pairs.fastest_mps * TTC_MAX_S
        course = pairs.select(on_course & np.isin(pairs.step, mine.step))
        met = set(course.actor_id[predicted_contacts(course).time_s <= TTC_MAX_S].tolist())
        moves = _moving(mine)
        for actor_id in set(self.ids[around & (gap_m <= _BODIES_M)].tolist()) - met:
            other = self.record.actors[actor_id]
            track = _moving(self.record.track(actor_id))
            pet = post_encroachment(moves, track, size_m, (other.length_m, other.width_m))
            if pet is not None and pet.time_s <= PET_MAX_S:
                met.add(actor_id)
        return met


def _moving(track: StateRows) -> StateRows:
    """A track without the inner steps of each standstill, which add no new position."""
    moved = np.hypot(np.diff(track.x_m), np.diff(track.y_m)) > 0.0
    return track.select(np.append(True, moved) | np.append(moved, True))
