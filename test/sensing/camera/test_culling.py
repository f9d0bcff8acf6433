"""A wall hides what stands behind it and nothing else; vertices are shared, and triangles out of view are left out."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.sensing.camera.culling import (
    Horizon,
    bounding_circles,
    chunks_in_view,
    index_mesh,
    standing_walls,
    visible_triangles,
)
from siren_ros.sensing.meshes.mesh import SEMANTIC_CLASS_OF_MATERIAL, Material, Mesh
from siren_ros.sensing.meshes.solids import box

EYE = np.array([0.0, 0.0, 1.5])


def house(low, high, material=Material.BUILDING_WALL):
    return box(low, high, material, (200, 200, 200))


def hidden(scene, low, high, eye=EYE, smallest=0.0, reach_m=450.0):
    horizon = Horizon(scene)
    horizon.look_from(eye, smallest, reach_m)
    circles = bounding_circles(np.array([low], dtype=float), np.array([high], dtype=float))
    return not horizon.visible(eye, circles)[0]


HOUSE = house((20.0, -10.0, 0.0), (30.0, 10.0, 9.0))


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        pytest.param((50, -1, 0), (52, 1, 2), True, id="behind"),
        pytest.param((50, -1, 0), (52, 1, 30), False, id="higher than the wall's shadow"),
        pytest.param((50, -1, 0), (52, 1, 19), True, id="just below the wall's shadow"),
        pytest.param((50, 19, 0), (52, 21, 2), True, id="behind its end"),
        pytest.param((50, 26, 0), (52, 28, 2), False, id="beside"),
        pytest.param((10, -1, 0), (12, 1, 2), False, id="before"),
        pytest.param((-52, -1, 0), (-50, 1, 2), False, id="on the other side of the eye"),
        pytest.param((50, -1, -1), (52, 1, 2), False, id="lower than the wall"),
        pytest.param((19.9, -1, 1), (19.95, 1, 2), False, id="on the wall"),
    ],
)
def test_a_house_hides_what_stands_behind_it(low, high, expected):
    assert hidden(HOUSE, low, high) is expected


def test_only_walls_that_stand_on_the_ground_and_are_drawn_hide():
    behind = (50, -1, 0), (52, 1, 2)
    assert hidden(HOUSE, *behind)
    assert not hidden(house((20.0, -10.0, 0.1), (30.0, 10.0, 9.0)), *behind)
    assert not hidden(house((20.0, -10.0, 0.0), (30.0, 10.0, 9.0), Material.BUILDING_GLASS), *behind)
    assert not hidden(HOUSE, *behind, reach_m=20.0)
    assert not hidden(HOUSE, *behind, smallest=1.0)
    assert not hidden(Mesh.joined(), *behind)
    walls = standing_walls(HOUSE)
    assert sorted(walls[:, 7].tolist()) == pytest.approx([90.0, 90.0, 180.0, 180.0])
    assert walls[:, 6].tolist() == pytest.approx([9.0] * 4)
    assert {tuple(np.round(n).astype(int)) for n in walls[:, 4:6]} == {(1, 0), (-1, 0), (0, 1), (0, -1)}


def crosses(eye, points, walls):
    """Whether the line from the eye to each point goes through a wall, shape (N,)."""
    through = np.zeros(len(points), bool)
    for x0, y0, x1, y1, nx, ny, top, _ in walls:
        normal, foot = np.array([nx, ny]), np.array([x0, y0])
        own, other = (eye[:2] - foot) @ normal, (points[:, :2] - foot) @ normal
        share = own / np.where(own == other, np.inf, own - other)
        at = eye + share[:, None] * (points - eye)
        along = (at[:, :2] - foot) @ np.array([x1 - x0, y1 - y0]) / ((x1 - x0) ** 2 + (y1 - y0) ** 2)
        within = (along >= 0.0) & (along <= 1.0) & (at[:, 2] <= top) & (at[:, 2] >= 0.0)
        through |= (own > 0.0) & (share > 0.0) & (share < 1.0) & within
    return through


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 100_000))
def test_no_line_of_sight_leads_to_what_is_hidden(seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-150.0, 150.0, (25, 2))
    houses = []
    for x, y in corners[np.abs(corners).max(axis=1) > 20.0]:
        width, depth, height = rng.uniform(5.0, 40.0), rng.uniform(5.0, 15.0), rng.uniform(2.0, 20.0)
        houses.append(house((x, y, 0.0), (x + width, y + depth, height)))
    scene = Mesh.joined(*houses)
    eye = np.array([0.0, 0.0, rng.uniform(0.5, 8.0)])
    horizon = Horizon(scene)
    horizon.look_from(eye, 0.0, 450.0)
    low = np.column_stack((rng.uniform(-200.0, 200.0, (300, 2)), rng.uniform(0.0, 3.0, 300)))
    high = low + rng.uniform(0.1, 4.0, (300, 3))
    visible = horizon.visible(eye, bounding_circles(low, high))
    inside = low[:, None] + (high - low)[:, None] * rng.random((300, 8, 3))
    walls = standing_walls(scene)
    for points in inside[~visible]:
        assert crosses(eye, points, walls).all()


@settings(max_examples=20, deadline=None)
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
    assert len(index_mesh(HOUSE, SEMANTIC_CLASS_OF_MATERIAL).vertices) < 36 / 2
    last = indexed.vertices[indexed.triangles[:, 2]]
    assert np.array_equal(last["normal_material"][:, 3].astype(np.uint8), mesh.material)
    assert np.array_equal(last["colour"][:, :3], mesh.colour_rgb)
    assert np.array_equal(last["colour"][:, 3], SEMANTIC_CLASS_OF_MATERIAL[mesh.material])
    assert np.allclose(last["normal_material"][:, :3], mesh.normals, atol=1e-3)


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
    # An area of 4 m² whose plane lies 2 m below the eye, 10 m away: 8 / 1000 steradians.
    for smallest, seen in ((0.0072, True), (0.0088, False)):
        assert shown((0, 0, 1), (0, 0, 0), (0, 0, 2), area=4.0, distance=10.0, smallest=smallest) is seen


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
