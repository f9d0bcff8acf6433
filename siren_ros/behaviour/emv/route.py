"""Next-link route following of the emergency vehicle: its path along the route and the lanes it needs."""

import math
from dataclasses import dataclass
from typing import Final

from siren_ros.behaviour.driving.navigator import NavigatorState
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.paths.lane_path import (
    LaneEnd,
    changes_needed,
    lanes_along,
    path_on_lanes,
)
from siren_ros.behaviour.paths.nearest_on_lane import nearest_on_lane
from siren_ros.behaviour.paths.path_blend import blend_length_m, on_reference, path_onto
from siren_ros.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.world.traffic_state import Indices

_ALIGNED_RAD: Final = 0.3
"""Heading errors below it are left to the path tracking."""


@dataclass(frozen=True)
class RoutePlan:
    """The lanes that the present path follows."""

    edges: tuple[int, ...]
    """Edges of the path in order, without internal ones."""
    end: LaneEnd
    planned_step: int

    def agrees_with(self, route: Indices) -> bool:
        """Whether the path still follows the route."""
        ahead = tuple(route.tolist())
        if ahead and ahead[0] not in self.edges:  # on the junction after the first edge
            ahead = ahead[1:]
        if not ahead or ahead[0] not in self.edges:
            return False
        rest = self.edges[self.edges.index(ahead[0]) :]
        common = min(len(rest), len(ahead))
        return rest[:common] == ahead[:common]


def plan_route(
    view: StepView, row: int, lane: int, navigator: NavigatorState, merge_m: float | None = None
) -> tuple[RoutePlan, NavigatorState]:
    """A new path along the route from a lane on.

    Args:
        view: The step.
        row: The EMV's row.
        lane: Lane to follow, internal ones included.
        navigator: State whose path is replaced.
        merge_m: Length of the move onto the lane; chosen by offset and speed by default.
    """
    network, config = view.world.network, view.world.config.emv
    x, y, yaw = view.pose(row)
    position = nearest_on_lane(network.lanes[lane].centre, x, y)[0]
    route = view.traffic.route_of_row(row)
    lanes, end = lanes_along(network, lane, position, route, config.path_ahead_m)
    reference = path_on_lanes(
        network, lanes, end, position - config.path_behind_m, config.path_ahead_m + config.path_behind_m
    )
    half_length = float(view.seen.half_length_m[row])
    shorten = {
        LaneEnd.ROUTE: config.stop_before_route_end_m + half_length,
        LaneEnd.ASTRAY: half_length + 1.0,
    }.get(reference.end, 0.0)
    stop = reference.end is not LaneEnd.HORIZON
    navigator_config = view.navigator_config(row)
    s, left = reference.curve.project_one(x, y)
    aligned = abs(math.remainder(yaw - reference.curve.place(s)[2], 2.0 * math.pi)) < _ALIGNED_RAD
    if merge_m is None and abs(left) < config.rejoin_offset_m and aligned:
        path = on_reference(reference, navigator_config, stop, shorten)
    else:
        speed = float(view.seen.speed_mps[row])
        change = view.world.config.lane_change
        length = merge_m
        if length is None:
            length = blend_length_m(left, speed, change.duration_s, change.length_min_m, navigator_config)
        path = path_onto(reference, (x, y, yaw), length, navigator_config, stop_at_end=stop, shorten_m=shorten)
    edges = tuple(network.lanes[item].edge for item in lanes if not network.edges[network.lanes[item].edge].internal)
    return RoutePlan(_without_repeats(edges), reference.end, view.step), navigator.following(path, x, y)


def _without_repeats(edges: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(edge for i, edge in enumerate(edges) if i == 0 or edges[i - 1] != edge)


def strategic_side(network: RoadNetwork, lane: int, route: Indices) -> int:
    """Side to which a vehicle must change lanes to follow its route: +1 left, −1 right, 0 if not on this edge."""
    found = network.lanes[lane]
    if len(route) == 0 or found.edge != int(route[0]):
        return 0
    needed = changes_needed(network, route, civilian=False)[0]
    if not needed:
        return 0
    position = {item: network.lanes[item].position for item in needed}
    best = min(needed, key=lambda item: (needed[item], abs(position[item] - found.position), position[item]))
    if lane in needed and needed[lane] <= needed[best]:
        return 0
    return 1 if position[best] > found.position else -1


def present_lane(view: StepView, row: int, navigator: NavigatorState) -> int:
    """The lane that the EMV is on: that of its path if it follows the route, otherwise SUMO's."""
    if navigator.path is not None:
        lane = navigator.path.lane_at(navigator.progress_m)
        if lane != NO_LANE:
            found = view.world.network.lanes[lane]
            if found.kind is LaneKind.INTERNAL or found.edge in view.traffic.route_of_row(row):
                return lane
    return int(view.traffic.lane[row])


def best_lane(network: RoadNetwork, lane: int, route: Indices) -> int:
    """The lane of the present edge that serves the route best, the nearest of equals; an internal lane itself."""
    found = network.lanes[lane]
    if len(route) == 0 or found.edge != int(route[0]):
        return lane
    needed = changes_needed(network, route, civilian=False)[0]
    if not needed or needed.get(lane) == min(needed.values()):
        return lane
    return min(needed, key=lambda item: (needed[item], abs(network.lanes[item].position - found.position)))
