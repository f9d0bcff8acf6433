"""Reference labels Normal, Near-Miss or Collision, from conflicts that a camera on the EMV saw."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from enum import IntEnum, StrEnum
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Ids
from siren_ros.base.numerics.geometry import footprint_corners
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows, Steps
from siren_ros.errors import InputError
from siren_ros.scoring.judging.surrogate_safety import (
    Encounters,
    Encroachment,
    conflict_series,
    contacts_on_ways,
    longest_run_s,
    post_encroachment,
)
from siren_ros.sensing.specification import Mount
from siren_ros.simulation.world.actors import EventKind


class RiskClass(IntEnum):
    """Outcome of a scene, by severity (paper, "Risk understanding")."""

    NORMAL = 0
    NEAR_MISS = 1
    COLLISION = 2

    @property
    def title(self) -> str:
        """Name as in the paper and in answer files: Normal, Near-Miss or Collision."""
        return _TITLES[self]


_TITLES = {RiskClass.NORMAL: "Normal", RiskClass.NEAR_MISS: "Near-Miss", RiskClass.COLLISION: "Collision"}
TITLES = tuple(risk.title for risk in RiskClass)


def risk_class(title: str) -> RiskClass:
    """Class of a title; case, spaces, hyphens and underscores are ignored.

    Raises:
        InputError: Another word.
    """
    plain = "".join(letter for letter in title.casefold() if letter.isalpha())
    for known, written in _TITLES.items():
        if plain == written.casefold().replace("-", ""):
            return known
    raise InputError("class", title, ", ".join(TITLES))


def most_severe(classes: Iterable[RiskClass]) -> RiskClass:
    """The most severe class among the predictions of one video (the paper's max-severity rule).

    Raises:
        ValueError: No class at all.
    """
    return max(classes)


def in_view(encounters: Encounters, mount: Mount, horizontal_fov_rad: float, range_m: float) -> Flags:
    """Whether a part of the other vehicle is in the view of a camera on the subject, for each pair, shape ``(N,)``.

    A vehicle is in view where a corner of its footprint lies within the horizontal field of view (its full angle) and
    within the range from the camera, which is mounted in the subject's ``base_link``. Objects between are not
    considered: the pictures' instance masks tell which vehicles were really seen.
    """
    subject, other = encounters.subject, encounters.other
    corners = footprint_corners(other.x_m, other.y_m, other.yaw_rad, *encounters.other_size_m.T)
    cos, sin = np.cos(subject.yaw_rad), np.sin(subject.yaw_rad)
    eye_x = subject.x_m + cos * mount.x_m - sin * mount.y_m
    eye_y = subject.y_m + sin * mount.x_m + cos * mount.y_m
    dx, dy = corners[..., 0] - eye_x[:, None], corners[..., 1] - eye_y[:, None]
    look = subject.yaw_rad + mount.yaw_rad
    ahead = dx * np.cos(look)[:, None] + dy * np.sin(look)[:, None]
    aside = dy * np.cos(look)[:, None] - dx * np.sin(look)[:, None]
    within = np.abs(np.arctan2(aside, ahead)) <= 0.5 * horizontal_fov_rad
    return np.asarray((within & (np.hypot(ahead, aside) <= range_m)).any(axis=1))


MOST_MPS2: Final = 100.0
"""Replaces an infinite deceleration, because JSON has no infinity."""
VIEW_RANGE_M: Final = 80.0
"""Range of view: beyond it a car is a few pixels wide in a picture of 800 pixels and 100 degrees."""
SEEN_BEFORE_STEPS: Final = 40
"""A conflict counts only if the camera saw the other vehicle within this many steps (2 s) before it."""


@dataclass(frozen=True)
class Camera:
    """The view of the camera that makes the video."""

    mount: Mount
    horizontal_fov_rad: float


@dataclass(frozen=True)
class Moments:
    """Pairs of the EMV and a visible vehicle on a collision course.

    Arrays of shape ``(N,)`` sorted by actor and step.
    """

    step: Steps
    actor_id: Ids
    time_to_collision_s: Floats
    closing_mps: Floats
    required_deceleration_mps2: Floats
    gap_m: Floats
    braked_mps2: Floats
    """Hardest braking of the two, from two seconds before until the predicted contact.

    It is 0 where keeping the speed on the ways that both took leads to no contact, so that nobody had to brake. NaN in
    sets of earlier versions.
    """

    def __len__(self) -> int:
        return len(self.step)

    def at(self, rows: Flags) -> "Moments":
        """Select some of the rows."""
        return Moments(*(getattr(self, column.name)[rows] for column in fields(Moments)))


@dataclass(frozen=True)
class SeenEncroachment:
    """The smallest PET of the EMV and a visible vehicle."""

    actor_id: int
    step: int
    time_s: float
    braked_mps2: float | None = None
    """Hardest braking of the two in the 2 s before the second one arrived; None in sets of earlier versions."""
    needed_mps2: float | None = None
    """Braking with which the second vehicle could have stopped before the place, when the first one left it."""


@dataclass(frozen=True)
class SeenContact:
    """A contact of the EMV with a visible vehicle."""

    actor_id: int
    step: int
    impact_mps: float


@dataclass(frozen=True)
class Evidence:
    """The conflicts of a window of an episode; steps are the episode's."""

    moments: Moments
    encroachments: tuple[SeenEncroachment, ...]
    contacts: tuple[SeenContact, ...]

    def within(self, first_step: int, end_step: int) -> "Evidence":
        """The part from the first step up to, but not including, the end step."""
        inside = (self.moments.step >= first_step) & (self.moments.step < end_step)
        return Evidence(
            self.moments.at(inside),
            tuple(conflict for conflict in self.encroachments if first_step <= conflict.step < end_step),
            tuple(conflict for conflict in self.contacts if first_step <= conflict.step < end_step),
        )


def evidence_of(record: EpisodeRecord, emv_id: int, camera: Camera, steps: tuple[int, int]) -> Evidence:
    """Find the conflicts between an EMV and the vehicles in its camera's view, within a window of an episode.

    Others are civilians and further EMVs.

    The window is given by its first step and the one after its last.

    Raises:
        InputError: The EMV is no actor of the episode.
    """
    pairs, contacts = conflict_series(record, emv_id, steps)
    visible = in_view(pairs, camera.mount, camera.horizontal_fov_rad, VIEW_RANGE_M)
    seen = _recently(visible, pairs.actor_id, pairs.step)
    course = seen & np.isfinite(contacts.time_s)
    step, actor_id, until = pairs.step[course], pairs.actor_id[course], (pairs.step + contacts.time_s / STEP_S)[course]
    meet = np.isfinite(contacts_on_ways(pairs.select(course), record).time_s)
    ways = {key: _way(record, key, steps) for key in (emv_id, *np.unique(pairs.actor_id[seen]).tolist())}
    braked_mps2 = np.zeros(len(step))
    for row in np.flatnonzero(meet).tolist():
        pair = ways[emv_id], ways[int(actor_id[row])]
        braked_mps2[row] = max(_hardest_braking(way, int(step[row]), float(until[row])) for way in pair)
    measures = contacts.time_s, contacts.closing_mps, contacts.required_deceleration_mps2, contacts.gap_m
    moments = Moments(step, actor_id, *[measure[course] for measure in measures] + [braked_mps2])
    seen_at = set(zip(pairs.actor_id[seen].tolist(), pairs.step[seen].tolist(), strict=True))
    encroachments = tuple(_encroachments(record, ways, emv_id, seen_at))
    return Evidence(moments, encroachments, tuple(_contacts(record, emv_id, steps, seen_at)))


def _recently(visible: Flags, actor_id: Ids, step: Steps) -> Flags:
    """Whether each pair's actor was visible at one of the last SEEN_BEFORE_STEPS steps."""
    last = np.full(len(step), -np.inf)
    last[visible] = step[visible]
    first = np.flatnonzero(np.append(True, actor_id[1:] != actor_id[:-1]))
    for begin, end in zip(first, np.append(first[1:], len(step)), strict=True):
        last[begin:end] = np.maximum.accumulate(last[begin:end])
    return np.asarray(step - last <= SEEN_BEFORE_STEPS)


def _encroachments(
    record: EpisodeRecord, ways: Mapping[int, StateRows], emv_id: int, seen_at: set[tuple[int, int]]
) -> Iterator[SeenEncroachment]:
    def size_m(actor_id: int) -> tuple[float, float]:
        return record.actors[actor_id].length_m, record.actors[actor_id].width_m

    emv = ways[emv_id]
    for actor_id in sorted(ways.keys() - {emv_id}):
        track = ways[actor_id]
        pet = post_encroachment(emv, track, size_m(emv_id), size_m(actor_id))
        if pet is not None and (actor_id, pet.step) in seen_at:
            second = track if pet.subject_first else emv
            braked = max(_hardest_braking(way, pet.step, pet.step) for way in (emv, track))
            yield SeenEncroachment(actor_id, pet.step, pet.time_s, braked, _needed_to_stop(second, pet))


def _way(record: EpisodeRecord, actor_id: int, steps: tuple[int, int]) -> StateRows:
    track = record.track(actor_id)
    return track.select((track.step >= steps[0]) & (track.step < steps[1]))


def _hardest_braking(way: StateRows, step: int, until_step: float) -> float:
    """Hardest braking from two seconds before a step until another step."""
    late = (way.step <= until_step) & (way.step > step - SEEN_BEFORE_STEPS)
    return float(max(0.0, -way.accel_mps2[late].min(initial=0.0)))


def _needed_to_stop(second: StateRows, pet: Encroachment) -> float:
    """Braking v² / (2·s) of the second vehicle to stop before the place, at the moment when the first one left it."""
    between = second.select((second.step >= pet.step - round(pet.time_s / STEP_S)) & (second.step <= pet.step))
    way_m = float(np.hypot(*np.diff(between.xy_m, axis=0).T).sum())
    speed_mps = float(between.speed_mps[0])
    return min(speed_mps**2 / (2.0 * way_m), MOST_MPS2) if way_m > 0.0 else MOST_MPS2 * (speed_mps > 0.0)


def _contacts(
    record: EpisodeRecord, emv_id: int, steps: tuple[int, int], seen_at: set[tuple[int, int]]
) -> Iterator[SeenContact]:
    for event in record.events_of(EventKind.COLLISION):
        pair = {event.actor_id, event.other_id}
        if emv_id not in pair or not steps[0] <= event.step < steps[1]:
            continue
        other = next(iter(pair - {emv_id}))
        # A contact stops both vehicles, so the step of the contact may be the first at which they touch.
        if {(other, event.step), (other, event.step - 1)} & seen_at:
            yield SeenContact(other, event.step, float(event.detail["impact_speed_mps"]))


@dataclass(frozen=True)
class RiskThresholds:
    """Thresholds of a near-miss. The paper publishes none; each has its source.

    A collision has no threshold: every contact is one, as the paper derives its labels from collision events and the
    models are told that touching is a collision.
    """

    time_to_collision_s: float = 1.5
    """TTC below which a conflict is serious (Hayward 1972; van der Horst 1990: 1.5 s)."""
    time_to_collision_for_s: float = 0.2
    """Least duration of a short TTC without interruption, so that a single step does not count."""
    closing_mps: float = 1.0
    """Least closing speed; slower vehicles manoeuvre in a queue."""
    post_encroachment_s: float = 1.0
    """PET below which an encroachment is serious (Allen, Shin and Cooper 1978; Peesapati et al. 2018: 1 s)."""
    required_deceleration_mps2: float = 3.4
    """DRAC above which a driver brakes uncomfortably (AASHTO Green Book: 3.4 m/s² is what most drivers accept)."""
    gap_m: float = 10.0
    """Largest gap at which a high DRAC counts; at larger gaps drivers can still evade."""
    braked_mps2: float = 0.0
    """A conflict counts only if one of the two braked at least this hard; 0 counts all."""
    needed_mps2: float = 0.0
    """A short PET also counts only if the second driver needed at least this braking to stop before the place; 0 counts
    all."""

    def counts(self, pet: SeenEncroachment) -> bool:
        """Whether a PET makes a near-miss: it is short, and the second driver did not pass in a controlled way."""
        evaded = pet.braked_mps2 is None or pet.braked_mps2 >= self.braked_mps2
        by_chance = pet.needed_mps2 is None or pet.needed_mps2 >= self.needed_mps2
        return pet.time_s < self.post_encroachment_s and (evaded or by_chance)


DEFINITIONS: Final = {"paper": RiskThresholds(), "near_crash": RiskThresholds(braked_mps2=3.4, needed_mps2=8.45)}
"""Definitions of a near-miss by name.

``paper``: each short TTC or PET and each high DRAC is one; the first set of 105 videos had these labels.
``near_crash``: a driver had to brake hard, too (a near-crash takes a rapid evasive manoeuvre: T. Dingus et al., The
100-Car Naturalistic Driving Study, DOT HS 810 593, 2006; 3.4 m/s² as for DRAC), or the PET is short and chance alone
kept the two apart, because not even full braking on a dry road would have (8.45 m/s²: F. Cunto, F. Saccomanno, Accid.
Anal. Prev. 40 (2008) 1171). A driver who waits for another vehicle and drives on right behind it passes in a controlled
way, which is normal; so is an oncoming car that points at the EMV for a moment, as it ends its turn, and may have
braked for that turn.
"""
NEW_SETS: Final = DEFINITIONS["near_crash"]
"""Thresholds of new sets: people see these near-misses; most conflicts of ``paper`` are none to the eye."""


class Reason(StrEnum):
    """The finding that decided a label."""

    NOTHING = "nothing"
    TIME_TO_COLLISION = "time_to_collision"
    POST_ENCROACHMENT = "post_encroachment"
    REQUIRED_DECELERATION = "required_deceleration"
    CONTACT = "contact"


@dataclass(frozen=True)
class RiskLabel:
    """A class with the moment that decided it."""

    risk: RiskClass
    reason: Reason = Reason.NOTHING
    actor_id: int = 0
    """The other vehicle; 0 without a conflict."""
    step: int = 0
    """Step of the episode; 0 without a conflict."""
    value: float = 0.0
    """Value of the measure in seconds, m/s² or m/s."""


def label_of(evidence: Evidence, thresholds: RiskThresholds) -> RiskLabel:
    """Label a window by its most severe finding; of equal ones the earliest decides."""
    findings = [
        *(
            RiskLabel(RiskClass.COLLISION, Reason.CONTACT, contact.actor_id, contact.step, contact.impact_mps)
            for contact in evidence.contacts
        ),
        *_short_times(evidence.moments, thresholds),
        *(
            RiskLabel(RiskClass.NEAR_MISS, Reason.POST_ENCROACHMENT, pet.actor_id, pet.step, pet.time_s)
            for pet in evidence.encroachments
            if thresholds.counts(pet)
        ),
        *_hard_decelerations(evidence.moments, thresholds),
    ]
    return min(findings, key=lambda label: (-label.risk, label.step), default=RiskLabel(RiskClass.NORMAL))


def _short_times(moments: Moments, thresholds: RiskThresholds) -> Iterator[RiskLabel]:
    short = moments.time_to_collision_s < thresholds.time_to_collision_s
    short &= (moments.closing_mps > thresholds.closing_mps) & _evaded(moments, thresholds)
    for actor_id in np.unique(moments.actor_id[short]).tolist():
        rows = np.flatnonzero((moments.actor_id == actor_id) & short)
        # Durations are whole steps: four steps are 0.2 s. The small amount absorbs rounding.
        run_s = longest_run_s(np.ones(len(rows), dtype=np.bool_), moments.step[rows])
        if run_s >= thresholds.time_to_collision_for_s - 1e-9:
            least = rows[np.argmin(moments.time_to_collision_s[rows])]
            yield _near_miss(Reason.TIME_TO_COLLISION, moments, least, moments.time_to_collision_s)


def _hard_decelerations(moments: Moments, thresholds: RiskThresholds) -> Iterator[RiskLabel]:
    hard = moments.required_deceleration_mps2 > thresholds.required_deceleration_mps2
    rows = np.flatnonzero(hard & (moments.gap_m < thresholds.gap_m) & _evaded(moments, thresholds))
    if len(rows):
        hardest = rows[np.argmax(moments.required_deceleration_mps2[rows])]
        yield _near_miss(Reason.REQUIRED_DECELERATION, moments, hardest, moments.required_deceleration_mps2)


def _evaded(moments: Moments, thresholds: RiskThresholds) -> Flags:
    return np.asarray(~(moments.braked_mps2 < thresholds.braked_mps2))


def _near_miss(reason: Reason, moments: Moments, row: np.intp, measure: Floats) -> RiskLabel:
    actor_id, step = int(moments.actor_id[row]), int(moments.step[row])
    return RiskLabel(RiskClass.NEAR_MISS, reason, actor_id, step, float(measure[row]))
