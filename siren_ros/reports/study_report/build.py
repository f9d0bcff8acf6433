"""Builds the page of a study from its folder: the sections on traffic and tasks, and all of them together."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from siren_ros.base.tables.table import UNBOUNDED_NOTE, counted
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.reports.study_report.charts import draw_coverage, draw_drivers, draw_forest, draw_metric
from siren_ros.reports.study_report.episode_pages import EpisodePages
from siren_ros.reports.study_report.episode_sections import generated_section, scenes_section
from siren_ros.reports.study_report.moments import moments_section
from siren_ros.reports.study_report.page import Page, Picture, Section, command, figure_uri, quoted
from siren_ros.reports.study_report.study import (
    PageOptions,
    StudyMeasures,
    StudyRows,
    measure_study,
    read_rows,
    stored_tables,
)
from siren_ros.scoring.evaluation.detection.tables import tables_of as detection_tables_of
from siren_ros.scoring.evaluation.diversity.summary import diversity, diversity_tables, drawn_ranges
from siren_ros.scoring.evaluation.paper_comparison import (
    at_template_level,
    comparison_tables,
    detection_rows,
    measured,
    prediction_rows,
    risk_rows,
    stored,
)
from siren_ros.scoring.evaluation.prediction.charts import colour_of_model, draw_horizon
from siren_ros.scoring.evaluation.prediction.reports.paper_results import PAPER_NAMES, maps_next_to_the_papers
from siren_ros.scoring.evaluation.prediction.reports.report import POPULATION_TEXT, prediction_tables
from siren_ros.scoring.evaluation.prediction.reports.score_table import ScoreTable, differences, score_table
from siren_ros.scoring.evaluation.risk.tables import tables_of as risk_tables_of
from siren_ros.scoring.evaluation.yielding.counterfactual import effect_tables, effects
from siren_ros.scoring.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.scoring.evaluation.yielding.scoring import yield_tables
from siren_ros.simulation.scenario.templates import own_level

DRAWN: Final = ("emv_delay_s", "corridor_continuity", "compliance", "wake_duration_s", "civilian_delay_s", "min_ttc_s")
"""Metrics of episodes that get a chart."""
_DRIVERS: Final = {
    "response_time_s": "first shift or slowing of drivers in the way",
    "clearance_time_s": "the way clear of them",
}
_DRAWN_EFFECTS: Final = ("emv_delay_s", "civilian_delay_s")


def making_way_section(study: StudyRows, measures: StudyMeasures) -> Section:
    """Section: how traffic made way for the EMV."""
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


def effects_section(study: StudyRows, measures: StudyMeasures) -> Section | None:
    """Section: differences between levels; None if no seed was run at two of them."""
    known = [effect for effect in effects(measures.yielding) if effect.paired.difference.valid]
    if not known:
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
        if (of_outcome := [effect for effect in known if effect.outcome == outcome])
    ]
    return Section(
        "effects",
        "What siren and level are worth",
        (text,),
        tuple(figures),
        tables=effect_tables(known),
        commands=(command("evaluate counterfactual", study.folder, "--out effects.json"),),
    )


def diversity_section(study: StudyRows, measures: StudyMeasures) -> Section:
    """Section: coverage and novelty of each group."""
    profiles = [bag.profile for bag in measures.bags]
    groups = diversity(profiles, drawn_ranges(profiles))
    drawn = [diverse for diverse in groups if own_level(diverse.group[0]) in {diverse.group[1], ""}] or list(groups)
    names = sorted({diverse.group[0] for diverse in drawn})
    colours = [colour_of_model(names, diverse.group[0]) for diverse in drawn]
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
        tables=diversity_tables(groups),
        commands=(command("evaluate diversity", study.folder, "--out diversity.json"),),
    )


def prediction_section(study: StudyRows, scores: ScoreTable) -> Section:
    """Section: how well models predict vehicles."""
    picture = Picture("horizon", "Error over the horizon", figure_uri(draw_horizon(scores)))
    text = (
        "Three seconds of history, five of future every 0.2 s, a sample for each vehicle and each frame at 10 Hz; "
        f"{POPULATION_TEXT[scores.episodes[0].population]}. A mean over templates counts each of them once; intervals "
        "are 95 % over whole episodes."
    )
    models = ",".join(scores.models)
    return Section(
        "prediction",
        "Task: trajectory prediction",
        (text,),
        (picture,),
        tables=prediction_tables(scores, differences(scores)),
        commands=(command("evaluate prediction", study.folder, f"--models {models} --out prediction"),),
    )


def detection_section(study: StudyRows, folder: Path) -> Section | None:
    """Section: scores of detectors; None if there are none."""
    tables = stored_tables("detection", folder, detection_tables_of)
    if tables is None:
        return None
    text = (
        "nuScenes' own code and the paper's protocol: one class for all vehicles, labels within 50 m with at least one "
        "LiDAR point. Intervals are 95 % over episodes."
    )
    call = command("evaluate detection", study.folder, f"--detections NAME=FILE --out {quoted(folder)}")
    return Section("detection", "Task: 3-D detection", (text,), tables=tables, commands=(call,))


def risk_section(folder: Path) -> Section | None:
    """Section: scores of the risk task; None if there are none."""
    tables = stored_tables("risk", folder, risk_tables_of)
    if tables is None:
        return None
    text = (
        "Each video is normal, a near-miss or a collision. Values are percentages, intervals 95 % over "
        "videos. The rows majority and oracle answer the commonest class and the label itself."
    )
    call = f"./env siren evaluate risk SET --predictions NAME=FILE --out {quoted(folder)}"
    return Section("risk", "Task: risk understanding", (text,), tables=tables, commands=(call,))


def paper_section(study: StudyRows, measures: StudyMeasures, options: PageOptions) -> Section | None:
    """Section: comparison with the paper's numbers; None without an episode at its template's own level."""
    counted = at_template_level(measures.prediction, own_level)
    if not counted:
        return None
    detection, risk = options.detection_in(study.folder), options.risk_in(study.folder)
    rows = measured(
        [*prediction_rows(score_table(counted)), *detection_rows(stored(detection)), *risk_rows(None, stored(risk))]
    )
    text = (
        f"Of the {len(measures.bags)} episodes, {len(counted)} are at their template's own level and count here, as in "
        "the paper, which has one episode of each template. Samples are of the vehicles in the interaction region; "
        f"{maps_next_to_the_papers(counted)}. "
        "Intervals are 95 % over episodes; a star says that the paper's value lies in ours."
    )
    more = [
        f"--{name} {quoted(folder)}"
        for name, folder in (("detection", detection), ("risk", risk))
        if stored(folder) is not None
    ]
    models = ",".join(name for name in options.models if name in PAPER_NAMES)
    call = command("compare-paper", study.folder, f"--models {models}", *more)
    return Section("next_to_the_paper", "Next to the paper", (text,), tables=comparison_tables(rows), commands=(call,))


def build_page(
    folder: Path,
    options: PageOptions,
    plan: Callable[[int], None] = lambda _: None,
    done: Callable[[], None] = lambda: None,
) -> tuple[Page, EpisodePages]:
    """Page of a study, and the linked pages of episodes, which are not written yet.

    Args:
        folder: What ``siren generate`` made.
        options: What goes into it.
        plan: Called with the number of bags before they are measured.
        done: Called after each bag.

    Raises:
        InputError: No study in the folder, no bag that can be read, or scores of a task that cannot be used.
    """
    options.check()
    study = read_rows(folder)
    bags = bags_among([folder])
    plan(len(bags))
    measures = measure_study(bags, options.models, options.jobs, done)
    return assembled(study, measures, options)


def assembled(study: StudyRows, measures: StudyMeasures, options: PageOptions) -> tuple[Page, EpisodePages]:
    """Assemble the page and the pages of episodes from the measured data."""
    pages = EpisodePages(options.pages_folder, options.pages, {bag.bag for bag in measures.bags if bag.moments})
    moments = moments_section(((bag.bag, moment) for bag in measures.bags for moment in bag.moments), pages)
    sections: list[Section | None] = [
        generated_section(study, measures),
        scenes_section(study, options.jobs, options.film_s, pages),
        moments,
        making_way_section(study, measures),
        effects_section(study, measures),
        prediction_section(study, score_table(measures.prediction)),
        detection_section(study, options.detection_in(study.folder)),
        risk_section(options.risk_in(study.folder)),
        paper_section(study, measures, options),
        diversity_section(study, measures),
    ]
    templates, levels, maps = (
        ", ".join(sorted({getattr(row, name) for row in study.rows})) for name in ("template", "level", "map_name")
    )
    episodes = f"{counted(len(study.rows), 'episode')} of {templates} at {levels} on {maps}"
    lead = f"{episodes}. This page needs no network. {UNBOUNDED_NOTE}."
    title = f"SIREN study {study.folder.resolve().name}"
    return Page(title, lead, [section for section in sections if section is not None]), pages
