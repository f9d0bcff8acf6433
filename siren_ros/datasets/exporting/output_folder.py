"""Folders that exporters write into."""

from pathlib import Path

from siren_ros.errors import InputError


def new_folder(path: Path) -> Path:
    """Makes a folder for an export.

    Raises:
        InputError: The folder is not empty, or cannot be written.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        occupied = any(path.iterdir())
    except OSError as error:
        raise InputError("out", str(path), f"a folder that can be written ({error.strerror or error})") from error
    if occupied:
        raise InputError("out", str(path), "a folder that is new or empty")
    return path
