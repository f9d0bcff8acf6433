"""Estimates the cost of a study's episodes: ``python -m siren_ros.benchmarks.study_sizes STUDY``.

Prints the processor time and the size of the bag of an episode on average, and what 10,000 episodes
cost. The numbers come from the study's table of episodes, ``manifest.parquet``.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from siren_ros.errors import EXIT_OK, InputError
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.studies.episode_row import EpisodeRow, rows_of_manifest

_MANY = 10_000


def sizes_of(rows: Sequence[EpisodeRow]) -> dict[str, float]:
    """Means over the recorded episodes, and the cost of ``_MANY`` such episodes; InputError if there is none."""
    recorded = [row for row in rows if row.bag]
    if not recorded:
        raise InputError("study", len(rows), "a study with episodes that were made")
    processor_s = float(np.mean([row.cpu_s for row in recorded]))
    bag_mb = float(np.mean([row.bag_bytes for row in recorded])) / 1e6
    return {
        "episodes": len(recorded),
        "processor_s": processor_s,
        "bag_mb": bag_mb,
        "core_hours_of_10000": processor_s * _MANY / 3600.0,
        "gb_of_10000": bag_mb * _MANY / 1e3,
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line for each number."""
    parser = argparse.ArgumentParser(prog="study_sizes", description=__doc__)
    parser.add_argument("study", type=Path, help="folder that siren generate made")
    add_json(parser)
    arguments = parser.parse_args(argv)
    sizes = sizes_of(rows_of_manifest((arguments.study / "manifest.parquet").read_bytes()))
    for name, value in sizes.items():
        print(f"{name:<20} {value:.3g}")
    write_json(arguments.json, sizes)
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
