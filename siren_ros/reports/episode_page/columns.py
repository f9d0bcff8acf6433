"""Stores columns of whole numbers in few bytes, for the page's script to read.

A file is the length of its head, the head as JSON, and the columns, all through zlib. A column holds differences of
neighbours, once or twice, as numbers of 32 or 16 bits that wrap around. Its bytes are sorted by significance: what
changes little is then almost all zeros.
"""

import json
import zlib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

SMALL: Final = 9
MEDIUM: Final = 6
QUICK: Final = 1
"""Compression levels of zlib. The first takes seconds for a town; on noise such as sweeps it takes ten times as long as
the second and saves 4 %."""


class ColumnFile:
    """Collects columns by name."""

    def __init__(self) -> None:
        """Start without columns."""
        self._entries: list[dict[str, Any]] = []
        self._bytes: list[bytes] = []

    def add(self, name: str, values: npt.ArrayLike, unit: float = 1.0, order: int = 1, *, width: int = 4) -> None:
        """Add a column of any shape, rounded to whole multiples of a unit.

        ``order`` is how often neighbours are subtracted: twice for what changes evenly, such as a position. Numbers
        have ``width`` bytes, 4 or 2.
        """
        numbers = np.rint(np.asarray(values, np.float64).ravel() / unit).astype(np.int64).astype(np.uint32)
        for _ in range(order):
            numbers = np.diff(numbers, prepend=np.uint32(0))
        narrow = {} if width == 4 else {"bytes": width}
        self._entries.append({"name": name, "length": len(numbers), "unit": unit, "order": order, **narrow})
        self._bytes.append(numbers.astype(f"<u{width}").view(np.uint8).reshape(-1, width).T.tobytes())

    def add_bytes(self, name: str, content: bytes) -> None:
        """Add bytes unchanged, such as pictures."""
        self._entries.append({"name": name, "length": len(content), "bytes": 1})
        self._bytes.append(content)

    def packed(self, head: Mapping[str, Any], level: int = SMALL) -> bytes:
        """The complete file; ``head`` has JSON types, and the list of columns is added to it."""
        text = json.dumps({**head, "columns": self._entries}, allow_nan=False, separators=(",", ":")).encode()
        return zlib.compress(b"".join((len(text).to_bytes(4, "little"), text, *self._bytes)), level)
