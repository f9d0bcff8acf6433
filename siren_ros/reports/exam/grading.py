"""Grades of a driver in an episode: how it kept each clause of a rulebook, and what decides that."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from siren_ros.base.tables.brief import Brief
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.reports.exam.examinee import Examinee
from siren_ros.reports.exam.monitors import MONITORS, Finding
from siren_ros.reports.exam.rulebook import Clause, Rulebook
from siren_ros.running.generation.answer_times import AnswerTimes
from siren_ros.simulation.scenario.episode import EpisodeDescription


class Grade(StrEnum):
    """How well a clause was kept; the worst grade comes last."""

    NOT_APPLICABLE = "not applicable"
    PASS = "pass"  # noqa: S105 - no password
    MINOR = "minor"
    MAJOR = "major"


VIOLATED: Final = frozenset({Grade.MINOR, Grade.MAJOR})
"""Grades of a clause that was not kept."""


@dataclass(frozen=True)
class Mark(Brief):
    """A clause with its grade and what decided it."""

    clause: Clause
    grade: Grade
    finding: Finding


@dataclass(frozen=True)
class Sitting(Brief):
    """One episode of an exam: the driver's marks, in the order of the rulebook."""

    bag: str
    episode: str
    """Name of the episode: template, level, seed and map."""
    actor_id: int
    marks: tuple[Mark, ...]
    """The driver's marks; empty where there is no result."""
    lack: str = ""
    """Why there is no result."""
    others: Mapping[str, float] = field(default_factory=dict)
    """Effects of the driver on others, compared with the paper's driver in its place (``others.py``)."""
    answers: AnswerTimes | None = None
    """Answer times of the program that drove; None where none did, or where its time was not limited."""

    @property
    def grade(self) -> Grade:
        """The worst grade of all marks."""
        return worst_of([mark.grade for mark in self.marks])

    @property
    def violated(self) -> tuple[str, ...]:
        """The clauses that were not kept."""
        return tuple(mark.clause.clause_id for mark in self.marks if mark.grade in VIOLATED)


def worst_of(grades: Sequence[Grade]) -> Grade:
    """The worst of some grades."""
    return max(grades, key=[*Grade].index, default=Grade.NOT_APPLICABLE)


def grade_of(clause: Clause, finding: Finding) -> Grade:
    """The grade for what a clause's monitor found."""
    if not finding.measure.valid:
        return Grade.NOT_APPLICABLE
    sign = 1.0 if clause.major > clause.minor else -1.0
    value = sign * finding.measure.value
    if value > sign * clause.major:
        return Grade.MAJOR
    return Grade.MINOR if value > sign * clause.minor else Grade.PASS


def examine(record: EpisodeRecord, actor_id: int, rulebook: Rulebook, bag: str = "") -> Sitting:
    """The marks of a driver in an episode.

    Raises:
        InputError: The episode has no such civilian vehicle.
    """
    examinee = Examinee(record, actor_id, rulebook.heard_m, rulebook.reaction_s)
    marks = []
    for clause in rulebook.clauses:
        finding = MONITORS[clause.monitor].find(examinee, clause.numbers)
        marks.append(Mark(clause, grade_of(clause, finding), finding))
    return Sitting(bag, name_of(record.description), actor_id, tuple(marks))


def name_of(described: EpisodeDescription) -> str:
    """The name of an episode in an exam."""
    return f"{described.template}_{described.level.name}_seed{described.seed}_{described.map_name}"
