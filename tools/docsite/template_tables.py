"""Tables of a template's parameters and thresholds, from its YAML file with the comments in it."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

_ENTRY: Final = re.compile(r"(?P<indent> *)(?P<key>\w+):(?: (?P<value>.+))?")
_COMMENT: Final = re.compile(r" *# (.*)")


@dataclass(frozen=True)
class Entry:
    """One key of a YAML file, with what the comment above it says."""

    path: str
    value: Any
    """None for a key that holds others."""
    comment: str


def entries(text: str) -> Iterator[Entry]:
    """The keys of a YAML text of nested mappings, in its order.

    A comment of several lines is one text. It also belongs to the number after a key with a word, as in "start_from"
    and "start_m".
    """
    comment: list[str] = []
    path: list[str] = []
    goes_on = False
    for line in text.splitlines():
        if said := _COMMENT.fullmatch(line):
            comment = [*comment, said[1]] if goes_on else [said[1]]
            goes_on = True
            continue
        goes_on = False
        if entry := _ENTRY.fullmatch(line):
            path[len(entry["indent"]) // 2 :] = [entry["key"]]
            value = None if entry["value"] is None else yaml.safe_load(entry["value"])
            yield Entry(".".join(path), value, " ".join(comment))
            if isinstance(value, str):
                continue
        comment = []


def _range(values: list[float] | None) -> str:
    return "" if values is None else f"{values[0]:g} to {values[1]:g}"


def _row(entry: Entry) -> str:
    """A parameter's line; for a group of vehicles, what the group is."""
    name = entry.path.replace("demand.groups.", "demand.")  # as values and ranges name it
    if entry.value is None:
        return f"| `{name}` | | | | *{entry.comment}* |"
    limits, drawn = _range(entry.value["range"]), _range(entry.value.get("draw"))
    return f"| `{name}` | {entry.value['default']:g} | {limits} | {drawn} | {entry.comment} |"


def template_table(file: Path) -> str:
    """The tables of a template as Markdown: its parameters, then the thresholds of its predicate.

    Args:
        file: Its YAML file.
    """
    parameter_entries = list(entries(file.read_text(encoding="utf-8")))
    parameters = [
        _row(entry)
        for entry in parameter_entries
        if isinstance(entry.value, dict) or (entry.value is None and entry.path.startswith("demand.groups."))
    ]
    thresholds = [
        f"| `{entry.path}` | {entry.value} | {entry.comment} |"
        for entry in parameter_entries
        if entry.path.startswith("predicate.") and entry.path != "predicate.name"
    ]
    tables = [
        "| parameter | default | range of studies | drawn by every seed | meaning |\n|---|---|---|---|---|",
        *parameters,
    ]
    if thresholds:
        tables += ["\n| threshold | value | meaning |\n|---|---|---|", *thresholds]
    return "\n".join(tables)
