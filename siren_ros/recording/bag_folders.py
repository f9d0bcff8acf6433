"""Which bags a user names: folders of episodes, and folders with such folders, as a study has them."""

from collections.abc import Iterable
from pathlib import Path

from siren_ros.recording.bag_guard import storage_files


def bags_among(paths: Iterable[Path]) -> tuple[Path, ...]:
    """The bags among some folders: themselves, or those at any depth below them, sorted by path.

    Hidden folders are left out: there bags are under way. A folder without any bag stays as it is, so that reading it
    says what is wrong.
    """
    found: list[Path] = []
    for path in paths:
        inside = set() if storage_files(path) else {file.parent for file in path.rglob("*.mcap")}
        bags = sorted(bag for bag in inside if not any(part[0] == "." for part in bag.relative_to(path).parts))
        found += bags or [path]
    return tuple(found)
