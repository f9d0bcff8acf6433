"""Folders that exporters write into."""

from pathlib import Path

from siren_ros.errors import InputError, writing


def new_folder(path: Path) -> Path:
    """Makes a folder for an export.

    Raises:
        InputError: The folder is not empty, or cannot be written.
    """
    with writing(path, "folder"):
        path.mkdir(parents=True, exist_ok=True)
        occupied = any(path.iterdir())
    if occupied:
        raise InputError("out", str(path), "a folder that is new or empty")
    return path
