"""The way of the vehicle with the seat, with the road beside it: edges, junctions and lines with signals."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from siren_ros.behaviour.paths.lane_path import road_limits
from siren_ros.numerics.arrays import Flags, Floats
from siren_ros.numerics.geometry import Polyline
from siren_ros.record.vehicle_location import locate
from siren_ros.roads.road_network import NO_LANE, Connection, LaneKind, RoadNetwork

SPACING_M: Final = 1.0


@dataclass(frozen=True)
class Line:
    """A stop line on the way."""

    at_m: float
    """Arc length on the way."""
    connection: Connection


@dataclass(frozen=True)
class Way:
    """A way along lane centres; columns have shape ``(K,)``, one value for each metre of it."""

    curve: Polyline
    right_m: Floats
    """Offset of the road's right edge, left positive."""
    leftmost: Flags
    """Whether the lane is the leftmost of several."""
    in_junction: Flags
    limit_mps: Floats
    """Speed limit of the lane."""
    lines: tuple[Line, ...]
    """In the order in which they come."""

    @classmethod
    def of(cls, network: RoadNetwork, curve: Polyline) -> Self:
        """The way along a curve on a map where traffic keeps right."""
        s_m = np.arange(0.0, curve.length_m + SPACING_M, SPACING_M)
        points, heading = curve.at(s_m), curve.heading_rad(s_m)
        places = locate(network, points, np.asarray(heading), np.full(len(s_m), NO_LANE, np.int32))
        right, limit = np.full(len(s_m), -1.75), np.full(len(s_m), np.nan)
        leftmost, inside = np.zeros(len(s_m), np.bool_), np.zeros(len(s_m), np.bool_)
        for row, lane_index in enumerate(places.lane.tolist()):
            if lane_index == NO_LANE:
                continue
            lane = network.lanes[lane_index]
            inside[row], limit[row] = lane.kind is LaneKind.INTERNAL, lane.speed_limit_mps
            right[row] = road_limits(network, lane_index).right_m - float(places.offset_m[row])
            driving = [k for k in network.edges[lane.edge].lanes if network.lanes[k].kind is LaneKind.DRIVING]
            leftmost[row] = len(driving) > 1 and driving[-1] == lane_index
        known = np.isfinite(limit)
        limit = np.interp(s_m, s_m[known], limit[known]) if known.any() else np.full(len(s_m), 8.0)
        return cls(curve, right, leftmost, inside, limit, tuple(_lines(network, s_m, places.lane.tolist())))

    def row(self, s_m: float) -> int:
        """The row of an arc length."""
        return int(min(max(round(s_m / SPACING_M), 0), len(self.right_m) - 1))


def _lines(network: RoadNetwork, s_m: Floats, lanes: list[int]) -> list[Line]:
    """Where the way leaves a lane for a path across a junction."""
    found, before = [], NO_LANE
    for at_m, lane in zip(s_m.tolist(), lanes, strict=True):
        if lane in {before, NO_LANE}:
            continue
        if before != NO_LANE and network.lanes[before].kind is not LaneKind.INTERNAL:
            onward = [one for one in network.connections_from.get(before, ()) if lane in {*one.via, one.to_lane}]
            found += [Line(at_m, one) for one in onward[:1]]
        before = lane
    return found
