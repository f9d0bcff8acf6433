"""Options of a study's matrix, for the commands that make studies."""

import argparse
from collections.abc import Callable, Mapping
from typing import Any, Final

from siren_ros.running.studies.matrix import TOWN, levels_of, seeds_of
from siren_ros.simulation.roads.maps.map_compiler import BUILT_IN_MAPS

BUILT_IN: Final = "{}, {} or {}".format(*BUILT_IN_MAPS)
"""Names of the built-in maps, as a text for help."""
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
    """Adds the options of the matrix. The texts name the values that hold without an option."""
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
    """The fields of the study that the command line sets."""
    words = {name: getattr(arguments, name) for name in matrix}
    return {name: matrix[name](word) for name, word in words.items() if word is not None}
