"""Newton's equations of the single-track model, substep by substep: the loop over vehicles, compiled."""

from typing import Any, Final, NamedTuple

import numpy as np

from siren_ros.world.compiled import compiled

Array = Any
"""A numpy array of float64."""
_FULL_PULL_MPS: Final = 0.1
"""Below this speed the sideways pull of a steered and braked wheel fades: static friction balances it at rest."""
_STILL: Final = 0.01
"""A vehicle that stopped rolling and drifts or turns slower than this (m/s, rad/s) stands still."""
_SLOWEST_MPS: Final = 1e-9
"""Keeps slip defined at standstill; far below any speed that matters."""


class Axles(NamedTuple):
    """What the equations need to know of each vehicle, shape ``(N,)``."""

    mass_rate: Array
    """Mass over the substep, kg/s."""
    inertia_rate: Array
    """Yaw inertia over the substep, kg m²/s."""
    front_arm_m: Array
    """Of the front axle ahead of the centre of gravity."""
    rear_arm_m: Array
    """Of the rear axle; negative."""
    front_stiffness: Array
    """Cornering stiffness of the axle, N/rad."""
    rear_stiffness: Array


class Forces(NamedTuple):
    """What acts during the n substeps; ``[substep, axle (front, rear), vehicle]`` or ``[substep, vehicle]``."""

    tan_steer: Array
    cos_steer: Array
    sin_steer: Array
    lateral_limit_n: Array
    """What the friction circle leaves for each axle's lateral force."""
    push_n: Array
    """Longitudinal forces of the driven axles, along the vehicle."""
    resist_n: Array
    """Brakes, drag and rolling resistance: they oppose the motion and never reverse it."""
    left_n: Array
    """Part of the front axle's longitudinal force that points to the vehicle's left."""


@compiled
def _secant(stiffness: float, limit_n: float, slip: float, cos: float) -> float:
    """Force over slip of a Fiala tyre (secant stiffness), of an axle steered by an angle of that cosine."""
    z = stiffness * cos * cos / (3.0 * limit_n) * slip
    inner = min(z, 1.0)
    return stiffness * cos * cos * cos * (1.0 - inner + inner * inner / 3.0) / max(z, 1.0)


@compiled
def integrate(motion: Array, axles: Axles, forces: Forces, h: float, course: Array) -> None:
    """Fill the course of forward and lateral velocity and yaw rate ``(3, count, N)`` from their start ``(3, N)``.

    Backward Euler of Newton's equations in v and ω, with U the speed that slip is measured by:
    ``m U (v⁺ − v)/h + m U u ω⁺ = Σ K (u tan δ − v⁺ − l ω⁺) + U F_left`` and
    ``I U (ω⁺ − ω)/h = Σ l K (u tan δ − v⁺ − l ω⁺) + U a F_left``, K the axles' secant stiffnesses, l = (a, −b).
    The tyre forces of that solution are cut to their limits before they act. ``h`` is the substep.
    """
    count = course.shape[1]
    for n in range(course.shape[2]):
        mass_rate, inertia_rate = axles.mass_rate[n], axles.inertia_rate[n]
        a, b = axles.front_arm_m[n], axles.rear_arm_m[n]
        u, v, w = motion[0, n], motion[1, n], motion[2, n]
        for i in range(count):
            cos, tan = forces.cos_steer[i, n], forces.tan_steer[i, n]
            front_limit, rear_limit = forces.lateral_limit_n[i, 0, n], forces.lateral_limit_n[i, 1, n]
            speed = np.sqrt(u * u + v * v + (a * w) ** 2) + _SLOWEST_MPS
            left = forces.left_n[i, n] * min(max(u / _FULL_PULL_MPS, -1.0), 1.0)
            front = _secant(axles.front_stiffness[n], front_limit, abs(u * tan - v - a * w) / speed, cos)
            rear = _secant(axles.rear_stiffness[n], rear_limit, abs(v + b * w) / speed, 1.0)
            push = u * tan * front
            a11, a12 = speed * mass_rate + front + rear, speed * mass_rate * h * u + front * a + rear * b
            a21, a22 = front * a + rear * b, speed * inertia_rate + front * a * a + rear * b * b
            r1 = speed * (mass_rate * v + left) + push
            r2 = speed * (inertia_rate * w + a * left) + push * a
            determinant = a11 * a22 - a12 * a21
            v_free, w_free = (r1 * a22 - a12 * r2) / determinant, (a11 * r2 - a21 * r1) / determinant
            front_n = front * (u * tan - v_free - a * w_free) / speed
            rear_n = -rear * (v_free + b * w_free) / speed
            front_n = min(max(front_n, -front_limit * cos), front_limit * cos)
            rear_n = min(max(rear_n, -rear_limit), rear_limit)
            w = w + ((front_n + left) * a + rear_n * b) / inertia_rate
            v = v + (front_n + rear_n + left) / mass_rate - h * u * w
            u = u + (forces.push_n[i, n] - front_n * tan) / mass_rate + h * v * w
            u = np.copysign(max(abs(u) - forces.resist_n[i, n] / mass_rate, 0.0), u)
            course[0, i, n], course[1, i, n], course[2, i, n] = u, v, w
        if u == 0.0 and abs(v) < _STILL and abs(w) < _STILL:
            course[1, count - 1, n] = course[2, count - 1, n] = 0.0
