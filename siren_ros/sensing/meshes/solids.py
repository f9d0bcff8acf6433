"""Solids that shapes are built from: boxes, cylinders, extruded polygons, rounded crowns, and lofted vehicle bodies.

A lofted body is a rounded shell through cross-sections, which follow from side profile, plan view and wheel arches. A
cross-section at distance ``s`` behind the front bumper has a half ring of nine points, from the middle of the
underbody outward and up to the middle of the roof; the other half is its mirror image.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import mapbox_earcut
import numpy as np
import numpy.typing as npt
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient

from siren_ros.base.numerics.arrays import Floats
from siren_ros.sensing.meshes.mesh import Material, Mesh

Knots = tuple[tuple[float, float], ...]
Finish = tuple[Material, tuple[int, int, int]]
"""Material and colour of a face."""

ARCH_CLEARANCE_M = 0.045
"""Gap between tyre and wheel arch."""
_ARCH_STEPS = 5
_MERGE_M = 0.07
"""Knots of the outlines that are nearer than this to a cross-section add none, except the knots that round the ends."""
_SLACK_M = 0.1
"""Tolerance by which a roof may lie below the belt line and outside the side: a load bed has only edges."""


class Band(IntEnum):
    """Strips of faces between neighbouring points of the half ring, from the underbody to the roof."""

    UNDERBODY = 0
    WELL_WALL = 1
    WELL_ROOF = 2
    LOWER_SIDE = 3
    UPPER_SIDE = 4
    WINDOW = 5
    ROOF_EDGE = 6
    ROOF = 7


@dataclass(frozen=True)
class Axle:
    """Wheels of one axle: distance behind the front bumper and the tyre's size."""

    s_m: float
    wheel_radius_m: float
    tyre_width_m: float


@dataclass(frozen=True)
class BodyProfile:
    """Outlines of a shell: heights above the ground and half widths over ``s``, linear between knots ``(s, value)``."""

    length_m: float
    """Length of the vehicle, whose front bumper is at ``s`` 0; the shell may cover only a part of it."""
    top_m: Knots
    belt_m: Knots
    bottom_m: Knots
    half_width_m: Knots
    roof_half_width_m: Knots
    axles: tuple[Axle, ...] = ()
    roof_drop_m: float = 0.07
    """How far the roof's edge lies below its middle."""
    tuck: float = 0.965
    """Half width at the sill and at the belt line, relative to the widest line between them."""
    extra_stations_m: tuple[float, ...] = ()
    zone_splits: tuple[float, float] = (0.52, 0.86)
    """Where zones 1 and 2 of the end faces begin, relative to their half width."""
    crease: float = 0.6
    """Height of the widest line, from 0 (bottom) to 1 (belt line)."""

    def __post_init__(self) -> None:
        """Check the outlines; ValueError if they cannot form a body, usually because a number is mistyped."""
        outlines = self._outlines
        places = [[s for s, _ in outline] for outline in outlines]
        ordered = all(len(row) > 1 and np.diff(row).min() > 0.0 for row in places)
        if not ordered or len({(row[0], row[-1]) for row in places}) > 1:
            raise ValueError("each outline's two knots or more go from the same start to the same end")
        s = np.unique(np.concatenate(places))
        top, belt, bottom, width, roof = (_at(outline, s) for outline in outlines)
        if (top < belt - _SLACK_M).any() or (belt < bottom).any() or (roof > width + _SLACK_M).any():
            raise ValueError("outlines of the roof above the belt above the sill, the roof no wider than the body")

    @property
    def _outlines(self) -> tuple[Knots, ...]:
        return self.top_m, self.belt_m, self.bottom_m, self.half_width_m, self.roof_half_width_m

    def stations_m(self) -> Floats:
        """Distances behind the front bumper of all cross-sections, increasing."""
        start, end = self.top_m[0][0], self.top_m[-1][0]
        fixed = [start, end, *(s for s in self.extra_stations_m if start < s < end)]
        angle = np.linspace(0.0, np.pi, _ARCH_STEPS + 1)
        for axle in self.axles:
            fixed.extend((axle.s_m - self._arch_reach_m(axle) * np.cos(angle)).tolist())
        for s in sorted({s for outline in self._outlines for s, _ in outline if start < s < end}):
            rounding = s - start < 0.2 or end - s < 0.12
            if min(abs(s - other) for other in fixed) > (1e-3 if rounding else _MERGE_M):
                fixed.append(s)
        return np.array(sorted(fixed))

    def _arch_reach_m(self, axle: Axle) -> float:
        radius = axle.wheel_radius_m + ARCH_CLEARANCE_M
        drop = axle.wheel_radius_m - float(_at(self.bottom_m, axle.s_m))
        return float(np.sqrt(radius**2 - min(max(drop, 0.0), 0.95 * radius) ** 2))

    def arch_m(self, s_m: Floats) -> Floats:
        """Height of the sill at ``s``: the bottom, or the wheel arch above it."""
        height = _at(self.bottom_m, s_m)
        for axle in self.axles:
            radius = axle.wheel_radius_m + ARCH_CLEARANCE_M
            inside = np.clip(radius**2 - (s_m - axle.s_m) ** 2, 0.0, None)
            arch = np.where(inside > 0, axle.wheel_radius_m + np.sqrt(inside), 0.0)
            under = np.abs(s_m - axle.s_m) < self._arch_reach_m(axle) - 1e-3
            height = np.where(under, np.maximum(height, arch), height)
        return np.asarray(height)

    def half_rings_m(self) -> Floats:
        """Cross-sections as ``(x, y, z)`` in ``base_link``, shape ``(stations, 9, 3)``."""
        s = self.stations_m()
        top, belt, bottom, width, roof = (_at(outline, s) for outline in self._outlines)
        arch = self.arch_m(s)
        tyre = max((axle.tyre_width_m for axle in self.axles), default=0.2)
        well = np.minimum(width - tyre - 0.06, 0.9 * width)
        crease = np.minimum(np.maximum(bottom + self.crease * (belt - bottom), arch + 0.02), belt - 0.01)
        drop = np.minimum(self.roof_drop_m, 0.6 * (top - belt))
        zero = np.zeros_like(s)
        y = (zero, well, well, self.tuck * width, width, self.tuck * width, roof, 0.86 * roof, zero)
        z = (bottom, bottom, arch, arch, crease, belt, top - drop, top - 0.22 * drop, top)
        x = np.broadcast_to((self.length_m / 2 - s)[:, None], (len(s), len(y)))
        return np.stack((x, np.stack(y, axis=1), np.stack(z, axis=1)), axis=-1)


def _at(knots: Knots, s_m: npt.ArrayLike) -> Floats:
    s, value = np.array(knots).T
    return np.asarray(np.interp(np.asarray(s_m, dtype=np.float64), s, value))


ShellFinish = Callable[[Band, float, int], Finish]
"""Gives the finish of a shell's face from its band, its middle ``s``, and its side (+1 left, −1 right)."""
EndFinish = Callable[[Band, int], Finish]
"""Gives the finish of a face at an end from its band and zone: −2 is rightmost, 0 the middle, +2 leftmost."""


def loft(profile: BodyProfile, side: ShellFinish, front: EndFinish, rear: EndFinish) -> Mesh:
    """Build a closed shell along the profile, in ``base_link``; faces without area are left out."""
    half = profile.half_rings_m()
    ring = np.concatenate((half, half[:, -2:0:-1] * (1.0, -1.0, 1.0)), axis=1)
    stations, around = ring.shape[:2]
    s = profile.length_m / 2 - ring[:, 0, 0]
    faces: list[tuple[Floats, Finish]] = []
    for i in range(stations - 1):
        middle = float(s[i] + s[i + 1]) / 2
        for j in range(around):
            k = (j + 1) % around
            quad = np.stack((ring[i, j], ring[i + 1, j], ring[i + 1, k], ring[i, k]))
            left = j < len(Band)
            faces.append((quad, side(Band(j if left else around - 1 - j), middle, 1 if left else -1)))
    faces.extend(_end_faces(half[0], profile.zone_splits, front, reverse=False))
    faces.extend(_end_faces(half[-1], profile.zone_splits, rear, reverse=True))
    return from_quads(faces)


def _end_faces(
    half: Floats, splits: tuple[float, float], finish: EndFinish, *, reverse: bool
) -> list[tuple[Floats, Finish]]:
    faces = []
    inner, outer = splits
    fractions = (-1.0, -outer, -inner, inner, outer, 1.0)
    for band in list(Band)[Band.LOWER_SIDE :]:
        low, high = half[band], half[band + 1]
        for zone in range(-2, 3):
            right, left = (np.array((1.0, fractions[zone + k], 1.0)) for k in (2, 3))
            quad = np.stack((low * right, low * left, high * left, high * right))
            faces.append((quad[::-1] if reverse else quad, finish(band, zone)))
    return faces


def from_quads(faces: list[tuple[Floats, Finish]]) -> Mesh:
    """Build a mesh of quads ``(4, 3)``, each with its finish; triangles smaller than 1 mm² are left out."""
    corners = np.stack([quad for quad, _ in faces])
    triangles = np.concatenate((corners[:, (0, 1, 2)], corners[:, (0, 2, 3)]), axis=1).reshape(-1, 3, 3)
    material = np.repeat(np.array([int(finish[0]) for _, finish in faces], dtype=np.uint8), 2)
    colour = np.repeat(np.array([finish[1] for _, finish in faces], dtype=np.uint8), 2, axis=0)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    keep = np.linalg.norm(cross, axis=1) > 2e-6
    vertices, inverse = np.unique(np.round(triangles[keep].reshape(-1, 3), 5), axis=0, return_inverse=True)
    return Mesh(vertices.astype(np.float32), inverse.reshape(-1, 3).astype(np.uint32), material[keep], colour[keep])


Rgb = tuple[int, int, int]
Point3 = tuple[float, float, float]

_BOX_TRIANGLES = np.array(
    [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4),
     (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7)], np.uint32
)  # fmt: skip


def box(low: Point3, high: Point3, material: Material, colour: Rgb) -> Mesh:
    """An axis-parallel box between two corners, 12 triangles; ValueError where a corner is on the wrong side."""
    if any(start > end for start, end in zip(low, high, strict=True)):
        raise ValueError(f"a box from {low} to {high}")
    (x0, y0, z0), (x1, y1, z1) = low, high
    corners = [(x, y, z) for z in (z0, z1) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    return Mesh.uniform(corners, _BOX_TRIANGLES, material, colour)


def hexahedron(corners: npt.ArrayLike, material: Material, colour: Rgb) -> Mesh:
    """A box with free corners: four of the lower face counter-clockwise from above, then the four above them."""
    return Mesh.uniform(corners, _BOX_TRIANGLES, material, colour)


def hexahedra(corners: Floats, material: Material, colour: Rgb) -> Mesh:
    """Many boxes with free corners, ``(N, 8, 3)``, each in the order of ``hexahedron``."""
    first = 8 * np.arange(len(corners))[:, None, None]
    return Mesh.uniform(corners.reshape(-1, 3), (first + _BOX_TRIANGLES).reshape(-1, 3), material, colour)


def frustum(
    base: Point3, height_m: float, radii_m: tuple[float, float], sides: int, material: Material, colour: Rgb
) -> Mesh:
    """An upright closed cylinder or truncated cone on ``base``, with lower and upper radius."""
    angle = np.arange(sides) * (2 * np.pi / sides)
    ring = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(sides)))
    low = ring * (radii_m[0], radii_m[0], 0.0)
    high = ring * (radii_m[1], radii_m[1], 0.0) + (0.0, 0.0, height_m)
    i = np.arange(sides)
    j, fan = (i + 1) % sides, i[1:-1]
    side = (i, j, j + sides), (i, j + sides, i + sides)
    top, bottom = (np.full(len(fan), sides), fan + sides, fan + sides + 1), (np.zeros_like(fan), fan + 1, fan)
    triangles = np.concatenate([np.column_stack(corners) for corners in (*side, top, bottom)])
    return Mesh.uniform(np.concatenate((low, high)) + base, triangles, material, colour)


def flat_polygons(polygons: list[Polygon], z_m: float, material: Material, colour: Rgb) -> Mesh:
    """Horizontal faces that face up; holes of the polygons stay open. Polygons are in metres."""
    return Mesh.joined(
        *[
            Mesh.uniform(np.column_stack((points, np.full(len(points), z_m))), triangles, material, colour)
            for points, triangles in map(triangulated, polygons)
            if len(triangles)
        ]
    )


def triangulated(polygon: Polygon) -> tuple[Floats, npt.NDArray[np.uint32]]:
    """Corners ``(K, 2)`` and triangles ``(T, 3)``, counter-clockwise from above, of a polygon with holes."""
    rings = [np.asarray(ring.coords)[:-1, :2] for ring in (polygon.exterior, *polygon.interiors)]
    points = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    triangles = mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3).astype(np.uint32)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    return points, triangles[np.abs(area) > 1e-12]


def walls(polygon: Polygon, z0_m: float, z1_m: float, material: Material, colour: Rgb) -> Mesh:
    """Upright faces along a polygon's rings; they face away from the polygon."""
    parts = []
    for ring in (orient(polygon).exterior, *orient(polygon).interiors):
        points = np.asarray(ring.coords)[:, :2]
        count = len(points)
        vertices = np.concatenate([np.column_stack((points, np.full(count, z_m))) for z_m in (z0_m, z1_m)])
        i = np.arange(count - 1)
        halves = (i, i + 1, i + 1 + count), (i, i + 1 + count, i + count)
        parts.append(Mesh.uniform(vertices, np.concatenate([*map(np.column_stack, halves)]), material, colour))
    return Mesh.joined(*parts)


_PHI = (1 + 5**0.5) / 2
_ICOSAHEDRON = np.array(
    [(-1, _PHI, 0), (1, _PHI, 0), (-1, -_PHI, 0), (1, -_PHI, 0), (0, -1, _PHI), (0, 1, _PHI), (0, -1, -_PHI),
     (0, 1, -_PHI), (_PHI, 0, -1), (_PHI, 0, 1), (-_PHI, 0, -1), (-_PHI, 0, 1)]
) / np.hypot(1, _PHI)  # fmt: skip
_ICOSAHEDRON_FACES = np.array(
    [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
     (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7),
     (9, 8, 1)]
)  # fmt: skip


def sphere_points(subdivisions: int) -> tuple[Floats, npt.NDArray[np.int64]]:
    """Unit directions and outward triangles of an icosahedron whose faces are split in four ``subdivisions`` times."""
    points, faces = _ICOSAHEDRON, _ICOSAHEDRON_FACES
    for _ in range(subdivisions):
        edges = np.sort(np.concatenate((faces[:, (0, 1)], faces[:, (1, 2)], faces[:, (2, 0)])), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = points[unique].mean(axis=1)
        new = inverse.reshape(3, -1).T + len(points)
        points = np.concatenate((points, middle / np.linalg.norm(middle, axis=1, keepdims=True)))
        a, b, c = faces.T
        ab, bc, ca = new.T
        faces = np.concatenate([np.column_stack(x) for x in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    return points, faces
