"""Runs SUMO's ``netconvert`` so that it writes the same bytes on every machine, and changes the nets that it writes.

Stop and yield signs are given to it as plain XML: the type of a junction and the priority of its approaches.

netconvert draws bends as polygons with sides of 2 to 10 m, some turning movements of OpenDRIVE maps as straight lines
from lane to lane, and gives all lanes of an edge one length. SUMO's vehicles would turn in jerks at every corner, and
change their speed where a lane is longer or shorter than its stated length. So the lanes' shapes and lengths are
corrected.

Ways for pedestrians and cyclists are added where an episode has some; maps of other episodes stay as they are.
Sidewalks get corners where they meet. Crossings join the sidewalks of both sides of a street at its junctions: in an
OpenDRIVE map at those that have crosswalks, elsewhere at all. OpenStreetMap's own crossings come on top. A cycle lane
lies between the sidewalk and the other lanes: the built-in city is the built-in town with cycle lanes. Cyclists cross a
junction in every direction that the street has; at a signal they go with the vehicles of that direction.
"""

import os
import re
import resource
import shutil
import signal
import subprocess
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, SubElement, register_namespace, tostring

import numpy as np
from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.arrays import Points
from siren_ros.errors import MapError, SirenError
from siren_ros.simulation.roads.maps.map_source import MapSource, SourceKind, shown_words
from siren_ros.simulation.roads.net_parser import FARTHEST_M, MAX_MAP_BYTES, check_shape, paths_across, permissions_on

TIMEOUT_S: Final = 900.0
"""Longest time of one import; a city of OpenStreetMap takes about a minute."""
MOST_MEMORY_BYTES: Final = 8 * 2**30
"""Largest address space of netconvert. A grid of streets with a net of 300 MB, more than SIREN reads, took 1.4 GB."""
_MOST_OUTPUT_BYTES: Final = 2 * MAX_MAP_BYTES

_PROLOGUE: Final = re.compile(rb"\s*(<\?xml[^>]*\?>)?(?:\s*<!--.*?-->)*\s*", re.DOTALL)
_ERROR_LINE: Final = re.compile(r"^Error: *(.+)$", re.MULTILINE)


@cache
def sumo_home() -> Path:
    """The folder of SUMO: the wheel's, else ``SUMO_HOME``.

    Raises:
        SirenError: SUMO is not installed.
    """
    spec = find_spec("sumo")
    if spec is not None and spec.submodule_search_locations:
        home = Path(next(iter(spec.submodule_search_locations)))
        if (home / "bin" / "netconvert").is_file():
            return home
    if "SUMO_HOME" in os.environ:
        return Path(os.environ["SUMO_HOME"])
    raise SirenError("SUMO is not installed: neither the eclipse-sumo wheel nor SUMO_HOME is there")


@cache
def netconvert_path() -> Path:
    """Path of the netconvert program.

    Raises:
        SirenError: There is none.
    """
    program = sumo_home() / "bin" / "netconvert"
    if program.is_file():
        return program
    if on_path := shutil.which("netconvert"):
        return Path(on_path)
    raise SirenError(f"netconvert is neither in {program.parent} nor on the PATH")


@cache
def netconvert_version() -> str:
    """SUMO's version, part of every cache key."""
    try:
        return version("eclipse-sumo")
    except PackageNotFoundError:
        answer = subprocess.run(  # noqa: S603 - SUMO's own program, fixed arguments
            [str(netconvert_path()), "--version"], capture_output=True, text=True, check=False
        )
        return answer.stdout.partition("\n")[0]


def run_netconvert(options: Sequence[str], output: Path, shown_source: str) -> bytes:
    """Compiles a net and returns it without netconvert's dated header.

    netconvert writes to ``output``, whose folder must exist. The error names the map by ``shown_source``.

    Raises:
        MapError: netconvert refused the input, and the message carries its first error line; or it took too much time,
            memory or disk.
    """
    command = [*_bounds(), str(netconvert_path()), *options, "--output-file", str(output)]
    environment = {**os.environ, "SUMO_HOME": str(sumo_home()), "LC_ALL": "C"}
    try:
        answer = subprocess.run(  # noqa: S603 - SUMO's own program; file names are arguments, no shell
            command, capture_output=True, text=True, errors="replace", check=False, env=environment, timeout=TIMEOUT_S
        )
    except subprocess.TimeoutExpired as error:
        raise MapError(shown_source, f"a map that netconvert imports within {TIMEOUT_S:.0f} s") from error
    if answer.returncode != 0 or not output.is_file():
        raise MapError(shown_source, f"a map that netconvert can import (it said: {_reason(answer)})")
    if output.stat().st_size > MAX_MAP_BYTES:
        raise MapError(shown_source, f"a map whose net has at most {MAX_MAP_BYTES // 1_000_000} MB")
    return without_header(output.read_bytes())


def _bounds() -> Sequence[str]:
    """Command prefix that limits netconvert's memory and ends it together with this process (util-linux).

    Without the latter, netconvert would go on alone where this process is killed.
    """
    limits = {
        "as": (resource.RLIMIT_AS, MOST_MEMORY_BYTES),
        "cpu": (resource.RLIMIT_CPU, int(TIMEOUT_S)),
        "fsize": (resource.RLIMIT_FSIZE, _MOST_OUTPUT_BYTES),
    }
    options = []
    for name, (number, most) in limits.items():
        _, allowed = resource.getrlimit(number)
        options.append(f"--{name}={most if allowed == resource.RLIM_INFINITY else min(most, allowed)}")
    return ("prlimit", *options, "setpriv", "--pdeathsig", "KILL", "--")


def _reason(answer: subprocess.CompletedProcess[str]) -> str:
    """Why netconvert failed, in one line that a terminal can show."""
    if line := _ERROR_LINE.search(answer.stderr) or _ERROR_LINE.search(answer.stdout):
        lacks_memory = "bad_alloc" in line.group(1)
        memory = f"more than {MOST_MEMORY_BYTES // 2**30} GB of memory are needed"
        return memory if lacks_memory else shown_words(line.group(1).strip())
    code = answer.returncode
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def without_header(net_xml: bytes) -> bytes:
    """The net without comments before its root element: netconvert's carry the date and the paths."""
    prologue = _PROLOGUE.match(net_xml)
    if prologue is None:
        return net_xml
    declaration = prologue.group(1)
    return (declaration + b"\n" if declaration else b"") + net_xml[prologue.end() :]


def normal_edges(net: Element) -> Iterator[Element]:
    """The edges of a net outside junctions."""
    return (edge for edge in net.iterfind("edge") if edge.get("function", "normal") == "normal")


def document(root: Element | str, elements: Iterable[Element] = ()) -> bytes:
    """A net as bytes, or one of netconvert's plain XML files with elements, by its root's name (``nodes``)."""
    if isinstance(root, Element):
        return bytes(tostring(root, encoding="utf-8", xml_declaration=True))
    plain = Element(root)
    plain.extend(elements)
    return bytes(tostring(plain, encoding="utf-8"))


def control_patches(
    net: Element, stopping: Collection[str], yielding: Collection[str], is_driven_on: Callable[[Element], bool]
) -> tuple[list[Element], Mapping[str, int]]:
    """Node patches and edge priorities for signs.

    A junction is an all-way stop where all of its approaches have a stop sign, and a priority stop where some have.
    Signed approaches get less priority than the others. Junctions with signals stay as they are. ``stopping`` and
    ``yielding`` are the ids of the edges that end at such a sign; ``is_driven_on`` says whether an edge is an approach.

    Returns:
        ``node`` elements, and the new priority of each signed edge by id.
    """
    approaches: dict[str, dict[str, int]] = {}
    for edge in filter(is_driven_on, normal_edges(net)):
        approaches.setdefault(edge.attrib["to"], {})[edge.attrib["id"]] = int(edge.get("priority", "1"))
    for junction in net.iterfind("junction"):
        if junction.get("type", "").startswith("traffic_light"):
            approaches.pop(junction.attrib["id"], None)
    nodes: list[Element] = []
    priorities: dict[str, int] = {}
    for junction_id, edges in approaches.items():
        stops = [edge for edge in edges if edge in stopping]
        if stops:
            kind = "allway_stop" if len(stops) == len(edges) else "priority_stop"
            nodes.append(Element("node", id=junction_id, type=kind))
        signed = {edge for edge in edges if edge in stopping or edge in yielding}
        others = [priority for edge, priority in edges.items() if edge not in signed]
        priorities |= {edge: min([priority, *others]) - 1 for edge, priority in edges.items() if edge in signed}
    return nodes, priorities


_SHARPEST_KEPT_RAD: Final = 0.02
"""A corner with a smaller change of direction stays as it is."""
_TURN_PER_POINT_RAD: Final = 0.05
"""A rounded corner gets one point for each such change of direction (3°)."""
_FARTHEST_CUT_M: Final = 6.0
"""A rounded corner begins at most this far before the vertex."""
_LARGEST_SHIFT_M: Final = 0.3
"""A rounded corner passes its vertex at most at this distance: a tenth of a lane's width."""
_ONE_LENGTH_SHARE: Final = 0.1
"""Lanes of one edge keep one length, their mean, while none differs from it by more than this share: where vehicles
change lanes, SUMO takes places with equal lengths for places side by side. A lane that differs more has its own: on it
a bus of 12 m would become shorter, for SUMO, by most of the 2 m that it keeps behind it."""
_STEP_BACK_M: Final = 1.0
"""Only shorter sides are removed where a line goes back; longer ones lead somewhere. Where a path across a junction
goes back by more, its lane ends earlier."""
_LEAST_SIDE_M: Final = 0.05
_SHORTEST_M: Final = 0.1
"""netconvert's own least length of a lane."""
_CORNER_RAD: Final = 0.17
"""Change of direction from which the end of a path across a junction is a corner (10°)."""
_SHORTEST_PATH_M: Final = 2.0
"""Shorter paths across junctions stay as they are, unless they lead backwards."""
_HANDLE: Final = 0.39
"""Length of a Bézier curve's handles over its chord: a quarter turn becomes nearly a circle."""
_POINTS: Final = 17


def mended_lanes(net_xml: bytes) -> bytes:
    """The net with rounded lane shapes and lengths that fit them.

    Edges for pedestrians at junctions and everything but ``shape`` and ``length`` of lanes stay as they are. What is no
    SUMO net is given back unchanged.

    Raises:
        ValueError, LookupError: The net is damaged.
    """
    root = fromstring(net_xml, forbid_dtd=True)
    if root.tag != "net":
        return net_xml
    mend_junction_paths(root)
    written = 0
    for edge in root.iterfind("edge"):
        if edge.get("function", "normal") in {"normal", "internal"}:
            _mend_edge(edge)
        written += sum(len(lane.get("shape", "")) for lane in edge.iterfind("lane"))
        if written > MAX_MAP_BYTES:
            raise ValueError(f"a net of more than {MAX_MAP_BYTES // 1_000_000} MB once its corners are rounded")
    register_namespace("xsi", "http://www.w3.org/2001/XMLSchema-instance")
    return document(root)


def _mend_edge(edge: Element) -> None:
    lengths_m: dict[Element, float] = {}
    for lane in edge.iterfind("lane"):
        if lane.get("shape"):
            points = points_of(lane.attrib["shape"])
            if not permissions_on(lane).any_motor:
                points = without_steps_back(points)
            if len(points) > 2:
                lane.set("shape", text_of(rounded(points)))
            lengths_m[lane] = _length_m(points_of(lane.attrib["shape"]))
    driven = {lane for lane in lengths_m if permissions_on(lane).any_motor} or set(lengths_m)
    mean_m = sum(length_m for lane, length_m in lengths_m.items() if lane in driven) / max(len(driven), 1)
    is_normal = edge.get("function", "normal") == "normal"
    for lane, length_m in lengths_m.items():
        alike = is_normal and abs(length_m - mean_m) <= _ONE_LENGTH_SHARE * mean_m
        lane.set("length", f"{max(mean_m if alike or lane not in driven else length_m, _SHORTEST_M):.3f}")


def without_steps_back(points: Points) -> Points:
    """A polyline, shape ``(K, 2)`` or more, without short sides on which it goes back; its ends stay.

    netconvert leaves some where the inner side of a bend is drawn: on them SUMO's people turn round twice, and jump to
    the other side of the sidewalk.
    """
    side = np.diff(points[:, :2], axis=0)
    short = np.linalg.norm(side, axis=1) < _STEP_BACK_M
    back = ((side[1:] * side[:-1]).sum(axis=1) < 0.0) & (short[1:] | short[:-1])
    if not back.any():
        return points
    return without_steps_back(np.delete(points, int(np.argmax(back)) + 1, axis=0))


def rounded(points: Points) -> Points:
    """A polyline, shape ``(K, 2)`` or ``(K, 3)``, with its corners replaced by parabolas; the ends stay.

    The parabola of a corner begins halfway to the next vertex, or nearer (``_FARTHEST_CUT_M``, ``_LARGEST_SHIFT_M``),
    and is tangent to both sides. A regular polygon becomes nearly a circle. Points that follow another one too closely
    to show a direction are left out.
    """
    apart = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    kept = points[np.concatenate(([True], apart > 1e-3))]
    if len(kept) < 3:
        return points
    side = np.diff(kept, axis=0)
    side_m = np.linalg.norm(side[:, :2], axis=1)
    unit = side / side_m[:, None]
    pieces = [kept[:1]]
    for number, vertex in enumerate(kept[1:-1]):
        before, after = unit[number], unit[number + 1]
        turn = _turn_rad(before, after)
        if turn < _SHARPEST_KEPT_RAD:
            pieces.append(vertex[None])
            continue
        cut = min(0.5 * side_m[number], 0.5 * side_m[number + 1], _FARTHEST_CUT_M)
        cut = min(cut, 2.0 * _LARGEST_SHIFT_M / np.sin(0.5 * turn))
        share = np.linspace(0.0, 1.0, int(np.ceil(turn / _TURN_PER_POINT_RAD)) + 2)[:, None]
        first, last = vertex - cut * before, vertex + cut * after
        pieces.append((1.0 - share) ** 2 * first + 2.0 * share * (1.0 - share) * vertex + share**2 * last)
    curve = np.concatenate([*pieces, kept[-1:]])
    distinct = [curve[0]]
    for point in curve[1:-1]:
        if min(np.hypot(*(point - other)[:2]) for other in (distinct[-1], curve[-1])) >= _LEAST_SIDE_M:
            distinct.append(point)
    return np.stack([*distinct, curve[-1]])


def mend_junction_paths(net: Element) -> None:
    """Gives the paths with corners at their ends the shape of a Bézier curve, in place; heights stay linear.

    A lane whose path would lead back, because it goes beyond the begin of the next one, ends earlier: no vehicle can
    follow such a path.
    """
    lanes = {lane.attrib["id"]: lane for lane in net.iter("lane") if lane.get("shape")}
    across = []
    for movement in paths_across(net):
        source, target = lanes.get(movement.source), lanes.get(movement.target)
        path = [lanes[lane] for lane in movement.via if lane in lanes]
        if path and source is not None and target is not None:
            across.append((source, path, target))
    for source, path, target in across:
        cut_m = _beyond_m(source, path, target)
        if cut_m > 0.0:
            _end_earlier(source, cut_m, path[0], [other[0] for lane, other, _ in across if lane is source])
    for source, path, target in across:
        _mend_path(source, path, target)


def _beyond_m(source: Element, path: Sequence[Element], target: Element) -> float:
    """Length at the end of a lane without which its path leads ahead by as much as it is long now; 0 if it does."""
    ends, begins = (points_of(lane.attrib["shape"])[:, :2] for lane in (source, target))
    enters, leaves, way = _direction(ends[-2:]), _direction(begins), begins[0] - ends[-1]
    back_m = float(-enters @ way)
    leads_back = len(path) == 1 and back_m > _STEP_BACK_M and enters @ leaves > 0.0 and permissions_on(target).civilian
    return back_m + float(np.hypot(*way)) if leads_back else 0.0


def _end_earlier(lane: Element, cut_m: float, back: Element, paths: Sequence[Element]) -> None:
    """Cuts the end of a lane off, where it is long enough; the path that led back becomes straight, others longer."""
    points = points_of(lane.attrib["shape"])[:, :2]
    arc_m = np.cumsum([0.0, *np.linalg.norm(np.diff(points, axis=0), axis=1)])
    at_m = arc_m[-1] - cut_m
    if at_m < _SHORTEST_PATH_M:
        return
    end, gone = np.array([np.interp(at_m, arc_m, column) for column in points.T]), points[arc_m > at_m]
    lane.set("shape", text_of(np.stack((*points[arc_m < at_m], end))))
    for path in paths:
        shape = points_of(path.attrib["shape"])[:, :2]
        path.set("shape", text_of(np.stack((end, shape[-1]) if path is back else (end, *gone[:-1], *shape))))


def _mend_path(source: Element, path: list[Element], target: Element) -> None:
    shapes = [points_of(lane.attrib["shape"]) for lane in path]
    flat = min(shape.shape[1] for shape in shapes)
    shapes = [shape[:, :flat] for shape in shapes]
    enters, leaves = _direction(points_of(source.attrib["shape"])[-2:]), _direction(points_of(target.attrib["shape"]))
    start, end = shapes[0][0], shapes[-1][-1]
    corners = _turn_rad(enters, _direction(shapes[0])), _turn_rad(_direction(shapes[-1][-2:]), leaves)
    chord_m = float(np.hypot(*(end - start)[:2]))
    if chord_m < _SHORTEST_PATH_M and len(path) == 1 and enters @ (end - start)[:2] < 0.0 < enters @ leaves:
        # Roads of an OpenDRIVE map overlap by some centimetres. SUMO would turn vehicles round on the way back.
        ahead = np.append(end[:2] - _SHORTEST_M * leaves, end[2:])
        path[0].set("shape", text_of(np.stack((ahead, end))))
        return
    if chord_m < _SHORTEST_PATH_M or max(corners) < _CORNER_RAD:
        return
    share = np.linspace(0.0, 1.0, _POINTS)[:, None]
    handle_m = _HANDLE * chord_m
    handles = (start[:2], start[:2] + handle_m * enters, end[:2] - handle_m * leaves, end[:2])
    weights = ((1.0 - share) ** 3, 3.0 * share * (1.0 - share) ** 2, 3.0 * share**2 * (1.0 - share), share**3)
    level = sum((weight * point for weight, point in zip(weights, handles, strict=True)), np.zeros((_POINTS, 2)))
    curve = np.concatenate((level, (start + share * (end - start))[:, 2:]), axis=1)
    lengths = [_length_m(shape) for shape in shapes]
    cuts = np.round(np.cumsum(lengths) / sum(lengths) * (_POINTS - 1)).astype(int)
    first = 0
    for lane, last in zip(path, cuts.tolist(), strict=True):
        begin = min(first, _POINTS - 2)
        first = max(last, begin + 1)
        lane.set("shape", text_of(curve[begin : first + 1]))


def _direction(points: Points) -> Points:
    """Unit vector from the first point of a line to the second."""
    side = points[1, :2] - points[0, :2]
    return np.asarray(side / max(float(np.hypot(*side)), 1e-9))


def _turn_rad(before: Points, after: Points) -> float:
    return float(abs(np.arctan2(before[0] * after[1] - before[1] * after[0], before[:2] @ after[:2])))


def _length_m(points: Points) -> float:
    return float(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).sum())


def points_of(shape: str) -> Points:
    """The points of a ``shape`` attribute, shape ``(K, 2)`` or ``(K, 3)``; ValueError where it is none."""
    check_shape(shape)
    rows = [[float(number) for number in point.split(",")] for point in shape.split()]
    flat = min(len(row) for row in rows)
    points = np.array([row[:flat] for row in rows], dtype=np.float64)
    if not (np.abs(points) <= FARTHEST_M).all():
        raise ValueError("a point that is not on Earth")
    return points


def text_of(points: Points) -> str:
    """Writes points as a ``shape`` attribute."""
    return " ".join(",".join(f"{value:.4f}".rstrip("0").rstrip(".") for value in point) for point in points)


_TYPES: Final = ("osmNetconvert", "osmNetconvertBicycle")
_SEPARATE: Final = re.compile(rb"""(k=["']sidewalk(:both|:left|:right)?["']\s+v=["'])separate(["'])""")
"""Finds a sidewalk that is also drawn as a way of its own. netconvert drops such ways where it keeps streets alone."""
_LEAST_ARMS: Final = 3
_OUTLINE: Final = re.compile(rb' outlineShape="[^"]*"')


def cycle_options() -> tuple[str, ...]:
    """Netconvert's options for an OpenStreetMap extract with its cycle lanes and its crossings."""
    types = ",".join(str(sumo_home() / "data/typemap" / f"{name}.typ.xml") for name in _TYPES)
    return "--type-files", types, "--osm.bike-access", "--osm.crossings"


def with_sidewalks_on_streets(osm: bytes) -> bytes:
    """An OpenStreetMap extract in which separately drawn sidewalks belong to their streets."""

    def on_street(tag: "re.Match[bytes]") -> bytes:
        return tag[1] + (b"yes" if tag[2] else b"both") + tag[3]

    return _SEPARATE.sub(on_street, osm)


def has_corners(net: bytes) -> bool:
    """Whether the sidewalks of a net meet at junctions."""
    return b'function="walkingarea"' in net


def without_outlines(net: bytes) -> bytes:
    """A net with crossings as wide as their lanes. netconvert's own outlines extend around corners of sidewalks."""
    return _OUTLINE.sub(b"", net)


def real_junctions(net: Element) -> frozenset[str]:
    """Junctions of three streets or more, and places that have crossings already."""
    arms: dict[str, set[str]] = {}
    for edge in normal_edges(net):
        ends = edge.attrib["from"], edge.attrib["to"]
        for end, other in (ends, ends[::-1]):
            arms.setdefault(end, set()).add(other)
    crossed = {edge.attrib["id"][1:].rpartition("_")[0] for edge in net.iterfind("edge[@function='crossing']")}
    return frozenset(crossed.union(node for node, others in arms.items() if len(others) >= _LEAST_ARMS))


def crosswalk_junctions(drive: Element) -> frozenset[str]:
    """Junctions of an OpenDRIVE map with a crosswalk: on a road across the junction, or near the end of a road."""
    found: set[str] = set()
    for road in drive.iterfind("road"):
        for crosswalk in road.iterfind("objects/object[@type='crosswalk']"):
            at_end = 2.0 * float(crosswalk.get("s", "0")) > float(road.get("length", "0"))
            link = road.find("link/successor" if at_end else "link/predecessor")
            if road.get("junction", "-1") != "-1":
                found.add(road.attrib["junction"])
            elif link is not None and link.get("elementType") == "junction":
                found.add(link.attrib["elementId"])
    return frozenset(found)


def crossing_places(source: MapSource, net: Element) -> Iterator[Element]:
    """Elements of netconvert's plain XML that forbid crossings at all places but those of the map."""
    drive = source.kind is SourceKind.OPENDRIVE
    kept = crosswalk_junctions(fromstring(source.content, forbid_dtd=True)) if drive else real_junctions(net)
    nodes = (junction.attrib["id"] for junction in net.iterfind("junction") if junction.get("type") != "internal")
    return (Element("crossing", node=node, discard="true") for node in nodes if node not in kept)


CYCLE_LANE: Final = {"index": "1", "allow": "bicycle", "width": "1.85", "type": "cycle"}
"""Attributes of a cycle lane. The width is the usual one (RASt 06: 1.85 m with its marking)."""
_STREETS: Final = frozenset({"arterial", "collector"})
"""Types of the streets that get cycle lanes; elsewhere cyclists ride with the other traffic."""


def with_cycle_lanes(files: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """Plain XML files by netconvert's options, with cycle lanes on both sides of the larger streets.

    Each street has its sidewalk as lane 0.
    """
    roots = {option: fromstring(content) for option, content in files.items()}
    edges, movements, signals = (roots[f"--{kind}-files"] for kind in ("edge", "connection", "tllogic"))
    widened = {edge.attrib["id"] for edge in edges.iterfind("edge") if edge.get("type") in _STREETS}
    for edge in edges.iterfind("edge"):
        if edge.attrib["id"] in widened:
            edge.set("numLanes", str(insert_lane(edge, 1, Element("lane", CYCLE_LANE))))
    for part in (movements, signals):
        _lead_across(part, widened)
    return {option: document(root) for option, root in roots.items()}


def insert_lane(edge: Element, place: int, lane: Element) -> int:
    """Puts a lane into an edge, and numbers all lanes anew, also in the ids of a net's; returns their number."""
    edge.insert([*edge].index(edge.findall("lane")[place]), lane)
    lanes = edge.findall("lane")
    for index, numbered in enumerate(lanes):
        numbered.set("index", str(index))
        if "id" in numbered.attrib:
            numbered.set("id", f"{edge.attrib['id']}_{index}")
    return len(lanes)


def renumber_lanes(part: Element, first: Mapping[str, int]) -> None:
    """Moves the lane numbers of the movements of a document by one where a lane was inserted, by the edges' names."""
    for movement in part.iterfind("connection"):
        for end, number in (("from", "fromLane"), ("to", "toLane")):
            if (place := int(movement.attrib[number])) >= first.get(movement.attrib[end], place + 1):
                movement.set(number, str(place + 1))


def _lead_across(part: Element, widened: set[str]) -> None:
    """Renumbers lanes, and adds the movements of cyclists, each with the signal of its direction's last lane."""
    renumber_lanes(part, dict.fromkeys(widened, 1))
    ways: dict[tuple[str, str], Element] = {}
    for movement in part.findall("connection"):
        pair = movement.attrib["from"], movement.attrib["to"]
        if movement.attrib["fromLane"] != "0" and not widened.isdisjoint(pair):
            ways[pair] = movement
    for movement in ways.values():
        SubElement(part, "connection", {**movement.attrib, "fromLane": "1", "toLane": "1"})
