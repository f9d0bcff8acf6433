"""Bounds of the checks of a recorded episode, each with its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class VerifyLimits:
    """Bounds of the checks."""

    jump_m: float = 0.05
    """Position change between two steps beyond ``v · dt``."""
    turn_rad: float = 0.01
    """Yaw change between two steps beyond the limits of steering and grip."""
    steer_max_rad: float = 0.7
    """Largest road-wheel angle of any class (40°)."""
    wheelbase_share: float = 0.5
    """Smallest wheelbase of any class as a share of its length: that of buses and fire engines."""
    lateral_accel_mps2: float = 12.0
    """Dry tyres give 1 g, plus a margin for the transient."""
    speed_error_mps: float = 0.5
    """Between the mean velocity of two steps and the position change between them."""
    residual_p99_m: float = 0.5
    residual_max_m: float = 2.0
    overlap_m: float = 0.3
    """Of two footprints: bodies do not pass through each other; real ones crumple by as much at walking speed."""
    impact_speed_mps: float = 2.0
    """With drivers of the paper, who all react: touches of manoeuvring at most."""
    comfort_lateral_mps2: float = 4.0
    """Everybody's, 99.9th percentile: what drivers use in urban bends at most (Hugemann and Nickel, "Longitudinal and
    lateral accelerations in normal day driving", ITAI 2003)."""
    emv_brake_mps2: float = 4.0
    """An EMV's, 1st percentile: what an anticipating driver brakes with (same source, urban roads)."""
    emv_accel_mps2: float = 2.5
    """An EMV's, 99th percentile: a brisk start of a van (same source)."""
