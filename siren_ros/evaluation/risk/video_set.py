"""A folder of risk videos: what each video is, its label, and what the label was derived from."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from os.path import relpath
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.errors import InputError, whole_file
from siren_ros.evaluation.risk.evidence import Evidence, Moments, SeenContact, SeenEncroachment
from siren_ros.evaluation.risk.labels import Reason, RiskLabel, RiskThresholds, label_of, risk_class

VIDEO_FRAMES: Final = 190
"""Of each video, at 10 Hz (paper, "Risk understanding")."""
SET_FILE: Final = "videos.json"
EVIDENCE_FILE: Final = "evidence.parquet"
_MOMENT_COLUMNS: Final = {
    "step": np.int64,
    "actor_id": np.uint32,
    "time_to_collision_s": np.float64,
    "closing_mps": np.float64,
    "required_deceleration_mps2": np.float64,
    "gap_m": np.float64,
}

_SHARED: Final = ("template", "file", "frames", "first_step")
"""Fields of a video that its file has under the same names."""


@dataclass(frozen=True)
class RiskVideo:
    """One video of a set."""

    video_id: str
    """Such as ``S4_007``; unique in the set."""
    template: str
    file: str
    """Path of the MP4 file, relative to the set's folder."""
    frames: int
    first_step: int
    """Step of the episode at the first frame."""
    label: RiskLabel
    evidence: Evidence
    request: Mapping[str, Any]
    """What the episode was made from, so that it can be made again."""


@dataclass(frozen=True)
class VideoSet:
    """The videos of a folder, by id, and the thresholds of their labels."""

    folder: Path
    videos: Mapping[str, RiskVideo]
    thresholds: RiskThresholds

    def moved(self, folder: Path) -> "VideoSet":
        """The set's files in another folder, with the videos where they are."""
        videos = {
            key: replace(video, file=Path(relpath(self.folder / video.file, folder)).as_posix())
            for key, video in self.videos.items()
        }
        return replace(self, folder=folder, videos=videos)

    def relabelled(self, thresholds: RiskThresholds) -> "VideoSet":
        """The same videos with the labels that other thresholds give."""
        videos = {key: replace(video, label=label_of(video.evidence, thresholds)) for key, video in self.videos.items()}
        return replace(self, videos=videos, thresholds=thresholds)


def write_set(videos: VideoSet) -> None:
    """Writes the set's two files into its folder, which holds the MP4 files."""
    content = {
        "thresholds": asdict(videos.thresholds),
        "videos": [_as_json(video) for _, video in sorted(videos.videos.items())],
    }
    with whole_file(videos.folder / SET_FILE) as file:
        file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    with whole_file(videos.folder / EVIDENCE_FILE) as file:
        pq.write_table(_evidence_table(list(videos.videos.values())), file)


def read_set(folder: Path) -> VideoSet:
    """Reads a set.

    Raises:
        InputError: No set in the folder, files that do not belong together, or a value that is not known.
    """
    allowed = f"a folder that `siren generate risk` made, with {SET_FILE} and {EVIDENCE_FILE}"
    try:
        content = json.loads(folder.joinpath(SET_FILE).read_text(encoding="utf-8"))
        moments = _moments_by_video(pq.read_table(folder / EVIDENCE_FILE))
        # Sets of earlier versions have the speed from which on a contact was a collision.
        known = {name: value for name, value in content["thresholds"].items() if name != "impact_mps"}
        thresholds = RiskThresholds(**known)
        videos = [_video(entry, moments.get(entry["id"], _moments({}))) for entry in content["videos"]]
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
        raise InputError("set", str(folder), f"{allowed} ({error})") from error
    return VideoSet(folder, {video.video_id: video for video in videos}, thresholds)


def missing_files(videos: VideoSet) -> tuple[str, ...]:
    """Videos of a set whose file is not there."""
    return tuple(key for key, video in videos.videos.items() if not (videos.folder / video.file).is_file())


def _as_json(video: RiskVideo) -> dict[str, Any]:
    label = asdict(video.label) | {"risk": video.label.risk.title}
    return {
        "id": video.video_id,
        **{name: getattr(video, name) for name in _SHARED},
        "label": label,
        "encroachments": [asdict(one) for one in video.evidence.encroachments],
        "contacts": [asdict(one) for one in video.evidence.contacts],
        "request": dict(video.request),
    }


def _video(entry: Mapping[str, Any], moments: Moments) -> RiskVideo:
    label = dict(entry["label"])
    risk, reason = risk_class(label.pop("risk")), Reason(label.pop("reason"))
    evidence = Evidence(
        moments,
        tuple(SeenEncroachment(**one) for one in entry["encroachments"]),
        tuple(SeenContact(**one) for one in entry["contacts"]),
    )
    shared = {name: entry[name] for name in (*_SHARED, "request")}
    return RiskVideo(video_id=entry["id"], label=RiskLabel(risk, reason, **label), evidence=evidence, **shared)


def _evidence_table(videos: Sequence[RiskVideo]) -> pa.Table:
    columns: dict[str, Any] = {
        "video": pa.array([video.video_id for video in videos for _ in range(len(video.evidence.moments))], pa.string())
    }
    for name, dtype in _MOMENT_COLUMNS.items():
        parts = [np.asarray(getattr(video.evidence.moments, name), dtype) for video in videos]
        columns[name] = np.concatenate([np.empty(0, dtype), *parts])
    return pa.table(columns)


def _moments_by_video(table: pa.Table) -> dict[str, Moments]:
    names = np.array(table["video"].to_pylist(), dtype=object)
    columns = {name: table[name].to_numpy() for name in _MOMENT_COLUMNS}
    return {
        str(name): _moments({key: values[names == name] for key, values in columns.items()})
        for name in np.unique(names)
    }


def _moments(columns: Mapping[str, Any]) -> Moments:
    return Moments(**{name: np.asarray(columns.get(name, ()), dtype) for name, dtype in _MOMENT_COLUMNS.items()})
