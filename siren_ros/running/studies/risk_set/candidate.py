"""One candidate of the search for risk videos, from its parameters to its video.

An episode without sensors gives its window and label. Its video is recorded with masks of key frames, and reused if it
exists.
"""

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params import plain_files
from siren_ros.base.params.plain_files import sha256_of_file
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EpisodeError, InputError, SirenError
from siren_ros.running.generation.closed_loop import simulated
from siren_ros.scoring.evaluation.risk.labels import (
    Camera,
    Evidence,
    Moments,
    Reason,
    RiskClass,
    RiskLabel,
    RiskThresholds,
    SeenContact,
    SeenEncroachment,
    evidence_of,
    label_of,
    risk_class,
)
from siren_ros.scoring.evaluation.risk.video_set import VIDEO_FRAMES, key_frames
from siren_ros.scoring.judging.surrogate_safety import encounters_of
from siren_ros.scoring.pictures.video import write_video
from siren_ros.sensing.look import load_look
from siren_ros.sensing.rig import SensorRig
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.sensing.specification import CameraSpec
from siren_ros.sensing.suite import EXPORTED_CAMERA, SensorSuite, load_suite
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


Outcome = Candidate | Rejected


def outcome_as_json(outcome: Outcome) -> dict[str, Any]:
    """An outcome as JSON types."""
    request = outcome.request.to_json()
    if isinstance(outcome, Rejected):
        return {"request": request, "rejected": outcome.reason}
    evidence = outcome.evidence
    return {
        "request": request,
        "first_step": outcome.first_step,
        "label": {**asdict(outcome.label), "risk": outcome.label.risk.title},
        "moments": {field.name: getattr(evidence.moments, field.name).tolist() for field in fields(Moments)},
        "encroachments": [asdict(encroachment) for encroachment in evidence.encroachments],
        "contacts": [asdict(contact) for contact in evidence.contacts],
    }


def outcome_of_json(entry: Mapping[str, Any]) -> Outcome:
    """Inverse of ``outcome_as_json``."""
    request = EpisodeRequest(**entry["request"])
    if "rejected" in entry:
        return Rejected(request, entry["rejected"])
    label = dict(entry["label"])
    kinds = {"step": np.int64, "actor_id": np.uint32}
    names = [field.name for field in fields(Moments)]
    moments = Moments(*(np.array(entry["moments"][name], kinds.get(name, np.float64)) for name in names))
    encroachments = tuple(SeenEncroachment(**part) for part in entry["encroachments"])
    evidence = Evidence(moments, encroachments, tuple(SeenContact(**part) for part in entry["contacts"]))
    risk_label = RiskLabel(risk_class(label.pop("risk")), Reason(label.pop("reason")), **label)
    return Candidate(request, entry["first_step"], risk_label, evidence)


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


SEEN_PIXELS: Final = 60
"""A vehicle with at least this many pixels (about 10 by 6) is visible."""


@dataclass(frozen=True)
class Rendered:
    """What a video shows."""

    frames: int
    most_pixels: int
    """Largest number of pixels of the vehicle that decided the label, in any frame until the moment; 0 without one."""


def render_candidate(candidate: Candidate, record: EpisodeRecord, video: Path, masks: Path) -> Rendered:
    """Record the window of a candidate's episode as an MP4 file.

    The compressed numpy file ``masks`` gets for each key frame the actor of each pixel, 0 off vehicles, in an array
    ``frame_000`` of shape ``(height, width)``.
    """
    most, kept = [0], dict[str, npt.NDArray[np.uint32]]()
    key_numbers = set(key_frames(VIDEO_FRAMES))

    def frames() -> Iterator[npt.NDArray[np.uint8]]:
        for number, (rgb, actors, step) in enumerate(_pictures(candidate, record)):
            if candidate.label.actor_id and step <= candidate.label.step:
                most[0] = max(most[0], int(np.count_nonzero(actors == candidate.label.actor_id)))
            if number in key_numbers:
                kept[f"frame_{number:03d}"] = actors
            yield rgb

    count = write_video(video, frames())
    masks.parent.mkdir(parents=True, exist_ok=True)
    with masks.open("wb") as file:
        np.savez_compressed(file, **kept)
    return Rendered(count, most[0])


def _pictures(
    candidate: Candidate, record: EpisodeRecord
) -> Iterator[tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint32], int]]:
    """Colours, actors and step of each frame."""
    camera = replace(front_camera(), instance=True, rate_hz=10.0)
    suite = SensorSuite("risk", cameras=(camera,))
    config = scene_config_of(record.description.template_values)
    rig = SensorRig(suite, record.network, record.description.seed, config, look=load_look(candidate.request.look))
    for row in range(candidate.first_step, candidate.first_step + VIDEO_FRAMES * FRAME_STEPS, FRAME_STEPS):
        seen = rig.observe(record.states[row], record.actors, record.traffic[row].signals, record.emv_ids[0])
        frame = seen.frames[0]
        actors = frame.image.instance
        if actors is None:
            raise AssertionError("a camera with instance labels made none")
        yield frame.rgb, actors.copy(), record.states[row].step


UNSEEN: Final = "the camera does not see the vehicle that decides the label"


@dataclass(frozen=True)
class VideoPlace:
    """Paths of the files of one video."""

    folder: Path
    video_id: str

    @property
    def video(self) -> Path:
        """The MP4 file."""
        return self.folder / "videos" / f"{self.video_id}.mp4"

    @property
    def masks(self) -> Path:
        """The file of instance masks of key frames."""
        return self.folder / "masks" / f"{self.video_id}.npz"

    @property
    def note(self) -> Path:
        """The file that tells what was made from which candidate."""
        return self.folder / "search" / "videos" / f"{self.video_id}.json"


def made_before(place: VideoPlace, candidate: Candidate) -> Rendered | None:
    """Content of an existing video, if its files are complete and belong to this candidate."""
    try:
        note = plain_files.read_json(place.note)
        if note["candidate"] != outcome_as_json(candidate) or note["sha256"] != _sha256(place):
            return None
        return Rendered(note["frames"], note["most_pixels"])
    except (OSError, ValueError, KeyError):
        return None


def is_seen(candidate: Candidate, rendered: Rendered) -> bool:
    """Whether the pictures show the vehicle that decided the label; normal videos have none."""
    return candidate.label.risk is RiskClass.NORMAL or rendered.most_pixels >= SEEN_PIXELS


def try_candidate(
    request: EpisodeRequest, thresholds: RiskThresholds, place: VideoPlace, drawn: frozenset[RiskClass]
) -> Candidate | Rejected:
    """Simulate and label a candidate, and record it at once if its class still needs videos (``drawn``).

    Raises:
        InputError: The request cannot be used.
    """
    record = simulated_or_rejected(request)
    if isinstance(record, Rejected):
        return record
    record = seen_by_most_at_risk(record, thresholds)
    outcome = assessed(request, record, thresholds)
    if isinstance(outcome, Rejected) or outcome.label.risk not in drawn:
        return outcome
    rendered = made_before(place, outcome) or _draw(place, outcome, record)
    return outcome if is_seen(outcome, rendered) else Rejected(request, UNSEEN)


def make_video(place: VideoPlace, candidate: Candidate, thresholds: RiskThresholds) -> Rendered:
    """Simulate the candidate again, record it, and note what was made.

    Raises:
        EpisodeError: The episode is not the one that was labelled: something differs between the two runs.
    """
    record = simulated_or_rejected(candidate.request)
    again: Candidate | Rejected
    if isinstance(record, Rejected):
        again = record
    else:
        record = seen_by_most_at_risk(record, thresholds)
        again = assessed(candidate.request, record, thresholds)
    if isinstance(record, Rejected) or outcome_as_json(again) != outcome_as_json(candidate):
        raise EpisodeError(f"{place.video_id}: simulated again, the episode differs from the one that was labelled")
    return _draw(place, candidate, record)


def remove_others(folder: Path, kept: Collection[str]) -> None:
    """Delete files of videos that do not belong to the set, and incomplete files of killed processes.

    They were drawn before another template took over their share. Nothing may be drawn at the same time.
    """
    for note in sorted((folder / "search" / "videos").glob("*.json")):
        if note.stem not in kept:
            place = VideoPlace(folder, note.stem)
            for path in (place.note, place.video, place.masks):
                path.unlink(missing_ok=True)
    for kind in ("videos", "masks"):
        for path in sorted((folder / kind).glob(".*")):
            path.unlink(missing_ok=True)


def _draw(place: VideoPlace, candidate: Candidate, record: EpisodeRecord) -> Rendered:
    for path in (place.video, place.masks, place.note):
        path.parent.mkdir(parents=True, exist_ok=True)
    place.note.unlink(missing_ok=True)
    rendered = render_candidate(candidate, record, place.video, place.masks)
    note = {**asdict(rendered), "sha256": _sha256(place), "candidate": outcome_as_json(candidate)}
    partial = place.note.with_suffix(".partial")
    partial.write_text(json.dumps(note) + "\n", encoding="utf-8")
    partial.replace(place.note)
    return rendered


def _sha256(place: VideoPlace) -> dict[str, str]:
    return {"video": sha256_of_file(place.video), "masks": sha256_of_file(place.masks)}
