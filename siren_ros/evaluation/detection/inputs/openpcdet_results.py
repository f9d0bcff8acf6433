"""Detections of OpenPCDet: ``result.pkl``, read without running code that it may hold."""

import io
import pickle
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.core import multiarray

from siren_ros.datasets.nuscenes.episode_tables import NUSCENES_FROM_LIDAR
from siren_ros.errors import InputError
from siren_ros.evaluation.detection.boxes import FoundBoxes
from siren_ros.evaluation.detection.frames import Frames
from siren_ros.evaluation.detection.inputs.stated_boxes import (
    FoundSet,
    StatedBoxes,
    check_boxes,
    in_map,
    quaternions_of_yaw,
)
from siren_ros.numerics.arrays import Flags, Floats, Rows


def _array_of_buffer(buffer: Any, dtype: Any, shape: tuple[int, ...], order: Literal["C", "F", "A"]) -> Any:
    """How pickles of protocol 5 hold arrays of numbers."""
    return np.frombuffer(buffer, dtype=dtype).reshape(shape, order=order)


_KNOWN: Final[dict[tuple[str, str], Any]] = {
    **{
        (f"{core}.multiarray", name): getattr(multiarray, name)
        for core in ("numpy.core", "numpy._core")
        for name in ("_reconstruct", "scalar")
    },
    **{(f"{core}.numeric", "_frombuffer"): _array_of_buffer for core in ("numpy.core", "numpy._core")},
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
}


class _NumbersOnly(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """A function that rebuilds an array; UnpicklingError for anything else."""
        known = _KNOWN.get((module, name))
        if known is not None:
            return known
        if (module, name) == ("_codecs", "encode"):
            return _latin_bytes
        raise pickle.UnpicklingError(f"it asks for {module}.{name}")


def _latin_bytes(text: object, encoding: object) -> bytes:
    """How old pickles hold bytes."""
    if not isinstance(text, str) or encoding != "latin1":
        raise pickle.UnpicklingError(f"it asks for an encoding {encoding!r}")
    return text.encode("latin1")


def load_numbers(path: Path) -> Any:
    """The content of a pickle of lists, dictionaries, texts, numbers and numpy arrays.

    Raises:
        InputError: It holds anything else, is damaged, or cannot be read.
    """
    try:
        return _NumbersOnly(io.BytesIO(path.read_bytes())).load()
    except OSError as error:
        raise InputError("detections", str(path), f"a file that can be read ({error.strerror or error})") from error
    except Exception as error:  # a damaged pickle raises any of a dozen kinds
        allowed = f"a pickle of lists, dictionaries, texts and numpy arrays alone ({error})"
        raise InputError("detections", str(path), allowed) from error


_FORMAT = "OpenPCDet results"
_WITH_VELOCITY = 9


def read_openpcdet(name: str, path: Path, frames: Frames) -> FoundSet:
    """Reads a file of either dataset; every frame of that dataset has to be in it.

    Raises:
        InputError: No such file, a frame that the bags do not have or that is missing, or a box that means nothing.
    """
    content = load_numbers(path)
    if not isinstance(content, list) or not content or not all(isinstance(entry, dict) for entry in content):
        raise InputError("detections", str(path), "a list of dictionaries, one for each frame")
    by_token = "token" in _metadata(content[0])
    scored = frames.keyframe if by_token else np.ones(len(frames), dtype=np.bool_)
    numbers = np.array([_frame_of(path, entry, frames, by_token=by_token) for entry in content], dtype=np.intp)
    _check_complete(path, numbers, scored, frames)
    width = max(map(_width, content))
    stated = _columns(path, content, numbers, frames, width)
    check_boxes(str(path), stated, frames.name_of, with_velocity=width == _WITH_VELOCITY)
    matrices = frames.map_from_lidar[stated.frame]
    if by_token:
        matrices = matrices @ np.linalg.inv(NUSCENES_FROM_LIDAR)
    return FoundSet(name, _FORMAT, in_map(stated, matrices), scored, width == _WITH_VELOCITY)


def _width(entry: dict[str, Any]) -> int:
    boxes = np.asarray(entry.get("boxes_lidar", ()))
    return int(boxes.shape[1]) if boxes.ndim == 2 else 0


def _metadata(entry: dict[str, Any]) -> dict[str, Any]:
    found = entry.get("metadata")
    return found if isinstance(found, dict) else {}


def _frame_of(path: Path, entry: dict[str, Any], frames: Frames, *, by_token: bool) -> int:
    if by_token:
        token = str(_metadata(entry).get("token", ""))
        if token not in frames.by_token:
            raise InputError("detections", f"{path}: token {token}", "keyframes of the given bags, as exported")
        return frames.by_token[token]
    stated = str(entry.get("frame_id", ""))
    if not stated.isdecimal() or int(stated) >= len(frames):
        allowed = f"frames 000000 to {len(frames) - 1:06d} of the given bags, as exported"
        raise InputError("detections", f"{path}: frame_id {stated}", allowed)
    return int(stated)


def _check_complete(path: Path, numbers: Rows, scored: Flags, frames: Frames) -> None:
    count = np.bincount(numbers, minlength=len(frames))
    if (count > 1).any():
        given = frames.name_of(int((count > 1).argmax()))
        raise InputError("detections", f"{path}: {given} twice", "each frame once")
    if (missing := scored & (count == 0)).any():
        given = frames.name_of(int(missing.argmax()))
        raise InputError("detections", f"{path}: nothing for {given}", "an entry for every frame of the dataset")


def _columns(path: Path, content: list[Any], numbers: Rows, frames: Frames, width: int) -> StatedBoxes:
    boxes: list[Floats] = [np.zeros((0, max(width, 7)))]
    scores, names, counts = [np.zeros(0)], [np.zeros(0, dtype=np.str_)], []
    for frame, entry in zip(numbers.tolist(), content, strict=True):
        try:
            found = np.asarray(entry["boxes_lidar"], dtype=np.float64)
            score = np.asarray(entry["score"], dtype=np.float64)
            name = np.asarray(entry["name"], dtype=np.str_)
        except (KeyError, ValueError, TypeError) as error:
            given = f"{path}: {frames.name_of(frame)}: {error}"
            raise InputError("detections", given, "name, score and boxes_lidar in each frame") from error
        found = found if found.size else boxes[0]
        usable = name.shape == score.shape == found.shape[:1] and width in {0, 7, _WITH_VELOCITY}
        if not usable or found.shape[1:] != (max(width, 7),):
            others = f"{name.size} names, {score.size} scores"
            given = f"{path}: {frames.name_of(frame)}: boxes_lidar of shape {found.shape}, {others}"
            raise InputError("detections", given, "a name, a score and 7 numbers for each box, or 9 with its velocity")
        boxes.append(found)
        scores.append(score)
        names.append(name)
        counts.append(len(score))
    rows = np.concatenate(boxes)
    velocity = rows[:, 7:9] if width == _WITH_VELOCITY else np.full((len(rows), 2), np.nan)
    return StatedBoxes(
        frame=np.repeat(numbers, counts),
        centre_m=rows[:, :3],
        size_m=rows[:, 3:6],
        rotation_wxyz=quaternions_of_yaw(rows[:, 6]),
        velocity_mps=velocity,
        score=np.concatenate(scores),
        label=np.char.lower(np.concatenate(names)),
        attribute=None,
    )


def openpcdet_entries(found: FoundBoxes, frames: Frames, *, nuscenes: bool) -> list[dict[str, Any]]:
    """Boxes in the form of a result file, of the custom dataset or of the nuScenes dataset."""
    matrices = frames.map_from_lidar @ (np.linalg.inv(NUSCENES_FROM_LIDAR) if nuscenes else np.eye(4))
    tokens = {frame: token for token, frame in frames.by_token.items()}
    entries = []
    for frame in np.flatnonzero(frames.keyframe if nuscenes else np.ones(len(frames))).tolist():
        here = found.at(found.frame == frame)
        inverse = np.linalg.inv(matrices[frame])
        turn = float(np.arctan2(inverse[1, 0], inverse[0, 0]))
        columns = (
            here.centre_m @ inverse[:3, :3].T + inverse[:3, 3],
            here.size_m,
            here.yaw_rad[:, None] + turn,
            np.nan_to_num(here.velocity_mps) @ inverse[:2, :2].T,
        )
        entry = {"name": here.label, "score": here.score, "boxes_lidar": np.hstack(columns), "frame_id": f"{frame:06d}"}
        entries.append({**entry, "metadata": {"token": tokens[frame]}} if nuscenes else entry)
    return entries
