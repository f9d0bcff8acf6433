"""Forced lane changes of controlled vehicles: feasibility, path, and end."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.braking import braking_distance_m
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled
from siren_ros.base.numerics.geometry import project_on
from siren_ros.simulation.behaviour.driving.step_view import SEEN_HALF_LENGTH, SEEN_HALF_WIDTH, Ego
from siren_ros.simulation.behaviour.paths.lane_path import LaneEnd, LanePath, nearest_on_line, neighbour_lane
from siren_ros.simulation.behaviour.paths.tracked_path import PEAK_CURVATURE, TrackedPath, blend_length_m, path_onto
from siren_ros.simulation.roads.movements import road_lane_of
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind
from siren_ros.simulation.scenario.driver_parameters import LaneChangeConfig
from siren_ros.simulation.world.actors import NO_ACTOR


class Refusal(StrEnum):
    """Reason why a lane change is not feasible at a step."""

    NO_LANE = "no_lane"
    JUNCTION = "junction"
    NO_ROOM = "no_room"
    ASTRAY = "leads_astray"
    BESIDE = "vehicle_beside"
    GAP_FRONT = "gap_front"
    GAP_REAR = "gap_rear"
    TURNING = "turning"
    """The vehicle is still turning onto its road."""


_EASED_OFF: Final = 0.75
"""Mean share of the present speed during a change, if the target speed is lower."""
_SPEED_UP_MPS: Final = 2.5
"""Gain of speed for which the length of a lane change is planned."""
_STEER_SHARE: Final = 0.7
"""Share of the steering range that a lane change may use."""


@dataclass(frozen=True, eq=False)
class LaneChangeQuery:
    """A possible lane change of a vehicle."""

    ego: Ego
    lane: int
    """Present lane."""
    side: int
    """+1 left, −1 right."""
    target_mps: float
    """Speed of the vehicle during the change."""
    civilian: bool
    ends_on_junction: bool = False
    """Whether the change may end on the next junction."""

    @property
    def config(self) -> LaneChangeConfig:
        """Parameters of lane changes, for EMVs or civilians."""
        return self.ego.civilian_driver.lane_change if self.civilian else self.ego.emv_driver.lane_change

    @property
    def target(self) -> int:
        """The lane to change to; ``NO_LANE`` without one."""
        return neighbour_lane(self.ego.network, self.lane, self.side)

    @property
    def length_m(self) -> float:
        """Length of a lane change that starts now, from its duration at the present speed and the steering's limits."""
        config, ego = self.config, self.ego
        sharpest = math.tan(_STEER_SHARE * ego.vehicle.max_steer_rad) / ego.vehicle.wheelbase_m
        width, speed = ego.network.lanes[self.lane].width_m, ego.speed_mps
        on_the_way = max(min(self.target_mps, speed + _SPEED_UP_MPS), _EASED_OFF * speed)
        limits = config.duration_s, config.length_min_m
        steerable = blend_length_m(width, on_the_way, *limits, ego.navigator_config)
        sharp = math.sqrt(PEAK_CURVATURE * width / sharpest)
        return max(config.length_min_m, sharp, config.duration_s * speed, steerable)


class LaneGaps(NamedTuple):
    """Free distances to the vehicles in a lane, bumper to bumper; infinite if there is none."""

    front_m: float
    front_mps: float
    rear_m: float
    rear_mps: float
    front_id: int = NO_ACTOR
    """Id of the vehicle ahead."""


_GAP_RANGE_M: Final = 60.0
"""Vehicles in a lane are considered within this distance."""


def gaps_in_lane(ego: Ego, lane: int) -> LaneGaps:
    """Gaps of a vehicle to those ahead and behind in any lane; negative next to one."""
    centre, seen = ego.network.lanes[lane].centre, ego.seen
    front, rear, *gaps = _gaps(centre.points, centre.arc_m, seen.bodies, ego.row, _GAP_RANGE_M)
    if front < 0:
        return LaneGaps(math.inf, 0.0, math.inf, 0.0)
    front_id = int(seen.actor_id[front]) if gaps[0] < math.inf else NO_ACTOR
    return LaneGaps(gaps[0], float(seen.speed_mps[front]), gaps[1], float(seen.speed_mps[rear]), front_id)


@compiled
def _gaps(points: Points, arc_m: Floats, bodies: Floats, row: int, range_m: float) -> tuple[int, int, float, float]:
    """Rows of the vehicles ahead and behind in a lane (−1 if there is none), and the gaps."""
    x_m, y_m = bodies[X, row], bodies[Y, row]
    half_length_m, half_width_m = bodies[SEEN_HALF_LENGTH, row], bodies[SEEN_HALF_WIDTH, row]
    own_s_m, _, heading = nearest_on_line(points, arc_m, x_m, y_m)
    front, rear, front_m, rear_m = -1, -1, np.inf, np.inf
    for other in range(bodies.shape[1]):
        dx, dy = bodies[X, other] - x_m, bodies[Y, other] - y_m
        if other == row or dx * dx + dy * dy >= range_m * range_m:
            continue
        turned = bodies[YAW, other] - heading
        cos, sin = abs(np.cos(turned)), abs(np.sin(turned))
        s_m, left_m = project_on(points, arc_m, bodies[X, other], bodies[Y, other])
        side = cos * bodies[SEEN_HALF_WIDTH, other] + sin * bodies[SEEN_HALF_LENGTH, other]
        if abs(left_m) - side >= half_width_m + 0.1 or cos <= 0.5:
            continue
        if front < 0:
            front = rear = other
        gap = abs(s_m - own_s_m) - bodies[SEEN_HALF_LENGTH, other] - half_length_m
        if s_m >= own_s_m and gap < front_m:
            front, front_m = other, gap
        if s_m < own_s_m and gap < rear_m:
            rear, rear_m = other, gap
    return front, rear, front_m, rear_m


def refusal_of_gaps(gaps: LaneGaps, speed_mps: float, target_mps: float, config: LaneChangeConfig) -> Refusal | None:
    """Reason why a gap cannot be entered; None if it can.

    The gaps must last for the whole manoeuvre. The vehicle slows to its target speed, if that is lower. The vehicle
    behind it brakes too, after a reaction time. Towards the vehicle ahead it brakes in the same way.
    """
    if min(gaps.front_m, gaps.rear_m) <= 0.0:
        return Refusal.BESIDE
    closing = max(speed_mps - gaps.front_mps, 0.0)
    way = closing * config.front_time_s + braking_distance_m(closing**2, config.front_brake_mps2)
    if gaps.front_m < config.front_gap_m + way:
        return Refusal.GAP_FRONT
    slowest = min(speed_mps, target_mps)
    closing = max(gaps.rear_mps - slowest, 0.0)
    way = closing * config.rear_time_s + braking_distance_m(closing**2, config.brake_mps2)
    way -= braking_distance_m((speed_mps - slowest) ** 2, config.own_brake_mps2)
    return Refusal.GAP_REAR if gaps.rear_m < config.rear_gap_m + max(way, 0.0) else None


_RETURN_ROOM_M: Final = 60.0
"""Length of lane needed after the change, if the target lane does not follow the route."""


def assess(query: LaneChangeQuery) -> Refusal | LanePath:
    """Reference line in the target lane of a lane change, or the reason why it is not feasible now.

    A lane change does not start on a junction, and ends before the next one unless the query says otherwise. Civilians
    use driving lanes only. A lane that does not follow the route is accepted if enough of it is left to come back.
    """
    ego, config, target = query.ego, query.config, query.target
    if road_lane_of(ego.network, query.lane) == NO_LANE:
        return Refusal.JUNCTION
    road = road_lane_of(ego.network, target)
    lane = None if road == NO_LANE else ego.network.lanes[road]
    driving = lane is not None and lane.civilian_allowed and lane.kind is LaneKind.DRIVING
    if lane is None or not (driving if query.civilian else lane.emergency_allowed):
        return Refusal.NO_LANE
    if refusal := refusal_of_gaps(gaps_in_lane(ego, target), ego.speed_mps, query.target_mps, config):
        return refusal
    ahead = query.length_m + _RETURN_ROOM_M + 30.0
    reference = ego.line_along(target, ahead, civilian=query.civilian, through_junctions=query.ends_on_junction)
    room = reference.curve.length_m - ego.half_length_m
    if room < query.length_m:
        return Refusal.NO_ROOM
    if reference.end is LaneEnd.ASTRAY and room < query.length_m + _RETURN_ROOM_M:
        return Refusal.ASTRAY
    return reference


def lane_change_path(query: LaneChangeQuery, reference: LanePath, stop_at_end: bool) -> TrackedPath:
    """``BuildLaneChangeWaypoints``: path from the present pose into the target lane and along it."""
    ego, shorten_m = query.ego, query.ego.half_length_m + 1.0 if stop_at_end else 0.0
    return path_onto(reference, ego.pose, query.length_m, ego.navigator_config, 0.0, stop_at_end, shorten_m)


_ENTERED_TOLERANCE_M: Final = 0.15
"""Amount by which the footprint may reach over the lane's edge and still count as inside."""


def entered_lane(ego: Ego, lane: int) -> bool:
    """Whether a vehicle's whole footprint is in a lane with the lane's heading (``HeadingAligned``)."""
    offset, turned = offset_in_lane(ego, lane)
    if abs(turned) > ego.world.constants.heading_aligned_rad:
        return False
    side = ego.half_width_m * math.cos(turned) + ego.half_length_m * abs(math.sin(turned))
    room = max(0.5 * ego.network.lanes[lane].width_m - side, 0.1) + _ENTERED_TOLERANCE_M
    return abs(offset) <= room


def offset_in_lane(ego: Ego, lane: int) -> tuple[float, float]:
    """Offset of a vehicle's centre from a lane's centre line (left positive) and its heading relative to the lane."""
    _, left, heading = ego.place_on(lane)
    return left, math.remainder(ego.pose[2] - heading, 2.0 * math.pi)
