"""Steering along a path: curvature feed-forward with feedback of offset and heading."""

import math

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.dynamics.parameters import VehicleParameters


def steer_along(
    path: TrackedPath,
    progress_m: float,
    left_m: float,
    yaw_rad: float,
    speed_mps: float,
    vehicle: VehicleParameters,
    config: NavigatorConfig,
) -> float:
    """Road-wheel angle that leads the footprint's centre along a path.

    The commanded curvature is ``κ − e/l² − 2ζ·sin(ψ)/l``, with the offset e, the course error ψ, the damping ratio ζ
    and a length l that grows with the speed. The course is the yaw plus the sideslip of steady cornering. The wheel
    angle is that of steady cornering, ``atan(L·κ) + K·κ·v²`` (Rajamani, "Vehicle Dynamics and Control", 2012, ch. 3).

    Args:
        path: Path of the footprint's centre.
        progress_m: Arc length of the place on the path that is nearest to the centre.
        left_m: Offset of the centre from the path, left positive.
        yaw_rad: Of the vehicle.
        speed_mps: Over ground.
        vehicle: For wheelbase, steering limit, lag and understeer.
        config: Preview and damping.

    Returns:
        Angle in radians, left positive, within the vehicle's limit.
    """
    lag_m = speed_mps * vehicle.steer_lag_s
    _, _, heading, curvature = path.curve.place(progress_m)
    _, _, _, ahead = path.curve.place(progress_m + lag_m)
    rear = vehicle.centre_ahead_of_rear_axle_m
    slip_per_accel = (
        vehicle.mass_kg * vehicle.cg_to_front_axle_m / (vehicle.wheelbase_m * vehicle.cornering_stiffness_rear_npr)
    )
    sideslip = math.atan(rear * curvature) - slip_per_accel * curvature * speed_mps**2
    course_error = _wrapped(yaw_rad + sideslip - heading)
    length = max(config.preview_min_m, config.preview_time_s * speed_mps)
    offset = max(-config.lateral_error_max_m, min(config.lateral_error_max_m, left_m))
    wanted = ahead - offset / length**2 - 2.0 * config.damping * math.sin(course_error) / length
    steer = math.atan(vehicle.wheelbase_m * wanted) + vehicle.understeer_gradient_s2pm * wanted * speed_mps**2
    return max(-vehicle.max_steer_rad, min(vehicle.max_steer_rad, steer))


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2.0 * math.pi)
