"""BAT's behaviour tensor: closeness centralities of a graph over the cells, as the published loader computes them.

The weights were trained on it as it is, so it is reproduced with what is peculiar about it:

* Positions are polar, and distances between them are taken as if they were Cartesian. Empty cells are at the origin.
* Cell 20 holds the target, and hides a neighbour there.
* Positions are listed by cell and then by time, and read as if they were listed by time and then by cell. A graph
  therefore joins the paths of two or three cells instead of all cells at one time.
* Closeness stands for all three centralities (degree, closeness, eigenvector). Their changes are zero but for that of
  closeness, which runs over the vertices of a graph, not over time, and whose axes are mixed up by another reshape.

The published loader computes the 16 graphs of a sample in threads and takes them in the order in which they finish.
Here they are in order.
"""

from typing import Final

import numpy as np

from siren_ros.datasets.ngsim.grid import CELLS
from siren_ros.numerics.arrays import Floats, Floats32, Rows
from siren_ros.numerics.compiled import Array, compiled

_POINTS: Final = 16
_TARGET_CELL: Final = 20
_JOINED_FT: Final = float(np.log(200.0))
"""Vertices are joined where exp(−distance) is more than 0.005: it does not round to 0.00 then."""


def behaviour_tensor(own: Floats, neighbours: Floats, sample: Rows, cell: Rows) -> Floats32:
    """The behaviour tensor, shape ``(16, B, 39, 6)``.

    Args:
        own: Polar past of the targets (feet, radians), shape ``(B, 16, 2)``.
        neighbours: Polar past of their neighbours, shape ``(P, 16, 2)``.
        sample: Sample of each neighbour, shape ``(P,)``.
        cell: Cell of each neighbour, shape ``(P,)``.
    """
    grid = np.zeros((len(own), CELLS, _POINTS, 2))
    grid[sample, cell] = neighbours
    grid[:, _TARGET_CELL] = own
    return behaviours(closeness_centralities(np.round(grid, 2).reshape(len(own), _POINTS, CELLS, 2)))


def behaviours(closeness: Floats) -> Floats32:
    """The behaviour tensor ``(16, B, 39, 6)`` of closeness centralities ``(B, 16, 39)``."""
    change = np.zeros_like(closeness)
    change[..., :-1] = np.diff(closeness, axis=-1)
    mixed = np.round(change, 2).swapaxes(1, 2).reshape(closeness.shape)
    found = np.zeros((_POINTS, len(closeness), CELLS, 6), dtype=np.float32)
    found[..., 1] = mixed.swapaxes(0, 1)
    found[..., 3:] = np.round(closeness, 2).swapaxes(0, 1)[..., None]
    return found


def closeness_centralities(points: Floats) -> Floats:
    """Closeness centrality of every vertex of a graph, with the scaling for parts that are not connected.

    (S. Wasserman, K. Faust, "Social Network Analysis", 1994, p. 201.) Edges join points that are near each other.

    Args:
        points: Vertices of B × G graphs, at most 64 each, shape ``(B, G, V, 2)``.

    Returns:
        Shape ``(B, G, V)``.
    """
    vertices = points.shape[2]
    graphs = np.ascontiguousarray(points).reshape(-1, vertices, 2)
    return _closeness(graphs, _JOINED_FT**2).reshape(points.shape[:3])


@compiled
def _closeness(graphs: Array, joined_squared: float) -> Array:
    count, vertices = graphs.shape[0], graphs.shape[1]
    found = np.zeros((count, vertices))
    joined = np.zeros(vertices, dtype=np.uint64)
    one = np.uint64(1)
    for graph in range(count):
        for i in range(vertices):
            joined[i] = one << np.uint64(i)
            for j in range(i):
                dx = graphs[graph, i, 0] - graphs[graph, j, 0]
                dy = graphs[graph, i, 1] - graphs[graph, j, 1]
                if dx * dx + dy * dy < joined_squared:
                    joined[i] |= one << np.uint64(j)
                    joined[j] |= one << np.uint64(i)
        for start in range(vertices):
            found[graph, start] = _closeness_of(joined, start)
    return found


@compiled
def _closeness_of(joined: Array, start: int) -> float:
    """Breadth-first search; sets of vertices are the bits of a number."""
    vertices = len(joined)
    one, none = np.uint64(1), np.uint64(0)
    reached = one << np.uint64(start)
    frontier = reached
    hops, others, total = 0, 0, 0
    while frontier != none:
        following = none
        for vertex in range(vertices):
            if (frontier >> np.uint64(vertex)) & one:
                following |= joined[vertex]
        frontier = following & ~reached
        reached |= frontier
        hops += 1
        rest = frontier
        while rest != none:
            rest &= rest - one
            others += 1
            total += hops
    return others / total * (others / (vertices - 1)) if total else 0.0
