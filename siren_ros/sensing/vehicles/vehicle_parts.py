"""Parts that every vehicle has, such as lamps, mirrors and wheels, and the colours that vehicles share."""

import itertools
from collections.abc import Sequence
from typing import Final

import numpy as np

from siren_ros.sensing.meshes.mesh import Material, Mesh, Wheel
from siren_ros.sensing.meshes.solids import Axle, Band, Finish, Knots, Point3, box, from_quads, hexahedron

Drawn = tuple[Mesh, tuple[Wheel, ...]]
"""Body and wheels of a vehicle in ``base_link``, as drawn (not yet scaled)."""

PAINT: Final[Finish] = (Material.CAR_PAINT, (255, 255, 255))
WHITE_PAINT: Final[Finish] = (Material.FLEET_PAINT, (236, 238, 240))
RED_PAINT: Final[Finish] = (Material.FLEET_PAINT, (184, 18, 20))
GLASS: Final[Finish] = (Material.CAR_GLASS, (34, 42, 50))
PLASTIC: Final[Finish] = (Material.PLASTIC, (36, 37, 40))
GRILLE: Final[Finish] = (Material.PLASTIC, (20, 20, 22))
STEEL: Final[Finish] = (Material.RIM, (150, 154, 160))
HEAD_LAMP: Final[Finish] = (Material.HEAD_LAMP, (226, 230, 236))
BRAKE_LAMP: Final[Finish] = (Material.BRAKE_LAMP, (132, 14, 18))
RED_BEACON: Final[Finish] = (Material.BEACON_RED, (150, 16, 20))
BLUE_BEACON: Final[Finish] = (Material.BEACON_BLUE, (20, 44, 170))
PLATE: Final[Finish] = (Material.PLATE, (240, 240, 228))
BLUE_LIVERY: Final[Finish] = (Material.LIVERY, (18, 58, 160))
YELLOW_LIVERY: Final[Finish] = (Material.LIVERY, (232, 222, 40))
RED_LIVERY: Final[Finish] = (Material.LIVERY, (204, 28, 32))
WHITE_LIVERY: Final[Finish] = (Material.LIVERY, (240, 240, 240))


def knots(*values: float) -> Knots:
    """An outline as knots from numbers that alternate: distance behind the front bumper, value."""
    return tuple(zip(values[::2], values[1::2], strict=True))


def indicator(side: int) -> Finish:
    """Amber lens of the left (+1) or right (−1) indicator."""
    material = Material.INDICATOR_LEFT_LAMP if side > 0 else Material.INDICATOR_RIGHT_LAMP
    return material, (214, 120, 20)


def car_front(paint: Finish, band: Band, zone: int) -> Finish:
    """Grille between head lamps and indicators, and a grille below."""
    if band is Band.UPPER_SIDE:
        return GRILLE if zone == 0 else HEAD_LAMP if abs(zone) == 1 else indicator(zone)
    return GRILLE if band is Band.LOWER_SIDE and abs(zone) < 2 else paint


def plates(front_x_m: float, rear_x_m: float, front_z_m: float, rear_z_m: float) -> Mesh:
    """European number plates, 520 mm × 110 mm, on the bumpers (size: Council Regulation (EC) 2411/98 practice)."""
    return Mesh.joined(
        box((front_x_m - 0.05, -0.26, front_z_m - 0.055), (front_x_m + 0.012, 0.26, front_z_m + 0.055), *PLATE),
        box((rear_x_m - 0.012, -0.26, rear_z_m - 0.055), (rear_x_m + 0.05, 0.26, rear_z_m + 0.055), *PLATE),
    )


def mirrors(x_m: float, inner_y_m: float, outer_y_m: float, z_m: float, finish: Finish, height_m: float = 0.15) -> Mesh:
    """Both door mirrors, between two distances from the middle of the vehicle."""
    below, above = (x_m - 0.05, x_m + 0.05, z_m), (x_m - 0.06, x_m + 0.02, z_m + height_m)
    sides = [sorted((side * inner_y_m, side * outer_y_m)) for side in (1, -1)]
    return Mesh.joined(*[hexahedron([*_corners(below, y), *_corners(above, y)], *finish) for y in sides])


def _corners(back_front_z_m: tuple[float, float, float], y_m: Sequence[float]) -> list[Point3]:
    """Corners of a rectangle, counter-clockwise from above, from its x range with its height and from its y range."""
    (x0, x1, z), (y0, y1) = back_front_z_m, y_m
    return [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]


def light_bar(x_m: float, z_m: float, half_width_m: float, depth_m: float, height_m: float) -> Mesh:
    """A roof light bar across the vehicle: red and blue domes beside a dark middle."""
    x0, x1 = x_m - depth_m / 2, x_m + depth_m / 2
    base, lens = z_m + 0.25 * height_m, z_m + height_m
    w, inset = half_width_m, 0.15 * depth_m
    parts = [box((x0 + 0.02, -w, z_m), (x1 - 0.02, w, base), *PLASTIC)]
    edges = (-1.0, -0.62, -0.24, 0.24, 0.62, 1.0)
    finishes = (BLUE_BEACON, RED_BEACON, WHITE_PAINT, RED_BEACON, BLUE_BEACON)
    for (low, high), finish in zip(itertools.pairwise(edges), finishes, strict=True):
        top = lens if finish is not WHITE_PAINT else lens - 0.2 * height_m
        below, above = ((x0, x1, base), (x0 + inset, x1 - inset, top))
        y = (low * w, high * w)
        parts.append(hexahedron([*_corners(below, y), *_corners(above, y)], *finish))
    return Mesh.joined(*parts)


def beacon(x_m: float, y_m: float, z_m: float, size_m: float, finish: Finish) -> Mesh:
    """A small flashing lamp, a box with its centre at a point."""
    h = size_m / 2
    return box((x_m - h, y_m - h, z_m - h), (x_m + h, y_m + h, z_m + h), *finish)


def side_panels(x_m: tuple[float, float], z_m: tuple[float, float], half_width_m: float, finish: Finish) -> Mesh:
    """The same flat panel on both sides of a vehicle, 6 mm outside ``±half_width_m``."""
    (x0, x1), (z0, z1) = x_m, z_m
    return Mesh.joined(
        box((x0, half_width_m - 0.02, z0), (x1, half_width_m + 0.006, z1), *finish),
        box((x0, -half_width_m - 0.006, z0), (x1, -half_width_m + 0.02, z1), *finish),
    )


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
        hub, back = 0.75 * across * out, -across * out
        # Every fourth sector is dark, so that a turning wheel shows that it turns.
        faces.append((np.stack((rings[2][i], rings[2][i + 1], hub, hub)), _RIM_GAP if i % 4 in {0, 1} else _RIM))
        faces.append((np.stack((rings[0][i + 1], rings[0][i], back, back)), _INSIDE))
    if side > 0:
        faces = [(quad[::-1], finish) for quad, finish in faces]
    return from_quads(faces)


def vehicle_wheels(axles: tuple[Axle, ...], length_m: float, half_width_m: float) -> tuple[Wheel, ...]:
    """Wheels of all axles, left and right; the first axle steers. The outer faces are at ``±half_width_m``."""
    wheels = []
    for axle, side in itertools.product(axles, (1, -1)):
        x, y, radius = length_m / 2 - axle.s_m, half_width_m - axle.tyre_width_m / 2, axle.wheel_radius_m
        mesh = wheel_mesh(radius, axle.tyre_width_m, side)
        wheels.append(Wheel(mesh, (x, side * y, radius), radius, steered=axle is axles[0]))
    return tuple(wheels)
