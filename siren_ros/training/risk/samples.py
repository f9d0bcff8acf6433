"""Films for the sequence model: an episode's small pictures and the conflicts of its record, made and kept in files."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros import __version__
from siren_ros.errors import InputError
from siren_ros.evaluation.risk.labels import Camera, RiskLabel, RiskThresholds, evidence_of, label_of
from siren_ros.evaluation.risk.sequence_model import EVERY, SmallFrames, reduced
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.sensors.look import load_look
from siren_ros.sensors.rig import SensorRig
from siren_ros.sensors.suite import SensorSuite
from siren_ros.studies.risk_set.candidate import FRAME_STEPS, Candidate, front_camera, simulated
from siren_ros.studies.risk_set.search import outcome_as_json, outcome_of_json
from siren_ros.training.data_files import MadeFiles, make_files, write_arrays
from siren_ros.training.risk.plan import PlannedFilm

FILM_STEPS: Final = EVERY * FRAME_STEPS
"""From one picture of a film to the next."""
_SIZE: Final = (320, 240)
"""Pictures are drawn at twice the small size and averaged: nearly what is left of the videos' 800 x 600."""


@dataclass(frozen=True)
class Film:
    """All pictures of an episode while the EMV is there."""

    frames: SmallFrames
    episode: Candidate
    """Its label and evidence are the whole episode's; its first step is that of the first picture."""

    def __len__(self) -> int:
        return len(self.frames)

    def step_of(self, frame: int) -> int:
        """Step of the episode at a picture."""
        return self.episode.first_step + frame * FILM_STEPS

    def label_between(self, first_step: int, end_step: int, thresholds: RiskThresholds) -> RiskLabel:
        """The label of a part of the episode."""
        return label_of(self.episode.evidence.within(first_step, end_step), thresholds)


def film_path(folder: Path, planned: PlannedFilm) -> Path:
    """Where a film is kept; another version of the package has another place."""
    return folder / f"films_{__version__}" / f"{planned.name}.npz"


def make_films(
    plan: Sequence[PlannedFilm], folder: Path, jobs: int, done: Callable[[], None]
) -> MadeFiles[PlannedFilm]:
    """Makes the films that have no file yet.

    Args:
        plan: The films.
        folder: Where they are kept.
        jobs: Processes at once.
        done: Called after each film.
    """
    return make_files({planned: film_path(folder, planned) for planned in plan}, _make, jobs, done)


def _make(planned: PlannedFilm, path: Path) -> None:
    request = planned.request
    write_film(path, film_of(request, simulated(request)))


def film_of(request: EpisodeRequest, record: EpisodeRecord) -> Film:
    """The film of a request's record."""
    emv_id, spec = record.emv_ids[0], front_camera()
    small = replace(spec, width=_SIZE[0], height=_SIZE[1], rate_hz=10.0)
    suite = SensorSuite("film", cameras=(small,))
    rig = SensorRig(suite, record.network, record.description.seed, look=load_look(request.look))
    there = record.track(emv_id).step
    first = -(-int(there[0]) // FRAME_STEPS) * FRAME_STEPS
    frames = []
    for row in range(first, int(there[-1]) + 1, FILM_STEPS):
        seen = rig.observe(record.states[row], record.actors, record.traffic[row].signals, emv_id)
        frames.append(reduced(seen.frames[0].rgb))
    evidence = evidence_of(record, emv_id, Camera(spec.mount, spec.horizontal_fov_rad), (0, record.steps))
    return Film(np.stack(frames), Candidate(request, first, label_of(evidence, RiskThresholds()), evidence))


def write_film(path: Path, film: Film) -> None:
    """Writes a file whole or not at all."""
    write_arrays(path, {"episode": np.array(json.dumps(outcome_as_json(film.episode))), "frames": film.frames})


def read_film(path: Path) -> Film:
    """A film that ``write_film`` wrote."""
    with np.load(path) as file:
        episode = outcome_of_json(json.loads(str(file["episode"])))
        frames = file["frames"]
    if not isinstance(episode, Candidate):
        raise InputError("film", str(path), "a film of an episode")
    return Film(frames, episode)
