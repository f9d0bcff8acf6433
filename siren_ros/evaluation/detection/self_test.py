"""The labels themselves as detections, through every format: they have to score fully, or a convention is wrong."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np

from siren_ros.evaluation.detection.inputs.found_set import FoundSet
from siren_ros.evaluation.detection.inputs.kitti_results import read_kitti, write_kitti
from siren_ros.evaluation.detection.inputs.nuscenes_results import read_nuscenes, write_nuscenes
from siren_ros.evaluation.detection.inputs.openpcdet_results import openpcdet_entries, read_openpcdet
from siren_ros.evaluation.detection.inputs.topic_results import read_topic
from siren_ros.evaluation.detection.protocol.boxes import Boxes, FoundBoxes
from siren_ros.evaluation.detection.protocol.frames import Frames
from siren_ros.interfaces.topics import BOXES


def labels_as_detections(frames: Frames) -> FoundBoxes:
    """Every label with a LiDAR point as a detection; nearer ones are more confident, so that confidences differ."""
    truth = frames.truth.at(frames.truth.lidar_points > 0)
    away = truth.centre_m[:, :2] - frames.vehicle_m[truth.frame]
    shared = {name: getattr(truth, name) for name in Boxes.__dataclass_fields__}
    return FoundBoxes(
        **shared,
        score=1.0 / (1.0 + 0.01 * np.hypot(away[:, 0], away[:, 1])),
        label=np.full(len(truth), "car"),
    )


def self_test_sets(frames: Frames, folder: Path) -> list[FoundSet]:
    """The labels, written in every format and read back.

    Args:
        frames: All episodes.
        folder: For the files; it is there already.
    """
    found = labels_as_detections(frames)
    sets = []
    write_nuscenes(folder / "nuscenes.json", found, frames)
    sets.append(read_nuscenes("labels, nuScenes", folder / "nuscenes.json", frames))
    for name, nuscenes in (("labels, OpenPCDet", False), ("labels, OpenPCDet nuScenes", True)):
        path = folder / f"openpcdet_{nuscenes}.pkl"
        path.write_bytes(pickle.dumps(openpcdet_entries(found, frames, nuscenes=nuscenes)))
        sets.append(read_openpcdet(name, path, frames))
    if all(episode.camera_from_lidar is not None for episode in frames.episodes):
        write_kitti(folder / "kitti", found, frames)
        sets.append(read_kitti("labels, KITTI", folder / "kitti", frames))
    topic = read_topic("labels, topic", BOXES.name, frames)
    # The topic holds vehicles without a LiDAR point, too: nuScenes' protocol takes them for false alarms.
    order = np.argsort(frames.truth.frame, kind="stable")
    if len(topic.boxes) == len(order):
        sets.append(replace(topic, boxes=topic.boxes.at(frames.truth.lidar_points[order] > 0)))
    return sets
