"""Computes pedals and steering from a target speed and a target offset."""

import math
from typing import Final

from siren_ros.running.seat.sight import Sight
from siren_ros.simulation.world.actors import Lights
from siren_ros.simulation.world.commands import AvControl

_WHEELBASE_M: Final = 2.7
_FULL_BRAKE_MPS2: Final = 9.0
_LARGEST_STEER_RAD: Final = 0.6
_LEAST_REACH_M: Final = 6.0
_PUSHES_PER_S: Final = 1.2
"""Acceleration per m/s of missing speed."""
_BRAKES_PER_S: Final = 3.0
"""Deceleration per m/s of excess speed; it is higher, so that drivers do not cross a line."""


def steered(
    sight: Sight,
    wanted_mps: float,
    offset_m: float,
    lights: int = int(Lights.NONE),
    hardest_mps2: float = 3.5,
) -> AvControl:
    """Control for a step: proportional speed control, and steering by pure pursuit of the path.

    Args:
        sight: The step.
        wanted_mps: Speed to come to.
        offset_m: Place across the way to come to, left positive.
        lights: Indicators.
        hardest_mps2: Limit of braking.
    """
    missing_mps = wanted_mps - sight.speed_mps
    push = (_BRAKES_PER_S if missing_mps < 0.0 else _PUSHES_PER_S) * missing_mps
    brake = min(max(-push, 0.0), hardest_mps2) / _FULL_BRAKE_MPS2
    if wanted_mps < 0.05 and sight.speed_mps < 0.3:
        brake = 0.3
    throttle = 0.0 if brake else min(max(0.3 * push, 0.0), 0.7)
    curve, reach_m = sight.way.curve, max(_LEAST_REACH_M, sight.speed_mps)
    target = curve.offset_points(sight.s_m + reach_m, offset_m)
    here = curve.offset_points(sight.s_m, sight.left_m)
    yaw = float(curve.heading_rad(sight.s_m)) + sight.turn_rad
    dx, dy = float(target[0] - here[0]), float(target[1] - here[1])
    side = math.cos(yaw) * dy - math.sin(yaw) * dx
    steer = math.atan(2.0 * _WHEELBASE_M * side / max(dx * dx + dy * dy, 1.0))
    return AvControl(sight.step, throttle, brake, min(max(steer, -_LARGEST_STEER_RAD), _LARGEST_STEER_RAD), lights)
