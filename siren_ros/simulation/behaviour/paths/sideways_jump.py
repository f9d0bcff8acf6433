"""Smooths lines along lanes that begin with a lateral jump: the line moves sideways gently, as drivers do."""

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.geometry import Polyline, wrap_angle

# These are no parameters: limits between a fault of the map's geometry and a bend of the road.
_HALF_BLEND_M = 15.0
"""Distance before and after a jump over which the line moves: for 1.75 m (half a lane) 2.3 m/s² at 50 km/h."""
_MOST_M = 2.5
"""Larger lateral moves are bends."""
_PARALLEL_RAD = 0.15
"""The road's directions before and after a jump differ by at most this."""
_SWERVE_RAD = 0.2
"""Lines that turn by less than this have no jump."""


def without_jumps(line: Polyline, starts_m: Floats) -> tuple[Polyline, Floats]:
    """A line along consecutive lanes without lateral jumps, and the arc lengths at which the lanes then begin.

    ``starts_m`` are those on the given line, shape ``(L,)``.
    """
    for number in range(1, len(starts_m)):
        from_m = max(float(starts_m[number]) - _HALF_BLEND_M, 0.0)
        to_m = min(float(starts_m[number]) + _HALF_BLEND_M, line.length_m)
        if _jumps(line, from_m, to_m):
            between = _moved_over(line, from_m, to_m)
            before, after = line.points[line.arc_m < from_m - 1e-6], line.points[line.arc_m > to_m + 1e-6]
            blended = Polyline.through(np.concatenate((before, between, after)))
            whole_m = to_m - from_m
            share = np.clip((starts_m - from_m) / whole_m, 0.0, 1.0)
            starts_m = starts_m + share * (blended.length_m - line.length_m)
            line = blended
    return line, starts_m


def _jumps(line: Polyline, from_m: float, to_m: float) -> bool:
    if to_m - from_m < 2.0:
        return False
    turned = wrap_angle(line.heading_rad(np.arange(from_m, to_m, 0.25)) - line.heading_rad(from_m))
    first, last = line.at(np.array([from_m, to_m - 1e-6]))
    heading = float(line.heading_rad(from_m))
    aside_m = abs(np.cos(heading) * (last - first)[1] - np.sin(heading) * (last - first)[0])
    along = np.abs(turned[-1]) < _PARALLEL_RAD and aside_m < _MOST_M
    return bool(along and np.abs(turned).max() > _SWERVE_RAD)


def _moved_over(line: Polyline, from_m: float, to_m: float) -> Points:
    """Points of the cubic curve between two places of a line, with the line's directions there."""
    ends_m = np.array([from_m, to_m - 1e-6])
    (first, last), headings = line.at(ends_m), line.heading_rad(ends_m)
    way_m = float(np.linalg.norm(last - first))
    start, end = (way_m * np.array([np.cos(heading), np.sin(heading)]) for heading in headings)
    u = np.linspace(0.0, 1.0, max(int(way_m), 2) + 1)[:, None]
    lead, rise = u * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u)
    return np.asarray(first + rise * (last - first) + lead * start - u * u * (1.0 - u) * end)
