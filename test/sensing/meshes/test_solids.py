"""Solids of triangles have their areas and volumes and look outward; outlines of bodies that are refused."""

from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import Polygon
from shapely.geometry import box as rectangle
from solids import areas, open_edges, volume

from siren_ros.sensing.meshes import solids
from siren_ros.sensing.meshes.mesh import Material, Mesh

PLAIN = solids.BodyProfile(
    length_m=4.0, top_m=((0.0, 1.5), (4.0, 1.5)), belt_m=((0.0, 1.0), (4.0, 1.0)),
    bottom_m=((0.0, 0.2), (4.0, 0.2)), half_width_m=((0.0, 0.9), (4.0, 0.9)),
    roof_half_width_m=((0.0, 0.6), (4.0, 0.6)),
)  # fmt: skip


def test_quads_become_two_triangles_and_slivers_none():
    quad = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)], dtype=float)
    sliver = np.array([(0, 0, 1), (1, 0, 1), (1, 0, 1), (0, 0, 1)], dtype=float)
    mesh = solids.from_quads([(quad, (Material.PLATE, (1, 2, 3))), (sliver, (Material.TYRE, (4, 5, 6)))])
    assert (len(mesh), areas(mesh).tolist()) == (2, [1.0, 1.0])
    assert (mesh.normals.tolist(), set(mesh.material.tolist())) == ([[0.0, 0.0, 1.0]] * 2, {Material.PLATE})
    assert len(mesh.vertices_m) == 4
    two = solids.flat_polygons([TRIANGLE, rectangle(20, 0, 21, 1)], 0.0, Material.KERB, GREY)
    assert areas(two).sum() == pytest.approx(7.0)
    assert len(solids.flat_polygons([], 0.0, Material.KERB, GREY)) == 0


@pytest.mark.parametrize(
    "wrong",
    [
        *[{"top_m": ((0.0, 1.5), (2.0, 1.5), (1.0, 1.5), (4.0, 1.5))}, {"belt_m": ((0.0, 1.0), (3.9, 1.0))}],
        *[{"bottom_m": ((-1.0, 0.2), (4.0, 0.2))}, {"belt_m": ((0.0, 1.7), (4.0, 1.0))}],
        *[{"bottom_m": ((0.0, 0.2), (4.0, 1.1))}, {"roof_half_width_m": ((0.0, 0.6), (2.0, 1.6), (4.0, 0.6))}],
    ],
)
def test_outlines_that_cannot_be_a_body_are_refused(wrong):
    """Knots that go back, other lengths, a belt above the roof or below the sill, an overhanging roof."""
    with pytest.raises(ValueError, match="outline"):
        replace(PLAIN, **wrong)


GREY = (1, 2, 3)
TRIANGLE = Polygon([(0.0, 0.0), (4.0, 0.0), (0.0, 3.0)])
RING = rectangle(0, 0, 10, 8) - rectangle(2, 2, 5, 6)


def bounds(mesh):
    return [side.tolist() for side in mesh.bounds_m]


def test_boxes_lie_between_their_corners_and_their_normals_look_out():
    mesh = solids.box((1, 2, 3), (2, 4, 6), Material.KERB, GREY)
    assert (bounds(mesh), open_edges(mesh)) == ([[1, 2, 3], [2, 4, 6]], 0)
    assert areas(mesh).sum() == pytest.approx(2 * (1 * 2 + 2 * 3 + 1 * 3))
    assert (volume(mesh), set(mesh.material.tolist())) == (pytest.approx(6.0), {Material.KERB})
    assert np.unique(mesh.colour_rgb, axis=0).tolist() == [list(GREY)]
    for high in ((0.9, 4.0, 6.0), (2.0, 1.9, 6.0), (2.0, 4.0, 2.9)):
        with pytest.raises(ValueError, match="a box from"):
            solids.box((1.0, 2.0, 3.0), high, Material.KERB, GREY)
    corners = [(0, 0, 0), (4, 0, 0), (4, 2, 0), (0, 2, 0), (0, 1, 1), (4, 1, 1), (4, 1, 1), (0, 1, 1)]
    assert volume(solids.hexahedron(corners, Material.KERB, GREY)) == pytest.approx(4.0)
    two = np.array((corners, corners)) + np.array([[[0.0, 0.0, 0.0]], [[9.0, 0.0, 0.0]]])
    assert volume(solids.hexahedra(two, Material.KERB, GREY)) == pytest.approx(8.0)
    mesh = solids.box((0, 0, 0), (1, 2, 3), Material.KERB, GREY)
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(12))
    outward = mesh.vertices_m[mesh.triangles].mean(axis=1) - (0.5, 1.0, 1.5)
    assert (np.einsum("ij,ij->i", mesh.normals, outward) > 0.1).all()
    assert {tuple(normal) for normal in mesh.normals.tolist()} == {
        tuple(float(sign * (axis == k)) + 0.0 for k in range(3)) for axis in range(3) for sign in (1, -1)
    }
    flat = Mesh.uniform([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)], Material.KERB, GREY)
    assert flat.normals.tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize(("low", "high"), [(2.0, 2.0), (2.0, 1.0), (0.5, 1.5)], ids=["cylinder", "cone", "funnel"])
def test_a_cone_stump_stands_on_its_base(low, high):
    mesh = solids.frustum((1.0, -2.0, 5.0), 3.0, (low, high), 8, Material.KERB, GREY)
    wide = max(low, high)
    corners = np.array([[1 - wide, -2 - wide, 5], [1 + wide, -2 + wide, 8]])
    assert (np.array(bounds(mesh)), open_edges(mesh)) == (pytest.approx(corners, abs=1e-6), 0)
    polygon = 0.5 * 8 * np.sin(2 * np.pi / 8)
    moved = mesh.translated(-1.0, 2.0, -5.0)
    assert volume(moved) == pytest.approx(polygon * 3.0 * (low**2 + low * high + high**2) / 3.0, rel=1e-5)
    top = mesh.vertices_m[mesh.vertices_m[:, 2] > 7.9]
    assert np.hypot(top[:, 0] - 1.0, top[:, 1] + 2.0) == pytest.approx(np.full(8, high), rel=1e-5)


@pytest.mark.parametrize("area", [TRIANGLE, RING, Polygon(list(TRIANGLE.exterior.coords)[::-1])])
def test_flat_faces_look_up(area):
    mesh = solids.flat_polygons([area], 0.25, Material.KERB, GREY)
    assert areas(mesh).sum() == pytest.approx(area.area)
    assert mesh.normals.tolist() == [[0.0, 0.0, 1.0]] * len(mesh)
    assert set(mesh.vertices_m[:, 2].tolist()) == {0.25}


@pytest.mark.parametrize("area", [TRIANGLE, RING, Polygon(list(TRIANGLE.exterior.coords)[::-1])])
def test_walls_look_out_of_their_polygon(area):
    """With floor and roof they make a closed prism."""
    mesh = solids.walls(area, 0.5, 2.0, Material.KERB, GREY)
    assert areas(mesh).sum() == pytest.approx(1.5 * area.length)
    roof = solids.flat_polygons([area], 2.0, Material.KERB, GREY)
    floor = solids.flat_polygons([area], 0.5, Material.KERB, GREY)
    below = Mesh(floor.vertices_m, floor.triangles[:, ::-1].copy(), floor.material, floor.colour_rgb)
    solid = Mesh.joined(mesh, roof, below)
    assert (volume(solid), open_edges(solid)) == (pytest.approx(1.5 * area.area, rel=1e-5), 0)
    assert np.abs(mesh.normals[:, 2]).max() == 0.0


def test_spheres_are_closed_with_points_on_the_unit_sphere_and_look_outward():
    points, faces = solids.sphere_points(1)
    mesh = Mesh.uniform(points, faces, Material.KERB, GREY)
    assert (open_edges(mesh), len(points)) == (0, 42)
    assert 3.5 < volume(mesh) < 4.0 / 3.0 * np.pi
    points, faces = solids.sphere_points(2)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0)
    a, b, c = (points[faces[:, k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()
    assert len(faces) == 20 * 16
