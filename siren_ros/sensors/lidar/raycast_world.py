"""The scene as ray casting needs it: static triangles in one tree, each vehicle class's shape in another.

A vehicle moves by casting rays in its own frame, so nothing is rebuilt between steps.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats32
from siren_ros.sensors.lidar.embree import PacketTree, RayHits, TriangleTree
from siren_ros.sensors.meshes.mesh import StaticScene, VehicleShape
from siren_ros.world.actors import ActorClass

SHAPE_SPACING_M: Final = 1024.0
"""Distance between the classes' shapes in their common tree. A power of two, so that shifting a ray adds no rounding
beyond float32's, and more than twice any sensor's range, so that a ray aimed at one shape meets no other within it."""
_SHAPES_PER_ROW: Final = 4


class RaycastWorld:
    """Static scene and vehicle shapes, ready for rays."""

    def __init__(self, static: StaticScene, shapes: Mapping[ActorClass, VehicleShape]) -> None:
        """Build both trees."""
        self._static = TriangleTree([(static.mesh.vertices_m, static.mesh.triangles)])
        self.static_material = static.mesh.material
        self.classes = tuple(sorted(shapes))
        meshes = [shapes[actor_class].at_rest for actor_class in self.classes]
        columns = np.array([[i % _SHAPES_PER_ROW, i // _SHAPES_PER_ROW, 0] for i in range(len(self.classes))])
        self.shape_offset_m = (columns.reshape(-1, 3) * SHAPE_SPACING_M).astype(np.float32)
        placed = zip(meshes, self.shape_offset_m, strict=True)
        self._shapes = TriangleTree([(mesh.vertices_m + offset, mesh.triangles) for mesh, offset in placed])
        self.shape_bounds_m = np.array([mesh.bounds_m for mesh in meshes], dtype=np.float32).reshape(-1, 2, 3)
        """Lowest and highest corner of each shape in its own frame, shape ``(classes, 2, 3)``."""
        self.shape_start = np.concatenate(([0], np.cumsum([len(mesh) for mesh in meshes]))).astype(np.int64)
        """First triangle of each shape in ``shape_material``, shape ``(classes + 1,)``."""
        self.shape_material = np.concatenate([np.empty(0, np.uint8), *(mesh.material for mesh in meshes)])
        self._row_of_class = np.full(max((int(c) for c in ActorClass), default=0) + 1, -1, dtype=np.int32)
        self._row_of_class[[int(c) for c in self.classes]] = np.arange(len(self.classes))
        self.cast_static(np.zeros((1, 6), np.float32))
        self.cast_shapes(np.zeros((1, 6), np.float32))

    def shape_rows(self, actor_class: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
        """Row of each actor's shape in the ``shape_*`` arrays, shape of ``actor_class``."""
        return self._row_of_class[actor_class]

    def cast_static(
        self, rays: Floats32, hits: RayHits | None = None, order: npt.NDArray[np.int32] | None = None
    ) -> RayHits:
        """Cast rays (origin and direction, shape ``(N, 6)``, ``map`` frame) at the static scene.

        ``hits`` and ``order`` as ``TriangleTree.cast`` takes them.
        """
        return self._static.cast(rays, hits, order)

    def packets(self) -> tuple[PacketTree, PacketTree]:
        """Both trees for compiled loops, the static scene's first; they live no longer than this object."""
        return self._static.packets(), self._shapes.packets()

    def cast_shapes(self, rays: Floats32) -> RayHits:
        """Cast rays at the shapes, given in a shape's own frame plus its ``shape_offset_m``, shape ``(N, 6)``."""
        return self._shapes.cast(rays)
