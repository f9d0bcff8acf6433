import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import box as rectangle
from solids import volume

from siren_ros.sensors.meshes.mesh import (
    SEMANTIC_CLASS_OF_MATERIAL,
    LampColour,
    Material,
    Mesh,
    SemanticClass,
    SignalLamp,
)
from siren_ros.sensors.meshes.solids import box, frustum, sphere_points, triangulated


def test_a_box_has_its_volume_and_outward_normals():
    assert volume(box((1, 2, 3), (2, 4, 6), Material.KERB, (1, 2, 3))) == pytest.approx(6.0)


def test_a_cylinder_has_the_volume_of_its_prism():
    mesh = frustum((1.0, 0.0, 0.0), 3.0, (2.0, 2.0), 12, Material.KERB, (0, 0, 0))
    assert volume(mesh) == pytest.approx(3.0 * 12 * 0.5 * 4.0 * np.sin(2 * np.pi / 12), rel=1e-5)


@given(st.floats(-3.1, 3.1), st.floats(-5, 5))
def test_moving_a_mesh_keeps_its_volume(angle, shift):
    c, s = np.cos(angle), np.sin(angle)
    moved = box((0, 0, 0), (1, 2, 3), Material.KERB, (0, 0, 0)).transformed(
        np.array(((c, -s, 0), (s, c, 0), (0, 0, 1))), (shift, -shift, shift)
    )
    assert volume(moved) == pytest.approx(6.0, rel=1e-4)


def test_a_mirrored_mesh_still_looks_outward():
    assert volume(box((0, 0, 0), (1, 2, 3), Material.KERB, (0, 0, 0)).transformed(np.diag((1, -1, 1)))) > 0


def test_concatenation_keeps_every_triangle_where_it_is():
    one, other = (box((x, 0, 0), (x + 1, 1, 1), Material.KERB, (0, 0, 0)) for x in (0, 5))
    both = Mesh.joined(one, other)
    corners = np.concatenate([m.vertices_m[m.triangles] for m in (one, other)])
    np.testing.assert_array_equal(both.vertices_m[both.triangles], corners)
    assert len(Mesh.joined()) == 0


def test_sphere_triangles_look_outward_and_points_are_on_the_unit_sphere():
    points, faces = sphere_points(2)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0)
    a, b, c = (points[faces[:, k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()
    assert len(faces) == 20 * 16


def test_triangulation_covers_a_polygon_with_a_hole():
    area = rectangle(0, 0, 10, 8) - rectangle(2, 2, 5, 6)
    points, triangles = triangulated(area)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    assert (doubled > 0).all()
    assert doubled.sum() / 2 == pytest.approx(area.area)


def test_every_material_has_a_semantic_class():
    assert [int(m) for m in Material] == list(range(len(Material)))
    assert {SemanticClass(int(c)) for c in SEMANTIC_CLASS_OF_MATERIAL} >= {SemanticClass.ROAD, SemanticClass.CAR}
    assert SEMANTIC_CLASS_OF_MATERIAL[Material.MARKING_WHITE] == SemanticClass.ROAD_LINE


@pytest.mark.parametrize(
    ("letter", "lit"),
    [("r", {"red"}), ("u", {"red", "yellow"}), ("y", {"yellow"}), ("g", {"green"}), ("G", {"green"}), ("O", set())],
)
def test_sumo_letters_light_the_right_lamps(letter, lit):
    lamps = [SignalLamp("C", 1, colour, 0, 1) for colour in LampColour]
    assert {lamp.colour.value for lamp in lamps if lamp.is_lit(f"r{letter}r")} == lit
