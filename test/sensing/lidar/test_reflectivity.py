import numpy as np
import pytest

from siren_ros.sensing.lidar.reflectivity import REFLECTIVITY, reflectivity_of
from siren_ros.sensing.meshes.mesh import Material

SURFACES = (Material.CAR_PAINT, Material.BUILDING_WALL, Material.METAL_POLE, Material.TYRE, Material.ASPHALT)
MATERIAL = np.array(SURFACES, np.uint8)


def of_colour(red, share):
    colour = np.tile(np.array([red, 99, 7], np.uint8), (len(MATERIAL), 1))
    return reflectivity_of(MATERIAL, colour, share).tolist()


def test_there_is_a_share_for_every_material_and_retroreflectors_send_back_all():
    assert REFLECTIVITY.shape == (len(Material),)
    assert ((REFLECTIVITY > 0.0) & (REFLECTIVITY <= 1.0)).all()
    assert REFLECTIVITY[Material.PLATE] == REFLECTIVITY[Material.LIVERY] == 1.0
    assert REFLECTIVITY[Material.TYRE] < 0.1


def test_nobody_changes_the_table():
    with pytest.raises(ValueError, match="read-only"):
        REFLECTIVITY[0] = 1.0


@pytest.mark.parametrize("red", [0, 120, 255])
def test_without_the_share_colours_change_nothing(red):
    assert of_colour(red, 0.0) == REFLECTIVITY[MATERIAL].tolist()


def test_paint_walls_and_sheet_metal_follow_their_colour_and_nothing_else_does():
    assert of_colour(0, 1.0) == pytest.approx([0.04, 0.04, 0.04, 0.07, 0.17])
    assert of_colour(255, 1.0) == pytest.approx([0.85, 0.85, 0.85, 0.07, 0.17])
    assert of_colour(0, 0.5) == pytest.approx([0.32, 0.245, 0.27, 0.07, 0.17])
