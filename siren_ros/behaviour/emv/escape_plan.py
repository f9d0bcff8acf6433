"""Where a gap escape looks for its path: the road beside the route and the vehicles on it."""

import math
from typing import Final

import numpy as np

from siren_ros.behaviour.driving.free_space import Body, Obstacles
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.emv.escape_lattice import RoadSpace, Start
from siren_ros.behaviour.emv.escape_search import FoundPath, search_lattice
from siren_ros.behaviour.emv.passage import rows_around
from siren_ros.behaviour.emv.route import best_lane
from siren_ros.behaviour.paths.lane_path import LanePath, lanes_along, path_on_lanes, road_limits
from siren_ros.behaviour.paths.nearest_on_lane import nearest_on_lane
from siren_ros.numerics.arrays import Floats
from siren_ros.roads.road_network import LaneKind, RoadNetwork

_STEER_SHARE: Final = 0.85
"""Part of the steering range that an escape path may use."""
_BEHIND_M: Final = 5.0
"""The reference line begins this far behind the EMV's centre, beyond its rear axle."""


def reference_line(view: StepView, row: int, lane: int) -> LanePath:
    """The line along the lanes of the route that the search measures from."""
    config, network = view.world.config.gap_escape, view.world.network
    route = view.traffic.route_of_row(row)
    lane = best_lane(network, lane, route)
    x, y, _ = view.pose(row)
    position = nearest_on_lane(network.lanes[lane].centre, x, y)[0]
    length = config.horizon_m + 10.0
    lanes, end = lanes_along(network, lane, position, route, length)
    return path_on_lanes(network, lanes, end, position - _BEHIND_M, length)


def search_gap(reference: LanePath, view: StepView, row: int) -> FoundPath | None:
    """The best path beside a reference line that the EMV's footprint clears with a margin.

    Vehicles are swept along their motion, those that do not move in the EMV's direction for longer.

    Returns:
        The path, or None where no path is long enough to be worth driving.
    """
    config, vehicle = view.world.config.gap_escape, view.vehicle(row)
    body, rear = Body.of(view.seen, row), vehicle.centre_ahead_of_rear_axle_m
    x, y, yaw = view.pose(row)
    curve = reference.curve
    s0, left = curve.project_one(x - rear * math.cos(yaw), y - rear * math.sin(yaw))
    room = min(config.horizon_m, curve.length_m - s0 - body.half_length_m - rear)
    count = int(room / config.station_m) + 1
    if count < 3:
        return None
    turned = math.remainder(yaw - curve.place(s0)[2], 2.0 * math.pi)
    start = Start(
        left_m=left,
        slope=math.tan(max(-0.7, min(0.7, turned))),
        body=body,
        centre_ahead_m=rear,
        wheelbase_m=vehicle.wheelbase_m,
        sharpest_1pm=math.tan(_STEER_SHARE * vehicle.max_steer_rad) / vehicle.wheelbase_m,
    )
    road = road_space(view.world.network, reference, s0 + config.station_m * np.arange(count))
    return search_lattice(curve, road, start, _obstacles(view, row), config)


def _obstacles(view: StepView, row: int) -> Obstacles:
    config = view.world.config.gap_escape
    rows, along = rows_around(view, row)
    return Obstacles.swept(view.seen, rows, np.where(along, 1.0, config.oncoming_factor) * config.sweep_s)


def road_space(network: RoadNetwork, reference: LanePath, s_m: Floats) -> RoadSpace:
    """The edges of the road beside a reference line, bridged across junctions."""
    lane_of = reference.lane_at(s_m)
    edges = np.full((5, len(s_m)), np.nan)
    for lane in dict.fromkeys(lane_of.tolist()):
        found = network.lanes[lane]
        if found.kind is LaneKind.INTERNAL:
            continue
        road = road_limits(network, lane)
        middle = 0.5 * (road.driving_right_m + road.left_m)
        values = (road.right_m, road.driving_right_m, road.left_m, road.left_m + road.opposite_road_m, middle)
        edges[:, lane_of == lane] = np.array(values)[:, None]
    known = np.isfinite(edges[0])
    if not known.any():
        width = network.lanes[int(lane_of[0])].width_m
        edges[:] = np.array([-1.5, -1.5, 1.5, 1.5, 0.0])[:, None] * width
    else:
        edges = np.stack([np.interp(s_m, s_m[known], line[known]) for line in edges])
    return RoadSpace(s_m, *edges)
