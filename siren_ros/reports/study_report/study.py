"""Data of a study's page: rows, options, stored scores, measures of its bags, and moments that readers may want to see.

Moments are failures, contacts, and the closest approaches.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params import plain_files
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.base.tables import Table
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, SirenError
from siren_ros.reports.episode_page.columns import check_motion
from siren_ros.reports.study_report.page import EpisodePages, Link, Section, quoted
from siren_ros.running.studies.episode_row import EpisodeRow
from siren_ros.running.studies.study_folder import MANIFEST, STUDY, LocalFolder, read_table
from siren_ros.scoring.evaluation.diversity import InteractionProfile, profile_of
from siren_ros.scoring.evaluation.paper_comparison import stored
from siren_ros.scoring.evaluation.prediction.predictors import Predictor, predictors_named
from siren_ros.scoring.evaluation.prediction.scoring import EpisodeScores, score_episode
from siren_ros.scoring.evaluation.yielding.scoring import ScoredEpisode, score_yielding
from siren_ros.scoring.judging.outcome import evaluate_predicate
from siren_ros.scoring.judging.surrogate_safety import conflict_series, pair_measures
from siren_ros.scoring.pictures.birdseye import interaction_steps
from siren_ros.simulation.scenario.templates import own_level
from siren_ros.simulation.world.actors import EventKind


class Kind(StrEnum):
    """Kind of a moment, in the order in which they are shown."""

    CONTACT = "contact"
    FAILURE = "failure"
    """A condition of the predicate does not hold at the template's own level."""
    CLOSE = "close"


MOST: Final = {Kind.CONTACT: 20, Kind.FAILURE: 20, Kind.CLOSE: 5}
"""Largest number of moments of each kind on a page."""


@dataclass(frozen=True)
class Notable:
    """A moment of an episode."""

    kind: Kind
    text: str
    step: int
    actor_id: int
    rank: float
    """Rank of the moment in its kind; the page shows those with the lowest."""


def notable_moments(record: EpisodeRecord) -> tuple[Notable, ...]:
    """Find at most one moment per kind: hardest contact, decisive moment of the first failed condition, smallest TTC.

    Nothing of a record that no page can show.
    """
    try:
        check_motion(record)
    except InputError:
        return ()
    return (*_contact(record), *_failure(record), *_closest(record))


def _contact(record: EpisodeRecord) -> Iterator[Notable]:
    contacts = record.events_of(EventKind.COLLISION)
    if contacts:
        speeds_mps = [float(event.detail.get("impact_speed_mps", 0.0)) for event in contacts]
        speed_mps = max(speeds_mps)
        event = contacts[speeds_mps.index(speed_mps)]
        text = f"contact with {event.other_id} at {speed_mps:.1f} m/s, the hardest of {len(contacts)}"
        yield Notable(Kind.CONTACT, text, event.step, event.actor_id, -speed_mps)


def _failure(record: EpisodeRecord) -> Iterator[Notable]:
    episode = record.description
    try:
        failing = evaluate_predicate(record).failing if own_level(episode.template) == episode.level.name else ()
    except SirenError:  # without a predicate there is no expectation to fail
        return
    for part in failing[:1]:
        moment = part.decisive
        step, actor_id = (moment.step, moment.actor_id) if moment else (interaction_steps(record)[0], record.emv_ids[0])
        yield Notable(Kind.FAILURE, str(part), step, actor_id, 0.0)


def _closest(record: EpisodeRecord) -> Iterator[Notable]:
    pairs = pair_measures(*conflict_series(record, record.emv_ids[0]))
    times = [(pair.time_to_collision_s, pair.actor_id) for pair in pairs if pair.time_to_collision_s is not None]
    if times:
        soonest, other_id = min(times, key=lambda pair: pair[0].value)
        text = f"least TTC of the EMV, {soonest.value:.2f} s to {other_id}"
        yield Notable(Kind.CLOSE, text, soonest.step, record.emv_ids[0], soonest.value)


def moments_section(found: Iterable[tuple[Path, Notable]], pages: EpisodePages) -> Section | None:
    """Section of moments with links to pages of episodes, or commands that show them; None without moments."""
    links, left_out = [], 0
    ordered = sorted(found, key=lambda item: (item[1].rank, item[0].name))
    for kind, most in MOST.items():
        of_kind = [item for item in ordered if item[1].kind is kind]
        left_out += 0 if kind is Kind.CLOSE else len(of_kind[most:])
        links += [_link(bag, notable, pages) for bag, notable in of_kind[:most]]
    if not links:
        return None
    text = (
        "The hardest contact of each episode, what decided that an interaction failed at its template's own level, "
        "and the episodes whose EMV came closest to a collision. A link opens the episode at this moment, in a file in "
        f"the folder {pages.folder.name} next to this one; the other moments have the command that shows them."
    )
    more = (f"{left_out} more are not named.",) if left_out else ()
    return Section("moments", "Moments to look into", (text, *more), links=tuple(links))


def _link(bag: Path, notable: Notable, pages: EpisodePages) -> Link:
    time_s = notable.step * STEP_S
    text = f"{bag.name}, {time_s:.2f} s, vehicle {notable.actor_id}: {notable.text}"
    command = f"./env siren view {quoted(bag)} --time-s {time_s:g} --actor {notable.actor_id}"
    return Link(text, pages.address(bag, time_s, notable.actor_id), command)


@dataclass(frozen=True)
class StudyRows:
    """Content of a study's folder about its episodes."""

    folder: Path
    asked: Mapping[str, Any]
    """Content of ``study.json``, the options of the last run; empty if it is missing."""
    rows: tuple[EpisodeRow, ...]
    manifest_sha256: str


def read_rows(folder: Path) -> StudyRows:
    """Read a study's table, and rows next to bags that an interrupted run did not add to it.

    Raises:
        InputError: The folder is none that ``siren generate`` made.
    """
    local = LocalFolder(folder)
    content = local.read(MANIFEST)
    if content is None:
        raise InputError("dir", str(folder), f"a folder that `siren generate` made, with {MANIFEST}")
    rows = {row.episode: row for row in read_table(local)}
    for file in sorted((folder / "episodes").glob("*/*.json")):
        row = None if file.stem in rows else local.row_of(file.relative_to(folder).with_suffix("").as_posix())
        if row is not None:
            rows[row.episode] = row
    asked = local.read(STUDY)
    ordered = tuple(rows[name] for name in sorted(rows))
    return StudyRows(folder, plain_files.load_json(asked) if asked else {}, ordered, sha256(content).hexdigest())


MODELS: Final = ("cv", "idm", "siren")
DETECTION: Final = "detection"
RISK: Final = "risk"
FILM_S: Final = 10.0
PAGES: Final = 8


@dataclass(frozen=True)
class PageOptions:
    """Options of a page."""

    models: tuple[str, ...] = MODELS
    """Trajectory predictors to score on the bags."""
    detection: Path | None = None
    """Folder of ``siren evaluate detection --out``; None for the folder ``detection`` of the study."""
    risk: Path | None = None
    """Folder of ``siren evaluate risk --out``; None for the folder ``risk`` of the study."""
    jobs: int = 1
    film_s: float = FILM_S
    """Length of the films."""
    pages: int = PAGES
    """Largest number of episodes that get a page of their own."""
    pages_folder: Path = Path("pages")
    """Folder of these pages next to the report."""

    def detection_in(self, folder: Path) -> Path:
        """Folder of the detectors' scores for a study."""
        return self.detection or folder / DETECTION

    def risk_in(self, folder: Path) -> Path:
        """Folder of the risk task's scores for a study."""
        return self.risk or folder / RISK

    def check(self) -> None:
        """Check that requested folders have scores; otherwise InputError, because the page would not show the lack."""
        for task, folder in ((DETECTION, self.detection), (RISK, self.risk)):
            if folder is not None and stored(folder) is None:
                raise InputError(task, str(folder), f"a folder that `siren evaluate {task} --out` wrote")


def stored_tables(
    task: str, folder: Path, tables: Callable[[Mapping[str, Any]], Iterable[Table]]
) -> tuple[Table, ...] | None:
    """Tables of the ``scores.json`` in a folder for a task of ``siren evaluate``; None without such a file.

    Raises:
        InputError: The scores are those of something else.
    """
    content = stored(folder)
    if content is None:
        return None
    try:
        return tuple(tables(content))
    except (InputError, KeyError, TypeError, AttributeError) as error:
        raise InputError(task, str(folder), f"scores of `siren evaluate {task}` ({error!r})") from error


@dataclass(frozen=True)
class BagMeasures:
    """Measures of one bag."""

    bag: Path
    yielding: ScoredEpisode
    prediction: EpisodeScores
    profile: InteractionProfile
    moments: tuple[Notable, ...]


@dataclass(frozen=True)
class StudyMeasures:
    """Measures of all bags, in their order."""

    bags: tuple[BagMeasures, ...]
    unread: tuple[tuple[Path, str], ...] = ()
    """Bags that cannot be read, each with the reason."""

    @property
    def yielding(self) -> tuple[ScoredEpisode, ...]:
        """Yield scores in the order of ``siren evaluate yield``, on which the bootstrap depends."""
        episodes = [bag.yielding for bag in self.bags]
        return tuple(sorted(episodes, key=lambda episode: (episode.group, episode.seed, episode.draw, episode.bag)))

    @property
    def prediction(self) -> tuple[EpisodeScores, ...]:
        """Prediction scores in the order of ``siren evaluate prediction``."""
        return tuple(bag.prediction for bag in self.bags)


def measure_study(
    bags: Sequence[Path], models: Sequence[str], jobs: int, progress: Callable[[], None] = lambda: None
) -> StudyMeasures:
    """Measure every bag in parallel processes; an unreadable bag does not stop the others.

    The models are trajectory predictors that need no checkpoint; ``progress`` is called after each bag.

    Raises:
        InputError: A predictor that is not known, or no bag that can be read.
    """
    names = tuple(models)
    _predictors(names)
    with ProcessPool(min(jobs, len(bags))) as pool:
        ordered = pool.map(measure_bag, [(bag, names) for bag in bags], progress)
    measured = tuple(result for result in ordered if isinstance(result, BagMeasures))
    unread = tuple(result for result in ordered if not isinstance(result, BagMeasures))
    if not measured:
        raise InputError("dir", unread[0][1] if unread else "no bag", "a folder with bags that can be read")
    return StudyMeasures(measured, unread)


def measure_bag(bag: Path, models: tuple[str, ...]) -> BagMeasures | tuple[Path, str]:
    """All measures of a bag; or the bag with the reason if it cannot be read."""
    try:
        record = read_episode(bag)
        yielding = ScoredEpisode.of(str(bag), record, score_yielding(record))
        prediction = score_episode(str(bag), record, _predictors(models))
        return BagMeasures(bag, yielding, prediction, profile_of(str(bag), record), notable_moments(record))
    except SirenError as error:
        return bag, str(error)


@cache
def _predictors(models: tuple[str, ...]) -> dict[str, Predictor]:
    """Make the predictors once per process."""
    return predictors_named(models)
