"""One video of the set: made in a process of its own from its candidate, and recognised when it is there already."""

import json
from dataclasses import dataclass
from hashlib import file_digest
from pathlib import Path

from siren_ros.errors import EpisodeError
from siren_ros.evaluation.risk.labels import RiskThresholds
from siren_ros.studies.risk_set.candidate import Candidate, assessed, simulated
from siren_ros.studies.risk_set.journal import outcome_as_json
from siren_ros.studies.risk_set.render import Rendered, render_candidate


@dataclass(frozen=True)
class VideoPlace:
    """Where the files of one video lie."""

    folder: Path
    video_id: str

    @property
    def video(self) -> Path:
        """The MP4 file."""
        return self.folder / "videos" / f"{self.video_id}.mp4"

    @property
    def masks(self) -> Path:
        """The instance masks of its key frames."""
        return self.folder / "masks" / f"{self.video_id}.npz"

    @property
    def note(self) -> Path:
        """What was made, and from what."""
        return self.folder / "search" / "videos" / f"{self.video_id}.json"


def made_before(place: VideoPlace, candidate: Candidate) -> Rendered | None:
    """What the video shows if its files are there, whole, and of this candidate."""
    try:
        note = json.loads(place.note.read_text(encoding="utf-8"))
        if note["candidate"] != outcome_as_json(candidate) or note["sha256"] != _sha256(place):
            return None
        return Rendered(note["frames"], note["most_pixels"])
    except (OSError, ValueError, KeyError):
        return None


def make_video(place: VideoPlace, candidate: Candidate, thresholds: RiskThresholds) -> Rendered:
    """Simulates the candidate again, draws it, and notes what was made.

    Raises:
        EpisodeError: The episode is not the one that was labelled: something differs between the two runs.
    """
    record = simulated(candidate.request)
    again = assessed(candidate.request, record, thresholds)
    if outcome_as_json(again) != outcome_as_json(candidate):
        raise EpisodeError(f"{place.video_id}: simulated again, the episode differs from the one that was labelled")
    for path in (place.video, place.masks, place.note):
        path.parent.mkdir(parents=True, exist_ok=True)
    place.note.unlink(missing_ok=True)
    rendered = render_candidate(candidate, record, place.video, place.masks)
    note = {
        "frames": rendered.frames,
        "most_pixels": rendered.most_pixels,
        "sha256": _sha256(place),
        "candidate": outcome_as_json(candidate),
    }
    partial = place.note.with_suffix(".partial")
    partial.write_text(json.dumps(note) + "\n", encoding="utf-8")
    partial.replace(place.note)
    return rendered


def _sha256(place: VideoPlace) -> dict[str, str]:
    found = {}
    for name, path in (("video", place.video), ("masks", place.masks)):
        with path.open("rb") as file:
            found[name] = file_digest(file, "sha256").hexdigest()
    return found
