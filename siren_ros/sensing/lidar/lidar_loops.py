"""Compiled loops of the LiDAR over rays. Their arguments are named tuples of C-contiguous arrays.

R rays run column by column and, within a column, ring by ring. A sweep has C columns; N vehicles may be hit. A ray may
hit a vehicle where it enters the vehicle's bounding box before it hits the static scene.
"""

from typing import NamedTuple

import numpy as np

from siren_ros.base.numerics.compiled import Array, X, Y, Z, compiled

ORIGIN = 3
"""Column of a pose, shape ``(3, 4)``, after those of its axes."""
DX, DY, DZ = range(3, 6)
"""Columns of rays: the direction, after the origin."""
HEADING = 3
"""Column of ``Vehicles.pose``, after the place."""
VX, VY, YAW_RATE = range(3)
"""Columns of ``Vehicles.motion``."""
LENGTH, WIDTH, HEIGHT = range(3)
"""Columns of ``Vehicles.size``."""
LOW, HIGH = range(2)
"""Corners of ``Vehicles.bounds``."""
RATE, LIMIT, RATE_AT_ZERO = range(3)
"""Places of ``Receiver.dropoff``."""
INTENSITY, TIME = 3, 4
"""Columns of ``Records.f4``, after the place."""
RING, ACTOR = 10, 11
"""Columns of ``Records.u2``."""


class Pattern(NamedTuple):
    """Directions and times of the beams; they do not change for a sensor."""

    directions: Array
    """Unit vectors in the sensor's frame, float32 (R, 3)."""
    elevation: Array
    """Elevation of each ray of a column, increasing, float64 (R / C,)."""
    slope: Array
    """Tangent of the elevation, float64 (R / C,)."""
    column_time_s: Array
    """Time of each column relative to the sweep's stamp, float32 (C,)."""
    world_time_s: Array
    """Times at which the world is seen: the column times with motion distortion, otherwise zero; float32 (C,)."""


class Vehicles(NamedTuple):
    """The vehicles that are near enough to be hit."""

    pose: Array
    """x, y, z, yaw at the sweep's stamp, float64 (N, 4)."""
    motion: Array
    """vx, vy, yaw rate while the beams turn, float64 (N, 3)."""
    size: Array
    """Length, width, height, float64 (N, 3)."""
    scale: Array
    """Scale of the vehicle's shape along each axis, float32 (N, 3)."""
    bounds: Array
    """Lowest and highest corner of the shape in its own frame, float32 (N, 2, 3)."""
    offset: Array
    """Place of the shape in the shapes' common tree, float32 (N, 3)."""
    first_triangle: Array
    """Index of the first triangle of the shape in ``Surfaces.shape_reflectivity``, int64 (N,)."""
    paint: Array
    """Reflectivity of the vehicle's paint, float32 (N,)."""
    actor_id: Array
    """Id of each vehicle, uint32 (N,)."""


class Candidates(NamedTuple):
    """Rays that may hit a vehicle."""

    rays: Array
    """Origin and direction in the coordinates of the shapes' tree, float32 (M, 6)."""
    ray: Array
    """Index of the ray in the sweep, int32 (M,)."""
    vehicle: Array
    """Row of the vehicle that the ray may hit, int32 (M,)."""


class Hits(NamedTuple):
    """The nearest hit of each ray of the sweep."""

    distance: Array
    """Distance along the ray, float32 (R,)."""
    normal: Array
    """Normal of hits on the static scene, of any length, float32 (R, 3)."""
    static_triangle: Array
    """Triangle hit in the static scene, uint32 (R,)."""
    vehicle: Array
    """Row of the vehicle hit + 1, 0 on the static scene, int32 (R,)."""
    shape_triangle: Array
    """Triangle hit in a vehicle's shape, uint32 (R,)."""
    cosine: Array
    """Cosine of the angle of incidence on a vehicle, float32 (R,)."""


class Surfaces(NamedTuple):
    """Reflectivity of the triangles: share of the light that returns at normal incidence, 0 to 1, float32."""

    static_reflectivity: Array
    shape_reflectivity: Array
    """Reflectivity of the triangles of vehicle shapes; 0 means that of the vehicle's paint."""


class Receiver(NamedTuple):
    """Parameters that turn a return into a point: range, attenuation, noise, drop-off."""

    range_m: np.float32
    attenuation: Array
    """Share of the light that passes, as a table over distance, float32."""
    least: Array
    """Smallest intensity that the receiver sees, as a table over the same distances."""
    steps_per_m: np.float32
    grid: float
    """Rounding constant for coordinates: 1.5 · 2²³ times their resolution, added and subtracted again; 0 for no
    rounding."""
    range_noise_m: Array
    """Range noise of each ray, float32 (R,), or empty."""
    draw: Array
    """Uniform numbers that decide the drop-off, float32 (R,) or empty."""
    dropoff: Array
    """General drop-off rate, intensity limit, rate at zero intensity, float32 (3,)."""


class Records(NamedTuple):
    """One buffer of ``LIDAR_POINT_DTYPE`` as arrays of each element type."""

    f4: Array
    """float32 (R, 6): x, y, z, intensity, time; the last is not used."""
    u2: Array
    """uint16 (R, 12): ring and actor; the others are parts of the numbers in ``f4``."""


@compiled
def aim(directions: Array, map_from_lidar: Array, rays: Array) -> None:
    """Compute origin and direction of all rays in the ``map`` frame into ``rays`` (R, 6).

    Poses have shape (C, 3, 4).
    """
    rings = directions.shape[0] // map_from_lidar.shape[0]
    for column in range(map_from_lidar.shape[0]):
        m = map_from_lidar[column]
        for i in range(column * rings, (column + 1) * rings):
            x, y, z = directions[i, X], directions[i, Y], directions[i, Z]
            rays[i, X] = m[X, ORIGIN]
            rays[i, Y] = m[Y, ORIGIN]
            rays[i, Z] = m[Z, ORIGIN]
            rays[i, DX] = m[X, X] * x + m[X, Y] * y + m[X, Z] * z
            rays[i, DY] = m[Y, X] * x + m[Y, Y] * y + m[Y, Z] * z
            rays[i, DZ] = m[Z, X] * x + m[Z, Y] * y + m[Z, Z] * z


@compiled
def merge_vehicles(  # arguments are positional, because compiled code cannot take keywords
    candidates: Candidates, distance: Array, normal: Array, triangle: Array, vehicles: Vehicles, hits: Hits
) -> None:
    """Replace the hits of rays for which a vehicle is nearer than the static scene."""
    for j in range(distance.shape[0]):
        i = candidates.ray[j]
        if distance[j] < hits.distance[i]:
            v = candidates.vehicle[j]
            hits.distance[i] = distance[j]
            hits.vehicle[i] = v + 1
            hits.shape_triangle[i] = triangle[j]
            along = np.float32(0.0)
            square = np.float32(0.0)
            for axis in range(3):
                n = normal[j, axis]
                along += n * candidates.rays[j, DX + axis]
                square += (n / vehicles.scale[v, axis]) ** 2
            hits.cosine[i] = abs(along) / np.sqrt(square)


@compiled
def _is_dropped(intensity: float, draw: float, dropoff: Array) -> bool:
    """Whether a return is lost at random or for its low intensity, as CARLA's documentation of its LiDAR describes."""
    rate = dropoff[RATE]
    if intensity < dropoff[LIMIT]:
        rate = 1.0 - (1.0 - rate) * (1.0 - dropoff[RATE_AT_ZERO] * (1.0 - intensity / dropoff[LIMIT]))
    return draw < rate


@compiled
def _cosine(n: Array, m: Array, x: np.float32, y: np.float32, z: np.float32) -> np.float32:
    """Cosine between a ray, in the sensor's frame, and the normal of the static scene, in the ``map`` frame."""
    nx = n[X] * m[X, X] + n[Y] * m[Y, X] + n[Z] * m[Z, X]
    ny = n[X] * m[X, Y] + n[Y] * m[Y, Y] + n[Z] * m[Z, Y]
    nz = n[X] * m[X, Z] + n[Y] * m[Y, Z] + n[Z] * m[Z, Z]
    return abs(nx * x + ny * y + nz * z) / np.sqrt(nx * nx + ny * ny + nz * nz)


@compiled
def pack_points(  # arguments are positional, because compiled code cannot take keywords
    map_from_lidar: Array,
    pattern: Pattern,
    hits: Hits,
    vehicles: Vehicles,
    surfaces: Surfaces,
    receiver: Receiver,
    out: Records,
    count_on: Array,
) -> int:
    """Write one record per return and count the returns on each vehicle; returns the number of records.

    Poses (C, 3, 4).
    """
    rings = pattern.elevation.shape[0]
    levels, per_level = np.float32(255.0), np.float32(1.0 / 255.0)
    grid, noisy, lossy = np.float32(receiver.grid), receiver.range_noise_m.shape[0] > 0, receiver.draw.shape[0] > 0
    written = 0
    for column in range(map_from_lidar.shape[0]):
        time_s, m = pattern.column_time_s[column], map_from_lidar[column]
        rays = slice(column * rings, (column + 1) * rings)
        distance, normal, directions = hits.distance[rays], hits.normal[rays], pattern.directions[rays]
        static_triangle, vehicle = hits.static_triangle[rays], hits.vehicle[rays]
        for ring in range(rings):
            t = distance[ring]
            if not t <= receiver.range_m:
                continue
            x, y, z = directions[ring, X], directions[ring, Y], directions[ring, Z]
            row = vehicle[ring] - 1
            if row >= 0:
                i = column * rings + ring
                reflectivity = surfaces.shape_reflectivity[vehicles.first_triangle[row] + hits.shape_triangle[i]]
                if reflectivity == np.float32(0.0):
                    reflectivity = vehicles.paint[row]
                cosine = hits.cosine[i]
            else:
                reflectivity = surfaces.static_reflectivity[static_triangle[ring]]
                cosine = _cosine(normal[ring], m, x, y, z)
            place = np.uint32(t * receiver.steps_per_m)
            intensity = reflectivity * cosine * receiver.attenuation[place]
            if intensity < receiver.least[place]:
                continue
            if lossy and _is_dropped(intensity, receiver.draw[column * rings + ring], receiver.dropoff):
                continue
            if noisy:
                t = max(np.float32(0.0), t + receiver.range_noise_m[column * rings + ring])
            out.f4[written, X] = (x * t + grid) - grid
            out.f4[written, Y] = (y * t + grid) - grid
            out.f4[written, Z] = (z * t + grid) - grid
            out.f4[written, INTENSITY] = np.float32(np.int32(intensity * levels + np.float32(0.5))) * per_level
            out.f4[written, TIME] = time_s
            out.u2[written, RING] = ring
            out.u2[written, ACTOR] = 0
            if row >= 0:
                out.u2[written, ACTOR] = vehicles.actor_id[row]
                count_on[row] += 1
            written += 1
    return written


@compiled
def _entry(bounds: Array, origin: Array, direction: Array) -> np.float32:
    """Ray parameter at which a ray enters an axis-aligned box (slab method); infinite where it misses."""
    near = np.float32(0.0)
    far = np.float32(np.inf)
    for axis in range(3):
        o, d = origin[axis], direction[axis]
        if d == np.float32(0.0):
            if o < bounds[LOW, axis] or o > bounds[HIGH, axis]:
                return np.float32(np.inf)
        else:
            inverse = np.float32(1.0) / d
            a = (bounds[LOW, axis] - o) * inverse
            b = (bounds[HIGH, axis] - o) * inverse
            near = max(near, min(a, b))
            far = min(far, max(a, b))
    return np.float32(near) if near <= far else np.float32(np.inf)


@compiled
def _window(
    pattern: Pattern, pose: Array, size: Array, reach: float, lidar_from_map: Array
) -> tuple[int, int, int, int]:
    """First column, number of columns (cyclic), first and end ray of a column that can hit a vehicle's bounding sphere.

    A sphere of radius r at horizontal distance d spans ± asin(r / d) in azimuth, and ± asin(r / distance) in elevation.
    ``reach`` is how far the vehicle moves while the beams turn.
    """
    columns, rings = pattern.column_time_s.shape[0], pattern.elevation.shape[0]
    radius = 0.5 * np.sqrt(size[LENGTH] ** 2 + size[WIDTH] ** 2 + size[HEIGHT] ** 2) + reach
    m, z = lidar_from_map, pose[Z] + 0.5 * size[HEIGHT]
    sx = m[X, X] * pose[X] + m[X, Y] * pose[Y] + m[X, Z] * z + m[X, ORIGIN]
    sy = m[Y, X] * pose[X] + m[Y, Y] * pose[Y] + m[Y, Z] * z + m[Y, ORIGIN]
    sz = m[Z, X] * pose[X] + m[Z, Y] * pose[Y] + m[Z, Z] * z + m[Z, ORIGIN]
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
    """Count the numbers below a value in a sorted array (bisection)."""
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
            if origin[axis] < bounds[LOW, axis] or origin[axis] > bounds[HIGH, axis]:
                return 0, 0
        else:
            a = (bounds[LOW, axis] - origin[axis]) / ahead[axis]
            b = (bounds[HIGH, axis] - origin[axis]) / ahead[axis]
            near, far = max(near, min(a, b)), min(far, max(a, b))
    if near > far or far <= 0.0:
        return 0, 0
    rings = pattern.slope.shape[0]
    if near <= 0.0:
        return 0, rings
    bottom, top = (bounds[LOW, Z] - origin[Z]) / rise, (bounds[HIGH, Z] - origin[Z]) / rise
    low = _rank(pattern.slope, min(bottom / near, bottom / far)) - 1
    high = _rank(pattern.slope, max(top / near, top / far)) + 1
    return max(low, 0), min(high, rings)


@compiled
def select_candidates(  # arguments are positional, because compiled code cannot take keywords
    rays: Array, pattern: Pattern, distance: Array, lidar_from_map: Array, vehicles: Vehicles, out: Candidates
) -> int:
    """Find the rays that enter a vehicle's bounding box before ``distance`` (R,); returns their number.

    As many as fit into ``out`` are written. Where there are more the caller calls again with a longer one.
    """
    columns, rings = pattern.column_time_s.shape[0], pattern.elevation.shape[0]
    turn_s = np.abs(pattern.world_time_s[0])
    upright = abs(lidar_from_map[Z, X]) + abs(lidar_from_map[Z, Y]) < 1e-9
    written = 0
    for v in range(vehicles.pose.shape[0]):
        unit = np.float32(1.0)
        sx, sy, sz = unit / vehicles.scale[v, X], unit / vehicles.scale[v, Y], unit / vehicles.scale[v, Z]
        pose, motion = vehicles.pose[v], vehicles.motion[v]
        reach = turn_s * (np.hypot(motion[VX], motion[VY]) + vehicles.size[v, LENGTH] * np.abs(motion[YAW_RATE]))
        first_column, count, low, high = _window(pattern, pose, vehicles.size[v], reach, lidar_from_map)
        cos, sin = np.float32(np.cos(pose[HEADING])), np.float32(np.sin(pose[HEADING]))
        for k in range(count):
            column = (first_column + k) % columns
            t = pattern.world_time_s[column]
            if t != 0.0:
                yaw = pose[HEADING] + motion[YAW_RATE] * t
                cos, sin = np.float32(np.cos(yaw)), np.float32(np.sin(yaw))
            first = column * rings
            rx = np.float32(rays[first, X] - pose[X] - motion[VX] * t)
            ry = np.float32(rays[first, Y] - pose[Y] - motion[VY] * t)
            rz = np.float32(rays[first, Z] - pose[Z])
            o = ((cos * rx + sin * ry) * sx, (cos * ry - sin * rx) * sy, rz * sz)
            if upright:
                x, y = rays[first, DX], rays[first, DY]
                per_m = unit / np.sqrt(x * x + y * y)
                ahead = ((cos * x + sin * y) * sx * per_m, (cos * y - sin * x) * sy * per_m)
                low, high = _rings(pattern, vehicles.bounds[v], o, ahead, sz)
            for i in range(first + low, first + high):
                x, y = rays[i, DX], rays[i, DY]
                d = ((cos * x + sin * y) * sx, (cos * y - sin * x) * sy, rays[i, DZ] * sz)
                if _entry(vehicles.bounds[v], o, d) < distance[i]:
                    if written < out.ray.shape[0]:
                        for axis in range(3):
                            out.rays[written, axis] = o[axis] + vehicles.offset[v, axis]
                            out.rays[written, DX + axis] = d[axis]
                        out.ray[written] = i
                        out.vehicle[written] = v
                    written += 1
    return written
