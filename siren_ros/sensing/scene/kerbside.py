"""Adds objects along the roads where a study asks for variety: parked vehicles, street furniture and clutter.

Everything stands off traffic's space, sidewalks and medians. Parked vehicles are actors to the sensors, with labels;
all else belongs to the static scene.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry import box as rectangle

from siren_ros.base.numerics.arrays import chances, drawn
from siren_ros.sensing.meshes.mesh import Material, Mesh, ParkedVehicle
from siren_ros.sensing.meshes.solids import Rgb, box, frustum
from siren_ros.sensing.scene.signals import turned
from siren_ros.sensing.scene.surfaces import FreeSpace, SceneConfig, Surfaces, ring_samples, union
from siren_ros.simulation.dynamics.parameters import load_vehicle_parameters
from siren_ros.simulation.scenario.scenario import VARIETY
from siren_ros.simulation.traffic.demand.sizes import varied_size
from siren_ros.simulation.traffic.demand.vehicle_factory import draw_paint
from siren_ros.simulation.world.actors import FIRST_PARKED_ID, ActorClass, ActorDescription

_PARKED: Final = {
    ActorClass.HATCHBACK: 0.30,
    ActorClass.SEDAN: 0.22,
    ActorClass.ESTATE: 0.10,
    ActorClass.SUV: 0.24,
    ActorClass.VAN: 0.11,
    ActorClass.PICKUP: 0.03,
}
"""Shares of the vehicle classes among parked vehicles: those of the templates without buses and trucks."""
_PARKED_ENDS: Final = chances(_PARKED.values())
_MOST_PARKED: Final = 2**16 - FIRST_PARKED_ID
_PLACE_M: Final = 6.2
"""Length of a parking place along the road (EAR 05: 5.2 to 6.7 m)."""
_ASIDE_M: Final = 0.3
"""Distance between a parked vehicle and the space of traffic."""
_YAW_RAD: Final = 0.04
"""Largest yaw of a parked vehicle against the road."""


def scene_config_of(values: Mapping[str, float]) -> SceneConfig:
    """Scene configuration of an episode, from the drawn values of its template (``EpisodeDescription``)."""
    variety: dict[str, Any] = {path.rpartition(".")[2]: float(values.get(path, 0.0)) for path in VARIETY}
    return SceneConfig(**variety)


def parked_vehicles(
    surfaces: Surfaces, space: FreeSpace, config: SceneConfig, seed: int, rng: np.random.Generator
) -> tuple[ParkedVehicle, ...]:
    """Parked vehicles on a share of the places along all roads, with their right side away from the road.

    The space that they take is marked as occupied.
    """
    edge = _roadside(surfaces)
    sizes = load_vehicle_parameters()
    widest = max(sizes[kind].width_m for kind in _PARKED) * (1.0 + config.size_spread)
    places, tangents = ring_samples(edge.buffer(_ASIDE_M + widest / 2.0, quad_segs=4), _PLACE_M)
    parked: list[ParkedVehicle] = []
    for (x, y), (tx, ty) in zip(places.tolist(), tangents.tolist(), strict=True):
        taken, askew = rng.random() < config.parked_share, float(rng.uniform(-_YAW_RAD, _YAW_RAD))
        kind, paint = [*_PARKED][drawn(_PARKED_ENDS, rng)], draw_paint(rng)
        if not taken or len(parked) == _MOST_PARKED:
            continue
        number = len(parked)
        own = sizes[kind]
        size = varied_size((own.length_m, own.width_m, own.height_m), config.size_spread, seed, f"parked{number}")
        yaw = float(np.arctan2(ty, tx)) + askew
        area = _footprint(x, y, yaw, size[0] + 0.5, size[1] + 0.2)
        if not space.is_clear(area) or edge.intersects(area) or not _on_map(surfaces, x, y):
            continue
        space.occupy(area)
        actor = ActorDescription(FIRST_PARKED_ID + number, f"parked{number}", kind, *size, paint)
        parked.append(ParkedVehicle(actor, x, y, 0.0, yaw))
    return tuple(parked)


class _Kind(NamedTuple):
    """A kind of clutter: ranges of length, width and height, and whether it is round."""

    weight: float
    length_m: tuple[float, float]
    width_m: tuple[float, float]
    height_m: tuple[float, float]
    material: Material
    colour: Rgb
    round: bool = False


_CLUTTER: Final[Mapping[str, _Kind]] = {
    "bin": _Kind(4.0, (0.5, 0.7), (0.5, 0.8), (0.9, 1.2), Material.METAL_POLE, (58, 66, 60)),
    "bollard": _Kind(3.0, (0.15, 0.3), (0.15, 0.3), (0.7, 1.1), Material.METAL_POLE, (96, 98, 102), round=True),
    "cabinet": _Kind(2.0, (0.8, 1.6), (0.3, 0.5), (1.0, 1.6), Material.METAL_POLE, (150, 154, 148)),
    "bench": _Kind(2.0, (1.5, 2.0), (0.5, 0.6), (0.45, 0.9), Material.TREE_TRUNK, (112, 84, 56)),
    "planter": _Kind(2.0, (1.0, 2.4), (0.5, 1.0), (0.6, 1.2), Material.FOLIAGE, (84, 110, 66)),
    "hedge": _Kind(2.0, (2.5, 6.0), (0.6, 1.4), (0.9, 1.8), Material.FOLIAGE, (66, 98, 48)),
    "skip": _Kind(1.5, (3.0, 5.5), (1.6, 2.2), (1.1, 1.9), Material.METAL_POLE, (160, 112, 44)),
    "waste container": _Kind(2.0, (1.2, 2.0), (0.9, 1.2), (1.2, 1.6), Material.METAL_POLE, (52, 84, 62)),
    "shelter": _Kind(1.0, (2.6, 4.5), (1.2, 1.7), (2.2, 2.6), Material.METAL_POLE, (120, 126, 132)),
    "column": _Kind(0.5, (1.1, 1.5), (1.1, 1.5), (2.4, 3.6), Material.BUILDING_WALL, (170, 160, 140), round=True),
    "stack of pallets": _Kind(1.0, (1.2, 2.6), (0.8, 1.3), (0.4, 2.0), Material.TREE_TRUNK, (146, 114, 76)),
}  # fmt: skip
"""The kinds of clutter with sizes from catalogues of street furniture; some are as large as a vehicle."""
_CLUTTER_ENDS: Final = chances(kind.weight for kind in _CLUTTER.values())
_EAVES_M: Final = 0.4
"""How far the eaves reach out in front of the houses; pieces stand clear of them."""
_TRIES: Final = 8


def clutter(surfaces: Surfaces, space: FreeSpace, config: SceneConfig, rng: np.random.Generator) -> Iterator[Mesh]:
    """Furniture and clutter between the roads and the houses, as dense as the configuration says."""
    spacing_m = 100.0 / config.clutter_per_100_m
    edge = _roadside(surfaces)
    places, tangents = ring_samples(edge, spacing_m)
    for (edge_x, edge_y), (tx, ty) in zip(places.tolist(), tangents.tolist(), strict=True):
        kind = [*_CLUTTER.values()][drawn(_CLUTTER_ENDS, rng)]
        length, width, height = (float(rng.uniform(*side)) for side in (kind.length_m, kind.width_m, kind.height_m))
        yaw = float(np.arctan2(ty, tx)) + float(rng.normal(0.0, 0.15))
        tone = np.clip(np.array(kind.colour) + rng.integers(-18, 19, 3), 0, 255).tolist()
        # The ring runs with the road on its left.
        spare = max(0.0, config.building_setback_m - _EAVES_M - _ASIDE_M - width)
        asides = (_ASIDE_M + width / 2.0 + rng.uniform(0.0, spare, _TRIES)).tolist()
        ahead = rng.uniform(-0.5, 0.5, _TRIES) * spacing_m
        spots = [
            (edge_x + tx * a + ty * b, edge_y + ty * a - tx * b) for a, b in zip(ahead.tolist(), asides, strict=True)
        ]
        spots = [(x, y) for x, y in spots if _on_map(surfaces, x, y)]
        areas = [(x, y, _footprint(x, y, yaw, length + 0.1, width + 0.1)) for x, y in spots]
        spot = next((one for one in areas if space.is_clear(one[2]) and not edge.intersects(one[2])), None)
        if spot is None:
            continue
        x, y, area = spot
        space.occupy(area)
        colour: Rgb = (tone[0], tone[1], tone[2])
        half = length / 2.0, width / 2.0
        body = (
            frustum((0.0, 0.0, 0.0), height, (half[0], half[0]), 8, kind.material, colour)
            if kind.round
            else box((-half[0], -half[1], 0.0), (half[0], half[1], height), kind.material, colour)
        )
        yield turned(body, x, y, 0.0, yaw)


def _roadside(surfaces: Surfaces) -> shapely.Geometry:
    edge = union((surfaces.keep_clear, surfaces.raised))
    shapely.prepare(edge)
    return edge


def _footprint(x_m: float, y_m: float, yaw_rad: float, length_m: float, width_m: float) -> Polygon:
    area = rectangle(-length_m / 2.0, -width_m / 2.0, length_m / 2.0, width_m / 2.0)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return shapely.transform(area, lambda points: points @ np.array([[cos, sin], [-sin, cos]]) + (x_m, y_m))


def _on_map(surfaces: Surfaces, x_m: float, y_m: float) -> bool:
    west, south, east, north = surfaces.bounds_m
    return west <= x_m <= east and south <= y_m <= north


def mirrored(parked: tuple[ParkedVehicle, ...]) -> tuple[ParkedVehicle, ...]:
    """Parked vehicles mirrored about the x axis, for left-hand traffic."""
    return tuple(replace(one, y_m=-one.y_m, yaw_rad=-one.yaw_rad) for one in parked)
