"""Shapes of people: limbs, torso and head, for riders and pedestrians.

Sizes are those of an adult of 1.75 m (DIN 33402-2, medians rounded).
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from siren_ros.sensing.meshes.mesh import Limb, Material, Mesh, Swing, VehicleShape
from siren_ros.sensing.meshes.solids import Finish, Point3, frustum, sphere_points
from siren_ros.simulation.world.actors import ActorClass

JACKET: Final[Finish] = (Material.CLOTHING, (255, 255, 255))
TROUSERS: Final[Finish] = (Material.CLOTHING, (70, 74, 86))
SHOES: Final[Finish] = (Material.PLASTIC, (40, 36, 34))
SKIN: Final[Finish] = (Material.SKIN, (196, 150, 122))
_HEAD_M: Final = (0.1, 0.08, 0.125)
_SIDES: Final = 7
_HAIR: Final[Finish] = (Material.PLASTIC, (66, 48, 36))


def rod(start: Point3, end: Point3, radii_m: tuple[float, float], finish: Finish, sides: int = _SIDES) -> Mesh:
    """A round bar between two points, with a radius at each of them."""
    along = np.subtract(end, start)
    length = float(np.linalg.norm(along))
    up = along / length
    aside = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 1.0, 0.0))
    aside /= np.linalg.norm(aside)
    upright = frustum((0.0, 0.0, 0.0), length, radii_m, sides, *finish)
    return upright.transformed(np.column_stack((aside, np.cross(up, aside), up)), start)


def ellipsoid(centre: Point3, radii_m: Point3, finish: Finish) -> Mesh:
    """A rounded body about a point."""
    points, triangles = sphere_points(1)
    return Mesh.uniform(points * radii_m + np.array(centre), triangles, *finish)


def jointed(points: Sequence[Point3], radii_m: Sequence[float], finish: Finish) -> Mesh:
    """Rods from point to point, with a radius at each."""
    pairs = zip(points[:-1], points[1:], radii_m[:-1], radii_m[1:], strict=True)
    return Mesh.joined(*[rod(start, end, (low, high), finish) for start, end, low, high in pairs])


def torso(hips: Point3, shoulders: Point3, jacket: Finish = JACKET) -> Mesh:
    """Trunk and shoulders between the middle of the hips and the middle of the shoulders."""
    chest = rod(hips, shoulders, (0.15, 0.17), jacket, 8)
    across = rod((shoulders[0], -0.2, shoulders[2]), (shoulders[0], 0.2, shoulders[2]), (0.065, 0.065), jacket)
    return Mesh.joined(chest, across)


def head(centre: Point3, cover: Finish, cover_m: float) -> Mesh:
    """Face and neck, with hair or a helmet of the given thickness above and behind them."""
    x, y, z = centre
    lifted = x - 0.02 - 0.2 * cover_m, y, z + 0.03
    thick = _HEAD_M[0] + cover_m, _HEAD_M[1] + cover_m, _HEAD_M[2] - 0.02 + cover_m
    neck = rod((x - 0.06, y, z - 0.22), (x - 0.01, y, z - 0.08), (0.06, 0.055), SKIN)
    return Mesh.joined(ellipsoid(centre, _HEAD_M, SKIN), ellipsoid(lifted, thick, cover), neck)


def leg(hip: Point3, knee: Point3, foot: Point3, swing: Swing) -> Limb:
    """A leg from the hip to the sole, with its points in the owner's frame."""
    toes = foot[0] + 0.14, foot[1], foot[2] + 0.03
    shoe = rod((foot[0] - 0.07, foot[1], foot[2] + 0.045), toes, (0.045, 0.035), SHOES)
    mesh = Mesh.joined(jointed((hip, knee, (foot[0], foot[1], foot[2] + 0.06)), (0.085, 0.06, 0.045), TROUSERS), shoe)
    return Limb(mesh.translated(*np.negative(hip)), hip, swing)


def walker(length_m: float, width_m: float, height_m: float) -> VehicleShape:
    """A pedestrian who walks upright. A bag and the elbows reach the corners of the box."""
    hip, shoulder = 0.52 * height_m, 0.81 * height_m
    reach = width_m / 2.0 - 0.045
    parts = [
        torso((-0.01, 0.0, hip), (0.0, 0.0, shoulder)),
        head((0.02, 0.0, height_m - 0.13), _HAIR, 0.012),
        jointed(((0.0, 0.0, hip + 0.04), (0.0, 0.0, hip - 0.06)), (0.15, 0.14), TROUSERS),
    ]
    legs = [
        leg((0.0, side * 0.09, hip), (0.01, side * 0.09, 0.5), (-0.03, side * 0.09, 0.0), Swing.WALKING_LEG)
        for side in (1, -1)
    ]
    arms = []
    for side in (1, -1):
        joint = (0.0, side * 0.21, shoulder - 0.02)
        points = (joint, (-0.03, side * reach, shoulder - 0.3), (0.06, side * (reach - 0.02), shoulder - 0.56))
        arm = Mesh.joined(
            jointed(points, (0.055, 0.045, 0.035), JACKET), ellipsoid(points[-1], (0.05, 0.03, 0.05), SKIN)
        )
        arms.append(Limb(arm.translated(*np.negative(joint)), joint, Swing.ARM))
    body = Mesh.joined(*parts)
    return VehicleShape(ActorClass.PEDESTRIAN, body, (), length_m, width_m, height_m, limbs=(*legs, *arms))
