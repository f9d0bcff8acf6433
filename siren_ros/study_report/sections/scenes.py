"""Section: a picture and a short film of each template."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.datasets.exporting.worker_pool import worker_pool
from siren_ros.errors import SirenError
from siren_ros.numerics.units import STEP_S
from siren_ros.pictures.birdseye import draw_episode, interaction_steps
from siren_ros.pictures.moving_birdseye import BirdseyeFilm
from siren_ros.pictures.palette import EMV_EVENTS
from siren_ros.pictures.video import FRAME_RATE_HZ, FRAME_STEPS, Coding
from siren_ros.recording.bag_reader import read_episode
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.templates import load_template
from siren_ros.studies.episode_row import EpisodeRow, Status
from siren_ros.study_report.commands import quoted
from siren_ros.study_report.content import Clip, Figure, Section
from siren_ros.study_report.inlined import drawn_uri, film_uri, picture_uri
from siren_ros.study_report.sections.generated import own_level
from siren_ros.study_report.study_rows import StudyRows
from siren_ros.world.events import EventKind

_PICTURE_PX: Final = 1200
_CODING: Final = Coding(width_px=640, crf=24)
_POSTER_PX: Final = (640, 360)
_TOLD: Final = EMV_EVENTS | {EventKind.YIELD_STARTED, EventKind.YIELD_COMPLETED, EventKind.YIELD_HELD}
"""Events around which the film is."""


@dataclass(frozen=True)
class Shown:
    """What is shown of one episode."""

    picture: str
    film: str
    poster: str
    from_s: float


def scenes_section(study: StudyRows, jobs: int, film_s: float) -> Section:
    """An episode of each template: at its own level if there is one, with a predicate that holds if there is one."""
    chosen = chosen_episodes(study.rows)
    figures, clips, commands = [], [], []
    with worker_pool(min(jobs, len(chosen)), lambda _: None) as pool:
        found = dict(pool(show_episode, [(study.folder / row.bag, film_s) for row in chosen]))
    for number, row in enumerate(chosen):
        shown = found[number]
        if shown is None:
            continue
        bag = quoted(study.folder / row.bag)
        title = f"{row.template} {row.level}, seed {row.seed}: {_title(row.template)}"
        clips.append(Clip(f"film_{row.template}", f"{title}. From {shown.from_s:.1f} s on.", shown.film, shown.poster))
        figures.append(
            Figure(
                f"picture_{row.template}", f"{title}. {row.predicate[:1].upper()}{row.predicate[1:]}.", shown.picture
            )
        )
        commands.append(f"./env siren plot {bag} --out {row.template}.png")
        frames = f"--start-s {shown.from_s:g} --frames {round(film_s * FRAME_RATE_HZ)}"
        coding = f"--width {_CODING.width_px} --crf {_CODING.crf}"
        commands.append(f"./env siren video {bag} {frames} {coding} --out {row.template}.mp4")
    text = (
        "Red: the emergency vehicle; other colours say what a driver who makes way is doing. In the pictures, lines "
        "are paths coloured by speed, numbers mark the EMV at the three moments below the map, and the bars say who "
        "did what when."
    )
    return Section("scenes", "The templates", (text,), tuple(figures), tuple(clips), commands=tuple(commands))


def chosen_episodes(rows: Sequence[EpisodeRow]) -> tuple[EpisodeRow, ...]:
    """One complete episode of each template, by template."""
    found: dict[str, EpisodeRow] = {}
    for row in rows:
        if row.status is Status.COMPLETE and row.bag:
            before = found.get(row.template)
            if before is None or _preference(row) > _preference(before):
                found[row.template] = row
    return tuple(found[name] for name in sorted(found))


def _preference(row: EpisodeRow) -> tuple[bool, bool, int]:
    return row.level == own_level(row.template), bool(row.predicate_holds), -row.seed


def show_episode(bag: Path, film_s: float) -> Shown | None:
    """The picture and the film; None where the bag cannot be read or drawn."""
    try:
        record = read_episode(bag)
        steps = film_steps(record, film_s)
        film = BirdseyeFilm(record, steps)
        poster = picture_uri(film.frame(steps[len(steps) // 2]).resize(_POSTER_PX))
        picture = drawn_uri(draw_episode(record), _PICTURE_PX)
        return Shown(picture, film_uri(film.frames(), _CODING), poster, steps[0] * STEP_S)
    except SirenError:
        return None


def film_steps(record: EpisodeRecord, film_s: float) -> range:
    """The frames around the median event of the interaction; around its middle where there is no event."""
    emvs = frozenset(record.emv_ids)
    told = [
        event.step
        for event in record.events
        if event.kind in _TOLD and (event.kind not in EMV_EVENTS or event.actor_id in emvs)
    ]
    middle = float(np.median(told)) if told else float(np.mean(interaction_steps(record)))
    length = round(film_s / STEP_S)
    last = max(record.steps - length, 0)
    first = int(np.clip(round(middle - 0.5 * length), 0, last)) // FRAME_STEPS * FRAME_STEPS
    return range(first, min(first + length, record.steps), FRAME_STEPS)


def _title(template: str) -> str:
    try:
        return load_template(template).title
    except SirenError:
        return "a template that is not among the project's"
