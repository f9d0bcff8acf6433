"""Reference labels: Normal, Near-Miss or Collision, from contacts and surrogate safety measures."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.evidence import Evidence, Moments
from siren_ros.evaluation.surrogate_safety import longest_run_s
from siren_ros.numerics.arrays import Floats


class RiskClass(IntEnum):
    """What a scene comes to, by severity (paper, "Risk understanding")."""

    NORMAL = 0
    NEAR_MISS = 1
    COLLISION = 2

    @property
    def title(self) -> str:
        """As the paper and answer files write it: Normal, Near-Miss or Collision."""
        return _TITLES[self]


_TITLES = {RiskClass.NORMAL: "Normal", RiskClass.NEAR_MISS: "Near-Miss", RiskClass.COLLISION: "Collision"}
TITLES = tuple(_TITLES[one] for one in RiskClass)


def risk_class(title: str) -> RiskClass:
    """The class of a title; case, spaces, hyphens and underscores do not matter.

    Raises:
        InputError: Another word.
    """
    plain = "".join(letter for letter in title.casefold() if letter.isalpha())
    for known, written in _TITLES.items():
        if plain == written.casefold().replace("-", ""):
            return known
    raise InputError("class", title, ", ".join(TITLES))


def most_severe(classes: Iterable[RiskClass]) -> RiskClass:
    """The paper's max-severity rule over the predictions of one video.

    Raises:
        ValueError: No class at all.
    """
    return max(classes)


@dataclass(frozen=True)
class RiskThresholds:
    """From when on an interaction is a near-miss. The paper publishes none; each has its source.

    A collision has no threshold: every contact is one, as the paper derives its labels from collision events and the
    models are told that touching is a collision.
    """

    time_to_collision_s: float = 1.5
    """TTC below which a conflict is serious (Hayward 1972; van der Horst 1990: 1.5 s)."""
    time_to_collision_for_s: float = 0.2
    """How long without interruption, so that a flicker of one step is none."""
    closing_mps: float = 1.0
    """Slower closing is manoeuvring in a queue."""
    post_encroachment_s: float = 1.0
    """PET below which an encroachment is serious (Allen, Shin and Cooper 1978; Peesapati et al. 2018: 1 s)."""
    required_deceleration_mps2: float = 3.4
    """DRAC above which a driver brakes uncomfortably (AASHTO Green Book: 3.4 m/s² is what most drivers accept)."""
    gap_m: float = 10.0
    """Farther away a high DRAC still leaves a way out."""


class Reason(StrEnum):
    """What decided a label."""

    NOTHING = "nothing"
    TIME_TO_COLLISION = "time_to_collision"
    POST_ENCROACHMENT = "post_encroachment"
    REQUIRED_DECELERATION = "required_deceleration"
    CONTACT = "contact"


@dataclass(frozen=True)
class RiskLabel:
    """A class, and the moment that decided it."""

    risk: RiskClass
    reason: Reason = Reason.NOTHING
    actor_id: int = 0
    """The civilian; 0 without a conflict."""
    step: int = 0
    """Of the episode; 0 without a conflict."""
    value: float = 0.0
    """The measure's: seconds, m/s² or m/s."""


def label_of(evidence: Evidence, thresholds: RiskThresholds) -> RiskLabel:
    """The label of a window: the most severe finding, and of equal ones the earliest."""
    findings = [
        *(
            RiskLabel(RiskClass.COLLISION, Reason.CONTACT, contact.actor_id, contact.step, contact.impact_mps)
            for contact in evidence.contacts
        ),
        *_short_times(evidence.moments, thresholds),
        *(
            RiskLabel(RiskClass.NEAR_MISS, Reason.POST_ENCROACHMENT, one.actor_id, one.step, one.time_s)
            for one in evidence.encroachments
            if one.time_s < thresholds.post_encroachment_s
        ),
        *_hard_decelerations(evidence.moments, thresholds),
    ]
    return min(findings, key=lambda label: (-label.risk, label.step), default=RiskLabel(RiskClass.NORMAL))


def _short_times(moments: Moments, thresholds: RiskThresholds) -> Iterator[RiskLabel]:
    short = moments.time_to_collision_s < thresholds.time_to_collision_s
    short &= moments.closing_mps > thresholds.closing_mps
    for actor_id in np.unique(moments.actor_id[short]).tolist():
        rows = np.flatnonzero((moments.actor_id == actor_id) & short)
        # Steps are whole, so that a run of four is 0.2 s; the small amount is for the division's last digit.
        run_s = longest_run_s(np.ones(len(rows), dtype=np.bool_), moments.step[rows])
        if run_s >= thresholds.time_to_collision_for_s - 1e-9:
            least = rows[np.argmin(moments.time_to_collision_s[rows])]
            yield _near_miss(Reason.TIME_TO_COLLISION, moments, least, moments.time_to_collision_s)


def _hard_decelerations(moments: Moments, thresholds: RiskThresholds) -> Iterator[RiskLabel]:
    hard = moments.required_deceleration_mps2 > thresholds.required_deceleration_mps2
    rows = np.flatnonzero(hard & (moments.gap_m < thresholds.gap_m))
    if len(rows):
        hardest = rows[np.argmax(moments.required_deceleration_mps2[rows])]
        yield _near_miss(Reason.REQUIRED_DECELERATION, moments, hardest, moments.required_deceleration_mps2)


def _near_miss(reason: Reason, moments: Moments, row: np.intp, measure: Floats) -> RiskLabel:
    actor_id, step = int(moments.actor_id[row]), int(moments.step[row])
    return RiskLabel(RiskClass.NEAR_MISS, reason, actor_id, step, float(measure[row]))
