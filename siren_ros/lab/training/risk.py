"""The complete training of the sequence model of risk: films, training clips, figures, files.

A film has small pictures of an episode and the conflicts in its record. The films of the two splits differ by seed from
each other and from every test set. Films are kept in files. Validation clips give the operating point.
"""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros import __version__
from siren_ros.base.numerics.arrays import Floats32
from siren_ros.base.params.plain_files import write_network
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.lab.training.data_files import MadeFiles, make_files, read_arrays, write_arrays
from siren_ros.lab.training.settings import FilmFitConfig, FittedNetwork
from siren_ros.running.generation.closed_loop import simulated
from siren_ros.running.studies.risk_set.candidate import (
    FRAME_STEPS,
    Candidate,
    candidate_request,
    front_camera,
    outcome_as_json,
    outcome_of_json,
)
from siren_ros.scoring.evaluation.risk.labels import (
    TITLES,
    Camera,
    RiskClass,
    RiskLabel,
    RiskThresholds,
    evidence_of,
    label_of,
)
from siren_ros.scoring.evaluation.risk.report import PAPER_BALANCE
from siren_ros.scoring.evaluation.risk.scoring import accuracy, confusion, macro_f1
from siren_ros.scoring.evaluation.risk.sequence_model import (
    EVERY,
    FRAMES_VERSION,
    SequenceModel,
    SmallFrames,
    load_sequence_model,
    reduced,
)
from siren_ros.scoring.evaluation.risk.video_set import VIDEO_FRAMES
from siren_ros.sensing.look import load_look
from siren_ros.sensing.rig import SensorRig
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.sensing.suite import SensorSuite
from siren_ros.simulation.scenario.episode import EpisodeIdentity, EpisodeRequest, Split
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.scenario.templates import load_template

FIRST_SEED: Final = {Split.TRAIN: 500, Split.VAL: 900}
"""First seed of the draws in each split; ``siren generate risk`` uses seed 0 by default."""
_LOOKS_FOR: Final = (RiskClass.NORMAL, RiskClass.NEAR_MISS, RiskClass.COLLISION, RiskClass.COLLISION)
_COLLISIONS_IN: Final = "S4"
"""Template with most collisions; additional films of it search for collisions only."""
_FURTHER: Final = 1000
"""Number from which the additional films are counted."""


@dataclass(frozen=True)
class PlannedFilm:
    """One planned film."""

    split: Split
    template: str
    number: int

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.split.value}_{self.template}_{self.number:03d}"

    @property
    def request(self) -> EpisodeRequest:
        """Its request, drawn like the candidates of a search, with each class in turn."""
        turn = _LOOKS_FOR[self.number % len(_LOOKS_FOR)]
        looking_for = RiskClass.COLLISION if self.number >= _FURTHER else turn
        template = load_template(self.template)
        return candidate_request(template, self.template, looking_for, FIRST_SEED[self.split], self.number, "")


@dataclass(frozen=True)
class FilmPlanSize:
    """Number of films per template."""

    train: int = 4
    validation: int = 4


def plan_films(size: FilmPlanSize, templates: Sequence[str] = TEMPLATES) -> tuple[PlannedFilm, ...]:
    """Plan all films, in an order whose beginning already has all templates, classes and both splits.

    As many films as each template has are added for the template with most collisions.
    """
    films = []
    for number in range(max(size.train, size.validation)):
        for split, count in ((Split.TRAIN, size.train), (Split.VAL, size.validation)):
            if number < count:
                films += [PlannedFilm(split, template, number) for template in templates]
                films.append(PlannedFilm(split, _COLLISIONS_IN, _FURTHER + number))
    return tuple(films)


FILM_STEPS: Final = EVERY * FRAME_STEPS
"""Steps between pictures of a film."""
_SIZE: Final = (320, 240)
"""Size of drawn pictures: twice the small size, then averaged; about what remains of the videos' 800 x 600."""


@dataclass(frozen=True)
class Film:
    """All pictures of an episode while the EMV is present."""

    frames: SmallFrames
    episode: Candidate
    """The episode with label and evidence for its whole length; its first step is that of the first picture."""

    def __len__(self) -> int:
        return len(self.frames)

    def step_of(self, frame: int) -> int:
        """Step of the episode at a picture."""
        return self.episode.first_step + frame * FILM_STEPS

    def label_between(self, first_step: int, end_step: int, thresholds: RiskThresholds) -> RiskLabel:
        """Label of a part of the episode."""
        return label_of(self.episode.evidence.within(first_step, end_step), thresholds)


def film_path(folder: Path, planned: PlannedFilm) -> Path:
    """Path of a film's file; it differs between versions of the package."""
    return folder / f"films_{__version__}" / f"{planned.name}.npz"


def make_films(
    plan: Sequence[PlannedFilm], folder: Path, jobs: int, done: Callable[[], None]
) -> MadeFiles[PlannedFilm]:
    """Make the films that have no file; arguments as of ``make_files``."""
    return make_files({planned: film_path(folder, planned) for planned in plan}, _make, jobs, done)


def _make(planned: PlannedFilm, path: Path) -> None:
    request = planned.request
    write_film(path, film_of(request, simulated(request)))


def film_of(request: EpisodeRequest, record: EpisodeRecord) -> Film:
    """Film of a request's record."""
    emv_id, spec = record.emv_ids[0], front_camera()
    suite = SensorSuite("film", cameras=(replace(spec, width=_SIZE[0], height=_SIZE[1], rate_hz=10.0),))
    config = scene_config_of(record.description.template_values)
    rig = SensorRig(suite, record.network, record.description.seed, config, look=load_look(request.look))
    there = record.track(emv_id).step
    first = -(-int(there[0]) // FRAME_STEPS) * FRAME_STEPS
    frames = []
    for row in range(first, int(there[-1]) + 1, FILM_STEPS):
        seen = rig.observe(record.states[row], record.actors, record.traffic[row].signals, emv_id)
        frames.append(reduced(seen.frames[0].rgb))
    evidence = evidence_of(record, emv_id, Camera(spec.mount, spec.horizontal_fov_rad), (0, record.steps))
    return Film(np.stack(frames), Candidate(request, first, label_of(evidence, RiskThresholds()), evidence))


def write_film(path: Path, film: Film) -> None:
    """Write a file completely or not at all."""
    write_arrays(path, {"episode": np.array(json.dumps(outcome_as_json(film.episode))), "frames": film.frames})


def read_film(path: Path) -> Film:
    """Read a file of ``write_film``."""
    about, arrays = read_arrays(path, "episode")
    episode = outcome_of_json(about)
    if not isinstance(episode, Candidate):
        raise InputError("film", str(path), "a film of an episode")
    return Film(arrays["frames"], episode)


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


Fitter = Callable[[Sequence[LabelledFilm], Sequence[LabelledFilm], FilmFitConfig, Callable[[str], None]], FittedNetwork]


def train_sequence_model(
    films: MadeFiles[PlannedFilm], path: Path, config: FilmFitConfig, fitter: Fitter, report: Callable[[str], None]
) -> SequenceModel:
    """Train the model on the films of both splits, and write it as an ONNX file with its card.

    ``report`` is called with lines on the progress.

    Raises:
        InputError: No film of a split, or the folder cannot be written.
    """
    splits = {
        split: [labelled(read_film(file), config) for planned, file in films.files if planned.split is split]
        for split in (Split.TRAIN, Split.VAL)
    }
    for split, part in splits.items():
        if not part:
            raise InputError("films", split.value, "at least one that could be made")
        report(f"{split.value}: {len(part)} films, pictures of {' / '.join(TITLES)}: {_pictures(part)}")
    wall, processor = time.monotonic(), time.process_time()
    fitted = fitter(splits[Split.TRAIN], splits[Split.VAL], config, report)
    card = fitted.card(config, model="sequence", task="risk", frames_version=FRAMES_VERSION)
    card["films"] = {split.value: _split_json(part, films, split) for split, part in splits.items()}
    card["data"] = {split.value: {"keys": _keys(films, split)} for split in splits}
    card["fitting_wall_s"] = round(time.monotonic() - wall)
    card["fitting_processor_s"] = round(time.process_time() - processor)
    write_network(path, fitted.onnx, card)
    model = load_sequence_model(path)
    card["validation"] = _figures(model, splits[Split.VAL], config)
    write_network(path, fitted.onnx, card)
    return load_sequence_model(path)


def _pictures(films: Sequence[LabelledFilm]) -> list[int]:
    counts: list[int] = np.bincount(
        np.concatenate([film.severity for film in films]), minlength=len(RiskClass)
    ).tolist()
    return counts


def _keys(films: MadeFiles[PlannedFilm], split: Split) -> list[str]:
    requests = [planned.request for planned, _ in films.files if planned.split is split]
    return sorted(EpisodeIdentity.of_request(request).text for request in requests)


def _split_json(part: Sequence[LabelledFilm], films: MadeFiles[PlannedFilm], split: Split) -> dict[str, Any]:
    episodes = [labelled_film.film.episode.label.risk for labelled_film in part]
    return {
        "films": len(part),
        "seed": FIRST_SEED[split],
        "episodes": [episodes.count(risk) for risk in RiskClass],
        "pictures": _pictures(part),
        "left_out": sorted(f"{planned.name}: {why}" for planned, why in films.missing if planned.split is split),
    }


def _figures(model: SequenceModel, films: Sequence[LabelledFilm], config: FilmFitConfig) -> dict[str, Any]:
    """Figures on the clips that decided the operating point; they are better than those of a test set."""
    clips = validation_clips(films, config.thresholds)
    counts = confusion([clip.label for clip in clips], [model.answer(clip.frames) for clip in clips])
    return {
        "clips": len(clips),
        "confusion": counts[:, : len(RiskClass)].tolist(),
        "accuracy": round(accuracy(counts).value, 4),
        "macro_f1": round(macro_f1(counts).value, 4),
    }
