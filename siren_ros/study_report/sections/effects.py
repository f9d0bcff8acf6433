"""Section: what siren and level are worth, from the same seeds at several levels."""

from collections.abc import Iterator, Sequence
from typing import Final

from siren_ros.evaluation.yielding.counterfactual import OUTCOMES, Effect, effects
from siren_ros.study_report.cells import with_interval
from siren_ros.study_report.charts.forest import draw_forest
from siren_ros.study_report.commands import command
from siren_ros.study_report.content import Figure, Section, Table
from siren_ros.study_report.inlined import figure_uri
from siren_ros.study_report.measures import StudyMeasures
from siren_ros.study_report.study_rows import StudyRows

_DRAWN: Final = ("emv_delay_s", "civilian_delay_s")


def effects_section(study: StudyRows, measures: StudyMeasures) -> Section | None:
    """Differences between levels; None where no seed was run at two of them."""
    found = [one for one in effects(measures.yielding) if one.found.difference.valid]
    if not found:
        return None
    text = (
        "Map, demand, route, drivers and draws of one seed are the same at all levels, so a difference is the effect "
        "of the level. L1 − L0: the EMV's privileges; L2 − L1: siren and lane changes; L3 − L1: siren and corridor. "
        "Intervals are 95 % over pairs; p-values come from a permutation test, adjusted for all "
        "comparisons of an outcome (Holm)."
    )
    figures = [
        Figure(f"effect_{outcome}", f"Effects on {outcome}", figure_uri(draw_forest(of_outcome, outcome)))
        for outcome in _DRAWN
        if (of_outcome := [one for one in found if one.outcome == outcome])
    ]
    return Section(
        "effects",
        "What siren and level are worth",
        (text,),
        tuple(figures),
        tables=tuple(_tables(found)),
        commands=(command("evaluate counterfactual", study.folder, "--out effects.json"),),
    )


def _tables(found: Sequence[Effect]) -> Iterator[Table]:
    head = ("levels", "template", "difference", "p", "p (Holm)", "pairs", "cut off")
    for outcome in OUTCOMES:
        rows = tuple(
            (
                f"{one.first} − {one.second}",
                one.template,
                with_interval(one.found.difference, sign="+"),
                f"{one.found.p_value:.3f}",
                f"{one.adjusted_p:.3f}",
                str(one.found.difference.blocks),
                str(one.cut_off),
            )
            for one in found
            if one.outcome == outcome
        )
        if rows:
            yield Table(f"effects_{outcome}", f"Effects on {outcome}", head, rows, folded=True)
