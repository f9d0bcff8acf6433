"""Reads a map file and tells its kind."""

import gzip
import io
import zlib
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import BinaryIO, Final
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import iterparse

from siren_ros.errors import MapError
from siren_ros.simulation.roads.net_parser import MAX_MAP_BYTES, MAX_TAGS

ALLOWED: Final = (
    "a SUMO net (.net.xml, .net.xml.gz), an OpenDRIVE map (.xodr) or an OpenStreetMap extract (.osm, .osm.xml, "
    "gzipped too), city or motorway for a built-in map, or no map for the built-in town"
)
_SHOWN_CHARACTERS: Final = 300
_GZIP_MAGIC: Final = b"\x1f\x8b"
_SUFFIXES: Final = frozenset({".gz", ".xml", ".net", ".osm", ".xodr"})


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
    """Opens a file. Pipes and devices are refused, because they may block or never end."""
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
