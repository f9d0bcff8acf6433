"""Reads and writes nuScenes' results: JSON with boxes in the global frame of ``siren export nuscenes``.

Source: nuscenes-devkit, ``python-sdk/nuscenes/eval/detection/README.md``, "Results format".
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Rows
from siren_ros.base.params import plain_json
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import ATTRIBUTES, FoundBoxes
from siren_ros.scoring.evaluation.detection.frames import Frames
from siren_ros.scoring.evaluation.detection.inputs.stated_boxes import FoundSet, StatedBoxes, check_boxes, in_map

_FORMAT = "nuScenes results"


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
    stated = _columns(path, frames, rows)
    check_boxes(str(path), stated, frames.name_of, with_velocity=True)
    map_from_global = np.tile(np.eye(4), (len(stated.frame), 1, 1))
    map_from_global[:, :2, 3] = -frames.global_from_map_m[stated.frame]
    boxes = in_map(stated, map_from_global)
    return FoundSet(name, _FORMAT, boxes, frames.keyframe, has_velocity=True, has_attributes=True)


def _results(path: Path) -> Mapping[str, Any]:
    try:
        content = plain_json.read(path)
    except (OSError, ValueError) as error:
        raise InputError("detections", str(path), f"a JSON file ({error})") from error
    results = content.get("results") if isinstance(content, dict) else None
    if not isinstance(results, dict) or not all(isinstance(boxes, list) for boxes in results.values()):
        raise InputError("detections", str(path), "an object with `meta` and `results`, a list for each sample_token")
    return results


def _columns(path: Path, frames: Frames, rows: list[tuple[int, Any]]) -> StatedBoxes:
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
