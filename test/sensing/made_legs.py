"""A small signalised crossing, made by hand."""

from functools import cache

import numpy as np

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.sensing.scene.static_scene import static_scene
from siren_ros.simulation.roads.road_network import (
    Connection,
    Edge,
    Junction,
    JunctionKind,
    Lane,
    LaneKind,
    RoadNetwork,
)

MOUTH_M = 16.0
"""From the middle of the crossing to where its legs begin."""
LEG_M = 90.0
LANES = ((LaneKind.SIDEWALK, 2.5), (LaneKind.SHOULDER, 2.0), (LaneKind.DRIVING, 3.5), (LaneKind.DRIVING, 3.5))
"""One direction of a leg, from the right to the left."""
DEGREES = (0, 90, 180, 270)


class _Builder:
    def __init__(self):
        self.lanes: list[Lane] = []
        self.edges: list[Edge] = []
        self.connections: list[Connection] = []

    def edge(self, name, start, end, internal, lanes):
        first = len(self.lanes)
        for position, (kind, width, points) in enumerate(lanes):
            place = (len(self.lanes), f"{name}_{position}", len(self.edges), position)
            allowed = (kind is not LaneKind.SIDEWALK, kind in {LaneKind.DRIVING, LaneKind.INTERNAL})
            self.lanes.append(Lane(*place, kind, Polyline.through(points), width, 13.9, *allowed))
        edge = Edge(len(self.edges), name, tuple(range(first, len(self.lanes))), start, end, internal)
        self.edges.append(edge)
        return edge

    def connect(self, before, after, direction, link):
        ends = np.stack((before.centre.at(before.length_m), after.centre.at(0.0)))
        points = np.stack((ends[0], ends.mean(axis=0) * (1.0 if direction == "s" else 0.7), ends[1]))
        via = self.edge(f":C_{link}", "C", "C", True, [(LaneKind.INTERNAL, 3.5, points)])
        self.connections.append(
            Connection(
                from_lane=before.index,
                to_lane=after.index,
                via=via.lanes,
                direction=direction,
                signal_id="C",
                signal_link=link,
                must_stop=False,
                junction="C",
            )
        )


def turned(points, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array(((c, s), (-s, c)))


@cache
def network_of_legs():
    """Four legs of two lanes, shoulder and sidewalk in each direction; straight on and right turns."""
    builder = _Builder()
    arrivals, departures = [], []
    for degrees in DEGREES:
        inward, outward = [], []
        for number, (kind, width) in enumerate(LANES):
            offset = sum(w for _, w in LANES[number + 1 :]) + width / 2
            # On the leg that points east, traffic to the junction keeps north of the middle.
            points = np.array(((MOUTH_M + LEG_M, offset), (MOUTH_M, offset)))
            inward.append((kind, width, turned(points, degrees)))
            outward.append((kind, width, turned(points[::-1] * (1, -1), degrees)))
        arrivals.append(builder.edge(f"in{degrees}", f"end{degrees}", "C", False, inward))
        departures.append(builder.edge(f"out{degrees}", "C", f"end{degrees}", False, outward))
    link = 0
    for leg, arrival in enumerate(arrivals):
        for position in (2, 3):
            for direction, turn in [("s", 2)] + ([("r", 1)] if position == 2 else []):
                after = builder.lanes[departures[(leg + turn) % 4].lanes[position]]
                builder.connect(builder.lanes[arrival.lanes[position]], after, direction, link)
                link += 1
    half = sum(width for _, width in LANES)
    corner = np.array(((MOUTH_M, -half), (MOUTH_M, half)))
    outline = np.concatenate([turned(corner, degrees) for degrees in DEGREES])
    junctions = {"C": Junction("C", JunctionKind.SIGNAL, outline, 0.0, 0.0)}
    for degrees in DEGREES:
        x, y = turned(np.array(((MOUTH_M + LEG_M, 0.0),)), degrees)[0]
        junctions[f"end{degrees}"] = Junction(f"end{degrees}", JunctionKind.DEAD_END, np.empty((0, 2)), x, y)
    parts = tuple(builder.lanes), tuple(builder.edges), tuple(builder.connections)
    return RoadNetwork(*parts, junctions, (0.0, 0.0), "!")


@cache
def scene_of_legs():
    return static_scene(network_of_legs(), seed=3)
