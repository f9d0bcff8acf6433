"""Looks packages and their executables up where ROS does: in the prefixes that ``AMENT_PREFIX_PATH`` names."""

import os
from pathlib import Path
from typing import Final

from small_ros2.errors import CommandError

MARKERS = Path("share/ament_index/resource_index/packages")

BUILT_IN: Final = {
    "tf2_ros": {"tf2_echo": "small_ros2.tf2_echo"},
    "tf2_tools": {"view_frames": "small_ros2.view_frames"},
}
"""Executables of ROS's packages that the small ros2 brings itself, each with the module whose ``main`` it is."""


def prefixes() -> list[Path]:
    """The prefixes, earlier ones win."""
    return [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]


def built_in(package: str) -> dict[str, str]:
    """The executables of a package that the small ros2 brings, with their modules; none where it is installed."""
    return {} if package in packages() else BUILT_IN.get(package, {})


def packages() -> dict[str, Path]:
    """Every known package and the prefix that it is taken from, sorted by name."""
    folders: dict[str, Path] = {}
    for prefix in prefixes():
        if (prefix / MARKERS).is_dir():
            for marker in (prefix / MARKERS).iterdir():
                folders.setdefault(marker.name, prefix)
    return dict(sorted(folders.items()))


def prefix_of(package: str) -> Path:
    """The prefix that holds a package.

    Raises:
        CommandError: No prefix holds it.
    """
    for prefix in prefixes():
        if (prefix / MARKERS / package).is_file():
            return prefix
    raise CommandError(f"package '{package}' not found in AMENT_PREFIX_PATH")


def executables(package: str) -> list[Path]:
    """The executables of a package, sorted: the executable files below ``lib/PACKAGE`` of its prefix.

    Raises:
        CommandError: The package is not known.
    """
    folder = prefix_of(package) / "lib" / package
    return sorted(path for path in folder.rglob("*") if path.is_file() and os.access(path, os.X_OK))


def executable(package: str, name: str) -> Path:
    """One executable of an installed package.

    Raises:
        CommandError: The package or the executable is not known; the message lists what there is.
    """
    if brought := built_in(package):
        raise CommandError(f"package '{package}' has no executable '{name}' here; it has: {', '.join(brought)}")
    known = executables(package)
    for path in known:
        if path.name == name:
            return path
    names = ", ".join(path.name for path in known) or "none"
    raise CommandError(f"package '{package}' has no executable '{name}'; it has: {names}")
