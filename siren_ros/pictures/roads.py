"""The road network drawn from above."""

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from siren_ros.numerics.arrays import Points
from siren_ros.pictures.palette import GROUND, JUNCTION, LANE_FILL, MARKING, ROAD_EDGE
from siren_ros.roads.road_network import Lane, LaneKind, RoadNetwork

_PAVED = (LaneKind.DRIVING, LaneKind.SHOULDER)


def draw_roads(axes: Axes, network: RoadNetwork, line_width: float) -> None:
    """Draws lane surfaces, junctions, crossings and markings.

    Args:
        axes: Where to draw; its background becomes the ground.
        network: The map.
        line_width: Width of lane markings in points; edges of the carriageway are drawn a little wider.
    """
    axes.set_facecolor(GROUND)
    order = (LaneKind.SIDEWALK, LaneKind.KERB, LaneKind.SHOULDER, LaneKind.DRIVING)
    for level, kind in enumerate(order):
        outlines = [lane_outline(lane) for lane in network.lanes if lane.kind is kind]
        axes.add_collection(
            PolyCollection(outlines, facecolors=LANE_FILL[kind], edgecolors="none", zorder=1 + level / 10)
        )
    junctions = [junction.outline for junction in network.junctions.values() if len(junction.outline) >= 3]
    axes.add_collection(PolyCollection(junctions, facecolors=JUNCTION, edgecolors="none", zorder=1.5))
    axes.add_collection(
        PolyCollection(
            list(network.crossings), facecolors="none", edgecolors=MARKING, hatch="|||", linewidths=0.0, zorder=1.6
        )
    )
    _draw_markings(axes, network, line_width)


def lane_outline(lane: Lane) -> Points:
    """Corners of a lane's surface, shape ``(2K, 2)``: along its left border and back along the right one."""
    return np.concatenate((_border(lane, 1), _border(lane, -1)[::-1]))


def _border(lane: Lane, side: int) -> Points:
    """The left (+1) or right (−1) border of a lane; at inner points along the mean of both headings."""
    points = lane.centre.points
    headings = lane.centre.heading_rad(lane.centre.arc_m)
    before = np.concatenate((headings[:1], headings[:-1]))
    normal = np.stack((-np.sin(headings) - np.sin(before), np.cos(headings) + np.cos(before)), axis=-1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return points + side * lane.width_m / 2.0 * normal / np.maximum(length, 1e-6)


def _draw_markings(axes: Axes, network: RoadNetwork, line_width: float) -> None:
    dashed: list[Points] = []
    solid: list[Points] = []
    for edge in network.edges:
        lanes = [network.lanes[index] for index in edge.lanes if network.lanes[index].kind in _PAVED]
        if edge.internal:
            continue
        for right, left in pairwise(lanes):
            both_driven = right.kind is left.kind is LaneKind.DRIVING
            (dashed if both_driven else solid).append(_border(right, 1))
        if lanes:
            solid += [_border(lanes[0], -1), _border(lanes[-1], 1)]
    axes.add_collection(LineCollection(solid, colors=ROAD_EDGE, linewidths=line_width * 0.8, zorder=1.7))
    dashes = (0, (6, 6))
    axes.add_collection(LineCollection(dashed, colors=MARKING, linewidths=line_width, linestyles=[dashes], zorder=1.7))
