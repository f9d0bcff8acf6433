"""The table of reflectivity."""

import pytest

from siren_ros.sensors.lidar.lidar import REFLECTIVITY
from siren_ros.sensors.meshes.mesh import Material


def test_there_is_a_share_for_every_material_and_retroreflectors_send_back_all():
    assert REFLECTIVITY.shape == (len(Material),)
    assert ((REFLECTIVITY > 0.0) & (REFLECTIVITY <= 1.0)).all()
    assert REFLECTIVITY[Material.PLATE] == REFLECTIVITY[Material.LIVERY] == 1.0
    assert REFLECTIVITY[Material.TYRE] < 0.1


def test_nobody_changes_the_table():
    with pytest.raises(ValueError, match="read-only"):
        REFLECTIVITY[0] = 1.0
