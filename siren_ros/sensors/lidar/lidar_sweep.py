"""A whole sweep as one compiled loop: it takes the interpreter's lock once to begin and once to end."""

from typing import NamedTuple

import numpy as np

from siren_ros.numerics.compiled import Array, compiled
from siren_ros.sensors.lidar import lidar_loops as loops
from siren_ros.sensors.lidar.embree import PacketTree, cast_packets
from siren_ros.sensors.lidar.vehicle_candidates import select_candidates

_aim, _merge, _pack = loops.aim, loops.merge_vehicles, loops.pack_points


class Optics(NamedTuple):
    """Inputs that are the same for every sweep of a sensor."""

    pattern: loops.Pattern
    order: Array
    """As ``TriangleTree.cast`` takes it, int32 (R,)."""
    trees: tuple[PacketTree, PacketTree]
    """Of the static scene and of the vehicles' shapes."""
    surfaces: loops.Surfaces


class Scratch(NamedTuple):
    """Memory of one sensor, written anew by every sweep."""

    poses: Array
    """Of the sensor at each column, float32 (C, 3, 4); the caller fills it."""
    rays: Array
    """float32 (R, 6)."""
    hits: loops.Hits
    candidates: loops.Candidates
    """Memory for the rays that may hit a vehicle."""


class Rotation(NamedTuple):
    """Inputs of one sweep, and memory for its points."""

    lidar_from_map: Array
    """float64 (4, 4)."""
    vehicles: loops.Vehicles
    receiver: loops.Receiver
    step: int
    out: loops.Records
    count_on: Array
    """Points on each vehicle, int64 (N,); zero at first."""


@compiled
def measure_sweep(optics: Optics, scratch: Scratch, rotation: Rotation) -> int:
    """Aim, cast at the static scene and go on as ``complete_sweep``; returns the same."""
    _aim(optics.pattern.directions, scratch.poses, scratch.rays)
    hits = scratch.hits
    cast_packets(optics.trees[0], scratch.rays, optics.order, (hits.distance, hits.static_triangle, hits.normal))
    return complete_sweep(optics, scratch, rotation)


@compiled
def complete_sweep(optics: Optics, scratch: Scratch, rotation: Rotation) -> int:
    """Cast those rays at vehicles that may hit one, and pack the points.

    Args:
        optics: The beams, and what they can hit.
        scratch: With the rays and what they hit of the static scene.
        rotation: The vehicles, and where the points go.

    Returns:
        Number of points written. Where ``scratch.candidates`` is too short: minus the length that is needed, and
        nothing is written.
    """
    pattern, hits, memory, vehicles = optics.pattern, scratch.hits, scratch.candidates, rotation.vehicles
    hits.vehicle[:] = 0
    found = select_candidates(scratch.rays, pattern, hits.distance, rotation.lidar_from_map, vehicles, memory)
    if found > memory.ray.shape[0]:
        return -found
    candidates = loops.Candidates(memory.rays[:found], memory.ray[:found], memory.vehicle[:found])
    distance, triangle = np.empty(found, np.float32), np.empty(found, np.uint32)
    normal = np.empty((found, 3), np.float32)
    cast_packets(optics.trees[1], candidates.rays, np.arange(found).astype(np.int32), (distance, triangle, normal))
    _merge(candidates, distance, normal, triangle, vehicles, hits)
    receiver, out, count_on = rotation.receiver, rotation.out, rotation.count_on
    return _pack(scratch.poses, pattern, hits, vehicles, optics.surfaces, receiver, out, count_on)
