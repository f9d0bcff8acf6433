"""The scene as ray casting needs it: static triangles in one tree, each vehicle class's shape in another.

A vehicle moves by casting rays in its own frame, so nothing is rebuilt between steps.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import open3d as o3d

from siren_ros.sensors.scene.material import SEMANTIC_CLASS_OF_MATERIAL, semantic_class_of_actor
from siren_ros.sensors.scene.mesh import Mesh, StaticScene, VehicleShape
from siren_ros.world.actors import ActorClass

SHAPE_SPACING_M: Final = 1024.0
"""Distance between the classes' shapes in their common tree. A power of two, so that shifting a ray adds no rounding
beyond float32's, and more than twice any sensor's range, so that a ray aimed at one shape meets no other within it."""
_SHAPES_PER_ROW: Final = 4

Floats = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RayHits:
    """What a bundle of N rays hit first."""

    distance: Floats
    """In units of the ray's direction; infinite where nothing was hit; shape ``(N,)``."""
    triangle: npt.NDArray[np.uint32]
    """Index of the triangle within its geometry, shape ``(N,)``."""
    geometry: npt.NDArray[np.uint32]
    normal: Floats
    """Unit normal of the triangle, shape ``(N, 3)``."""


class RaycastWorld:
    """Static scene and vehicle shapes, ready for rays."""

    def __init__(self, static: StaticScene, shapes: Mapping[ActorClass, VehicleShape], threads: int = 0) -> None:
        """Build both trees; ``threads`` 0 lets the ray caster use all cores."""
        self._threads = threads
        self._static = o3d.t.geometry.RaycastingScene(nthreads=threads)
        _add(self._static, static.mesh)
        self.static_material = static.mesh.material
        self.classes = tuple(sorted(shapes))
        self._shapes = o3d.t.geometry.RaycastingScene(nthreads=threads)
        meshes = [shapes[actor_class].at_rest for actor_class in self.classes]
        columns = np.array([[i % _SHAPES_PER_ROW, i // _SHAPES_PER_ROW, 0] for i in range(len(self.classes))])
        self.shape_offset_m = (columns.reshape(-1, 3) * SHAPE_SPACING_M).astype(np.float32)
        for mesh, offset in zip(meshes, self.shape_offset_m, strict=True):
            _add(self._shapes, mesh.translated(*(float(value) for value in offset)))
        self.shape_bounds_m = np.array([mesh.bounds_m for mesh in meshes], dtype=np.float32).reshape(-1, 2, 3)
        """Lowest and highest corner of each shape in its own frame, shape ``(classes, 2, 3)``."""
        self.shape_start = np.concatenate(([0], np.cumsum([len(mesh) for mesh in meshes]))).astype(np.int64)
        """First triangle of each shape in ``shape_material``, shape ``(classes + 1,)``."""
        self.shape_material = np.concatenate([np.empty(0, np.uint8), *(mesh.material for mesh in meshes)])
        self.static_semantic = SEMANTIC_CLASS_OF_MATERIAL
        self.shape_semantic = np.array([int(semantic_class_of_actor(c)) for c in self.classes], dtype=np.uint8)
        self._row_of_class = np.full(max((int(c) for c in ActorClass), default=0) + 1, -1, dtype=np.int32)
        self._row_of_class[[int(c) for c in self.classes]] = np.arange(len(self.classes))
        self.cast_static(np.zeros((1, 6), np.float32))
        self.cast_shapes(np.zeros((1, 6), np.float32))

    def shape_rows(self, actor_class: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
        """Row of each actor's shape in the ``shape_*`` arrays, shape of ``actor_class``."""
        return self._row_of_class[actor_class]

    def cast_static(self, rays: Floats) -> RayHits:
        """Cast rays (origin and direction, shape ``(N, 6)``, ``map`` frame) at what does not move."""
        return _cast(self._static, rays, self._threads)

    def cast_shapes(self, rays: Floats) -> RayHits:
        """Cast rays at the shapes, given in a shape's own frame plus its ``shape_offset_m``, shape ``(N, 6)``."""
        return _cast(self._shapes, rays, self._threads)


def _add(scene: Any, mesh: Mesh) -> None:
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.vertices_m)),
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.triangles)),
    )


def _cast(scene: Any, rays: Floats, threads: int) -> RayHits:
    hits = scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=threads)
    return RayHits(
        distance=hits["t_hit"].numpy(),
        triangle=hits["primitive_ids"].numpy(),
        geometry=hits["geometry_ids"].numpy(),
        normal=hits["primitive_normals"].numpy(),
    )
