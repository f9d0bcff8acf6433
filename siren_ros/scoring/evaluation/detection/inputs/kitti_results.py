"""Reads and writes KITTI's result files: ``NNNNNN.txt`` with lines of 16 words in the front camera's frame.

Source: the development kit of the object benchmark (Geiger, Lenz, Urtasun 2012), ``readme.txt``: ``type truncated
occluded alpha left top right bottom height width length x y z rotation_y score``; the place is the centre of the
bottom face.
Two more words, which KITTI does not have, may give the velocity along the camera's x and z axes in m/s.
"""

from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Rows
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes
from siren_ros.scoring.evaluation.detection.frames import Frames
from siren_ros.scoring.evaluation.detection.inputs import stated_boxes

_FORMAT: Final = "KITTI results"
_WORDS: Final = 16
_UPRIGHT_FROM_CAMERA: Final = np.array([[0.0, 0, 1.0, 0], [-1.0, 0, 0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])
"""Transform from the camera's axes to forward, left, up: boxes are upright there, and ``rotation_y`` becomes a
heading."""


def read_kitti(name: str, path: Path, frames: Frames) -> stated_boxes.FoundSet:
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
    stated, with_velocity = _columns(path, numbers, lines)
    stated_boxes.check_boxes(str(path), stated, frames.name_of, with_velocity=with_velocity)
    boxes = stated_boxes.in_map(stated, map_from_upright(frames)[stated.frame])
    return stated_boxes.FoundSet(name, _FORMAT, boxes, frames.pictured, with_velocity)


def _lines_of(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise InputError("detections", str(file), f"a text file ({error})") from error


def _columns(path: Path, numbers: Rows, lines: list[tuple[int, list[str]]]) -> tuple[stated_boxes.StatedBoxes, bool]:
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
    stated = stated_boxes.StatedBoxes(
        frame=numbers[[number for number, _ in lines]] if lines else np.zeros(0, dtype=np.intp),
        centre_m=middle @ _UPRIGHT_FROM_CAMERA[:3, :3].T,
        size_m=height[:, [2, 1, 0]],
        rotation_wxyz=stated_boxes.quaternions_of_yaw(-rotation - np.pi / 2.0),
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


def write_kitti(folder: Path, boxes: FoundBoxes, frames: Frames) -> None:
    """Write boxes as KITTI's result files with velocities."""
    folder.mkdir(parents=True, exist_ok=True)
    matrices = map_from_upright(frames)
    for number, frame in enumerate(np.flatnonzero(frames.pictured).tolist()):
        here = boxes.at(boxes.frame == frame)
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
