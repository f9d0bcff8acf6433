"""How a driver sits an exam: in recorded episodes, or in a study that is made twice, the second time to compare."""

import json
import re
import shlex
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeAlias

from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.plain_files import sha256_of_file
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import InputError, shown_text, write_text, writing
from siren_ros.reports.exam.certificate import Certificate, as_json, as_junit, page_of
from siren_ros.reports.exam.examinee import PAPER, actor_in_seat, compared_with_paper
from siren_ros.reports.exam.grading import Rulebook, Sitting, examine
from siren_ros.reports.study_report.page import EpisodePages, html_of
from siren_ros.running.generation.closed_loop import AnswerTimes
from siren_ros.running.generation.episode_setup import present_versions
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.drivers.learned import SHIPPED
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import Seat, Study
from siren_ros.simulation.world.actors import NO_ACTOR

PAPER_FOLDER: Final = "paper"
"""Folder of the episodes with the paper's driver, in that of an exam."""
_PAGES: Final = 20
"""Most episodes with a page of their own."""
StudyMaker: TypeAlias = Callable[[Study, Path], Sequence[EpisodeRow]]
"""Makes the episodes of a study in a folder, and gives their rows."""


@dataclass(frozen=True)
class MadeEpisode:
    """An episode that an exam made for its driver."""

    bag: Path
    paper: Path | None
    """Bag of the same episode with the paper's driver; None where there is none."""
    answers: AnswerTimes | None
    """Answer times of the program that drove (``Sitting.answers``)."""
    actor_id: int | None = None
    """The driver; None for the AV under test, or who would be it."""


def make_exam(
    study: Study, out: Path, make: StudyMaker, *, paired: bool
) -> tuple[tuple[MadeEpisode, ...], tuple[Sitting, ...]]:
    """Makes the episodes of an exam: a study with the driver in its seat, and the same study with the paper's driver.

    Args:
        study: The matrix. Its seat names the driver; the paper's own is ``PAPER``, and takes the seat of nobody.
        out: Folder of the study; the folder ``PAPER_FOLDER`` in it gets the episodes with the paper's driver.
        make: Makes the two studies.
        paired: Whether the second study is made too.

    Returns:
        The episodes that have a bag, and a sitting with its reason for each episode that is not complete.

    Raises:
        InputError: There is no such driver, or the study or the folder cannot be used.
    """
    driver = study.seat.driver
    if driver and driver != PAPER:
        driver_of(driver)
    papers = replace(study, seat=Seat())
    rows = make(papers if driver == PAPER else study, out)
    pairs = make(papers, out / PAPER_FOLDER) if paired and driver != PAPER else ()
    beside = {_cell(row): out / PAPER_FOLDER / row.bag for row in pairs if row.bag}
    real_time = study.seat.real_time
    made = [
        MadeEpisode(out / row.bag, beside.get(_cell(row)), _answers(row) if real_time else None)
        for row in rows
        if row.bag
    ]
    lacking = [row for row in rows if row.status is not Status.COMPLETE]
    lacks = [Sitting(str(out / row.path), _name(row), NO_ACTOR, (), row.reason) for row in lacking]
    return tuple(made), tuple(lacks)


def _cell(row: EpisodeRow) -> tuple[Any, ...]:
    return row.template, row.level, row.seed, row.map, row.site, row.values


def _answers(row: EpisodeRow) -> AnswerTimes | None:
    measures = json.loads(row.measures)
    names = {field.name: f"answers.{field.name}" for field in fields(AnswerTimes)}
    if not measures.keys() >= set(names.values()):
        return None
    return AnswerTimes(**{name: float(measures[key]) for name, key in names.items()})


def _name(row: EpisodeRow) -> str:
    return f"{row.template}_{row.level}_seed{row.seed}_{row.map_name}"


def sit_in_bag(bag: Path, actor_id: int | None, rulebook: Rulebook) -> Sitting:
    """The marks of a bag's AV under test, or of another driver.

    Raises:
        InputError: The bag has no AV and no driver is named, or it has no such driver.
        BagError: The bag cannot be read.
    """
    record = read_episode(bag)
    chosen = record.description.av_id if actor_id is None else actor_id
    if chosen == NO_ACTOR:
        raise InputError("bag", str(bag), "an episode with an AV under test, or --actor (in Python actor_id)")
    return examine(record, chosen, rulebook, str(bag))


def sit_in_made_episode(made: MadeEpisode, rulebook: Rulebook) -> Sitting:
    """The marks of the driver in the seat, with what it does to others where there is a pair.

    Raises:
        BagError: A bag cannot be read.
    """
    record = read_episode(made.bag)
    seated = record.description.av_id if made.actor_id is None else made.actor_id
    actor_id = actor_in_seat(record) if seated == NO_ACTOR else seated
    if made.paper is None:
        return replace(examine(record, actor_id, rulebook, str(made.bag)), answers=made.answers)
    model = read_episode(made.paper)
    name = record.actors[actor_id].name
    model_id = next(one for one, actor in model.actors.items() if actor.name == name)
    sitting = examine(record, actor_id, rulebook, str(made.bag), (model, model_id))
    others = compared_with_paper(record, actor_id, model, model_id)
    return replace(sitting, answers=made.answers, others=others, paper=str(made.paper))


def write_certificate(certificate: Certificate, out: Path, command: str, jobs: int) -> tuple[int, tuple[str, ...]]:
    """Writes ``certificate.html``, ``.json`` and ``.xml``, and the pages of the episodes with violations.

    Args:
        certificate: The exam.
        out: Folder; it is made if missing.
        command: It makes the certificate again.
        jobs: Processes that write pages.

    Returns:
        The number of pages, and why others are missing.

    Raises:
        InputError: The folder cannot be written.
    """
    with writing(out, "folder"):
        out.mkdir(parents=True, exist_ok=True)
    pages = EpisodePages(out / "pages", _PAGES, {Path(sitting.bag) for sitting in certificate.graded})
    write_text(out / "certificate.html", html_of(page_of(certificate, command, pages)))
    write_text(out / "certificate.json", as_json(certificate))
    write_text(out / "certificate.xml", as_junit(certificate))
    written, _, errors = pages.write(jobs)
    return written, errors


def about_of(study: Study | None = None) -> dict[str, Any]:
    """What a certificate says of versions, and of the study that was made for it with the files of its driver."""
    about: dict[str, Any] = {"versions": dict(present_versions())}
    if study is None:
        return about
    driver, program = study.seat.driver, study.seat.program
    words = [driver, *shlex.split(program)] if driver != "learned" else [str(params_dir() / SHIPPED)]
    files = [Path(found) for word in words if (found := shutil.which(word) or word) and Path(found).is_file()]
    matrix = replace(study, salt=Path(study.salt).name).to_json()
    return {**about, "matrix": matrix, "driver_sha256": {file.name: sha256_of_file(file) for file in files}}


def certificate_of(
    driver: str,
    actor_id: int | None,
    rulebook: Rulebook,
    sittings: Sequence[Sitting],
    about: Mapping[str, Any] = MappingProxyType({}),
) -> Certificate:
    """The certificate of an exam, with the sittings in the order of their bags: seed 2 comes before seed 10.

    Args:
        driver: Its name; empty for that of its part in the episodes.
        actor_id: The driver in recorded episodes; None for the AV under test.
        rulebook: What was asked.
        sittings: Sittings of all episodes, in any order.
        about: What else is on the certificate (``about_of``).
    """
    part = "the AV under test" if actor_id is None else f"actor {actor_id}"
    return Certificate(shown_text(driver or part), rulebook, tuple(sorted(sittings, key=_by_number)), about)


def _by_number(sitting: Sitting) -> list[tuple[str, int]]:
    return [(text, int(number or 0)) for text, number in re.findall(r"(\D*)(\d*)", sitting.bag)]
