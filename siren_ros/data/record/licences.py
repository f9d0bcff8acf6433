"""The licence of SIREN's own output, and the licences of the maps in its datasets."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from siren_ros.simulation.roads.maps.map_compiler import BUILT_IN_MAPS, TOWN_NAME

LICENCE: Final = "Apache-2.0"
"""Licence of the code, the parameter files, the weights and the datasets, unless a dataset's maker states another. A
test compares ``LICENSE``, the packages' metadata and ``CITATION.cff`` with it."""
LICENCE_URL: Final = "https://www.apache.org/licenses/LICENSE-2.0"
UNKNOWN: Final = "that of its source, which SIREN does not know"

_BY_SOURCE: Final[tuple[tuple[Callable[[str, str], bool], str], ...]] = (
    (lambda name, file: name in {TOWN_NAME, *BUILT_IN_MAPS} and file in {"", name}, LICENCE),
    (lambda _, file: ".osm" in Path(file).suffixes, "ODbL-1.0, © OpenStreetMap contributors"),
    (lambda name, _: re.fullmatch(r"Town\d\d(HD)?(_Opt)?", name) is not None, "CC-BY, CARLA's assets"),
)


def licence_of_map(name: str, file: str) -> str:
    """The licence of a map, as far as its name shows.

    Args:
        name: The map's name in the episode.
        file: The file as the request names it; empty for the built-in town.
    """
    return next((licence for holds, licence in _BY_SOURCE if holds(name, file)), UNKNOWN)
