"""The road network in the ``map`` frame: lanes with their centre lines, how they connect, signals."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Final, TypeVar

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.tables.brief import Brief

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
