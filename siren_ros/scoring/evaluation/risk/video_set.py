"""A folder of risk videos: each video with its label and the label's evidence; frames of video files."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from os.path import relpath
from pathlib import Path
from typing import Any, Final

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.base.params import plain_files
from siren_ros.errors import InputError, whole_file
from siren_ros.scoring.evaluation.risk.labels import (
    DEFINITIONS,
    Evidence,
    Moments,
    Reason,
    RiskClass,
    RiskLabel,
    RiskThresholds,
    SeenContact,
    SeenEncroachment,
    label_of,
    risk_class,
)

VIDEO_FRAMES: Final = 190
"""Number of frames of a video, at 10 Hz (paper, "Risk understanding")."""
SET_FILE: Final = "videos.json"
EVIDENCE_FILE: Final = "evidence.parquet"
_MOMENT_COLUMNS: Final = {
    "step": np.int64,
    "actor_id": np.uint32,
    "time_to_collision_s": np.float64,
    "closing_mps": np.float64,
    "required_deceleration_mps2": np.float64,
    "gap_m": np.float64,
    "braked_mps2": np.float64,
}

_SHARED: Final = ("template", "file", "frames", "first_step")
"""Fields of a video that have the same names in the set's file."""


@dataclass(frozen=True)
class RiskVideo:
    """One video of a set."""

    video_id: str
    """Id such as ``S4_007``, unique in the set."""
    template: str
    file: str
    """Path of the MP4 file, relative to the set's folder."""
    frames: int
    first_step: int
    """Step of the episode at the video's first frame."""
    label: RiskLabel
    evidence: Evidence
    request: Mapping[str, Any]
    """The episode's request, from which it can be made again."""


@dataclass(frozen=True)
class VideoSet:
    """The videos of a folder, by id, and the thresholds of their labels."""

    folder: Path
    videos: Mapping[str, RiskVideo]
    thresholds: RiskThresholds

    def moved(self, folder: Path) -> "VideoSet":
        """The set with its files in another folder; the videos stay where they are."""
        videos = {
            key: replace(video, file=Path(relpath(self.folder / video.file, folder)).as_posix())
            for key, video in self.videos.items()
        }
        return replace(self, folder=folder, videos=videos)

    def relabelled(self, thresholds: RiskThresholds) -> "VideoSet":
        """The same videos with labels by other thresholds."""
        videos = {key: replace(video, label=label_of(video.evidence, thresholds)) for key, video in self.videos.items()}
        return replace(self, videos=videos, thresholds=thresholds)


_SHARES: Final = (0.5, 0.75, 1.25, 1.5)
"""Factors on a threshold in the table of changes."""


@dataclass(frozen=True)
class ChangedLabels:
    """Labels of a set with one changed threshold."""

    name: str
    value: float
    counts: tuple[int, ...]
    """Number of videos per class: Normal, Near-Miss, Collision."""
    changed: int
    """Number of videos with another class than before."""


def changes_of_labels(videos: VideoSet) -> tuple[ChangedLabels, ...]:
    """How labels change with each threshold, from half to one and a half of it, and with each definition."""
    limits = asdict(videos.thresholds)
    tried = [(f"near-miss: {name}", 1.0, thresholds) for name, thresholds in DEFINITIONS.items()]
    tried += [
        (name, share * value, replace(videos.thresholds, **{name: share * value}))
        for name, value in limits.items()
        for share in _SHARES
        if value > 0.0
    ]
    rows = [_changed(videos, name, value, videos.relabelled(thresholds)) for name, value, thresholds in tried]
    return (_changed(videos, "as they are", 1.0, videos), *rows)


def _changed(videos: VideoSet, name: str, value: float, again: VideoSet) -> ChangedLabels:
    risks = [video.label.risk for video in again.videos.values()]
    changed = sum(again.videos[key].label.risk is not video.label.risk for key, video in videos.videos.items())
    return ChangedLabels(name, value, tuple(risks.count(risk) for risk in RiskClass), changed)


def write_set(videos: VideoSet) -> None:
    """Write the set's two files into its folder, which contains the MP4 files."""
    content = {
        "thresholds": asdict(videos.thresholds),
        "videos": [_as_json(video) for _, video in sorted(videos.videos.items())],
    }
    with whole_file(videos.folder / SET_FILE) as file:
        file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    with whole_file(videos.folder / EVIDENCE_FILE) as file:
        pq.write_table(_evidence_table(list(videos.videos.values())), file)


def read_set(folder: Path) -> VideoSet:
    """Read a set from a folder.

    Raises:
        InputError: No set in the folder, files that do not belong together, or a value that is not known.
    """
    allowed = f"a folder that `siren generate risk` made, with {SET_FILE} and {EVIDENCE_FILE}"
    try:
        content = plain_files.read_json(folder / SET_FILE)
        most_rows = MOMENTS_OF_VIDEO * len(content["videos"])
        table = plain_files.read_table(folder / EVIDENCE_FILE, most_rows, BYTES_OF_MOMENT)
        moments = _moments_by_video(table)
        # Sets of earlier versions contain a speed above which a contact was a collision.
        known = {name: value for name, value in content["thresholds"].items() if name != "impact_mps"}
        thresholds = RiskThresholds(**known)
        videos = [_video(entry, moments.get(str(entry["id"]), _moments({}))) for entry in content["videos"]]
        for video in videos:
            _check(video, folder)
        _check_types("thresholds", thresholds)
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError, pa.ArrowException) as error:
        raise InputError("set", str(folder), f"{allowed} ({error})") from error
    return VideoSet(folder, {video.video_id: video for video in videos}, thresholds)


def _check(video: RiskVideo, folder: Path) -> None:
    """Check that a set refers only to its own films, because sets come from others and pages show these files."""
    _check_types("videos", video)
    for part in (video.label, *video.evidence.encroachments, *video.evidence.contacts):
        _check_types(video.video_id, part)
    file = folder / video.file
    # A relabelled set refers to the films of its original set.
    owner = file.parent.parent if ".." in Path(video.file).parts else folder
    known = owner.joinpath(SET_FILE).is_file() and file.resolve().is_relative_to(owner.resolve())
    if not known or file.resolve().suffix != ".mp4":
        allowed = "an .mp4 file of this set, or of the set that it relabels"
        raise InputError("set", f"{folder}: {video.video_id}: {video.file}", allowed)


def _check_types(where: str, of: Any) -> None:
    """Check the types of fields; ValueError if a field of numbers or texts has another type."""
    for field in fields(of):
        value = getattr(of, field.name)
        allowed = _TYPES.get(str(getattr(field.type, "__name__", field.type)))
        if allowed and (not isinstance(value, allowed) or isinstance(value, bool) is not (allowed is bool)):
            raise ValueError(f"{where}: {field.name}: {value!r:.40} is not {field.type}")


_TYPES: Final[Mapping[str, Any]] = {"str": str, "int": int, "float": (int, float), "bool": bool}
MOMENTS_OF_VIDEO: Final = 200_000
"""Largest number of rows in one video's evidence: 190 frames, each with some steps and many vehicles."""
BYTES_OF_MOMENT: Final = 256
"""Upper bound of the memory of a row of the evidence."""


def missing_files(videos: VideoSet) -> tuple[str, ...]:
    """Videos of a set whose file is missing."""
    return tuple(key for key, video in videos.videos.items() if not (videos.folder / video.file).is_file())


def _as_json(video: RiskVideo) -> dict[str, Any]:
    return {
        "id": video.video_id,
        **{name: getattr(video, name) for name in _SHARED},
        "label": asdict(video.label) | {"risk": video.label.risk.title},
        "encroachments": [*map(asdict, video.evidence.encroachments)],
        "contacts": [*map(asdict, video.evidence.contacts)],
        "request": dict(video.request),
    }


def _video(entry: Mapping[str, Any], moments: Moments) -> RiskVideo:
    label = dict(entry["label"])
    risk, reason = risk_class(label.pop("risk")), Reason(label.pop("reason"))
    evidence = Evidence(
        moments,
        tuple(SeenEncroachment(**encroachment) for encroachment in entry["encroachments"]),
        tuple(SeenContact(**contact) for contact in entry["contacts"]),
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
    columns = {name: table[name].to_numpy() for name in _MOMENT_COLUMNS if name in table.column_names}
    columns.setdefault("braked_mps2", np.full(len(names), np.nan))
    return {
        str(name): _moments({key: values[names == name] for key, values in columns.items()})
        for name in np.unique(names)
    }


def _moments(columns: Mapping[str, Any]) -> Moments:
    return Moments(**{name: np.asarray(columns.get(name, ()), dtype) for name, dtype in _MOMENT_COLUMNS.items()})


def film_frames(path: Path, count: int) -> Iterator[av.VideoFrame]:
    """Decode an MP4 file frame by frame; it must have the given number of frames.

    Raises:
        InputError: No such video, not a video, or one of another length, which is known after the last frame.
    """
    decoded = 0
    try:
        with av.open(str(path)) as container:
            for frame in container.decode(video=0):
                decoded += 1
                yield frame
    except (OSError, IndexError, av.FFmpegError) as error:
        raise InputError("video", str(path), f"an MP4 file ({error})") from error
    if decoded != count:
        raise InputError("video", f"{path}: {decoded} frames", f"{count} frames")


KEY_FRAMES: Final = 9
BATCH: Final = 8


def key_frames(frames: int) -> tuple[int, ...]:
    """Indices of nine uniform key frames, including first and last: 0, 23, 47, …, 189 of 190.

    Their number and places are this project's choice; the paper does not say which frames its models see.

    Raises:
        InputError: A video with fewer frames than that.
    """
    if frames < KEY_FRAMES:
        raise InputError("frames", frames, f"a video of {KEY_FRAMES} frames or more")
    return tuple((frames - 1) * number // (KEY_FRAMES - 1) for number in range(KEY_FRAMES))


def dense_frames(frames: int) -> tuple[int, ...]:
    """Indices of frames 0.2 s apart: a TTC that is short for long enough to count is short in one of them."""
    return tuple(range(0, frames, 2))


def batches(frames: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """Key frames of each question, eight and one: this project's way to the paper's two predictions per video."""
    return tuple(tuple(frames[first : first + BATCH]) for first in range(0, len(frames), BATCH))
