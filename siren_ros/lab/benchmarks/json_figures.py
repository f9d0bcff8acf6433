"""The option ``--json FILE`` of the benchmarks: it writes the printed figures for ``siren reproduce``."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

from siren_ros.errors import write_text


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
