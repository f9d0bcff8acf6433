"""Samples of risk understanding: a small grey film of the front camera, its class, and its severity."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Final

import numpy as np

from siren_ros.lab.training.packed.parquet_samples import Column, Sample
from siren_ros.scoring.evaluation.risk.labels import TITLES
from siren_ros.scoring.evaluation.risk.sequence_model import EVERY, HEIGHT, WIDTH, read_small_frames
from siren_ros.scoring.evaluation.risk.severity import MEASURES, severity_of
from siren_ros.scoring.evaluation.risk.video_set import VIDEO_FRAMES, RiskVideo, VideoSet

COLUMNS: Final[Mapping[str, Column]] = {
    "video": Column(str, (), "id of the video in its set"),
    "template": Column(str, (), "template of the episode"),
    "frames": Column(np.uint8, (VIDEO_FRAMES // EVERY, HEIGHT, WIDTH), "grey values of every second frame, 5 Hz"),
    "label": Column(np.int64, (), f"class: {', '.join(f'{number} {title}' for number, title in enumerate(TITLES))}"),
    **{name: Column(np.float32, (), meaning) for name, meaning in MEASURES.items()},
}


def risk_samples(videos: VideoSet) -> Iterator[tuple[RiskVideo, Sample]]:
    """Samples of a set's videos, in the order of their ids.

    Raises:
        InputError: A video is missing or of another length.
    """
    for key, video in sorted(videos.videos.items()):
        frames = read_small_frames(videos.folder / video.file, video.frames)
        about = {"video": key, "template": video.template, "frames": frames, "label": int(video.label.risk)}
        yield video, {**about, **asdict(severity_of(video.evidence, videos.thresholds))}
