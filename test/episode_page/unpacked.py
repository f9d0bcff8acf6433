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
        if entry.get("bytes") == 1:
            columns[entry["name"]] = np.frombuffer(content, np.uint8, count, start)
            start += count
            continue
        planes = np.frombuffer(content, np.uint8, 4 * count, start).reshape(4, count)
        values = sum(planes[k].astype(np.int64) << (8 * k) for k in range(4))
        for _ in range(entry["order"]):
            values = np.cumsum(values) % 2**32
        values = np.where(values >= 2**31, values - 2**32, values)
        columns[entry["name"]] = values * entry["unit"]
        start += 4 * count
    assert start == len(content)
    return head, columns
