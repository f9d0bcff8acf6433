"""Which interfaces are installed, from the ament index."""

import os
from collections.abc import Iterable
from pathlib import Path

_INDEX = Path("share/ament_index/resource_index/rosidl_interfaces")


def _prefixes() -> list[Path]:
    return [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]


def _packages() -> dict[str, Path]:
    """Every package with interfaces, and its prefix; earlier prefixes win."""
    prefixes: dict[str, Path] = {}
    for prefix in _prefixes():
        for marker in sorted((prefix / _INDEX).glob("*")):
            prefixes.setdefault(marker.name, prefix)
    return dict(sorted(prefixes.items()))


def get_interface_packages() -> dict[str, str]:
    """The packages with interfaces, and their prefixes."""
    return {name: str(prefix) for name, prefix in _packages().items()}


def get_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """Names such as ``msg/String`` of the interfaces of packages, by default of all.

    Raises:
        LookupError: A package has no interfaces, or is not installed.
    """
    known = _packages()
    interfaces = {}
    for package in package_names or known:
        if package not in known:
            raise LookupError(f"Unknown package '{package}'")
        lines = (known[package] / _INDEX / package).read_text(encoding="utf-8").splitlines()
        names = {line.rsplit(".", 1)[0] for line in lines if line.endswith((".msg", ".srv", ".action", ".idl"))}
        interfaces[package] = sorted(names)
    return interfaces


def _of_kind(kind: str, package_names: Iterable[str]) -> dict[str, list[str]]:
    chosen = {
        package: [name for name in names if name.startswith(f"{kind}/")]
        for package, names in get_interfaces(package_names).items()
    }
    return {package: names for package, names in chosen.items() if names}


def get_message_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """The messages among ``get_interfaces``."""
    return _of_kind("msg", package_names)


def get_service_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """The services among ``get_interfaces``."""
    return _of_kind("srv", package_names)


def get_action_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """The actions among ``get_interfaces``."""
    return _of_kind("action", package_names)


def get_interface_path(parts: Iterable[str]) -> str:
    """The file that defines an interface, from the parts ``package, kind, Name`` of its name.

    Raises:
        LookupError: The interface is not installed.
    """
    package, *rest = parts
    prefix = _packages().get(package)
    if prefix is not None:
        base = prefix / "share" / package / "/".join(rest)
        for suffix in ("", ".msg", ".srv", ".action", ".idl"):
            path = base.with_name(base.name + suffix)
            if path.is_file():
                return str(path)
    raise LookupError(f"Could not find the interface '{'/'.join((package, *rest))}'")
