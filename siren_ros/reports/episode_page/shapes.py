"""Stores what the page draws as columns of triangles: scene around the EMV's path, signals, actors."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.reports.episode_page.columns import ColumnFile
from siren_ros.sensing.meshes.mesh import LENSES, Bytes, LampColour, Material, Mesh, StaticScene, Triangles
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.world.actors import ActorClass

STATIC_TRIANGLES: Final = 190_000
"""Largest number of triangles of the scene. The page may draw 300,000; the rest is for the actors."""
_UNIT_M: Final = 0.001
_GROUND: Final = (
    *(Material.GROUND, Material.GRASS, Material.ASPHALT, Material.SHOULDER_ASPHALT, Material.MARKING_WHITE),
    *(Material.MARKING_YELLOW, Material.KERB, Material.SIDEWALK, Material.MEDIAN),
)
_GROUND_FIRST: Final = 0.25
"""Factor on the distance of the ground: distant roads matter more than distant trees."""
_PLAIN, _PAINT = 0, 1
_SLENDER: Final = (Material.SIGNAL_HOUSING, Material.METAL_POLE, Material.STOP_SIGN)
"""Materials of thin objects. They hide little, so that the page need not cut them open for the view."""
_SURFACES: Final = {
    Material.CAR_PAINT: _PAINT,
    Material.CLOTHING: _PAINT,
    Material.BRAKE_LAMP: 2,
    Material.INDICATOR_LEFT_LAMP: 3,
    Material.INDICATOR_RIGHT_LAMP: 4,
    Material.BEACON_BLUE: 5,
    Material.BEACON_RED: 6,
    Material.HEAD_LAMP: 7,
}
"""Codes in the page's script for surfaces that have the actor's colour or can shine; all others are plain."""
_SURFACE_OF: Final = np.array([_SURFACES.get(material, _PLAIN) for material in Material])
_CLOTHES: Final = (255, 255, 255)


def add_static_scene(
    file: ColumnFile, records: Sequence[EpisodeRecord], scene: StaticScene, prefix: str = "", pictures: int = 1
) -> dict[str, Any]:
    """Add the mesh without the lenses of signals, and the lenses; returns the lamps for the head.

    ``records`` are the episodes in it. The columns' names begin with ``prefix``.
    """
    mesh = scene.mesh
    lenses = np.isin(mesh.material, LENSES)
    kept = _nearest(records, mesh, np.flatnonzero(~lenses), STATIC_TRIANGLES // pictures)
    _add_mesh(file, f"{prefix}static", mesh, kept, np.isin(mesh.material, _SLENDER).astype(np.intp))
    chosen = [np.arange(lamp.start, lamp.stop) for lamp in scene.signal_lamps]
    corners = np.concatenate([mesh.triangles[rows].ravel() for rows in chosen]) if chosen else np.empty(0, np.uint32)
    file.add(f"{prefix}lamp.corners", mesh.vertices_m[corners], _UNIT_M)
    return {
        "lamps": [
            [lamp.signal_id, lamp.link, lamp.colour.value, 3 * (lamp.stop - lamp.start)] for lamp in scene.signal_lamps
        ],
        "lamp_letters": {colour.value: colour.lit_by for colour in LampColour},
    }


def _nearest(
    records: Sequence[EpisodeRecord], mesh: Mesh, candidates: npt.NDArray[np.intp], most: int
) -> npt.NDArray[np.intp]:
    """Select triangles, in order: all, or those nearest to the EMVs' paths."""
    if len(candidates) <= most:
        return candidates
    ways = [each.rows.xy_m[np.isin(each.rows.actor_id, each.emv_ids)] for each in records]
    tree = cKDTree(np.concatenate(ways if any(map(len, ways)) else [each.rows.xy_m for each in records])[::5])
    centres = mesh.vertices_m[mesh.triangles[candidates]].mean(axis=1)[:, :2]
    distance_m, _ = tree.query(centres)
    distance_m[np.isin(mesh.material[candidates], _GROUND)] *= _GROUND_FIRST
    kept = np.argsort(distance_m, kind="stable")[:most]
    return np.sort(candidates[kept])


def add_shapes(file: ColumnFile, classes: Iterable[ActorClass]) -> None:
    """Add the shape of each class at rest in ``base_link``, and its moving parts (``VehicleShape.parts``)."""
    for actor_class in classes:
        shape = vehicle_shape(actor_class)
        mesh = shape.at_rest
        surface = _SURFACE_OF[mesh.material]
        rgb = np.where((surface == _PAINT)[:, None], _CLOTHES, mesh.colour_rgb).astype(np.uint8)
        painted = Mesh(mesh.vertices_m, mesh.triangles, mesh.material, rgb)
        name = f"shape.{actor_class.name}"
        vertex = _add_mesh(file, name, painted, np.arange(len(mesh)), surface)
        ends = np.cumsum([len(part.vertices_m) for part, _ in shape.parts])
        file.add(f"{name}.part", np.searchsorted(ends, vertex, side="right"))
        file.add(f"{name}.hubs", [hub for _, hub in shape.parts], _UNIT_M, order=0)


def _add_mesh(
    file: ColumnFile,
    name: str,
    mesh: Mesh,
    rows: npt.NDArray[np.intp],
    surface: npt.NDArray[np.intp],
) -> npt.NDArray[np.intp]:
    """Add some triangles with colour and surface at each vertex; returns the mesh's vertices used."""
    code = _packed_rgb(mesh.colour_rgb[rows]) + (surface[rows] << 24)
    vertex, code, triangles = _split_by_code(mesh.triangles[rows], code)
    file.add(f"{name}.xyz", mesh.vertices_m[vertex].T, _UNIT_M)
    file.add(f"{name}.triangles", triangles)
    file.add(f"{name}.rgb", code & 0xFFFFFF)
    file.add(f"{name}.surface", code >> 24)
    return vertex


def _packed_rgb(colour_rgb: Bytes) -> npt.NDArray[np.int64]:
    return colour_rgb.astype(np.int64) @ np.array((1 << 16, 1 << 8, 1))


def _split_by_code(
    corners: Triangles, code: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.int64], npt.NDArray[np.intp]]:
    """Split vertices so that each has one code: old indices, codes, and corners as indices of the new ones."""
    codes, code_index = np.unique(code, return_inverse=True)
    key = corners.astype(np.int64) * len(codes) + code_index.reshape(-1, 1)
    keys, triangles = np.unique(key.ravel(), return_inverse=True)
    return (keys // max(len(codes), 1)).astype(np.intp), codes[keys % max(len(codes), 1)], triangles
