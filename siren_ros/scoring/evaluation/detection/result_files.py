"""Detections of other programs: KITTI's and nuScenes' result files, recorded topics, and the choice of the reader.

KITTI: ``NNNNNN.txt`` with lines of 16 words in the front camera's frame. Source: the development kit of the object
benchmark (Geiger, Lenz, Urtasun 2012), ``readme.txt``: ``type truncated occluded alpha left top right bottom height
width length x y z rotation_y score``; the place is the centre of the bottom face. Two more words, which KITTI does not
have, may give the velocity along the camera's x and z axes in m/s.

nuScenes: JSON with boxes in the global frame of ``siren export nuscenes``. Source: nuscenes-devkit,
``python-sdk/nuscenes/eval/detection/README.md``, "Results format".

Topics: messages ``vision_msgs/Detection3DArray`` that were recorded with the episodes.

All formats are tested with the labels themselves. Labels as detections have to score fully; otherwise a convention of a
format is wrong.
"""

import json
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Matrix, Rows
from siren_ros.base.params import plain_files
from siren_ros.data.episode_source import open_source
from siren_ros.data.interfaces.topics import BOXES
from siren_ros.data.recording.bag_reader import damage_refused
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection import boxes
from siren_ros.scoring.evaluation.detection.boxes import (
    ATTRIBUTES,
    CAR,
    PERSON_NAMES,
    Boxes,
    FoundBoxes,
    FoundSet,
    StatedBoxes,
    check_boxes,
    in_map,
)
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames, Frames
from siren_ros.scoring.evaluation.detection.openpcdet_results import openpcdet_entries, read_openpcdet
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import BASE_FRAME, MAP_FRAME

_KITTI: Final = "KITTI results"
_WORDS: Final = 16
_UPRIGHT_FROM_CAMERA: Final = np.array([[0.0, 0, 1.0, 0], [-1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])
"""Transform from the camera's axes to forward, left, up: boxes are upright there, and ``rotation_y`` becomes a
heading."""


def read_kitti(name: str, path: Path, frames: Frames) -> boxes.FoundSet:
    """Read a folder, which needs a file for every frame of ``siren export kitti``.

    Raises:
        InputError: A file that is missing, of a frame that the bags do not have, or that holds something else.
    """
    numbers = np.flatnonzero(frames.pictured)
    files = sorted(path.glob("*.txt"))
    for file in files:
        if not file.stem.isdecimal() or int(file.stem) >= len(numbers):
            allowed = f"frames 000000 to {len(numbers) - 1:06d} of the given bags, as exported"
            raise InputError("detections", str(file), allowed)
    if missing := set(range(len(numbers))) - {int(file.stem) for file in files}:
        allowed = "a file for every frame of the dataset, an empty one where nothing was found"
        raise InputError("detections", f"{path}: no {min(missing):06d}.txt", allowed)
    lines = [(int(file.stem), line.split()) for file in files for line in _lines_of(file) if line.strip()]
    stated, with_velocity = _kitti_columns(path, numbers, lines)
    boxes.check_boxes(str(path), stated, frames.name_of, with_velocity=with_velocity)
    found = boxes.in_map(stated, map_from_upright(frames)[stated.frame])
    return boxes.FoundSet(name, _KITTI, found, frames.pictured, with_velocity)


def _lines_of(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise InputError("detections", str(file), f"a text file ({error})") from error


def _kitti_columns(path: Path, numbers: Rows, lines: list[tuple[int, list[str]]]) -> tuple[boxes.StatedBoxes, bool]:
    rows = np.full((len(lines), _WORDS + 1), np.nan)
    for row, (number, words) in enumerate(lines):
        if len(words) not in {_WORDS, _WORDS + 2}:
            given = f"{path / f'{number:06d}.txt'}: a line of {len(words)} words"
            raise InputError("detections", given, f"{_WORDS} words, or {_WORDS + 2} with a velocity")
        try:
            rows[row, : len(words) - 1] = [float(word) for word in words[1:]]
        except ValueError as error:
            raise InputError("detections", f"{path / f'{number:06d}.txt'}: {error}", "numbers") from error
    height, place, rotation = rows[:, 7:10], rows[:, 10:13], rows[:, 13]
    with_velocity = any(len(words) == _WORDS + 2 for _, words in lines)
    middle = place - np.stack((np.zeros(len(rows)), height[:, 0] / 2.0, np.zeros(len(rows))), axis=-1)
    stated = boxes.StatedBoxes(
        frame=numbers[[number for number, _ in lines]] if lines else np.zeros(0, dtype=np.intp),
        centre_m=middle @ _UPRIGHT_FROM_CAMERA[:3, :3].T,
        size_m=height[:, [2, 1, 0]],
        rotation_wxyz=boxes.quaternions_of_yaw(-rotation - np.pi / 2.0),
        velocity_mps=np.stack((rows[:, 16], -rows[:, 15]), axis=-1),
        score=rows[:, 14],
        label=np.array([words[0].lower() for _, words in lines], dtype=np.str_),
    )
    return stated, with_velocity


def map_from_upright(frames: Frames) -> Floats:
    """Pose in the map of a frame at the front camera with axes forward, left, up, shape ``(F, 4, 4)``.

    Raises:
        InputError: An episode has no front camera.
    """
    parts = []
    for episode in frames.episodes:
        camera = episode.camera_from_lidar
        if camera is None:
            raise InputError("detections", "KITTI results", f"bags with a front camera; {episode.bag} has none")
        parts.append(episode.map_from_lidar @ np.linalg.inv(camera) @ np.linalg.inv(_UPRIGHT_FROM_CAMERA))
    return np.concatenate(parts)


def write_kitti(folder: Path, found: FoundBoxes, frames: Frames) -> None:
    """Write boxes as KITTI's result files with velocities."""
    folder.mkdir(parents=True, exist_ok=True)
    matrices = map_from_upright(frames)
    for number, frame in enumerate(np.flatnonzero(frames.pictured).tolist()):
        here = found.at(found.frame == frame)
        upright = np.linalg.inv(matrices[frame])
        turn = float(np.arctan2(upright[1, 0], upright[0, 0]))
        middle = here.centre_m @ upright[:3, :3].T + upright[:3, 3]
        velocity = np.nan_to_num(here.velocity_mps) @ upright[:2, :2].T
        lines = []
        for row in range(len(here)):
            length, width, height = here.size_m[row]
            ahead, left, up = middle[row]
            rotation_y = -float(here.yaw_rad[row]) - turn - np.pi / 2.0
            place = (height, width, length, -left, -up + height / 2.0, ahead, rotation_y, here.score[row])
            text = " ".join(f"{value:.9f}" for value in (*place, -velocity[row, 1], velocity[row, 0]))
            lines.append(f"{str(here.label[row]).capitalize()} -1 -1 -10 0 0 0 0 {text}\n")
        (folder / f"{number:06d}.txt").write_text("".join(lines), encoding="utf-8")


_NUSCENES = "nuScenes results"


def read_nuscenes(name: str, path: Path, frames: Frames) -> FoundSet:
    """Read a results file; only the keyframes of the export are scored.

    Raises:
        InputError: No results file, a frame that the bags do not have or that is missing, or a box that means nothing.
    """
    results = _results(path)
    unknown = next((token for token in results if token not in frames.by_token), None)
    if unknown is not None:
        raise InputError("detections", f"{path}: sample_token {unknown}", "keyframes of the given bags, as exported")
    missing = next((frame for token, frame in frames.by_token.items() if token not in results), None)
    if missing is not None:
        raise InputError("detections", f"{path}: nothing for {frames.name_of(missing)}", "an entry for every keyframe")
    rows = [(frames.by_token[token], box) for token, boxes in results.items() for box in boxes]
    stated = _nuscenes_columns(path, frames, rows)
    check_boxes(str(path), stated, frames.name_of, with_velocity=True)
    map_from_global = np.tile(np.eye(4), (len(stated.frame), 1, 1))
    map_from_global[:, :2, 3] = -frames.global_from_map_m[stated.frame]
    boxes = in_map(stated, map_from_global)
    return FoundSet(name, _NUSCENES, boxes, frames.keyframe, has_velocity=True, has_attributes=True)


def _results(path: Path) -> Mapping[str, Any]:
    try:
        content = plain_files.read_json(path)
    except (OSError, ValueError) as error:
        raise InputError("detections", str(path), f"a JSON file ({error})") from error
    results = content.get("results") if isinstance(content, dict) else None
    if not isinstance(results, dict) or not all(isinstance(boxes, list) for boxes in results.values()):
        raise InputError("detections", str(path), "an object with `meta` and `results`, a list for each sample_token")
    return results


def _nuscenes_columns(path: Path, frames: Frames, rows: list[tuple[int, Any]]) -> StatedBoxes:
    def column(key: str, width: int) -> Floats:
        values = np.full((len(rows), width), np.nan)
        for number, (frame, box) in enumerate(rows):
            try:
                values[number] = box[key]
            except (KeyError, TypeError, ValueError) as error:
                given = f"{path}: {frames.name_of(frame)}: {key}"
                raise InputError("detections", given, f"{width} numbers in each box") from error
        return values

    attributes = []
    for frame, box in rows:
        if not isinstance(box, dict) or not isinstance(box.get("detection_name"), str):
            raise InputError("detections", f"{path}: {frames.name_of(frame)}", "a detection_name in each box")
        attribute = box.get("attribute_name", "")
        attributes.append(ATTRIBUTES.index(attribute) if attribute in ATTRIBUTES else 0)
    return StatedBoxes(
        frame=np.array([frame for frame, _ in rows], dtype=np.intp),
        centre_m=column("translation", 3),
        size_m=column("size", 3)[:, [1, 0, 2]],
        rotation_wxyz=column("rotation", 4),
        velocity_mps=column("velocity", 2),
        score=column("detection_score", 1)[:, 0],
        label=np.array([box["detection_name"].lower() for _, box in rows], dtype=np.str_),
        attribute=np.array(attributes, dtype=np.uint8),
    )


def write_nuscenes(path: Path, boxes: FoundBoxes, frames: Frames) -> None:
    """Write boxes of keyframes as a results file."""
    rows = {
        "detection_name": boxes.label.tolist(),
        "detection_score": boxes.score.tolist(),
        "attribute_name": [ATTRIBUTES[code] for code in boxes.attribute.tolist()],
    }
    _write(path, boxes, frames, rows)


def write_nuscenes_tracks(path: Path, boxes: FoundBoxes, track: Rows, frames: Frames) -> None:
    """Write tracks as a file of nuScenes' tracking task; ``track`` has the track number of each box, shape ``(N,)``.

    Source: nuscenes-devkit, ``python-sdk/nuscenes/eval/tracking/README.md``, "Results format".
    """
    rows = {
        "tracking_id": [str(number) for number in track.tolist()],
        "tracking_name": boxes.label.tolist(),
        "tracking_score": boxes.score.tolist(),
    }
    _write(path, boxes, frames, rows)


def _write(path: Path, boxes: FoundBoxes, frames: Frames, more: Mapping[str, Sequence[str | float]]) -> None:
    results: dict[str, list[dict[str, Any]]] = {token: [] for token in frames.by_token}
    tokens = {frame: token for token, frame in frames.by_token.items()}
    for row, frame in enumerate(boxes.frame.tolist()):
        if frame not in tokens:
            continue
        centre = boxes.centre_m[row].copy()
        centre[:2] += frames.global_from_map_m[frame]
        half = float(boxes.yaw_rad[row]) / 2.0
        results[tokens[frame]].append(
            {
                "sample_token": tokens[frame],
                "translation": centre.tolist(),
                "size": boxes.size_m[row, [1, 0, 2]].tolist(),
                "rotation": [float(np.cos(half)), 0.0, 0.0, float(np.sin(half))],
                "velocity": np.nan_to_num(boxes.velocity_mps[row]).tolist(),
                **{key: values[row] for key, values in more.items()},
            }
        )
    meta = {"use_lidar": True, **dict.fromkeys(("use_camera", "use_radar", "use_map", "use_external"), False)}
    path.write_text(json.dumps({"meta": meta, "results": results}) + "\n", encoding="utf-8")


TOPIC_PREFIX: Final = "topic:"
_TYPE: Final = "vision_msgs/msg/Detection3DArray"
_TOPIC: Final = "recorded topic"


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
    return FoundSet(name, _TOPIC, boxes, np.ones(len(frames), dtype=np.bool_), has_velocity=False)


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
