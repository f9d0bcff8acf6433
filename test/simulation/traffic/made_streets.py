"""Two streets that cross at a signal, made of straight lines: every place on them is a number that one can write down.

A road of two lanes leads east: 200 m, a junction K of 10 m without signal, 100 m up to the stop line of junction J.
Behind it, 20 m on, it goes on for 200 m. A side road of one lane comes from the north: 190 m, 10 m, 100 m up to J.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.road_network import (
    Connection,
    Edge,
    Junction,
    JunctionKind,
    Lane,
    LaneKind,
    RoadNetwork,
)
from siren_ros.simulation.roads.sites import Site, SiteKind
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.scenario.scenario import (
    DemandGroup,
    EmvDemand,
    GroupAnchor,
    Placement,
    StartReference,
    Template,
)
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.emv_start import EmvStart
from siren_ros.simulation.traffic.demand.plan import DriverPopulation, load_drivers
from siren_ros.simulation.world.actors import ActorClass

LIMIT_MPS: Final = 14.0
A, B, C, D, M, N = range(6)
"""Edges: the road before K, up to J and behind it; south of J; the side road before and up to J."""
A_RIGHT, A_LEFT, B_RIGHT, B_LEFT, C_RIGHT, C_LEFT, SOUTH, FAR, NEAR = range(9)
"""Their lanes."""
STRAIGHT, STRAIGHT_LEFT, TURN, CROSSING = 2, 3, 4, 5
"""Movements at J: 0 and 1 lead over K, 6 joins the two parts of the side road."""
STOP_LINE_M: Final = 310.0
"""Of J, from the beginning of the first road."""
CAR_M: Final = 4.6
CONFIG: Final = TrafficDrivers(spacing_spread=0.0, speed_spread=0.0)

_ROADS: Final[tuple[tuple[str, tuple[tuple[tuple[float, float], tuple[float, float]], ...]], ...]] = (
    ("a", (((-310.0, -5.25), (-110.0, -5.25)), ((-310.0, -1.75), (-110.0, -1.75)))),
    ("b", (((-100.0, -5.25), (0.0, -5.25)), ((-100.0, -1.75), (0.0, -1.75)))),
    ("c", (((20.0, -5.25), (220.0, -5.25)), ((20.0, -1.75), (220.0, -1.75)))),
    ("d", (((10.0, -20.0), (10.0, -120.0)),)),
    ("m", (((10.0, 310.0), (10.0, 120.0)),)),
    ("n", (((10.0, 110.0), (10.0, 10.0)),)),
)
_MOVEMENTS: Final = (
    (A_RIGHT, B_RIGHT, "s", "K"),
    (A_LEFT, B_LEFT, "s", "K"),
    (B_RIGHT, C_RIGHT, "s", "J"),
    (B_LEFT, C_LEFT, "s", "J"),
    (B_RIGHT, SOUTH, "r", "J"),
    (NEAR, SOUTH, "s", "J"),
    (FAR, NEAR, "s", "L"),
)


def streets() -> RoadNetwork:
    """The network; signal J has a link for each of its movements."""
    lanes: list[Lane] = []
    edges: list[Edge] = []

    def add(name: str, lines: Sequence[Sequence[tuple[float, float]]], kind: LaneKind) -> None:
        first = len(lanes)
        for position, points in enumerate(lines):
            centre = Polyline.through(points)
            lanes.append(
                Lane(len(lanes), f"{name}_{position}", len(edges), position, kind, centre, 3.5, LIMIT_MPS, True, True)
            )
        internal = kind is LaneKind.INTERNAL
        edges.append(Edge(len(edges), name, tuple(range(first, len(lanes))), "from", "to", internal))

    for name, lines in _ROADS:
        add(name, lines, LaneKind.DRIVING)
    connections = []
    for number, (source, target, direction, junction) in enumerate(_MOVEMENTS):
        path = (tuple(lanes[source].centre.points[-1]), tuple(lanes[target].centre.points[0]))
        add(f":{junction}_{number}", [path], LaneKind.INTERNAL)
        signal = "J" if junction == "J" else None
        link = number - STRAIGHT if signal else -1
        connections.append(
            Connection(source, target, (len(lanes) - 1,), direction, signal, link, must_stop=False, junction=junction)
        )
    junctions = {"J": Junction("J", JunctionKind.SIGNAL, np.zeros((0, 2)), 10.0, -3.5)}
    return RoadNetwork(tuple(lanes), tuple(edges), tuple(connections), junctions, (0.0, 0.0), "!")


def signal_site() -> Site:
    """The site at J: the EMV comes in the left lane."""
    route = {"route": (A, B, C), "site_position": 1, "site_edge": B, "stretch": (B,), "approach_lane": B_LEFT}
    movements = {"connections": (STRAIGHT, STRAIGHT_LEFT), "crossing": (CROSSING,)}
    return Site(SiteKind.SIGNAL_JUNCTION, "J", "J", **route, length_m=100.0, **movements, score=1.0)


def start_at(front_m: float, lane: int = A_LEFT) -> EmvStart:
    """The EMV on the first road; its lanes to the stop line are straight on."""
    return EmvStart(lane, front_m, (A, B, C), (lane, 9 + (lane - A_RIGHT), lane + B_RIGHT - A_RIGHT))


def emv_demand(start_m: float, speed_mps: float = 10.0) -> EmvDemand:
    """Constant speed from the start on; the start is counted from the stop line."""
    return EmvDemand(ActorClass.AMBULANCE, 1, start_m, speed_mps, speed_mps, 2.0, StartReference.STOP_LINE)


def group(
    placement: Placement, anchor: GroupAnchor, vehicles: int = 3, standing: bool = False, optional: bool = False
) -> DemandGroup:
    """Gaps of 5 m after a first one of 7 m, at 8 m/s."""
    return DemandGroup("group", placement, vehicles, 7.0, 5.0, 8.0, anchor, standing, optional)


def crossing(vehicles: int, spacing_m: float = 3.0) -> DemandGroup:
    """A queue on the side road; vehicles that do not stand have 8 m/s."""
    queue = group(Placement.CROSSING, GroupAnchor.STOP_LINE, standing=True)
    return replace(queue, vehicles=vehicles, spacing_m=spacing_m)


def template_with(*groups: DemandGroup, start_m: float = -200.0) -> Template:
    """Sedans only, who wish for the limit; ten civilians in all."""
    template = load_template("S4")
    demand = replace(
        template.demand,
        groups=groups,
        classes=((ActorClass.SEDAN, 1.0),),
        speed_factor=1.0,
        background_vehicles=10,
        district_per_lane_km=0.0,
    )
    return replace(template, demand=demand, emv=emv_demand(start_m), warm_up_s=5.0, duration_s=20.0)


def same_drivers() -> DriverPopulation:
    """Everybody wishes for the limit and keeps the same headway."""
    drivers = load_drivers()
    return replace(
        drivers,
        speed_factor=replace(drivers.speed_factor, mean=1.0, std=0.0),
        tau_s=replace(drivers.tau_s, mean=1.2, std=0.0),
    )


def with_connection(number: int, **changed: Any) -> RoadNetwork:
    """The streets with one movement that is different."""
    network = streets()
    connections = list(network.connections)
    connections[number] = replace(connections[number], **changed)
    return replace(network, connections=tuple(connections))


class Road:
    """A road along x, edge by edge; a lane with offset n is n lane widths left of the axis."""

    def __init__(self) -> None:
        self.lanes: list[Lane] = []
        self.edges: list[Edge] = []
        self.connections: list[Connection] = []

    def edge(self, from_m: float, to_m: float, offsets: Sequence[int], kind: LaneKind = LaneKind.DRIVING) -> None:
        edge, first = len(self.edges), len(self.lanes)
        for position, offset in enumerate(offsets):
            centre = Polyline.through(np.array([[from_m, 3.5 * offset], [to_m, 3.5 * offset]]))
            name = f"e{edge}_{position}"
            self.lanes.append(Lane(first + position, name, edge, position, kind, centre, 3.5, 8.3, True, True))
        lanes = tuple(range(first, len(self.lanes)))
        self.edges.append(Edge(edge, f"e{edge}", lanes, f"J{edge}", f"J{edge + 1}", kind is LaneKind.INTERNAL))

    def connect(self, source: int, target: int, via: tuple[int, ...] = ()) -> None:
        junction = f"J{self.lanes[target].edge}"
        self.connections.append(Connection(source, target, via, "s", None, -1, False, junction))

    def site(self, edges: tuple[int, ...], approach_lane: int, movements: tuple[int, ...]) -> Site:
        """The site at the end of the approach lane's edge."""
        edge = self.lanes[approach_lane].edge
        where = (edges, edges.index(edge), edge, (edge,), approach_lane)
        return Site(SiteKind.QUEUED_APPROACH, "here", "J", *where, 100.0, movements, (), 1.0)

    def built(self) -> RoadNetwork:
        return RoadNetwork(tuple(self.lanes), tuple(self.edges), tuple(self.connections), {}, (0.0, 0.0), "!")
