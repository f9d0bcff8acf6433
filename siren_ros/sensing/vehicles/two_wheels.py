"""Shapes of bicycle and motorcycle with their riders.

Drawn in metres after published side views of a city bicycle with 28-inch wheels and of a naked motorcycle of the middle
class (Yamaha MT-07); scaled to their classes' exact sizes afterwards.
"""

import itertools
from typing import Final

import numpy as np

from siren_ros.sensing.meshes.mesh import Limb, Material, Mesh, Swing, Wheel
from siren_ros.sensing.meshes.solids import Finish, Point3, box, from_quads, hexahedron
from siren_ros.sensing.vehicles.people import JACKET, SKIN, ellipsoid, head, jointed, leg, rod, torso
from siren_ros.sensing.vehicles.vehicle_parts import (
    BRAKE_LAMP,
    HEAD_LAMP,
    PAINT,
    PLASTIC,
    PLATE,
    STEEL,
    indicator,
)

Ridden = tuple[Mesh, tuple[Wheel, ...], tuple[Limb, ...]]
"""Body with the rider, wheels and the rider's legs in ``base_link``, as drawn."""
_TYRE: Final[Finish] = (Material.TYRE, (28, 28, 30))
_HELMET: Final[Finish] = (Material.PLASTIC, (208, 210, 214))
_SECTORS: Final = 16


def _wheel(x_m: float, radius_m: float, width_m: float, hole: float, *, steered: bool) -> Wheel:
    """A wheel in the middle of the vehicle: a tyre around a hole of that share of its radius, with spokes across it."""
    angle = -np.pi / 2 + np.arange(_SECTORS + 1) * (2 * np.pi / _SECTORS)
    circle = np.stack((np.cos(angle), np.zeros_like(angle), np.sin(angle)), axis=1)
    side = np.array((0.0, width_m / 2, 0.0))
    outer, inner = circle * radius_m, circle * (hole * radius_m)
    rings = (inner - side, outer - side, outer + side, inner + side, inner - side)
    faces = [
        (np.stack((a[i], a[i + 1], b[i + 1], b[i]))[::-1], STEEL if k == 3 else _TYRE)
        for k, (a, b) in enumerate(itertools.pairwise(rings))
        for i in range(_SECTORS)
    ]
    reach, thin = (hole + 0.02) * radius_m, 0.25 * width_m
    bars = [
        box((-thin, -thin, -reach), (thin, thin, reach), *STEEL).transformed(_turned(turn))
        for turn in np.arange(3) * (np.pi / 3)
    ]
    return Wheel(Mesh.joined(from_quads(faces), *bars), (x_m, 0.0, radius_m), radius_m, steered)


def _turned(angle_rad: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Rotation matrix about the axle."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array(((cos, 0.0, sin), (0.0, 1.0, 0.0), (-sin, 0.0, cos)))


def _both(*points: Point3) -> tuple[tuple[Point3, ...], tuple[Point3, ...]]:
    """The points of the left side, and their mirror images for the right side."""
    return points, tuple((x, -y, z) for x, y, z in points)


def _mudguard(x_m: float, hub_m: float, radius_m: float, from_deg: float, to_deg: float, width_m: float) -> Mesh:
    """A curved strip around a wheel between two angles, measured upward from the forward direction."""
    angle = np.radians(np.linspace(from_deg, to_deg, 7))
    x, z = x_m + radius_m * np.cos(angle), hub_m + radius_m * np.sin(angle)
    pieces = [
        rod((float(x[i]), 0.0, float(z[i])), (float(x[i + 1]), 0.0, float(z[i + 1])), (width_m, width_m), PLASTIC, 4)
        for i in range(len(angle) - 1)
    ]
    return Mesh.joined(*pieces)


def bicycle() -> Ridden:
    """A city bicycle with mudguards, rack and lamps; its rider sits upright and wears a helmet."""
    radius, axle = 0.335, 0.525
    crank, seat, neck, grip = (-0.08, 0.0, 0.29), (-0.24, 0.0, 0.93), (0.33, 0.0, 0.86), (0.2, 0.29, 1.06)
    tubes = [
        *((crank, neck), (crank, seat), ((-0.2, 0.0, 0.78), neck), (neck, (0.3, 0.0, 1.04))),
        *((crank, (-axle, 0.0, radius)), ((-0.2, 0.0, 0.78), (-axle, 0.0, radius))),
        *((neck, (axle, 0.05, radius)), (neck, (axle, -0.05, radius))),
    ]
    frame = [rod(start, end, (0.02, 0.02), PAINT, 6) for start, end in tubes]
    handle = jointed(((0.2, 0.31, 1.06), (0.3, 0.0, 1.04), (0.2, -0.31, 1.06)), (0.016, 0.016, 0.016), PLASTIC)
    parts = [
        box((-0.38, -0.08, 0.9), (-0.12, 0.08, 0.95), *PLASTIC),
        box((-0.92, -0.07, 0.745), (-0.4, 0.07, 0.77), *STEEL),
        box((-0.935, -0.05, 0.67), (-0.9, 0.05, 0.74), *BRAKE_LAMP),
        box((0.38, -0.045, 0.86), (0.44, 0.045, 0.94), *HEAD_LAMP),
        _mudguard(axle, radius, 0.385, 20.0, 120.0, 0.025),
        _mudguard(-axle, radius, 0.385, 60.0, 190.0, 0.025),
        rod((0.88, 0.0, 0.45), (0.925, 0.0, 0.4), (0.02, 0.01), PLASTIC, 4),
    ]
    arms = [
        jointed(points, (0.055, 0.045, 0.035), JACKET) for points in _both((0.02, 0.2, 1.4), (0.1, 0.27, 1.18), grip)
    ]
    hands = [ellipsoid(point, (0.05, 0.035, 0.035), SKIN) for (point,) in _both(grip)]
    rider = [torso((-0.25, 0.0, 0.95), (0.0, 0.0, 1.42)), head((0.08, 0.0, 1.62), _HELMET, 0.025), *arms, *hands]
    legs = (
        leg((-0.22, 0.09, 0.97), (0.13, 0.1, 0.66), (-0.02, 0.1, 0.18), Swing.PEDALLING_LEG),
        leg((-0.22, -0.09, 0.97), (0.16, -0.1, 0.76), (-0.02, -0.1, 0.3), Swing.PEDALLING_LEG),
    )
    wheels = tuple(_wheel(x, radius, 0.045, 0.9, steered=x > 0.0) for x in (axle, -axle))
    return Mesh.joined(*frame, handle, *parts, *rider), wheels, legs


def motorcycle() -> Ridden:
    """A naked motorcycle of the middle class; its rider wears a full helmet."""
    radius, axle = 0.31, 0.725
    grip, foot = (0.3, 0.33, 1.02), (-0.22, 0.2, 0.32)
    tank = hexahedron(
        [(-0.15, -0.12, 0.68), (0.3, -0.15, 0.66), (0.3, 0.15, 0.66), (-0.15, 0.12, 0.68),
         (-0.12, -0.09, 0.86), (0.24, -0.13, 0.92), (0.24, 0.13, 0.92), (-0.12, 0.09, 0.86)], *PAINT
    )  # fmt: skip
    tail = hexahedron(
        [(-0.85, -0.08, 0.72), (-0.1, -0.14, 0.62), (-0.1, 0.14, 0.62), (-0.85, 0.08, 0.72),
         (-0.9, -0.07, 0.86), (-0.1, -0.15, 0.8), (-0.1, 0.15, 0.8), (-0.9, 0.07, 0.86)], *PLASTIC
    )  # fmt: skip
    fork = [rod((0.42, side * 0.1, 0.95), (axle, side * 0.1, radius), (0.03, 0.03), STEEL, 6) for side in (1, -1)]
    arm = [rod((-0.2, side * 0.1, 0.36), (-axle, side * 0.1, radius), (0.035, 0.035), PLASTIC, 6) for side in (1, -1)]
    lamps = [
        box((x - 0.03, 0.17 * side - 0.03, z), (x + 0.03, 0.17 * side + 0.03, z + 0.05), *indicator(side))
        for side, (x, z) in itertools.product((1, -1), ((0.5, 0.84), (-0.88, 0.72)))
    ]
    mirrors = [box((0.26, low, 1.14), (0.29, low + 0.13, 1.22), *PLASTIC) for low in (-0.425, 0.295)]
    stalks = [rod(low, high, (0.01, 0.01), PLASTIC, 4) for low, high in _both((0.3, 0.3, 1.03), (0.28, 0.35, 1.15))]
    parts = [
        tank, tail, *fork, *arm, *lamps, *mirrors, *stalks,
        box((-0.25, -0.16, 0.28), (0.32, 0.16, 0.66), *STEEL),
        box((0.45, -0.11, 0.78), (0.56, 0.11, 0.98), *HEAD_LAMP),
        box((-0.93, -0.07, 0.78), (-0.88, 0.07, 0.84), *BRAKE_LAMP),
        box((-1.12, -0.09, 0.5), (-1.1, 0.09, 0.66), *PLATE),
        rod((-0.85, 0.0, 0.74), (-1.11, 0.0, 0.6), (0.03, 0.02), PLASTIC, 4),
        rod((0.1, -0.2, 0.3), (-0.8, -0.2, 0.42), (0.05, 0.07), STEEL),
        jointed(((0.3, 0.36, 1.02), (0.42, 0.0, 1.0), (0.3, -0.36, 1.02)), (0.018, 0.018, 0.018), PLASTIC),
        _mudguard(axle, radius, 0.37, 5.0, 150.0, 0.05),
        rod((1.09, 0.0, 0.33), (1.12, 0.0, 0.3), (0.05, 0.02), PLASTIC, 4),
    ]  # fmt: skip
    arms = [
        jointed(points, (0.065, 0.055, 0.04), JACKET) for points in _both((-0.02, 0.2, 1.28), (0.08, 0.32, 1.06), grip)
    ]
    legs = [
        jointed(points, (0.1, 0.075, 0.06), (Material.CLOTHING, (60, 62, 68)))
        for points in _both((-0.32, 0.11, 0.84), (0.08, 0.2, 0.72), foot)
    ]
    boots = [rod((x - 0.08, y, z), (x + 0.16, y, z), (0.05, 0.04), PLASTIC) for ((x, y, z),) in _both(foot)]
    rider = [torso((-0.32, 0.0, 0.85), (-0.04, 0.0, 1.3)), head((0.06, 0.0, 1.47), _HELMET, 0.045)]
    wheels = tuple(_wheel(x, radius, 0.14, 0.68, steered=x > 0.0) for x in (axle, -axle))
    return Mesh.joined(*parts, *arms, *legs, *boots, *rider), wheels, ()
