"""Folders: the package's data files, and the user's own files.

Data files lie in the repository, or where colcon or pip installed them. Parameter files are found by name: templates,
presets, suites, looks, drivers, vehicles. The user's files lie below the home, or in a temporary folder where no home
can be written.
"""

import os
import stat
import tempfile
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


def user_folder(below_home: str) -> Path:
    """A writable folder for caches and logs; it is created if missing.

    Args:
        below_home: Where it lies below the user's home, such as ``.cache/siren``. Without a home, or with one that
            cannot be written, it lies below ``siren_ros_UID`` in the folder for temporary files instead.

    Raises:
        InputError: There is no folder for temporary files either.
    """
    with suppress(RuntimeError):  # there is no HOME, and the system does not know the user
        home = Path.home()
        if home.is_dir() and is_writable(home / below_home):
            return home / below_home
    try:
        folder = private_folder(f"siren_ros_{os.geteuid()}")
        if not is_writable(folder / below_home):
            folder = Path(tempfile.mkdtemp(prefix="siren_ros_"))  # a folder of that name belongs to another user
            (folder / below_home).mkdir(parents=True)
    except OSError as error:
        why = f"the home of a user, or a folder for temporary files, that can be written ({error.strerror or error})"
        raise InputError("HOME", os.environ.get("HOME", ""), why) from error
    return folder / below_home


def default_cache_dir() -> Path:
    """The folder for what was compiled once, such as maps and scenes: the one that the environment asks for."""
    if siren := os.environ.get("SIREN_CACHE_DIR"):
        return Path(siren)
    shared = os.environ.get("XDG_CACHE_HOME")
    return Path(shared) / "siren" if shared else user_folder(".cache/siren")


def store_in_cache(file: Path, content: bytes) -> None:
    """Write a file under a temporary name and rename it, so that other programs see a whole file or none.

    Raises:
        InputError: Its folder cannot be written.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, prefix=f".{file.name}.", delete=False) as partial:
            partial.write(content)
        Path(partial.name).replace(file)
    except OSError as error:
        raise InputError("SIREN_CACHE_DIR", str(file.parent), f"a folder that can be written ({error})") from error


_instead: Final[dict[str, Path]] = {}
"""Folders of this process that replace names taken by other users."""


def private_folder(name: str) -> Path:
    """A temporary folder that other users cannot read or write; it has the same name in every process, if possible.

    Anybody may make files in the folder for temporary files: where the name is a link there, belongs to another user,
    or can be written by others, this process has a new folder with a name that nobody knows.

    Raises:
        OSError: No folder can be made.
    """
    folder = Path(tempfile.gettempdir()) / name
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    found = folder.lstat()
    if stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022:
        folder.chmod(0o700)
        return folder
    if name not in _instead or not _instead[name].is_dir():
        _instead[name] = Path(tempfile.mkdtemp(prefix=f"{name}-"))
    return _instead[name]


def is_writable(folder: Path) -> bool:
    """Whether files can be written into a folder; it is created if missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)
