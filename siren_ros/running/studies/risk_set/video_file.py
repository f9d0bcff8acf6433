"""One video of the set: recorded from its candidate with masks of key frames, and reused if it exists."""

import json
from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.params import plain_json
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EpisodeError
from siren_ros.running.studies.risk_set.candidate import (
    FRAME_STEPS,
    Candidate,
    Rejected,
    assessed,
    front_camera,
    seen_by_most_at_risk,
    simulated_or_rejected,
)
from siren_ros.running.studies.risk_set.search import outcome_as_json
from siren_ros.running.studies.study_folder import sha256_of_file
from siren_ros.scoring.evaluation.risk.labels import RiskClass, RiskThresholds
from siren_ros.scoring.evaluation.risk.video_set import VIDEO_FRAMES, key_frames
from siren_ros.scoring.pictures.video import write_video
from siren_ros.sensing.look import load_look
from siren_ros.sensing.rig import SensorRig
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.sensing.suite import SensorSuite
from siren_ros.simulation.scenario.episode import EpisodeRequest

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
        note = plain_json.read(place.note)
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
