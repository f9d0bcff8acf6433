import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.sensing.camera.occlusion import Horizon
from siren_ros.sensing.camera.vertices import chunks_in_view, index_mesh, visible_triangles
from siren_ros.sensing.meshes.mesh import SEMANTIC_CLASS_OF_MATERIAL, Mesh


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 60))
def test_indexing_keeps_every_triangle_and_its_values(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.integers(-2, 3, (12, 3)).astype(np.float32)
    corners, codes = rng.integers(0, 12, (count, 3)).astype(np.uint32), rng.integers(0, 5, count).astype(np.uint8)
    mesh = Mesh(points, corners, codes, rng.integers(0, 256, (count, 3)).astype(np.uint8))
    indexed = index_mesh(mesh, SEMANTIC_CLASS_OF_MATERIAL)
    corners = indexed.vertices["position"][indexed.triangles]
    original = mesh.vertices_m[mesh.triangles]
    turns = [np.all(np.roll(corners, turn, axis=1) == original, axis=(1, 2)) for turn in range(3)]
    assert np.all(np.any(turns, axis=0))
    last = indexed.vertices[indexed.triangles[:, 2]]
    assert np.array_equal(last["normal_material"][:, 3].astype(np.uint8), mesh.material)
    assert np.array_equal(last["colour"][:, :3], mesh.colour_rgb)
    assert np.array_equal(last["colour"][:, 3], SEMANTIC_CLASS_OF_MATERIAL[mesh.material])
    assert np.allclose(last["normal_material"][:, :3], mesh.normals, atol=1e-3)


def test_a_box_needs_few_vertices(boxes):
    assert len(index_mesh(boxes.box((0, 0, 0), (1, 2, 3)), SEMANTIC_CLASS_OF_MATERIAL).vertices) < 36 / 2


def distances(eye, reach=100.0, planes=()):
    """Of a box from (1, 2, 3) to (4, 6, 8)."""
    low, high = np.array([[1.0, 2.0, 3.0]]), np.array([[4.0, 6.0, 8.0]])
    out = np.empty(1)
    chunks_in_view(low, high, np.array([reach]), np.array(planes, dtype=float).reshape(-1, 4), np.array(eye), out)
    return float(out[0])


@pytest.mark.parametrize(
    ("eye", "distance"),
    [((2.0, 3.0, 4.0), 0.0), ((-2.0, 4.0, 5.0), 3.0), ((7.0, 4.0, 5.0), 3.0), ((2.0, -2.0, 5.0), 4.0),
     ((2.0, 4.0, 13.0), 5.0), ((-2.0, 10.0, 5.0), 5.0), ((7.0, -2.0, 20.0), 13.0)],
)  # fmt: skip
def test_the_distance_is_that_of_the_nearest_point_of_the_box(eye, distance):
    assert distances(eye) == pytest.approx(distance)
    assert np.isinf(distances(eye, reach=distance))


@pytest.mark.parametrize(
    ("normal", "nearest", "farthest"),
    [((1.0, 0.0, 0.0), -3.9, -4.1), ((-1.0, 0.0, 0.0), 1.1, 0.9), ((0.0, 1.0, 1.0), -13.9, -14.1),
     ((0.0, 1.0, -1.0), -2.9, -3.1)],
)  # fmt: skip
def test_a_box_with_a_corner_on_the_visible_side_of_all_planes_is_in_view(normal, nearest, farthest):
    for plane, seen in (((*normal, nearest), True), ((*normal, farthest), False)):
        for planes, in_view in (([plane], seen), ([(0, 0, 1, 0), plane], seen), ([plane, (0, 0, -1, 0)], False)):
            assert np.isfinite(distances((0.0, 0.0, 0.0), planes=planes)) is np.bool_(in_view)


def nothing_hidden(triangles, chunks):
    """Bounding circles of triangles and of chunks, and a horizon without walls."""
    horizon = Horizon(Mesh.joined())
    horizon.look_from(np.zeros(3), 0.0, 450.0)
    return np.zeros((triangles, 5), np.float32), np.zeros((chunks, 5), np.float32), horizon.slopes


def shown(normal, corner, eye, area=1.0, distance=5.0, smallest=0.0):
    """Whether a triangle of a plane with a normal through a corner is copied."""
    normal = np.array(normal, dtype=float) / np.linalg.norm(normal)
    planes = np.array([[*normal, normal @ np.array(corner)]], np.float32)
    out = np.zeros((1, 3), np.uint32)
    chunk = (np.array([0]), np.array([0]), np.array([0, 1]), np.array([distance]))
    sizes, eye, counts = np.array([area], np.float32), np.array(eye, dtype=float), np.zeros(1, np.int64)
    triangle = np.array([[4, 5, 6]], np.uint32)
    count = visible_triangles(*chunk, planes, sizes, triangle, *nothing_hidden(1, 1), eye, smallest, out, counts)
    assert count in {0, 1}
    assert counts.tolist() == [count]
    assert out[0].tolist() == ([4, 5, 6] if count else [0, 0, 0])
    return bool(count)


@pytest.mark.parametrize("normal", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, -2.0, 0.5)])
def test_a_triangle_is_seen_from_the_side_of_its_normal(normal):
    corner = np.array([3.0, -4.0, 2.0])
    towards = np.array(normal) / np.linalg.norm(normal)
    assert shown(normal, corner, corner + 0.5 * towards)
    assert not shown(normal, corner, corner - 0.5 * towards)


@pytest.mark.parametrize(("smallest", "seen"), [(0.9, True), (1.1, False)])
def test_a_triangle_is_left_out_below_a_solid_angle(smallest, seen):
    """An area of 4 m² whose plane lies 2 m below the eye, 10 m away: 8 / 1000 steradians."""
    assert shown((0, 0, 1), (0, 0, 0), (0, 0, 2), area=4.0, distance=10.0, smallest=0.008 * smallest) is seen


def test_triangles_of_several_chunks_are_copied_in_the_order_of_the_draws():
    planes = np.array([[0, 0, 1, 0], [0, 0, -1, 0], [0, 0, 1, 0], [0, 0, 1, 0]], np.float32)
    triangles = np.arange(12, dtype=np.uint32).reshape(4, 3)
    out = np.zeros((4, 3), np.uint32)
    eye, counts = np.array([0.0, 0.0, 1.0]), np.zeros(3, np.int64)
    for draws, order, drawn in (([2, 2], [2, 3, 0], [0, 0, 3]), ([1, 0], [0, 2, 3], [1, 2, 0])):
        chunks = (np.array([1, 0]), np.array(draws), np.array([0, 2, 4]), np.ones(2))
        sizes = planes, np.ones(4, np.float32), triangles
        count = visible_triangles(*chunks, *sizes, *nothing_hidden(4, 2), eye, 0.0, out, counts)
        assert out[:count].tolist() == triangles[order].tolist()
        assert counts.tolist() == drawn
