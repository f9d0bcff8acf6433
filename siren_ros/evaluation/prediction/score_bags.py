"""Scores many bags, side by side in processes."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from siren_ros.errors import SirenError
from siren_ros.evaluation.prediction.episode_scores import Answers, EpisodeScores, answers_of, score_episode
from siren_ros.evaluation.prediction.predictors import Predictor, predictors_named
from siren_ros.evaluation.prediction.samples import Population
from siren_ros.evaluation.prediction.submission import Submission, SubmittedPart, read_recorded_predictions
from siren_ros.processes.worker_pool import worker_pool
from siren_ros.record.bag_survey import episode_name
from siren_ros.record.episode_source import EpisodeSource, open_source
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
    for one in submissions.values():
        one.check_episodes(names)
    if job.models:
        _predictors(job.models, job.checkpoints)
    results: list[BagResult] = [BagResult(bag, None) for bag in bags]
    with worker_pool(min(job.processes, len(bags) // 2), lambda _: None) as run:
        told = replace(job, submissions=None)  # each worker gets the part of its bag alone
        calls = [(bag, told, _parts(submissions, own)) for bag, own in zip(bags, names, strict=True)]
        for number, result in run(_score_bag, calls):
            results[number] = result
            progress()
    return tuple(results)


def answers_for(job: ScoringJob, bag: Path, models: Collection[str]) -> tuple[EpisodeRecord, Mapping[str, Answers]]:
    """An episode and what some of the models predict in it, once more: scores do not keep paths.

    Raises:
        SirenError: As for ``BagResult.error``.
    """
    predictors = _predictors(job.models, job.checkpoints) if job.models else {}
    submissions = {name: one for name, one in (job.submissions or {}).items() if name in models}
    wanted = {name: predictor for name, predictor in predictors.items() if name in models}
    with open_source(bag) as source:
        record = source.record()
        recorded = job.recorded if job.recorded in models else ""
        parts = _with_recorded(source, _parts(submissions, _names(bag)), recorded, job.allow_missing)
    return record, {one.model: one for one in answers_of(record, wanted, job.population, parts)}


def _names(bag: Path) -> tuple[str, ...]:
    """What predictions may call the episode: the folder, and as exports name it, with or without underscores."""
    try:
        with open_source(bag) as source:
            episode = source.description
    except SirenError:
        return (bag.name,)
    exported = episode_name(episode.template, episode.level.name, episode.seed, episode.map_name)
    return tuple(dict.fromkeys((bag.name, exported, exported.replace("_", "-"))))


def _parts(submissions: Mapping[str, Submission], names: tuple[str, ...]) -> Mapping[str, SubmittedPart]:
    return {model: one.of_episode(names) for model, one in submissions.items()}


def _with_recorded(
    source: EpisodeSource, submitted: Mapping[str, SubmittedPart], recorded: str, allow_missing: bool
) -> Mapping[str, SubmittedPart]:
    return {**submitted, recorded: read_recorded_predictions(source, allow_missing)} if recorded else submitted


@cache
def _predictors(models: tuple[str, ...], checkpoints: tuple[tuple[str, Path], ...]) -> Mapping[str, Predictor]:
    """Made once in each process: some load weights."""
    return predictors_named(models, dict(checkpoints))


def _score_bag(bag: Path, job: ScoringJob, submitted: Mapping[str, SubmittedPart]) -> BagResult:
    predictors = _predictors(job.models, job.checkpoints) if job.models else {}
    try:
        with open_source(bag) as source:
            record = source.record()
            parts = _with_recorded(source, submitted, job.recorded, job.allow_missing)
        return BagResult(bag, score_episode(str(bag), record, predictors, job.population, parts))
    except SirenError as error:
        return BagResult(bag, None, error)
