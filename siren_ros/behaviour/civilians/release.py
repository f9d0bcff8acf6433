"""The paper's release rule (Algorithm 2, "Release (both levels)"): a yield ends when the EMV has fully passed."""

import math

from siren_ros.behaviour.civilians.unit import EmvView
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.paths.nearest_on_lane import lane_heading
from siren_ros.roads.road_network import NO_LANE


def release_reason(emv: EmvView) -> str:
    """Why a civilian is released: the EMV has passed, or has left the interaction region; empty while neither holds."""
    if emv.passed:
        return "emv_passed"
    return "" if emv.in_region else "emv_gone"


def emv_fully_passed(view: StepView, row: int, emv_row: int) -> bool:
    """``EmvFullyPassed``: the EMV's rear is ahead of a vehicle's front along the vehicle's lane, by a clearance."""
    seen, traffic = view.seen, view.traffic
    x, y, heading = view.pose(row)
    lane = int(traffic.lane[row])
    if lane != NO_LANE:
        centre = view.world.network.lanes[lane].centre
        heading = lane_heading(centre, float(traffic.lane_position_m[row]))
    cos, sin = math.cos(heading), math.sin(heading)
    ahead = cos * (float(seen.x_m[emv_row]) - x) + sin * (float(seen.y_m[emv_row]) - y)
    turned = float(seen.yaw_rad[emv_row]) - heading
    rear = abs(math.cos(turned)) * float(seen.half_length_m[emv_row])
    rear += abs(math.sin(turned)) * float(seen.half_width_m[emv_row])
    own = float(seen.half_length_m[row])
    return ahead - rear - own >= view.world.constants.emv_passed_clearance_m
