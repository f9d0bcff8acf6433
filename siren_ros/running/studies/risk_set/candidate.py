"""One candidate of the search: drawn parameters, episode without sensors, window and label."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, SirenError
from siren_ros.running.generation.closed_loop import closed_loop, record_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.evaluation.risk.labels import (
    Camera,
    Evidence,
    RiskClass,
    RiskLabel,
    RiskThresholds,
    evidence_of,
    label_of,
)
from siren_ros.scoring.evaluation.risk.video_set import VIDEO_FRAMES
from siren_ros.scoring.judging.surrogate_safety import encounters_of
from siren_ros.sensing.specification import CameraSpec
from siren_ros.sensing.suite import EXPORTED_CAMERA, load_suite
from siren_ros.simulation.scenario.episode import EpisodeRequest, text_of_values
from siren_ros.simulation.scenario.templates import Template


@dataclass(frozen=True)
class Leaning:
    """Part of each parameter's range from which values are drawn, as shares of the range."""

    presets: tuple[str, ...]
    shares: Mapping[str, tuple[float, float]]


_RISKY: Final[Mapping[str, tuple[float, float]]] = {
    "emv.speed_mps": (0.5, 1.0),
    "demand.speed_factor": (0.5, 1.0),
    "demand.background_vehicles": (0.5, 1.0),
    "response.response_distance_m": (0.0, 0.5),
    "response.extra_delay_s": (0.5, 1.0),
    "response.compliance": (0.0, 0.5),
}
"""Parts of ranges with more risk: faster, denser, later, and with fewer drivers that comply."""

LEANINGS: Final[Mapping[RiskClass, Leaning]] = {
    RiskClass.NORMAL: Leaning(("paper", "realistic"), {}),
    RiskClass.NEAR_MISS: Leaning(("realistic", "inattentive"), {**_RISKY, "emv.speed_mps": (0.3, 1.0)}),
    RiskClass.COLLISION: Leaning(("reckless",), _RISKY),
}
"""What the search for each class draws from. Only the label decides an episode's class."""


def candidate_request(
    template: Template, name: str, looking_for: RiskClass, seed: int, number: int, map_file: str
) -> EpisodeRequest:
    """Request of a candidate. It depends only on the search's seed, the template's ranges and its number.

    ``name`` is the user's name for the template, ``looking_for`` the class that the search lacks most. An empty map is
    the town.
    """
    rng = random_stream(seed, f"risk_set/{template.template_id}", number)
    leaning = LEANINGS[looking_for]
    preset = leaning.presets[int(rng.integers(len(leaning.presets)))]
    values = {}
    for path, (low, high) in sorted(leaning.shares.items()):
        limits = template.ranges.get(path)
        if limits is None:
            continue
        value = limits.minimum + float(rng.uniform(low, high)) * (limits.maximum - limits.minimum)
        values[path] = float(np.round(value)) if limits.integer else round(value, 3)
    episode_seed, text = int(rng.integers(2**31 - 1)), text_of_values(values)
    return EpisodeRequest(name, "", episode_seed, map_file, preset=preset, sensors="none", values=text)


FRAME_STEPS: Final = round(0.1 / STEP_S)
"""Steps between frames, at 10 Hz."""
WINDOW_STEPS: Final = VIDEO_FRAMES * FRAME_STEPS
_MOMENT_AT: Final = (0.4, 0.8)
"""Range, as shares of the video, in which the decisive moment is placed at random, so that its time tells nothing about
the class."""


@dataclass(frozen=True)
class Candidate:
    """A candidate that can become a video."""

    request: EpisodeRequest
    first_step: int
    label: RiskLabel
    evidence: Evidence


@dataclass(frozen=True)
class Rejected:
    """A candidate that cannot become a video, with the reason."""

    request: EpisodeRequest
    reason: str


def front_camera() -> CameraSpec:
    """The paper's front camera, which records the videos."""
    return next(camera for camera in load_suite("front").cameras if camera.name == EXPORTED_CAMERA)


def simulated_or_rejected(request: EpisodeRequest) -> EpisodeRecord | Rejected:
    """As ``simulated``, or the reason why the episode failed; InputError if the request cannot be used."""
    try:
        return simulated(request)
    except InputError:
        raise
    except SirenError as error:
        return Rejected(request, str(error))


def simulated(request: EpisodeRequest) -> EpisodeRecord:
    """Record of a request's episode, without sensors; EpisodeError if it failed."""
    setup = set_up_episode(request)
    return record_of(setup, list(closed_loop(setup, setup.steps)))


def seen_by_most_at_risk(record: EpisodeRecord, thresholds: RiskThresholds) -> EpisodeRecord:
    """The record with that EMV first whose camera saw the most severe conflict, or the earliest of equal ones.

    EMVs that are there for less than a video do not count, unless all are.
    """
    if len(record.emv_ids) < 2:
        return record

    def rank(seen: EpisodeRecord) -> tuple[bool, int, int]:
        label = label_of(evidence_of(seen, seen.emv_ids[0], _camera(), (0, seen.steps)), thresholds)
        return not _lasts(seen), -label.risk, label.step

    return min((seen for seen in record.by_emv() if len(seen.track(seen.emv_ids[0]))), key=rank, default=record)


def _lasts(record: EpisodeRecord) -> bool:
    """Whether the first EMV is present long enough for a video."""
    steps = record.track(record.emv_ids[0]).step
    return len(steps) > 0 and bool(steps[-1] - steps[0] + 1 >= WINDOW_STEPS)


def _camera() -> Camera:
    spec = front_camera()
    return Camera(spec.mount, spec.horizontal_fov_rad)


def assessed(request: EpisodeRequest, record: EpisodeRecord, thresholds: RiskThresholds) -> Candidate | Rejected:
    """Choose the window of a record, seen by its first EMV's camera, and label it."""
    emv_id, camera = record.emv_ids[0], _camera()
    if not _lasts(record):
        return Rejected(request, f"the EMV is there for less than {VIDEO_FRAMES} frames")
    steps = record.track(emv_id).step
    label = label_of(evidence_of(record, emv_id, camera, (0, record.steps)), thresholds)
    moment = label.step if label.risk is not RiskClass.NORMAL else _closest_step(record, emv_id)
    first = window_start(moment, int(steps[0]), int(steps[-1]) + 1, request.seed)
    evidence = evidence_of(record, emv_id, camera, (first, first + WINDOW_STEPS))
    return Candidate(request, first, label_of(evidence, thresholds), evidence)


def window_start(moment: int, begin: int, end: int, seed: int) -> int:
    """First step of the window: on the frame grid, in ``begin … end``, with the moment at a drawn position."""
    share = random_stream(seed, "risk_set/window").uniform(*_MOMENT_AT)
    first = moment - round(share * WINDOW_STEPS)
    lowest = -(-begin // FRAME_STEPS) * FRAME_STEPS
    highest = (end - WINDOW_STEPS) // FRAME_STEPS * FRAME_STEPS
    return max(lowest, min(highest, first // FRAME_STEPS * FRAME_STEPS))


def _closest_step(record: EpisodeRecord, emv_id: int) -> int:
    """Step at which the moving EMV was closest to another vehicle's centre; the middle of its time without others."""
    pairs = encounters_of(record, emv_id)
    moving = pairs.subject.speed_mps > 1.0
    if not moving.any():
        steps = record.track(emv_id).step
        return int(steps[len(steps) // 2])
    distance = np.hypot(pairs.subject.x_m - pairs.other.x_m, pairs.subject.y_m - pairs.other.y_m)
    return int(pairs.step[moving][np.argmin(distance[moving])])
