"""Reads an episode's data back, as the page's script does, but by itself."""

import json
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt


def unpacked(data: bytes) -> tuple[dict[str, Any], dict[str, npt.NDArray[np.float64]]]:
    """The head, and the columns in their units."""
    content = zlib.decompress(data)
    length = int.from_bytes(content[:4], "little")
    head = json.loads(content[4 : 4 + length])
    start, columns = 4 + length, {}
    for entry in head["columns"]:
        count = entry["length"]
        width = entry.get("bytes", 4)
        if width == 1:
            columns[entry["name"]] = np.frombuffer(content, np.uint8, count, start)
            start += count
            continue
        planes = np.frombuffer(content, np.uint8, width * count, start).reshape(width, count)
        values, whole = sum(planes[k].astype(np.int64) << (8 * k) for k in range(width)), 2 ** (8 * width)
        for _ in range(entry["order"]):
            values = np.cumsum(values) % whole
        values = np.where(values >= whole // 2, values - whole, values)
        columns[entry["name"]] = values * entry["unit"]
        start += width * count
    assert start == len(content)
    return head, columns
