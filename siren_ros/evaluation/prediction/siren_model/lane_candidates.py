"""Lanes that a vehicle may be in, from its pose alone: an observer does not know which one it drives along."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Floats, Rows
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.roads.road_network import LaneKind, RoadNetwork
from siren_ros.world.traffic_state import Indices

_DRIVEN_KINDS: Final = frozenset({LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL})
_MARGIN_M: Final = 1.5
"""A vehicle that has pulled over may stand this far outside its lane."""
_END_MARGIN_M: Final = 0.5
_TURNED_MAX_RAD: Final = np.pi / 3.0
_OFFSET_COST_PER_M: Final = 1.0
_HEADING_COST_PER_RAD: Final = 3.0


@dataclass(frozen=True)
class LaneCandidates:
    """C pairs of a vehicle and a lane that it may be in, sorted by vehicle; arrays of shape ``(C,)``."""

    row: Rows
    """Number of the pose."""
    lane: Indices
    arc_m: Floats
    """Of the footprint's centre along the lane."""
    offset_m: Floats
    """Of the centre from the lane's centre line, left positive."""
    turned_rad: Floats
    """Heading of the vehicle minus that of the lane."""
    cost: Floats
    """Grows with offset and angle: the likeliest lane has the least."""


def lane_candidates(network: RoadNetwork, xy_m: Floats, yaw_rad: Floats) -> LaneCandidates:
    """All lanes that hold a pose or pass it closely, and run within 60° of its heading.

    Args:
        network: The map.
        xy_m: Footprint centres, shape ``(M, 2)``.
        yaw_rad: Headings, shape ``(M,)``.
    """
    found: list[tuple[Rows, Floats, Floats, Floats]] = []
    lanes: list[int] = []
    if len(xy_m):
        low, high = xy_m.min(axis=0), xy_m.max(axis=0)
    for lane in network.lanes if len(xy_m) else ():
        reach = 0.5 * lane.width_m + _MARGIN_M
        corner_low, corner_high = lane.centre.points.min(axis=0) - reach, lane.centre.points.max(axis=0) + reach
        if lane.kind not in _DRIVEN_KINDS or (corner_low > high).any() or (corner_high < low).any():
            continue
        near = np.flatnonzero(((xy_m >= corner_low) & (xy_m <= corner_high)).all(axis=1))
        if len(near) == 0:
            continue
        arc, left = lane.centre.project(xy_m[near])
        turned = wrap_angle(yaw_rad[near] - lane.centre.heading_rad(arc))
        fits = (np.abs(left) <= reach) & (np.abs(turned) <= _TURNED_MAX_RAD)
        fits &= (arc >= -_END_MARGIN_M) & (arc <= lane.length_m + _END_MARGIN_M)
        found.append((near[fits], arc[fits], left[fits], turned[fits]))
        lanes.append(lane.index)
    if not found:
        nothing = np.empty(0)
        return LaneCandidates(
            np.empty(0, dtype=np.intp), np.empty(0, dtype=np.int32), nothing, nothing, nothing, nothing
        )
    row, arc, left, turned = (np.concatenate(parts) for parts in zip(*found, strict=True))
    lane_of = np.repeat(np.array(lanes, dtype=np.int32), [len(part[0]) for part in found])
    cost = _OFFSET_COST_PER_M * np.abs(left) + _HEADING_COST_PER_RAD * np.abs(turned)
    order = np.lexsort((cost, row))
    return LaneCandidates(row[order], lane_of[order], arc[order], left[order], turned[order], cost[order])
