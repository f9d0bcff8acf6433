"""Selects the triangles that a camera can see before OpenGL gets them: each is expensive in software."""

import numpy as np

from siren_ros.numerics.compiled import Array, compiled


@compiled
def chunks_in_view(low: Array, high: Array, reach: Array, planes: Array, eye: Array, distance: Array) -> None:
    """Set the distance of every box from the eye, infinite where it is out of reach or outside the view.

    Args:
        low: Lowest corners, float64 (K, 3).
        high: Highest corners, float64 (K, 3).
        reach: Distance up to which each box is drawn, float64 (K,).
        planes: ``(a, b, c, d)`` with the visible side positive, float64 (P, 4).
        eye: Where the camera is, float64 (3,).
        distance: Result, float64 (K,).
    """
    for k in range(low.shape[0]):
        square = 0.0
        for axis in range(3):
            gap = max(low[k, axis] - eye[axis], 0.0, eye[axis] - high[k, axis])
            square += gap * gap
        far = np.sqrt(square)
        inside = far < reach[k]
        for p in range(planes.shape[0]):
            most = planes[p, 3]
            for axis in range(3):
                n = planes[p, axis]
                most += n * (high[k, axis] if n > 0.0 else low[k, axis])
            inside = inside and most > 0.0
        distance[k] = far if inside else np.inf


@compiled
def visible_triangles(
    chunks: Array,
    first: Array,
    distance: Array,
    planes: Array,
    area: Array,
    triangles: Array,
    eye: Array,
    smallest: float,
    out: Array,
) -> int:
    """Copy the triangles of chunks that turn their front to the eye and are large enough; returns how many.

    A triangle of area A whose plane lies h below the eye shows A h / d³ steradians at distance d. The chunk's distance
    stands for the triangle's, so that what is dropped is smaller than asked for.

    Args:
        chunks: Rows of ``first``, int64 (C,).
        first: First triangle of each chunk, and the end, int64 (K + 1,).
        distance: From the eye to each chunk, float64 (K,).
        planes: Outward normal and its product with a corner, float32 (T, 4).
        area: float32 (T,).
        triangles: Indices of vertices, uint32 (T, 3).
        eye: Where the camera is, float64 (3,).
        smallest: Least solid angle, steradians.
        out: Result, uint32 (at least as many as the chunks have, 3).
    """
    x, y, z = np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2])
    count = 0
    for c in range(chunks.shape[0]):
        chunk = chunks[c]
        least = np.float32(smallest * distance[chunk] ** 3)
        for t in range(first[chunk], first[chunk + 1]):
            above = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z - planes[t, 3]
            if above > np.float32(-0.01) and area[t] * above >= least:
                out[count, 0] = triangles[t, 0]
                out[count, 1] = triangles[t, 1]
                out[count, 2] = triangles[t, 2]
                count += 1
    return count
