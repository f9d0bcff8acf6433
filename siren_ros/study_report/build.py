"""Builds the page of a study from its folder."""

from collections.abc import Callable
from pathlib import Path

from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.recording.bag_reader import bags_among
from siren_ros.study_report.episode_sections import generated_section, scenes_section
from siren_ros.study_report.page import Page, Section
from siren_ros.study_report.study import PageOptions, StudyMeasures, StudyRows, measure_study, read_rows
from siren_ros.study_report.task_sections import detection_section, paper_section, prediction_section, risk_section
from siren_ros.study_report.traffic_sections import diversity_section, effects_section, making_way_section
from siren_ros.tables.table import UNBOUNDED_NOTE, counted


def build_page(
    folder: Path,
    options: PageOptions,
    plan: Callable[[int], None] = lambda _: None,
    done: Callable[[], None] = lambda: None,
) -> Page:
    """The page of a study.

    Args:
        folder: What ``siren generate`` made.
        options: What goes into it.
        plan: Told the number of bags before they are measured.
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


def assembled(study: StudyRows, measures: StudyMeasures, options: PageOptions) -> Page:
    """The page from what was read and measured."""
    sections: list[Section | None] = [
        generated_section(study, measures),
        scenes_section(study, options.jobs, options.film_s),
        making_way_section(study, measures),
        effects_section(study, measures),
        prediction_section(study, score_table(measures.prediction)),
        detection_section(study, options.detection_in(study.folder)),
        risk_section(options.risk_in(study.folder)),
        paper_section(study, measures, options),
        diversity_section(study, measures),
    ]
    templates = ", ".join(sorted({row.template for row in study.rows}))
    levels = ", ".join(sorted({row.level for row in study.rows}))
    maps = ", ".join(sorted({row.map_name for row in study.rows}))
    episodes = counted(len(study.rows), "episode")
    lead = (
        f"{episodes} of {templates} at {levels} on {maps}. This page is one file and needs no network. "
        f"{UNBOUNDED_NOTE}."
    )
    title = f"SIREN study {study.folder.resolve().name}"
    return Page(title, lead, [section for section in sections if section is not None])
