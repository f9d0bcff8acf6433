"""Moves pedestrians: they follow SUMO's pose without its jumps.

SUMO's pedestrians change stripes and corners from one step to the next, by up to a metre. People do so within a step or
two. They keep SUMO's pace, so they do not lag behind.
"""

from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.compiled import compiled, within, wrapped_rad

# No parameters: they only smooth jumps of SUMO's model.
_CATCH_UP_S: Final = 0.5
"""Time in which the distance from SUMO's position is corrected."""
_FASTER_MPS: Final = 0.8
"""Largest additional speed for this correction."""
_ACCEL_MPS2: Final = 2.5
"""Acceleration with which people start, stop and step aside (typical value of healthy adults)."""
_TURN_RADPS: Final = 4.0
_STEADY_MPS: Final = 0.4
"""Slower people have SUMO's heading; faster ones that of their motion."""


@compiled
def walk(bodies: Any, sumo: Any, walks: Any, step_s: float, after: Any) -> None:
    """Move pedestrians by one step: from ``bodies`` towards SUMO's x, y, yaw and speed into ``after``.

    Bodies have the columns of ``BodyState``: pose, speed ahead and to the left, turn rate and accelerations first.
    """
    for k in range(len(walks)):
        if not walks[k]:
            continue
        yaw, ahead, left = bodies[2, k], bodies[3, k], bodies[4, k]
        vx, vy = ahead * np.cos(yaw) - left * np.sin(yaw), ahead * np.sin(yaw) + left * np.cos(yaw)
        ux, uy = sumo[3, k] * np.cos(sumo[2, k]), sumo[3, k] * np.sin(sumo[2, k])
        wx = ux + (sumo[0, k] - step_s * ux - bodies[0, k]) / _CATCH_UP_S
        wy = uy + (sumo[1, k] - step_s * uy - bodies[1, k]) / _CATCH_UP_S
        scale = min(1.0, (sumo[3, k] + _FASTER_MPS) / max(np.hypot(wx, wy), 1e-9))
        dx, dy = scale * wx - vx, scale * wy - vy
        part = min(1.0, _ACCEL_MPS2 * step_s / max(np.hypot(dx, dy), 1e-9))
        vx, vy = vx + part * dx, vy + part * dy
        facing = np.arctan2(vy, vx) if np.hypot(vx, vy) > _STEADY_MPS else sumo[2, k]
        turn = within(wrapped_rad(facing - yaw), -_TURN_RADPS * step_s, _TURN_RADPS * step_s)
        after[:, k] = 0.0
        after[0, k], after[1, k] = bodies[0, k] + step_s * vx, bodies[1, k] + step_s * vy
        after[2, k] = wrapped_rad(yaw + turn)
        cos, sin = np.cos(after[2, k]), np.sin(after[2, k])
        after[3, k], after[4, k], after[5, k] = vx * cos + vy * sin, vy * cos - vx * sin, turn / step_s
        after[6, k] = (after[3, k] - ahead) / step_s
