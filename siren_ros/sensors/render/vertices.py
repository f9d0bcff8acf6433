"""Vertices as the graphics card gets them: three per triangle, each with its triangle's normal, material and colour."""

from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.sensors.scene.mesh import Mesh

VERTEX: Final = np.dtype([("position", "<f4", 3), ("normal_material", "<f2", 4), ("colour", "u1", 4)])
"""24 bytes; the fourth byte of the colour is the semantic class. Half floats hold material codes exactly."""
VERTEX_FORMAT: Final = "3f 4f2 4f1"
VERTEX_NAMES: Final = ("in_position", "in_normal", "in_colour")


def vertices_of(mesh: Mesh, semantic_of_material: npt.NDArray[np.uint8]) -> npt.NDArray[np.void]:
    """Vertices of all triangles in order, dtype ``VERTEX``, shape ``(3 T,)``."""
    out = np.zeros((len(mesh), 3), VERTEX)
    out["position"] = mesh.vertices_m[mesh.triangles]
    out["normal_material"][..., :3] = mesh.normals[:, None, :]
    out["normal_material"][..., 3] = mesh.material[:, None]
    out["colour"][..., :3] = mesh.colour_rgb[:, None, :]
    out["colour"][..., 3] = semantic_of_material[mesh.material][:, None]
    return out.reshape(-1)
