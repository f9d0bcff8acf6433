"""Oriented boxes one by one, for compiled loops; ``geometry.separation_m`` is for arrays of them."""

from siren_ros.numerics.compiled import compiled

Pose = tuple[float, float, float, float]
"""x and y of the centre, and the cosine and sine of the yaw."""


@compiled
def box_gap_m(a: Pose, b: Pose, a_length: float, a_width: float, b_length: float, b_width: float) -> float:
    """Largest gap along a separating axis of two boxes with half lengths and half widths (separating axis theorem).

    It is negative where they overlap, then by the depth, and else a lower bound of their distance.
    """
    dx, dy = b[0] - a[0], b[1] - a[1]
    cos, sin = abs(a[2] * b[2] + a[3] * b[3]), abs(a[2] * b[3] - a[3] * b[2])
    gap = abs(a[2] * dx + a[3] * dy) - (a_length + cos * b_length + sin * b_width)
    gap = max(gap, abs(a[2] * dy - a[3] * dx) - (a_width + sin * b_length + cos * b_width))
    gap = max(gap, abs(b[2] * dx + b[3] * dy) - (b_length + cos * a_length + sin * a_width))
    return max(gap, abs(b[2] * dy - b[3] * dx) - (b_width + sin * a_length + cos * a_width))
