"""The ground's triangles: heights and materials at places of a small crossing, areas without gaps."""

import numpy as np
import pytest
import shapely
from hand_made_record import crossing
from shapely.geometry import Polygon

from siren_ros.roads.road_network import RoadNetwork
from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh
from siren_ros.sensors.scene.config import SceneConfig
from siren_ros.sensors.scene.ground import _cut, ground_mesh
from siren_ros.sensors.scene.markings import road_markings
from siren_ros.sensors.scene.surfaces import Surfaces, drawn_centres, road_surfaces

CONFIG = SceneConfig(ground_margin_m=20.0, tile_m=40.0)
TOP_M = CONFIG.kerb_height_m


def ground_of(network: RoadNetwork) -> tuple[Surfaces, Mesh]:
    centres = drawn_centres(network, 0.0)
    surfaces = road_surfaces(network, centres, CONFIG)
    return surfaces, ground_mesh(surfaces, road_markings(network, centres, surfaces, CONFIG), CONFIG)


BARE = ground_of(crossing())
"""Without sidewalks, with a verge."""


def triangles(mesh: Mesh) -> np.ndarray:
    return np.asarray(mesh.vertices_m[mesh.triangles], dtype=np.float64)


def surface_at(mesh: Mesh, x_m: float, y_m: float) -> tuple[float, Material]:
    """Height and material of the topmost level triangle over a place."""
    corners = triangles(mesh)
    level = np.ptp(corners[:, :, 2], axis=1) < 1e-6
    there = [
        (float(corners[row, 0, 2]), Material(int(mesh.material[row])))
        for row in np.flatnonzero(level).tolist()
        if shapely.contains_xy(Polygon(corners[row, :, :2]).buffer(1e-6), x_m, y_m)
    ]
    return max(there)


@pytest.mark.parametrize(
    ("place", "material"),
    [
        ((5.25, -70.0), Material.ASPHALT),
        ((8.25, -70.0), Material.SHOULDER_ASPHALT),
        ((5.25, -5.0), Material.ASPHALT),
        ((3.5, -30.0), Material.MARKING_WHITE),
        ((0.15, -70.0), Material.MARKING_YELLOW),
        ((-60.0, -8.0), Material.GROUND),
        ((-60.0, 60.0), Material.GRASS),
    ],
)
def test_every_region_is_plane_and_has_its_material(place: tuple[float, float], material: Material) -> None:
    assert surface_at(BARE[1], *place) == (pytest.approx(0.0), material)


def test_sidewalks_stand_a_kerb_above_the_road(network: RoadNetwork) -> None:
    """The legs of this crossing have 7 m of lanes, 2 m of shoulder and 2.5 m of sidewalk on each side."""
    _, mesh = ground_of(network)
    assert surface_at(mesh, 60.0, 10.5) == (pytest.approx(TOP_M), Material.SIDEWALK)
    assert surface_at(mesh, 60.0, 9.07) == (pytest.approx(TOP_M), Material.KERB)
    assert surface_at(mesh, 60.0, 8.0) == (pytest.approx(0.0), Material.SHOULDER_ASPHALT)
    assert surface_at(mesh, 60.0, 12.0) == (pytest.approx(0.0), Material.GRASS)
    upright = np.ptp(triangles(mesh)[:, :, 2], axis=1) > 1e-6
    assert set(mesh.material[upright].tolist()) == {int(Material.KERB)}
    heights = triangles(mesh)[upright][:, :, 2]
    assert (heights.min(), heights.max()) == (pytest.approx(0.0), pytest.approx(TOP_M))


def test_the_land_is_covered_once_with_a_plane_below() -> None:
    """The lanes reach from −110 to 120 m and from −120 to 110 m; the margin is 20 m."""
    surfaces, mesh = BARE
    assert surfaces.bounds_m == (-110.0, -120.0, 120.0, 110.0)
    corners = triangles(mesh)
    side = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.abs(side[:, 2])
    below = corners[:, 0, 2] < -0.01
    assert corners[below, 0, 2] == pytest.approx(-0.05)
    assert area[below].sum() == pytest.approx(270.0 * 270.0)
    assert area[~below].sum() == pytest.approx(270.0 * 270.0, rel=1e-6)
    assert corners[:, :, 0].min() == pytest.approx(-130.0)
    assert corners[:, :, 1].max() == pytest.approx(130.0)
    assert (side[:, 2] > -1e-6).all(), "seen from above"


def test_areas_are_cut_along_a_grid_without_loss() -> None:
    area = Polygon([(-5.0, 1.0), (25.0, 1.0), (25.0, 19.0), (12.0, 31.0), (-5.0, 19.0)])
    tiles = _cut(area, 10.0)
    assert shapely.union_all(tiles).symmetric_difference(area).area < 1e-9
    assert sum(tile.area for tile in tiles) == pytest.approx(area.area)
    for tile in tiles:
        low_x, low_y, high_x, high_y = tile.bounds
        assert np.floor(low_x / 10.0) == np.floor((high_x - 1e-9) / 10.0)
        assert np.floor(low_y / 10.0) == np.floor((high_y - 1e-9) / 10.0)
    # By columns from the west: up to 22.5 m, 29.6 m, 31 m and 23.6 m.
    assert len(tiles) == 3 + 3 + 4 + 3
    inside = Polygon([(1.0, 1.0), (9.0, 1.0), (9.0, 9.0)])
    assert _cut(inside, 10.0) == [inside]
