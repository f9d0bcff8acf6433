"""Compiles a map of any supported kind into a SUMO net. The result is cached by the map's content.

The speed limits of a compiled map can be lowered, so that a scenario has the same traffic on every map. A map says on
which side of the road traffic keeps, or its place on Earth tells: OpenDRIVE has the ``rule`` of its roads, an
OpenStreetMap extract ``driving_side`` (https://wiki.openstreetmap.org/wiki/Key:driving_side), the direction of its
roundabouts, or its place.
"""

import hashlib
import json
import logging
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, ParseError

import shapely
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from shapely.geometry.base import BaseGeometry

from siren_ros.base.params.folders import default_cache_dir, params_dir, store_in_cache
from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps.map_formats import (
    crowded_joints,
    drives_on,
    mirrored_net,
    mirrored_opendrive,
    opendrive_patches,
    signed_edges,
    tags_of,
    taper_patches,
    with_stated_limits,
)
from siren_ros.simulation.roads.maps.map_source import (
    MapSource,
    SourceKind,
    map_stem,
    read_map_source,
    refuse_unusable_map,
    shown_words,
)
from siren_ros.simulation.roads.maps.netconvert import (
    control_patches,
    crossing_places,
    cycle_options,
    document,
    has_corners,
    mended_lanes,
    netconvert_version,
    run_netconvert,
    with_cycle_lanes,
    with_sidewalks_on_streets,
    without_header,
    without_outlines,
)
from siren_ros.simulation.roads.maps.opendrive_import import importable
from siren_ros.simulation.roads.maps.prolonged_ends import with_prolonged_ends
from siren_ros.simulation.roads.net_parser import ALLOWED as NET_ALLOWED
from siren_ros.simulation.roads.net_parser import is_left_hand, parse_road_network
from siren_ros.simulation.roads.road_network import OTHER_SIDE, RoadNetwork

TOWN_NAME: Final = "town"

_RECIPE: Final = "12"
"""Part of the cache key: raised whenever the way in which maps are compiled changes."""
_PEOPLE_RECIPE: Final = f"{_RECIPE} people 4"
"""The same part of the key for maps with ways for people."""
_SLOWER_RECIPE: Final = "1"
"""The same part of the key for nets with lowered speed limits."""
_IN_USE_RECIPE: Final = "shoulders 1"
"""The same part of the key for nets with closed shoulders."""
_MIRRORED_RECIPE: Final = "mirrored 1"
"""The same part of the key for mirror images."""
_COMMON: Final = (
    "--no-turnarounds",
    # Lateral acceleration in turns, m/s²: what passengers bear, and what every vehicle class can follow.
    *("--junctions.limit-turn-speed", "3.5"),
    "--junctions.internal-link-detail",
    "16",
    "--xml-validation",
    "never",
    "--no-warnings",
)
_PARTS: Final = {
    "nod": "--node-files",
    "edg": "--edge-files",
    "typ": "--type-files",
    "con": "--connection-files",
    "tll": "--tllogic-files",
}
"""Netconvert's option for each part of a built-in map, by the ending of its file: ``town.nod.xml`` of ``params/town``
and so on."""
Files = Mapping[str, bytes]
"""Contents of plain XML files, by the netconvert option that names each file."""


@dataclass(frozen=True)
class _BuiltIn:
    """The folder of a built-in map, and how its files are changed."""

    folder: str
    parts: tuple[str, ...]
    made_of: Callable[[Files], Files] = dict
    """Changes the files of the folder into those of the map."""


_TOWN: Final = _BuiltIn("town", ("nod", "edg", "typ", "con", "tll"))
BUILT_IN_MAPS: Final = {
    TOWN_NAME: _TOWN,
    "city": replace(_TOWN, made_of=with_cycle_lanes),
    "motorway": _BuiltIn("motorway", ("nod", "edg", "typ", "con")),
}
"""The maps that a request may name in place of a file."""
_BUILT_IN: Final = (*_COMMON, "--offset.disable-normalization", "--junctions.corner-detail", "8")
_OPENDRIVE: Final = (*_COMMON, "--opendrive.import-all-lanes", "--offset.disable-normalization")
_OPENDRIVE_SECOND: Final = (
    *_COMMON,
    "--offset.disable-normalization",
    # One approach after the other, as the controllers in CARLA's maps group the signals, and as CARLA switches them.
    # 120 s is what netconvert aims at; the cycles come out at 100 to 110 s, usual for three and four phases.
    *("--tls.rebuild", "--tls.layout", "incoming", "--tls.cycle.time", "120"),
)
_OPENSTREETMAP: Final = (
    *_COMMON,
    *("--keep-edges.by-vclass", "passenger", "--keep-edges.components", "1"),
    *("--geometry.remove", "--geometry.max-angle.fix", "--roundabouts.guess", "--ramps.guess"),
    *("--junctions.join", "--junctions.corner-detail", "5"),
    *("--tls.guess-signals", "--tls.discard-simple", "--tls.join", "--tls.default-type", "static"),
    # RiLSA 2015 has 3 s up to 50 km/h. netconvert's own value, from the speed limit alone, is twice as long.
    *("--tls.yellow.time", "3"),
    *("--osm.sidewalks", "--osm.turn-lanes", "--osm.lane-access", "--output.street-names"),
)
_OPENSTREETMAP_SECOND: Final = (*_COMMON, "--offset.disable-normalization", "--output.street-names")
AMENDED: Final = (*_OPENSTREETMAP_SECOND, "--tls.default-type", "static", "--tls.yellow.time", "3")
"""Options for a net to which signs and signals are added (``amended_map``)."""
_JOINED_SIDEWALKS: Final = (*_COMMON, "--offset.disable-normalization", "--crossings.guess", "--walkingareas")
_ONE_RUN: Final = {
    SourceKind.BUILT_IN: (_BUILT_IN, tuple(_PARTS.values())),
}
"""Kinds of maps that netconvert compiles in one run, with its options and the options that name the files."""
_TWO_RUNS: Final = {
    SourceKind.OPENDRIVE: (_OPENDRIVE, _OPENDRIVE_SECOND, "--opendrive-files", "an OpenDRIVE map whose roads"),
    SourceKind.OPENSTREETMAP: (
        _OPENSTREETMAP,
        _OPENSTREETMAP_SECOND,
        "--osm-files",
        "an OpenStreetMap extract whose nodes",
    ),
}
"""Kinds that need two runs: the options of both, the option that names the source, and how the error begins where parts
are missing."""


@dataclass(frozen=True)
class CompiledMap:
    """A map that SUMO can load."""

    name: str
    net_path: Path
    """File of the compiled net in the cache: a plain ``.net.xml``."""
    sha256: str
    """SHA-256 of the net's bytes; the same on every machine with the same SUMO version."""
    kind: SourceKind
    source_sha256: str = ""
    """SHA-256 of the source's content, after decompression."""
    variant: str = ""
    """What the map was given for a template, in words; empty for the map itself."""

    def read_bytes(self) -> bytes:
        """The net, for ``parse_road_network``."""
        return self.net_path.read_bytes()


def compile_map(source: Path | None, cache_dir: Path | None = None, *, for_people: bool = False) -> CompiledMap:
    """Compiles a map with netconvert, or finds it in the cache.

    Args:
        source: A SUMO net, an OpenDRIVE or an OpenStreetMap file, or the name of a built-in map; None is the town.
        cache_dir: Where compiled nets are kept; None is ``$SIREN_CACHE_DIR``, else
            ``$XDG_CACHE_HOME/siren``, else ``~/.cache/siren``, or a temporary folder where there is no home.
        for_people: Whether the net gets crossings, corners of sidewalks and cycle lanes (``ways_for_people``).
            Built-in maps have them in any case.

    Raises:
        MapError: The map is missing, unreadable, not a map, refused by netconvert, without roads, or with counts that
            no real place has.
        InputError: The cache folder cannot be written.
    """
    loaded = _source_of(source)
    shown = TOWN_NAME if source is None else str(source)
    for_people = for_people and loaded.kind is not SourceKind.BUILT_IN
    recipe = _PEOPLE_RECIPE if for_people else _RECIPE
    net_path = (cache_dir or default_cache_dir()) / f"{loaded.name}-{_cache_key(loaded, recipe)[:20]}.net.xml"
    try:
        net = net_path.read_bytes()
    except OSError:
        refuse_unusable_map(loaded, shown)
        net = _compile(loaded, shown, for_people=for_people)
        network = parsed_map(net, shown)
        try:
            if loaded.kind is not SourceKind.BUILT_IN:
                net = with_prolonged_ends(net, network)
            net = mended_lanes(net)
        except (ValueError, LookupError, OverflowError) as error:
            raise MapError(shown, f"{NET_ALLOWED}; this one is damaged ({shown_words(error)})") from error
        store_in_cache(net_path, net)
    source_sha256 = hashlib.sha256(loaded.content).hexdigest()
    return CompiledMap(loaded.name, net_path, hashlib.sha256(net).hexdigest(), loaded.kind, source_sha256)


def parsed_map(net: bytes, shown: str) -> RoadNetwork:
    """The road network of a net; the error names the map."""
    try:
        return parse_road_network(net)
    except MapError as error:
        raise MapError(shown, f"{error.allowed}; this is {shown_words(error.value)}") from error


def source_sha256_of(source: Path | None) -> str:
    """``CompiledMap.source_sha256`` of a map, without compiling it; raises MapError as ``compile_map``."""
    loaded = _source_of(source)
    return hashlib.sha256(loaded.content).hexdigest()


def name_of_map(source: Path | None) -> str:
    """``CompiledMap.name`` of a map, without reading it."""
    return TOWN_NAME if source is None else map_stem(source)


def _source_of(source: Path | None) -> MapSource:
    """A built-in map by its name, or a file; raises MapError where it cannot be read."""
    if source is not None and str(source) not in BUILT_IN_MAPS:
        return read_map_source(source)
    name = name_of_map(source)
    built_in = BUILT_IN_MAPS[name]
    folder = params_dir() / built_in.folder
    try:
        files = {_PARTS[part]: (folder / f"{built_in.folder}.{part}.xml").read_bytes() for part in built_in.parts}
    except OSError as error:
        raise MapError(name, f"an installation with the built-in {name} in {folder} ({error.strerror})") from error
    return MapSource(name=name, kind=SourceKind.BUILT_IN, content=b"\0".join(built_in.made_of(files).values()))


def _cache_key(source: MapSource, recipe: str) -> str:
    first, second, *_ = _TWO_RUNS.get(source.kind, (_ONE_RUN.get(source.kind, ((), ()))[0], ()))
    parts = (recipe, source.kind.value, netconvert_version(), *first, *second)
    return hashlib.sha256(b"".join(part.encode() + b"\0" for part in parts) + source.content).hexdigest()


def converted(shown: str, options: Sequence[str], files: Files) -> bytes:
    """What netconvert makes of files, each given by the option that names it; raises MapError as ``run_netconvert``."""
    with tempfile.TemporaryDirectory(prefix="siren-map-") as folder:
        for option, content in files.items():
            path = Path(folder, f"file{option}.xml")
            path.write_bytes(content)
            options = (*options, option, str(path))
        return run_netconvert(options, Path(folder, "out.net.xml"), shown)


def _compile(source: MapSource, shown: str, *, for_people: bool) -> bytes:
    logging.getLogger("siren_ros").info("compiling the map %s; later calls have it from the cache", shown)
    run = partial(converted, shown)
    net = _streets(source, shown, run, for_people=for_people)
    if not for_people or has_corners(net):
        return without_outlines(net) if for_people else net
    places = crossing_places(source, fromstring(net))
    files = {"--sumo-net-file": net, "--connection-files": document("connections", places)}
    return without_outlines(run(_JOINED_SIDEWALKS, files))


def _streets(source: MapSource, shown: str, run: Callable[[Sequence[str], Files], bytes], *, for_people: bool) -> bytes:
    """The net of a map. Where the source is a net, its sidewalks have crossings only if it has them."""
    if source.kind is SourceKind.SUMO:
        return without_header(source.content)
    if source.kind in _ONE_RUN:
        options, names = _ONE_RUN[source.kind]
        return run(options, dict(zip(names, source.content.split(b"\0"), strict=False)))
    first_options, second_options, option, complete = _TWO_RUNS[source.kind]
    try:
        left_hand, content = _imported(source)
        if source.kind is SourceKind.OPENSTREETMAP:
            first_options = (*first_options, *(("--lefthand",) if left_hand else ()))
            if for_people:
                first_options, content = (*first_options, *cycle_options()), with_sidewalks_on_streets(content)
        first_net = run(first_options, {option: content})
        if source.kind is SourceKind.OPENDRIVE:
            patches = opendrive_patches(first_net, content, shown, for_people=for_people)
            net = with_stated_limits(run(second_options, {"--sumo-net-file": first_net, **patches}), content)
            return mirrored_net(net) if left_hand else net
        return _openstreetmap_net(source.content, first_net, shown, lambda patches: run(second_options, patches))
    except (KeyError, ValueError) as error:
        raise MapError(shown, f"{complete} are complete ({error!r})") from error


def _imported(source: MapSource) -> tuple[bool, bytes]:
    """Whether traffic keeps left, and the input for netconvert.

    An OpenDRIVE map is converted so that its traffic keeps right, and that netconvert can read it.
    """
    left_hand, content = keeps_left(source), source.content
    if left_hand:
        exchange = mirrored_opendrive if source.kind is SourceKind.OPENDRIVE else with_sides_exchanged
        content = exchange(content)
    return left_hand, importable(content) if source.kind is SourceKind.OPENDRIVE else content


def _openstreetmap_net(osm: bytes, first_net: bytes, shown: str, run: Callable[[Files], bytes]) -> bytes:
    """The net with stop and give-way signs, and longer joints where lanes fan out.

    Joints that would reach into other junctions or roads are left as they are.
    """
    net, first = fromstring(first_net), parsed_map(first_net, shown)
    signs, priorities = control_patches(net, *signed_edges(osm, net), drives_on)
    edges = [Element("edge", id=edge, priority=str(priority)) for edge, priority in priorities.items()]
    tapers = taper_patches(first)
    while signs or tapers or edges:
        nodes = document("nodes", [*signs, *tapers])
        patched = run({"--sumo-net-file": first_net, "--node-files": nodes, "--edge-files": document("edges", edges)})
        crowded = crowded_joints(first, parsed_map(patched, shown)) if tapers else ()
        if not crowded:
            return patched
        kept = [taper for taper in tapers if taper.attrib["id"] not in crowded]
        tapers = kept if len(kept) < len(tapers) else []
    return first_net


def with_speed_limit(compiled: CompiledMap, limit_mps: float) -> CompiledMap:
    """The map with all speed limits lowered to a limit; the same map where no limit is higher.

    The paper's traffic drives at the limit that CARLA gives to roads without a sign, 30 km/h. Higher limits of a map
    would leave nothing for an EMV at 50 km/h to pass. The lowered net is kept in the cache of compiled maps.

    Raises:
        InputError: The cache folder cannot be written.
    """
    return changed_map(compiled, f"{_SLOWER_RECIPE} {limit_mps:.2f}", lambda net: lowered_limits(net, limit_mps))


def with_shoulders_in_use(compiled: CompiledMap) -> CompiledMap:
    """The map with its shoulders closed to everybody; the same map where it has none.

    In a town vehicles park there. A template asks for it where a free shoulder would be the EMV's way past everybody.
    Raises InputError as ``with_speed_limit`` does.
    """
    return changed_map(compiled, _IN_USE_RECIPE, closed_shoulders)


def mirrored_map(compiled: CompiledMap) -> CompiledMap:
    """The mirror image of a map, with traffic on the other side; raises InputError as ``with_speed_limit`` does."""
    return changed_map(compiled, _MIRRORED_RECIPE, mirrored_net)


def changed_map(compiled: CompiledMap, recipe: str, change: Callable[[bytes], bytes], variant: str = "") -> CompiledMap:
    """The map with its net changed, from the cache or anew; the map itself where nothing changes.

    The ``recipe`` names the change and its version; ``variant`` says what the map was given for a template.
    """
    key = hashlib.sha256(f"{recipe} {compiled.sha256}".encode()).hexdigest()
    path = compiled.net_path.with_name(f"{compiled.name}-{key[:20]}.net.xml")
    try:
        net = path.read_bytes()
    except OSError:
        net = change(compiled.read_bytes())
        store_in_cache(path, net)
    digest = hashlib.sha256(net).hexdigest()
    variant = variant or compiled.variant
    return compiled if digest == compiled.sha256 else replace(compiled, net_path=path, sha256=digest, variant=variant)


def closed_shoulders(net: bytes) -> bytes:
    """A SUMO net whose lanes for emergency vehicles alone are closed; the same bytes where there are none."""
    return with_lanes_closed(net, lambda lane: lane.get("allow") == "emergency")


def with_lanes_closed(net: bytes, chosen: Callable[[Element], bool]) -> bytes:
    """A SUMO net with some ``lane`` elements closed to everybody; the same bytes where there are none."""
    root = fromstring(net)
    lanes = [*filter(chosen, root.iter("lane"))]
    if not lanes:
        return net
    for lane in lanes:
        lane.attrib.pop("allow", None)
        lane.set("disallow", "all")
    return document(root)


def lowered_limits(net: bytes, limit_mps: float) -> bytes:
    """A SUMO net with no lane's limit above ``limit_mps``; the same bytes where none was above."""
    root = fromstring(net)
    fast = [lane for lane in root.iter("lane") if float(lane.get("speed", "0")) > limit_mps]
    if not fast:
        return net
    for lane in fast:
        lane.set("speed", f"{limit_mps:.2f}")
    return document(root)


_SIDED_KEYS: Final = ("sidewalk", "cycleway", "busway", "parking")
"""Keys of OpenStreetMap that name a side of a way, by which netconvert adds lanes."""


def keeps_left(source: MapSource) -> bool:
    """Whether traffic keeps left on a map. The answer is no where the map states neither its side nor its place.

    It is also no where the map cannot be read: the compiler says what is wrong with it.
    """
    told = _TOLD.get(source.kind)
    try:
        return told is not None and told(fromstring(source.content, forbid_dtd=True))
    except (ParseError, DefusedXmlException, ValueError, LookupError):
        return False


def _told_by_opendrive(drive: Element) -> bool:
    return any(road.get("rule", "RHT").upper() == "LHT" for road in drive.iterfind("road"))


def _told_by_openstreetmap(osm: Element) -> bool:
    ways = [(way, tags_of(way)) for way in osm.iterfind("way")]
    tags_of_all = [tags for _, tags in ways] + [tags_of(relation) for relation in osm.iterfind("relation")]
    if sides := {tags["driving_side"] for tags in tags_of_all if "driving_side" in tags}:
        return sides == {"left"}
    places = {
        node.attrib["id"]: (float(node.attrib["lat"]), float(node.attrib["lon"]))
        for node in osm.iterfind("node")
        if {"id", "lat", "lon"} <= set(node.attrib)
    }
    turns = []
    for way, tags in ways:
        nodes = [node.get("ref", "") for node in way.iterfind("nd")]
        if tags.get("junction") == "roundabout" and len(nodes) >= 4 and nodes[0] == nodes[-1]:
            area = _area_deg2([places[node] for node in nodes if node in places])
            turns.append(-area if tags.get("oneway") == "-1" else area)
    if turns:
        return sum(turns) < 0.0
    if not places:
        return False
    lat_deg, lon_deg = (sum(values) / len(places) for values in zip(*places.values(), strict=True))
    return bool(shapely.contains_xy(_left_hand_places(), lon_deg, lat_deg))


def _area_deg2(points: Sequence[tuple[float, float]]) -> float:
    """Signed area of a closed line of latitudes and longitudes; positive where it runs counter-clockwise."""
    sides = zip(points, [*points[1:], *points[:1]], strict=True)
    return sum((lon * to_lat - to_lon * lat) / 2.0 for (lat, lon), (to_lat, to_lon) in sides)


@cache
def _left_hand_places() -> BaseGeometry:
    """Where on Earth traffic keeps left, in degrees of longitude and latitude (``tools/left_hand_places.py``)."""
    places = json.loads((params_dir() / "left_hand_places.json").read_text(encoding="utf-8"))
    return shapely.geometry.shape(places)


_TOLD: Final[Mapping[SourceKind, Callable[[Element], bool]]] = {
    SourceKind.SUMO: is_left_hand,
    SourceKind.OPENDRIVE: _told_by_opendrive,
    SourceKind.OPENSTREETMAP: _told_by_openstreetmap,
}


def with_sides_exchanged(osm: bytes) -> bytes:
    """An extract with the sidewalks, cycle lanes and bus lanes on the other side of their ways.

    netconvert counts the right side of a way as that of the traffic along it, also where traffic keeps left.
    """
    root = fromstring(osm, forbid_dtd=True)
    for tag in root.iter("tag"):
        key = tag.get("k", "").split(":")
        if key[0] in _SIDED_KEYS:
            tag.set("k", ":".join(OTHER_SIDE.get(part, part) for part in key))
            tag.set("v", OTHER_SIDE.get(tag.get("v", ""), tag.get("v", "")))
    return document(root)
