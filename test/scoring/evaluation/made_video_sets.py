"""Small sets of videos, without the pictures."""

from pathlib import Path

import numpy as np

from siren_ros.scoring.evaluation.risk.labels import (
    Evidence,
    Moments,
    RiskThresholds,
    SeenContact,
    SeenEncroachment,
    label_of,
)
from siren_ros.scoring.evaluation.risk.video_set import VIDEO_FRAMES, RiskVideo, VideoSet, key_frames, read_set
from siren_ros.scoring.pictures.video import write_video


def evidence(kind: str) -> Evidence:
    """What a video of a class is labelled by."""
    steps = np.arange(40, 40 + (8 if kind != "Normal" else 0))
    count = len(steps)
    moments = Moments(
        steps,
        np.full(count, 5, np.uint32),
        np.linspace(1.2, 0.9, count),
        np.full(count, 6.0),
        np.full(count, 3.0),
        np.full(count, 5.5),
        np.zeros(count),
    )
    contacts = (SeenContact(5, 48, 3.5),) if kind == "Collision" else ()
    return Evidence(moments, (SeenEncroachment(8, 60, 2.5),), contacts)


def small_video_set(folder: Path) -> VideoSet:
    """Three normal videos, two near-misses and one collision, of two templates."""
    kinds = ["Normal", "Normal", "Near-Miss", "Normal", "Near-Miss", "Collision"]
    videos = {}
    for number, kind in enumerate(kinds):
        template = "S4" if number < 3 else "S6"
        key, found = f"{template}_{number:03d}", evidence(kind)
        label = label_of(found, RiskThresholds())
        request = {"template": template, "seed": number, "map": "", "values": ""}
        videos[key] = RiskVideo(key, template, f"videos/{key}.mp4", VIDEO_FRAMES, 20, label, found, request)
        assert label.risk.title == kind
    return VideoSet(folder, videos, RiskThresholds())


def draw_films(folder: Path) -> None:
    """Draws the pictures of a set: grey films, and masks without vehicles."""
    folder.joinpath("masks").mkdir()
    for number, (key, video) in enumerate(sorted(read_set(folder).videos.items())):
        write_video(folder / video.file, (np.full((120, 160, 3), 40 * number, np.uint8) for _ in range(video.frames)))
        empty = {f"frame_{frame:03d}": np.zeros((120, 160), np.uint32) for frame in key_frames(video.frames)}
        np.savez_compressed(folder / "masks" / f"{key}.npz", **empty)
