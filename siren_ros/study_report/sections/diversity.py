"""Section: how different the episodes are, and what more seeds would still add."""

from collections.abc import Iterator, Sequence

import numpy as np

from siren_ros.evaluation.diversity.drawn_ranges import drawn_ranges
from siren_ros.evaluation.diversity.summary import GroupDiversity, diversity
from siren_ros.evaluation.prediction.charts.chart import colour_of_model
from siren_ros.study_report.cells import NONE, number
from siren_ros.study_report.charts.coverage_curves import draw_coverage
from siren_ros.study_report.commands import command
from siren_ros.study_report.content import Figure, Section, Table
from siren_ros.study_report.inlined import figure_uri
from siren_ros.study_report.measures import StudyMeasures
from siren_ros.study_report.sections.generated import own_level
from siren_ros.study_report.study_rows import StudyRows


def diversity_section(study: StudyRows, measures: StudyMeasures) -> Section:
    """Coverage and novelty, group by group."""
    profiles = [one.profile for one in measures.bags]
    found = diversity(profiles, drawn_ranges(profiles))
    drawn = [one for one in found if own_level(one.group[0]) in {one.group[1], ""}] or list(found)
    names = sorted({one.group[0] for one in drawn})
    colours = [colour_of_model(names, one.group[0]) for one in drawn]
    caption = "What more seeds add, at each template's own level: averages over all choices of n among the episodes"
    text = (
        "Parameters: the share of the tenths of their ranges that an episode has tried. Ways: mean distance in metres "
        "between the EMVs of two episodes at the same times. Events: edits that turn one episode's order of events "
        "into the other's, as a share. Transitions: which event came directly after which; the next episode is "
        "expected to add as many new ones as a single episode has alone, divided by the number of episodes "
        "(Good-Turing)."
    )
    return Section(
        "diversity",
        "Diversity: what more seeds still add",
        (text,),
        (Figure("coverage", caption, figure_uri(draw_coverage(drawn, colours))),),
        tables=tuple(_tables(found)),
        commands=(command("evaluate diversity", study.folder, "--out diversity.json"),),
    )


def _tables(found: Sequence[GroupDiversity]) -> Iterator[Table]:
    head = (
        "template",
        "level",
        "map",
        "episodes",
        "ranges tried",
        "ways apart, m",
        "nearest, m",
        "events apart",
        "nearest",
        "transitions",
        "next adds",
        "coverage",
    )
    yield Table("diversity", "Diversity by template, level and map", head, tuple(map(_row, found)))
    rows = tuple(
        (*profile.group, str(profile.seed), profile.draw, number(_known(way), 1), number(_known(event)))
        for one in found
        for profile, way, event in zip(one.profiles, one.ways.nearest, one.events.nearest, strict=True)
    )
    caption = "Novelty of each episode: distance to the nearest other one"
    columns = ("template", "level", "map", "seed", "draw", "nearest way, m", "nearest order of events")
    yield Table("novelty", caption, columns, rows, folded=True)


def _row(one: GroupDiversity) -> tuple[str, ...]:
    several = len(one.profiles) > 1
    share = one.parameter_share
    return (
        *one.group,
        str(len(one.profiles)),
        NONE if share is None else f"{share:.0%}",
        number(one.ways.mean if several else None, 1),
        number(float(np.mean(one.ways.nearest)) if several else None, 1),
        number(one.events.mean if several else None),
        number(float(np.mean(one.events.nearest)) if several else None),
        str(one.transitions.seen),
        number(one.transitions.next_adds if several else None, 1),
        f"{one.transitions.coverage:.0%}" if several else NONE,
    )


def _known(value: np.float64) -> float | None:
    return None if np.isnan(value) else float(value)
