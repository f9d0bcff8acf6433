"""Scores predictors on episodes: every model with every metric on each sample, many bags in parallel.

A sample has a category: what its vehicle does in the window.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum, IntFlag
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Brief, Codes, Floats, Ids, Rows
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.data.episode_source import episode_name, open_source
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.errors import InputError, SirenError
from siren_ros.scoring.evaluation.detection.detectors import DETECTORS
from siren_ros.scoring.evaluation.prediction.metrics import METRIC_OF, METRICS, MetricValue, distances, reliability_of
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses, Predictor, causal_answer, predictors_named
from siren_ros.scoring.evaluation.prediction.reported_tracks import NOISES, Reporter, detected_by, with_noise
from siren_ros.scoring.evaluation.prediction.samples import (
    LAST_FUTURE_STEP,
    Population,
    SampleBatch,
    ScoredSamples,
    samples_of,
)
from siren_ros.scoring.evaluation.prediction.submission import EpisodePredictions, Submission, read_recorded_predictions
from siren_ros.simulation.scenario.episode import EpisodeIdentity, Split
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import Mode


class Category(IntEnum):
    """Category of a sample; each sample has one."""

    EMV = 0
    YIELDING = 1
    """A civilian that yields at some step of its 5 s window; it may begin in the window."""
    HELD = 2
    """A civilian that stands in the hold of a pull-over at the present."""
    OTHER = 3


class Trait(IntFlag):
    """Traits of a sample; a sample may have several."""

    MOVING = 1
    """Faster than ``MOVING_MPS`` at the present."""
    BEGINS = 2
    """A yield, or the return from one, begins after the present and within the horizon."""


MOVING_MPS: Final = 1.0


def categories_of(record: EpisodeRecord, batch: SampleBatch) -> Codes:
    """Category of each sample of an episode, shape ``(N,)``, from recorded modes of present and future."""
    rows = record.rows
    category = np.full(len(batch), Category.OTHER, dtype=np.uint8)
    if not len(batch):
        return category
    now, end = _window_rows(rows, batch)
    yielding = (rows.mode >= Mode.YIELD_REACTING) & (rows.mode <= Mode.YIELD_HOLD)
    before = np.concatenate(([0], np.cumsum(yielding)))
    category[before[end] > before[now]] = Category.YIELDING
    category[rows.mode[now] == Mode.YIELD_HOLD] = Category.HELD
    category[batch.actors.is_emv[batch.target]] = Category.EMV
    return category


def traits_of(record: EpisodeRecord, batch: SampleBatch) -> Codes:
    """``Trait`` of each sample of an episode, shape ``(N,)``, from recorded speeds and modes of present and future."""
    rows = record.rows
    traits = np.zeros(len(batch), dtype=np.uint8)
    if not len(batch):
        return traits
    now, end = _window_rows(rows, batch)
    yielding = (rows.mode >= Mode.YIELD_REACTING) & (rows.mode <= Mode.YIELD_HOLD)
    phase = np.where(yielding, 1, np.where(rows.mode == Mode.REJOIN, 2, 0))
    begins = np.concatenate(([False], (phase[1:] > 0) & (phase[1:] != phase[:-1])))
    before = np.concatenate(([0], np.cumsum(begins)))
    traits[before[end] > before[now + 1]] |= int(Trait.BEGINS)
    traits[rows.speed_mps[now] > MOVING_MPS] |= int(Trait.MOVING)
    return traits


def _window_rows(rows: StateRows, batch: SampleBatch) -> tuple[Rows, Rows]:
    """For each sample the row of its present, and the row after its horizon; at least one sample."""
    actor, step = batch.actor_id, batch.sample_step
    span = int(rows.step.max()) + LAST_FUTURE_STEP + 1
    keys = rows.actor_id.astype(np.int64) * span + rows.step
    now = np.searchsorted(keys, actor * span + step)
    return now, np.searchsorted(keys, actor * span + step + LAST_FUTURE_STEP, side="right")


@dataclass(frozen=True)
class ModelScores(Brief):
    """Scores of one model on N samples; within an episode they are sorted by step and then by actor."""

    step: npt.NDArray[np.int64]
    """Step of each sample's present, shape ``(N,)``."""
    actor_id: Ids
    category: Codes
    """``Category`` of each sample; for people their ``ActorClass``."""
    traits: Codes
    """``Trait`` of each sample; 0 for people."""
    moved_m: Floats
    """Distance between the true positions at the present and at the horizon, shape ``(N,)``."""
    values: Mapping[str, Floats]
    """Values by metric, shape ``(N,)``; NaN where a metric does not apply."""
    distance_sum_m: Floats
    """Sum of the distances of the most probable paths from the truth, at each time of the grid; shape
    ``(FUTURE_POINTS,)``."""
    reliability: Floats
    """Counts of all hypotheses by probability, as ``reliability_of``."""
    population_size: int
    """Number of samples of the population; it is larger than N where predictions are missing."""

    def __len__(self) -> int:
        return len(self.step)

    def __getitem__(self, metric: str) -> MetricValue:
        """A metric over all samples."""
        return METRIC_OF[metric].value(self.values[metric])


@dataclass(frozen=True)
class EpisodeScores(Brief):
    """The scores of every model on one episode."""

    name: str
    """Name of the episode: its bag's folder."""
    template: str
    level: EmergencyLevel
    seed: int
    map_name: str
    population: Population
    parameters: Mapping[str, float]
    """Values of the template's parameters, such as ``emv.speed_mps``."""
    models: Mapping[str, ModelScores]
    people: Mapping[str, ModelScores] = field(default_factory=dict)
    """Scores of the same models on pedestrians and riders; empty for an episode without them."""
    standing: Mapping[str, Split] = field(default_factory=dict)
    """Whether the episode was part of each trained model's training; models that do not know are missing."""
    noise: str = ""
    """Input of the predictors: a name of ``NOISES`` or a detector; empty for the logged states."""
    causal_frames: Mapping[str, int] = field(default_factory=dict)
    """Number of frames on which each model was checked without later frames; 0 for submissions, which cannot be
    checked."""

    @property
    def samples(self) -> int:
        """Smallest number of samples of a model; models with different histories have different numbers."""
        return min((len(scores) for scores in self.models.values()), default=0)


def score_episode(
    name: str,
    record: EpisodeRecord,
    predictors: Mapping[str, Predictor],
    population: Population = Population.REGION,
    submitted: Mapping[str, EpisodePredictions] | None = None,
    noise: str = "",
    bag: Path | None = None,
) -> EpisodeScores:
    """Score every predictor and every submission on an episode: on its vehicles, and separately on its people.

    With ``noise``, a name of ``NOISES`` or a detector, predictors get what a tracker would report; the truth stays. A
    detector needs the bag.

    Predictors, and what other programs predicted in this episode (``submitted``), are by the names of the models; the
    name of the episode is for reports.

    Raises:
        InputError: The record does not describe its actors, or a model's hypotheses cannot be scored.
        CausalityError: A predictor looks at later frames.
    """
    models: dict[str, ModelScores] = {}
    causal_frames: dict[str, int] = {}
    reporter = reporter_named(noise, bag)
    for answers in _answers_of(record, predictors, population, submitted or {}, reporter):
        models[answers.model] = _scores_of(record, answers, people=False)
        causal_frames[answers.model] = answers.causal_frames
    of_people = _answers_of(record, predictors, population, submitted or {}, reporter, people=True)
    people = {answers.model: _scores_of(record, answers, people=True) for answers in of_people}
    about = record.description
    identity = EpisodeIdentity.of(about)
    seen = {model: getattr(predictor, "seen", None) for model, predictor in predictors.items()}
    return EpisodeScores(
        name,
        about.template,
        about.level,
        about.seed,
        about.map_name,
        population,
        about.template_values,
        models,
        people,
        standing={model: episodes.split_of(identity) for model, episodes in seen.items() if episodes is not None},
        noise=noise,
        causal_frames=causal_frames,
    )


def _scores_of(record: EpisodeRecord, answers: "Answers", people: bool) -> ModelScores:
    hypotheses, batch, truth = answers.hypotheses, answers.samples.batch, answers.samples.future_xy_m
    return ModelScores(
        step=batch.sample_step,
        actor_id=batch.actors.actor_id[batch.target],
        category=batch.actors.actor_class[batch.target] if people else categories_of(record, batch),
        traits=np.zeros(len(batch), dtype=np.uint8) if people else traits_of(record, batch),
        moved_m=np.hypot(*(truth[:, -1] - batch.xy_m).T),
        values={metric.name: metric.of_samples(hypotheses, answers.samples) for metric in METRICS},
        distance_sum_m=distances(hypotheses.xy_m[:, :1], truth)[:, 0].sum(axis=0),
        reliability=reliability_of(hypotheses, truth),
        population_size=answers.population_size,
    )


def reporter_named(noise: str, bag: Path | None) -> Reporter | None:
    """The reporter for ``--noise``; None for the logged states.

    Raises:
        BagError: The bag has no LiDAR, which a detector needs, or is damaged.
        InputError: The detector cannot run here.
    """
    if noise in DETECTORS:
        if bag is None:
            raise InputError("noise", noise, "a bag, for a detector")
        return detected_by(noise, bag)
    return with_noise(NOISES[noise]) if noise else None


@dataclass(frozen=True)
class Answers:
    """Predictions of one model in an episode."""

    model: str
    samples: ScoredSamples
    """Samples that have hypotheses."""
    hypotheses: Hypotheses
    """Hypotheses, one row per sample."""
    population_size: int
    """Number of samples of the population."""
    causal_frames: int = 0
    """Number of frames on which the hypotheses were checked without later frames."""


def _answers_of(
    record: EpisodeRecord,
    predictors: Mapping[str, Predictor],
    population: Population,
    submitted: Mapping[str, EpisodePredictions],
    reporter: Reporter | None = None,
    *,
    people: bool = False,
) -> Iterator[Answers]:
    """Hypotheses of all models, one model after the other; arguments and errors are those of ``score_episode``.

    Those for people are what a submission has of them.
    """
    if people and not len(record.people_ids):
        return
    samples_with = cache(lambda window: samples_of(record, window, population, people=people))
    seen_with = cache(lambda window: samples_of(record, window, population, people=people, reporter=reporter).batch)
    for model, predictor in predictors.items():
        samples = samples_with(predictor.window)
        population_size, seen = len(samples), samples.batch
        if reporter is not None:
            seen = seen_with(predictor.window)
            samples = samples.select(np.flatnonzero(np.isin(_keys(samples.batch), _keys(seen))))
        hypotheses, frames = causal_answer(model, predictor, seen)
        yield Answers(model, samples, hypotheses, population_size, frames)
    for model, predictions in submitted.items():
        samples = samples_with(predictions.window)
        answered = predictions.select(np.flatnonzero(np.isin(predictions.actor_id, record.people_ids) == people))
        if people:
            answered = replace(answered, allow_missing=True, allow_unknown=True)
        rows, hypotheses = answered.meet(samples.batch)
        yield Answers(model, samples.select(rows), hypotheses, len(samples))


def _keys(batch: SampleBatch) -> npt.NDArray[np.int64]:
    """A unique number for each sample, from its step and its actor."""
    return batch.sample_step * 2**32 + batch.actor_id


@dataclass(frozen=True)
class ScoringJob:
    """What to score on every bag."""

    models: tuple[str, ...]
    checkpoints: tuple[tuple[str, Path], ...] = ()
    submissions: Mapping[str, Submission] | None = None
    recorded: str = ""
    """Row name for predictions recorded in the bags; empty if they are not scored."""
    allow_missing: bool = False
    """Whether recorded predictions may be incomplete; submissions have a setting of their own."""
    population: Population = Population.REGION
    noise: str = ""
    """Input of the predictors, as ``EpisodeScores.noise``."""
    processes: int = 1


@dataclass(frozen=True)
class BagResult:
    """Result for one bag: its scores, or the error."""

    bag: Path
    scores: EpisodeScores | None
    error: SirenError | None = None


def score_bags(
    job: ScoringJob, bags: Sequence[Path], progress: Callable[[], None] = lambda: None
) -> tuple[BagResult, ...]:
    """Score every bag in parallel processes; an unreadable bag does not stop the others.

    ``progress`` is called after each bag.

    Raises:
        InputError: A model that cannot be made, or predictions that do not fit the episodes.
    """
    submissions = job.submissions or {}
    names = [_names(bag) if submissions else (bag.name,) for bag in bags]
    for submission in submissions.values():
        submission.check_episodes(names)
    _predictors(job.models, job.checkpoints)
    rest = replace(job, submissions=None)  # each worker gets only its own bag's part
    calls = [(bag, rest, _parts(submissions, of_bag)) for bag, of_bag in zip(bags, names, strict=True)]
    with ProcessPool(min(job.processes, len(bags) // 2)) as pool:
        return tuple(pool.map(_score_bag, calls, progress))


def answers_for(job: ScoringJob, bag: Path, models: Collection[str]) -> tuple[EpisodeRecord, Mapping[str, Answers]]:
    """Predict one episode again with some of the models, because scores do not keep paths.

    Raises:
        SirenError: As for ``BagResult.error``.
    """
    submissions = {model: submission for model, submission in (job.submissions or {}).items() if model in models}
    job = replace(job, recorded=job.recorded if job.recorded in models else "")
    record, predictors, submitted = _opened(job, bag, _parts(submissions, _names(bag)))
    predictors = {model: predictor for model, predictor in predictors.items() if model in models}
    return record, {
        answers.model: answers
        for answers in _answers_of(record, predictors, job.population, submitted, reporter_named(job.noise, bag))
    }


def _names(bag: Path) -> tuple[str, ...]:
    """Names that predictions may use for the episode: the folder, and the export's name with or without underscores."""
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
    """Make the predictors once per process, because some load weights."""
    return predictors_named(models, dict(checkpoints)) if models else {}


def _opened(
    job: ScoringJob, bag: Path, submitted: Mapping[str, EpisodePredictions]
) -> tuple[EpisodeRecord, Mapping[str, Predictor], Mapping[str, EpisodePredictions]]:
    """An episode, the predictors, and the submissions for it, including predictions recorded in the bag."""
    predictors = _predictors(job.models, job.checkpoints)
    with open_source(bag) as source:
        if job.recorded:
            submitted = {**submitted, job.recorded: read_recorded_predictions(source, job.allow_missing)}
        return source.tracks(), predictors, submitted


def _score_bag(bag: Path, job: ScoringJob, submitted: Mapping[str, EpisodePredictions]) -> BagResult:
    try:
        record, predictors, submitted = _opened(job, bag, submitted)
        return BagResult(bag, score_episode(str(bag), record, predictors, job.population, submitted, job.noise, bag))
    except SirenError as error:
        return BagResult(bag, None, error)
