"""The parts of a reproduction from ``params/reproduction.yaml``: commands, inputs, figures to keep."""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from siren_ros.base.params.strict_yaml import StrictMapping, read_strict_yaml
from siren_ros.errors import InputError

HOURS: Final = 60.0
"""Number of minutes in an hour."""
_MOST_MINUTES: Final = 14 * 24 * HOURS


@dataclass(frozen=True)
class FigureFile:
    """A JSON file that a part's commands write, and which of its numbers are kept as figures."""

    path: str
    """Path in the part's folder. A pattern such as ``*/scores.json`` means all matching files; their folders' names
    follow the prefix."""
    keep: tuple[str, ...]
    """Patterns (``fnmatch``) for the dotted names of figures."""
    prefix: str
    """Prefix of the names, joined with a dot; empty for none."""
    leave_out: tuple[str, ...] = ()
    """Parts of the dotted names that are removed."""
    ratios: tuple[str, ...] = ()
    """Figures that are ratios of others, as ``NAME=A/B`` with names of figures."""
    means: tuple[str, ...] = ()
    """Figures that are means of others, as ``NAME=PATTERN`` with a pattern of figures' names."""


@dataclass(frozen=True)
class TargetFile:
    """A file that a part makes for the repository: a picture, a film, trained weights."""

    source: str
    """Path in the part's folder."""
    target: str
    """Path in the repository."""


@dataclass(frozen=True)
class Part:
    """One part. It is made as a whole, and again when its inputs change."""

    name: str
    about: str
    minutes: float
    """Wall time on two cores in minutes."""
    needs: tuple[str, ...]
    """Names of parts whose folders its commands read."""
    code: tuple[str, ...]
    """Files and folders of the repository that decide its figures."""
    files: tuple[str, ...]
    """Files outside the repository that it needs, as paths relative to it; without them the part is skipped."""
    commands: tuple[str, ...]
    """Commands; ``{out}`` is the part's folder, ``{NAME}`` that of the needed part NAME, ``{workers}`` a number."""
    figures: tuple[FigureFile, ...]
    targets: tuple[TargetFile, ...]

    def missing(self, repository: Path) -> tuple[str, ...]:
        """Needed files that are missing."""
        return tuple(file for file in self.files if not (repository / file).exists())


def read_parts(file: Path, repository: Path) -> dict[str, Part]:
    """Read the parts by name, in the order of the file; a part must stand below the parts that it needs.

    Raises:
        InputError: The file names a part that does not stand above, or a path that the repository does not have.
    """
    content = read_strict_yaml(file)
    groups = content.mapping("code")
    code = {name: groups.words(name) for name in tuple(groups.values)}
    parts: dict[str, Part] = {}
    for entry in content.mappings("parts"):
        part = _part(entry, code)
        if part.name in parts:
            raise InputError(entry.where("name"), part.name, "each part once")
        for need in part.needs:
            if need not in parts:
                raise InputError(entry.where("needs"), need, "a part that stands above")
        for path in part.code:
            if not (repository / path).exists():
                raise InputError(entry.where("code"), path, "a file or folder of the repository")
        parts[part.name] = part
    content.finish()
    return parts


def _part(entry: StrictMapping, code: Mapping[str, tuple[str, ...]]) -> Part:
    named = entry.words("code")
    for name in named:
        if name not in code:
            raise InputError(entry.where("code"), name, f"one of {', '.join(code)}")
    figures = entry.mappings("figures") if entry.has("figures") else ()
    targets = entry.mappings("made") if entry.has("made") else ()
    part = Part(
        name=entry.text("name"),
        about=entry.text("about"),
        minutes=entry.number("minutes", 0.0, _MOST_MINUTES),
        needs=_words(entry, "needs"),
        code=tuple(path for name in named for path in code[name]),
        files=_words(entry, "files"),
        commands=entry.words("commands"),
        figures=tuple(
            FigureFile(
                source.text("file"),
                source.words("keep"),
                source.text("prefix") if source.has("prefix") else "",
                *(_words(source, key) for key in ("leave_out", "ratios", "means")),
            )
            for source in figures
        ),
        targets=tuple(TargetFile(target.text("from"), target.text("to")) for target in targets),
    )
    for mapping in (*figures, *targets, entry):
        mapping.finish()
    return part


def _words(mapping: StrictMapping, key: str) -> tuple[str, ...]:
    """An optional list of words."""
    return mapping.words(key) if mapping.has(key) else ()


def inputs_sha256(part: Part, repository: Path, needed: Iterable[str]) -> str:
    """Hash of everything that decides a part: commands, code, outside files, hashes of needed parts."""
    digest = hashlib.sha256(json.dumps([part.commands, part.files, list(needed)]).encode())
    roots = [repository / name for name in (*part.code, *part.files)]
    for path in sorted(file for root in roots for file in ([root] if root.is_file() else root.rglob("*"))):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(f"\0{path.name}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def shown_minutes(minutes: float) -> str:
    """A duration as text: ``12 min``, ``3.5 h``."""
    return f"{math.ceil(minutes)} min" if minutes < 2 * HOURS else f"{minutes / HOURS:.1f} h"
