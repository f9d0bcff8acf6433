"""Which bags a user names: folders of episodes, and folders of such folders."""

from collections.abc import Iterable
from pathlib import Path

from siren_ros.recording.bag_guard import storage_files


def bags_among(paths: Iterable[Path]) -> tuple[Path, ...]:
    """The bags among some folders: themselves, or those directly in them, sorted by name.

    A folder without any bag stays as it is, so that reading it says what is wrong.
    """
    found: list[Path] = []
    for path in paths:
        inside = [] if storage_files(path) or not path.is_dir() else sorted(path.iterdir())
        bags = [folder for folder in inside if folder.is_dir() and folder.name[0] != "." and storage_files(folder)]
        found += bags or [path]
    return tuple(found)
