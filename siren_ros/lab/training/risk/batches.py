"""Training clips of the sequence model, and its operating point from validation clips."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats32
from siren_ros.lab.training.risk.samples import FILM_STEPS, Film
from siren_ros.lab.training.settings import FilmFitConfig
from siren_ros.scoring.evaluation.risk.labels import RiskClass, RiskThresholds
from siren_ros.scoring.evaluation.risk.sequence_model import EVERY, SmallFrames
from siren_ros.scoring.evaluation.risk.tables import PAPER_BALANCE
from siren_ros.scoring.evaluation.risk.video_set import VIDEO_FRAMES

CLIP_FRAMES: Final = VIDEO_FRAMES // EVERY
"""Number of pictures in a clip: those used of a video."""
Severity = npt.NDArray[np.int64]


@dataclass(frozen=True)
class LabelledFilm:
    """A film with the class of each picture."""

    film: Film
    severity: Severity
    """Class of each picture, shape ``(T,)``."""


@dataclass(frozen=True)
class Clip:
    """A part of a film as long as a video, with the classes of its pictures and of the whole."""

    frames: SmallFrames
    severity: Severity
    label: RiskClass


def labelled(film: Film, config: FilmFitConfig) -> LabelledFilm:
    """Label each picture with the class of the moments around it."""
    near = config.near_steps
    steps = [film.step_of(frame) for frame in range(len(film))]
    classes = [film.label_between(step - near, step + near + 1, config.thresholds).risk for step in steps]
    return LabelledFilm(film, np.array(classes, dtype=np.int64))


def clip_of(labelled_film: LabelledFilm, first: int, length: int, thresholds: RiskThresholds) -> Clip:
    """Clip from a first picture; if the film is too short, the last picture is repeated."""
    film = labelled_film.film
    rows = np.minimum(np.arange(first, first + length), len(film) - 1)
    begin = film.step_of(first)
    label = film.label_between(begin, begin + length * FILM_STEPS, thresholds)
    return Clip(film.frames[rows], labelled_film.severity[rows], label.risk)


def drawn_first(labelled_film: LabelledFilm, risk: RiskClass, length: int, random: np.random.Generator) -> int:
    """Random first picture so that the clip has a moment of a class between 10 and 90 % of its length.

    Any if there is none.
    """
    last = max(0, len(labelled_film.film) - length)
    moments = np.flatnonzero(labelled_film.severity == risk)
    if risk is RiskClass.NORMAL or not len(moments):
        return int(random.integers(last + 1))
    at = int(random.choice(moments)) - round(random.uniform(0.1, 0.9) * length)
    return int(np.clip(at, 0, last))


def films_with(films: Sequence[LabelledFilm], risk: RiskClass) -> list[LabelledFilm]:
    """Films with a moment of a class."""
    return [film for film in films if (film.severity == risk).any()]


def validation_clips(films: Sequence[LabelledFilm], thresholds: RiskThresholds) -> list[Clip]:
    """Three clips of each film: beginning, middle and end."""
    clips = []
    for film in films:
        last = max(0, len(film.film) - CLIP_FRAMES)
        clips += [clip_of(film, first, CLIP_FRAMES, thresholds) for first in sorted({0, last // 2, last})]
    return clips


def brightness(frames: SmallFrames, random: np.random.Generator) -> Floats32:
    """The pictures with random contrast and brightness, in 0 … 255."""
    gain, shift = random.uniform(0.75, 1.25), random.uniform(-25.0, 25.0)
    values = (frames.astype(np.float32) - 128.0) * np.float32(gain) + np.float32(128.0 + shift)
    return np.clip(values, 0.0, 255.0)


Logits = npt.NDArray[np.float32]
_STEPS: Final = 40


def operating_point(logits: Logits, labels: npt.NDArray[np.int64]) -> Floats32:
    """Offsets of both logits with the best macro F1 at the paper's class balance, shape ``(2,)``.

    Clips of a class count so that the classes have the paper's shares. Among equally good offsets the middle one is
    taken. ``logits`` of the clips have the shape ``(N, 2)``, their classes ``(N,)``.
    """
    counts = np.bincount(labels, minlength=len(RiskClass))
    weight = np.array(PAPER_BALANCE) / np.maximum(counts, 1)
    shares = (np.arange(_STEPS) + 0.5) / _STEPS
    tried = [np.quantile(logits[:, question].astype(np.float64), shares) for question in range(2)]
    score = np.array([[_macro_f1(logits, labels, weight, (near, hit)) for hit in tried[1]] for near in tried[0]])
    best = np.argwhere(score >= score.max() - 1e-9)
    near, hit = best[np.argsort(np.abs(best - best.mean(axis=0)).sum(axis=1), kind="stable")[0]]
    return np.array([tried[0][near], tried[1][hit]], dtype=np.float32)


def classes_at(logits: Logits, offsets: tuple[float, float]) -> npt.NDArray[np.int64]:
    """Class of each clip: a collision is tested first."""
    near, hit = (logits[:, question] > offsets[question] for question in range(2))
    return np.where(hit, RiskClass.COLLISION, np.where(near, RiskClass.NEAR_MISS, RiskClass.NORMAL)).astype(np.int64)


def _macro_f1(
    logits: Logits, labels: npt.NDArray[np.int64], weight: npt.NDArray[np.float64], offsets: tuple[float, float]
) -> float:
    answers = classes_at(logits, offsets)
    counts = np.zeros((len(RiskClass), len(RiskClass)))
    np.add.at(counts, (labels, answers), weight[labels])
    whole = counts.sum(axis=0) + counts.sum(axis=1)
    return float(np.mean(2.0 * np.diag(counts) / np.maximum(whole, 1e-12)))
