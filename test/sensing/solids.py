"""What every solid of triangles has: a volume, a surface without holes, a mirror image."""

from collections import Counter

import numpy as np

from siren_ros.sensing.meshes.mesh import Material


def volume(mesh):
    """Signed volume by the divergence theorem; positive where normals look outward."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, k]].astype(float) for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def areas(mesh):
    """Of each triangle."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, k]].astype(float) for k in range(3))
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def open_edges(mesh):
    """Edges that are not passed as often in one direction as in the other; 0 for a closed surface."""
    corners = [tuple(point) for point in np.round(mesh.vertices_m.astype(float), 4).tolist()]
    passed: Counter[tuple[object, object]] = Counter()
    for triangle in mesh.triangles.tolist():
        points = [corners[index] for index in triangle]
        for start, end in zip(points, points[1:] + points[:1], strict=True):
            passed[start, end] += 1
    return sum(count != passed[end, start] for (start, end), count in passed.items())


def by_material(mesh):
    """Triangles, area in m², middle, mean normal and mean colour of each material."""
    area, middle = areas(mesh), mesh.vertices_m.astype(float)[mesh.triangles].mean(axis=1)
    values = np.column_stack((middle, mesh.normals, mesh.colour_rgb))
    return {
        Material(code).name: [int(part.sum()), area[part].sum(), *np.average(values[part], axis=0, weights=area[part])]
        for code in np.unique(mesh.material)
        for part in [mesh.material == code]
    }
