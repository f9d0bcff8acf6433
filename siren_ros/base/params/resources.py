"""Finds the package's data files: in the repository, or where colcon or pip installed them.

Parameter files are found by name: templates, presets, suites, looks, drivers, vehicles.
"""

import os
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError

PACKAGE: Final = "siren_ros"


def find_params_dir(package_file: Path, ament_prefix_path: str) -> Path:
    """Find the folder of parameter files of an installed or checked-out package.

    A checkout (also an editable or a ``--symlink-install`` one) holds ``params/`` beside the package. An installation
    holds ``share/siren_ros/params`` in the prefix above the package; failing that, the prefixes of the value of
    ``AMENT_PREFIX_PATH`` are searched, earlier ones first. ``package_file`` lies directly in the package's folder.

    Raises:
        InputError: No such folder exists.
    """
    package_dir = package_file.resolve().parent
    checkout = package_dir.parent
    if (checkout / "package.xml").is_file() and (checkout / "params").is_dir():
        return checkout / "params"
    prefixes = [*package_dir.parents, *(Path(prefix) for prefix in ament_prefix_path.split(os.pathsep) if prefix)]
    for prefix in prefixes:
        installed = prefix / "share" / PACKAGE / "params"
        if installed.is_dir():
            return installed
    allowed = f"one with params/ beside it or share/{PACKAGE}/params in its prefix"
    raise InputError("installation", str(package_dir), allowed)


@cache
def params_dir() -> Path:
    """The folder with ``templates/``, ``suites/`` and so on; InputError if the installation has none."""
    return find_params_dir(Path(__file__).parents[2] / "__init__.py", os.environ.get("AMENT_PREFIX_PATH", ""))


def named_params_file(parameter: str, folder: str, name_or_path: str) -> Path:
    """Path of ``params/<folder>/<name>.yaml``, or of a user's file with the suffix ``.yaml`` or ``.yml``.

    Raises:
        InputError: No such file; names the parameter that the user set, and lists the names that there are.
    """
    # The name may be too long, contain a null character, or name an unknown user's home.
    with suppress(OSError, ValueError, RuntimeError):
        path = params_dir() / folder / f"{name_or_path}.yaml"
        if name_or_path == path.stem and path.is_file():
            return path
        path = Path(name_or_path).expanduser()
        if path.suffix in {".yaml", ".yml"} and path.is_file():
            return path
    available = ", ".join(names_in_params(folder))
    raise InputError(parameter, name_or_path, f"one of {available}, or the path of a YAML file")


def names_in_params(folder: str) -> tuple[str, ...]:
    """Names of the YAML files of a folder below ``params``, sorted."""
    return tuple(sorted(path.stem for path in (params_dir() / folder).glob("*.yaml")))
