"""Rulebooks (what a place asks of a driver before an emergency vehicle, clause by clause, as data), and grades by them.

A grade tells how a driver kept a clause in an episode, and what decides that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Final

from siren_ros.base.numerics.arrays import Brief
from siren_ros.base.params.folders import named_params_file, names_in_params, params_dir
from siren_ros.base.params.parameters import StrictMapping, read_strict_yaml
from siren_ros.base.params.plain_files import sha256_of_file
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, shown_text
from siren_ros.reports.exam.examinee import Examinee
from siren_ros.reports.exam.finding import Finding, Numbers
from siren_ros.reports.exam.monitors import MONITORS
from siren_ros.running.generation.closed_loop import AnswerTimes
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.scenario.sealing import SEALED

FOLDER = "rulebooks"
_LARGEST = 1e6


@dataclass(frozen=True)
class Clause(Brief):
    """One duty of a driver, with the monitor that measures it and the limits of its grades."""

    clause_id: str
    title: str
    text: str
    """The duty in plain words."""
    source: str
    """Document in which the duty is written down."""
    monitor: str
    """Name of the monitor that measures it, from ``MONITORS``."""
    numbers: Numbers
    """Numbers that the monitor needs."""
    minor: float
    """Value beyond which a violation is minor."""
    major: float
    """Value beyond which a violation is major. Where it is above ``minor``, greater values are worse; otherwise smaller
    ones are."""
    group: str = ""
    """Group of clauses that have to apply in a least number of episodes (``Rulebook.coverage``)."""


@dataclass(frozen=True)
class Rulebook(Brief):
    """The clauses that hold at a place, such as a country."""

    name: str
    title: str
    heard_m: float
    """Gap at which a driver can notice a siren at the earliest: from there on its duties are counted."""
    heard_late_m: float
    """Gap at which a driver notices it at the latest: a grave violation of a duty to act is one from there on, too."""
    reaction_s: float
    """Time after which a driver has to respond."""
    clauses: tuple[Clause, ...]
    sha256: str = ""
    """Hash of its file."""
    coverage: Mapping[str, int] = field(default_factory=dict)
    """Least number of episodes to which any clause of a group has to apply, by group."""
    most_minor: float = 1.0
    """Greatest share of episodes in which a clause may be violated."""
    included: Mapping[str, str] = field(default_factory=dict)
    """Hash of the book whose clauses this one has besides its own, by name."""


def load_rulebook(name_or_path: str) -> Rulebook:
    """A rulebook by its name in ``params/rulebooks``, or of a file, whose name then says so.

    With ``includes`` it has the clauses, the coverage and the share of minor violations of a shipped book first; a
    clause of its own replaces the one with the same id.

    Raises:
        InputError: No such file, or one that cannot be used; names file, line, key, value and what is allowed.
    """
    file = named_params_file("rulebook", FOLDER, name_or_path)
    root = read_strict_yaml(file)
    shipped = file.resolve().parent == (params_dir() / FOLDER).resolve()
    base = load_rulebook(root.text("includes", names_in_params(FOLDER))) if root.has("includes") else None
    if base is not None and base.included:
        raise InputError(root.where("includes"), base.name, "a book that includes none itself")
    heard_m = root.number("heard_m", 1.0, 500.0)
    clauses = tuple(_clause(entry) for entry in root.mappings("clauses"))
    ids = [clause.clause_id for clause in clauses]
    if not ids or len(set(ids)) < len(ids):
        raise InputError(f"{Path(file)}: clauses", ", ".join(ids), "clauses, each with an id of its own")
    book = Rulebook(
        name=shown_text(file.stem if shipped else f"own rulebook {file.name}"),
        title=_text(root, "title") if shipped else f"own rulebook {shown_text(file.name)}: {_text(root, 'title')}",
        heard_m=heard_m,
        heard_late_m=root.number("heard_late_m", 1.0, heard_m) if root.has("heard_late_m") else heard_m,
        reaction_s=root.number("reaction_s", 0.0, 10.0),
        clauses=(*(one for one in (base.clauses if base else ()) if one.clause_id not in ids), *clauses),
        sha256=sha256_of_file(file),
        coverage=_coverage(root) if root.has("coverage") else base.coverage if base else {},
        most_minor=root.number("most_minor", 0.0, 1.0) if root.has("most_minor") else base.most_minor if base else 1.0,
        included={base.name: base.sha256} if base else {},
    )
    root.finish()
    return book


def _coverage(root: StrictMapping) -> Mapping[str, int]:
    entry = root.mapping("coverage")
    least = {group: entry.integer(group, 0, 10_000) for group in entry.values}
    entry.finish()
    return least


def _text(entry: StrictMapping, key: str) -> str:
    """A text for certificates, on one line, because terminals and XML take no control characters."""
    return shown_text(" ".join(entry.text(key).split()))


def _clause(entry: StrictMapping) -> Clause:
    monitor = entry.text("monitor", MONITORS)
    numbers = {}
    if wanted := MONITORS[monitor].numbers:
        given = entry.mapping("numbers")
        numbers = {key: given.number(key, *limits) for key, limits in wanted.items()}
        given.finish()
    clause = Clause(
        clause_id=_text(entry, "id"),
        title=_text(entry, "title"),
        text=_text(entry, "text"),
        source=_text(entry, "source"),
        monitor=monitor,
        numbers=numbers,
        minor=entry.number("minor", -_LARGEST, _LARGEST),
        major=entry.number("major", -_LARGEST, _LARGEST),
        group=_text(entry, "group") if entry.has("group") else "",
    )
    entry.finish()
    if clause.minor == clause.major:
        raise InputError(entry.where("major"), clause.major, "another value than minor, which says what is worse")
    return clause


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
    paper: str = ""
    """Bag of the same episode with the paper's driver; empty where there is none."""
    map_sha256: str = ""
    """Hash of the compiled map."""
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


def examine(
    record: EpisodeRecord,
    actor_id: int,
    rulebook: Rulebook,
    bag: str = "",
    paper: tuple[EpisodeRecord, int] | None = None,
) -> Sitting:
    """The marks of a driver in an episode.

    Args:
        record: The episode.
        actor_id: The driver.
        rulebook: The rulebook.
        bag: Its bag, for the sitting.
        paper: The same episode with the paper's driver in its place, and that one's id.

    Raises:
        InputError: The episode has no such civilian vehicle.
    """
    other = None if paper is None else Examinee(*paper, rulebook.heard_m, rulebook.reaction_s)
    examinee = Examinee(record, actor_id, rulebook.heard_m, rulebook.reaction_s, other)
    late = Examinee(record, actor_id, rulebook.heard_late_m, rulebook.reaction_s, other)
    marks = []
    for clause in rulebook.clauses:
        monitor = MONITORS[clause.monitor]
        finding = monitor.find(examinee, clause.numbers)
        grade = grade_of(clause, finding)
        if grade is Grade.MAJOR and monitor.asks_to_act and rulebook.heard_late_m < rulebook.heard_m:
            lately = grade_of(clause, monitor.find(late, clause.numbers))
            grade = grade if lately is Grade.MAJOR else Grade.MINOR
        marks.append(Mark(clause, grade, finding))
    described = record.description
    return Sitting(bag, name_of(described, bag), actor_id, tuple(marks), map_sha256=described.map_sha256)


def name_of(described: EpisodeDescription, bag: str) -> str:
    """The name of an episode in an exam; a sealed one has that of its bag."""
    if SEALED in described.parameters:
        return Path(bag).name
    return f"{described.template}_{described.level.name}_seed{described.seed}_{described.map_name}"
