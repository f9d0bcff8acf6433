"""Reads a map file, tells its kind, and refuses one with numbers that no real place has.

netconvert would need too much time or memory for such maps.
"""

import bz2
import gzip
import io
import math
import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import BinaryIO, Final, cast
from xml.etree.ElementTree import Element, ParseError, tostring

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring, iterparse

from siren_ros.errors import MapError
from siren_ros.simulation.roads.net_parser import MAX_MAP_BYTES, MAX_TAGS

ALLOWED: Final = (
    "a SUMO net (.net.xml), an OpenDRIVE map (.xodr) or an OpenStreetMap extract (.osm, .osm.xml), each also packed by "
    "gzip or bzip2, city or motorway for a built-in map, or no map for the built-in town"
)
_SHOWN_CHARACTERS: Final = 300
_PACKED: Final[Mapping[bytes, tuple[str, Callable[[BinaryIO], BinaryIO]]]] = {
    b"\x1f\x8b": ("gzip", lambda file: cast("BinaryIO", gzip.GzipFile(fileobj=file))),
    b"BZh": ("bzip2", lambda file: cast("BinaryIO", bz2.BZ2File(file))),
}
"""By the first bytes of a packed file: how the packing is called, and what unpacks it."""
_SUFFIXES: Final = frozenset({".gz", ".bz2", ".xml", ".net", ".osm", ".xodr"})
_MAP_NAME: Final = re.compile(r"\.(net\.xml|osm|osm\.xml|xodr)(\.gz|\.bz2)?$")


class SourceKind(StrEnum):
    """The kind of a map's source."""

    BUILT_IN = "built_in"
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
    """The file's content, decompressed."""


def unpacked(path: Path, allowed: str = ALLOWED) -> bytes:
    """The content of a file, decompressed; MapError with ``allowed`` where it is missing, unreadable or too large."""
    try:
        with _open(path) as file:
            content = file.read(MAX_MAP_BYTES + 1)
    except (OSError, ValueError) as error:
        raise MapError(str(path), f"{allowed}; {getattr(error, 'strerror', None) or error}") from error
    for packing, unpacking in [way for magic, way in _PACKED.items() if content.startswith(magic)]:
        try:
            with unpacking(io.BytesIO(content)) as packed:
                content = packed.read(MAX_MAP_BYTES + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise MapError(str(path), f"{allowed}; this {packing} file is damaged") from error
    if len(content) > MAX_MAP_BYTES or content.count(b"<") > MAX_TAGS:
        raise MapError(str(path), f"a file of at most {MAX_MAP_BYTES // 1_000_000} MB and {MAX_TAGS} XML tags")
    return content


def read_map_source(path: Path) -> MapSource:
    """Reads a map file and tells by its root element, not by its name, what it is.

    Raises:
        MapError: The file is missing, unreadable, or no map of a known kind.
    """
    content = unpacked(path)
    try:
        elements = iterparse(io.BytesIO(content), events=("start",), forbid_dtd=True)
        root = next((element.tag for _, element in elements), "")
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise MapError(str(path), f"{ALLOWED}; this file is not readable XML: {error}") from error
    if root.startswith("{"):
        content, root = _without_namespaces(content, path), root.rpartition("}")[2]
    kind = _KIND_OF_ROOT.get(root)
    if kind is None:
        raise MapError(str(path), f"{ALLOWED}; this file is an XML document <{root}>")
    return MapSource(name=map_stem(path), kind=kind, content=content)


def _without_namespaces(content: bytes, path: Path) -> bytes:
    """A document with plain names, as those who read maps expect them; RoadRunner writes a namespace into OpenDRIVE."""
    try:
        root = fromstring(content, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise MapError(str(path), f"{ALLOWED}; this file is not readable XML: {error}") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    return bytes(tostring(root, encoding="utf-8", xml_declaration=True))


def _open(path: Path) -> BinaryIO:
    """Opens a file. Pipes and devices are refused, because they may block or never end."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError("this is no file")
    return path.open("rb")


def shown_words(text: object) -> str:
    """Words that may quote a map, as one short line that a terminal can show."""
    start = str(text)[:_SHOWN_CHARACTERS]
    return "".join(letter if letter.isprintable() else "?" for letter in start)


def maps_in(folder: Path) -> tuple[Path, ...]:
    """The map files of a folder by their names, sorted."""
    return tuple(sorted(path for path in folder.iterdir() if _MAP_NAME.search(path.name) and path.is_file()))


def map_stem(path: Path) -> str:
    """Name of a map: its file's name without the suffixes of map files."""
    name = Path(path.name)
    while name.suffix in _SUFFIXES and name.stem:
        name = Path(name.stem)
    return name.name


DEEPEST: Final = 100
"""Greatest depth of nested elements; maps have fewer than 20. netconvert's time grows with the square of it."""
MOST_LANES: Final = 100
"""Most lanes of one way in OpenStreetMap; the widest toll stations have about 50. netconvert takes 20 s for a crossing
of 1000."""
LONGEST_CURVE_M: Final = 100_000.0
"""Greatest length of one curved piece of an OpenDRIVE road. netconvert puts a point on it every 2 m."""
MOST_CURVE_M: Final = 20_000_000.0
"""Greatest length of all curved pieces times their lanes: ten million points, which make a net of 200 MB."""
MOST_REPEATS: Final = 1_000_000
"""Most copies of the objects of an OpenDRIVE map; netconvert makes each of them."""
_SHOWN_OF_TEXT: Final = 40


def refuse_unusable_map(source: MapSource, shown_source: str) -> None:
    """Accept a map whose counts a real place can have.

    A document that cannot be read is accepted: the compiler says what is wrong with it. The error names the map by
    ``shown_source``.

    Raises:
        MapError: There is too much of something, and the message says of what, and where.
    """
    try:
        root = fromstring(source.content, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError):
        return
    count = _COUNTS.get(source.kind)
    if allowed := _too_deep(root) or (count(root) if count else ""):
        raise MapError(shown_source, allowed)


def _too_deep(root: Element) -> str:
    level = [root]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
    return f"a map with at most {DEEPEST} elements inside each other" if level else ""


def _lanes_of_openstreetmap(osm: Element) -> str:
    if osm.find("relation/tag[@k='type'][@v='lanelet']") is not None and osm.find("way/tag[@k='highway']") is None:
        return f"{ALLOWED}; this is a Lanelet2 map: convert it first, as the CommonRoad Scenario Designer does"
    for way in osm.iter("way"):
        for tag in way.iter("tag"):
            value = tag.get("v", "")
            # Python refuses to read a much longer number, and it would be too large as well.
            numbers = re.findall("[0-9]+", value) if tag.get("k", "").startswith("lanes") else []
            if any(len(number) > 9 or int(number) > MOST_LANES for number in numbers):
                shown = f"{tag.get('k')}={value[:_SHOWN_OF_TEXT]!r} of way {way.get('id', '')[:_SHOWN_OF_TEXT]!r}"
                return f"a map with at most {MOST_LANES} lanes on a way ({shown})"
    return ""


def _curves_of_opendrive(drive: Element) -> str:
    total_m = repeats = 0.0
    for road in drive.iter("road"):
        shown = f"road {road.get('id', '')[:_SHOWN_OF_TEXT]!r}"
        lanes = max((sum(1 for _ in section.iter("lane")) for section in road.iter("laneSection")), default=1)
        curves_m = [
            _number(geometry, "length")
            for geometry in road.iter("geometry")
            if any(shape.tag != "line" for shape in geometry)
        ]
        total_m += lanes * sum(curves_m)
        if not max(curves_m, default=0.0) <= LONGEST_CURVE_M or not total_m <= MOST_CURVE_M:
            limits = f"{LONGEST_CURVE_M / 1e3:.0f} km, and {MOST_CURVE_M / 1e3:.0f} km of lanes on all of them"
            return f"a map whose curves are no longer than {limits} ({shown})"
        for repeat in road.iter("repeat"):
            distance_m = _distance_m(repeat)
            if math.isnan(distance_m):
                return f"a map whose repeated objects have a distance in metres ({shown})"
            repeats += _number(repeat, "length") / distance_m if distance_m > 0.0 else 0.0
        if not repeats <= MOST_REPEATS:
            return f"a map with at most {MOST_REPEATS} copies of objects"
    return ""


def _distance_m(repeat: Element) -> float:
    """Distance between the copies of an object.

    It is NaN where none is stated: netconvert then makes copies until its memory is full.
    """
    try:
        value = float(repeat.get("distance", "nan"))
    except ValueError:
        return math.nan
    return value if 0.0 <= value < math.inf else math.nan


def _number(element: Element, name: str) -> float:
    """A number from 0 on. A missing one counts as 0, and one that cannot be used as infinite."""
    try:
        value = float(element.get(name, "0"))
    except ValueError:
        return 0.0
    return math.inf if math.isnan(value) else max(value, 0.0)


_COUNTS: Final[Mapping[SourceKind, Callable[[Element], str]]] = {
    SourceKind.OPENDRIVE: _curves_of_opendrive,
    SourceKind.OPENSTREETMAP: _lanes_of_openstreetmap,
}
"""For each kind of map, the function that names what there is too much of. Its text is empty for usable maps."""
