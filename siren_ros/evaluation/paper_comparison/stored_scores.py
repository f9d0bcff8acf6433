"""Scores that other commands wrote: ``scores.json`` of the tasks that need sensors or videos."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.interval import BLOCKS_MIN, NOTHING, Interval

FILE: Final = "scores.json"


def stored(folder: Path) -> Mapping[str, Any] | None:
    """The scores in a folder, or of a file; None where there are none.

    Raises:
        InputError: Something else than a JSON object.
    """
    file = folder if folder.is_file() else folder / FILE
    if not file.is_file():
        return None
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError("scores", str(file), f"the scores that `siren evaluate` wrote ({error})") from error
    if not isinstance(content, dict):
        raise InputError("scores", str(file), "the scores that `siren evaluate` wrote, a JSON object")
    return content


def interval_in(content: Mapping[str, Any] | None, key: str = "value") -> Interval:
    """An interval as the reports write it: ``value``, ``low``, ``high``; null where there is none."""
    if content is None or content.get(key) is None:
        return NOTHING
    low, high = content.get("low"), content.get("high")
    if low is None or high is None:
        blocks = int(content.get("episodes", 1))
        return Interval(content[key], content[key], content[key], blocks, scatter_known=False)
    return Interval(content[key], low, high, int(content.get("episodes", BLOCKS_MIN)))
