"""Rulebooks: what a place asks of a driver before an emergency vehicle, clause by clause, as data."""

from dataclasses import dataclass
from pathlib import Path

from siren_ros.base.params.resources import named_params_file
from siren_ros.base.params.strict_yaml import StrictMapping, read_strict_yaml
from siren_ros.base.tables.brief import Brief
from siren_ros.errors import InputError, shown_text
from siren_ros.reports.exam.monitors import MONITORS, Numbers

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


@dataclass(frozen=True)
class Rulebook(Brief):
    """The clauses that hold at a place, such as a country."""

    name: str
    title: str
    heard_m: float
    """Gap at which a driver has to notice the siren of an EMV that comes from behind."""
    reaction_s: float
    """Time after which a driver has to respond."""
    clauses: tuple[Clause, ...]


def load_rulebook(name_or_path: str) -> Rulebook:
    """A rulebook by its name in ``params/rulebooks``, or of a file.

    Raises:
        InputError: No such file, or one that cannot be used; names file, line, key, value and what is allowed.
    """
    file = named_params_file("rulebook", FOLDER, name_or_path)
    root = read_strict_yaml(file)
    book = Rulebook(
        name=shown_text(file.stem),
        title=_text(root, "title"),
        heard_m=root.number("heard_m", 1.0, 500.0),
        reaction_s=root.number("reaction_s", 0.0, 10.0),
        clauses=tuple(_clause(entry) for entry in root.mappings("clauses")),
    )
    root.finish()
    ids = [clause.clause_id for clause in book.clauses]
    if not ids or len(set(ids)) < len(ids):
        raise InputError(f"{Path(file)}: clauses", ", ".join(ids), "clauses, each with an id of its own")
    return book


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
    )
    entry.finish()
    if clause.minor == clause.major:
        raise InputError(entry.where("major"), clause.major, "another value than minor, which says what is worse")
    return clause
