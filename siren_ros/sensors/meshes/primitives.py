"""Small closed solids of one material: boxes, cylinders, extruded polygons, rounded crowns."""

import mapbox_earcut
import numpy as np
import numpy.typing as npt
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient

from siren_ros.sensors.meshes.material import Material
from siren_ros.sensors.meshes.mesh import Mesh

Rgb = tuple[int, int, int]
Point3 = tuple[float, float, float]

_BOX_TRIANGLES = np.array(
    [
        (0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4),
        (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7),
    ],
    dtype=np.uint32,
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


def frustum(
    base: Point3, height_m: float, radii_m: tuple[float, float], sides: int, material: Material, colour: Rgb
) -> Mesh:
    """An upright cylinder or cone stump on ``base`` with lower and upper radius; closed."""
    angle = np.arange(sides) * (2 * np.pi / sides)
    ring = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(sides)))
    low = ring * (radii_m[0], radii_m[0], 0.0)
    high = ring * (radii_m[1], radii_m[1], 0.0) + (0.0, 0.0, height_m)
    i = np.arange(sides)
    j = (i + 1) % sides
    side = np.concatenate((np.column_stack((i, j, j + sides)), np.column_stack((i, j + sides, i + sides))))
    fan = i[1:-1]
    top = np.column_stack((np.full(len(fan), sides), fan + sides, fan + sides + 1))
    bottom = np.column_stack((np.zeros_like(fan), fan + 1, fan))
    return Mesh.uniform(np.concatenate((low, high)) + base, np.concatenate((side, top, bottom)), material, colour)


def flat_polygons(polygons: list[Polygon], z_m: float, material: Material, colour: Rgb) -> Mesh:
    """Horizontal faces that look up, with the polygons' holes left open; shapely polygons in metres."""
    return Mesh.concatenate(
        [
            Mesh.uniform(np.column_stack((points, np.full(len(points), z_m))), triangles, material, colour)
            for points, triangles in map(triangulated, polygons)
            if len(triangles)
        ]
    )


def triangulated(polygon: Polygon) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]:
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
    """Upright faces along a polygon's rings that look out of the polygon."""
    parts = []
    for ring in (orient(polygon).exterior, *orient(polygon).interiors):
        points = np.asarray(ring.coords)[:, :2]
        count = len(points)
        vertices = np.concatenate(
            [np.column_stack((points, np.full(count, z_m))) for z_m in (z0_m, z1_m)],
        )
        i = np.arange(count - 1)
        quads = np.concatenate(
            (np.column_stack((i, i + 1, i + 1 + count)), np.column_stack((i, i + 1 + count, i + count)))
        )
        parts.append(Mesh.uniform(vertices, quads, material, colour))
    return Mesh.concatenate(parts)


_GOLDEN = (1 + 5**0.5) / 2
_ICOSAHEDRON = np.array(
    [(-1, _GOLDEN, 0), (1, _GOLDEN, 0), (-1, -_GOLDEN, 0), (1, -_GOLDEN, 0),
     (0, -1, _GOLDEN), (0, 1, _GOLDEN), (0, -1, -_GOLDEN), (0, 1, -_GOLDEN),
     (_GOLDEN, 0, -1), (_GOLDEN, 0, 1), (-_GOLDEN, 0, -1), (-_GOLDEN, 0, 1)]
) / np.hypot(1, _GOLDEN)  # fmt: skip
_ICOSAHEDRON_FACES = np.array(
    [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
     (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7),
     (9, 8, 1)]
)  # fmt: skip


def sphere_points(subdivisions: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Unit directions and outward triangles of an icosahedron, each face split in four ``subdivisions`` times."""
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
