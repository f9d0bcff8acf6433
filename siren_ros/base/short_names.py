"""Short names of modules that users import or start: ``siren_ros.learning`` stands for ``siren_ros.lab.learning``."""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import InspectLoader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import CodeType, ModuleType
from typing import Final

SHORT_NAMES: Final = {f"siren_ros.{name}": f"siren_ros.lab.{name}" for name in ("learning", "training", "benchmarks")}
"""Long module name by short name. It applies to the module and to all modules below it."""


def full_name(name: str) -> str:
    """Full name of a module; the name itself if it has no other."""
    for short, full in SHORT_NAMES.items():
        if name == short or name.startswith(f"{short}."):
            return full + name.removeprefix(short)
    return name


class _Loader(InspectLoader):
    """Returns the same module under its short and its full name."""

    def __init__(self, spec: ModuleSpec) -> None:
        self._spec = spec

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return import_module(self._spec.name)

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec  # the import system has put the short name there

    def get_code(self, fullname: str) -> CodeType | None:
        loader = self._spec.loader
        return loader.get_code(self._spec.name) if isinstance(loader, InspectLoader) else None

    def get_source(self, fullname: str) -> str | None:
        loader = self._spec.loader
        return loader.get_source(self._spec.name) if isinstance(loader, InspectLoader) else None


class _Finder(MetaPathFinder):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if (full := full_name(fullname)) == fullname or (spec := find_spec(full)) is None:
            return None
        is_package = spec.submodule_search_locations is not None
        return ModuleSpec(fullname, _Loader(spec), origin=spec.origin, is_package=is_package)


def allow_short_names() -> None:
    """Make imports such as ``siren_ros.learning`` and ``python -m siren_ros.benchmarks.sensors`` find the lab.

    The finder stands before the others: these would load a second copy of a module below a short name.
    """
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
