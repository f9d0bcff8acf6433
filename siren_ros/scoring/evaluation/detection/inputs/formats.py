"""Chooses the reader of a detections file by its source, and tests all formats with the labels themselves.

Labels as detections have to score fully; otherwise a convention of a format is wrong.
"""

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.data.interfaces.topics import BOXES
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import CAR, PERSON_NAMES, Boxes, FoundBoxes
from siren_ros.scoring.evaluation.detection.frames import Frames
from siren_ros.scoring.evaluation.detection.inputs.kitti_results import read_kitti, write_kitti
from siren_ros.scoring.evaluation.detection.inputs.nuscenes_results import read_nuscenes, write_nuscenes
from siren_ros.scoring.evaluation.detection.inputs.openpcdet_results import openpcdet_entries, read_openpcdet
from siren_ros.scoring.evaluation.detection.inputs.stated_boxes import FoundSet
from siren_ros.scoring.evaluation.detection.inputs.topic_results import TOPIC_PREFIX, read_topic
from siren_ros.simulation.world.actors import ActorClass

_READERS: Final[dict[str, Callable[[str, Path, Frames], FoundSet]]] = {
    ".json": read_nuscenes,
    ".pkl": read_openpcdet,
    ".npz": read_openpcdet,
    ".pickle": read_openpcdet,
}


def read_detections(name: str, source: str, frames: Frames) -> FoundSet:
    """Read detections from a source: a JSON file, a pickle, a folder of text files, or ``topic:/NAME``.

    Raises:
        InputError: It is none of these, or its content is refused.
    """
    if source.startswith(TOPIC_PREFIX):
        return read_topic(name, source.removeprefix(TOPIC_PREFIX), frames)
    path = Path(source)
    if path.is_dir():
        return read_kitti(name, path, frames)
    reader = _READERS.get(path.suffix)
    if reader is None or not path.is_file():
        allowed = f"a file {', '.join(_READERS)} that exists, a folder of KITTI's text files, or {TOPIC_PREFIX}/NAME"
        raise InputError("detections", source, allowed)
    return reader(name, path, frames)


def labels_as_detections(frames: Frames) -> FoundBoxes:
    """Labels with LiDAR points as detections. Nearer ones get a higher confidence, so that confidences differ."""
    truth = frames.truth.at(frames.truth.lidar_points > 0)
    shared = {name: getattr(truth, name) for name in Boxes.__dataclass_fields__}
    names = [PERSON_NAMES[kind][0] if kind in PERSON_NAMES else CAR for kind in map(ActorClass, truth.actor_class)]
    label = np.array(names, dtype=np.str_)
    return FoundBoxes(**shared, score=1.0 / (1.0 + 0.01 * frames.distance_m(truth)), label=label)


def self_test_sets(frames: Frames, folder: Path) -> list[FoundSet]:
    """Write the labels into a folder in every format and read them back."""
    labels = labels_as_detections(frames)
    sets = []
    write_nuscenes(folder / "nuscenes.json", labels, frames)
    sets.append(read_nuscenes("labels, nuScenes", folder / "nuscenes.json", frames))
    for name, nuscenes in (("labels, OpenPCDet", False), ("labels, OpenPCDet nuScenes", True)):
        path = folder / f"openpcdet_{nuscenes}.pkl"
        path.write_bytes(pickle.dumps(openpcdet_entries(labels, frames, nuscenes=nuscenes)))
        sets.append(read_openpcdet(name, path, frames))
    if all(episode.camera_from_lidar is not None for episode in frames.episodes):
        write_kitti(folder / "kitti", labels, frames)
        sets.append(read_kitti("labels, KITTI", folder / "kitti", frames))
    topic = read_topic("labels, topic", BOXES.name, frames)
    # The topic also has labels without a LiDAR point; nuScenes' protocol counts them as false alarms.
    order = np.argsort(frames.truth.frame, kind="stable")
    if len(topic.boxes) == len(order):
        sets.append(replace(topic, boxes=topic.boxes.at(frames.truth.lidar_points[order] > 0)))
    return sets
