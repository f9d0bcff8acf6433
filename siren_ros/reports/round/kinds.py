"""The kinds of rounds by their names: what an episode asks, what a submission is, and how it is judged."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.reports.round import detection, driving, prediction
from siren_ros.reports.round.prediction import Limits
from siren_ros.reports.round.sealed_round import COMMAND_FILE
from siren_ros.running.seat.drivers.drivers import DRIVERS
from siren_ros.running.studies.matrix import Study
from siren_ros.scoring.evaluation.detection.detectors import DETECTORS
from siren_ros.scoring.evaluation.prediction.predictors import PREDICTORS
from siren_ros.scoring.evaluation.prediction.questions import Content
from siren_ros.scoring.evaluation.statistics import BlockSums
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES

PREDICTION: Final = "prediction"
Judge = Callable[[Path], tuple[BlockSums, str, Content]]


@dataclass(frozen=True)
class Kind:
    """A kind of rounds."""

    question: Callable[[str, EpisodeRequest, EpisodeRecord, Path, Path], Content]
    """What is asked of an episode, by name, request, record and bag; the folder gets what else participants need."""
    answer: Callable[[Path, str, Path], int]
    """Answers the public part of a round with a model, into a file."""
    take: Callable[[Path, Path, Path, Content, Limits], Path]
    """Makes the answers of a submission, at a path that it completes; with the private part and the plan."""
    judge: Callable[[Content, Path, Path], tuple[Judge, Content]]
    """By plan, folder of the salt and bags: gives the scores of answers, why they are flagged, and what else is told of
    them; and what is told of all."""
    names: tuple[str, str]
    """Title, and name of the score."""
    models: tuple[str, ...]
    """Models of the project that can answer."""
    suffixes: tuple[str, ...]
    """Suffixes of submissions that are files."""
    study: Study
    """Episodes of a round, unless the organiser names others."""
    holds: str = COMMAND_FILE
    """Pattern of a file in submissions that are folders."""
    less_is_better: bool = True
    forged: Callable[[Content, Path, Sequence[Path]], list[str]] = lambda *_: []
    """What in answers does not follow from the salt."""
    rules: Callable[[str], Content] = lambda _: {}
    """What everybody is told of the rules, by the rulebook's name."""


_SHORT: Final = Study(("S2", "S3", "S4"), seeds=(0, 1))
KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {
        PREDICTION: Kind(
            question=prediction.question,
            answer=prediction.answer,
            take=prediction.take,
            judge=prediction.judge,
            names=("trajectory prediction", "ADE in metres"),
            models=tuple(PREDICTORS),
            suffixes=(".parquet",),
            study=_SHORT,
        ),
        "detection": Kind(
            question=detection.question,
            answer=detection.answer,
            take=detection.take,
            judge=detection.judge,
            names=("3-D detection", "mAP of episodes"),
            models=tuple(DETECTORS),
            suffixes=(".json", ".pkl", ".npz"),
            study=replace(_SHORT, sensors="front"),
            holds="*.txt",
            less_is_better=False,
        ),
        "exam": Kind(
            question=driving.question,
            answer=driving.answer,
            take=driving.take,
            judge=driving.judge,
            names=("exam for drivers", "violated clauses"),
            models=tuple(DRIVERS),
            suffixes=(driving.NAME_SUFFIX, ".onnx"),
            study=Study(TEMPLATES, levels=("L2", "L3"), seeds=tuple(range(20))),
            forged=driving.forged,
            rules=driving.rules,
        ),
    }
)
