"""Buildings on their lots: walls, roofs and panes, in every direction."""

import numpy as np
import pytest
from shapely.geometry import Point
from solids import gap_m2, volume

from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh
from siren_ros.sensors.scene.buildings import Lot, _facade, _flat_roof, _gable, building
from siren_ros.sensors.scene.planting import footprint

WIDTH_M, DEPTH_M = 16.0, 10.0


def lot(heading_rad: float, height_m: float) -> Lot:
    return Lot(50.0, -20.0, heading_rad, WIDTH_M, DEPTH_M, height_m)


def on_lot(mesh: Mesh, heading_rad: float) -> np.ndarray:
    """Corners seen from the middle of the front: to the back, to its left, up."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    x, y, z = (mesh.vertices_m[mesh.triangles].astype(float) - (50.0, -20.0, 0.0)).reshape(-1, 3).T
    return np.stack((cos * x + sin * y, cos * y - sin * x, z), axis=-1)


@pytest.mark.parametrize("heading_rad", [0.0, 1.1, -2.4])
@pytest.mark.parametrize("height_m", [8.0, 20.0])
def test_walls_stand_on_the_lot(heading_rad: float, height_m: float) -> None:
    for seed in range(4):
        mesh = building(lot(heading_rad, height_m), np.random.default_rng(seed), detailed=True)
        places = on_lot(mesh, heading_rad)
        material = np.repeat(mesh.material, 3)
        walls = places[(material == Material.BUILDING_WALL) & (places[:, 2] < height_m - 0.5)]
        assert walls.min(axis=0) == pytest.approx([0.0, -WIDTH_M / 2, 0.0], abs=1e-4)
        assert walls.max(axis=0)[:2] == pytest.approx([DEPTH_M, WIDTH_M / 2], abs=1e-4)
        panes = places[material == Material.BUILDING_GLASS]
        outside = np.maximum(np.maximum(-panes[:, 0], panes[:, 0] - DEPTH_M), np.abs(panes[:, 1]) - WIDTH_M / 2)
        assert outside == pytest.approx(np.full(len(panes), 0.03), abs=1e-4), "3 cm in front of one of the walls"
        assert panes[:, 2].min() > 0.3
        assert panes[:, 2].max() < height_m
        glass = mesh.normals[mesh.material == Material.BUILDING_GLASS]
        centres = mesh.vertices_m[mesh.triangles[mesh.material == Material.BUILDING_GLASS]].mean(axis=1)
        house = np.array([50.0 + np.cos(heading_rad) * DEPTH_M / 2, -20.0 + np.sin(heading_rad) * DEPTH_M / 2])
        looks = np.einsum("ij,ij->i", glass[:, :2], centres[:, :2] - house)
        assert (looks > 0.0).all(), "panes look out"


def test_plain_buildings_have_windows_in_front_alone() -> None:
    mesh = building(lot(0.0, 12.0), np.random.default_rng(0), detailed=False)
    panes = on_lot(mesh, 0.0)[np.repeat(mesh.material == Material.BUILDING_GLASS, 3)]
    assert panes[:, 0] == pytest.approx(np.full(len(panes), -0.03), abs=1e-5)


def test_windows_of_a_facade_lie_side_by_side_in_each_storey() -> None:
    """16 m and 5 storeys of 3 m: (16 − 0.8) / 2.9 makes five windows, 46 % of their field each."""
    mesh = _facade((0.0, 8.0), (0.0, -8.0), 5, 15.0, np.random.default_rng(0), ribbons=False, shop=False)
    quads = mesh.vertices_m.reshape(-1, 4, 3)
    assert len(quads) == 25
    step = 15.2 / 5
    lefts = np.sort(np.unique(np.round(8.0 - quads[:, 0, 1].astype(float), 4)))
    assert lefts == pytest.approx(0.4 + (np.arange(5) + 0.27) * step, abs=1e-3)
    assert quads[:, 0, 1] - quads[:, 1, 1] == pytest.approx(np.full(25, 0.46 * step), abs=1e-4)
    assert np.unique(np.round(quads[:, 0, 2], 3)).tolist() == pytest.approx([0.95, 3.95, 6.95, 9.95, 12.95])
    assert quads[:, 2, 2] - quads[:, 0, 2] == pytest.approx(np.full(25, 1.45), abs=1e-4)


def test_ribbons_and_shops() -> None:
    mesh = _facade((0.0, 8.0), (0.0, -8.0), 3, 9.0, np.random.default_rng(0), ribbons=True, shop=True)
    quads = mesh.vertices_m.reshape(-1, 4, 3)
    shop = quads[quads[:, 0, 2] < 0.5]
    assert len(shop) == 4, "16 m / 3.6 m"
    assert shop[:, 0, 1] - shop[:, 1, 1] == pytest.approx(np.full(4, 3.5), abs=1e-4)
    ribbons = quads[quads[:, 0, 2] > 0.5]
    assert ribbons[:, 0, 1] - ribbons[:, 1, 1] == pytest.approx(np.full(2, 15.0), abs=1e-4)
    assert ribbons[:, 0, 2].tolist() == pytest.approx([3.95, 6.95])


def test_a_saddle_roof_is_closed_and_has_its_volume() -> None:
    """A ridge of 16.8 m, 0.28 of the depth above the eaves; half of the box around it."""
    (roof,) = _gable(8.0, DEPTH_M, 7.0, np.random.default_rng(0))
    assert gap_m2(roof) < 1e-4
    rise = 0.28 * DEPTH_M
    assert volume(roof.translated(0.0, 0.0, -7.0)) == pytest.approx(0.5 * 16.8 * 10.8 * rise, rel=1e-4)
    low, high = roof.bounds_m
    assert low == pytest.approx([-0.4, -8.4, 7.0])
    assert high == pytest.approx([10.4, 8.4, 7.0 + rise])
    ridge = roof.vertices_m[roof.vertices_m[:, 2] > 7.1]
    assert ridge[:, 0] == pytest.approx([5.0, 5.0])


def test_a_flat_roof_lies_on_the_walls() -> None:
    parts = _flat_roof(8.0, DEPTH_M, 9.0, (100, 100, 100), np.random.default_rng(0))
    assert len(parts) == 2
    edge, roof = parts
    assert edge.bounds_m[0] == pytest.approx([-0.15, -8.15, 8.55])
    assert edge.bounds_m[1] == pytest.approx([10.15, 8.15, 9.0])
    assert roof.bounds_m[0] == pytest.approx([0.1, -7.9, 8.8])
    assert roof.bounds_m[1] == pytest.approx([9.9, 7.9, 9.04])
    assert np.unique(edge.colour_rgb).tolist() == [82]
    tall = _flat_roof(8.0, DEPTH_M, 12.0, (100, 100, 100), np.random.default_rng(0))
    hut = tall[2]
    low, high = hut.bounds_m
    assert high - low == pytest.approx([3.2, 3.6, 2.2], abs=1e-4)
    assert low[2] == 12.0
    assert low[0] > 0.0
    assert high[0] < DEPTH_M
    assert max(abs(low[1]), high[1]) < 8.0


@pytest.mark.parametrize("heading_rad", [0.0, 1.1, -2.4])
def test_a_footprint_holds_the_house_and_its_eaves(heading_rad: float) -> None:
    area = footprint(lot(heading_rad, 8.0))
    assert area.area == pytest.approx((WIDTH_M + 0.8) * (DEPTH_M + 0.8))
    mesh = building(lot(heading_rad, 8.0), np.random.default_rng(1), detailed=False)
    assert all(area.buffer(1e-3).contains(Point(x, y)) for x, y in mesh.vertices_m[:, :2].tolist())
