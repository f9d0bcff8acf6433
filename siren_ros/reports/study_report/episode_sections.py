"""Sections on the episodes: what was generated, and a picture and a short film for each template."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.base.tables.interval import Bounds, share_interval
from siren_ros.base.tables.table import Row, Table, counted
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import SirenError
from siren_ros.reports.study_report.charts import draw_outcomes
from siren_ros.reports.study_report.episode_pages import EpisodePages
from siren_ros.reports.study_report.page import (
    Clip,
    Link,
    Picture,
    Section,
    drawn_uri,
    figure_uri,
    film_uri,
    generate_command,
    picture_uri,
    quoted,
)
from siren_ros.reports.study_report.study import StudyMeasures, StudyRows
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import TOWN
from siren_ros.scoring.judging.people import NAMES
from siren_ros.scoring.pictures.birdseye import draw_episode, interaction_steps
from siren_ros.scoring.pictures.moving_birdseye import BirdseyeFilm
from siren_ros.scoring.pictures.palette import EMV_EVENTS
from siren_ros.scoring.pictures.video import FRAME_RATE_HZ, FRAME_STEPS, Coding
from siren_ros.simulation.scenario.templates import load_template, own_level
from siren_ros.simulation.world.traffic_state import EventKind

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
