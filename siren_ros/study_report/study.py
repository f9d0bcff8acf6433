"""A study as the page needs it: its rows, its options, stored scores, and everything that is measured on its bags."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError, SirenError
from siren_ros.evaluation.diversity.profile import InteractionProfile, profile_of
from siren_ros.evaluation.paper_comparison import stored
from siren_ros.evaluation.prediction.episode_scores import EpisodeScores, score_episode
from siren_ros.evaluation.prediction.predictors import Predictor, predictors_named
from siren_ros.evaluation.yielding.scoring import ScoredEpisode, score_yielding
from siren_ros.processes.process_pool import ProcessPool
from siren_ros.recording.bag_reader import read_episode
from siren_ros.studies.episode_row import EpisodeRow
from siren_ros.studies.study_folder import MANIFEST, STUDY, LocalFolder, read_table
from siren_ros.tables.table import Table


@dataclass(frozen=True)
class StudyRows:
    """What a study's folder says about its episodes."""

    folder: Path
    asked: Mapping[str, Any]
    """``study.json``: what the last run asked for; empty where it is missing."""
    rows: tuple[EpisodeRow, ...]
    manifest_sha256: str


def read_rows(folder: Path) -> StudyRows:
    """Reads the table of a study, and the rows next to bags that a run without an end left out of it.

    Raises:
        InputError: The folder is none that ``siren generate`` made.
    """
    local = LocalFolder(folder)
    content = local.read(MANIFEST)
    if content is None:
        raise InputError("dir", str(folder), f"a folder that `siren generate` made, with {MANIFEST}")
    rows = {row.episode: row for row in read_table(local)}
    for file in sorted((folder / "episodes").glob("*/*.json")):
        if file.stem not in rows:
            row = local.row_of(file.relative_to(folder).with_suffix("").as_posix())
            if row is not None:
                rows[row.episode] = row
    asked = local.read(STUDY)
    ordered = tuple(rows[name] for name in sorted(rows))
    return StudyRows(folder, json.loads(asked) if asked else {}, ordered, sha256(content).hexdigest())


MODELS: Final = ("cv", "idm", "siren")
DETECTION: Final = "detection"
RISK: Final = "risk"
FILM_S: Final = 10.0


@dataclass(frozen=True)
class PageOptions:
    """What goes into a page."""

    models: tuple[str, ...] = MODELS
    """Trajectory predictors that are scored on the bags."""
    detection: Path | None = None
    """Where ``siren evaluate detection --out`` wrote; None: the folder ``detection`` of the study."""
    risk: Path | None = None
    """Where ``siren evaluate risk --out`` wrote; None: the folder ``risk`` of the study."""
    jobs: int = 1
    film_s: float = FILM_S
    """Length of the films."""

    def detection_in(self, folder: Path) -> Path:
        """Where the detectors' scores of a study are."""
        return self.detection or folder / DETECTION

    def risk_in(self, folder: Path) -> Path:
        """Where the risk task's scores of a study are."""
        return self.risk or folder / RISK

    def check(self) -> None:
        """InputError if a folder that was asked for has no scores: a page without them would not say so."""
        for task, folder in ((DETECTION, self.detection), (RISK, self.risk)):
            if folder is not None and stored(folder) is None:
                raise InputError(task, str(folder), f"a folder that `siren evaluate {task} --out` wrote")


def stored_tables(
    task: str, folder: Path, tables: Callable[[Mapping[str, Any]], Iterable[Table]]
) -> tuple[Table, ...] | None:
    """The tables of the scores in a folder; None where there are none.

    Args:
        task: As ``siren evaluate`` names it.
        folder: With ``scores.json``.
        tables: Made from its content.

    Raises:
        InputError: The scores are those of something else.
    """
    content = stored(folder)
    if content is None:
        return None
    try:
        return tuple(tables(content))
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(task, str(folder), f"scores of `siren evaluate {task}` ({error!r})") from error


@dataclass(frozen=True)
class BagMeasures:
    """What one bag gives."""

    bag: Path
    yielding: ScoredEpisode
    prediction: EpisodeScores
    profile: InteractionProfile


@dataclass(frozen=True)
class UnreadBag:
    """A bag that gives nothing, and why."""

    bag: Path
    reason: str


@dataclass(frozen=True)
class StudyMeasures:
    """What all bags give, in the order of the bags."""

    bags: tuple[BagMeasures, ...]
    unread: tuple[UnreadBag, ...]

    @property
    def yielding(self) -> tuple[ScoredEpisode, ...]:
        """In the order in which ``siren evaluate yield`` takes them, which the bootstrap depends on."""
        found = [one.yielding for one in self.bags]
        return tuple(sorted(found, key=lambda one: (one.group, one.seed, one.draw, one.bag)))

    @property
    def prediction(self) -> tuple[EpisodeScores, ...]:
        """In the order in which ``siren evaluate prediction`` takes them."""
        return tuple(one.prediction for one in self.bags)


def measure_study(
    bags: Sequence[Path], models: Sequence[str], jobs: int, progress: Callable[[], None] = lambda: None
) -> StudyMeasures:
    """Measures every bag; one that cannot be read does not keep the others from being measured.

    Args:
        bags: Folders of episodes.
        models: Trajectory predictors that need no checkpoint.
        jobs: Processes.
        progress: Called after each bag.

    Raises:
        InputError: A predictor that is not known, or no bag that can be read.
    """
    names = tuple(models)
    _predictors(names)
    with ProcessPool(min(jobs, len(bags))) as pool:
        ordered = pool.map(measure_bag, [(bag, names) for bag in bags], progress)
    measured = tuple(one for one in ordered if isinstance(one, BagMeasures))
    unread = tuple(one for one in ordered if isinstance(one, UnreadBag))
    if not measured:
        raise InputError("dir", unread[0].reason if unread else "no bag", "a folder with bags that can be read")
    return StudyMeasures(measured, unread)


def measure_bag(bag: Path, models: tuple[str, ...]) -> BagMeasures | UnreadBag:
    """All measures of a bag."""
    try:
        record = read_episode(bag)
        yielding = ScoredEpisode.of(str(bag), record, score_yielding(record))
        prediction = score_episode(str(bag), record, _predictors(models))
        return BagMeasures(bag, yielding, prediction, profile_of(str(bag), record))
    except SirenError as error:
        return UnreadBag(bag, str(error))


@cache
def _predictors(models: tuple[str, ...]) -> dict[str, Predictor]:
    """Made once in each process."""
    return predictors_named(models)
