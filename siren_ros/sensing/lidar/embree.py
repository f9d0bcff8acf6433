"""Casts rays at triangles with Embree, in packets of neighbouring rays and without holding the GIL.

Neighbouring rays travel through the tree together, which costs a fifth of casting them one by one, as Open3D's
``cast_rays`` and the Python bindings of Embree do. So the library inside the ``embreex`` wheel is called directly:
its C interface (Embree 4 API reference, "RTCRayHit", "rtcIntersect4/8/16", "rtcGetDeviceProperty",
"rtcSetSharedGeometryBuffer"). Compiled loops run without the interpreter's lock, so that all cores take part.

Static triangles are in one tree, and the shape of each vehicle class is in another. A vehicle moves by casting rays in
its own frame, so nothing is rebuilt between steps.
"""

import ctypes
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib.metadata import files
from itertools import pairwise
from typing import Any, Final, NamedTuple

import embreex.rtcore  # noqa: F401 - loads the library with the thread pool that it needs
import llvmlite.binding
import numpy as np
import numpy.typing as npt
from numba import types

from siren_ros.base.numerics.arrays import Floats32, Rows
from siren_ros.base.numerics.compiled import X, Y, Z, compiled
from siren_ros.errors import SirenError
from siren_ros.sensing.meshes.mesh import StaticScene, VehiclePlacement, VehicleShape
from siren_ros.sensing.specification import inverse, map_from_base
from siren_ros.simulation.world.actors import ActorClass

_MOST: Final = 8
"""Maximum number of threads; with more, the parts of a loop become too small to gain anything."""


class ThreadPool:
    """Shares loops between the calling thread and further threads."""

    def __init__(self, size: int) -> None:
        """Prepare the threads; ``size`` counts the calling thread too."""
        self.size = max(1, size)
        self._executor = ThreadPoolExecutor(self.size, "rays")  # the executor starts a thread only when it needs one

    def run(self, work: Callable[[int, int, int], None], count: int, grain: int) -> None:
        """Run a loop of ``count`` in parts of ``grain``: a free thread takes the next part. Returns when all are done.

        ``work`` gets the number of the thread (0 is the calling one) and the first and the end index of a part. Parts
        run in any order and at the same time; those of one thread follow each other. A single part stays in the calling
        thread.
        """
        starts = iter(range(0, count, grain))
        workers = min(self.size, -(-count // grain))
        futures = [
            self._executor.submit(_take_parts, work, worker, starts, count, grain) for worker in range(1, workers)
        ]
        try:
            _take_parts(work, 0, starts, count, grain)
        finally:
            for future in futures:
                future.result()


def _take_parts(
    work: Callable[[int, int, int], None], worker: int, starts: Iterator[int], count: int, grain: int
) -> None:
    for first in starts:
        work(worker, first, min(first + grain, count))


@cache
def shared_pool() -> ThreadPool:
    """The pool of this process: a thread for each processor that it may use."""
    return ThreadPool(min(len(os.sched_getaffinity(0)), _MOST))


_NATIVE: Final = {16: 34, 8: 33, 4: 32}
"""Packet sizes in rays, each with the Embree property that says whether the processor has registers of that width.
Without them, Embree casts the rays of a packet one by one."""
_ROWS: Final = 21
_ORIGIN, _NEAR, _DIRECTION, _TIME, _FAR, _MASK, _ID, _FLAGS, _NORMAL = 0, 3, 4, 7, 8, 9, 10, 11, 12
_TRIANGLE, _MESH, _INSTANCE, _INSTANCE_PART = range(17, _ROWS)
"""Rows of ``RTCRayHit4``, ``8`` and ``16``, each a number per ray; vectors have three rows."""
_PART: Final = 512 * max(_NATIVE)
"""Rays that one thread takes at a time: about a millisecond of work, a multiple of all packet sizes."""
_ALIGNMENT: Final = 64
_NOTHING: Final = 0xFFFFFFFF
_COHERENT: Final = 1 << 16
_TRIANGLES, _INDEX_BUFFER, _VERTEX_BUFFER, _UINT3, _FLOAT3, _HIGH_QUALITY = 0, 0, 1, 0x5003, 0x9003, 2
_SYMBOL: Final = "siren_embree_intersect"
_pointer, _size, _uint = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint
_SIGNATURES: Final[dict[str, tuple[Any, ...]]] = {
    # each entry: result type, then argument types
    "rtcNewDevice": (_pointer, ctypes.c_char_p),
    "rtcNewScene": (_pointer, _pointer),
    "rtcSetSceneBuildQuality": (None, _pointer, ctypes.c_int),
    "rtcNewGeometry": (_pointer, _pointer, ctypes.c_int),
    "rtcSetSharedGeometryBuffer": (
        None, _pointer, ctypes.c_int, _uint, ctypes.c_int, _pointer, _size, _size, _size,
    ),
    "rtcCommitGeometry": (None, _pointer),
    "rtcAttachGeometry": (_uint, _pointer, _pointer),
    "rtcReleaseGeometry": (None, _pointer),
    "rtcCommitScene": (None, _pointer),
    "rtcReleaseScene": (None, _pointer),
    "rtcGetDeviceError": (ctypes.c_int, _pointer),
    "rtcGetDeviceProperty": (_size, _pointer, ctypes.c_int),
}  # fmt: skip
_intersect: Any = types.ExternalFunction(_SYMBOL, types.void(types.intp, types.intp, types.intp, types.intp))


class _IntersectArguments(ctypes.Structure):
    """Embree's structure ``RTCIntersectArguments``."""

    _fields_ = (
        ("flags", _uint),
        ("feature_mask", _uint),
        ("context", _pointer),
        ("filter", _pointer),
        ("intersect", _pointer),
        ("room", _pointer * 4),
    )


@dataclass(frozen=True, eq=False)
class RayHits:
    """The first hit of each of N rays."""

    distance: Floats32
    """Distance as a multiple of the ray's direction vector; infinite where nothing was hit; shape ``(N,)``."""
    triangle: npt.NDArray[np.uint32]
    """Index of the triangle within its mesh, shape ``(N,)``; meaningless where nothing was hit."""
    normal: Floats32
    """Normal of the triangle, not of unit length, shape ``(N, 3)``; meaningless where nothing was hit."""

    @classmethod
    def for_rays(cls, count: int) -> "RayHits":
        """Allocate memory for the hits of ``count`` rays."""
        return cls(np.empty(count, np.float32), np.empty(count, np.uint32), np.empty((count, 3), np.float32))


HitArrays = tuple[Floats32, npt.NDArray[np.uint32], Floats32]
"""The arrays of ``RayHits``."""


class PacketTree(NamedTuple):
    """A tree in the form that compiled loops need: addresses as integers, with the arrays that must stay alive."""

    scene: int
    arguments: int
    packet: Floats32
    packet_at: int
    valid: npt.NDArray[np.int32]
    valid_at: int


class TriangleTree:
    """Meshes in a tree at which rays are cast. The meshes cannot change later."""

    def __init__(
        self, meshes: Sequence[tuple[Floats32, npt.NDArray[np.integer[Any]]]], pool: ThreadPool | None = None
    ) -> None:
        """Build the tree of meshes, each given as vertices ``(V, 3)`` and triangles ``(T, 3)``; they may overlap.

        The threads of ``pool`` cast, those of this process where None. Raises SirenError where Embree refuses the
        meshes.
        """
        library, device = _library(), _device()
        self._library = library
        self._kept: list[npt.NDArray[Any]] = []
        self._scene = int(library.rtcNewScene(device))
        library.rtcSetSceneBuildQuality(self._scene, _HIGH_QUALITY)
        for vertices_m, triangles in meshes:
            self._add(device, vertices_m, triangles)
        library.rtcCommitScene(self._scene)
        if error := library.rtcGetDeviceError(device):
            raise SirenError(f"Embree could not build a tree of triangles (RTCError {error})")
        self._arguments = _IntersectArguments(flags=_COHERENT, feature_mask=_NOTHING)
        self._pool = pool or shared_pool()
        self._packets_of = [self.packets() for _ in range(self._pool.size)]

    def __del__(self) -> None:
        """Free Embree's memory."""
        if scene := getattr(self, "_scene", 0):
            self._library.rtcReleaseScene(scene)

    def _add(self, device: int, vertices_m: Floats32, triangles: npt.NDArray[np.integer[Any]]) -> None:
        # Embree reads 16 bytes per vertex, also for the last one.
        vertices = np.zeros((len(vertices_m) + 1, 3), np.float32)
        vertices[:-1] = vertices_m
        corners = np.ascontiguousarray(triangles, dtype=np.uint32)
        self._kept += (vertices, corners)
        library = self._library
        geometry = library.rtcNewGeometry(device, _TRIANGLES)
        for kind, form, data, rows in (
            (_VERTEX_BUFFER, _FLOAT3, vertices, len(vertices_m)),
            (_INDEX_BUFFER, _UINT3, corners, len(corners)),
        ):
            library.rtcSetSharedGeometryBuffer(geometry, kind, 0, form, data.ctypes.data, 0, 12, rows)
        library.rtcCommitGeometry(geometry)
        library.rtcAttachGeometry(self._scene, geometry)
        library.rtcReleaseGeometry(geometry)

    def packets(self) -> PacketTree:
        """The tree for compiled loops, with scratch memory for one thread. It must not outlive this object."""
        lanes = _lanes()
        packet, valid = _aligned((_ROWS, lanes), np.float32), _aligned((lanes,), np.int32)
        arguments = ctypes.addressof(self._arguments)
        return PacketTree(self._scene, arguments, packet, packet.ctypes.data, valid, valid.ctypes.data)

    def cast(self, rays: Floats32, hits: RayHits | None = None, order: npt.NDArray[np.int32] | None = None) -> RayHits:
        """Find the first hit of each ray (origin and direction, ``(N, 6)``). Only one call at a time.

        ``hits`` is memory for the answer, used again from call to call. ``order`` are the rays in an order in which
        neighbours travel together, shape ``(N,)``, see ``tiles``; it decides the cost alone.
        """
        target = hits if hits is not None else RayHits.for_rays(len(rays))
        all_rays = order if order is not None else np.arange(len(rays), dtype=np.int32)

        def part(worker: int, first: int, end: int) -> None:
            arrays = target.distance, target.triangle, target.normal
            cast_packets(self._packets_of[worker], rays, all_rays[first:end], arrays)

        self._pool.run(part, len(all_rays), _PART)
        return target


def tiles(columns: int, rows: int, side: int = 4) -> npt.NDArray[np.int32]:
    """Order the rays of a ``(columns, rows)`` grid by square tiles of ``side`` rays; shape ``(N,)``."""
    grid = np.arange(columns * rows, dtype=np.int32).reshape(columns, rows)
    bounds = [*range(0, columns, side), columns], [*range(0, rows, side), rows]
    return np.concatenate([grid[a:b, c:d].reshape(-1) for a, b in pairwise(bounds[0]) for c, d in pairwise(bounds[1])])


@compiled
def cast_packets(
    tree: PacketTree,
    rays: Floats32,
    order: npt.NDArray[np.int32],
    hits: HitArrays,
) -> None:
    """Cast rays (N, 6) in packets in the given order (N,), and write distance, triangle and normal of each hit."""
    packet, valid = tree.packet, tree.valid
    distance, triangle, normal = hits
    names = packet.view(np.uint32)
    lanes = packet.shape[1]
    packet[_NEAR] = np.float32(0.0)
    packet[_TIME] = np.float32(0.0)
    names[_MASK] = np.uint32(0xFFFFFFFF)
    names[_ID : _FLAGS + 1] = np.uint32(0)
    valid[:] = -1
    for first in range(0, order.shape[0], lanes):
        count = min(lanes, order.shape[0] - first)
        if count < lanes:
            valid[count:] = 0
        for lane in range(count):
            ray = rays[order[first + lane]]
            x, y, z, dx, dy, dz = ray[0], ray[1], ray[2], ray[3], ray[4], ray[5]
            packet[_ORIGIN + X, lane], packet[_ORIGIN + Y, lane], packet[_ORIGIN + Z, lane] = x, y, z
            packet[_DIRECTION + X, lane], packet[_DIRECTION + Y, lane], packet[_DIRECTION + Z, lane] = dx, dy, dz
            packet[_FAR, lane] = np.float32(np.inf)
            names[_MESH, lane] = np.uint32(0xFFFFFFFF)
            names[_INSTANCE, lane] = np.uint32(0xFFFFFFFF)
            names[_INSTANCE_PART, lane] = np.uint32(0xFFFFFFFF)
        _intersect(tree.valid_at, tree.scene, tree.packet_at, tree.arguments)
        for lane in range(count):
            i = order[first + lane]
            distance[i] = packet[_FAR, lane]
            triangle[i] = names[_TRIANGLE, lane]
            normal[i, X], normal[i, Y] = packet[_NORMAL + X, lane], packet[_NORMAL + Y, lane]
            normal[i, Z] = packet[_NORMAL + Z, lane]


def _aligned(shape: tuple[int, ...], dtype: type[np.generic]) -> npt.NDArray[Any]:
    """Zeros at an address aligned for the processor's widest registers."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    raw = np.zeros(size + _ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % _ALIGNMENT
    return raw[start : start + size].view(dtype).reshape(shape)


@cache
def _library() -> ctypes.CDLL:
    """Load Embree's library from the wheel; SirenError where the wheel has none."""
    libraries = [file for file in files("embreex") or () if file.name.startswith("libembree4")]
    if not libraries:
        raise SirenError("the package embreex has no Embree library in it; install it from its wheel")
    library = ctypes.CDLL(str(libraries[0].locate()))
    for name, (result, *arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


@cache
def _device() -> int:
    device = _library().rtcNewDevice(b"threads=1")
    if not device:
        raise SirenError("Embree does not run on this processor")
    return int(device)


@cache
def _lanes() -> int:
    """Width of the widest ray packets of this processor. The call also sets this width for compiled code."""
    library, device = _library(), _device()
    lanes = next((size for size, name in _NATIVE.items() if library.rtcGetDeviceProperty(device, name)), min(_NATIVE))
    intersect = getattr(library, f"rtcIntersect{lanes}")
    llvmlite.binding.add_symbol(_SYMBOL, ctypes.cast(intersect, ctypes.c_void_p).value)
    return lanes


SHAPE_SPACING_M: Final = 1024.0
"""Distance between the classes' shapes in their common tree. A power of two, so that shifting a ray adds no rounding
beyond float32's, and more than twice any sensor's range, so that a ray aimed at one shape meets no other within it."""
_SHAPES_PER_ROW: Final = 4


class RaycastWorld:
    """The static scene and the vehicle shapes as trees for ray casting."""

    def __init__(self, static: StaticScene, shapes: Mapping[ActorClass, VehicleShape]) -> None:
        """Build both trees."""
        self._static = TriangleTree([(static.mesh.vertices_m, static.mesh.triangles)])
        self.static_material, self.static_colour_rgb = static.mesh.material, static.mesh.colour_rgb
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
        self.shape_colour_rgb = np.concatenate([np.empty((0, 3), np.uint8), *(mesh.colour_rgb for mesh in meshes)])
        self._row_of_class = np.full(max((int(c) for c in ActorClass), default=0) + 1, -1, dtype=np.int32)
        self._row_of_class[[int(c) for c in self.classes]] = np.arange(len(self.classes))
        self.cast_static(np.zeros((1, 6), np.float32))
        self.cast_shapes(np.zeros((1, 6), np.float32))

    def shape_rows(self, actor_class: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
        """Row of each actor's shape in the ``shape_*`` arrays; same shape as ``actor_class``."""
        return self._row_of_class[actor_class]

    def cast_static(
        self, rays: Floats32, hits: RayHits | None = None, order: npt.NDArray[np.int32] | None = None
    ) -> RayHits:
        """Cast rays (origin and direction, ``(N, 6)``, ``map`` frame) at the static scene, as ``TriangleTree.cast``."""
        return self._static.cast(rays, hits, order)

    def packets(self) -> tuple[PacketTree, PacketTree]:
        """Both trees for compiled loops, the static scene first. They must not outlive this object."""
        return self._static.packets(), self._shapes.packets()

    def cast_shapes(self, rays: Floats32) -> RayHits:
        """Cast rays at the vehicle shapes, shape ``(N, 6)``.

        Rays are in the shape's own frame, shifted by its ``shape_offset_m``.
        """
        return self._shapes.cast(rays)

    def cast(self, rays: Floats32, placement: VehiclePlacement) -> tuple[Floats32, Rows]:
        """Cast rays (origin and direction, ``(N, 6)``, ``map`` frame) at the static scene and at vehicles.

        Returns the distance to the first hit as a multiple of the direction, infinite where there is none, ``(N,)``,
        and the row of the vehicle hit in ``placement``, -1 where it is none, ``(N,)``.
        """
        rays = np.ascontiguousarray(rays, np.float32)
        distance = self.cast_static(rays).distance
        hit_row = np.full(len(rays), -1, np.intp)
        for row in range(len(placement)):
            chosen, hits = self.cast_at_vehicle(rays, placement, row)
            nearer = hits.distance < distance[chosen]
            distance[chosen[nearer]] = hits.distance[nearer]
            hit_row[chosen[nearer]] = row
        return distance, hit_row

    def cast_at_vehicle(self, rays: Floats32, placement: VehiclePlacement, row: int) -> tuple[Rows, RayHits]:
        """Cast rays as ``cast`` at the vehicle of a row; the hits are those of the rays that come near, ``(M,)``."""
        size_m, scale = placement.size_m[row], placement.scale[row]
        x_m, y_m, z_m = (float(values[row]) for values in (placement.x_m, placement.y_m, placement.z_m))
        direction, towards = rays[:, 3:].astype(np.float64), (x_m, y_m, z_m + size_m[2] / 2.0) - rays[:, :3]
        square = np.einsum("ij,ij->i", direction, direction)
        along = np.einsum("ij,ij->i", direction, towards) / square
        gap = np.einsum("ij,ij->i", towards, towards) - along**2 * square
        radius_m = float(np.linalg.norm(size_m)) / 2.0
        chosen = np.flatnonzero((gap < radius_m**2) & (along * np.sqrt(square) > -radius_m))
        base_from_map = inverse(map_from_base(x_m, y_m, z_m, float(placement.yaw_rad[row])))
        shape = int(self.shape_rows(placement.actor_class[row : row + 1])[0])
        local = np.empty((len(chosen), 6), np.float32)
        origin = rays[chosen, :3] @ base_from_map[:3, :3].T + base_from_map[:3, 3]
        local[:, :3] = origin / scale + self.shape_offset_m[shape]
        local[:, 3:] = (direction[chosen] @ base_from_map[:3, :3].T) / scale
        hits = self.cast_shapes(local)
        # A ray that passes by the vehicle goes on to the next shape of the common tree.
        hits.distance[hits.distance > along[chosen] + radius_m / np.sqrt(square[chosen])] = np.inf
        return chosen, hits
