"""LiDAR reflectivity of surfaces by material, and by colour where a study asks for it."""

from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats32
from siren_ros.sensing.meshes.mesh import Material

_DEFAULT: Final = 0.4
_REFLECTIVITY: Final[dict[Material, float]] = {
    Material.GROUND: 0.25,
    Material.GRASS: 0.45,
    Material.ASPHALT: 0.17,
    Material.SHOULDER_ASPHALT: 0.2,
    Material.MARKING_WHITE: 0.75,
    Material.MARKING_YELLOW: 0.6,
    Material.KERB: 0.4,
    Material.SIDEWALK: 0.35,
    Material.MEDIAN: 0.4,
    Material.BUILDING_WALL: 0.45,
    Material.BUILDING_ROOF: 0.3,
    Material.BUILDING_GLASS: 0.1,
    Material.TREE_TRUNK: 0.3,
    Material.FOLIAGE: 0.5,
    Material.METAL_POLE: 0.5,
    Material.SIGNAL_HOUSING: 0.15,
    Material.STOP_SIGN: 1.0,
    Material.CAR_PAINT: 0.6,
    Material.FLEET_PAINT: 0.6,
    Material.CAR_GLASS: 0.08,
    Material.TYRE: 0.07,
    Material.RIM: 0.6,
    Material.PLASTIC: 0.12,
    Material.CLOTHING: 0.4,
    Material.SKIN: 0.55,
    Material.LIVERY: 1.0,
    Material.PLATE: 1.0,
}

REFLECTIVITY: Final = np.array([_REFLECTIVITY.get(material, _DEFAULT) for material in Material], dtype=np.float32)
"""Reflectivity by material code at normal incidence, 0–1, in the near infrared (about 905 nm).

Orders of magnitude after the ASTER/ECOSTRESS spectral library: asphalt 0.1–0.2, vegetation 0.4–0.5, concrete 0.3–0.4,
rubber below 0.1; retro-reflective sheeting saturates a receiver and is 1; glass mostly lets light through or
mirrors it.
"""
REFLECTIVITY.setflags(write=False)


_COLOURED: Final = (Material.CAR_PAINT, Material.FLEET_PAINT, Material.BUILDING_WALL, Material.METAL_POLE)
_DARKEST: Final = 0.04
_BRIGHTEST: Final = 0.85


def reflectivity_of(
    material: npt.NDArray[np.uint8], colour_rgb: npt.NDArray[np.uint8], colour_share: float
) -> Floats32:
    """Reflectivity of triangles, shape ``(T,)``, from their materials, ``(T,)``, and colours, ``(T, 3)``.

    With ``colour_share`` 0 each material has one value. With 1, paint, walls and sheet metal have that of their colour:
    the linear red of the picture, the nearest that it has to near infrared, from 0.04 (carbon black) to 0.85 (titanium
    white). In between, values are mixed.
    """
    own = REFLECTIVITY[material]
    if colour_share == 0.0:
        return own
    coloured = np.isin(material, _COLOURED)
    of_colour = _DARKEST + (_BRIGHTEST - _DARKEST) * (colour_rgb[:, 0] / 255.0) ** 2
    return np.where(coloured, (1.0 - colour_share) * own + colour_share * of_colour, own).astype(np.float32)
