"""Which reader a file of detections belongs to."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.inputs.found_set import FoundSet
from siren_ros.evaluation.detection.inputs.kitti_results import read_kitti
from siren_ros.evaluation.detection.inputs.nuscenes_results import read_nuscenes
from siren_ros.evaluation.detection.inputs.openpcdet_results import read_openpcdet
from siren_ros.evaluation.detection.inputs.topic_results import TOPIC_PREFIX, read_topic
from siren_ros.evaluation.detection.protocol.frames import Frames

_READERS: Final[dict[str, Callable[[str, Path, Frames], FoundSet]]] = {
    ".json": read_nuscenes,
    ".pkl": read_openpcdet,
    ".pickle": read_openpcdet,
}


def read_detections(name: str, source: str, frames: Frames) -> FoundSet:
    """Reads what a user names: a JSON file, a pickle, a folder of text files, or ``topic:/NAME``.

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
