"""Parameter files by name: templates, presets, suites, looks, drivers, vehicles."""

from contextlib import suppress
from pathlib import Path

from siren_ros.errors import InputError
from siren_ros.params.resources import params_dir

__all__ = ["named_params_file", "names_in_params", "params_dir"]


def named_params_file(parameter: str, folder: str, name_or_path: str) -> Path:
    """The file ``params/<folder>/<name>.yaml``, or a path to a YAML file given as such.

    Args:
        parameter: Name of the parameter that the user set, for the error.
        folder: Folder below ``params``.
        name_or_path: ``S2``, or a path that ends in ``.yaml`` or ``.yml``.

    Raises:
        InputError: no such file; lists the names that there are.
    """
    available = names_in_params(folder)
    if name_or_path in available:
        return params_dir() / folder / f"{name_or_path}.yaml"
    with suppress(OSError, ValueError, RuntimeError):  # a name too long, a null character, an unknown user's home
        path = Path(name_or_path).expanduser()
        if path.suffix in {".yaml", ".yml"} and path.is_file():
            return path
    raise InputError(parameter, name_or_path, f"one of {', '.join(available)}, or the path of a YAML file")


def names_in_params(folder: str) -> tuple[str, ...]:
    """Names of the YAML files of a folder below ``params``, sorted."""
    return tuple(sorted(path.stem for path in (params_dir() / folder).glob("*.yaml")))
