"""Which walls lie in the sun."""

from dataclasses import replace

import numpy as np

from siren_ros.sensing.camera.surface_light import Shading, shading_of
from siren_ros.sensing.look import Look
from siren_ros.sensing.meshes.mesh import Material


def test_walls_that_face_away_from_the_sun_are_shady_unless_lamps_are_lit():
    """Normals at 60°, 89°, 91° and 120° from the sun's direction, turned about the vertical."""
    look = Look()
    x, y, _ = look.towards_sun
    azimuth = np.arctan2(y, x)
    turned = np.deg2rad([60.0, 89.0, 91.0, 120.0])
    normals = np.column_stack((np.cos(azimuth + turned), np.sin(azimuth + turned), np.zeros(4))).astype(np.float32)
    walls = np.full(4, Material.BUILDING_WALL, dtype=np.uint8)
    sunny, shady = Shading.WALL_SUNNY, Shading.WALL_SHADY
    assert shading_of(walls, normals, look).tolist() == [sunny, sunny, shady, shady]
    assert shading_of(walls, normals, replace(look, sun_elevation_rad=-0.2)).tolist() == [sunny] * 4
    assert shading_of(np.full(4, Material.ASPHALT, dtype=np.uint8), normals, look).max() not in {sunny, shady}
