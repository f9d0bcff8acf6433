"""Sections of the page about the traffic: how it made way, the effects of siren and level, and diversity."""

from typing import Final

from siren_ros.evaluation.diversity.coverage import drawn_ranges
from siren_ros.evaluation.diversity.summary import diversity, diversity_tables
from siren_ros.evaluation.prediction.charts import colour_of_model
from siren_ros.evaluation.yielding.counterfactual import effect_tables, effects
from siren_ros.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.evaluation.yielding.scoring import yield_tables
from siren_ros.study_report.charts import draw_coverage, draw_drivers, draw_forest, draw_metric
from siren_ros.study_report.episode_sections import own_level
from siren_ros.study_report.page import Picture, Section, command, figure_uri
from siren_ros.study_report.study import StudyMeasures, StudyRows

DRAWN: Final = ("emv_delay_s", "corridor_continuity", "compliance", "wake_duration_s", "civilian_delay_s", "min_ttc_s")
"""Episode metrics that have a chart."""
_DRIVERS: Final = (
    ("response_time_s", "first shift or slowing of drivers in the way"),
    ("clearance_time_s", "the way clear of them"),
)


def making_way_section(study: StudyRows, measures: StudyMeasures) -> Section:
    """What traffic did for the EMV."""
    episodes = measures.yielding
    figures = [
        Picture(f"metric_{metric.name}", f"{metric.name}: {metric.meaning}", figure_uri(draw_metric(episodes, metric)))
        for metric in EPISODE_METRICS
        if metric.name in DRAWN and any(episode.scores.metrics[metric.name].valid for episode in episodes)
    ]
    if any(driver.in_the_way for episode in episodes for driver in episode.scores.drivers):
        caption = "How soon drivers in the EMV's way respond, and how soon the way is clear of them"
        figures.append(Picture("drivers", caption, figure_uri(draw_drivers(episodes, _DRIVERS))))
    text = (
        "Each number comes from the record by a rule of its own. An episode that ended too early gives a lower bound. "
        "Points are episodes, bars are medians, curves are shares of all drivers in the EMV's way. Means are over "
        "episodes, with 95 % intervals over episodes."
    )
    return Section(
        "making_way",
        "How traffic made way",
        (text,),
        tuple(figures),
        tables=yield_tables(episodes),
        commands=(command("evaluate yield", study.folder, "--out yield.parquet --drivers drivers.parquet"),),
    )


_DRAWN_EFFECTS: Final = ("emv_delay_s", "civilian_delay_s")


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
        Picture(f"effect_{outcome}", f"Effects on {outcome}", figure_uri(draw_forest(of_outcome, outcome)))
        for outcome in _DRAWN_EFFECTS
        if (of_outcome := [one for one in found if one.outcome == outcome])
    ]
    return Section(
        "effects",
        "What siren and level are worth",
        (text,),
        tuple(figures),
        tables=effect_tables(found),
        commands=(command("evaluate counterfactual", study.folder, "--out effects.json"),),
    )


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
        (Picture("coverage", caption, figure_uri(draw_coverage(drawn, colours))),),
        tables=diversity_tables(found),
        commands=(command("evaluate diversity", study.folder, "--out diversity.json"),),
    )
