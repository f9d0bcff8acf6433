"""Reads OpenPCDet's ``result.pkl`` without running code that the file may contain."""

import io
import pickle
import re
import sys
from math import prod
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.params import plain_files
from siren_ros.base.processes.process_pool import CrashError, ProcessPool, limit_memory
from siren_ros.data.datasets.nuscenes_tables import NUSCENES_FROM_LIDAR
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection import boxes
from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes
from siren_ros.scoring.evaluation.detection.frames import Frames


class _Dtype:
    """Replaces numpy's dtype in a pickle. The file's state could otherwise give numpy invalid pointers or offsets."""

    def __init__(self, name: object, *_: object) -> None:
        if not isinstance(name, str) or not _PLAIN.fullmatch(name):
            raise pickle.UnpicklingError(f"it asks for values of the type {name!r:.40}")
        self._name, self._order = name, "="

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        if len(state) != _DTYPE_STATE or state[2:5] != (None, None, None) or state[1] not in tuple("<>=|"):
            raise pickle.UnpicklingError("it asks for values of several parts")
        self._order = state[1]

    def array(self, shape: object, raw: object) -> Any:
        """Make an array of this type; UnpicklingError if shape and bytes do not match."""
        if isinstance(raw, str):  # pickles of old protocols
            raw = raw.encode("latin1")
        dtype = np.dtype(f"{self._order}{self._name}")
        sizes = shape if isinstance(shape, tuple) else (-1,)
        usable = all(isinstance(size, int) and size >= 0 for size in sizes) and len(sizes) <= _MOST_AXES
        if not usable or not isinstance(raw, bytes | bytearray) or prod(sizes) * dtype.itemsize != len(raw):
            raise pickle.UnpicklingError("it has an array of other bytes than its shape says")
        if dtype.kind == "U" and (np.frombuffer(raw, np.dtype(f"{self._order}u4")) > sys.maxunicode).any():
            raise pickle.UnpicklingError("it has a text of no characters")
        return np.frombuffer(raw, dtype).reshape(sizes) if raw else np.zeros(sizes if 0 in sizes else 0, dtype)


class _Array:
    """Replaces numpy's array in a pickle until its state is known."""

    values: Any = None

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, shape, dtype, by_columns, raw = state
        self.values = _array_of_buffer(raw, dtype, shape, "F" if by_columns else "C")


def _array_of_buffer(raw: object, dtype: object, shape: object, order: object = "C") -> Any:
    """Arrays of numbers in pickles of protocol 5."""
    if not isinstance(dtype, _Dtype):
        raise pickle.UnpicklingError("it has an array without a type")
    if order != "F":
        return dtype.array(shape, raw)
    turned = dtype.array(shape[::-1] if isinstance(shape, tuple) else shape, raw)
    return turned.T


def _new_array(*_: object) -> _Array:
    return _Array()


def _scalar(dtype: object, raw: object) -> Any:
    return _array_of_buffer(raw, dtype, ())[()]


def _latin_bytes(text: object, encoding: object) -> bytes:
    """Bytes as stored in old pickles."""
    if not isinstance(text, str) or encoding != "latin1":
        raise pickle.UnpicklingError(f"it asks for an encoding {encoding!r:.40}")
    return text.encode("latin1")


def _no_bytes() -> bytes:
    """The bytes of an empty array, as stored in old pickles."""
    return b""


_PLAIN: Final = re.compile(r"[biufSU]\d{1,6}")
_DTYPE_STATE: Final = 8
_MOST_AXES: Final = 8
_KNOWN: Final[dict[str, Any]] = {
    **{
        f"{core}.{name}": known
        for core in ("numpy.core", "numpy._core")
        for name, known in {
            "multiarray._reconstruct": _new_array,
            "multiarray.scalar": _scalar,
            "numeric._frombuffer": _array_of_buffer,
        }.items()
    },
    "numpy.ndarray": _Array,
    "numpy.dtype": _Dtype,
    "_codecs.encode": _latin_bytes,
    "__builtin__.bytes": _no_bytes,
}


class _NumbersOnly(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """Give a replacement for a part of numpy; UnpicklingError for anything else."""
        if (known := f"{module}.{name}") not in _KNOWN:
            raise pickle.UnpicklingError(f"it asks for {known:.80}")
        return _KNOWN[known]


def _plain(value: object) -> Any:
    """Convert the replacements to arrays, in the entries of frames and one level below."""
    if isinstance(value, _Array):
        return value.values
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list) else value


def _loaded(path: str) -> Any:
    """Load a pickle; it runs in a process of its own, because a hostile file can exhaust memory or end the process."""
    content = Path(path).read_bytes()
    limit_memory(_SPARE_BYTES + _BYTES_OF_EACH * len(content))
    try:
        return _plain(_NumbersOnly(io.BytesIO(content)).load())
    except Exception as error:  # noqa: BLE001 - a damaged pickle raises many kinds of errors
        allowed = f"{_PICKLE} ({error or type(error).__name__})"
        raise InputError("detections", path, allowed) from None


_PICKLE: Final = "a pickle of lists, dictionaries, texts and numpy arrays alone"
_SPARE_BYTES: Final = 1 << 29
_BYTES_OF_EACH: Final = 16
"""Factor by which Python objects may be larger than their bytes in the file."""
_TIME_S: Final = 120.0


def load_numbers(path: Path) -> Any:
    """Read a pickle that contains only lists, dictionaries, texts, numbers and numpy arrays.

    It is read in a process of its own, with a limit of memory and of time. Nothing in the file reaches numpy but bytes
    with a shape that fits them.

    Raises:
        InputError: It holds anything else, is damaged, or cannot be read.
    """
    try:
        with path.open("rb"), ProcessPool(1, fresh=True) as pool:
            return pool.call(_loaded, str(path), timeout_s=_TIME_S)
    except OSError as error:
        raise InputError("detections", str(path), f"a file that can be read ({error.strerror or error})") from error
    except CrashError as error:
        raise InputError("detections", str(path), f"{_PICKLE} ({error})") from error


MOST_BYTES: Final = 1 << 30
"""Largest size of the arrays of an .npz file; a small file may claim more than the memory holds."""


def load_arrays(path: Path) -> list[dict[str, Any]]:
    """Read an ``.npz`` file into the same form as the pickle: one entry per frame.

    Its arrays are ``frame_id`` or ``token`` and ``count`` (F,), one for each frame, and ``name``, ``score`` (N,) and
    ``boxes_lidar`` (N, 7 or 9), in the order of the frames. Nothing in such a file can run.

    Raises:
        InputError: It holds anything else, is damaged, too large, or cannot be read.
    """
    try:
        return _entries(*_arrays(path))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError("detections", str(path), f"an .npz file of detections ({error})") from error


def _arrays(path: Path) -> tuple[str, Any, Any, dict[str, Any]]:
    """Check the arrays.

    Returns the key that names frames, the names, the number of boxes per frame, and the boxes' columns.
    """
    file = plain_files.read_arrays(path, MOST_BYTES)
    key = "token" if "token" in file else "frame_id"
    columns = {name: file[name] for name in ("name", "score", "boxes_lidar")}
    return key, file[key], file["count"].astype(np.int64, casting="same_kind"), columns


def _entries(key: str, frames: Any, counts: Any, columns: dict[str, Any]) -> list[dict[str, Any]]:
    if counts.shape != (len(frames),) or (counts < 0).any():
        raise ValueError("count is not a number for each frame")
    if {len(column) for column in columns.values()} != {int(counts.sum())}:
        raise ValueError("name, score and boxes_lidar do not have as many rows as count says")
    entries, begin = [], 0
    for frame, count in zip(frames.tolist(), counts.tolist(), strict=True):
        head = {"metadata": {key: frame}} if key == "token" else {key: frame}
        entries.append({**head, **{name: column[begin : begin + count] for name, column in columns.items()}})
        begin += count
    return entries


_FORMAT = "OpenPCDet results"
_WITH_VELOCITY = 9


def read_openpcdet(name: str, path: Path, frames: Frames) -> boxes.FoundSet:
    """Read a file of either dataset; it needs every frame of that dataset.

    Raises:
        InputError: No such file, a frame that the bags do not have or that is missing, or a box that means nothing.
    """
    content = load_arrays(path) if path.suffix == ".npz" else load_numbers(path)
    if not isinstance(content, list) or not content or not all(isinstance(entry, dict) for entry in content):
        raise InputError("detections", str(path), "a list of dictionaries, one for each frame")
    by_token = "token" in _metadata(content[0])
    scored = frames.keyframe if by_token else np.ones(len(frames), dtype=np.bool_)
    numbers = np.array([_frame_of(path, entry, frames, by_token=by_token) for entry in content], dtype=np.intp)
    _check_complete(path, numbers, scored, frames)
    shapes = [np.shape(np.asarray(entry.get("boxes_lidar", ()))) for entry in content]
    width = max(shape[1] if len(shape) == 2 else 0 for shape in shapes)
    stated = _columns(path, content, numbers, frames, width)
    boxes.check_boxes(str(path), stated, frames.name_of, with_velocity=width == _WITH_VELOCITY)
    matrices = frames.map_from_lidar[stated.frame]
    if by_token:
        matrices = matrices @ np.linalg.inv(NUSCENES_FROM_LIDAR)
    found = boxes.in_map(stated, matrices)
    return boxes.FoundSet(name, _FORMAT, found, scored, width == _WITH_VELOCITY)


def _metadata(entry: dict[str, Any]) -> dict[str, Any]:
    metadata = entry.get("metadata")
    return metadata if isinstance(metadata, dict) else {}


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


def _columns(path: Path, content: list[Any], numbers: Rows, frames: Frames, width: int) -> boxes.StatedBoxes:
    found: list[Floats] = [np.zeros((0, max(width, 7)))]
    scores, names, counts = [np.zeros(0)], [np.zeros(0, dtype=np.str_)], []
    for frame, entry in zip(numbers.tolist(), content, strict=True):
        try:
            table = np.asarray(entry["boxes_lidar"], dtype=np.float64)
            score = np.asarray(entry["score"], dtype=np.float64)
            name = np.asarray(entry["name"], dtype=np.str_)
        except (KeyError, ValueError, TypeError) as error:
            given = f"{path}: {frames.name_of(frame)}: {error}"
            raise InputError("detections", given, "name, score and boxes_lidar in each frame") from error
        table = table if table.size else found[0]
        usable = name.shape == score.shape == table.shape[:1] and width in {0, 7, _WITH_VELOCITY}
        if not usable or table.shape[1:] != (max(width, 7),):
            others = f"{name.size} names, {score.size} scores"
            given = f"{path}: {frames.name_of(frame)}: boxes_lidar of shape {table.shape}, {others}"
            raise InputError("detections", given, "a name, a score and 7 numbers for each box, or 9 with its velocity")
        found.append(table)
        scores.append(score)
        names.append(name)
        counts.append(len(score))
    rows = np.concatenate(found)
    velocity = rows[:, 7:9] if width == _WITH_VELOCITY else np.full((len(rows), 2), np.nan)
    return boxes.StatedBoxes(
        frame=np.repeat(numbers, counts),
        centre_m=rows[:, :3],
        size_m=rows[:, 3:6],
        rotation_wxyz=boxes.quaternions_of_yaw(rows[:, 6]),
        velocity_mps=velocity,
        score=np.concatenate(scores),
        label=np.char.lower(np.concatenate(names)),
    )


def openpcdet_entries(found: FoundBoxes, frames: Frames, *, nuscenes: bool) -> list[dict[str, Any]]:
    """Boxes in the form of a result file, for the custom or the nuScenes dataset."""
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
