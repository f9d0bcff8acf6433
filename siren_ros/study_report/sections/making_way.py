"""Section: the yield metrics, as distributions and as means."""

from collections.abc import Iterator
from typing import Final

from siren_ros.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.evaluation.yielding.summary import group_means
from siren_ros.study_report.cells import with_interval
from siren_ros.study_report.charts.distributions import draw_drivers, draw_metric
from siren_ros.study_report.commands import command
from siren_ros.study_report.content import Figure, Section, Table
from siren_ros.study_report.inlined import figure_uri
from siren_ros.study_report.measures import StudyMeasures
from siren_ros.study_report.study_rows import StudyRows

DRAWN: Final = (
    "emv_delay_s",
    "corridor_continuity",
    "compliance",
    "wake_duration_s",
    "civilian_delay_s",
    "min_ttc_s",
)
"""Episode metrics that have a chart."""
_DRIVERS: Final = (
    ("response_time_s", "first shift or slowing of drivers in the way"),
    ("clearance_time_s", "the way clear of them"),
)


def making_way_section(study: StudyRows, measures: StudyMeasures) -> Section:
    """What traffic did for the EMV."""
    episodes = measures.yielding
    figures = [
        Figure(f"metric_{metric.name}", f"{metric.name}: {metric.meaning}", figure_uri(draw_metric(episodes, metric)))
        for metric in EPISODE_METRICS
        if metric.name in DRAWN and any(episode.scores.metrics[metric.name].valid for episode in episodes)
    ]
    if any(driver.in_the_way for episode in episodes for driver in episode.scores.drivers):
        caption = "How soon drivers in the EMV's way respond, and how soon the way is clear of them"
        figures.append(Figure("drivers", caption, figure_uri(draw_drivers(episodes, _DRIVERS))))
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
        tables=tuple(_tables(measures)),
        commands=(command("evaluate yield", study.folder, "--out yield.parquet --drivers drivers.parquet"),),
    )


def _tables(measures: StudyMeasures) -> Iterator[Table]:
    means = group_means(measures.yielding)
    places = dict.fromkeys((template, map_name) for template, _, map_name in means)
    several_maps = len({map_name for _, map_name in places}) > 1
    for template, map_name in places:
        levels = [level for name, level, place in means if (name, place) == (template, map_name)]
        of_levels = [means[template, level, map_name] for level in levels]
        rows = tuple(
            (metric.name, *(with_interval(found[metric.name]) for found in of_levels), metric.meaning)
            for metric in EPISODE_METRICS
        )
        where = f" on {map_name}" if several_maps else ""
        key = f"yield_{template}_{map_name}" if several_maps else f"yield_{template}"
        head = ("metric", *levels, "meaning")
        yield Table(key, f"Yield metrics of {template}{where}", head, rows, folded=True)
