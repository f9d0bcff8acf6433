"""Everything that is measured on the bags of a study, in one pass over them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from siren_ros.datasets.exporting.worker_pool import worker_pool
from siren_ros.errors import InputError, SirenError
from siren_ros.evaluation.diversity.profile import InteractionProfile, profile_of
from siren_ros.evaluation.prediction.predictors import predictors_named
from siren_ros.evaluation.prediction.protocol.predictor import Predictor
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores
from siren_ros.evaluation.prediction.scoring.score_episode import score_episode
from siren_ros.evaluation.yielding.scoring import score_yielding
from siren_ros.evaluation.yielding.summary import ScoredEpisode
from siren_ros.recording.bag_reader import read_episode


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
    bags: Sequence[Path], models: Sequence[str], jobs: int, told: Callable[[], None] = lambda: None
) -> StudyMeasures:
    """Measures every bag; one that cannot be read does not keep the others from being measured.

    Args:
        bags: Folders of episodes.
        models: Trajectory predictors that need no checkpoint.
        jobs: Processes.
        told: Called after each bag.

    Raises:
        InputError: A predictor that is not known, or no bag that can be read.
    """
    names = tuple(models)
    _predictors(names)
    found: dict[int, BagMeasures | UnreadBag] = {}
    with worker_pool(min(jobs, len(bags)), lambda _: None) as pool:
        for number, one in pool(measure_bag, [(bag, names) for bag in bags]):
            found[number] = one
            told()
    ordered = [found[number] for number in range(len(bags))]
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
