"""Vehicles on the graphics card: one mesh per class, drawn once per vehicle with its own pose, paint and lights."""

import itertools
from collections.abc import Mapping
from typing import Any, Final

import moderngl
import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from siren_ros.sensors.camera.geometry.vertices import VERTEX, IndexedMesh, index_mesh
from siren_ros.sensors.camera.shading import vehicle_shaders
from siren_ros.sensors.camera.shading.preamble import defined
from siren_ros.sensors.meshes.material import SEMANTIC_CLASS_OF_MATERIAL, semantic_class_of_actor
from siren_ros.sensors.meshes.mesh import VehicleShape
from siren_ros.sensors.meshes.placement import Placement
from siren_ros.world.actors import ActorClass

_VERTEX: Final = np.dtype([("base", VERTEX), ("hub", "<f2", 4)])
_VERTEX_FORMAT: Final = "3f 4f2 4f1 4f2"
INSTANCE: Final = np.dtype([("rows", "<f4", (3, 4)), ("paint", "<f4", 4), ("motion", "<f4", 2), ("actor", "<u4", 2)])
_INSTANCE_FORMAT: Final = "4f 4f 4f 4f 2f 2u4/i"
_INSTANCE_NAMES: Final = ("in_row_x", "in_row_y", "in_row_z", "in_paint", "in_motion", "in_actor")
_ROOM: Final = 64
"""Initial capacity of the buffers, in vehicles of one class."""
Casters = tuple[tuple[int, npt.NDArray[np.void]], ...]
"""Vehicles that throw shadows: their class and, dtype ``INSTANCE``, where they stand."""
_SEMANTIC: Final = np.array([int(semantic_class_of_actor(kind)) for kind in ActorClass], np.float32)


def model_rows(placement: Placement) -> npt.NDArray[np.float32]:
    """Rows of ``map_from_base`` with each shape's scale, shape ``(N, 3, 4)``."""
    cos, sin = np.cos(placement.yaw_rad), np.sin(placement.yaw_rad)
    zero = np.zeros(len(placement))
    sx, sy, sz = placement.scale.T if len(placement) else (zero, zero, zero)
    rows = (
        (cos * sx, -sin * sy, zero, placement.x_m),
        (sin * sx, cos * sy, zero, placement.y_m),
        (zero, zero, sz, placement.z_m),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1).astype(np.float32)


def _indexed(shape: VehicleShape) -> IndexedMesh:
    """Body and wheels at rest as one indexed mesh; its vertices, dtype ``_VERTEX``, know their wheel's hub."""
    wheels = [(w.mesh.translated(*w.hub_m), (*w.hub_m, 2.0 if w.steered else 1.0)) for w in shape.wheels]
    parts = [(shape.body, (0.0, 0.0, 0.0, 0.0)), *wheels]
    blocks, triangles, first = [], [], 0
    for mesh, hub in parts:
        indexed = index_mesh(mesh, SEMANTIC_CLASS_OF_MATERIAL)
        block = np.zeros(len(indexed.vertices), _VERTEX)
        block["base"] = indexed.vertices
        block["hub"] = hub
        blocks.append(block)
        triangles.append(indexed.triangles + np.uint32(first))
        first += len(block)
    return IndexedMesh(np.concatenate(blocks), np.concatenate(triangles))


def _hull(shape: VehicleShape) -> npt.NDArray[np.float32]:
    """Corners of a simple convex body's triangles that throws the shadow, shape ``(K, 3)``.

    It spans the shape's extreme points in the 26 directions to a cube's corners, edges and faces. Its triangles turn
    counter-clockwise seen from outside: of both sides that cover the shadow one is drawn.
    """
    points = shape.at_rest.vertices_m.astype(np.float64)
    directions = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
    extreme = points[np.unique(np.argmax(directions @ points.T, axis=1))]
    hull = ConvexHull(extreme)
    corners = extreme[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0.0
    corners[inward] = corners[inward][:, ::-1]
    return corners.reshape(-1, 3).astype(np.float32)


class _Class:
    """Buffers of one vehicle class: those in view, and all of the picture's, whose shadows may be in view."""

    def __init__(self, context: moderngl.Context, shape: VehicleShape, program: Any, shadow_program: Any) -> None:
        self._instances = context.buffer(reserve=_ROOM * INSTANCE.itemsize, dynamic=True)
        self._casters = context.buffer(reserve=_ROOM * INSTANCE.itemsize, dynamic=True)
        indexed = _indexed(shape)
        body = context.buffer(indexed.vertices.tobytes())
        indices = context.buffer(indexed.triangles.tobytes())
        hull = context.buffer(_hull(shape).tobytes())
        names = ("in_position", "in_normal", "in_colour", "in_hub")
        self._array = context.vertex_array(
            program,
            ((body, _VERTEX_FORMAT, *names), (self._instances, _INSTANCE_FORMAT, *_INSTANCE_NAMES)),
            indices,
        )
        self._shadow_array = context.vertex_array(
            shadow_program, ((hull, "3f", "in_position"), (self._casters, "4f 4f 4f 32x/i", *_INSTANCE_NAMES[:3]))
        )
        self._room = {id(self._instances): _ROOM, id(self._casters): _ROOM}

    def _write(self, buffer: Any, instances: npt.NDArray[np.void]) -> None:
        if len(instances) > self._room[id(buffer)]:
            self._room[id(buffer)] = 2 * len(instances)
        buffer.orphan(self._room[id(buffer)] * INSTANCE.itemsize)
        buffer.write(instances.tobytes())

    def draw(self, instances: npt.NDArray[np.void]) -> None:
        """Draw these vehicles."""
        if len(instances):
            self._write(self._instances, instances)
            self._array.render(moderngl.TRIANGLES, instances=len(instances))

    def draw_shadows(self, instances: npt.NDArray[np.void]) -> None:
        """Draw the hulls of these vehicles with the shadow program."""
        if len(instances):
            self._write(self._casters, instances)
            self._shadow_array.render(moderngl.TRIANGLES, instances=len(instances))


class VehicleGeometry:
    """All classes' meshes; ``place`` once per set of vehicles, then draw."""

    def __init__(
        self,
        context: moderngl.Context,
        shapes: Mapping[ActorClass, VehicleShape],
        constants: str,
    ) -> None:
        """Upload the shapes once; ``constants`` are a look's preamble of the program."""
        self.program = context.program(
            vertex_shader=defined(vehicle_shaders.VEHICLE_VERTEX, constants),
            fragment_shader=defined(vehicle_shaders.VEHICLE_FRAGMENT, constants),
        )
        self.shadow_program: Any = context.program(
            vertex_shader=vehicle_shaders.GROUND_SHADOW_VERTEX, fragment_shader=vehicle_shaders.GROUND_SHADOW_FRAGMENT
        )
        self._classes = {
            int(actor_class): _Class(context, shapes[actor_class], self.program, self.shadow_program)
            for actor_class in sorted(shapes)
        }
        self._actor_class = np.empty(0, np.uint8)
        self._instances = np.empty(0, INSTANCE)

    def place(self, placement: Placement, rolled_m: npt.NDArray[np.float64]) -> None:
        """Set the vehicles of the pictures to come."""
        instances = np.zeros(len(placement), INSTANCE)
        instances["rows"] = model_rows(placement)
        instances["paint"][:, :3] = placement.colour_rgb / 255.0
        instances["paint"][:, 3] = _SEMANTIC[placement.actor_class] / 255.0
        instances["motion"] = np.stack((placement.steer_rad, rolled_m), axis=1)
        instances["actor"] = np.stack((placement.actor_id, placement.lights), axis=1)
        self._instances, self._actor_class = instances, placement.actor_class

    def draw(self, nearest_first: npt.NDArray[np.intp]) -> None:
        """Draw vehicles, given as rows of what was placed."""
        kinds = self._actor_class[nearest_first]
        for kind in dict.fromkeys(kinds.tolist()):
            self._classes[kind].draw(self._instances[nearest_first[kinds == kind]])

    def casters(self, near: npt.NDArray[np.bool_]) -> Casters:
        """Some of the placed vehicles by class."""
        by_class = ((kind, self._instances[near & (self._actor_class == kind)]) for kind in self._classes)
        return tuple((kind, instances) for kind, instances in by_class if len(instances))

    def draw_shadows(self, casters: Casters) -> None:
        """Draw the hulls of vehicles with the shadow program."""
        for kind, instances in casters:
            self._classes[kind].draw_shadows(instances)
