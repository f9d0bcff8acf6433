"""Whole results compared with stored ones, so that whoever changes a result sees which numbers changed.

A stored result does not say that it is right: closed-form tests do, and the reader of the change. With the variable
SIREN_WRITE_KNOWN=1 a test writes its file anew and fails; the difference that git shows is then to be looked at.
"""

import dataclasses
import enum
import json
import math
import os
from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Any

import numpy as np
import pytest

SHOWN = 12
"""Differences that the message names."""


def assert_known(file: Path, value: object, *, digits: int = 6, decimals: int = 9) -> None:
    """A result is the one that the file stores; a number may differ by one in its last place.

    That is its ``digits``-th significant digit, but not finer than ``decimals`` places behind the point. Of structures
    and named tuples the file has the public fields, of enumerations the names, of arrays the rows.
    """
    now = _plain(value, digits, decimals)
    if os.environ.get("SIREN_WRITE_KNOWN") == "1":
        file.parent.mkdir(exist_ok=True)
        file.write_text(_written(now) + "\n")
        pytest.fail(f"{file.name}: written, look at the change")
    was = dict(_leaves(json.loads(file.read_text())))
    leaves = dict(_leaves(now))
    missing = "nothing"
    differing = [
        f"  {path}: was {was.get(path, missing)}, is {leaves.get(path, missing)}"
        for path in (*was, *(leaves.keys() - was.keys()))
        if path not in leaves or path not in was or not _same(was[path], leaves[path], digits, decimals)
    ]
    if differing:
        further = [f"  and {len(differing) - SHOWN} more"] if len(differing) > SHOWN else []
        heading = f"{file.name}: {len(differing)} of {len(was)} values differ (SIREN_WRITE_KNOWN=1 writes it anew)"
        pytest.fail("\n".join([heading, *differing[:SHOWN], *further]), pytrace=False)


def _plain(value: object, digits: int, decimals: int) -> object:
    """What JSON knows, rounded."""
    opened = _opened(value)
    if isinstance(opened, Mapping):
        return {_key(key): _plain(item, digits, decimals) for key, item in opened.items()}
    if isinstance(opened, list | tuple):
        return [_plain(item, digits, decimals) for item in opened]
    if isinstance(opened, float):
        return _rounded(opened, digits, decimals)
    if opened is None or isinstance(opened, bool | int | str):
        return opened
    raise TypeError(f"no known output: {type(value).__name__}")


def _opened(value: Any) -> object:
    """Structures, named tuples and rows of tables as mappings, arrays as lists."""
    if isinstance(value, enum.Enum):
        return value.name
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value) if not field.name.startswith("_")]
        return {name: getattr(value, name) for name in names}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return value._asdict()
    if isinstance(value, np.ndarray | np.generic):
        columns = value.dtype.names
        return value.tolist() if columns is None else {name: np.asarray(value)[name] for name in columns}
    return sorted(value) if isinstance(value, AbstractSet) else value


def _key(key: object) -> str:
    return key.name if isinstance(key, enum.Enum) else str(key)


def _rounded(number: float, digits: int, decimals: int) -> float | str:
    """Numbers that JSON has no form for are text."""
    if not math.isfinite(number):
        return str(number)
    return round(float(f"{number:.{digits}g}"), decimals) + 0.0


def _same(was: object, now: object, digits: int, decimals: int) -> bool:
    if isinstance(was, float) or isinstance(now, float):
        if not (isinstance(was, int | float) and isinstance(now, int | float)):
            return False
        size = max(abs(was), abs(now))
        place = 10.0 ** (math.floor(math.log10(size)) + 1 - digits) if size else 0.0
        return abs(was - now) <= 1.01 * max(place, 10.0**-decimals)
    return type(was) is type(now) and was == now


def _leaves(value: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Each value by its path; an empty list or table is a value, too."""
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from _leaves(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and value:
        for place, item in enumerate(value):
            yield from _leaves(item, f"{path}[{place}]")
    else:
        yield path, value


def _written(value: object, indent: int = 0) -> str:
    """JSON in which whatever fits stands in one line."""
    line = json.dumps(value, ensure_ascii=False)
    if len(line) + indent <= 120 or not isinstance(value, list | dict):
        return line
    blank = " " * (indent + 1)
    if isinstance(value, dict):
        parts = [f"{blank}{json.dumps(key)}: {_written(item, indent + 1)}" for key, item in value.items()]
        return "{\n" + ",\n".join(parts) + "\n" + " " * indent + "}"
    if not any(isinstance(item, list | dict) for item in value):
        return _wrapped([json.dumps(item, ensure_ascii=False) for item in value], indent)
    return "[\n" + ",\n".join(blank + _written(item, indent + 1) for item in value) + "\n" + " " * indent + "]"


def _wrapped(items: list[str], indent: int) -> str:
    lines = [""]
    for item in items:
        if lines[-1] and len(lines[-1]) + len(item) + indent > 116:
            lines.append("")
        lines[-1] += f"{', ' if lines[-1] else ''}{item}"
    return "[\n" + ",\n".join(" " * (indent + 1) + line for line in lines) + "\n" + " " * indent + "]"
