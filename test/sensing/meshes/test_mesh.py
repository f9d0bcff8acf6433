import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solids import volume

from siren_ros.sensing.meshes.mesh import (
    SEMANTIC_CLASS_OF_MATERIAL,
    LampColour,
    Material,
    Mesh,
    SemanticClass,
    SignalLamp,
)
from siren_ros.sensing.meshes.solids import box


@given(st.floats(-3.1, 3.1), st.floats(-5, 5))
def test_moving_a_mesh_keeps_its_volume(angle, shift):
    c, s = np.cos(angle), np.sin(angle)
    turn, box_ = np.array(((c, -s, 0), (s, c, 0), (0, 0, 1))), box((0, 0, 0), (1, 2, 3), Material.KERB, (0, 0, 0))
    for matrix in (turn, turn @ np.diag((1.0, -1.0, 1.0))):  # a mirrored mesh still looks outward
        moved = box_.transformed(matrix, (shift, -shift, shift))
        assert volume(moved) == pytest.approx(6.0, rel=1e-4)
        corners = box_.vertices_m @ matrix.T + (shift, -shift, shift)
        np.testing.assert_allclose(moved.vertices_m, corners, atol=1e-5)
        onward = moved.translated(3.0, -2.0, 5.0).vertices_m - moved.vertices_m
        np.testing.assert_allclose(onward, np.tile((3.0, -2.0, 5.0), (8, 1)), atol=1e-5)


def test_concatenation_keeps_every_triangle_where_it_is():
    left, right = (box((x, 0, 0), (x + 1, 1, 1), Material.KERB, (0, 0, 0)) for x in (0, 5))
    both = Mesh.joined(left, right)
    corners = np.concatenate([m.vertices_m[m.triangles] for m in (left, right)])
    np.testing.assert_array_equal(both.vertices_m[both.triangles], corners)
    assert len(Mesh.joined()) == 0


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
