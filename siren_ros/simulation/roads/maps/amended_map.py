"""Adds to a compiled map what it lacks: signals, stop signs, shoulders, longer roads at open ends.

Lanes and signs are put into the net, and netconvert draws the junctions anew. The junctions and edges of the result say
what was added there (parameters ``added_…`` of the net).
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Final
from xml.etree.ElementTree import Element, SubElement

from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError
from siren_ros.simulation.roads.maps.map_compiler import AMENDED, converted, parsed_map
from siren_ros.simulation.roads.maps.map_formats import mirrored_net, shoulder_movements
from siren_ros.simulation.roads.maps.netconvert import (
    document,
    insert_lane,
    mended_lanes,
    normal_edges,
    points_of,
    renumber_lanes,
    text_of,
)
from siren_ros.simulation.roads.maps.prolonged_ends import open_edges, roads_at, with_prolonged_ends
from siren_ros.simulation.roads.net_parser import DEFAULT_LANE_WIDTH_M, is_left_hand, permissions_on
from siren_ros.simulation.roads.road_network import JunctionKind, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes

ADDITIONS: Final[Mapping[str, str]] = {
    "signal": "a junction without a signal",
    "all_way_stop": "a junction without a signal that is no such stop",
    "shoulder": "an edge without a shoulder",
    "longer": "an edge at an open end of a road with space ahead",
}
"""What can be added, and where."""
_AT: Final = {"junction": ("signal", "all_way_stop"), "edge": ("shoulder", "longer")}
_ADDED: Final = "added_"
_SHOULDER: Final = {"allow": "emergency", "type": "shoulder", "width": "2.50"}
"""Attributes of a shoulder, as wide as those of the built-in town (RAA 2008, cross-section RQ 28)."""


def places_for(network: RoadNetwork) -> Mapping[str, Sequence[str]]:
    """By kind of addition, the junctions or edges of a map where it can be made."""
    beside, _ = roads_at(network)
    kinds = {name: network.junctions[name].kind for name, ends in beside.items() if len(ends) > 2}
    free = [name for name, kind in kinds.items() if kind is not JunctionKind.SIGNAL]
    edges = [edge for edge in network.edges if driving_lanes(network, edge.index)]
    wide = {lane.edge for lane in network.lanes if lane.kind is LaneKind.SHOULDER}
    return {
        "signal": free,
        "all_way_stop": [name for name in free if kinds[name] is not JunctionKind.ALL_WAY_STOP],
        "shoulder": [edge.edge_id for edge in edges if edge.index not in wide],
        "longer": open_edges(network),
    }


def amended_map(net: bytes, additions: Sequence[str], shown: str) -> bytes:
    """A SUMO net with additions; the same net and additions give the same bytes.

    Args:
        net: A compiled map (``compile_map``).
        additions: Texts ``KIND:NAME`` (``ADDITIONS``). Where two roads have a shoulder, a movement along both is added
            to the right and straight on. A road becomes longer by half a route, or as far as there is space.
        shown: The map's name in errors.

    Raises:
        InputError: An addition is not one of these, or the map has no such place for it.
        MapError: netconvert refused the net.
    """
    if is_left_hand(fromstring(net)):
        return mirrored_net(amended_map(mirrored_net(net), additions, shown))
    network = parsed_map(net, shown)
    chosen = _chosen(places_for(network), additions)
    root = fromstring(net)
    for place, kind in ((place, kind) for tag, kinds in _AT.items() for place in root.iterfind(tag) for kind in kinds):
        if place.attrib["id"] in chosen[kind]:
            SubElement(place, "param", key=f"{_ADDED}{kind}", value="true")
            place.attrib.update({"type": "allway_stop"} if kind == "all_way_stop" else {})
    _add_shoulders(root, chosen["shoulder"])
    signals = ("--tls.set", ",".join(chosen["signal"])) if chosen["signal"] else ()
    net = converted(shown, (*AMENDED, *signals), {"--sumo-net-file": document(root)})
    return mended_lanes(with_prolonged_ends(net, parsed_map(net, shown), chosen["longer"]))


def additions_of(net: bytes) -> list[str]:
    """The additions ``KIND:NAME`` that a net says it has."""
    root = fromstring(net, forbid_dtd=True)
    params = (
        (place, param.get("key", ""))
        for tag in _AT
        for place in root.iterfind(tag)
        for param in place.iterfind("param")
    )
    return [f"{key.removeprefix(_ADDED)}:{place.get('id')}" for place, key in params if key.startswith(_ADDED)]


def _chosen(places: Mapping[str, Sequence[str]], additions: Sequence[str]) -> Mapping[str, Sequence[str]]:
    """The names of each kind; InputError where the map has no such place."""
    asked = [addition.partition(":")[::2] for addition in additions]
    for (kind, name), addition in zip(asked, additions, strict=True):
        if kind not in ADDITIONS:
            kinds = ", ".join(f"{kind}:NAME ({where})" for kind, where in ADDITIONS.items())
            raise InputError("add", addition, kinds)
        if name not in places[kind]:
            names = ", ".join(places[kind]) or "here is none"
            raise InputError("add", addition, f"{kind} with the name of {ADDITIONS[kind]}: {names}")
    return {kind: [name for of_kind, name in asked if of_kind == kind] for kind in ADDITIONS}


def _add_shoulders(root: Element, names: Collection[str]) -> None:
    """Puts a shoulder to the right of the driving lanes of some edges, in place, and movements between shoulders."""
    first: dict[str, int] = {}
    edges = {edge.attrib["id"]: edge for edge in normal_edges(root)}
    for name in names:
        lanes = edges[name].findall("lane")
        first[name] = next(place for place, lane in enumerate(lanes) if permissions_on(lane).civilian)
        beside = lanes[first[name]]
        shoulder = Element("lane", {**beside.attrib, **_SHOULDER})
        shoulder.attrib.pop("disallow", None)
        centre = Polyline.through(points_of(beside.attrib["shape"])[:, :2])
        apart_m = 0.5 * (float(beside.get("width", DEFAULT_LANE_WIDTH_M)) + float(_SHOULDER["width"]))
        shoulder.set("shape", text_of(centre.offset_points(centre.arc_m, -apart_m)))
        edges[name].attrib.pop("shape", None)  # netconvert takes it from the lanes, so that the others stay in place
        insert_lane(edges[name], first[name], shoulder)
    renumber_lanes(root, first)
    shoulders = {
        (name, int(lane.attrib["index"]))
        for name, edge in edges.items()
        for lane in edge.iterfind("lane[@allow='emergency']")
    }
    for movement, ends in [*shoulder_movements(root, shoulders)]:
        if not first.keys().isdisjoint((ends["from"], ends["to"])):
            SubElement(root, "connection", {**movement.attrib, **ends}).attrib.pop("via", None)
