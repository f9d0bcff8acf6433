"""The surrogate safety measures of one vehicle with everybody it met: least values and when they occurred."""

from dataclasses import dataclass

import numpy as np

from siren_ros.evaluation.surrogate_safety.encounters import Encounters, encounters_of
from siren_ros.evaluation.surrogate_safety.post_encroachment import Encroachment, post_encroachment
from siren_ros.evaluation.surrogate_safety.time_to_collision import PredictedContacts, predicted_contacts
from siren_ros.numerics.arrays import Flags, Rows
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord, Steps


@dataclass(frozen=True)
class Extreme:
    """The extreme value of a measure, and the step at which it occurred."""

    value: float
    step: int


@dataclass(frozen=True)
class PairMeasures:
    """How close a subject and one other actor came; None where a measure has no value."""

    actor_id: int
    time_to_collision_s: Extreme | None
    """Least TTC within the horizon."""
    required_deceleration_mps2: Extreme | None
    """Greatest DRAC."""
    encroachment: Encroachment | None
    gap_m: Extreme
    """Least gap of the two footprints; negative where they overlap."""


@dataclass(frozen=True)
class ConflictSeries:
    """The measures of all pairs step by step, for thresholds that combine them."""

    encounters: Encounters
    contacts: PredictedContacts


def conflict_series(record: EpisodeRecord, subject_id: int, steps: tuple[int, int] | None = None) -> ConflictSeries:
    """TTC, closing speed and gap between a subject and everybody else, step by step.

    Args:
        record: The episode.
        subject_id: The vehicle that the measures are about.
        steps: First step and the one after the last; the whole episode without it.

    Raises:
        InputError: The subject is no actor of the episode.
    """
    encounters = encounters_of(record, subject_id)
    if steps is not None:
        encounters = _select(encounters, (encounters.step >= steps[0]) & (encounters.step < steps[1]))
    return ConflictSeries(encounters, predicted_contacts(encounters))


def pair_measures(series: ConflictSeries) -> tuple[PairMeasures, ...]:
    """The extremes for each other actor of a series, by actor id."""
    encounters = series.encounters
    ids, first = np.unique(encounters.actor_id, return_index=True)
    bounds = np.append(first, len(encounters))
    return tuple(
        _measures(series, int(actor), np.arange(bounds[place], bounds[place + 1])) for place, actor in enumerate(ids)
    )


def longest_run_s(flags: Flags, steps: Steps) -> float:
    """Longest time for which a condition held without interruption: number of consecutive steps times the step.

    Args:
        flags: The condition at each step, shape ``(M,)``.
        steps: Increasing step numbers, shape ``(M,)``; a missing step interrupts.
    """
    held = steps[flags]
    if not len(held):
        return 0.0
    runs = np.split(held, np.flatnonzero(np.diff(held) != 1) + 1)
    return max(len(run) for run in runs) * STEP_S


def _measures(series: ConflictSeries, actor_id: int, rows: Rows) -> PairMeasures:
    encounters, contacts = series.encounters, series.contacts
    step = encounters.step[rows]
    time, needed, gap = contacts.time_s[rows], contacts.required_deceleration_mps2[rows], contacts.gap_m[rows]
    soonest, hardest, closest = int(np.argmin(time)), int(np.argmax(needed)), int(np.argmin(gap))
    length, width = encounters.other_size_m[rows[0]].tolist()
    return PairMeasures(
        actor_id,
        Extreme(float(time[soonest]), int(step[soonest])) if np.isfinite(time[soonest]) else None,
        Extreme(float(needed[hardest]), int(step[hardest])) if needed[hardest] > 0.0 else None,
        post_encroachment(
            encounters.subject.select(rows), encounters.other.select(rows), encounters.subject_size_m, (length, width)
        ),
        Extreme(float(gap[closest]), int(step[closest])),
    )


def _select(encounters: Encounters, chosen: Flags) -> Encounters:
    return Encounters(
        encounters.subject.select(chosen),
        encounters.other.select(chosen),
        encounters.subject_size_m,
        encounters.other_size_m[chosen],
    )
