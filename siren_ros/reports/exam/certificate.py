"""The certificate of an exam: tables and moments as a page, the same as JSON, and as JUnit XML for a CI.

Two drivers are compared by their certificates, in the episodes that both were graded in.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET

import numpy as np

from siren_ros import __version__
from siren_ros.base.numerics.arrays import Brief, data_frame
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params import plain_files
from siren_ros.base.tables import Interval, Row, Table, share_interval
from siren_ros.data.episode_source import bag_sha256
from siren_ros.errors import InputError, shown_text
from siren_ros.reports.exam.examinee import OTHERS
from siren_ros.reports.exam.grading import VIOLATED, Grade, Mark, Rulebook, Sitting, worst_of
from siren_ros.reports.exam.monitors import MONITORS
from siren_ros.reports.study_report.page import EpisodePages, Link, Page, Section, quoted
from siren_ros.scoring.evaluation.realism.ledger import read_ledger
from siren_ros.scoring.evaluation.statistics import BlockSums, interval_of_mean

ABOUT: Final = ("versions", "matrix", "driver_sha256")
"""Keys of ``Certificate.about``."""
_VIOLATIONS: Final = "violations"
"""Name of the number of violated clauses in an episode."""
_BEFORE_S: Final = 2.0
"""A link to a moment starts the page this long before the moment."""


@dataclass(frozen=True)
class Certificate(Brief):
    """An exam: a rulebook, and a driver's sittings in order."""

    driver: str
    rulebook: Rulebook
    sittings: tuple[Sitting, ...]
    about: Mapping[str, Any] = field(default_factory=dict)
    """What else is on it, as JSON types: versions, matrix, hashes of the driver's files (``ABOUT``)."""

    def facts(self) -> dict[str, object]:
        """Whether the driver passes, and how many episodes have which grade."""
        counts = Counter(sitting.grade for sitting in self.graded)
        return {
            "driver": self.driver,
            "rulebook": self.rulebook.name,
            "passed": self.passed,
            "episodes": len(self.sittings),
            **{grade.value: counts[grade] for grade in _SHOWN if counts[grade]},
            **({"no result": len(self.without_result)} if self.without_result else {}),
        }

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame`` with a row for each episode and clause; a value that is not known is NaN.

        The columns are ``episode``, ``bag``, ``actor_id``, ``clause``, ``grade``, ``value`` with its ``unit``, and
        ``time_s``, the moment that decided. Episodes without a result have no rows.

        Raises:
            InputError: pandas is not installed.
        """
        pairs = [(sitting, mark) for sitting in self.graded for mark in sitting.marks]
        told = [_mark_as_json(mark) for _, mark in pairs]
        numbers = {
            name: np.array([one[name] for one in told], dtype=np.float64)  # a missing value (None) becomes NaN
            for name in ("value", "time_s")
        }
        return data_frame(
            {
                **{name: [getattr(one, name) for one, _ in pairs] for name in ("episode", "bag", "actor_id")},
                "clause": [one["clause"] for one in told],
                "grade": [mark.grade.value for _, mark in pairs],
                "value": numbers["value"],
                "unit": [one["unit"] for one in told],
                "time_s": numbers["time_s"],
            }
        )

    @property
    def grade(self) -> Grade:
        """The worst grade of all sittings."""
        return worst_of([sitting.grade for sitting in self.sittings])

    @property
    def passed(self) -> bool:
        """Whether every episode has a result, no clause was violated gravely, and nothing of ``lacks`` is there."""
        return self.grade in {Grade.PASS, Grade.MINOR} and not self.without_result and not self.lacks

    @property
    def lacks(self) -> tuple[str, ...]:
        """What else keeps the driver from passing: groups that applied too rarely, clauses violated too often.

        A clause is violated too often where the 95 % interval of its share is above what the rulebook allows.
        """
        often, counts, least = [], self.coverage(), self.rulebook.coverage
        rare = [
            f"{group}: applied in {count} episodes, at least {least[group]} are needed"
            for group, count in counts.items()
            if count < least[group]
        ]
        for number, clause in enumerate(self.rulebook.clauses):
            violated, applied = self.violated(number)
            if applied and share_interval(violated, applied).low > self.rulebook.most_minor:
                often.append(f"{clause.title}: violated in {violated} of {applied} episodes")
        return (*rare, *often)

    def coverage(self) -> dict[str, int]:
        """In how many episodes any clause of each group applied."""
        applied = [
            {mark.clause.group for mark in one.marks if mark.grade is not Grade.NOT_APPLICABLE} for one in self.graded
        ]
        return {group: sum(group in groups for groups in applied) for group in self.rulebook.coverage}

    def violated(self, number: int) -> tuple[int, int]:
        """In how many episodes a clause was violated, and in how many it applied."""
        grades = [sitting.marks[number].grade for sitting in self.graded]
        return sum(grade in VIOLATED for grade in grades), sum(grade is not Grade.NOT_APPLICABLE for grade in grades)

    @property
    def without_result(self) -> tuple[Sitting, ...]:
        """Episodes that came to no result."""
        return tuple(sitting for sitting in self.sittings if sitting.lack)

    @property
    def graded(self) -> tuple[Sitting, ...]:
        """Episodes that came to a result."""
        return tuple(sitting for sitting in self.sittings if not sitting.lack)

    def summary(self) -> Table:
        """How often each clause was kept, with the share of violations among the episodes that it applies to."""
        rows: list[Row] = []
        for number, clause in enumerate(self.rulebook.clauses):
            counts = Counter(sitting.marks[number].grade for sitting in self.graded)
            share = share_interval(*self.violated(number))
            rows.append((clause.title, *(counts[grade] for grade in _SHOWN), share, clause.source))
        head = ("clause", *(str(grade) for grade in _SHOWN), "violated", "source")
        return Table("clauses", "Clauses, by number of episodes", head, tuple(rows), specs={"violated": ".0%"})

    def tables(self) -> list[Table]:
        """All tables of the certificate: the summary, and effects and latency where they are known."""
        known = self.effects(), self.latency()
        return [self.summary(), self.per_way(), *(table for table in known if table is not None)]

    def effects(self) -> Table | None:
        """The effect of the driver on others, compared with the paper's driver in its place.

        None without paired episodes.
        """
        means = self.means()
        if len(means) == 1:
            return None
        rows = tuple((meaning, means[key]) for key, meaning in OTHERS.items())
        caption = f"Others, against the paper's driver at the wheel; number of episodes: {rows[0][1].blocks}"
        return Table("others", caption, ("figure", "difference"), rows, spec="+.2f")

    def means(self) -> dict[str, Interval]:
        """Means over the episodes: violated clauses, and the figures of ``OTHERS`` where episodes are paired."""
        violated = [float(len(sitting.violated)) for sitting in self.graded]
        paired = [sitting.others for sitting in self.graded if sitting.others]
        others = {key: mean_of([one[key] for one in paired]) for key in OTHERS} if paired else {}
        return {_VIOLATIONS: mean_of(violated), **others}

    def per_way(self) -> Table:
        """Violations and the figures of ``OTHERS`` in an episode, and on the road, where active EMVs are rare."""
        times, names = WAY_KM / km_per_emv(), {_VIOLATIONS: "violated clauses", **OTHERS}
        rows: list[Row] = [(names[key], mean, mean.scaled(times)) for key, mean in self.means().items()]
        caption = f"An automated vehicle meets an active emergency vehicle once in {km_per_emv():g} km"
        head = ("figure", "an encounter", f"{WAY_KM:,} km")
        return Table("per_way", caption, head, tuple(rows), spec=".2f")

    def latency(self) -> Table | None:
        """How fast the program answered in real time; None where that was not measured."""
        times = [sitting.answers for sitting in self.graded if sitting.answers is not None]
        if not times:
            return None
        late = sum(one.p95_ms > STEP_S * 1000.0 for one in times)
        rows: tuple[Row, ...] = (
            ("median of the medians, ms", float(np.median([one.median_ms for one in times]))),
            ("greatest 95 % value, ms", max(one.p95_ms for one in times)),
            ("slowest answer, ms", max(one.worst_ms for one in times)),
            ("episodes with more than 5 % of the answers later than a step", float(late)),
        )
        caption = f"Wall time to an answer; number of episodes: {len(times)}"
        return Table("latency", caption, ("figure", "value"), rows, spec=".1f")


WAY_KM: Final = 100_000
"""Way for which the certificate tells how often something happens."""


@cache
def km_per_emv() -> float:
    """Way between two active EMVs that an automated vehicle meets (line V01 of ``params/realism/ledger.yaml``)."""
    return next(line.value for line in read_ledger() if line.line_id == "V01")


def mean_of(values: Sequence[float]) -> Interval:
    """The mean over episodes, with its interval."""
    ones = np.ones(len(values))
    return interval_of_mean(BlockSums(np.asarray(values, np.float64), ones, np.zeros(len(values), np.intp)))


_SHOWN: Final = (Grade.PASS, Grade.MINOR, Grade.MAJOR, Grade.NOT_APPLICABLE)


def as_json(certificate: Certificate, hashes: Mapping[str, str] | None = None) -> str:
    """The certificate as JSON; the same exam gives the same bytes. ``hashes`` are those of bags that are known."""
    book, known = certificate.rulebook, hashes or {}
    content = {
        "siren": __version__,
        "driver": certificate.driver,
        **certificate.about,
        "rulebook": book.name,
        "rulebook_sha256": book.sha256,
        "included_sha256": dict(book.included),
        "heard_m": book.heard_m,
        "heard_late_m": book.heard_late_m,
        "reaction_s": book.reaction_s,
        "coverage": dict(book.coverage),
        "most_minor": book.most_minor,
        "passed": certificate.passed,
        "lacks": certificate.lacks,
        "grade": certificate.grade,
        "means": {key: mean.json() for key, mean in certificate.means().items()},
        "km_per_emv": km_per_emv(),
        "clauses": [_clause_as_json(certificate, number) for number in range(len(book.clauses))],
        "episodes": [
            {
                "episode": shown_text(sitting.episode),
                "bag": shown_text(sitting.bag),
                "map_sha256": sitting.map_sha256,
                "bag_sha256": known.get(sitting.bag) or _bag_sha256(sitting.bag),
                **(
                    {
                        "paper": shown_text(sitting.paper),
                        "paper_sha256": known.get(sitting.paper) or _bag_sha256(sitting.paper),
                    }
                    if sitting.paper
                    else {}
                ),
                "actor_id": sitting.actor_id,
                "grade": sitting.grade,
                "no_result": shown_text(sitting.lack),
                **({} if sitting.answers is None else {"answers": asdict(sitting.answers)}),
                "others": {key: round(value, 6) for key, value in sitting.others.items()},
                "marks": [_mark_as_json(mark) for mark in sitting.marks],
            }
            for sitting in certificate.sittings
        ],
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _bag_sha256(bag: str) -> str | None:
    return bag_sha256(Path(bag)) if Path(bag).exists() else None


def _clause_as_json(certificate: Certificate, number: int) -> dict[str, Any]:
    """A clause with its limits, and in how many episodes it applied: one that never did says nothing of a driver."""
    one = certificate.rulebook.clauses[number]
    limits = {"monitor": one.monitor, "numbers": dict(one.numbers), "minor": one.minor, "major": one.major}
    named = {"id": one.clause_id, "title": one.title, "text": one.text, "source": one.source, "group": one.group}
    violated, applied = certificate.violated(number)
    return {**named, **limits, "applied": applied, "violated": violated}


def _mark_as_json(mark: Mark) -> dict[str, Any]:
    measure, step = mark.finding.measure, mark.finding.step
    return {
        "clause": mark.clause.clause_id,
        "grade": mark.grade,
        "value": round(measure.value, 6) if measure.valid else None,
        "unit": MONITORS[mark.clause.monitor].unit,
        "reason": measure.lack,
        "time_s": None if step is None else round(step * STEP_S, 3),
        **({"about": shown_text(mark.finding.about)} if mark.finding.about else {}),
    }


def as_junit(certificate: Certificate) -> str:
    """The certificate as JUnit XML: a suite for each episode, a case for each clause, an error without a result.

    A grave violation is a failure, a clause that does not apply is skipped. A minor violation passes; its text is in
    the case's output. What else keeps the driver from passing (``Certificate.lacks``) fails in a suite of its own.
    """
    root = ET.Element("testsuites", name=f"siren exam {certificate.rulebook.name}")
    for sitting in certificate.sittings:
        counts = Counter(mark.grade for mark in sitting.marks)
        suite = ET.SubElement(
            root,
            "testsuite",
            name=sitting.episode,
            tests=str(len(sitting.marks) + bool(sitting.lack)),
            failures=str(counts[Grade.MAJOR]),
            errors=str(int(bool(sitting.lack))),
            skipped=str(counts[Grade.NOT_APPLICABLE]),
        )
        if sitting.lack:
            case = ET.SubElement(suite, "testcase", classname=sitting.episode, name="episode", time="0")
            ET.SubElement(case, "error", message=sitting.lack)
        for mark in sitting.marks:
            case = ET.SubElement(suite, "testcase", classname=sitting.episode, name=mark.clause.clause_id, time="0")
            if mark.grade is Grade.NOT_APPLICABLE:
                ET.SubElement(case, "skipped", message=mark.finding.measure.lack)
            elif mark.grade is Grade.MAJOR:
                failure = ET.SubElement(case, "failure", message=told(mark), type=mark.clause.clause_id)
                failure.text = f"{mark.clause.text}\n{mark.clause.source}\n{shown_again(sitting, mark)}"
            elif mark.grade is Grade.MINOR:
                ET.SubElement(case, "system-out").text = f"minor: {told(mark)}"
    _add_lacks(root, certificate.lacks)
    for element in root.iter():  # XML 1.0 has no character for an escape code, not even escaped
        element.attrib = {key: shown_text(value) for key, value in element.attrib.items()}
        if element.text is not None:
            element.text = "\n".join(map(shown_text, element.text.split("\n")))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _add_lacks(root: ET.Element, lacks: Sequence[str]) -> None:
    if not lacks:
        return
    count = str(len(lacks))
    suite = ET.SubElement(root, "testsuite", name="certificate", tests=count, failures=count, errors="0", skipped="0")
    for reason in lacks:
        case = ET.SubElement(suite, "testcase", classname="certificate", name=reason, time="0")
        ET.SubElement(case, "failure", message=reason, type="certificate")


def told(mark: Mark) -> str:
    """What the monitor found, as text with the limit that decides."""
    measure, unit = mark.finding.measure, MONITORS[mark.clause.monitor].unit
    if not measure.valid:
        return measure.lack
    limit = mark.clause.major if mark.grade is Grade.MAJOR else mark.clause.minor
    side = "at most" if mark.clause.major > mark.clause.minor else "at least"
    when = "" if mark.finding.step is None else f" at {mark.finding.step * STEP_S:.1f} s"
    meaning = MONITORS[mark.clause.monitor].meaning + (f" ({mark.finding.about})" if mark.finding.about else "")
    return f"{meaning}: {'at least ' * measure.at_least}{measure.value:.2f} {unit}{when}, allowed {side} {limit:g}"


def violations_of(sittings: Sequence[Sitting]) -> list[tuple[Sitting, Mark, str]]:
    """Each violation with a line that says where it was and what was found; grave ones first."""
    return [
        (sitting, mark, f"{sitting.episode}: {mark.grade}, {mark.clause.title}: {told(mark)}")
        for grade in (Grade.MAJOR, Grade.MINOR)
        for sitting in sittings
        for mark in sitting.marks
        if mark.grade is grade
    ]


def shown_again(sitting: Sitting, mark: Mark) -> str:
    """The command that opens the moment which decided a mark."""
    return f"siren view {quoted(Path(sitting.bag))} --time-s {_begin_s(mark):g} --actor {sitting.actor_id}"


def _begin_s(mark: Mark) -> float:
    return max((mark.finding.step or 0) * STEP_S - _BEFORE_S, 0.0)


def page_of(certificate: Certificate, command: str, pages: EpisodePages | None = None) -> Page:
    """The certificate as a page.

    Args:
        certificate: The exam.
        command: It makes the certificate again.
        pages: Where moments are shown; without it, and where an episode has no page, a moment has its command.
    """
    book, sittings = certificate.rulebook, certificate.sittings
    counts = Counter(sitting.grade for sitting in certificate.graded)
    verdict = "passes" if certificate.passed else "does not pass"
    parts = [f"{counts[grade]} {grade}" for grade in _SHOWN if counts[grade]]
    lacking = len(certificate.without_result)
    parts += [f"{lacking} without a result"] if lacking else []
    lead = f"{certificate.driver} {verdict}. Episodes by their worst clause: {', '.join(parts) or 'none'}."
    why = (Section("lacks", "Why there is no certificate", certificate.lacks),) if certificate.lacks else ()
    duties = Table(
        "duties",
        "The rulebook",
        ("clause", "duty", "measured", "minor beyond", "major beyond", "source"),
        tuple(
            (
                one.title,
                one.text,
                f"{MONITORS[one.monitor].meaning}, {MONITORS[one.monitor].unit}",
                f"{one.minor:g}",
                f"{one.major:g}",
                one.source,
            )
            for one in book.clauses
        ),
        folded=True,
    )
    summary = Section(
        "summary",
        "Clauses",
        ("The interval of the share of violations is Wilson's, over the episodes to which the clause applies.",),
        tables=(*certificate.tables(), duties),
        commands=(command,),
    )
    lacks = tuple(f"{sitting.episode}: no result: {sitting.lack}" for sitting in certificate.without_result)
    without = (Section("no_result", "Episodes without a result", lacks),) if lacks else ()
    marks = Section("episodes", "Episodes", tables=tuple(map(_marks, certificate.graded)))
    sections = (*why, summary, *without, _violations(sittings, pages), *([marks] if marks.tables else ()))
    return Page(f"Exam: {book.title}", lead, sections)


def _violations(sittings: Sequence[Sitting], pages: EpisodePages | None) -> Section:
    links = [
        Link(
            line,
            "" if pages is None else pages.address(Path(sitting.bag), _begin_s(mark), sitting.actor_id),
            shown_again(sitting, mark),
        )
        for sitting, mark, line in violations_of(sittings)
    ]
    return Section("violations", "Violations", () if links else ("There is none.",), links=tuple(links))


def _marks(sitting: Sitting) -> Table:
    rows = tuple((mark.clause.title, str(mark.grade), told(mark)) for mark in sitting.marks)
    title = f"{sitting.episode}: {sitting.grade}"
    return Table(sitting.episode, title, ("clause", "grade", "found"), rows, folded=True)


Content = Mapping[str, Any]


def read_certificate(file: Path) -> Content:
    """The content of a ``certificate.json``.

    Raises:
        InputError: It cannot be read, or is none.
    """
    try:
        content: Content = plain_files.load_json(file.read_bytes())
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
    if any(first.get(key) != second.get(key) for key in ("rulebook_sha256", "included_sha256")):
        raise InputError("certificate", second["rulebook"], f"one of the same rulebook, {first['rulebook']}")
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
