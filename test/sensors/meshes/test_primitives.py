"""Small solids: bounds, volumes, closed surfaces and directions, in closed form."""

import numpy as np
import pytest
from shapely.geometry import Polygon
from shapely.geometry import box as rectangle
from solids import areas, open_edges, volume

from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh
from siren_ros.sensors.meshes.primitives import (
    box,
    flat_polygons,
    frustum,
    hexahedron,
    sphere_points,
    triangulated,
    walls,
)

GREY = (1, 2, 3)
TRIANGLE = Polygon([(0.0, 0.0), (4.0, 0.0), (0.0, 3.0)])
RING = rectangle(0, 0, 10, 8) - rectangle(2, 2, 5, 6)


def bounds(mesh: Mesh) -> list[list[float]]:
    return [side.tolist() for side in mesh.bounds_m]


def test_a_box_lies_between_its_corners() -> None:
    mesh = box((1, 2, 3), (2, 4, 6), Material.KERB, GREY)
    assert bounds(mesh) == [[1, 2, 3], [2, 4, 6]]
    assert open_edges(mesh) == 0
    assert areas(mesh).sum() == pytest.approx(2 * (1 * 2 + 2 * 3 + 1 * 3))
    assert set(mesh.material.tolist()) == {Material.KERB}
    assert np.unique(mesh.colour_rgb, axis=0).tolist() == [list(GREY)]


@pytest.mark.parametrize("high", [(0.9, 4.0, 6.0), (2.0, 1.9, 6.0), (2.0, 4.0, 2.9)])
def test_a_box_is_not_turned_inside_out(high: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="a box from"):
        box((1.0, 2.0, 3.0), high, Material.KERB, GREY)


def test_a_box_with_free_corners_may_be_a_roof() -> None:
    """A base of 4 m by 2 m below a ridge of 4 m in the middle, 1 m above."""
    corners = [(0, 0, 0), (4, 0, 0), (4, 2, 0), (0, 2, 0), (0, 1, 1), (4, 1, 1), (4, 1, 1), (0, 1, 1)]
    mesh = hexahedron(corners, Material.KERB, GREY)
    assert volume(mesh) == pytest.approx(4.0)


@pytest.mark.parametrize(("low", "high"), [(2.0, 2.0), (2.0, 1.0), (0.5, 1.5)])
def test_a_cone_stump_stands_on_its_base(low: float, high: float) -> None:
    mesh = frustum((1.0, -2.0, 5.0), 3.0, (low, high), 8, Material.KERB, GREY)
    wide = max(low, high)
    assert np.array(bounds(mesh)) == pytest.approx(
        np.array([[1 - wide, -2 - wide, 5], [1 + wide, -2 + wide, 8]]), abs=1e-6
    )
    assert open_edges(mesh) == 0
    polygon = 0.5 * 8 * np.sin(2 * np.pi / 8)
    moved = mesh.translated(-1.0, 2.0, -5.0)
    assert volume(moved) == pytest.approx(polygon * 3.0 * (low**2 + low * high + high**2) / 3.0, rel=1e-5)
    top = mesh.vertices_m[mesh.vertices_m[:, 2] > 7.9]
    assert np.hypot(top[:, 0] - 1.0, top[:, 1] + 2.0) == pytest.approx(np.full(8, high), rel=1e-5)


@pytest.mark.parametrize("area", [TRIANGLE, RING, Polygon(list(TRIANGLE.exterior.coords)[::-1])])
def test_flat_faces_look_up(area: Polygon) -> None:
    mesh = flat_polygons([area], 0.25, Material.KERB, GREY)
    assert areas(mesh).sum() == pytest.approx(area.area)
    assert mesh.normals.tolist() == [[0.0, 0.0, 1.0]] * len(mesh)
    assert set(mesh.vertices_m[:, 2].tolist()) == {0.25}


def test_several_areas_and_none() -> None:
    mesh = flat_polygons([TRIANGLE, rectangle(20, 0, 21, 1)], 0.0, Material.KERB, GREY)
    assert areas(mesh).sum() == pytest.approx(7.0)
    assert len(flat_polygons([], 0.0, Material.KERB, GREY)) == 0


def test_triangles_run_counter_clockwise_from_above() -> None:
    for area in (TRIANGLE, RING):
        points, triangles = triangulated(area)
        a, b, c = (points[triangles[:, k]] for k in range(3))
        doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
        assert (doubled > 0).all()
        assert doubled.sum() / 2 == pytest.approx(area.area)


@pytest.mark.parametrize("area", [TRIANGLE, RING, Polygon(list(TRIANGLE.exterior.coords)[::-1])])
def test_walls_look_out_of_their_polygon(area: Polygon) -> None:
    """With floor and roof they make a closed prism."""
    mesh = walls(area, 0.5, 2.0, Material.KERB, GREY)
    assert areas(mesh).sum() == pytest.approx(1.5 * area.length)
    roof = flat_polygons([area], 2.0, Material.KERB, GREY)
    floor = flat_polygons([area], 0.5, Material.KERB, GREY)
    below = Mesh(floor.vertices_m, floor.triangles[:, ::-1].copy(), floor.material, floor.colour_rgb)
    solid = Mesh.concatenate([mesh, roof, below])
    assert volume(solid) == pytest.approx(1.5 * area.area, rel=1e-5)
    assert open_edges(solid) == 0
    assert np.abs(mesh.normals[:, 2]).max() == 0.0


def test_spheres_are_closed() -> None:
    points, faces = sphere_points(1)
    mesh = Mesh.uniform(points, faces, Material.KERB, GREY)
    assert open_edges(mesh) == 0
    assert len(points) == 42
    assert 3.5 < volume(mesh) < 4.0 / 3.0 * np.pi


def test_normals_are_unit_and_look_out() -> None:
    mesh = box((0, 0, 0), (1, 2, 3), Material.KERB, GREY)
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(12))
    outward = mesh.vertices_m[mesh.triangles].mean(axis=1) - (0.5, 1.0, 1.5)
    assert (np.einsum("ij,ij->i", mesh.normals, outward) > 0.1).all()
    assert {tuple(normal) for normal in mesh.normals.tolist()} == {
        tuple(float(sign * (axis == k)) + 0.0 for k in range(3)) for axis in range(3) for sign in (1, -1)
    }
    flat = Mesh.uniform([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)], Material.KERB, GREY)
    assert flat.normals.tolist() == [[0.0, 0.0, 0.0]]
