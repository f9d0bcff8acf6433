"""What a contact does to two vehicles: they go on together along the contact's normal, and do not overlap.

The impact is plastic and central: both bodies get the velocity of their common centre of mass along the contact's
normal (coefficient of restitution 0: cars crumple; Brach and Brach, "Vehicle Accident Analysis and Reconstruction
Methods", 2011, ch. 6). Along the side they slide. Bodies that overlap at the end of a step are moved apart along the
normal, the lighter one further, which puts them where they are if the impact happens within the step.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from siren_ros.dynamics.collisions import Footprints, contact_normal
from siren_ros.dynamics.parameters import ParameterTable
from siren_ros.dynamics.vehicle_model import BodyState
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import footprint_corners, separation_m

RowPairs = tuple[tuple[int, int], ...]
"""Pairs of rows, the smaller first."""
_ROUNDS: Final = 8
"""Passes over all pairs: who is pushed may be pushed into the next one."""
_TOUCHING_M: Final = 1e-3
"""Overlap that is left, so that bodies in contact stay so."""


def collide(bodies: BodyState, boxes: Footprints, table: ParameterTable, pairs: RowPairs, dt_s: float) -> BodyState:
    """Bodies after the impacts of a step.

    Args:
        bodies: Vehicles at the end of the step, as if they could pass through each other.
        boxes: The same as oriented boxes in motion.
        table: Parameters, rows as in ``bodies``.
        pairs: Rows that overlap.
        dt_s: The step: a change of velocity counts into its mean acceleration.
    """
    place = np.stack((boxes.x_m, boxes.y_m), axis=-1)
    velocity = np.stack((boxes.vx_mps, boxes.vy_mps), axis=-1)
    before = velocity.copy()
    for _ in range(_ROUNDS):
        moved = [_separate(a, b, place, velocity, boxes, table.mass_kg) for a, b in pairs]
        if not any(moved):
            break
    return _with_motion(bodies, place, velocity - before, dt_s)


def _separate(a: int, b: int, place: Floats, velocity: Floats, boxes: Footprints, mass_kg: Floats) -> bool:
    """Apply one impact to ``place`` and ``velocity`` (shape ``(N, 2)``); whether the pair still overlapped."""
    present = replace(boxes, x_m=place[:, 0], y_m=place[:, 1], vx_mps=velocity[:, 0], vy_mps=velocity[:, 1])
    corners = footprint_corners(present.x_m, present.y_m, present.yaw_rad, present.length_m, present.width_m)
    if separation_m(corners[[a]], corners[[b]])[0] > -_TOUCHING_M:
        return False
    normal = contact_normal(present, corners, a, b)
    depth = float((corners[a] @ normal).max() - (corners[b] @ normal).min())
    share = mass_kg[b] / (mass_kg[a] + mass_kg[b])
    apart = (depth - 0.5 * _TOUCHING_M) * normal
    place[a] -= share * apart
    place[b] += (1.0 - share) * apart
    closing = float((velocity[a] - velocity[b]) @ normal)
    if closing > 0.0:
        velocity[a] -= share * closing * normal
        velocity[b] += (1.0 - share) * closing * normal
    return True


def _with_motion(bodies: BodyState, place: Floats, gained: Floats, dt_s: float) -> BodyState:
    """Bodies at other places, with velocities gained in the ``map`` frame."""
    cos, sin = np.cos(bodies.yaw_rad), np.sin(bodies.yaw_rad)
    forward = cos * gained[:, 0] + sin * gained[:, 1]
    left = cos * gained[:, 1] - sin * gained[:, 0]
    return replace(
        bodies,
        x_m=place[:, 0],
        y_m=place[:, 1],
        forward_mps=bodies.forward_mps + forward,
        lateral_mps=bodies.lateral_mps + left,
        accel_mps2=bodies.accel_mps2 + forward / dt_s,
        lateral_accel_mps2=bodies.lateral_accel_mps2 + left / dt_s,
    )
