"""Moves pedestrians: they follow SUMO's pose without its jumps.

SUMO's pedestrians change stripes and corners from one step to the next, by up to a metre. People do so within a step or
two. They keep SUMO's pace, so they do not lag behind.
"""

from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled, within, wrapped_rad
from siren_ros.simulation.dynamics.tracker import SPEED
from siren_ros.simulation.dynamics.vehicle_model import ACCEL, FORWARD, LATERAL, YAW_RATE

# These are no parameters: they only smooth jumps of SUMO's model.
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
def walk(bodies: Floats, sumo: Floats, walks: Flags, step_s: float, after: Floats) -> None:
    """Move pedestrians by one step: from ``bodies`` towards ``sumo`` into ``after``.

    Bodies are ``BodyState.columns``, and ``sumo`` is ``Reference.columns``.
    """
    for k in range(len(walks)):
        if not walks[k]:
            continue
        yaw, ahead, left = bodies[YAW, k], bodies[FORWARD, k], bodies[LATERAL, k]
        vx, vy = ahead * np.cos(yaw) - left * np.sin(yaw), ahead * np.sin(yaw) + left * np.cos(yaw)
        ux, uy = sumo[SPEED, k] * np.cos(sumo[YAW, k]), sumo[SPEED, k] * np.sin(sumo[YAW, k])
        wx = ux + (sumo[X, k] - step_s * ux - bodies[X, k]) / _CATCH_UP_S
        wy = uy + (sumo[Y, k] - step_s * uy - bodies[Y, k]) / _CATCH_UP_S
        scale = min(1.0, (sumo[SPEED, k] + _FASTER_MPS) / max(np.hypot(wx, wy), 1e-9))
        dx, dy = scale * wx - vx, scale * wy - vy
        part = min(1.0, _ACCEL_MPS2 * step_s / max(np.hypot(dx, dy), 1e-9))
        vx, vy = vx + part * dx, vy + part * dy
        facing = np.arctan2(vy, vx) if np.hypot(vx, vy) > _STEADY_MPS else sumo[YAW, k]
        turn = within(wrapped_rad(facing - yaw), -_TURN_RADPS * step_s, _TURN_RADPS * step_s)
        after[:, k] = 0.0
        after[X, k], after[Y, k] = bodies[X, k] + step_s * vx, bodies[Y, k] + step_s * vy
        after[YAW, k] = wrapped_rad(yaw + turn)
        cos, sin = np.cos(after[YAW, k]), np.sin(after[YAW, k])
        after[FORWARD, k], after[LATERAL, k] = vx * cos + vy * sin, vy * cos - vx * sin
        after[YAW_RATE, k] = turn / step_s
        after[ACCEL, k] = (after[FORWARD, k] - ahead) / step_s
