"""The road network in the ``map`` frame: lanes with their centre lines, how they connect, signals.

The map's coordinates are converted to latitude and longitude for transverse Mercator maps, UTM among them. pyproj is
not used: its results differ from these by up to 5.5e-9 degrees, more than the 1e-9 allowed to GNSS.

Drivers decide and SUMO drives as where traffic keeps right. On a map with left-hand traffic they do so in the mirror
image of the map and of the world about the x axis of the ``map`` frame, as SUMO's netconvert builds such nets, and what
they say is mirrored again.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property, lru_cache
from operator import neg
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Brief, Floats, Points
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.world.actors import MIRRORED_BY, ActorStates, EmvAdvice, Event, Lights, TrafficState
from siren_ros.simulation.world.commands import AvControl, VehicleCommands

NO_LANE = -1


class LaneKind(StrEnum):
    """What a lane is for."""

    DRIVING = "driving"
    SHOULDER = "shoulder"
    CYCLE = "cycle"
    """A lane for cyclists alone."""
    SIDEWALK = "sidewalk"
    KERB = "kerb"
    """A strip that nobody uses, between shoulder and sidewalk."""
    INTERNAL = "internal"
    """A path across a junction, not a lane of a road."""
    CROSSING = "crossing"


class JunctionKind(StrEnum):
    """How a junction is controlled."""

    SIGNAL = "signal"
    ALL_WAY_STOP = "all_way_stop"
    PRIORITY_STOP = "priority_stop"
    PRIORITY = "priority"
    UNCONTROLLED = "uncontrolled"
    DEAD_END = "dead_end"


@dataclass(frozen=True)
class Lane(Brief):
    """One lane; ``centre`` runs in driving direction."""

    index: int
    """Position of the lane in ``RoadNetwork.lanes``."""
    lane_id: str
    edge: int
    position: int
    """SUMO's lane number on the edge, 0 at the outer kerb: the right one, or the left one with left-hand traffic."""
    kind: LaneKind
    centre: Polyline
    width_m: float
    speed_limit_mps: float
    emergency_allowed: bool
    civilian_allowed: bool

    @property
    def length_m(self) -> float:
        """Length of the centre line."""
        return self.centre.length_m


@dataclass(frozen=True)
class Edge(Brief):
    """A directed road between two junctions, or a path through one (``internal``)."""

    index: int
    edge_id: str
    lanes: tuple[int, ...]
    """Lane indices from the outer kerb inwards."""
    from_junction: str
    to_junction: str
    internal: bool
    name: str = ""
    prolonged_m: float = 0.0
    """Length by which the road was prolonged at the map's border; the map itself does not have this part."""


@dataclass(frozen=True)
class Connection(Brief):
    """A permitted movement from one lane to the next across a junction."""

    from_lane: int
    to_lane: int
    via: tuple[int, ...]
    """Internal lanes in driving order; empty where the lanes touch."""
    direction: str
    """SUMO's letter: s straight, l left, r right, t turnaround, L/R partially."""
    signal_id: str | None
    signal_link: int
    """Position of the movement in the signal's state string; −1 without a signal."""
    must_stop: bool
    """Whether a stop sign binds this movement."""
    junction: str
    gives_way: bool = False
    """Whether a movement without a signal gives way to others."""
    alternates: bool = True
    """Whether the signal's programme has both red and green for this movement; the map may come without one."""
    green_phases: frozenset[int] = frozenset()
    """Phases of the signal's programmes, counted through all of them, in which this movement is green."""
    yellow_s: float = 0.0
    """Longest yellow of this movement in the signal's programmes; 0 without one."""

    @property
    def has_stop_line(self) -> bool:
        """Whether it has a line at which drivers stop: of a signal, or of a stop sign."""
        return self.must_stop or self.signal_id is not None

    def letter_in(self, state: str) -> str:
        """This movement's letter in the state of its signal; empty where the state has none."""
        return state[self.signal_link] if 0 <= self.signal_link < len(state) else ""


@dataclass(frozen=True)
class Junction(Brief):
    """A junction's control, outline and the movements that cross each other."""

    junction_id: str
    kind: JunctionKind
    outline: npt.NDArray[np.float64]
    """Shape ``(K, 2)``, map frame; may be empty for dead ends."""
    x_m: float
    y_m: float


MAPS_KEPT: Final = 4
"""Number of parsed maps, with what is derived from them, that a process keeps."""


@dataclass(frozen=True, eq=False)
class RoadNetwork(Brief):
    """A whole map. Built by ``parse_road_network`` from a SUMO net, immutable afterwards."""

    lanes: tuple[Lane, ...]
    edges: tuple[Edge, ...]
    connections: tuple[Connection, ...]
    junctions: Mapping[str, Junction]
    sumo_offset_m: tuple[float, float]
    """``map = sumo − offset``, per axis: the net's ``netOffset``."""
    projection: str
    """PROJ string of the map's geo-reference; ``!`` without one, as SUMO writes it."""
    origin_lat_lon_deg: tuple[float, float] | None = None
    projected_origin_m: tuple[float, float] = (0.0, 0.0)
    """Coordinates of the map frame's origin in the projection."""
    crossings: tuple[npt.NDArray[np.float64], ...] = field(default=())
    """Outlines of pedestrian crossings, each ``(K, 2)``."""
    left_hand: bool = False
    """Whether traffic keeps left."""
    cycle_connections: tuple[Connection, ...] = field(default=())
    """Movements from or to cycle lanes, which ``connections`` does not have."""
    net_sha256: str = field(default="", init=False)
    """SHA-256 of the net from which this network was parsed; a changed copy (``replace``) has none."""

    @cached_property
    def lane_by_id(self) -> Mapping[str, Lane]:
        """Lanes by SUMO id."""
        return {lane.lane_id: lane for lane in self.lanes}

    @cached_property
    def edge_by_id(self) -> Mapping[str, Edge]:
        """Edges by SUMO id."""
        return {edge.edge_id: edge for edge in self.edges}

    @cached_property
    def connections_from(self) -> Mapping[int, tuple[Connection, ...]]:
        """Movements out of each lane."""
        return _grouped((connection.from_lane, connection) for connection in self.connections)

    @cached_property
    def connection_index(self) -> Mapping[tuple[int, int], int]:
        """Position in ``connections`` of the movement from one lane to another."""
        return {(c.from_lane, c.to_lane): index for index, c in enumerate(self.connections)}

    @cached_property
    def cycle_connections_from(self) -> Mapping[int, tuple[Connection, ...]]:
        """Movements of cyclists out of each lane from or to cycle lanes."""
        return _grouped((connection.from_lane, connection) for connection in self.cycle_connections)

    @cached_property
    def cycle_connections_over(self) -> Mapping[int, tuple[Connection, ...]]:
        """Movements of cyclists across each internal lane."""
        return _grouped((lane, connection) for connection in self.cycle_connections for lane in connection.via)

    @cached_property
    def connections_to(self) -> Mapping[int, tuple[Connection, ...]]:
        """Movements into each lane."""
        return _grouped((connection.to_lane, connection) for connection in self.connections)

    @cached_property
    def connections_over(self) -> Mapping[int, tuple[Connection, ...]]:
        """Movements across each internal lane."""
        return _grouped((lane, connection) for connection in self.connections for lane in connection.via)

    @cached_property
    def connections_at(self) -> Mapping[str, tuple[tuple[int, Connection], ...]]:
        """Movements across each junction, with their positions in ``connections``."""
        return _grouped((connection.junction, (index, connection)) for index, connection in enumerate(self.connections))

    def length_m(self, lanes: Iterable[int]) -> float:
        """Total length of some lanes, such as a way across a junction."""
        return sum(self.lanes[lane].length_m for lane in lanes)

    def is_civilian(self, connection: Connection) -> bool:
        """Whether civilians may make a movement."""
        return self.lanes[connection.from_lane].civilian_allowed and self.lanes[connection.to_lane].civilian_allowed

    def neighbour(self, lane: Lane, side: int) -> Lane | None:
        """The adjacent lane of the same edge: side +1 left, −1 right; None where there is none."""
        position = lane.position + (-side if self.left_hand else side)
        lanes = self.edges[lane.edge].lanes
        return self.lanes[lanes[position]] if 0 <= position < len(lanes) else None


Key = TypeVar("Key")
Value = TypeVar("Value")


def _grouped(pairs: Iterable[tuple[Key, Value]]) -> dict[Key, tuple[Value, ...]]:
    groups: dict[Key, list[Value]] = {}
    for key, value in pairs:
        groups.setdefault(key, []).append(value)
    return {key: tuple(group) for key, group in groups.items()}


MIRROR: Final = np.array((1.0, -1.0))
"""Factors of x and y."""
_SIDES: Final = (("l", "r"), ("L", "R"), ("left", "right"), ("Left", "Right"))
OTHER_SIDE: Final[Mapping[str, str]] = {**dict(_SIDES), **{right: left for left, right in _SIDES}}
"""The other side of each side, by its word or by SUMO's letter of a direction."""


def negated(number: str) -> str:
    """A number with the other sign and the same digits; zero has no sign."""
    digits = number.lstrip("+-")
    return digits if number.startswith("-") or not float(digits) else f"-{digits}"


def right_hand_image(network: RoadNetwork) -> RoadNetwork:
    """The map itself where traffic keeps right, else its mirror image. Indices and ids are the same in both."""
    return mirrored_network(network) if network.left_hand else network


@lru_cache(maxsize=MAPS_KEPT)
def mirrored_network(network: RoadNetwork) -> RoadNetwork:
    """The mirror image of a map, with traffic on the other side. Only its origin has a place on Earth."""
    x_m, y_m = network.sumo_offset_m
    lanes = (replace(lane, centre=Polyline.through(_mirrored(lane.centre.points))) for lane in network.lanes)
    junctions = {
        name: replace(junction, outline=_mirrored(junction.outline), y_m=-junction.y_m)
        for name, junction in network.junctions.items()
    }
    return replace(
        network,
        lanes=tuple(lanes),
        connections=_mirrored_movements(network.connections),
        cycle_connections=_mirrored_movements(network.cycle_connections),
        junctions=junctions,
        sumo_offset_m=(x_m, -y_m),
        projection="!",
        projected_origin_m=(0.0, 0.0),
        crossings=tuple(map(_mirrored, network.crossings)),
        left_hand=not network.left_hand,
    )


def _mirrored_movements(movements: tuple[Connection, ...]) -> tuple[Connection, ...]:
    letters = (OTHER_SIDE.get(movement.direction, movement.direction) for movement in movements)
    return tuple(replace(movement, direction=letter) for movement, letter in zip(movements, letters, strict=True))


def _mirrored(points: Points) -> Points:
    return points * MIRROR


Content = TypeVar("Content", TrafficState, ActorStates, VehicleCommands, AvControl, Event, EmvAdvice)

_SIGNED_DETAILS: Final = frozenset({"side", "offset_m"})
_LEFT, _RIGHT = int(Lights.INDICATOR_LEFT), int(Lights.INDICATOR_RIGHT)
"""Bits of the indicators in codes of lights. The flags for wished lane changes use the same bits."""


def _exchanged(code: int) -> int:
    to_right, to_left = (_RIGHT if code & _LEFT else 0), (_LEFT if code & _RIGHT else 0)
    return code & ~(_LEFT | _RIGHT) | to_right | to_left


SIDES_EXCHANGED: Final = np.array([_exchanged(code) for code in range(256)], dtype=np.uint8)
"""For each code of lights or flags, the code with left and right exchanged."""


def mirror_image(content: Content) -> Content:
    """The mirror image of a structure. The mirror image of the result is the structure again.

    The metadata of its fields say which of them have a side (``siren_ros.simulation.world.actors``).
    """
    sided = {field.name: field.metadata[MIRRORED_BY] for field in fields(content) if MIRRORED_BY in field.metadata}
    return replace(content, **{name: _CHANGES[how](getattr(content, name)) for name, how in sided.items()})


def _mirrored_yaw(yaw_rad: Floats) -> Floats:
    """Mirrored yaws, in (−π, π]."""
    return np.where(yaw_rad == np.pi, np.pi, -yaw_rad)


def _other_sides(code: Any) -> Any:
    """Lights or flags with left and right exchanged: one code, or an array of codes."""
    return _exchanged(code) if isinstance(code, int) else SIDES_EXCHANGED[code]


def _mirrored_detail(detail: Mapping[str, Any]) -> dict[str, Any]:
    return {key: -fact if key in _SIGNED_DETAILS else fact for key, fact in detail.items()}


_CHANGES: Final[dict[str, Callable[[Any], Any]]] = {
    "sign": neg,
    "yaw": _mirrored_yaw,
    "sides": _other_sides,
    "parts": lambda parts: tuple(map(mirror_image, parts)),
    "details": _mirrored_detail,
}
"""What happens to a field, by what its metadata says."""


WGS84_A_M: Final = 6_378_137.0
WGS84_FLATTENING: Final = 1.0 / 298.257223563
UTM_SCALE: Final = 0.9996
UTM_FALSE_EASTING_M: Final = 500_000.0
UTM_FALSE_NORTHING_SOUTH_M: Final = 10_000_000.0


def geodetic_from_projected(projection: str, x_m: float, y_m: float) -> tuple[float, float] | None:
    """Latitude and longitude in degrees of a projected point; None for a projection other than tmerc and UTM.

    The projection is a PROJ string as SUMO and OpenDRIVE write it (``+proj=tmerc …`` or ``+proj=utm …``).

    Source: Karney, "Transverse Mercator with an accuracy of a few nanometers", J. Geodesy 85 (2011),
    Krüger's series in the third flattening to third order (error below a millimetre inside a zone).
    """
    frame = _frame(projection)
    if frame is None:
        return None
    x, y = (x_m - frame.false_easting_m) / frame.scale, (y_m - frame.false_northing_m) / frame.scale
    xi = (y + _meridian_arc_m(math.radians(frame.lat0_deg))) / _RECTIFYING_RADIUS_M
    eta = x / _RECTIFYING_RADIUS_M
    xi_prime = xi - sum(b * math.sin(2 * j * xi) * math.cosh(2 * j * eta) for j, b in enumerate(_BETA, start=1))
    eta_prime = eta - sum(b * math.cos(2 * j * xi) * math.sinh(2 * j * eta) for j, b in enumerate(_BETA, start=1))
    chi = math.asin(math.sin(xi_prime) / math.cosh(eta_prime))
    lat = chi + sum(d * math.sin(2 * j * chi) for j, d in enumerate(_DELTA, start=1))
    lon = math.atan2(math.sinh(eta_prime), math.cos(xi_prime))
    return math.degrees(lat), frame.lon0_deg + math.degrees(lon)


def projected_from_geodetic(projection: str, lat_deg: float, lon_deg: float) -> tuple[float, float] | None:
    """Easting and northing of a place; the inverse of ``geodetic_from_projected``, with the same source and limits."""
    frame = _frame(projection)
    if frame is None:
        return None
    conformal = _conformal(math.radians(lat_deg))
    lam = math.radians(lon_deg - frame.lon0_deg)
    xi = math.atan2(conformal, math.cos(lam))
    eta = math.asinh(math.sin(lam) / math.hypot(conformal, math.cos(lam)))
    series = list(enumerate(_ALPHA, start=1))
    y = xi + sum(a * math.sin(2 * j * xi) * math.cosh(2 * j * eta) for j, a in series)
    x = eta + sum(a * math.cos(2 * j * xi) * math.sinh(2 * j * eta) for j, a in series)
    east_m, north_m = _RECTIFYING_RADIUS_M * x, _RECTIFYING_RADIUS_M * y - _meridian_arc_m(math.radians(frame.lat0_deg))
    return east_m * frame.scale + frame.false_easting_m, north_m * frame.scale + frame.false_northing_m


class _Frame(NamedTuple):
    """The constants of a transverse Mercator grid."""

    scale: float
    false_easting_m: float
    false_northing_m: float
    lat0_deg: float
    lon0_deg: float


def _frame(projection: str) -> _Frame | None:
    pairs = (term[1:].partition("=") for term in projection.split() if term.startswith("+"))
    terms = {name: value for name, _, value in pairs}
    kind = terms.get("proj")
    try:
        if kind == "utm":
            north = UTM_FALSE_NORTHING_SOUTH_M if "south" in terms else 0.0
            return _Frame(UTM_SCALE, UTM_FALSE_EASTING_M, north, 0.0, 6.0 * int(terms["zone"]) - 183.0)
        if kind == "tmerc":
            scale = float(terms.get("k", terms.get("k_0", "1")))
            false = float(terms.get("x_0", "0")), float(terms.get("y_0", "0"))
            origin = float(terms.get("lat_0", "0")), float(terms.get("lon_0", "0"))
            return _Frame(scale, *false, *origin) if scale else None
    except (KeyError, ValueError):
        return None
    return None


_N: Final = WGS84_FLATTENING / (2.0 - WGS84_FLATTENING)
_RECTIFYING_RADIUS_M: Final = WGS84_A_M / (1.0 + _N) * (1.0 + _N**2 / 4.0 + _N**4 / 64.0)
_ALPHA: Final = (
    _N / 2.0 - 2.0 * _N**2 / 3.0 + 5.0 * _N**3 / 16.0,
    13.0 * _N**2 / 48.0 - 3.0 * _N**3 / 5.0,
    61.0 * _N**3 / 240.0,
)
_BETA: Final = (_N / 2.0 - 2.0 * _N**2 / 3.0 + 37.0 * _N**3 / 96.0, _N**2 / 48.0 + _N**3 / 15.0, 17.0 * _N**3 / 480.0)
_DELTA: Final = (2.0 * _N - 2.0 * _N**2 / 3.0 - 2.0 * _N**3, 7.0 * _N**2 / 3.0 - 8.0 * _N**3 / 5.0, 56.0 * _N**3 / 15.0)


def _conformal(lat_rad: float) -> float:
    """Tangent of the conformal latitude."""
    eccentricity = 2.0 * math.sqrt(_N) / (1.0 + _N)
    sine = math.sin(lat_rad)
    return math.sinh(math.atanh(sine) - eccentricity * math.atanh(eccentricity * sine))


def _meridian_arc_m(lat_rad: float) -> float:
    xi = math.atan(_conformal(lat_rad))
    return _RECTIFYING_RADIUS_M * (xi + sum(a * math.sin(2 * j * xi) for j, a in enumerate(_ALPHA, start=1)))
