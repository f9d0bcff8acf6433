"""Trees and hedges with seeded variation."""

from typing import Final

import numpy as np

from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh
from siren_ros.sensors.meshes.primitives import Rgb, frustum, sphere_points

TRUNK_RGB: Final[Rgb] = (92, 72, 52)
_GREENS: Final = np.array([(74, 112, 44), (92, 128, 52), (62, 98, 46), (110, 134, 58), (84, 118, 66)])
_CROWN_POINTS, _CROWN_FACES = sphere_points(1)


def broadleaf(x_m: float, y_m: float, crown_radius_m: float, rng: np.random.Generator) -> Mesh:
    """A broad-leaved tree, 120 triangles; nothing reaches farther from its trunk than the crown's radius."""
    height = crown_radius_m * rng.uniform(2.6, 3.4)
    trunk = 0.42 * height
    swelling = rng.uniform(0.78, 1.0, len(_CROWN_POINTS))[:, None]
    squash = np.array((crown_radius_m, crown_radius_m, 0.33 * height))
    points = _CROWN_POINTS * swelling * squash + (x_m, y_m, trunk + 0.27 * height)
    tone = _GREENS[rng.integers(len(_GREENS))]
    colour = np.clip(tone + rng.integers(-9, 10, (len(_CROWN_FACES), 1)), 0, 255).astype(np.uint8)
    crown = Mesh(
        points.astype(np.float32),
        _CROWN_FACES.astype(np.uint32),
        np.full(len(_CROWN_FACES), int(Material.FOLIAGE), np.uint8),
        colour,
    )
    width = 0.05 + 0.05 * crown_radius_m
    stem = frustum((x_m, y_m, 0.0), trunk + 0.1 * height, (width, 0.6 * width), 6, Material.TREE_TRUNK, TRUNK_RGB)
    return Mesh.concatenate([stem, crown])


def conifer(x_m: float, y_m: float, radius_m: float, rng: np.random.Generator) -> Mesh:
    """A conifer of two stacked cones on a short trunk."""
    height = radius_m * rng.uniform(3.4, 4.4)
    tone = np.clip(np.array((46, 82, 50)) + rng.integers(-8, 9), 0, 255)
    colour: Rgb = (int(tone[0]), int(tone[1]), int(tone[2]))
    return Mesh.concatenate(
        [
            frustum((x_m, y_m, 0.0), 0.2 * height, (0.14, 0.12), 6, Material.TREE_TRUNK, TRUNK_RGB),
            frustum((x_m, y_m, 0.14 * height), 0.55 * height, (radius_m, 0.25 * radius_m), 8, Material.FOLIAGE, colour),
            frustum((x_m, y_m, 0.48 * height), 0.52 * height, (0.68 * radius_m, 0.02), 8, Material.FOLIAGE, colour),
        ]
    )
