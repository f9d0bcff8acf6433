"""Measured figures in files: those of a benchmark (``--json FILE``), and the file of results of all parts.

The file of results has each part's figures with the commands, code and machine that made them.
"""

import argparse
import json
import math
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from fnmatch import fnmatchcase
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from siren_ros.base.params import plain_files
from siren_ros.errors import InputError, write_text

Figure = float | int | str
_VERSIONS: Final = ("numpy", "libsumo", "numba", "onnxruntime")
_LABELS: Final = (
    *("of", "name", "template", "model", "kind", "group", "metric"),
    *("outcome", "class", "map", "level", "levels"),
)
"""Keys whose texts (or lists of texts) name a list item, in this order."""


@dataclass(frozen=True)
class PartResult:
    """Result of one part."""

    inputs_sha256: str
    """Hash of the part's inputs; empty for figures that were entered by hand."""
    commands: tuple[str, ...]
    machine: Mapping[str, str]
    minutes: float
    figures: Mapping[str, Figure] = field(default_factory=dict)


def read_results(file: Path) -> dict[str, PartResult]:
    """Read the results by part, empty if there is no file; InputError if the file is damaged."""
    if not file.exists():
        return {}
    try:
        stored = plain_files.read_json(file)
        kinds = {"inputs_sha256": str, "commands": tuple, "machine": dict, "minutes": float, "figures": dict}
        return {
            name: PartResult(**{key: kind(part[key]) for key, kind in kinds.items()})
            for name, part in stored["parts"].items()
        }
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError("results", str(file), f"a file of results; {error!r}") from error


def write_results(file: Path, results: Mapping[str, PartResult]) -> None:
    """Write all results, sorted by name, so that changes affect few lines."""
    content = {"parts": {name: asdict(part) for name, part in sorted(results.items())}}
    write_text(file, json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False) + "\n")


def machine() -> dict[str, str]:
    """Facts about the machine: cores, load, processor, Python, versions of numerical packages.

    The load is the mean number of waiting processes in the last minute: times mean little where it exceeds the cores.
    """
    lines: list[str] = []
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    processors = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    card = {
        "cores": str(os.cpu_count()),
        "load": f"{os.getloadavg()[0]:.1f}",
        "processor": next(processors, platform.machine()),
        "python": platform.python_version(),
    }
    for package in _VERSIONS:
        with suppress(PackageNotFoundError):
            card[package] = version(package)
    return card


def figures_in(
    content: Any, keep: tuple[str, ...], prefix: str = "", leave_out: tuple[str, ...] = ()
) -> dict[str, Figure]:
    """Numbers and texts of a JSON document by dotted names that match a pattern of ``keep``.

    An item of a list is named by its texts under the keys ``name``, ``template``, ``model`` and so on, otherwise by its
    place: ``[{"template": "S1", "model": "cv", "ade_m": 1.99}]`` gives ``S1.cv.ade_m``. Spaces and
    colons become ``_``, because a mark in a document ends with them. The other arguments are as the fields of
    ``FigureFile``.

    Raises:
        InputError: Two numbers have one name, or a pattern matches nothing.
    """
    figures: dict[str, Figure] = {}
    matched: set[str] = set()
    for name, value in _leaves(content, ()):
        hits = {pattern for pattern in keep if fnmatchcase(name, pattern)}
        if not hits:
            continue
        matched |= hits
        parts = [part for part in name.split(".") if part not in leave_out]
        full = ".".join([prefix, *parts] if prefix else parts).replace(" ", "_").replace(":", "_")
        if full in figures:
            raise InputError("figures", full, "one number of each name")
        figures[full] = value
    for pattern in keep:
        if pattern not in matched:
            raise InputError("figures", pattern, "a pattern that matches a number of the file")
    return figures


def _leaves(content: Any, above: tuple[str, ...]) -> Iterator[tuple[str, Figure]]:
    if isinstance(content, Mapping):
        for key, value in content.items():
            yield from _leaves(value, (*above, str(key)))
    elif isinstance(content, list):
        for place, item in enumerate(content):
            labels = [label for key in _LABELS if isinstance(item, Mapping) and (label := _label(item.get(key)))]
            rest = {key: value for key, value in item.items() if key not in _LABELS} if labels else item
            yield from _leaves(rest, (*above, *(labels or [str(place)])))
    elif isinstance(content, int | float | str):
        yield ".".join(above), content


def _label(value: Any) -> str:
    """Name of a list item: a text, or texts such as two levels as ``L3-L1``; empty for other values."""
    if isinstance(value, list) and all(isinstance(text, str) for text in value):
        return "-".join(value)
    return value if isinstance(value, str) else ""


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there, too")


def write_json(file: Path | None, content: Any) -> None:
    """Write the figures if the option was given; infinite values and NaN become null. InputError as ``write_text``."""
    if file is not None:
        write_text(file, json.dumps(_finite(content), indent=1, allow_nan=False) + "\n")


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
