"""Films for the sequence model: plan, small pictures of an episode, and the conflicts in its record.

The films of the two splits differ by seed from each other and from every test set. Films are kept in files.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros import __version__
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.lab.training.data_files import MadeFiles, make_files, read_arrays, write_arrays
from siren_ros.running.studies.risk_set.candidate import (
    FRAME_STEPS,
    Candidate,
    candidate_request,
    front_camera,
    simulated,
)
from siren_ros.running.studies.risk_set.search import outcome_as_json, outcome_of_json
from siren_ros.scoring.evaluation.risk.labels import Camera, RiskClass, RiskLabel, RiskThresholds, evidence_of, label_of
from siren_ros.scoring.evaluation.risk.sequence_model import EVERY, SmallFrames, reduced
from siren_ros.sensing.look import load_look
from siren_ros.sensing.rig import SensorRig
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.sensing.suite import SensorSuite
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.scenario.splits import Split
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
