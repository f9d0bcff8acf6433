"""What the import of ``siren_ros`` sets before anything else is loaded: the arithmetic of numpy, and short names.

Floating-point arithmetic is pinned, so that an episode has the same bytes on every x86-64 processor with AVX2 and FMA.
numpy and OpenBLAS choose among implementations by the processor, and their results differ in the last bit. They read
environment variables when numpy is loaded; these variables are set.

Short names are those of modules that users import or start: ``siren_ros.learning`` stands for
``siren_ros.lab.learning``.
"""

import importlib.util
import os
import re
import sys
import warnings
from collections.abc import Collection, Mapping, MutableMapping, Sequence
from importlib import import_module
from importlib.abc import InspectLoader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, ModuleType
from typing import Final

_GROUPS_BY_GENERATION: Final = {
    "AVX512F": ("avx512f",),
    "AVX512CD": ("avx512cd",),
    "AVX512_KNL": ("avx512er", "avx512pf"),
    "AVX512_KNM": ("avx512_4fmaps", "avx512_4vnniw"),
    "AVX512_SKX": ("avx512vl", "avx512bw", "avx512dq"),
    "AVX512_CLX": ("avx512_vnni",),
    "AVX512_CNL": ("avx512ifma", "avx512vbmi"),
    "AVX512_ICL": ("avx512_vbmi2", "avx512_bitalg", "avx512_vpopcntdq"),
}
_SAPPHIRE_RAPIDS: Final = {"AVX512_SPR": ("avx512_fp16",)}
_GROUPS_BY_LEVEL: Final = {
    "X86_V4": ("avx512f", "avx512cd", "avx512vl", "avx512bw", "avx512dq"),
    "AVX512_ICL": (
        *("avx512_vnni", "avx512ifma", "avx512vbmi"),
        *("avx512_vbmi2", "avx512_bitalg", "avx512_vpopcntdq"),
    ),
    **_SAPPHIRE_RAPIDS,
}
_SINCE_2_3: Final = (2, 3)
_SINCE_2_4: Final = (2, 4)


class UnpinnedArithmeticWarning(UserWarning):
    """Warns that numpy was loaded before ``siren_ros``, so that its arithmetic depends on this processor."""


def pin_arithmetic(
    environment: MutableMapping[str, str] = os.environ,
    flags: Collection[str] | None = None,
    numpy_version: tuple[int, int] | None = None,
) -> dict[str, str]:
    """Set the environment variables that numpy and OpenBLAS read when they load; existing values stay.

    Args:
        environment: Environment variables of this process.
        flags: What the processor can do, in Linux's names; read from ``/proc/cpuinfo`` where None.
        numpy_version: Major and minor version of numpy; that of the installed one where None.

    Returns:
        The variables that were not set before, with their values.
    """
    able = set(_processor_flags() if flags is None else flags)
    # With more threads, idle ones of OpenBLAS spin after every large product and take a core from the cameras.
    pinned = {"OPENBLAS_NUM_THREADS": "1"}
    if able >= {"avx2", "fma"}:
        pinned["OPENBLAS_CORETYPE"] = "Haswell"
    groups = _groups_beyond_avx2(numpy_version or _installed_numpy())
    if beyond := [group for group, needed in groups.items() if able.issuperset(needed)]:
        pinned["NPY_DISABLE_CPU_FEATURES"] = " ".join(beyond)
    missing = {name: value for name, value in pinned.items() if name not in environment}
    environment.update(missing)
    return missing


def pin_before_numpy() -> None:
    """Pin the arithmetic of this process; warn if numpy is already loaded and did not see the variables."""
    loaded = "numpy" in sys.modules
    missing = pin_arithmetic()
    if loaded and missing:
        variables = " ".join(f"{name}='{value}'" for name, value in missing.items())
        warnings.warn(
            "numpy was loaded before siren_ros and computes as this processor does it fastest: an episode made in this "
            "process can differ in the last bit from the same episode on another machine, so that their hashes differ. "
            f"Import siren_ros before numpy, or start Python with {variables}.",
            UnpinnedArithmeticWarning,
            stacklevel=3,
        )


def _groups_beyond_avx2(numpy_version: tuple[int, int]) -> Mapping[str, tuple[str, ...]]:
    """Groups of instructions beyond AVX2 in numpy's names, with the processor flags (in Linux's names) that each needs.

    numpy's reference, "CPU/SIMD optimizations". numpy warns about a disabled group that the processor does not have and
    about a group that this version of numpy does not know.
    """
    if numpy_version >= _SINCE_2_4:
        return _GROUPS_BY_LEVEL
    if numpy_version >= _SINCE_2_3:
        return {**_GROUPS_BY_GENERATION, **_SAPPHIRE_RAPIDS}
    return _GROUPS_BY_GENERATION


def _installed_numpy() -> tuple[int, int]:
    """Major and minor version of the numpy that would be loaded, without loading it; (1, 26) if unknown."""
    spec = importlib.util.find_spec("numpy")
    if spec is not None and spec.origin is not None:
        text = Path(spec.origin).with_name("version.py").read_text(encoding="utf-8")
        if number := re.search(r"""^\s*(?:full_)?version = ["'](\d+)\.(\d+)""", text, re.MULTILINE):
            return int(number[1]), int(number[2])
    return 1, 26


def _processor_flags(cpuinfo: Path = Path("/proc/cpuinfo")) -> list[str]:
    """Flags of the first processor; none if the file is missing or of another architecture."""
    try:
        lines = cpuinfo.read_text().splitlines()
    except OSError:
        return []
    return next((line.partition(":")[2].split() for line in lines if line.startswith("flags")), [])


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
