"""Refuses maps with numbers that no real place has, because netconvert would need too much time or memory for them."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps.map_source import MapSource, SourceKind

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
