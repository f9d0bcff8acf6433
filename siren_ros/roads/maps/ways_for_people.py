"""What netconvert imports for people on foot and on bicycles, where an episode has some: other maps stay as they are.

Sidewalks get corners where they meet, and crossings: those of the map, and at junctions those that join the sidewalks
of both sides of a street.
"""

import re
from pathlib import Path
from typing import Final

from siren_ros.roads.maps.map_source import SourceKind

_ON_FOOT: Final = ("--crossings.guess", "--walkingareas")
_SEPARATE: Final = re.compile(rb"""(k=["']sidewalk(:both|:left|:right)?["']\s+v=["'])separate(["'])""")
"""A sidewalk that is drawn as an own way, too. netconvert does not import such ways where it keeps streets alone."""
_JOINED: Final = b'function="walkingarea"'


def people_options(kind: SourceKind, sumo_home: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Options of netconvert's first and second run."""
    if kind is not SourceKind.OPENSTREETMAP:
        return (), _ON_FOOT
    types = ",".join(str(sumo_home / "data/typemap" / f"{name}.typ.xml") for name in _TYPES)
    return ("--type-files", types, "--osm.bike-access", "--osm.crossings", *_ON_FOOT), _ON_FOOT


_TYPES: Final = ("osmNetconvert", "osmNetconvertBicycle")


def with_sidewalks_on_streets(osm: bytes) -> bytes:
    """An OpenStreetMap extract whose separate sidewalks are sidewalks of their streets."""

    def on_street(tag: "re.Match[bytes]") -> bytes:
        return tag[1] + (b"yes" if tag[2] else b"both") + tag[3]

    return _SEPARATE.sub(on_street, osm)


def lacks_corners(net: bytes) -> bool:
    """Whether a net's sidewalks, if it has any, end at junctions."""
    return _JOINED not in net
