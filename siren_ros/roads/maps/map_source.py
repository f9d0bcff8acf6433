"""Reads a map file, tells its kind, and refuses what netconvert must not get.

Small texts in a map from which netconvert makes much are refused before it runs.
"""

import gzip
import io
import math
import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import BinaryIO, Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring, iterparse

from siren_ros.errors import MapError
from siren_ros.roads.net_parser import MAX_MAP_BYTES, MAX_TAGS

ALLOWED: Final = (
    "a SUMO net (.net.xml, .net.xml.gz), an OpenDRIVE map (.xodr) or an OpenStreetMap extract (.osm, .osm.xml, "
    "gzipped too), or no map for the built-in town"
)
_SHOWN_CHARACTERS: Final = 300
_GZIP_MAGIC: Final = b"\x1f\x8b"
_SUFFIXES: Final = frozenset({".gz", ".xml", ".net", ".osm", ".xodr"})


class SourceKind(StrEnum):
    """Where a map comes from."""

    TOWN = "town"
    SUMO = "sumo"
    OPENDRIVE = "opendrive"
    OPENSTREETMAP = "openstreetmap"


_KIND_OF_ROOT: Final = {
    "net": SourceKind.SUMO,
    "OpenDRIVE": SourceKind.OPENDRIVE,
    "osm": SourceKind.OPENSTREETMAP,
}


@dataclass(frozen=True)
class MapSource:
    """A map file as it was read."""

    name: str
    kind: SourceKind
    content: bytes
    """Decompressed."""


def read_map_source(path: Path) -> MapSource:
    """Reads a map file and tells by its root element, not by its name, what it is.

    Raises:
        MapError: The file is missing, unreadable, or no map of a known kind.
    """
    try:
        with _open(path) as file:
            content = file.read(MAX_MAP_BYTES + 1)
    except (OSError, ValueError) as error:
        raise MapError(str(path), f"{ALLOWED}; {getattr(error, 'strerror', None) or error}") from error
    if content.startswith(_GZIP_MAGIC):
        try:
            with gzip.GzipFile(fileobj=io.BytesIO(content)) as packed:
                content = packed.read(MAX_MAP_BYTES + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise MapError(str(path), f"{ALLOWED}; this gzip file is damaged") from error
    if len(content) > MAX_MAP_BYTES or content.count(b"<") > MAX_TAGS:
        raise MapError(str(path), f"a map of at most {MAX_MAP_BYTES // 1_000_000} MB and {MAX_TAGS} XML tags")
    try:
        elements = iterparse(io.BytesIO(content), events=("start",), forbid_dtd=True)
        root = next((element.tag for _, element in elements), "")
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise MapError(str(path), f"{ALLOWED}; this file is not readable XML: {error}") from error
    kind = _KIND_OF_ROOT.get(root)
    if kind is None:
        raise MapError(str(path), f"{ALLOWED}; this file is an XML document <{root}>")
    return MapSource(name=map_stem(path), kind=kind, content=content)


def _open(path: Path) -> BinaryIO:
    """The open file. Pipes and devices are refused: they may block or never end."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError("this is no file")
    return path.open("rb")


def shown_words(text: object) -> str:
    """Words that may quote a map, as one short line that a terminal can show."""
    start = str(text)[:_SHOWN_CHARACTERS]
    return "".join(letter if letter.isprintable() else "?" for letter in start)


def map_stem(path: Path) -> str:
    """Name of a map: its file's name without the suffixes of map files."""
    name = Path(path.name)
    while name.suffix in _SUFFIXES and name.stem:
        name = Path(name.stem)
    return name.name


DEEPEST: Final = 100
"""Elements inside each other; maps have fewer than 20. netconvert takes a time that grows with the square."""
MOST_LANES: Final = 100
"""Of one way of OpenStreetMap; the widest toll stations have about 50. netconvert takes 20 s for a crossing of 1000."""
LONGEST_CURVE_M: Final = 100_000.0
"""Of one piece of an OpenDRIVE road that is no straight line. netconvert puts a point on it every 2 m."""
MOST_CURVE_M: Final = 20_000_000.0
"""Of all of these and all of their lanes: ten million points, which make a net of 200 MB."""
MOST_REPEATS: Final = 1_000_000
"""Copies of the objects of an OpenDRIVE map; netconvert makes each of them."""
_SHOWN_OF_TEXT: Final = 40


def refuse_costly_counts(source: MapSource, shown_source: str) -> None:
    """Accept a map whose counts and lengths a real place can have.

    Args:
        source: The map. A document that cannot be read is accepted; whoever compiles it says what is wrong with it.
        shown_source: What the error names as the map.

    Raises:
        MapError: The map has too much of something; the message says of what, and where.
    """
    try:
        root = fromstring(source.content, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError):
        return
    check = _CHECKS.get(source.kind)
    found = _too_deep(root) or ("" if check is None else check(root))
    if found:
        raise MapError(shown_source, found)


def _too_deep(root: Element) -> str:
    level = [root]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
    return f"a map with at most {DEEPEST} elements inside each other" if level else ""


def _of_openstreetmap(osm: Element) -> str:
    for way in osm.iter("way"):
        for tag in way.iter("tag"):
            value = tag.get("v", "")
            # A longer number is too large as well, and Python refuses it.
            numbers = re.findall("[0-9]+", value) if tag.get("k", "").startswith("lanes") else []
            if any(len(number) > 9 or int(number) > MOST_LANES for number in numbers):
                shown = f"{tag.get('k')}={value[:_SHOWN_OF_TEXT]!r} of way {way.get('id', '')[:_SHOWN_OF_TEXT]!r}"
                return f"a map with at most {MOST_LANES} lanes on a way ({shown})"
    return ""


def _of_opendrive(drive: Element) -> str:
    total_m = repeats = 0.0
    for road in drive.iter("road"):
        lanes = max((sum(1 for _ in section.iter("lane")) for section in road.iter("laneSection")), default=1)
        curves_m = [
            _number(geometry, "length")
            for geometry in road.iter("geometry")
            if any(shape.tag != "line" for shape in geometry)
        ]
        total_m += lanes * sum(curves_m)
        if not max(curves_m, default=0.0) <= LONGEST_CURVE_M or not total_m <= MOST_CURVE_M:
            shown = f"road {road.get('id', '')[:_SHOWN_OF_TEXT]!r}"
            limits = f"{LONGEST_CURVE_M / 1e3:.0f} km, and {MOST_CURVE_M / 1e3:.0f} km of lanes on all of them"
            return f"a map whose curves are no longer than {limits} ({shown})"
        for repeat in road.iter("repeat"):
            distance_m = _number(repeat, "distance")
            repeats += _number(repeat, "length") / distance_m if distance_m > 0.0 else 0.0
        if not repeats <= MOST_REPEATS:
            return f"a map with at most {MOST_REPEATS} copies of objects"
    return ""


def _number(element: Element, name: str) -> float:
    """A number from 0 on; 0 where there is none, and infinite where it is none that can be counted with."""
    try:
        value = float(element.get(name, "0"))
    except ValueError:
        return 0.0
    return math.inf if math.isnan(value) else max(value, 0.0)


_CHECKS: Final[Mapping[SourceKind, Callable[[Element], str]]] = {
    SourceKind.OPENDRIVE: _of_opendrive,
    SourceKind.OPENSTREETMAP: _of_openstreetmap,
}
