"""Wheels: with a rim and a hub for cars and larger vehicles, with spokes for two-wheelers."""

import itertools
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.sensing.meshes.mesh import Mesh, Wheel
from siren_ros.sensing.meshes.solids import Axle, Finish, box, from_quads
from siren_ros.sensing.vehicles.parts import Finishes

_SECTORS: Final = 16
_ANGLE_RAD: Final = -np.pi / 2 + np.arange(_SECTORS + 1) * (2 * np.pi / _SECTORS)
_CIRCLE: Final = np.stack((np.cos(_ANGLE_RAD), np.zeros_like(_ANGLE_RAD), np.sin(_ANGLE_RAD)), axis=1)


def pair_of_wheels(
    axle: Axle, x_m: float, outer_y_m: float, finishes: Finishes, *, steered: bool
) -> tuple[Wheel, Wheel]:
    """The left and the right wheel of an axle at ``x_m`` in ``base_link``, with their outer faces at ``±outer_y_m``."""
    y, radius = outer_y_m - axle.tyre_width_m / 2, axle.wheel_radius_m
    left, right = (
        Wheel(_wheel_mesh(radius, axle.tyre_width_m, side, finishes), (x_m, side * y, radius), radius, steered)
        for side in (1, -1)
    )
    return left, right


def _wheel_mesh(radius_m: float, width_m: float, side: int, finishes: Finishes) -> Mesh:
    """A wheel about its hub, axle along y, rim towards ``side`` (+1 left, −1 right); lowest corner at −radius."""
    out, across = np.array((0.0, 1.0, 0.0)) * side, width_m / 2
    rings = [
        _CIRCLE * radius_m - across * out,
        _CIRCLE * radius_m + 0.85 * across * out,
        _CIRCLE * 0.7 * radius_m + across * out,
    ]
    hub, back = 0.75 * across * out, -across * out
    faces: list[tuple[Floats, Finish]] = []
    for i in range(_SECTORS):
        for inner, outer in itertools.pairwise(rings):
            faces.append((np.stack((inner[i], inner[i + 1], outer[i + 1], outer[i])), finishes["tyre"]))
        # Every fourth sector is dark, so that a turning wheel shows that it turns.
        rim = finishes["rim_gap" if i % 4 in {0, 1} else "rim"]
        faces.append((np.stack((rings[2][i], rings[2][i + 1], hub, hub)), rim))
        faces.append((np.stack((rings[0][i + 1], rings[0][i], back, back)), finishes["wheel_inside"]))
    return from_quads([(quad[::-1], finish) for quad, finish in faces] if side > 0 else faces)


def spoked_wheel(axle: Axle, x_m: float, hole: float, finishes: Finishes, *, steered: bool) -> Wheel:
    """A wheel in the middle of the vehicle: a tyre around a hole of that share of its radius, with spokes across it."""
    radius, width = axle.wheel_radius_m, axle.tyre_width_m
    side = np.array((0.0, width / 2, 0.0))
    outer, inner = _CIRCLE * radius, _CIRCLE * (hole * radius)
    rings = (inner - side, outer - side, outer + side, inner + side, inner - side)
    faces = [
        (np.stack((a[i], a[i + 1], b[i + 1], b[i]))[::-1], finishes["steel" if k == 3 else "tyre"])
        for k, (a, b) in enumerate(itertools.pairwise(rings))
        for i in range(_SECTORS)
    ]
    reach, thin = (hole + 0.02) * radius, 0.25 * width
    bar = box((-thin, -thin, -reach), (thin, thin, reach), *finishes["steel"])
    bars = [bar.transformed(_turned(turn)) for turn in np.arange(3) * (np.pi / 3)]
    return Wheel(Mesh.joined(from_quads(faces), *bars), (x_m, 0.0, radius), radius, steered)


def _turned(angle_rad: float) -> Floats:
    """Rotation matrix about the axle."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array(((cos, 0.0, sin), (0.0, 1.0, 0.0), (-sin, 0.0, cos)))
