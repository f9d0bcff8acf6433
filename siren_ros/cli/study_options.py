"""Options of a study's matrix, and its progress bar, for the commands that make studies."""

import argparse
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final

from tqdm import tqdm

from siren_ros.roads.maps.map_compiler import BUILT_IN_MAPS
from siren_ros.studies.episode_row import EpisodeRow, Status
from siren_ros.studies.matrix import TOWN, levels_of, seeds_of
from siren_ros.studies.run_study import StudyObserver

BUILT_IN: Final = "{}, {} or {}".format(*BUILT_IN_MAPS)
"""The built-in maps, in words."""
MATRIX: Final[Mapping[str, Callable[[Any], Any]]] = {
    "templates": tuple,
    "levels": levels_of,
    "seeds": seeds_of,
    "maps": tuple,
    "sites": tuple,
    "preset": str,
    "sensors": str,
    "look": str,
    "duration_s": float,
    "values": str,
}
"""Options of the matrix, by the study's fields that they stand for, and how their words are read."""


def add_matrix(matrix: "argparse._ArgumentGroup", templates: str, levels: str, seeds: str) -> None:
    """Adds the options of the matrix; the texts name what stands without them."""
    matrix.add_argument(
        "--templates", nargs="+", metavar="ID", help=f"S1 to S8, or template files (default: {templates})"
    )
    matrix.add_argument("--levels", nargs="+", metavar="L", help=f"L0 to L3, or 0 to 3, or own (default {levels})")
    matrix.add_argument("--seeds", nargs="+", metavar="N|A:B", help=f"seeds; 0:5 are 0 to 4 (default {seeds})")
    matrix.add_argument("--maps", nargs="+", metavar="FILE", help=f"map files, or {BUILT_IN} (default {TOWN})")
    matrix.add_argument("--sites", nargs="+", metavar="NAME", help="names that siren sites prints, or drawn (default)")
    matrix.add_argument("--preset", help="how civilians react (default paper)")
    matrix.add_argument("--sensors", help="suite of sensors (default none)")
    matrix.add_argument("--look", help="weather and time of day (default clear)")
    matrix.add_argument(
        "--duration-s", type=float, metavar="S", help="simulated time of each episode (default: its own)"
    )
    matrix.add_argument(
        "--values",
        metavar="PATH=N,…",
        help="values of the templates' parameters, which the seeds then do not draw: emv.speed_mps=12.5,duration_s=60",
    )


def asked_of(arguments: argparse.Namespace, matrix: Mapping[str, Callable[[Any], Any]] = MATRIX) -> dict[str, Any]:
    """The study's fields that the command line names."""
    words = {name: getattr(arguments, name) for name in matrix}
    return {name: matrix[name](word) for name, word in words.items() if word is not None}


class StudyBar(StudyObserver):
    """A progress bar with the rate and the time left."""

    def __init__(self, bar: "tqdm[Any]") -> None:
        self._bar = bar
        self._counts: Counter[str] = Counter()
        self._simulated_s = 0.0

    def plan(self, episodes: int) -> None:
        """As ``StudyObserver``."""
        self._bar.reset(episodes)

    def keep(self, row: EpisodeRow) -> None:  # noqa: ARG002 - the interface
        """As ``StudyObserver``."""
        if not self._bar.disable:
            self._bar.initial += 1  # it took no time, so that it does not count for the rate
            self._bar.update(1)

    def make(self, row: EpisodeRow) -> None:
        """As ``StudyObserver``."""
        if self._bar.disable:
            return
        self._counts["retried"] += row.attempts - 1
        self._counts[row.status.value] += 1
        self._simulated_s += row.simulated_s
        counts = {name: count for name, count in self._counts.items() if count and name != Status.COMPLETE.value}
        factor = self._simulated_s / max(self._bar.format_dict["elapsed"], 1e-3)
        self._bar.set_postfix({"simulated": f"{factor:.1f}x", **counts}, refresh=False)
        self._bar.update(1)
