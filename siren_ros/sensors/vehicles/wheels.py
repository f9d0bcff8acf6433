"""Wheels: a tyre and a spoked rim about the hub."""

import itertools

import numpy as np

from siren_ros.sensors.meshes.loft import Axle, Finish, from_quads
from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh, Wheel

_SIDES = 16
_TYRE: Finish = (Material.TYRE, (28, 28, 30))
_RIM: Finish = (Material.RIM, (168, 172, 178))
_RIM_GAP: Finish = (Material.RIM, (52, 54, 58))
_INSIDE: Finish = (Material.PLASTIC, (22, 22, 24))


def wheel_mesh(radius_m: float, width_m: float, side: int) -> Mesh:
    """A wheel about its hub, axle along y, rim towards ``side`` (+1 left, −1 right); lowest corner at −radius."""
    angle = -np.pi / 2 + np.arange(_SIDES + 1) * (2 * np.pi / _SIDES)
    circle = np.stack((np.cos(angle), np.zeros_like(angle), np.sin(angle)), axis=1)
    out, across = np.array((0.0, 1.0, 0.0)) * side, width_m / 2
    rings = [
        circle * radius_m - across * out,
        circle * radius_m + 0.85 * across * out,
        circle * 0.7 * radius_m + across * out,
    ]
    faces = []
    for i in range(_SIDES):
        for inner, outer in itertools.pairwise(rings):
            faces.append((np.stack((inner[i], inner[i + 1], outer[i + 1], outer[i])), _TYRE))
        # Every fourth sector is dark, so that a turning wheel shows that it turns.
        spoke = _RIM_GAP if i % 4 in {0, 1} else _RIM
        hub = 0.75 * across * out
        faces.append((np.stack((rings[2][i], rings[2][i + 1], hub, hub)), spoke))
        back = -across * out
        faces.append((np.stack((rings[0][i + 1], rings[0][i], back, back)), _INSIDE))
    if side > 0:
        faces = [(quad[::-1], finish) for quad, finish in faces]
    return from_quads(faces)


def axle_wheels(axle: Axle, length_m: float, outer_half_width_m: float, *, steered: bool) -> tuple[Wheel, Wheel]:
    """Left and right wheel of an axle, their outer faces at ``±outer_half_width_m``."""
    y = outer_half_width_m - axle.tyre_width_m / 2
    left, right = (
        Wheel(
            mesh=wheel_mesh(axle.wheel_radius_m, axle.tyre_width_m, side),
            hub_m=(length_m / 2 - axle.s_m, side * y, axle.wheel_radius_m),
            radius_m=axle.wheel_radius_m,
            steered=steered,
        )
        for side in (1, -1)
    )
    return left, right
