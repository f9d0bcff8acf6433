"""Sections of the page about the tasks: prediction, detection, risk, and all of them next to the paper."""

from pathlib import Path

from siren_ros.evaluation.detection.tables import tables_of as detection_tables_of
from siren_ros.evaluation.paper_comparison import (
    comparison_tables,
    detection_rows,
    measured,
    own_level_only,
    prediction_rows,
    risk_rows,
    stored,
)
from siren_ros.evaluation.prediction.charts import draw_horizon
from siren_ros.evaluation.prediction.reports.paper_results import PAPER_NAMES, maps_next_to_the_papers
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable, differences, score_table
from siren_ros.evaluation.prediction.reports.tables import POPULATION_TEXT, prediction_tables
from siren_ros.evaluation.risk.tables import tables_of as risk_tables_of
from siren_ros.study_report.episode_sections import own_level
from siren_ros.study_report.page import Picture, Section, command, figure_uri, quoted
from siren_ros.study_report.study import PageOptions, StudyMeasures, StudyRows, stored_tables


def prediction_section(study: StudyRows, scores: ScoreTable) -> Section:
    """How well models predict where vehicles go."""
    text = (
        "Three seconds of history, five of future every 0.2 s, a sample for each vehicle and each frame at 10 Hz; "
        f"{POPULATION_TEXT[scores.episodes[0].population]}. A mean over templates counts each of them once; intervals "
        "are 95 % over whole episodes."
    )
    figures = (Picture("horizon", "Error over the horizon", figure_uri(draw_horizon(scores))),)
    models = ",".join(scores.models)
    return Section(
        "prediction",
        "Task: trajectory prediction",
        (text,),
        figures,
        tables=prediction_tables(scores, differences(scores)),
        commands=(command("evaluate prediction", study.folder, f"--models {models} --out prediction"),),
    )


def detection_section(study: StudyRows, folder: Path) -> Section | None:
    """The detectors' scores; None where there are none."""
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
    """The models' scores; None where there are none."""
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
    """The paper's numbers that were measured here; None without an episode at its template's own level."""
    counted = own_level_only(measures.prediction, own_level)
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
