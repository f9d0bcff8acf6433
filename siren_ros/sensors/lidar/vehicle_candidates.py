"""Which rays of a sweep may hit a vehicle: those that enter its bounding box before they hit the static scene."""

import numpy as np

from siren_ros.numerics.compiled import Array, compiled
from siren_ros.sensors.lidar.lidar_loops import Candidates, Pattern, Vehicles


@compiled
def _entry(bounds: Array, origin: Array, direction: Array) -> np.float32:
    """Parameter at which a ray enters an axis-aligned box, infinite where it misses (slab method)."""
    near = np.float32(0.0)
    far = np.float32(np.inf)
    for axis in range(3):
        o, d = origin[axis], direction[axis]
        if d == np.float32(0.0):
            if o < bounds[0, axis] or o > bounds[1, axis]:
                return np.float32(np.inf)
        else:
            inverse = np.float32(1.0) / d
            a = (bounds[0, axis] - o) * inverse
            b = (bounds[1, axis] - o) * inverse
            near = max(near, min(a, b))
            far = min(far, max(a, b))
    return np.float32(near) if near <= far else np.float32(np.inf)


@compiled
def _window(
    pattern: Pattern, pose: Array, size: Array, reach: float, lidar_from_map: Array
) -> tuple[int, int, int, int]:
    """First column, number of columns (cyclic) and first and end ray of a column that can meet a vehicle's sphere.

    A sphere of radius r at horizontal distance d spans ± asin(r / d) in azimuth, and ± asin(r / distance) in elevation.
    ``reach`` is how far the vehicle moves while the beams turn.
    """
    columns, rings = pattern.column_time_s.shape[0], pattern.elevation.shape[0]
    radius = 0.5 * np.sqrt(size[0] ** 2 + size[1] ** 2 + size[2] ** 2) + reach
    m, z = lidar_from_map, pose[2] + 0.5 * size[2]
    sx = m[0, 0] * pose[0] + m[0, 1] * pose[1] + m[0, 2] * z + m[0, 3]
    sy = m[1, 0] * pose[0] + m[1, 1] * pose[1] + m[1, 2] * z + m[1, 3]
    sz = m[2, 0] * pose[0] + m[2, 1] * pose[1] + m[2, 2] * z + m[2, 3]
    flat = np.hypot(sx, sy)
    if flat <= radius:
        return 0, columns, 0, rings
    step = 2.0 * np.pi / columns
    half = np.arcsin(radius / flat) / step
    first = int(np.floor((np.pi - np.arctan2(sy, sx)) / step - half))
    count = min(columns, int(np.ceil(2.0 * half)) + 2)
    elevation, spread = np.arctan2(sz, flat), np.arcsin(radius / np.hypot(flat, sz))
    low, high = _rank(pattern.elevation, elevation - spread), _rank(pattern.elevation, elevation + spread)
    return first % columns, count, low, min(high + 1, rings)


@compiled
def _rank(ascending: Array, value: float) -> int:
    """How many numbers lie below a value (bisection)."""
    low, high = 0, ascending.shape[0]
    while low < high:
        middle = (low + high) // 2
        if ascending[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@compiled
def _rings(pattern: Pattern, bounds: Array, origin: Array, ahead: Array, rise: float) -> tuple[int, int]:
    """First and end ray of an upright column that meet a box; none where it misses the box.

    ``ahead`` is the horizontal unit direction and ``rise`` the height of slope 1, both in the box's coordinates.
    """
    near, far = -np.inf, np.inf
    for axis in range(2):
        if abs(ahead[axis]) < 1e-9:
            if origin[axis] < bounds[0, axis] or origin[axis] > bounds[1, axis]:
                return 0, 0
        else:
            a = (bounds[0, axis] - origin[axis]) / ahead[axis]
            b = (bounds[1, axis] - origin[axis]) / ahead[axis]
            near, far = max(near, min(a, b)), min(far, max(a, b))
    if near > far or far <= 0.0:
        return 0, 0
    rings = pattern.slope.shape[0]
    if near <= 0.0:
        return 0, rings
    bottom, top = (bounds[0, 2] - origin[2]) / rise, (bounds[1, 2] - origin[2]) / rise
    low = _rank(pattern.slope, min(bottom / near, bottom / far)) - 1
    high = _rank(pattern.slope, max(top / near, top / far)) + 1
    return max(low, 0), min(high, rings)


@compiled
def select_candidates(  # compiled code is called with positions
    rays: Array,
    pattern: Pattern,
    distance: Array,
    lidar_from_map: Array,
    vehicles: Vehicles,
    out: Candidates,
) -> int:
    """Find the rays that enter a vehicle's bounding box before ``distance`` (R,); returns how many there are.

    As many as fit into ``out`` are written. Where there are more the caller calls again with a longer one.
    """
    columns, rings = pattern.column_time_s.shape[0], pattern.elevation.shape[0]
    turn_s = np.abs(pattern.world_time_s[0])
    upright = abs(lidar_from_map[2, 0]) + abs(lidar_from_map[2, 1]) < 1e-9
    found = 0
    for v in range(vehicles.pose.shape[0]):
        one = np.float32(1.0)
        sx, sy, sz = one / vehicles.scale[v, 0], one / vehicles.scale[v, 1], one / vehicles.scale[v, 2]
        pose, motion = vehicles.pose[v], vehicles.motion[v]
        reach = turn_s * (np.hypot(motion[0], motion[1]) + vehicles.size[v, 0] * np.abs(motion[2]))
        first_column, count, low, high = _window(pattern, pose, vehicles.size[v], reach, lidar_from_map)
        cos, sin = np.float32(np.cos(pose[3])), np.float32(np.sin(pose[3]))
        for k in range(count):
            column = (first_column + k) % columns
            t = pattern.world_time_s[column]
            if t != 0.0:
                yaw = pose[3] + motion[2] * t
                cos, sin = np.float32(np.cos(yaw)), np.float32(np.sin(yaw))
            first = column * rings
            rx = np.float32(rays[first, 0] - pose[0] - motion[0] * t)
            ry = np.float32(rays[first, 1] - pose[1] - motion[1] * t)
            rz = np.float32(rays[first, 2] - pose[2])
            o = ((cos * rx + sin * ry) * sx, (cos * ry - sin * rx) * sy, rz * sz)
            if upright:
                x, y = rays[first, 3], rays[first, 4]
                per_m = one / np.sqrt(x * x + y * y)
                ahead = ((cos * x + sin * y) * sx * per_m, (cos * y - sin * x) * sy * per_m)
                low, high = _rings(pattern, vehicles.bounds[v], o, ahead, sz)
            for i in range(first + low, first + high):
                x, y = rays[i, 3], rays[i, 4]
                d = ((cos * x + sin * y) * sx, (cos * y - sin * x) * sy, rays[i, 5] * sz)
                if _entry(vehicles.bounds[v], o, d) < distance[i]:
                    if found < out.ray.shape[0]:
                        for axis in range(3):
                            out.rays[found, axis] = o[axis] + vehicles.offset[v, axis]
                            out.rays[found, 3 + axis] = d[axis]
                        out.ray[found] = i
                        out.vehicle[found] = v
                    found += 1
    return found
