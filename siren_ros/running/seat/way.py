"""The path of the driven vehicle with the road along it: edges, junctions, and lines with signals."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.data.record.vehicle_location import locate
from siren_ros.running.seat.lanes import LanesBeside
from siren_ros.simulation.behaviour.paths.lane_path import road_limits
from siren_ros.simulation.roads.rescue_lane import rescue_sides
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import is_leftmost_of_several
from siren_ros.simulation.world.traffic_state import Indices

SPACING_M: Final = 1.0
_JUMP_M: Final = 1.0
_DRIFT: Final = 0.02
"""Lateral drift per metre above which the path is changing lanes."""


@dataclass(frozen=True)
class Line:
    """A stop line on the path."""

    at_m: float
    """Arc length on the path."""
    connection: Connection


@dataclass(frozen=True)
class Way:
    """A path along lane centres; columns have shape ``(K,)``, one value per metre."""

    curve: Polyline
    lane: Indices
    """Index of the lane or of the path across a junction; ``NO_LANE`` off the lanes."""
    right_m: Floats
    """Offset of the road's right edge, positive to the left."""
    driving_right_m: Floats
    """Offset of the right edge of the driving lanes, without shoulder."""
    lane_right_m: Floats
    """Offset of the lane's right edge."""
    lane_left_m: Floats
    """Offset of the lane's left edge."""
    leftmost: Flags
    """Whether the lane is the leftmost of several."""
    in_junction: Flags
    limit_mps: Floats
    """Speed limit of the lane."""
    changes: Floats
    """+1 where the path changes to the left lane, −1 to the right lane, 0 elsewhere."""
    duty: Flags
    """Whether slow traffic must keep a corridor open between the lanes before any siren (Germany's rescue lane)."""
    lines: tuple[Line, ...]
    """Stop lines in the order along the path."""
    lanes: LanesBeside

    @classmethod
    def of(cls, network: RoadNetwork, curve: Polyline) -> Self:
        """The path along a curve on a map with right-hand traffic."""
        s_m = np.arange(0.0, curve.length_m + SPACING_M, SPACING_M)
        points, heading = curve.at(s_m), curve.heading_rad(s_m)
        places = locate(network, points, np.asarray(heading), np.full(len(s_m), NO_LANE, np.int32))
        right, limit = np.full(len(s_m), -1.75), np.full(len(s_m), np.nan)
        driving_right, lane_right, lane_left = (
            np.full(len(s_m), -1.75),
            np.full(len(s_m), -1.75),
            np.full(len(s_m), 1.75),
        )
        leftmost, inside, duty = (np.zeros(len(s_m), np.bool_) for _ in range(3))
        rescue = rescue_sides(network)
        for row, lane_index in enumerate(places.lane.tolist()):
            if lane_index == NO_LANE:
                continue
            lane = network.lanes[lane_index]
            duty[row] = rescue[lane_index] != 0
            inside[row], limit[row] = lane.kind is LaneKind.INTERNAL, lane.speed_limit_mps
            limits = road_limits(network, lane_index)
            right[row], driving_right[row] = (
                edge - float(places.offset_m[row]) for edge in (limits.right_m, limits.driving_right_m)
            )
            lane_right[row] = -0.5 * lane.width_m - float(places.offset_m[row])
            lane_left[row] = 0.5 * lane.width_m - float(places.offset_m[row])
            leftmost[row] = is_leftmost_of_several(network, lane_index)
        drift = np.diff(places.offset_m, append=places.offset_m[-1:])
        drift[~np.isfinite(drift) | (np.abs(drift) > _JUMP_M) | inside] = 0.0  # a jump means another lane, not a drift
        changes = np.where(np.abs(drift) > _DRIFT, np.sign(drift), 0.0)
        known = np.isfinite(limit)
        limit = np.interp(s_m, s_m[known], limit[known]) if known.any() else np.full(len(s_m), 8.0)
        edges = right, driving_right, lane_right, lane_left
        lines = tuple(_lines(network, s_m, places.lane.tolist()))
        lanes = LanesBeside.of(network, places.lane)
        return cls(curve, places.lane, *edges, leftmost, inside, limit, changes, duty, lines, lanes)

    def row(self, s_m: float) -> int:
        """Row of an arc length."""
        return int(min(max(round(s_m / SPACING_M), 0), len(self.right_m) - 1))


def _lines(network: RoadNetwork, s_m: Floats, lanes: list[int]) -> list[Line]:
    """Stop lines where the path leaves a lane for a path across a junction."""
    found, before = [], NO_LANE
    for at_m, lane in zip(s_m.tolist(), lanes, strict=True):
        if lane in {before, NO_LANE}:
            continue
        if before != NO_LANE and network.lanes[before].kind is not LaneKind.INTERNAL:
            onward = [one for one in network.connections_from.get(before, ()) if lane in {*one.via, one.to_lane}]
            found += [Line(at_m, one) for one in onward[:1]]
        before = lane
    return found
