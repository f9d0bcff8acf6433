from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.sensors.camera.geometry.vertices import index_mesh
from siren_ros.sensors.meshes.material import SEMANTIC_CLASS_OF_MATERIAL
from siren_ros.sensors.meshes.mesh import Mesh


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 60))
def test_indexing_keeps_every_triangle_and_its_values(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(-2, 3, (12, 3)).astype(np.float32)
    mesh = Mesh(
        points,
        rng.integers(0, 12, (count, 3)).astype(np.uint32),
        rng.integers(0, 5, count).astype(np.uint8),
        rng.integers(0, 256, (count, 3)).astype(np.uint8),
    )
    indexed = index_mesh(mesh, SEMANTIC_CLASS_OF_MATERIAL)
    corners = indexed.vertices["position"][indexed.triangles]
    wanted = mesh.vertices_m[mesh.triangles]
    turns = [np.all(np.roll(corners, turn, axis=1) == wanted, axis=(1, 2)) for turn in range(3)]
    assert np.all(np.any(turns, axis=0))
    last = indexed.vertices[indexed.triangles[:, 2]]
    assert np.array_equal(last["normal_material"][:, 3].astype(np.uint8), mesh.material)
    assert np.array_equal(last["colour"][:, :3], mesh.colour_rgb)
    assert np.array_equal(last["colour"][:, 3], SEMANTIC_CLASS_OF_MATERIAL[mesh.material])
    assert np.allclose(last["normal_material"][:, :3], mesh.normals, atol=1e-3)


def test_a_box_needs_few_vertices(boxes: Any) -> None:
    assert len(index_mesh(boxes.box((0, 0, 0), (1, 2, 3)), SEMANTIC_CLASS_OF_MATERIAL).vertices) < 36 / 2
