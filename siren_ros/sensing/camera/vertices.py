"""Vertices as the graphics card gets them, and the selection of the triangles that a camera can see.

Normal, material and colour belong to triangles. OpenGL takes such "flat" values from a triangle's last vertex, so
triangles can share vertices as long as each has a last vertex with its own values. That needs about
one vertex per triangle instead of three, and a software rasteriser's time goes by vertices. For the same reason
invisible triangles are left out before OpenGL gets them.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.compiled import Array, X, Y, Z, compiled
from siren_ros.sensing.camera.occlusion import is_hidden
from siren_ros.sensing.meshes.mesh import Mesh

VERTEX: Final = np.dtype([("position", "<f4", 3), ("normal_material", "<f2", 4), ("colour", "u1", 4)])
"""Record of a vertex, 24 bytes. The colour's fourth byte is the semantic class; half floats hold material codes
exactly."""

_FIRST, _SECOND, _LAST = range(3)
"""Corners of a triangle."""
_OFFSET: Final = 3
"""Column of planes, after the normal."""


@dataclass(frozen=True, eq=False)
class IndexedMesh:
    """Triangles for ``glDrawElements``."""

    vertices: npt.NDArray[np.void]
    """Records of dtype ``VERTEX``, shape ``(V,)``."""
    triangles: npt.NDArray[np.uint32]
    """Rows of ``vertices``, shape ``(T, 3)``, in the mesh's order; the last corner holds the triangle's values."""


def index_mesh(mesh: Mesh, semantic_of_material: npt.NDArray[np.uint8]) -> IndexedMesh:
    """Index a mesh with few vertices: a greedy rule chooses which corner of each triangle comes last."""
    values = np.zeros(len(mesh), VERTEX)
    values["normal_material"][:, :3] = mesh.normals
    values["normal_material"][:, 3] = mesh.material
    values["colour"][:, :3] = mesh.colour_rgb
    values["colour"][:, 3] = semantic_of_material[mesh.material]
    look = values.view(np.uint8).reshape(len(mesh), VERTEX.itemsize)[:, 12:]
    key = _distinct(look)[1]
    first, welded = _distinct(mesh.vertices_m + np.float32(0.0))
    points = mesh.vertices_m[first]
    triangles = welded[mesh.triangles]
    source = np.empty(len(points) + len(mesh), np.int64)
    owner = np.empty(len(points) + len(mesh), np.int64)
    count = _share(triangles, key, source, owner, len(points))
    vertices = np.zeros(count, VERTEX)
    owned = owner[:count] >= 0
    vertices[owned] = values[owner[:count][owned]]
    vertices["position"] = points[source[:count]]
    return IndexedMesh(vertices, triangles.astype(np.uint32))


def _distinct(rows: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Group equal rows by their bytes: the index of one row of each group, and the group of each row."""
    whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).reshape(-1)
    _, first, kind = np.unique(whole, return_index=True, return_inverse=True)
    return first.astype(np.int64), kind.astype(np.int64).reshape(-1)


@compiled
def _share(triangles: Array, key: Array, source: Array, owner: Array, points: int) -> int:
    """Reorder or copy corners so that no two triangles share a last corner; returns the number of vertices.

    ``owner`` becomes the triangle whose values a vertex holds (−1 for none), ``source`` the point that it stands for.

    """
    for v in range(points):
        source[v] = v
        owner[v] = -1
    count = points
    for t in range(triangles.shape[0]):
        chosen = -1
        for k in range(3):
            o = owner[triangles[t, k]]
            if o >= 0 and key[o] == key[t]:
                chosen = k
                break
            if o < 0 and chosen < 0:
                chosen = k
        a, b, c = triangles[t, _FIRST], triangles[t, _SECOND], triangles[t, _LAST]
        if chosen < 0:
            source[count] = source[c]
            triangles[t, _LAST] = count
            owner[count] = t
            count += 1
        else:
            if chosen == 0:
                triangles[t, _FIRST], triangles[t, _SECOND], triangles[t, _LAST] = b, c, a
            elif chosen == 1:
                triangles[t, _FIRST], triangles[t, _SECOND], triangles[t, _LAST] = c, a, b
            if owner[triangles[t, _LAST]] < 0:
                owner[triangles[t, _LAST]] = t
    return count


@compiled
def chunks_in_view(low: Array, high: Array, reach: Array, planes: Array, eye: Array, distance: Array) -> None:
    """Set the distance of every box from the eye, infinite where it is out of reach or outside the view.

    ``low`` and ``high`` are the boxes' corners (K, 3) and ``reach`` the distance up to which each is drawn (K,);
    ``planes`` are ``(a, b, c, d)`` with the visible side positive (P, 4); ``eye`` (3,); ``distance`` is the result
    (K,); all float64.
    """
    for k in range(low.shape[0]):
        square = 0.0
        for axis in range(3):
            gap = max(low[k, axis] - eye[axis], 0.0, eye[axis] - high[k, axis])
            square += gap * gap
        far = np.sqrt(square)
        inside = far < reach[k]
        for p in range(planes.shape[0]):
            most = planes[p, _OFFSET]
            for axis in range(3):
                n = planes[p, axis]
                most += n * (high[k, axis] if n > 0.0 else low[k, axis])
            inside = inside and most > 0.0
        distance[k] = far if inside else np.inf


@compiled
def visible_triangles(
    chunks: Array,
    draws: Array,
    first: Array,
    distance: Array,
    planes: Array,
    area: Array,
    triangles: Array,
    circles: Array,
    chunk_circles: Array,
    slopes: Array,
    eye: Array,
    smallest: float,
    out: Array,
    counts: Array,
) -> int:
    """Copy the triangles that turn their front to the eye, are large enough and not hidden; returns how many.

    The triangles of a draw stand together, in the order of the draws, and ``counts`` (D,) becomes how many each has.

    A triangle of area A whose plane lies h below the eye shows A h / d³ steradians at distance d; ``smallest`` is the
    least that is drawn. The chunk's distance stands for the triangle's, so that what is dropped is smaller than that.
    ``chunks`` (C,) are rows of ``first`` (int64), which holds the first triangle of each chunk and the end (K + 1,);
    ``draws`` (C,) are what draws them; ``distance`` from the eye to each chunk is float64 (K,). Of the triangles,
    ``planes`` are the outward normal and its product with a corner, float32 (T, 4), ``area`` is float32 (T,), and
    ``triangles`` are vertices, uint32 (T, 3), as in the result ``out``, which has room for all triangles of the chunks.
    ``circles`` bound the triangles and ``chunk_circles`` the chunks, and ``slopes`` are those of the horizon around the
    eye (``occlusion``).
    """
    x, y, z = np.float32(eye[X]), np.float32(eye[Y]), np.float32(eye[Z])
    count = 0
    for d in range(counts.shape[0]):
        before = count
        for c in range(chunks.shape[0]):
            chunk = chunks[c]
            if draws[c] != d or is_hidden(slopes, eye, chunk_circles[chunk]):
                continue
            least = np.float32(smallest * distance[chunk] ** 3)
            for t in range(first[chunk], first[chunk + 1]):
                above = planes[t, X] * x + planes[t, Y] * y + planes[t, Z] * z - planes[t, _OFFSET]
                large = above > np.float32(-0.01) and area[t] * above >= least
                if large and not is_hidden(slopes, eye, circles[t]):
                    out[count, _FIRST] = triangles[t, _FIRST]
                    out[count, _SECOND] = triangles[t, _SECOND]
                    out[count, _LAST] = triangles[t, _LAST]
                    count += 1
        counts[d] = count - before
    return count
