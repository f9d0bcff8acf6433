"""Two drivers compared by their certificates, in the episodes that both were graded in."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from siren_ros.base.params import plain_json
from siren_ros.base.tables.table import Row, Table
from siren_ros.errors import InputError
from siren_ros.reports.exam.certificate import mean_of
from siren_ros.reports.exam.grading import VIOLATED, Grade
from siren_ros.reports.exam.others import OTHERS

Content = Mapping[str, Any]


def read_certificate(file: Path) -> Content:
    """The content of a ``certificate.json``.

    Raises:
        InputError: It cannot be read, or is none.
    """
    try:
        content: Content = plain_json.load(file.read_bytes())
        content["driver"], content["clauses"], content["episodes"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError("certificate", str(file), f"a certificate.json of siren exam ({error})") from error
    return content


def compared(first: Content, second: Content) -> Table:
    """Violations of each clause, and the figures of what the drivers do to others, with the differences.

    A clause is compared in the episodes in which it applies to both; a difference is the first driver's less the
    second's.

    Raises:
        InputError: The rulebooks differ, no episode is in both, or a certificate is none of this version.
    """
    try:
        return _compared(first, second)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise InputError("certificate", repr(error), "the content of a certificate.json of siren exam") from error


def _compared(first: Content, second: Content) -> Table:
    if first["rulebook"] != second["rulebook"]:
        raise InputError("certificate", second["rulebook"], f"one of the rulebook {first['rulebook']}")
    sides = [{one["episode"]: one for one in content["episodes"] if one["marks"]} for content in (first, second)]
    both = [(sides[0][name], sides[1][name]) for name in sorted(sides[0].keys() & sides[1].keys())]
    if not both:
        raise InputError("certificate", second["driver"], "certificates with common episodes")
    rows: list[Row] = []
    for number, clause in enumerate(first["clauses"]):
        grades = [(a["marks"][number]["grade"], b["marks"][number]["grade"]) for a, b in both]
        pairs = [(a in VIOLATED, b in VIOLATED) for a, b in grades if Grade.NOT_APPLICABLE.value not in (a, b)]
        rows.append(_row(f"violated: {clause['title']}", [(float(a), float(b)) for a, b in pairs]))
    for key, meaning in OTHERS.items():
        known = [(a["others"][key], b["others"][key]) for a, b in both if a.get("others") and b.get("others")]
        rows.append(_row(meaning, known))
    head = ("figure", "episodes", first["driver"], second["driver"], "difference")
    caption = f"{first['driver']} and {second['driver']}, by the rulebook {first['rulebook']}"
    return Table("compared", caption, head, tuple(rows), specs={"difference": "+.2f"})


def _row(title: str, pairs: list[tuple[float, float]]) -> Row:
    if not pairs:
        return title, 0, None, None, None
    firsts, seconds = zip(*pairs, strict=True)
    differences = [a - b for a, b in pairs]
    return title, len(pairs), sum(firsts) / len(pairs), sum(seconds) / len(pairs), mean_of(differences)
