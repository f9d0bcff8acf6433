"""Which frames a training has: bags, made into files of frames that a second run finds."""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.pillars.grid import PillarGrid
from siren_ros.recording.bag_folders import bags_among
from siren_ros.recording.bag_metadata import METADATA_FILE
from siren_ros.training.detection.frame_store import BagFrames, frames_of_bag, read_frames_file, write_frames

FRAMES_SUFFIX: Final = ".npz"
_FORM: Final = 1
"""Of the files; another form has other names."""


def frames_among(
    paths: Sequence[Path], folder: Path, grid: PillarGrid, told: Callable[[str], None]
) -> tuple[BagFrames, ...]:
    """The frames of all bags, in the order of their paths.

    Args:
        paths: Bags, folders with bags, or files of frames of an earlier run.
        folder: Where files of frames are kept.
        grid: The pillars.
        told: Called with a line for each bag that was read.

    Raises:
        BagError: A bag is damaged or has no LiDAR.
        InputError: A file cannot be read, or none holds a frame.
    """
    files = [path for path in paths if path.suffix == FRAMES_SUFFIX]
    found = [_read(path) for path in files]
    for bag in bags_among(path for path in paths if path not in files):
        file = folder / f"{bag.name}-{_digest(bag, grid)}{FRAMES_SUFFIX}"
        if not file.exists():
            frames = frames_of_bag(bag, grid)
            _kept(file, frames)
            told(f"{bag}: {len(frames)} frames")
        found.append(_read(file))
    if not sum(len(frames) for frames in found):
        raise InputError("bags", ", ".join(map(str, paths)), "at least one episode with labelled sweeps")
    return tuple(found)


def check_apart(trained: Iterable[Mapping[str, Any]], judged: Iterable[Mapping[str, Any]]) -> None:
    """Refuses episodes that judge and share map and seed with one of the training.

    Args:
        trained: What each episode is: ``template``, ``map``, ``seed``.
        judged: Likewise.

    Raises:
        InputError: The first such episode.
    """
    taken = {(about["map"], about["seed"]) for about in trained}
    for about in judged:
        if (about["map"], about["seed"]) in taken:
            told = f"{about['template']} on {about['map']}, seed {about['seed']}"
            raise InputError("held_out", told, "seeds or maps that are not trained on")


def _digest(bag: Path, grid: PillarGrid) -> str:
    try:
        metadata = (bag / METADATA_FILE).read_bytes()
    except OSError as error:
        raise InputError("bag", str(bag), f"a finished bag ({error.strerror})") from error
    text = json.dumps([_FORM, grid.to_json()], sort_keys=True).encode()
    return hashlib.sha256(metadata + text).hexdigest()[:12]


def _kept(file: Path, frames: BagFrames) -> None:
    try:
        write_frames(file, frames)
    except OSError as error:
        raise InputError("cache", str(file.parent), f"a folder that can be written ({error.strerror})") from error


def _read(file: Path) -> BagFrames:
    try:
        return read_frames_file(file)
    except (OSError, ValueError, KeyError) as error:
        raise InputError("frames", str(file), f"a file of frames of an earlier run ({error})") from error
