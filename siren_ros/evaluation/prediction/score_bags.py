"""Scores many bags, side by side in processes."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from siren_ros.errors import SirenError
from siren_ros.evaluation.prediction.episode_scores import Answers, EpisodeScores, answers_of, score_episode
from siren_ros.evaluation.prediction.predictors import Predictor, predictors_named
from siren_ros.evaluation.prediction.samples import Population
from siren_ros.evaluation.prediction.submission import EpisodePredictions, Submission, read_recorded_predictions
from siren_ros.processes.process_pool import ProcessPool
from siren_ros.record.bag_survey import episode_name
from siren_ros.record.episode_source import open_source
from siren_ros.recording.episode_record import EpisodeRecord


@dataclass(frozen=True)
class ScoringJob:
    """What is scored on every bag."""

    models: tuple[str, ...]
    checkpoints: tuple[tuple[str, Path], ...] = ()
    submissions: Mapping[str, Submission] | None = None
    recorded: str = ""
    """Name of the row for the predictions that the bags hold themselves; empty where they are not scored."""
    allow_missing: bool = False
    """Of the recorded ones; submissions say it themselves."""
    population: Population = Population.REGION
    processes: int = 1


@dataclass(frozen=True)
class BagResult:
    """What became of a bag: its scores, or the error."""

    bag: Path
    scores: EpisodeScores | None
    error: SirenError | None = None


def score_bags(
    job: ScoringJob, bags: Sequence[Path], progress: Callable[[], None] = lambda: None
) -> tuple[BagResult, ...]:
    """Scores every bag; one that cannot be read does not keep the others from being scored.

    Args:
        job: The models.
        bags: Folders of episodes.
        progress: Called after each bag.

    Raises:
        InputError: A model that cannot be made, or predictions that do not fit the episodes.
    """
    submissions = job.submissions or {}
    names = [_names(bag) if submissions else (bag.name,) for bag in bags]
    for submission in submissions.values():
        submission.check_episodes(names)
    _predictors(job.models, job.checkpoints)
    rest = replace(job, submissions=None)  # each worker gets the part of its bag alone
    calls = [(bag, rest, _parts(submissions, of_bag)) for bag, of_bag in zip(bags, names, strict=True)]
    with ProcessPool(min(job.processes, len(bags) // 2)) as pool:
        return tuple(pool.map(_score_bag, calls, progress))


def answers_for(job: ScoringJob, bag: Path, models: Collection[str]) -> tuple[EpisodeRecord, Mapping[str, Answers]]:
    """An episode and what some of the models predict in it, once more: scores do not keep paths.

    Raises:
        SirenError: As for ``BagResult.error``.
    """
    submissions = {model: submission for model, submission in (job.submissions or {}).items() if model in models}
    job = replace(job, recorded=job.recorded if job.recorded in models else "")
    record, predictors, submitted = _opened(job, bag, _parts(submissions, _names(bag)))
    predictors = {model: predictor for model, predictor in predictors.items() if model in models}
    return record, {each.model: each for each in answers_of(record, predictors, job.population, submitted)}


def _names(bag: Path) -> tuple[str, ...]:
    """What predictions may call the episode: the folder, and as exports name it, with or without underscores."""
    try:
        with open_source(bag) as source:
            episode = source.description
    except SirenError:
        return (bag.name,)
    exported = episode_name(episode.template, episode.level.name, episode.seed, episode.map_name)
    return tuple(dict.fromkeys((bag.name, exported, exported.replace("_", "-"))))


def _parts(submissions: Mapping[str, Submission], names: tuple[str, ...]) -> Mapping[str, EpisodePredictions]:
    return {model: submission.of_episode(names) for model, submission in submissions.items()}


@cache
def _predictors(models: tuple[str, ...], checkpoints: tuple[tuple[str, Path], ...]) -> Mapping[str, Predictor]:
    """Made once in each process: some load weights."""
    return predictors_named(models, dict(checkpoints)) if models else {}


def _opened(
    job: ScoringJob, bag: Path, submitted: Mapping[str, EpisodePredictions]
) -> tuple[EpisodeRecord, Mapping[str, Predictor], Mapping[str, EpisodePredictions]]:
    """An episode, the predictors, and what was submitted for it, the predictions that the bag holds included."""
    predictors = _predictors(job.models, job.checkpoints)
    with open_source(bag) as source:
        if job.recorded:
            submitted = {**submitted, job.recorded: read_recorded_predictions(source, job.allow_missing)}
        return source.record(), predictors, submitted


def _score_bag(bag: Path, job: ScoringJob, submitted: Mapping[str, EpisodePredictions]) -> BagResult:
    try:
        record, predictors, submitted = _opened(job, bag, submitted)
        return BagResult(bag, score_episode(str(bag), record, predictors, job.population, submitted))
    except SirenError as error:
        return BagResult(bag, None, error)
