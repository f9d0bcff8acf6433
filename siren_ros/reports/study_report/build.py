"""Builds the page of a study from its folder: sections on episodes, traffic and tasks, and all of them together."""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.base.tables import UNBOUNDED_NOTE, Bounds, Row, Table, counted, share_interval
from siren_ros.data.recording.bag_reader import bags_among, read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import SirenError
from siren_ros.reports.study_report.charts import draw_coverage, draw_drivers, draw_forest, draw_metric, draw_outcomes
from siren_ros.reports.study_report.page import (
    Clip,
    EpisodePages,
    Link,
    Page,
    Picture,
    Section,
    command,
    drawn_uri,
    figure_uri,
    film_uri,
    generate_command,
    picture_uri,
    quoted,
)
from siren_ros.reports.study_report.study import (
    PageOptions,
    StudyMeasures,
    StudyRows,
    measure_study,
    moments_section,
    read_rows,
    stored_tables,
)
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import TOWN
from siren_ros.scoring.evaluation.detection.tables import tables_of as detection_tables_of
from siren_ros.scoring.evaluation.diversity import diversity, diversity_tables, drawn_ranges
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
from siren_ros.scoring.evaluation.risk.report import tables_of as risk_tables_of
from siren_ros.scoring.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.scoring.evaluation.yielding.scoring import effect_tables, effects, yield_tables
from siren_ros.scoring.judging.outcome import NAMES
from siren_ros.scoring.pictures.birdseye import draw_episode, interaction_steps
from siren_ros.scoring.pictures.moving_birdseye import BirdseyeFilm
from siren_ros.scoring.pictures.plot_parts import EMV_EVENTS
from siren_ros.scoring.pictures.video import FRAME_RATE_HZ, FRAME_STEPS, Coding
from siren_ros.simulation.scenario.templates import load_template, own_level
from siren_ros.simulation.world.actors import EventKind

_NAMED_MAX: Final = 50
"""Largest number of missing episodes that the page names."""
_PEOPLE_CAPTION: Final = (
    "People within 150 m of an EMV, over the episode and at once (median), and how many of them meet an EMV or a "
    "driver who makes way: means over the episodes; the last column has the episodes in which somebody is met"
)
_PEOPLE_HEAD: Final = (
    *("template", "level", "people", "within 150 m", "at once"),
    *("meet an EMV", "meet a driver who makes way", "episodes"),
)
_VERDICT: Final = re.compile(r"emv(\d+)\.predicate_holds")


def generated_section(study: StudyRows, measures: StudyMeasures) -> Section:
    """Section: what ``siren generate`` made."""
    rows = study.rows
    complete = [row for row in rows if row.status is Status.COMPLETE]
    summary = (
        f"{counted(len(rows), 'episode')} in the study, {len(complete):,} of them complete: "
        f"{sum(row.simulated_s for row in complete) / 60.0:,.0f} simulated minutes, "
        f"{sum(row.bag_bytes for row in rows) / 1e6:,.0f} MB. "
        f"The numbers below come from the {counted(len(measures.bags), 'bag')} that could be read."
    )
    judged = (
        "A predicate decides from the record alone whether the template's interaction happened. It should hold at the "
        "template's own level, and fail where its cause is missing."
    )
    caption = "Episodes whose predicate holds, by template and level"
    return Section(
        "generated",
        "What was generated",
        text=(summary, judged),
        figures=(Picture("outcomes", caption, figure_uri(draw_outcomes(rows))),),
        tables=tuple(_tables(study, measures)),
        commands=(generate_command(study.asked, study.folder),) if study.asked else (),
    )


def _tables(study: StudyRows, measures: StudyMeasures) -> Iterator[Table]:
    groups: dict[tuple[str, str, str], list[EpisodeRow]] = {}
    for row in study.rows:
        groups.setdefault((row.template, row.level, row.map_name), []).append(row)
    yield Table(
        "groups",
        "Episodes by template, level and map",
        (
            "template",
            "level",
            "map",
            "seeds",
            "complete",
            "predicate holds",
            "simulated s",
            "CPU s per simulated s",
            "retried",
        ),
        tuple(_group_row(*group, rows) for group, rows in sorted(groups.items())),
        specs={"predicate holds": ".0%", "simulated s": ".0f", "CPU s per simulated s": ".3f"},
        folded=len(groups) > 12,
    )
    if further := tuple(_further_emvs(study.rows)):
        head = ("template", "level", "EMV", "interaction, or junction crossed", "mean speed m/s")
        yield Table("further_emvs", "EMVs besides the first", head, further)
    if people := tuple(_people(study.rows)):
        yield Table("people", _PEOPLE_CAPTION, _PEOPLE_HEAD, people, spec=".1f")
    yield _asked(study)
    missing = [row for row in study.rows if row.status is not Status.COMPLETE]
    if missing:
        named = tuple((row.episode, str(row.status), row.reason, row.attempts) for row in missing[:_NAMED_MAX])
        caption = f"Episodes that are missing: {len(missing)}"
        yield Table("missing", caption, ("episode", "status", "reason", "attempts"), named)
    if measures.unread:
        bags = tuple((bag.name, reason) for bag, reason in measures.unread[:_NAMED_MAX])
        yield Table("unread", f"Bags that could not be read: {len(measures.unread)}", ("bag", "reason"), bags)


def _group_row(template: str, level: str, map_name: str, rows: Sequence[EpisodeRow]) -> Row:
    complete = [row for row in rows if row.status is Status.COMPLETE]
    judged = [row for row in complete if row.predicate_holds is not None]
    holds = sum(bool(row.predicate_holds) for row in judged)
    cpu = [row.cpu_s / row.simulated_s for row in complete if row.simulated_s]
    return (
        template,
        f"{level} (own)" if own_level(template) == level else level,
        map_name,
        len({row.seed for row in rows}),
        f"{len(complete)} of {len(rows)}",
        (f"{holds} of {len(judged)}", Bounds(share_interval(holds, len(judged)))) if judged else None,
        sum(row.simulated_s for row in complete),
        float(np.mean(cpu)) if cpu else None,
        sum(row.attempts - 1 for row in rows),
    )


def _further_emvs(rows: Iterable[EpisodeRow]) -> Iterator[Row]:
    """Rows for further EMVs by template and level: share of episodes in which its verdict holds, and its mean speed."""
    found: dict[tuple[str, str, int], list[tuple[bool, float]]] = {}
    for row in rows:
        measures = json.loads(row.measures)
        for name in measures:
            if match := _VERDICT.fullmatch(name):
                emv = int(match[1])
                speed_mps = float(measures.get(f"emv{emv}.mean_speed_mps", "nan"))
                found.setdefault((row.template, row.level, emv), []).append((bool(measures[name]), speed_mps))
    for group, emvs in sorted(found.items()):
        holds, speeds_mps = zip(*emvs, strict=True)
        yield *group, f"{sum(holds)} of {len(holds)}", float(np.mean(speeds_mps))


def _people(rows: Iterable[EpisodeRow]) -> Iterator[Row]:
    """Rows for people by template, level and class: means over the episodes, and share of episodes with a meeting."""
    groups: dict[tuple[str, str], list[dict[str, int]]] = {}
    for row in rows:
        if row.people:
            groups.setdefault((row.template, row.level), []).append(row.people)
    for group, episodes in sorted(groups.items()):
        for kind in NAMES.values():
            columns = ("near", "near_median", "with_emv", "with_yielding")
            means = (float(np.mean([people[f"{kind}.{name}"] for people in episodes])) for name in columns)
            met = sum(people[f"{kind}.met"] > 0 for people in episodes)
            yield *group, kind, *means, f"{met} of {len(episodes)}"
        met = sum(people["met"] > 0 for people in episodes)
        yield *group, "all", None, None, None, None, f"{met} of {len(episodes)}"


def _asked(study: StudyRows) -> Table:
    """Table of the study's options."""
    texts = {"map": {"": TOWN}, "draw": {"-1": "none"}}
    rows = []
    for name in ("map", "preset", "sensors", "look", "draw"):
        counts = sorted(Counter(str(getattr(row, name)) for row in study.rows).items())
        rows.append((name, ", ".join(f"{texts.get(name, {}).get(value, value)} ({count})" for value, count in counts)))
    versions = {(name, version) for row in study.rows for name, version in row.versions.items()}
    rows.append(("versions", ", ".join(f"{name} {version}" for name, version in sorted(versions))))
    rows.append(("SHA-256 of manifest.parquet", study.manifest_sha256))
    return Table("asked", "What the episodes were made from, with the number of episodes", ("", ""), tuple(rows))


_PICTURE_PX: Final = 1200
_CODING: Final = Coding(width_px=640, crf=24)
_POSTER_PX: Final = (640, 360)
_FILMED: Final = EMV_EVENTS | {EventKind.YIELD_STARTED, EventKind.YIELD_COMPLETED, EventKind.YIELD_HELD}
"""The film shows the time around the middle one of these events."""


def scenes_section(study: StudyRows, jobs: int, film_s: float, pages: EpisodePages) -> Section:
    """Section: one episode per template, at its own level and with a predicate that holds if possible."""
    chosen = chosen_episodes(study.rows)
    figures, clips, commands, links = [], [], [], []
    with ProcessPool(min(jobs, len(chosen))) as pool:
        shown = pool.map(show_episode, [(study.folder / row.bag, film_s) for row in chosen])
    for row, drawn in zip(chosen, shown, strict=True):
        if drawn is None:
            continue
        picture, film, poster, from_s = drawn
        bag = quoted(study.folder / row.bag)
        title = f"{row.template} {row.level}, seed {row.seed}: {_title(row.template)}"
        if address := pages.address(study.folder / row.bag, from_s):
            links.append(Link(f"{row.template} {row.level}, seed {row.seed}, to look into", address))
        clips.append(Clip(f"film_{row.template}", f"{title}. From {from_s:.1f} s on.", film, poster))
        caption = f"{title}. {row.predicate[:1].upper()}{row.predicate[1:]}."
        figures.append(Picture(f"picture_{row.template}", caption, picture))
        commands.append(f"./env siren plot {bag} --out {row.template}.png")
        frames = f"--start-s {from_s:g} --frames {round(film_s * FRAME_RATE_HZ)}"
        coding = f"--width {_CODING.width_px} --crf {_CODING.crf}"
        commands.append(f"./env siren video {bag} {frames} {coding} --out {row.template}.mp4")
    text = (
        "Red: the emergency vehicle; other colours say what a driver who makes way is doing. In the pictures, lines "
        "are paths coloured by speed, numbers mark the EMV at the three moments below the map, and the bars say who "
        "did what when."
    )
    return Section(
        "scenes", "The templates", (text,), tuple(figures), tuple(clips), links=tuple(links), commands=tuple(commands)
    )


def chosen_episodes(rows: Sequence[EpisodeRow]) -> tuple[EpisodeRow, ...]:
    """Choose one complete episode per template."""
    usable = [row for row in rows if row.status is Status.COMPLETE and row.bag]

    def preference(row: EpisodeRow) -> tuple[bool, bool, int]:
        return row.level == own_level(row.template), bool(row.predicate_holds), -row.seed

    templates = sorted({row.template for row in usable})
    return tuple(max((row for row in usable if row.template == name), key=preference) for name in templates)


def show_episode(bag: Path, film_s: float) -> tuple[str, str, str, float] | None:
    """Picture, film and poster as data URIs, and the film's first second; None if the bag cannot be drawn."""
    try:
        record = read_episode(bag)
        steps = film_steps(record, film_s)
        film = BirdseyeFilm(record, steps)
        poster = picture_uri(film.frame(steps[len(steps) // 2]).resize(_POSTER_PX))
        picture = drawn_uri(draw_episode(record), _PICTURE_PX)
        return picture, film_uri(film.frames(), _CODING), poster, steps[0] * STEP_S
    except SirenError:
        return None


def film_steps(record: EpisodeRecord, film_s: float) -> range:
    """Frames of the film around the median event, or around the middle of the interaction without events."""
    emvs = frozenset(record.emv_ids)
    steps = [
        event.step
        for event in record.events
        if event.kind in _FILMED and (event.kind not in EMV_EVENTS or event.actor_id in emvs)
    ]
    middle = float(np.median(steps)) if steps else float(np.mean(interaction_steps(record)))
    length = round(film_s / STEP_S)
    last = max(record.steps - length, 0)
    first = int(np.clip(round(middle - 0.5 * length), 0, last)) // FRAME_STEPS * FRAME_STEPS
    return range(first, min(first + length, record.steps), FRAME_STEPS)


def _title(template: str) -> str:
    try:
        return load_template(template).title
    except SirenError:
        return "a template that is not among the project's"


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
    known = [effect for effect in effects(measures.yielding) if effect.interval.valid]
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
        if (of_outcome := [effect for effect in known if effect.metric == outcome])
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
