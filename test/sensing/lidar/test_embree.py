"""Rays cast in packets find what Open3D's ray caster finds, whatever their order."""

import subprocess
import sys
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.sensing.lidar.embree import RayHits, ThreadPool, TriangleTree, tiles

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
TRIANGLE = np.array([[0, 1, 2]])


def soup(count, rng):
    """Triangles at random."""
    vertices = rng.uniform(-10.0, 10.0, (3 * count, 3)).astype(np.float32)
    return vertices, np.arange(3 * count, dtype=np.uint32).reshape(-1, 3)


@given(seed=st.integers(0, 1000), triangles=st.integers(1, 60), count=st.integers(0, 100))
@settings(max_examples=30, deadline=None, derandomize=True)
def test_hits_are_those_of_open3d(seed, triangles, count):
    rng = np.random.default_rng(seed)
    mesh = soup(triangles, rng)
    rays = rng.uniform(-1.0, 1.0, (count, 6)).astype(np.float32)
    ours = TriangleTree([mesh]).cast(rays)
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor.from_numpy(mesh[0]), o3d.core.Tensor.from_numpy(mesh[1]))
    theirs = scene.cast_rays(o3d.core.Tensor.from_numpy(rays))
    np.testing.assert_allclose(ours.distance, theirs["t_hit"].numpy(), rtol=1e-3, atol=1e-3)
    hit = np.isfinite(ours.distance)
    np.testing.assert_array_equal(ours.triangle[hit], theirs["primitive_ids"].numpy()[hit])
    unit = ours.normal[hit] / np.linalg.norm(ours.normal[hit], axis=1, keepdims=True)
    np.testing.assert_allclose(unit, theirs["primitive_normals"].numpy()[hit], atol=1e-3)


def test_distance_is_in_units_of_the_direction_and_triangles_are_counted_within_each_mesh():
    tree = TriangleTree([(VERTICES, TRIANGLE)])
    hits = tree.cast(np.array([[0.2, 0.2, -1, 0, 0, 2], [0.2, 0.2, 3, 0, 0, -1], [2, 2, -1, 0, 0, 1]], np.float32))
    np.testing.assert_allclose(hits.distance, [0.5, 3.0, np.inf], rtol=2.0**-23)  # processors differ in the last bit
    assert np.isinf(TriangleTree([]).cast(np.ones((20, 6), np.float32)).distance).all()
    behind = np.concatenate((VERTICES, VERTICES + np.float32(5.0)))
    tree = TriangleTree([(VERTICES + np.float32(5.0), TRIANGLE), (behind, np.array([[3, 4, 5], [0, 1, 2]]))])
    hits = tree.cast(np.array([[0.2, 0.2, -1, 0, 0, 1], [5.2, 5.2, 0, 0, 0, 1]], np.float32))
    assert hits.triangle.tolist() == [1, 0]


def test_order_and_the_room_given_change_nothing():
    rng = np.random.default_rng(3)
    tree = TriangleTree([soup(40, rng)])
    rays = rng.uniform(-1.0, 1.0, (10 * 7, 6)).astype(np.float32)
    plain, room = tree.cast(rays), RayHits.for_rays(len(rays))
    for order in (tiles(10, 7), tiles(7, 10, 3), rng.permutation(70).astype(np.int32)):
        room.distance.fill(-1.0)
        assert tree.cast(rays, room, order) is room
        np.testing.assert_array_equal(room.distance, plain.distance)
        hit = np.isfinite(plain.distance)
        np.testing.assert_array_equal(room.triangle[hit], plain.triangle[hit])


@pytest.mark.parametrize(("columns", "rows", "side"), [(8, 8, 4), (10, 7, 4), (1, 5, 4), (3, 3, 1)])
def test_tiles_visit_each_ray_once_and_keep_neighbours_together(columns, rows, side):
    order = tiles(columns, rows, side)
    assert sorted(order.tolist()) == list(range(columns * rows))
    first = order[: min(columns, side) * min(rows, side)]
    assert set((first // rows).tolist()) == set(range(min(columns, side)))
    assert set((first % rows).tolist()) == set(range(min(rows, side)))


_WITH_PACKETS_OF = """
import sys
import numpy as np
from siren_ros.sensing.lidar import embree

embree._NATIVE = {int(sys.argv[1]): embree._NATIVE[int(sys.argv[1])]}
rng = np.random.default_rng(5)
soup = rng.uniform(-5.0, 5.0, (90, 3)).astype(np.float32)
rays = rng.normal(size=(101, 6)).astype(np.float32)
hits = embree.TriangleTree([(soup, np.arange(90).reshape(-1, 3))]).cast(rays)
assert embree._lanes() == int(sys.argv[1])
met = np.isfinite(hits.distance)
np.save(sys.argv[2], np.column_stack((hits.distance, np.where(met, hits.triangle, 0))))
"""


def test_packets_of_every_width_find_the_same(tmp_path):
    files = {lanes: tmp_path / f"{lanes}.npy" for lanes in (4, 8, 16)}
    programs = [
        subprocess.Popen([sys.executable, "-c", _WITH_PACKETS_OF, str(lanes), str(file)])
        for lanes, file in files.items()
    ]
    assert [program.wait() for program in programs] == [0, 0, 0]
    hits_by_width = [np.load(file) for file in files.values()]
    assert 10 < np.isfinite(hits_by_width[0][:, 0]).sum() < 101
    for other in hits_by_width[1:]:
        np.testing.assert_array_equal(other[:, 1], hits_by_width[0][:, 1])
        np.testing.assert_allclose(other[:, 0], hits_by_width[0][:, 0], rtol=1e-5)


@given(size=st.integers(0, 4), count=st.integers(0, 200), grain=st.integers(1, 50))
@settings(max_examples=40, deadline=None)
def test_every_index_is_done_once(size, count, grain):
    done = np.zeros(count, np.int64)
    workers = set()

    def work(worker, first, end):
        assert end - first <= grain
        done[first:end] += 1
        workers.add(worker)

    ThreadPool(size).run(work, count, grain)
    assert (done == 1).all()
    assert workers <= set(range(max(1, size)))


def test_each_worker_has_a_thread_of_its_own_and_the_caller_is_one():
    all_started = threading.Barrier(3)
    threads: dict[int, str] = {}

    def work(worker, first, end):
        assert end == first + 1
        threads[worker] = threading.current_thread().name
        all_started.wait(10.0)

    ThreadPool(3).run(work, 3, 1)
    assert (sorted(threads), len(set(threads.values()))) == ([0, 1, 2], 3)
    assert threads[0] == threading.current_thread().name
    alone = []
    ThreadPool(4).run(lambda _worker, _first, _end: alone.append(threading.current_thread()), 10, 10)
    assert alone == [threading.current_thread()]


@pytest.mark.parametrize("failing", [0, 1])
def test_an_error_of_any_worker_reaches_the_caller(failing):
    both = threading.Barrier(2)

    def work(worker, first, end):
        assert end == first + 1
        both.wait(10.0)
        if worker == failing:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        ThreadPool(2).run(work, 2, 1)
