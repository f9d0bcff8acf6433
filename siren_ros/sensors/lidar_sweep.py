"""A whole sweep as one compiled loop: it takes the interpreter's lock once to begin and once to end."""

from typing import Any, NamedTuple

import numpy as np

from siren_ros.sensors import lidar_loops as loops
from siren_ros.sensors.embree import PacketTree, cast_packets
from siren_ros.world.compiled import compiled

Array = Any
"""A numpy array; numba compiles for the element types that it is given."""
_aim, _select, _merge, _pack = loops.aim, loops.select_candidates, loops.merge_vehicles, loops.pack_points


class Scratch(NamedTuple):
    """Memory of one sensor, written anew by every sweep."""

    poses: Array
    """Of the sensor at each column, float32 (C, 3, 4); the caller fills it."""
    rays: Array
    """float32 (R, 6)."""
    order: Array
    """As ``TriangleTree.cast`` takes it; never written."""
    hits: loops.Hits
    room: loops.Candidates
    """For the rays that may hit a vehicle."""


class Rotation(NamedTuple):
    """What one sweep measures, and where its points go."""

    lidar_from_map: Array
    """float64 (4, 4)."""
    vehicles: loops.Vehicles
    receiver: loops.Receiver
    step: int
    out: loops.Records
    count_on: Array
    """Points on each vehicle, int64 (N,); zero at first."""


@compiled
def measure_sweep(
    pattern: loops.Pattern,
    scratch: Scratch,
    rotation: Rotation,
    trees: tuple[PacketTree, PacketTree],
    surfaces: loops.Surfaces,
) -> int:
    """Aim, cast at what stands still and go on as ``complete_sweep``, which says what is returned."""
    _aim(pattern.directions, scratch.poses, scratch.rays)
    hits = scratch.hits
    cast_packets(trees[0], scratch.rays, scratch.order, (hits.distance, hits.static_triangle, hits.normal))
    return complete_sweep(pattern, scratch, rotation, trees, surfaces)


@compiled
def complete_sweep(
    pattern: loops.Pattern,
    scratch: Scratch,
    rotation: Rotation,
    trees: tuple[PacketTree, PacketTree],
    surfaces: loops.Surfaces,
) -> int:
    """Cast those rays at vehicles that may hit one, and pack the points.

    Args:
        pattern: The beams.
        scratch: With the rays and what they hit of the static scene.
        rotation: The vehicles, and where the points go.
        trees: Of the static scene and of the vehicles' shapes.
        surfaces: What reflects how.

    Returns:
        How many points were written; where the room was too small, minus the room that is needed, and nothing was.
    """
    hits, room, vehicles = scratch.hits, scratch.room, rotation.vehicles
    hits.vehicle[:] = 0
    found = _select(scratch.rays, pattern, hits.distance, rotation.lidar_from_map, vehicles, room)
    if found > room.ray.shape[0]:
        return -found
    candidates = loops.Candidates(room.rays[:found], room.ray[:found], room.vehicle[:found])
    distance, triangle = np.empty(found, np.float32), np.empty(found, np.uint32)
    normal = np.empty((found, 3), np.float32)
    cast_packets(trees[1], candidates.rays, np.arange(found).astype(np.int32), (distance, triangle, normal))
    _merge(candidates, distance, normal, triangle, vehicles, hits)
    return _pack(scratch.poses, pattern, hits, vehicles, surfaces, rotation.receiver, rotation.out, rotation.count_on)
