"""Paths that lead smoothly from a pose onto a reference line."""

import math
from typing import Final

import numpy as np

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.paths.curve import SPACING_M, Curve
from siren_ros.behaviour.paths.lane_path import LanePath
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.numerics.arrays import Floats

_WINDING: Final = 40.0
"""Change of curvature that a blend's length is laid out for, times length³ over lateral distance."""
_STEEPEST: Final = 0.6
"""Largest tangent of the angle between the pose and the reference that a blend starts with."""
PEAK_CURVATURE: Final = 10.0 / math.sqrt(3.0)
"""Peak curvature of a quintic blend with level ends, times length² over lateral distance."""


def quintic_offsets(u: Floats, start: float, slope: float, end: float) -> Floats:
    """Lateral offsets of a blend between two straight lines; at its end it is parallel to the reference.

    Args:
        u: Place along the blend, 0–1; beyond 1 the end value.
        start: Offset at 0.
        slope: Derivative by ``u`` at 0.
        end: Offset at 1.

    Returns:
        The quintic polynomial with the given start, no second derivative at both ends and no slope at 1.
    """
    u = np.clip(u, 0.0, 1.0)
    cubic = u**3
    change = end - start
    rise = cubic * (10.0 - 15.0 * u + 6.0 * u * u)
    lead = u - cubic * (6.0 - 8.0 * u + 3.0 * u * u)
    return start + change * rise + slope * lead


def blend_length_m(
    offset_change_m: float, speed_mps: float, duration_s: float, least_m: float, config: NavigatorConfig
) -> float:
    """Length of a lateral move.

    Args:
        offset_change_m: Lateral distance.
        speed_mps: Speed during the move.
        duration_s: Time that a move over a lane's width (3.5 m) takes.
        least_m: Least length of such a move.
        config: For what the steering can follow: the curvature of a quintic changes by up to 60·d/l³ per metre at its
            ends, where the path's speed limit takes care of it, and by a third less on the way.
    """
    offset = abs(offset_change_m)
    share = math.sqrt(min(offset / 3.5, 1.0))
    steerable = (_WINDING * offset * speed_mps / config.curvature_rate_1pms) ** (1.0 / 3.0)
    return max(least_m * share, duration_s * speed_mps * share, steerable, 3.0)


def path_onto(
    reference: LanePath,
    pose: tuple[float, float, float],
    merge_m: float,
    config: NavigatorConfig,
    offset_m: float = 0.0,
    stop_at_end: bool = True,
    shorten_m: float = 0.0,
) -> TrackedPath:
    """The path from a pose onto a line beside a reference line, and along it.

    Args:
        reference: Reference line.
        pose: x, y in metres and yaw in radians, ``map`` frame.
        merge_m: Length of the lateral move.
        config: Limits for the path's speed.
        offset_m: Where to go beside the reference line, left positive.
        stop_at_end: Whether the vehicle shall stop at the path's end.
        shorten_m: Length to leave out at the end of the reference line (the front of the vehicle).
    """
    curve = reference.curve
    s0, d0 = curve.project_one(pose[0], pose[1])
    heading = float(curve.heading_at(np.array([s0]))[0])
    turned = math.remainder(pose[2] - heading, 2.0 * math.pi)
    slope = max(-_STEEPEST, min(_STEEPEST, math.tan(max(-1.0, min(1.0, turned)))))
    end_m = max(curve.length_m - shorten_m, s0 + 2.0)
    s = np.linspace(s0, end_m, max(3, math.ceil((end_m - s0) / SPACING_M) + 1))
    offsets = quintic_offsets((s - s0) / merge_m, d0, slope * merge_m, offset_m)
    path = Curve.through(curve.offset_at(s, offsets))
    return along_reference(path, reference, s, config, merge_m, stop_at_end)


def on_reference(reference: LanePath, config: NavigatorConfig, stop_at_end: bool, shorten_m: float) -> TrackedPath:
    """The reference line itself as a path, ``shorten_m`` left out at its end."""
    curve = reference.curve
    end_m = max(curve.length_m - shorten_m, 2.0)
    s = np.linspace(0.0, end_m, max(3, math.ceil(end_m / SPACING_M) + 1))
    return along_reference(Curve.through(curve.at(s)), reference, s, config, 0.0, stop_at_end)


def along_reference(
    curve: Curve, reference: LanePath, s_m: Floats, config: NavigatorConfig, settled_m: float, stop_at_end: bool
) -> TrackedPath:
    """A tracked path whose points belong to arc lengths ``s_m`` of a reference line, evenly from end to end."""
    own = np.linspace(s_m[0], s_m[-1], len(curve.points))
    return TrackedPath.of(curve, config, reference.lane_at(own), settled_m, stop_at_end)
