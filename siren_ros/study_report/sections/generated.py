"""Section: what was generated, and what became of it."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from siren_ros.errors import SirenError
from siren_ros.scenario.templates import load_template
from siren_ros.studies.episode_row import EpisodeRow, Status
from siren_ros.studies.matrix import TOWN
from siren_ros.study_report.cells import NONE, count_of, share_of
from siren_ros.study_report.charts.outcomes import draw_outcomes
from siren_ros.study_report.commands import generate_command
from siren_ros.study_report.content import Figure, Section, Table
from siren_ros.study_report.inlined import figure_uri
from siren_ros.study_report.measures import StudyMeasures
from siren_ros.study_report.study_rows import StudyRows

_NAMED_MAX: Final = 50
"""Episodes that are named because they are missing."""


def generated_section(study: StudyRows, measures: StudyMeasures) -> Section:
    """What ``siren generate`` made."""
    rows = study.rows
    complete = [row for row in rows if row.status is Status.COMPLETE]
    simulated_s = sum(row.simulated_s for row in complete)
    made = (
        f"{count_of(len(rows), 'episode')} in the study, {len(complete):,} of them complete: "
        f"{simulated_s / 60.0:,.0f} simulated minutes, {sum(row.bag_bytes for row in rows) / 1e6:,.0f} MB. "
        f"The numbers below come from the {count_of(len(measures.bags), 'bag')} that could be read."
    )
    judged = (
        "A predicate decides from the record alone whether the template's interaction happened. It should hold at the "
        "template's own level, and fail where its cause is missing."
    )
    caption = "Episodes whose predicate holds, by template and level"
    figures = (Figure("outcomes", caption, figure_uri(draw_outcomes(rows))),)
    return Section(
        "generated",
        "What was generated",
        text=(made, judged),
        figures=figures,
        tables=tuple(_tables(study, measures)),
        commands=(generate_command(study.asked, study.folder),) if study.asked else (),
    )


def _tables(study: StudyRows, measures: StudyMeasures) -> Iterator[Table]:
    groups: dict[tuple[str, str, str], list[EpisodeRow]] = {}
    for row in study.rows:
        groups.setdefault((row.template, row.level, row.map_name), []).append(row)
    head = (
        "template",
        "level",
        "map",
        "seeds",
        "complete",
        "predicate holds",
        "simulated s",
        "CPU s per simulated s",
        "retried",
    )
    found = [(*_named(group), *_counts(members)) for group, members in sorted(groups.items())]
    yield Table("groups", "Episodes by template, level and map", head, tuple(found), folded=len(found) > 12)
    yield _asked(study)
    missing = [row for row in study.rows if row.status is not Status.COMPLETE]
    if missing:
        cells = tuple((row.episode, str(row.status), row.reason, str(row.attempts)) for row in missing[:_NAMED_MAX])
        caption = f"Episodes that are missing: {len(missing)}"
        yield Table("missing", caption, ("episode", "status", "reason", "attempts"), cells)
    if measures.unread:
        named = tuple((one.bag.name, one.reason) for one in measures.unread[:_NAMED_MAX])
        yield Table("unread", f"Bags that could not be read: {len(measures.unread)}", ("bag", "reason"), named)


def _named(group: tuple[str, str, str]) -> tuple[str, str, str]:
    template, level, map_name = group
    own = own_level(template) == level
    return template, f"{level} (own)" if own else level, map_name


def own_level(template: str) -> str:
    """The level in a template's file; empty where the template is not ours."""
    try:
        return load_template(template).level.name
    except SirenError:
        return ""


def _counts(rows: Sequence[EpisodeRow]) -> tuple[str, ...]:
    complete = [row for row in rows if row.status is Status.COMPLETE]
    judged = [row for row in complete if row.predicate_holds is not None]
    cpu = [row.cpu_s / row.simulated_s for row in complete if row.simulated_s]
    return (
        str(len({row.seed for row in rows})),
        f"{len(complete)} of {len(rows)}",
        share_of(sum(bool(row.predicate_holds) for row in judged), len(judged)),
        f"{sum(row.simulated_s for row in complete):.0f}",
        f"{np.mean(cpu):.3f}" if cpu else NONE,
        str(sum(row.attempts - 1 for row in rows)),
    )


def _asked(study: StudyRows) -> Table:
    """What the episodes share or differ in."""
    names = ("map", "preset", "sensors", "look", "draw")
    rows = []
    for name in names:
        counts = Counter(str(getattr(row, name)) for row in study.rows)
        told = ", ".join(f"{_said(name, value)} ({count})" for value, count in sorted(counts.items()))
        rows.append((name, told))
    versions = {(name, version) for row in study.rows for name, version in row.versions.items()}
    rows.append(("versions", ", ".join(f"{name} {version}" for name, version in sorted(versions))))
    rows.append(("SHA-256 of manifest.parquet", study.manifest_sha256))
    return Table("asked", "What the episodes were made from, with the number of episodes", ("", ""), tuple(rows))


def _said(name: str, value: str) -> str:
    if name == "map":
        return value or TOWN
    return "none" if name == "draw" and value == "-1" else value
