"""What kind of file a map is, and its bytes."""

import gzip
import io
import zlib
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import iterparse

from siren_ros.world.errors import MapError

ALLOWED: Final = (
    "a SUMO net (.net.xml, .net.xml.gz), an OpenDRIVE map (.xodr) or an OpenStreetMap extract (.osm, .osm.xml, "
    "gzipped too), or no map for the built-in town"
)
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
        content = path.read_bytes()
    except OSError as error:
        raise MapError(str(path), f"{ALLOWED}; {error.strerror or error}") from error
    if content.startswith(_GZIP_MAGIC):
        try:
            content = gzip.decompress(content)
        except (OSError, EOFError, zlib.error) as error:
            raise MapError(str(path), f"{ALLOWED}; this gzip file is damaged") from error
    try:
        root = next((element.tag for _, element in iterparse(io.BytesIO(content), events=("start",))), "")
    except (ParseError, DefusedXmlException, ValueError) as error:
        raise MapError(str(path), f"{ALLOWED}; this file is not readable XML: {error}") from error
    kind = _KIND_OF_ROOT.get(root)
    if kind is None:
        raise MapError(str(path), f"{ALLOWED}; this file is an XML document <{root}>")
    return MapSource(name=_stem(path), kind=kind, content=content)


def _stem(path: Path) -> str:
    name = Path(path.name)
    while name.suffix in _SUFFIXES and name.stem:
        name = Path(name.stem)
    return name.name
