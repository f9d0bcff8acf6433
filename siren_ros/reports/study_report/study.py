"""Data of a study's page: rows, options, stored scores, and measures of its bags."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from siren_ros.base.params import plain_json
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.base.tables.table import Table
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import InputError, SirenError
from siren_ros.reports.study_report.moments import Notable, notable_moments
from siren_ros.running.studies.episode_row import EpisodeRow
from siren_ros.running.studies.study_folder import MANIFEST, STUDY, LocalFolder, read_table
from siren_ros.scoring.evaluation.diversity.profile import InteractionProfile, profile_of
from siren_ros.scoring.evaluation.paper_comparison import stored
from siren_ros.scoring.evaluation.prediction.predictors import Predictor, predictors_named
from siren_ros.scoring.evaluation.prediction.scoring import EpisodeScores, score_episode
from siren_ros.scoring.evaluation.yielding.scoring import ScoredEpisode, score_yielding


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
    return StudyRows(folder, plain_json.load(asked) if asked else {}, ordered, sha256(content).hexdigest())


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
    except (KeyError, TypeError, AttributeError) as error:
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
