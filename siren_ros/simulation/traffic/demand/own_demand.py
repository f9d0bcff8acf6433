"""The user's own traffic as the background of an episode: a SUMO route file, or what a configuration of SUMO names.

SUMO gets types, routes, the departures of the episode's time, programmes of signals, stops and detectors. The drivers
are SUMO's, with the parameters of their types.
"""

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element, ParseError, tostring

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from siren_ros.errors import BagError, InputError, MapError
from siren_ros.simulation.roads.maps.map_source import shown_words, unpacked
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import ActorClass

NAME_START: Final = "demand."
"""Beginning of the names of these vehicles; the user's ids follow it."""
_ALLOWED: Final = "a SUMO route file (.rou.xml) or configuration (.sumocfg), each also packed by gzip or bzip2"
_ALIKE: Final = {"passenger": ActorClass.SEDAN, "delivery": ActorClass.VAN}
_BODIES: Final = _ALIKE | {name: ActorClass[name.upper()] for name in ("truck", "bus", "motorcycle", "bicycle")}
"""The body of each of SUMO's vehicle classes that has its own."""
_NEAREST: Final = {"trailer": "truck", "coach": "bus", "tram": "bus", "moped": "motorcycle", "scooter": "bicycle"}
"""The class whose body others have; those that are not here have that of ``passenger``."""
_DEPARTURES: Final = frozenset({"vehicle", "trip", "flow"})
_ROUTES: Final = frozenset({"route", "routeDistribution"})
_TYPES: Final = frozenset({"vType", "vTypeDistribution"})
_STANDING: Final = frozenset(
    ("busStop", "tlLogic", "WAUT", "wautJunction", "taz", "inductionLoop", "instantInductionLoop", "laneAreaDetector")
) | {"entryExitDetector", "e1Detector", "e2Detector", "e3Detector"}
"""Elements beside the traffic that SUMO gets; what detectors and programmes write goes nowhere."""
_STOPS: Final = frozenset({"busStop", "lane", "edge", "duration", "until", "startPos", "endPos", "friendlyPos", "line"})
"""What a stop may say: it is then on the road, and for a time."""
_UNITS_S: Final = (1.0, 60.0, 3600.0, 86400.0)


@dataclass(frozen=True)
class OwnDemand:
    """The traffic as SUMO loads it: elements of an additional file (``xml``).

    It begins at ``begin_s`` of SUMO's time with the warm-up. ``source`` is the name of its file, ``sha256`` of what is
    in it after decompression, or in all files of a configuration. ``left_out`` has a line for each kind of thing that
    is not taken over as it is.
    """

    source: str
    sha256: str
    begin_s: float
    left_out: tuple[str, ...]
    xml: str

    @property
    def options(self) -> Mapping[str, str]:
        """The options that SUMO has with it. A trip that finds no way does not enter."""
        return {"--begin": repr(self.begin_s), "--ignore-route-errors": "true"}

    @staticmethod
    def of_json(stored: Any) -> "OwnDemand | None":
        """The demand in an episode's description, None for None; BagError for anything else."""
        try:
            return stored and OwnDemand(**{**stored, "left_out": tuple(stored["left_out"])})
        except (TypeError, LookupError) as error:
            raise BagError("demand of the episode", f"the fields {', '.join(OwnDemand.__annotations__)}") from error


def _contents(path: Path) -> tuple[list[tuple[bytes, Element]], dict[str, str]]:
    """The user's files, the given one first, each with its root element, and the options of a configuration."""
    content, root = _read(path)
    if root.tag not in {"configuration", "sumoConfiguration"}:
        return [(content, root)], {}
    options = {one.tag: one.attrib["value"] for one in root.iter() if "value" in one.attrib}
    names = ",".join(options.pop(key, "") for key in ("additional-files", "route-files")).split(",")
    return [(content, root), *(_read(path.parent / name.strip()) for name in names if name.strip())], options


def _read(path: Path) -> tuple[bytes, Element]:
    try:
        content = unpacked(path, _ALLOWED)
        return content, fromstring(content, forbid_dtd=True)
    except MapError as error:
        raise InputError("demand", str(path), error.allowed) from error
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise InputError("demand", str(path), f"{_ALLOWED}; this is not readable XML: {shown_words(error)}") from error


def sha256_of_demand(path: Path) -> str:
    """``OwnDemand.sha256`` of a file; raises InputError where one cannot be read."""
    return _sha256_of(_contents(path)[0])


def _sha256_of(files: Iterable[tuple[bytes, Element]]) -> str:
    return hashlib.sha256(b"".join(content for content, _ in files)).hexdigest()


def read_demand(path: Path, network: RoadNetwork, lasting_s: float, begin_s: float = 0.0) -> OwnDemand:
    """The traffic of a file for warm-up and episode, which last ``lasting_s``.

    The warm-up begins at ``begin_s`` of SUMO's time; 0 stands for that of the configuration, else the first departure.

    Raises:
        InputError: A file cannot be used, names a type or a route that it does not have, or has no vehicle that can
            drive on these roads at this time.
    """
    files, options = _contents(path)
    elements = [one for _, root in files[len(files) > 1 :] for one in root]
    notes: defaultdict[str, list[str]] = defaultdict(list)
    begin_s = begin_s or _seconds(options.pop("begin", ""), 0.0)
    begin_s = begin_s or max(min((_begin_s(one) for one in elements if one.tag in _DEPARTURES), default=0.0), 0.0)
    for option in sorted(options.keys() - {"net-file"}):
        notes["options of the configuration"].append(option)
    _adapt(elements, notes)
    taken = []
    for one, why, detail in _with_faults(elements, network, begin_s, begin_s + lasting_s):
        if why:
            notes[why].append(one.get("id", "") + detail)
        else:
            one.set("id", f"{NAME_START}{one.get('id')}")
            one.attrib.setdefault("insertionChecks", "all")
            taken.append(one)
    lines = tuple(f"{len(ids)} × {why}: {', '.join(ids[:3])}{', …' * (len(ids) > 3)}" for why, ids in notes.items())
    if not taken:
        when = f"from {begin_s:g} s to {begin_s + lasting_s:g} s"
        raise InputError("demand", str(path), f"a vehicle that departs {when} on the map's roads ({'; '.join(lines)})")
    mixed = [one for one in elements if one.tag == "routeDistribution"]
    named = {name for one in (*taken, *mixed) for name in _routes_in(one)}
    kept = [one for one in elements if one.tag in _STANDING | _TYPES]
    kept += [one for one in elements if one.tag in _ROUTES and (one.tag != "route" or one.get("id") in named)]
    xml = "".join(tostring(one, encoding="unicode") for one in (*kept, *taken))
    return OwnDemand(path.name, _sha256_of(files), begin_s, lines, xml)


def _routes_in(element: Element) -> list[str]:
    """Names of routes in an element and its parts."""
    return [name for one in element.iter() for key in ("route", "routes", "refId") for name in one.get(key, "").split()]


def _begin_s(departure: Element) -> float:
    """Time of a departure, or of a flow's first one; −1 where it is no time."""
    return _seconds(departure.get("begin" if departure.tag == "flow" else "depart", "0"), -1.0)


def _seconds(text: str, otherwise: float) -> float:
    """Seconds of SUMO's notations: a number, or ``[DD:]HH:MM:SS``."""
    try:
        return sum(float(part) * unit for part, unit in zip(reversed(text.split(":")), _UNITS_S, strict=False))
    except ValueError:
        return otherwise


def _adapt(elements: Iterable[Element], notes: Mapping[str, list[str]]) -> None:
    """Changes what cannot be as it is, and notes it: bodies, models of lane changes, outputs, stops and devices."""
    places = {None, *(one.get("id") for one in elements if one.tag == "busStop")}
    for element in elements:
        if element.tag not in _STANDING | _TYPES | _ROUTES | _DEPARTURES:
            notes[f"<{element.tag}>"].append(element.get("id", ""))
            continue
        for one in element.iter():
            name, kind = one.get("id", one.tag), one.get("vClass", "passenger")
            if kind not in _BODIES:
                notes[f"class {kind}, with the body of class {_NEAREST.get(kind, 'passenger')}"].append(name)
            if one.get("laneChangeModel", "SL2015") != "SL2015":  # SUMO has no other one with sublanes
                notes[f"lane-change model {one.attrib.pop('laneChangeModel')}, now SL2015"].append(name)
            if "file" in (*one.attrib, one.get("key")):
                one.set("file" if "file" in one.attrib else "value", "NUL")
            for part in [*one]:
                wrong = part.tag == "stop" and not (part.attrib.keys() <= _STOPS and part.get("busStop") in places)
                if wrong or (part.tag == "param" and part.get("key", "").startswith(("has.", "device."))):
                    one.remove(part)
                    notes["stops off the road, or for somebody" if wrong else "devices"].append(name)


def body_of(vehicle_class: str) -> ActorClass:
    """The body of one of SUMO's vehicle classes: its own, or the nearest."""
    return _BODIES[vehicle_class if vehicle_class in _BODIES else _NEAREST.get(vehicle_class, "passenger")]


def _with_faults(
    elements: Sequence[Element], network: RoadNetwork, begin_s: float, end_s: float
) -> Iterator[tuple[Element, str, str]]:
    """The departures, each with why it cannot be taken for a time, empty if it can, and a detail of that."""
    kinds = ([part for one in elements if one.tag in tags for part in one.iter()] for tags in (_TYPES, _ROUTES))
    types, routes = ({one.get("id"): one for one in kind} for kind in kinds)
    edge_of = {lane.index: network.edges[lane.edge].edge_id for lane in network.lanes}
    joined = {(edge_of[way.from_lane], edge_of[way.to_lane]) for way in network.connections if way.direction != "t"}
    for one in (element for element in elements if element.tag in _DEPARTURES):
        for key, known in (("type", types), ("route", routes)):
            if (wanted := one.get(key, "DEFAULT_")) not in known and not wanted.startswith("DEFAULT_"):
                raise InputError("demand", f"{key} {wanted} of {one.tag} {one.get('id')}", f"a {key} that the file has")
        named = [routes[name] for name in _routes_in(one)]
        named += [routes[name] for route in named for name in _routes_in(route) if name in routes]
        ways = [part.get("edges", "").split() for other in (one, *named) for part in other.iter()]
        ways += [[edge] for key in ("from", "to", "via") for edge in one.get(key, "").split()]
        lacking = [edge for way in ways for edge in way if edge not in network.edge_by_id]
        lacking += [" to ".join(pair) for way in ways for pair in pairwise(way) if pair not in joined]
        first_s = _begin_s(one)
        last_s = _seconds(one.get("end", ""), end_s) if one.tag == "flow" else first_s
        why = "departure on a trigger" if first_s < 0.0 else "departure at another time"
        if first_s >= 0.0 and first_s < end_s and last_s >= begin_s:
            why = "route that the map lacks, or that turns back" if lacking else ""
        yield one, why, f" ({lacking[0]})" if why.startswith("route") else ""
