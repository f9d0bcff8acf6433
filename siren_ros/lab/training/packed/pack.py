"""Packs bags or sets of risk videos into one Parquet file per split, with card, datasheet and metadata.

Samples of 3-D detection are ten LiDAR sweeps in the frame of the last one, and the boxes of the vehicles. Samples of
risk understanding are a small grey film of the front camera, its class, and its severity.
"""

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.data.datasets.export_job import AUTO, card_of, write_card
from siren_ros.data.datasets.files import FileWriter, Staging
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport, Format, Option
from siren_ros.data.episode_source import EpisodeSource, Need, episode_name, licence_of_map
from siren_ros.data.tracks import POPULATIONS
from siren_ros.errors import InputError, writing
from siren_ros.lab.training.detection.samples import BOX_COLUMNS, frames_of_bag
from siren_ros.lab.training.packed import prediction
from siren_ros.lab.training.packed.parquet_samples import Column, PackedSamples, Sample, join_files, write_samples
from siren_ros.scoring.evaluation.detection.boxes import CLASS_NAMES
from siren_ros.scoring.evaluation.detection.pillar_detector import COLUMNS as POINT_COLUMNS
from siren_ros.scoring.evaluation.detection.pillar_detector import PillarGrid
from siren_ros.scoring.evaluation.prediction.samples import Population
from siren_ros.scoring.evaluation.risk.labels import TITLES
from siren_ros.scoring.evaluation.risk.scoring import MEASURES, severity_of
from siren_ros.scoring.evaluation.risk.sequence_model import EVERY, HEIGHT, WIDTH, read_small_frames
from siren_ros.scoring.evaluation.risk.video_set import VIDEO_FRAMES, RiskVideo, VideoSet, read_set
from siren_ros.simulation.roads.maps.map_compiler import name_of_map
from siren_ros.simulation.scenario.episode import EpisodeIdentity, Split, split_of

DETECTION_COLUMNS: Final[Mapping[str, Column]] = {
    "episode": Column(str, (), "id of the episode"),
    "template": Column(str, (), "template of the episode"),
    "frame": Column(np.int32, (), "number of the frame in its episode, 2 Hz"),
    "points": Column(
        np.float32,
        (-1, len(POINT_COLUMNS)),
        "points of ten sweeps in the frame of the last one, x forward, z = 0 where the ground of a LiDAR at 1.93 m "
        "would have z = -1.93; crowded pillars of 0.256 m are thinned",
        POINT_COLUMNS,
    ),
    "boxes": Column(
        np.float32,
        (-1, len(BOX_COLUMNS)),
        f"vehicles: centre, size, yaw, velocity, class ({', '.join(CLASS_NAMES)}), LiDAR points; metres, radians, m/s",
        BOX_COLUMNS,
    ),
}


def detection_samples(bag: Path) -> Iterator[Sample]:
    """Samples of an episode, two per second.

    Raises:
        BagError: The bag is damaged or has no LiDAR.
    """
    frames = frames_of_bag(bag, PillarGrid())
    about = frames.about
    name = episode_name(about["template"], about["level"], about["seed"], about["map"])
    for number in range(len(frames)):
        frame = frames.frame(number)
        yield {
            "episode": name,
            "template": about["template"],
            "frame": number,
            "points": frame.points,
            "boxes": frame.boxes,
        }


RISK_COLUMNS: Final[Mapping[str, Column]] = {
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


_PART: Final = "samples.parquet"
COMMAND: Final = "siren pack"
_SPLITS: Final = (*(split.value for split in Split), "test")
"""The project's splits, and ``test`` for all tests together."""


class _Packer(ABC):
    """Base of packers: it writes the samples of each episode, and one file per split of the dataset."""

    task = ""
    columns: Mapping[str, Column]

    @abstractmethod
    def samples(self, source: EpisodeSource) -> Iterator[Sample]:
        """Samples of an episode."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:  # noqa: ARG002 - the samples name their episode
        """Implements ``Exporter.write_episode``."""
        with writing(files.folder, "place"):
            count = write_samples(files.folder / _PART, self.columns, self.samples(source), self.task)
        return EpisodeReport({"samples": count})

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Implements ``Exporter.assemble``; a split without episodes gets no file."""
        for split in dict.fromkeys(part.split for part in parts):
            join_files([part.folder / _PART for part in parts if part.split == split], folder / f"{split}.parquet")


class PredictionPacker(_Packer):
    """Packs samples of trajectory prediction."""

    task = "prediction"
    columns = prediction.COLUMNS

    def __init__(self, population: str) -> None:
        self._population = Population(population)

    def samples(self, source: EpisodeSource) -> Iterator[Sample]:
        """Samples of an episode."""
        return prediction.prediction_samples(source.record(), self._population)


class DetectionPacker(_Packer):
    """Packs frames of 3-D detection."""

    task = "detection"
    columns = DETECTION_COLUMNS

    def samples(self, source: EpisodeSource) -> Iterator[Sample]:
        """Samples of an episode."""
        return detection_samples(source.path)


PACKS: Final = {
    pack.name: pack
    for pack in (
        Format(
            "prediction",
            "Samples of trajectory prediction: past, map, signals, flags, future",
            (Need.TRACKS, Need.MAP, Need.EMV),
            f"{__name__}:{PredictionPacker.__name__}",
            (Option("population", "region", POPULATIONS, "vehicles to predict"),),
            command=COMMAND,
        ),
        Format(
            "detection",
            "Frames of 3-D detection at 2 Hz: ten LiDAR sweeps and the boxes of the vehicles",
            (Need.LIDAR,),
            f"{__name__}:{DetectionPacker.__name__}",
            command=COMMAND,
        ),
    )
}
"""Packing formats of bags by task."""
RISK: Final = Format(
    "risk", "Films of the front camera with the classes Normal, Near-Miss and Collision", (), "", command=COMMAND
)


@dataclass(frozen=True)
class RiskPack:
    """Settings for packing sets of risk videos."""

    sets: tuple[Path, ...]
    out: Path
    split: str = AUTO
    licence: str = ""


def pack_risk(job: RiskPack, done: Callable[[], None] = lambda: None) -> Mapping[str, Any]:
    """Pack the videos of some sets and return the card; ``done`` is called after each video.

    A video is in the split of its episode.

    Raises:
        InputError: A set cannot be read, two sets have a video of the same episode, or the place is taken.
    """
    staging = Staging(job.out)
    staging.check_free()
    sets = [read_set(folder) for folder in job.sets]
    _check_apart(sets)
    with staging.opened({"sets": [str(path.absolute()) for path in job.sets], "split": job.split}):
        folder = staging.new(staging.dataset)
        episodes = list[dict[str, Any]]()
        for split in _SPLITS:
            chosen = [_of_split(videos, split, job.split) for videos in sets]
            if not any(part.videos for part in chosen):
                continue

            def packed(parts: Sequence[VideoSet] = chosen, split: str = split) -> Iterator[Sample]:
                for part in parts:
                    for video, sample in risk_samples(part):
                        episodes.append(_episode(video, split))
                        yield sample
                        done()

            with writing(folder, "place"):
                write_samples(folder / f"{split}.parquet", RISK_COLUMNS, packed(), RISK.name)
        classes = Counter(str(item["label"]) for item in episodes)
        content = card_of(RISK, "SET…", {}, episodes, {"samples": len(episodes)}, classes, job.licence)
        write_card(folder, content)
        staging.publish(folder)
    return content


def _split(video: RiskVideo, asked: str) -> str:
    request = video.request
    identity = EpisodeIdentity(_map_of(video), video.template, int(request["seed"]), str(request.get("values", "")))
    return split_of(identity).value if asked == AUTO else asked


def _map_of(video: RiskVideo) -> str:
    file = str(video.request["map"])
    return name_of_map(Path(file) if file else None)


def _of_split(videos: VideoSet, split: str, asked: str) -> VideoSet:
    return replace(videos, videos={key: item for key, item in videos.videos.items() if _split(item, asked) == split})


def _check_apart(sets: Sequence[VideoSet]) -> None:
    seen = set[str]()
    for videos in sets:
        for video in videos.videos.values():
            key = f"{video.request} from step {video.first_step}"
            if key in seen:
                raise InputError("sets", f"{videos.folder}: {video.video_id}", "sets without a video in common")
            seen.add(key)


def _episode(video: RiskVideo, split: str) -> dict[str, Any]:
    map_name = _map_of(video)
    return {
        "id": video.video_id,
        "split": split,
        "template": video.template,
        "seed": int(video.request["seed"]),
        "map": map_name,
        "map_licence": licence_of_map(map_name, str(video.request["map"])),
        "label": video.label.risk.title,
    }


def read_through(file: Path) -> tuple[int, float]:
    """Read all samples of a packed file, which also proves it undamaged; otherwise InputError.

    Returns their number, and how many of them a second of processor time reads.
    """
    packed, start = PackedSamples(file), time.process_time()
    count = sum(1 for number in range(len(packed)) if packed[number])
    return count, count / max(time.process_time() - start, 1e-9)
