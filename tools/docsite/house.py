"""How large the library is: files, lines and classes of its wings, as they are and as the last release had them."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from siren_ros.errors import write_text

_CLASS: Final = re.compile(r"^\s*class \w+", re.MULTILINE)


class Size(NamedTuple):
    """The size of one wing."""

    files: int
    lines: int
    classes: int


def sizes_of(library: Path) -> dict[str, Size]:
    """The size of each wing of a library, by name; ``library`` is its folder. Files beside the wings do not count."""
    sizes = {}
    for wing in sorted({file.parent for file in library.glob("*/__init__.py")}):
        texts = [file.read_text(encoding="utf-8") for file in wing.rglob("*.py")]
        lines, classes = sum(text.count("\n") for text in texts), sum(len(_CLASS.findall(text)) for text in texts)
        sizes[wing.name] = Size(len(texts), lines, classes)
    return sizes


def record_sizes(record: Path, library: Path) -> None:
    """Writes the sizes of a library's wings into a record, as a release does."""
    sizes = {name: size._asdict() for name, size in sizes_of(library).items()}
    write_text(record, json.dumps(sizes, indent=1) + "\n")


def recorded_sizes(record: Path) -> dict[str, Size]:
    """The sizes that a record has, by the name of the wing."""
    return {name: Size(**size) for name, size in json.loads(record.read_text(encoding="utf-8")).items()}


def grown(now: Mapping[str, Size], then: Mapping[str, Size], share: float) -> dict[str, float]:
    """By which share of its lines each wing has grown, of those that have grown by more than ``share``.

    A new wing has grown by all that it has: infinitely.
    """
    growth = {name: size.lines / then[name].lines - 1.0 if name in then else float("inf") for name, size in now.items()}
    return {name: grows for name, grows in growth.items() if grows > share}


def sizes_table(record: Path) -> str:
    """The recorded sizes as Markdown: wing, files, lines, classes; the last row is their sum."""
    sizes = recorded_sizes(record)
    rows = [(f"`{name}`", *size) for name, size in sizes.items()]
    total = ("all", *map(sum, zip(*sizes.values(), strict=True)))
    lines = [f"| {name} | {files} | {lines:,} | {classes} |" for name, files, lines, classes in [*rows, total]]
    return "\n".join(["| wing | files | lines | classes |", "|---|---|---|---|", *lines])
