"""Reads detections that were recorded with the episodes, from a topic with ``vision_msgs/Detection3DArray``."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Matrix
from siren_ros.data.record.episode_source import open_source
from siren_ros.data.recording.bag_reader import damage_refused
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames, Frames
from siren_ros.scoring.evaluation.detection.inputs.stated_boxes import FoundSet, StatedBoxes, check_boxes, in_map
from siren_ros.simulation.world.carrier import BASE_FRAME, MAP_FRAME

TOPIC_PREFIX: Final = "topic:"
_TYPE: Final = "vision_msgs/msg/Detection3DArray"
_FORMAT: Final = "recorded topic"


def read_topic(name: str, topic: str, frames: Frames) -> FoundSet:
    """Read a topic from every bag. All frames are scored; a frame without a message has no detections.

    Raises:
        InputError: A bag lacks the topic, boxes stand in an unknown frame, or a box means nothing.
    """
    numbers: list[int] = []
    rows: list[tuple[Any, ...]] = []
    matrices: list[Matrix] = []
    for first, episode in zip(frames.first.tolist(), frames.episodes, strict=False):
        row_of_step = episode.frame_of_step
        for step, message in _messages(episode, topic):
            if step not in row_of_step or not message.detections:
                continue
            row = row_of_step[step]
            for detection in message.detections:
                place = f"{topic} of {episode.bag}, step {step}"
                rows.append(_row(place, detection))
                numbers.append(first + row)
                matrices.append(_map_from(str(message.header.frame_id), episode, row, place))
    table = np.array([row[:-1] for row in rows], dtype=np.float64).reshape(-1, 11)
    stated = StatedBoxes(
        frame=np.array(numbers, dtype=np.intp),
        centre_m=table[:, 0:3],
        size_m=table[:, 3:6],
        rotation_wxyz=table[:, 6:10],
        velocity_mps=np.full((len(table), 2), np.nan),
        score=table[:, 10],
        label=np.array([row[-1] for row in rows], dtype=np.str_),
    )
    check_boxes(topic, stated, frames.name_of, with_velocity=False)
    boxes = in_map(stated, np.array(matrices).reshape(-1, 4, 4))
    return FoundSet(name, _FORMAT, boxes, np.ones(len(frames), dtype=np.bool_), has_velocity=False)


def _messages(episode: EpisodeFrames, topic: str) -> Iterator[tuple[int, Any]]:
    with open_source(Path(episode.bag)) as source:
        if source.bag.type_names.get(topic) != _TYPE:
            topics = ", ".join(sorted(name for name, kind in source.bag.type_names.items() if kind == _TYPE))
            raise InputError("detections", f"{topic} in {episode.bag}", f"a topic of type {_TYPE}: {topics}")
        for step, held in source.messages_by_step({topic}):
            yield step, held[topic].read()


def _row(place: str, detection: Any) -> tuple[Any, ...]:
    if not len(detection.results):
        raise InputError("detections", f"{place}: a detection without results", "a hypothesis for each detection")
    with damage_refused(Path(place)):
        best = max((result.hypothesis for result in detection.results), key=lambda hypothesis: float(hypothesis.score))
        centre, turn, size = detection.bbox.center.position, detection.bbox.center.orientation, detection.bbox.size
        places = (centre.x, centre.y, centre.z, size.x, size.y, size.z, turn.w, turn.x, turn.y, turn.z)
        return (*places, float(best.score), str(best.class_id).lower())


def _map_from(frame_id: str, episode: EpisodeFrames, row: int, place: str) -> Matrix:
    lidar: Matrix = episode.map_from_lidar[row]
    if frame_id == episode.lidar_frame:
        return lidar
    if frame_id == BASE_FRAME:
        return lidar @ np.linalg.inv(episode.base_from_lidar)
    if frame_id == MAP_FRAME:
        return np.eye(4)
    allowed = f"{episode.lidar_frame}, {BASE_FRAME} or {MAP_FRAME}"
    raise InputError("detections", f"{place}: frame_id {frame_id!r}", allowed)
