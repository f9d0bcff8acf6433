"""Surrogate safety measures of one vehicle with all that it meets: time to collision, post-encroachment time.

Time to collision (TTC): when two footprints would touch if both drivers went on as they do now. Post-encroachment
time (PET): how long after one vehicle another one was at the same place.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Ids, Rows
from siren_ros.base.numerics.geometry import footprint_corners, separation_m, wrap_angle
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows, Steps
from siren_ros.errors import InputError


@dataclass(frozen=True)
class Encounters:
    """The states of a subject and of others at the same steps: N pairs, sorted by the other actor and then by step."""

    subject: StateRows
    other: StateRows
    subject_size_m: tuple[float, float]
    """Length and width of the subject."""
    other_size_m: Floats
    """Length and width of the other actor of each pair, shape ``(N, 2)``."""

    def __len__(self) -> int:
        return len(self.other)

    @property
    def step(self) -> Steps:
        """Step of each pair."""
        return self.other.step

    @property
    def actor_id(self) -> Ids:
        """Id of the other actor of each pair."""
        return self.other.actor_id

    @cached_property
    def reach_m(self) -> Floats:
        """Distance of the centres beyond which the two footprints cannot touch, shape ``(N,)``."""
        return np.asarray(0.5 * (np.hypot(*self.subject_size_m) + np.hypot(*self.other_size_m.T)))

    @cached_property
    def distance_m(self) -> Floats:
        """Distance of the centres, shape ``(N,)``."""
        return np.asarray(np.hypot(self.subject.x_m - self.other.x_m, self.subject.y_m - self.other.y_m))

    @cached_property
    def fastest_mps(self) -> Floats:
        """Sum of both speeds, shape ``(N,)``, an upper bound of the closing speed."""
        return np.asarray(self.subject.speed_mps + self.other.speed_mps)

    def select(self, pairs: Flags) -> "Encounters":
        """Select some of the pairs."""
        subject, other = self.subject.select(pairs), self.other.select(pairs)
        return Encounters(subject, other, self.subject_size_m, self.other_size_m[pairs])


def encounters_of(record: EpisodeRecord, subject_id: int, others: Iterable[int] | None = None) -> Encounters:
    """Pair one actor with other actors (all by default), at every step with both.

    Raises:
        InputError: The record has no state of the subject, or does not describe it.
    """
    rows = record.rows
    mine = record.rows_of(subject_id)
    if not len(mine) or subject_id not in record.actors:
        raise InputError("actor", subject_id, "an actor of the episode")
    wanted = [key for key in (record.actors if others is None else others) if key != subject_id]
    theirs = np.flatnonzero(np.isin(rows.actor_id, wanted))
    place = np.searchsorted(rows.step[mine], rows.step[theirs])
    together = place < len(mine)
    together[together] = rows.step[mine][place[together]] == rows.step[theirs[together]]
    theirs, place = theirs[together], place[together]
    ids, column = np.unique(rows.actor_id[theirs], return_inverse=True)
    subject, *actors = (record.actors[key] for key in (subject_id, *ids.tolist()))
    sizes_m = np.array([(actor.length_m, actor.width_m) for actor in actors], dtype=np.float64).reshape(-1, 2)
    size_m = subject.length_m, subject.width_m
    return Encounters(rows.select(mine[place]), rows.select(theirs), size_m, sizes_m[column])


CROSSING_MIN_RAD: Final = float(np.radians(30.0))
"""Paths that meet at a smaller angle follow each other: their time gap is headway, not encroachment."""


@dataclass(frozen=True)
class Encroachment:
    """The closest encroachment of two tracks."""

    time_s: float
    """PET: time from when the first vehicle left a place until the second reached it."""
    step: int
    """Step at which the second vehicle reached the place."""
    subject_first: bool
    """Whether the subject was first."""


def post_encroachment(
    subject: StateRows,
    other: StateRows,
    subject_size_m: tuple[float, float],
    other_size_m: tuple[float, float],
    crossing_min_rad: float = CROSSING_MIN_RAD,
) -> Encroachment | None:
    """Smallest PET of two tracks that cross or meet head-on, from their footprints; None if they do not overlap.

    PET after Allen, Shin and Cooper (1978), with the places that both footprints covered instead of one conflict area,
    so that long vehicles and shallow angles count as they are. Sizes are length and width. Below the angle
    ``crossing_min_rad`` between the two headings the two follow each other.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415 - loads slowly, and episodes without people do not need it

    if not len(subject) or not len(other):
        return None
    reach = 0.5 * float(np.hypot(*subject_size_m) + np.hypot(*other_size_m))
    pairs = cKDTree(subject.xy_m).sparse_distance_matrix(cKDTree(other.xy_m), reach, output_type="ndarray")
    mine, theirs = pairs["i"], pairs["j"]
    crossing = np.abs(wrap_angle(subject.yaw_rad[mine] - other.yaw_rad[theirs])) >= crossing_min_rad
    mine, theirs = mine[crossing], theirs[crossing]
    if not len(mine):
        return None
    footprints = _corners(subject.select(mine), subject_size_m), _corners(other.select(theirs), other_size_m)
    both = separation_m(*footprints) < 0.0
    if not both.any():
        return None
    first, second = subject.step[mine[both]], other.step[theirs[both]]
    delay = np.abs(first - second)
    # The earliest of equal delays.
    best = int(np.lexsort((np.maximum(first, second), delay))[0])
    step = int(max(first[best], second[best]))
    return Encroachment(float(delay[best] * STEP_S), step, bool(first[best] < second[best]))


def _corners(states: StateRows, size_m: tuple[float, float]) -> Floats:
    length, width = (np.full(len(states), side) for side in size_m)
    return footprint_corners(states.x_m, states.y_m, states.yaw_rad, length, width)


HORIZON_S: Final = 3.0
"""Time for which contacts are predicted; no threshold in use is above it."""
INTERVAL_S: Final = 0.05
_TURN_MIN_RADPS: Final = 1e-6
"""Below this rate of turn the motion is treated as straight."""


@dataclass(frozen=True)
class PredictedContacts:
    """Contacts predicted from the present motion of each pair; arrays of shape ``(N,)`` like the encounters."""

    time_s: Floats
    """TTC; infinite if the footprints do not touch within the horizon, 0 if they already overlap."""
    closing_mps: Floats
    """Closing speed along the contact's normal just before the contact; 0 without a contact."""
    gap_m: Floats
    """Present gap of the footprints along their best separating axis; negative if they overlap."""

    @property
    def required_deceleration_mps2(self) -> Floats:
        """Deceleration that avoids the contact (DRAC); 0 if none is predicted.

        The closing speed has to vanish over the gap that is left: v² / (2·gap) with gap = v·TTC, hence v / (2·TTC)
        (Cooper and Ferguson 1976; Archer 2005).
        """
        ahead = np.isfinite(self.time_s)
        needed = np.zeros(len(self.time_s))
        closing = self.closing_mps[ahead]
        with np.errstate(divide="ignore", invalid="ignore"):  # the division by 0 s occurs where they already touch
            needed[ahead] = np.where(closing > 0.0, closing / (2.0 * self.time_s[ahead]), 0.0)
        return needed


def predicted_contacts(encounters: Encounters) -> PredictedContacts:
    """Predict contacts of each pair with swept oriented boxes.

    Both vehicles keep their speed and their rate of turn, so that one that follows a bend is not expected to leave it.
    The footprints are compared every 0.05 s; between two instants the gap is taken as linear.
    """
    return _first_contacts(encounters, partial(_turned, encounters.subject), partial(_turned, encounters.other))


def contacts_on_ways(encounters: Encounters, record: EpisodeRecord) -> PredictedContacts:
    """Predict contacts along the recorded paths, if both kept their present speed.

    It is as ``predicted_contacts``, but knows where both went: a vehicle at the end of its turn does not turn on.
    Behind the end of its record a vehicle goes straight on.
    """
    ids = np.unique(np.concatenate((encounters.subject.actor_id, encounters.other.actor_id))).tolist()
    ways = {actor_id: _Way.of(record.track(actor_id)) for actor_id in ids}
    return _first_contacts(
        encounters, partial(_driven, encounters.subject, ways), partial(_driven, encounters.other, ways)
    )


_Pose = tuple[Floats, Floats, Floats]
"""Position and yaw of several rows."""
_Motion = Callable[[Rows, float], _Pose]
"""Gives the poses of rows after a time in seconds."""


def _first_contacts(encounters: Encounters, subject: _Motion, other: _Motion) -> PredictedContacts:
    count, motions = len(encounters), (subject, other)
    time, closing = np.full(count, np.inf), np.zeros(count)
    gap = _gaps(encounters, motions, np.arange(count), 0.0, exact=True)
    touching = gap <= 0.0
    time[touching] = 0.0
    # Pairs that can touch within the horizon, whatever their directions.
    reach_m = encounters.reach_m + encounters.fastest_mps * HORIZON_S
    candidates = np.flatnonzero(~touching & (encounters.distance_m <= reach_m))
    before = gap[candidates]
    for instant in np.arange(INTERVAL_S, HORIZON_S + 0.5 * INTERVAL_S, INTERVAL_S):
        if not len(candidates):
            break
        after = _gaps(encounters, motions, candidates, float(instant))
        met = after <= 0.0
        change = before[met] - after[met]
        time[candidates[met]] = instant - INTERVAL_S * (-after[met] / change)
        closing[candidates[met]] = change / INTERVAL_S
        candidates, before = candidates[~met], after[~met]
    if touching.any():
        later = _gaps(encounters, motions, np.flatnonzero(touching), INTERVAL_S)
        closing[touching] = np.maximum(0.0, (gap[touching] - later) / INTERVAL_S)
    return PredictedContacts(time, closing, gap)


def _gaps(
    encounters: Encounters, motions: tuple[_Motion, _Motion], rows: Rows, after_s: float, *, exact: bool = False
) -> Floats:
    """Gap of each pair after some time of both motions.

    Unless exact, a lower bound serves for pairs that are too far apart to touch within the next interval.
    """
    a, b = (motion(rows, after_s) for motion in motions)
    gap = np.hypot(a[0] - b[0], a[1] - b[1]) - encounters.reach_m[rows]
    near = np.flatnonzero(exact | (gap <= encounters.fastest_mps[rows] * INTERVAL_S + 1.0))
    length, width = encounters.subject_size_m
    (ax, ay, a_yaw), (bx, by, b_yaw) = (tuple(part[near] for part in pose) for pose in (a, b))
    mine = footprint_corners(ax, ay, a_yaw, np.full(len(near), length), np.full(len(near), width))
    theirs = footprint_corners(bx, by, b_yaw, *encounters.other_size_m[rows[near]].T)
    gap[near] = separation_m(mine, theirs)
    return np.asarray(gap)


def _turned(states: StateRows, rows: Rows, after_s: float) -> _Pose:
    """Pose after a time with constant speed and rate of turn; the velocity turns with the yaw."""
    vx, vy, rate = states.vx_mps[rows], states.vy_mps[rows], states.yaw_rate_radps[rows]
    turn = rate * after_s
    straight = np.abs(rate) < _TURN_MIN_RADPS
    safe = np.where(straight, 1.0, rate)
    along = np.where(straight, after_s, np.sin(turn) / safe)
    aside = np.where(straight, 0.0, (1.0 - np.cos(turn)) / safe)
    x = states.x_m[rows] + vx * along - vy * aside
    y = states.y_m[rows] + vx * aside + vy * along
    return x, y, states.yaw_rad[rows] + turn


@dataclass(frozen=True)
class _Way:
    """Path of a recorded vehicle; arrays over its steps."""

    step: Steps
    arc_m: Floats
    x_m: Floats
    y_m: Floats
    yaw_rad: Floats

    @classmethod
    def of(cls, track: StateRows) -> "_Way":
        arc_m = np.append(0.0, np.cumsum(np.hypot(np.diff(track.x_m), np.diff(track.y_m))))
        return cls(track.step, arc_m, track.x_m, track.y_m, np.unwrap(track.yaw_rad))

    def after(self, step: Steps, way_m: Floats) -> _Pose:
        """Poses at distances driven from the positions of steps."""
        at_m = np.interp(step, self.step, self.arc_m) + way_m
        x, y, yaw = (np.interp(at_m, self.arc_m, column) for column in (self.x_m, self.y_m, self.yaw_rad))
        beyond_m = np.maximum(at_m - self.arc_m[-1], 0.0)
        return x + beyond_m * np.cos(yaw), y + beyond_m * np.sin(yaw), yaw


def _driven(states: StateRows, ways: Mapping[int, _Way], rows: Rows, after_s: float) -> _Pose:
    """Poses after a time with constant speed on each vehicle's path."""
    pose = np.empty((3, len(rows)))
    ids, step, way_m = states.actor_id[rows], states.step[rows], states.speed_mps[rows] * after_s
    for actor_id in np.unique(ids).tolist():
        own = ids == actor_id
        pose[:, own] = ways[actor_id].after(step[own], way_m[own])
    return pose[0], pose[1], pose[2]


@dataclass(frozen=True)
class Extreme:
    """Extreme value of a measure, with its step."""

    value: float
    step: int


@dataclass(frozen=True)
class PairMeasures:
    """How close a subject and one other actor came; None where a measure has no value."""

    actor_id: int
    time_to_collision_s: Extreme | None
    """Smallest TTC within the horizon."""
    required_deceleration_mps2: Extreme | None
    """Largest DRAC."""
    encroachment: Encroachment | None
    gap_m: Extreme
    """Smallest gap of the two footprints; negative if they overlap."""


def conflict_series(
    record: EpisodeRecord, subject_id: int, steps: tuple[int, int] | None = None
) -> tuple[Encounters, PredictedContacts]:
    """Pairs of a subject with all other actors, and their predicted contacts, step by step.

    ``steps`` are the first step and the one after the last, without them the whole episode.

    Raises:
        InputError: The subject is no actor of the episode.
    """
    encounters = encounters_of(record, subject_id)
    if steps is not None:
        encounters = encounters.select((encounters.step >= steps[0]) & (encounters.step < steps[1]))
    return encounters, predicted_contacts(encounters)


def pair_measures(encounters: Encounters, contacts: PredictedContacts) -> tuple[PairMeasures, ...]:
    """Extremes of a conflict series for each other actor, by actor id."""
    time, needed, gap = contacts.time_s, contacts.required_deceleration_mps2, contacts.gap_m

    def extreme(values: Floats, row: np.intp) -> Extreme:
        return Extreme(float(values[row]), int(encounters.step[row]))

    ids, first = np.unique(encounters.actor_id, return_index=True)
    measures = []
    for actor_id, bounds in zip(ids.tolist(), pairwise((*first.tolist(), len(encounters))), strict=True):
        rows = np.arange(*bounds)
        soonest, hardest, closest = rows[[time[rows].argmin(), needed[rows].argmax(), gap[rows].argmin()]]
        length, width = encounters.other_size_m[rows[0]].tolist()
        subject, other = encounters.subject.select(rows), encounters.other.select(rows)
        measures.append(
            PairMeasures(
                actor_id,
                extreme(time, soonest) if np.isfinite(time[soonest]) else None,
                extreme(needed, hardest) if needed[hardest] > 0.0 else None,
                post_encroachment(subject, other, encounters.subject_size_m, (length, width)),
                extreme(gap, closest),
            )
        )
    return tuple(measures)


def longest_run(flags: Flags, steps: Steps) -> Steps:
    """The consecutive steps of the longest time for which a condition held without interruption; the first such run.

    Args:
        flags: The condition at each step, shape ``(M,)``.
        steps: Increasing step numbers, shape ``(M,)``; a missing step interrupts.
    """
    held = steps[flags]
    return max(np.split(held, np.flatnonzero(np.diff(held) != 1) + 1), key=len)


def longest_run_s(flags: Flags, steps: Steps) -> float:
    """Longest time for which a condition held without interruption: steps of ``longest_run`` times the step."""
    return len(longest_run(flags, steps)) * STEP_S
