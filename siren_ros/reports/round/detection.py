"""Rounds of 3-D detection: the sensors of sealed episodes without a label, answered by files of boxes."""

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.data.episode_source import Need, bag_sha256, in_dataset_order, survey_bag
from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.boxes import from_ground_truth, to_ground_truth
from siren_ros.data.interfaces.measurements import from_point_cloud, to_point_cloud
from siren_ros.data.interfaces.messages import step_of
from siren_ros.data.recording.bag_reader import BagMessage, open_bag
from siren_ros.data.recording.bag_writer import EpisodeBagWriter
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import writing
from siren_ros.reports.round.prediction import Limits
from siren_ros.reports.round.sealed_round import BAGS, public_of, strata_of
from siren_ros.scoring.evaluation.detection.boxes import joined
from siren_ros.scoring.evaluation.detection.detectors import run_detector
from siren_ros.scoring.evaluation.detection.frames import Frames, frames_of, read_frames
from siren_ros.scoring.evaluation.detection.metrics import DISTANCES_M, match
from siren_ros.scoring.evaluation.detection.result_files import read_detections, write_nuscenes
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes, mean_ap_of_episodes
from siren_ros.scoring.evaluation.prediction.questions import Content
from siren_ros.scoring.evaluation.statistics import BlockSums, block_sums
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.carrier import GROUND_TRUTH_DTYPES

FLOOR_M: Final = 0.02
"""Least error of a centre: the range of a LiDAR with 64 beams has a standard deviation of 2 cm (data sheet of
Velodyne's HDL-64E S3), and it sees one or two sides of a vehicle."""
_MATCH_M: Final = 2.0
"""Distance of the matches whose errors are counted, as in nuScenes' error of translation."""
_TOLD: Final = frozenset(
    one.name
    for one in (*(topics.EPISODE, topics.MAP, topics.EPISODE_END), *(topics.CLOCK, topics.TF, topics.TF_STATIC))
)
_SENSORS: Final = frozenset(
    one.type_name
    for one in (
        *(topics.LIDAR, topics.IMAGE_COMPRESSED, topics.CAMERA_INFO),
        *(topics.GNSS, topics.IMU, topics.AUDIO, topics.ODOMETRY),
    )
)
"""Types of what sensors measure. Images of classes and of actors have another one."""


def question(name: str, _request: EpisodeRequest, record: EpisodeRecord, bag: Path, public: Path) -> Content:
    """The hash of an episode's sensors, which ``public`` gets as a bag."""
    out = public / BAGS / name
    write_sensed(bag, out)
    return {"episode": name, "map": record.description.map_sha256, "sensors_sha256": bag_sha256(out)}


def write_sensed(bag: Path, out: Path) -> None:
    """Write what the sensors of a bag measure, without labels; the times of the labels stay.

    Points do not say on which actor they are. All that reads bags with sensors reads it.

    Raises:
        BagError: The bag is damaged.
        InputError: The folder cannot be written.
    """
    with writing(out, "folder"):
        out.parent.mkdir(exist_ok=True)
    with open_bag(bag) as opened:
        writer = EpisodeBagWriter(out, opened.typestore, opened.latched)
        for message in opened.messages():
            if message.topic in {*_TOLD, topics.GROUND_TRUTH.name} or message.type_name in _SENSORS:
                writer.write(message.topic, message.type_name, _without_labels(message), message.time_ns)
        writer.finish()


def _without_labels(message: BagMessage) -> bytes:
    if message.topic == topics.GROUND_TRUTH.name:
        truth = from_ground_truth(message.read())
        nothing: dict[str, Any] = {name: getattr(truth, name)[:0] for name in GROUND_TRUTH_DTYPES}
        return wire.encode(topics.GROUND_TRUTH, to_ground_truth(replace(truth, **nothing)))
    if message.type_name == topics.LIDAR.type_name:
        cloud = message.read()
        points = from_point_cloud(cloud).copy()
        if "instance" in (points.dtype.names or ()):
            points["instance"] = 0
            return wire.encode(topics.LIDAR, to_point_cloud(step_of(cloud), str(cloud.header.frame_id), points))
    return message.cdr


def labelled_frames(public: Path, bags: Path) -> Frames:
    """The frames of a round, named and in the order as in a dataset of its public bags, with the labels of others."""
    with tempfile.TemporaryDirectory(prefix="siren-survey-") as scratch:
        needs = (Need.LIDAR, Need.MAP)
        given = [survey_bag(bag, "detection", needs, Path(scratch)) for bag in sorted((public / BAGS).iterdir())]
        ordered = in_dataset_order(given)
        return frames_of(
            [read_frames(replace(one, readable=str(bags / Path(one.bag).name)), name) for one, name in ordered]
        )


def answer(public: Path, model: str, out: Path) -> int:
    """Answer a round with a detector of the project, as results of nuScenes; gives the number of frames."""
    frames = labelled_frames(public, public / BAGS)
    parts = [run_detector(model, episode, None)[0] for episode in frames.episodes]
    boxes = joined([replace(part, frame=part.frame + first) for part, first in zip(parts, frames.first, strict=False)])
    with writing(out):
        write_nuscenes(out, boxes, frames)
    return len(frames)


def take(given: Path, out: Path, _folder: Path, _plan: Content, _limits: Limits) -> Path:
    """A copy of a submission, which is a file or a folder of files."""
    copy = out.with_name(out.name + given.suffix)
    if given.is_dir():
        shutil.copytree(given, copy)
    else:
        shutil.copyfile(given, copy)
    return copy


def judge(plan: Content, folder: Path, bags: Path) -> tuple[Callable[[Path], tuple[BlockSums, str, Content]], Content]:
    """The precision of a file of boxes in each episode, and why it is flagged: its boxes are where the labels are."""
    frames = labelled_frames(public_of(folder), bags)
    of_name = dict(zip([one["name"] for one in plan["episodes"]], strata_of(plan).tolist(), strict=True))
    stratum = np.array([of_name[Path(episode.bag).name] for episode in frames.episodes])

    def judged(file: Path) -> tuple[BlockSums, str, Content]:
        found = read_detections(file.stem, str(file), frames)
        values = mean_ap_of_episodes(frames, found, VEHICLE_NAMES)
        truth, boxes = counted_boxes(frames, found, VEHICLE_NAMES)
        pairs = match(truth, boxes)
        label = pairs.label[DISTANCES_M.index(_MATCH_M)]
        away = boxes.centre_m[pairs.order] - truth.centre_m[label] if len(truth) else np.zeros((0, 3))
        error_m = np.hypot(*away[label >= 0, :2].T).mean() if (label >= 0).any() else np.inf
        low = f"its centres are {error_m:.3f} m from the labels, nearer than a LiDAR measures"
        return block_sums(values, np.arange(len(values)), stratum), low if error_m < FLOOR_M else "", {}

    told = f"The floor is {FLOOR_M:g} m: the least mean distance of matched centres from the labels."
    return judged, {"floor": {"centre_m": FLOOR_M, "text": told}}
