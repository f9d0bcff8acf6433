"""The static world of a map as one mesh: ground, signals, street furniture, buildings and trees.

Buildings, trees and street lamps stand along the roads, outside the space of traffic. Building a town's scene takes
seconds, so scenes are cached as files next to the compiled maps (``kept_scene``).
"""

import hashlib
import io
import json
import logging
import zipfile
from contextlib import suppress
from dataclasses import astuple, dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from shapely.geometry import Polygon

from siren_ros.base.numerics.arrays import Floats, Points, random_stream
from siren_ros.base.params.folders import default_cache_dir, store_in_cache
from siren_ros.errors import InputError
from siren_ros.sensing.meshes.mesh import LampColour, Material, Mesh, ParkedVehicle, SignalLamp, StaticScene
from siren_ros.sensing.meshes.solids import Rgb, box, frustum, hexahedra, sphere_points
from siren_ros.sensing.scene.ground import ground_mesh, road_markings
from siren_ros.sensing.scene.kerbside import clutter, junction_controls, mirrored, parked_vehicles, street_lamp, turned
from siren_ros.sensing.scene.surfaces import (
    FreeSpace,
    SceneConfig,
    Surfaces,
    drawn_centres,
    ring_samples,
    road_surfaces,
    union,
)
from siren_ros.simulation.roads.road_network import RoadNetwork, right_hand_image

_WALL_RGB: Final = np.array(
    [(196, 178, 150), (168, 110, 86), (206, 200, 188), (150, 148, 144), (188, 150, 112), (214, 192, 140),
     (132, 96, 80), (176, 184, 186), (222, 214, 200), (156, 134, 116)]
)  # fmt: skip
_GLASS_RGB: Final[Rgb] = (66, 84, 98)
_CURTAIN_RGB: Final = np.array([(138, 134, 122), (148, 138, 116), (126, 122, 114), (142, 128, 110)])
"""Colours of window panes with curtains; at night these rooms are lit."""
_CURTAINED: Final = 0.4
_STOREY_M: Final = 3.2
_RAIL_ASIDE_M: Final = 0.7
"""Distance between the paved road and a crash barrier."""
_RAIL_M: Final = 0.44, 0.75
"""Heights of the lower and the upper edge of a crash barrier."""
_RAIL_RGB: Final[Rgb] = (158, 162, 166)
_POST_M: Final = 0.05
"""Half the thickness of rails and posts."""
_PROUD_M: Final = 0.03
"""Window panes are this far in front of the wall."""


@dataclass(frozen=True)
class Lot:
    """A building's footprint: the middle of its front, the direction from front to back, and its size."""

    x_m: float
    y_m: float
    heading_rad: float
    width_m: float
    depth_m: float
    height_m: float


def building(lot: Lot, rng: np.random.Generator, *, detailed: bool) -> Mesh:
    """A building on a lot, its front towards the street.

    ``detailed`` gives windows in every storey and on both sides.
    """
    tone = np.clip(_WALL_RGB[rng.integers(len(_WALL_RGB))] + rng.integers(-10, 11, 3), 0, 255)
    colour: Rgb = (int(tone[0]), int(tone[1]), int(tone[2]))
    storeys = max(1, int(lot.height_m / _STOREY_M))
    gabled = lot.height_m < 10.5 and rng.random() < 0.6
    half, depth, height = lot.width_m / 2, lot.depth_m, lot.height_m
    parts = [box((0.0, -half, 0.0), (depth, half, height), Material.BUILDING_WALL, colour)]
    parts.extend(gable_roof(half, depth, height, rng) if gabled else flat_roof(half, depth, height, colour, rng))
    ribbons, shop = storeys >= 4 and rng.random() < 0.4, storeys >= 2 and rng.random() < 0.55
    faces = [((0.0, half), (0.0, -half))]
    if detailed:
        faces += [((0.0, -half), (depth, -half)), ((depth, half), (0.0, half)), ((depth, -half), (depth, half))]
    rooms = np.random.Generator(np.random.PCG64([abs(int(8.0 * lot.x_m)), abs(int(8.0 * lot.y_m))]))
    for number, (start, end) in enumerate(faces):
        parts.append(facade(start, end, storeys, height, rooms, ribbons=ribbons, shop=shop and number == 0))
    c, s = float(np.cos(lot.heading_rad)), float(np.sin(lot.heading_rad))
    turn = np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)])
    return Mesh.joined(*parts).transformed(turn, (lot.x_m, lot.y_m, 0.0))


def facade(
    start: tuple[float, float],
    end: tuple[float, float],
    storeys: int,
    height_m: float,
    rooms: np.random.Generator,
    *,
    ribbons: bool,
    shop: bool,
) -> Mesh:
    """Window panes along a wall from ``start`` to ``end`` (x and y in metres), left to right as seen from outside.

    ``ribbons`` joins the panes of a storey, ``shop`` has wide panes at the ground; ``rooms`` draws who has light on.
    """
    a, b = np.array(start), np.array(end)
    length = float(np.linalg.norm(b - a))
    spans: list[tuple[float, float, float, float]] = []
    for storey in range(storeys):
        low = storey * (height_m / storeys)
        if storey == 0 and shop:
            count = max(2, round(length / 3.6))
            spans.extend((k * length / count + 0.25, (k + 1) * length / count - 0.25, 0.35, 2.75) for k in range(count))
        elif ribbons:
            spans.append((0.5, length - 0.5, low + 0.95, low + 2.45))
        else:
            count = max(1, round((length - 0.8) / 2.9))
            step = (length - 0.8) / count
            spans.extend(
                (0.4 + (k + 0.27) * step, 0.4 + (k + 0.73) * step, low + 0.95, low + 2.4) for k in range(count)
            )
    span = np.array(spans)
    along = (b - a) / length
    outward = np.array((along[1], -along[0])) * _PROUD_M
    return _panes(a + outward, along, span, rooms)


def _panes(origin: Floats, along: Floats, span: Floats, rooms: np.random.Generator) -> Mesh:
    left, right, low, high = span.T
    corners = np.empty((len(span), 4, 3))
    for k, (s, z) in enumerate(((left, low), (right, low), (right, high), (left, high))):
        corners[:, k, :2] = origin + s[:, None] * along
        corners[:, k, 2] = z
    base = np.arange(len(span))[:, None] * 4
    triangles = np.concatenate((base + np.array((0, 1, 2)), base + np.array((0, 2, 3))))
    panes = Mesh.uniform(corners.reshape(-1, 3), triangles, Material.BUILDING_GLASS, _GLASS_RGB)
    curtained = rooms.random(len(span))[:, None] < _CURTAINED
    curtains = np.where(curtained, _CURTAIN_RGB[rooms.integers(len(_CURTAIN_RGB), size=len(span))], _GLASS_RGB)
    return replace(panes, colour_rgb=np.concatenate((curtains, curtains)).astype(np.uint8))


def flat_roof(half_m: float, depth_m: float, height_m: float, wall: Rgb, rng: np.random.Generator) -> list[Mesh]:
    """A flat roof within an edge a little darker than the ``wall``; large ones carry a box for the lift."""
    grey = int(rng.integers(92, 132))
    roof: Rgb = (grey, grey, grey + 4)
    eaves: Rgb = (int(0.82 * wall[0]), int(0.82 * wall[1]), int(0.82 * wall[2]))
    low, high = (-0.15, -half_m - 0.15, height_m - 0.45), (depth_m + 0.15, half_m + 0.15, height_m)
    inner_low, inner_high = (0.1, -half_m + 0.1, height_m - 0.2), (depth_m - 0.1, half_m - 0.1, height_m + 0.04)
    parts = [box(low, high, Material.BUILDING_WALL, eaves), box(inner_low, inner_high, Material.BUILDING_ROOF, roof)]
    if height_m > 11 and half_m > 4:
        y = float(rng.uniform(-half_m + 2.5, half_m - 2.5))
        x = float(rng.uniform(0.4, 0.7)) * depth_m
        parts.append(
            box((x - 1.6, y - 1.8, height_m), (x + 1.6, y + 1.8, height_m + 2.2), Material.BUILDING_ROOF, roof)
        )
    return parts


def gable_roof(half_m: float, depth_m: float, height_m: float, rng: np.random.Generator) -> list[Mesh]:
    """A saddle roof with its ridge parallel to the street; the eaves, at ``height_m``, reach 0.4 m out."""
    eaves, rise = 0.4, depth_m * 0.28
    shade = int(rng.integers(-14, 15))
    colour: Rgb = (138 + shade, 74 + shade, 58 + shade)
    x0, x1, y0, y1 = -eaves, depth_m + eaves, -half_m - eaves, half_m + eaves
    ridge = (depth_m / 2, height_m + rise)
    points = [(x0, y0, height_m), (x1, y0, height_m), (x1, y1, height_m), (x0, y1, height_m),
              (ridge[0], y0, ridge[1]), (ridge[0], y1, ridge[1])]  # fmt: skip
    faces = [(0, 4, 5), (0, 5, 3), (1, 2, 5), (1, 5, 4), (0, 1, 4), (2, 3, 5), (0, 3, 2), (0, 2, 1)]
    return [Mesh.uniform(points, faces, Material.BUILDING_ROOF, colour)]


TRUNK_RGB: Final[Rgb] = (92, 72, 52)
_GREENS: Final = np.array([(74, 112, 44), (92, 128, 52), (62, 98, 46), (110, 134, 58), (84, 118, 66)])
_CROWN_POINTS, _CROWN_FACES = sphere_points(1)


def broadleaf(x_m: float, y_m: float, crown_radius_m: float, rng: np.random.Generator) -> Mesh:
    """A broad-leaved tree, 120 triangles; nothing reaches farther from its trunk than the crown's radius."""
    height = crown_radius_m * rng.uniform(2.6, 3.4)
    trunk = 0.42 * height
    swelling = rng.uniform(0.78, 1.0, len(_CROWN_POINTS))[:, None]
    squash = np.array((crown_radius_m, crown_radius_m, 0.33 * height))
    points = _CROWN_POINTS * swelling * squash + (x_m, y_m, trunk + 0.27 * height)
    tone = _GREENS[rng.integers(len(_GREENS))]
    colour = np.clip(tone + rng.integers(-9, 10, (len(_CROWN_FACES), 1)), 0, 255).astype(np.uint8)
    crown = Mesh(
        points.astype(np.float32),
        _CROWN_FACES.astype(np.uint32),
        np.full(len(_CROWN_FACES), int(Material.FOLIAGE), np.uint8),
        colour,
    )
    width = 0.05 + 0.05 * crown_radius_m
    stem = frustum((x_m, y_m, 0.0), trunk + 0.1 * height, (width, 0.6 * width), 6, Material.TREE_TRUNK, TRUNK_RGB)
    return Mesh.joined(stem, crown)


def conifer(x_m: float, y_m: float, radius_m: float, rng: np.random.Generator) -> Mesh:
    """A conifer of two stacked cones on a short trunk."""
    height = radius_m * rng.uniform(3.4, 4.4)
    tone = np.clip(np.array((46, 82, 50)) + rng.integers(-8, 9), 0, 255)
    colour: Rgb = (int(tone[0]), int(tone[1]), int(tone[2]))
    return Mesh.joined(
        frustum((x_m, y_m, 0.0), 0.2 * height, (0.14, 0.12), 6, Material.TREE_TRUNK, TRUNK_RGB),
        frustum((x_m, y_m, 0.14 * height), 0.55 * height, (radius_m, 0.25 * radius_m), 8, Material.FOLIAGE, colour),
        frustum((x_m, y_m, 0.48 * height), 0.52 * height, (0.68 * radius_m, 0.02), 8, Material.FOLIAGE, colour),
    )


def street_lamps(surfaces: Surfaces, space: FreeSpace, config: SceneConfig) -> Mesh:
    """Street lamps along the carriageway's edge, their arms over the road."""
    edge = surfaces.keep_clear.buffer(0.55, quad_segs=4)
    places, tangents = ring_samples(edge, config.lamp_spacing_m)
    lamp = street_lamp(config.lamp_height_m)
    parts = []
    for (x, y), (tx, ty) in zip(places, tangents, strict=True):
        if _is_built_up(surfaces, x, y, 0.0) and space.place_disc(x, y, 0.2):
            # The ring runs with the road on its left, so that the arm points left.
            parts.append(turned(lamp, x, y, 0.0, float(np.arctan2(tx, -ty))))
    return Mesh.joined(*parts)


def street_trees(surfaces: Surfaces, space: FreeSpace, config: SceneConfig, rng: np.random.Generator) -> Mesh:
    """A row of trees along every road, with gaps; no crown reaches into the space of traffic."""
    parts: list[Mesh] = []
    row = surfaces.keep_clear.buffer(2.4, quad_segs=4)
    places, _ = ring_samples(row, config.tree_spacing_m)
    for x, y in places:
        radius = float(rng.uniform(1.4, 2.2))
        if rng.random() < 0.72 and _is_built_up(surfaces, x, y, 10.0) and space.place_disc(x, y, radius):
            parts.append(broadleaf(x, y, radius, rng))
    return Mesh.joined(*parts)


def parkland(surfaces: Surfaces, space: FreeSpace, config: SceneConfig, rng: np.random.Generator) -> Mesh:
    """Trees on the grass between and behind the buildings."""
    west, south, east, north = surfaces.bounds_m
    margin = config.skyline_m
    count = int((east - west + 2 * margin) * (north - south + 2 * margin) / 900.0)
    points = rng.uniform((west - margin, south - margin), (east + margin, north + margin), (min(count, 900), 2))
    radii = rng.uniform(1.6, 3.2, len(points))
    clear = space.clear_of_traffic(points, 9.0)
    parts: list[Mesh] = []
    for (x, y), radius in zip(points[clear], radii[clear], strict=True):
        if len(parts) < 260 and space.place_disc(float(x), float(y), float(radius) + 0.3):
            make = conifer if rng.random() < 0.3 else broadleaf
            parts.append(make(float(x), float(y), float(radius), rng))
    return Mesh.joined(*parts)


def street_buildings(surfaces: Surfaces, space: FreeSpace, config: SceneConfig, rng: np.random.Generator) -> Mesh:
    """A first row of buildings that faces the roads and a second, taller and plainer one behind it."""
    streets = union((surfaces.paved, surfaces.raised, surfaces.verge, surfaces.keep_clear))
    parts: list[Mesh] = []
    low, high = config.building_height_m
    for setback, detailed in ((config.building_setback_m, True), (config.building_setback_m + 26.0, False)):
        front = streets.buffer(setback, quad_segs=4)
        shapely.prepare(front)
        next_position = 0
        for position, ((x, y), (tx, ty)) in enumerate(zip(*ring_samples(front.simplify(0.2), 2.0), strict=True)):
            if position < next_position:
                continue
            width = float(rng.uniform(11.0, 24.0))
            depth = float(rng.uniform(9.0, 15.0))
            height = float(low + (high - low) * rng.beta(1.4, 2.6 if detailed else 1.6))
            # The ring runs with the street on its left, so that the lot is on the right.
            outward = float(np.arctan2(-tx, ty))
            lot = Lot(float(x + tx * width / 2), float(y + ty * width / 2), outward, width, depth, height)
            area = footprint(lot)
            # On the outside of bends a lot may reach over the building line by a small area.
            off_street = not front.intersects(area) or front.intersection(area).area < 0.06 * area.area
            if _is_built_up(surfaces, lot.x_m, lot.y_m, config.skyline_m) and off_street and space.is_clear(area):
                space.occupy(area.buffer(0.6))
                parts.append(building(lot, rng, detailed=detailed))
                next_position = position + int((width + rng.uniform(0.5, 7.0)) / 2.0)
    return Mesh.joined(*parts)


def crash_barriers(surfaces: Surfaces, config: SceneConfig) -> Mesh:
    """Rails on posts along the roads out of town, outside the space of traffic."""
    edge = surfaces.keep_clear.buffer(_RAIL_ASIDE_M, quad_segs=4)
    places, _ = ring_samples(edge, config.rail_spacing_m)
    west, south, east, north = surfaces.bounds_m
    x, y = places.T
    on_map = (west <= x) & (x <= east) & (south <= y) & (y <= north)
    beside = on_map & np.asarray(shapely.contains_xy(surfaces.country, x, y), np.bool_)
    step = np.roll(places, -1, axis=0) - places
    length = np.linalg.norm(step, axis=1)
    rails = shapely.linestrings(np.stack((places, places + step), axis=1))
    clear = (length < 1.5 * config.rail_spacing_m) & ~shapely.dwithin(rails, surfaces.keep_clear, _RAIL_ASIDE_M / 2)
    first = np.flatnonzero(beside & np.roll(beside, -1) & clear)
    along = step[first] / length[first, None]
    start, end = places[first], places[first] + step[first]
    return Mesh.joined(
        _bars(start, end, along, _RAIL_M), _bars(start - along * _POST_M, start + along * _POST_M, along, (0.0, 0.72))
    )


def _bars(start: Points, end: Points, along: Points, heights_m: tuple[float, float]) -> Mesh:
    """Upright bars between pairs of places, each array of shape ``(N, 2)``."""
    aside = np.stack((along[:, 1], -along[:, 0]), axis=-1) * _POST_M
    ring = np.stack((start + aside, end + aside, end - aside, start - aside), axis=1)
    corners = np.empty((len(ring), 2, 4, 3))
    corners[..., :2] = ring[:, None]
    corners[..., 2] = np.array(heights_m)[:, None]
    return hexahedra(corners.reshape(-1, 8, 3), Material.METAL_POLE, _RAIL_RGB)


def footprint(lot: Lot) -> Polygon:
    """The rectangle of a lot, eaves included."""
    c, s = np.cos(lot.heading_rad), np.sin(lot.heading_rad)
    half, eaves = lot.width_m / 2 + 0.4, 0.4
    corners = np.array([(-eaves, -half), (lot.depth_m + eaves, -half), (lot.depth_m + eaves, half), (-eaves, half)])
    return Polygon(corners @ np.array([[c, s], [-s, c]]) + (lot.x_m, lot.y_m))


def _is_built_up(surfaces: Surfaces, x_m: float, y_m: float, margin_m: float) -> bool:
    west, south, east, north = surfaces.bounds_m
    on_map = west - margin_m <= x_m <= east + margin_m and south - margin_m <= y_m <= north + margin_m
    return on_map and not shapely.contains_xy(surfaces.country, x_m, y_m)


def static_scene(network: RoadNetwork, seed: int, config: SceneConfig | None = None) -> StaticScene:
    """Build the static scene of a map; the same arguments give the same triangles. The seed varies buildings and trees.

    For left-hand traffic the scene is built on the mirrored map and then mirrored back.

    """
    if network.left_hand:
        image = static_scene(right_hand_image(network), seed, config)
        mirror = image.mesh.transformed(np.diag((1.0, -1.0, 1.0)))
        raised = shapely.transform(image.raised, lambda points: points * (1.0, -1.0))
        shapely.prepare(raised)
        return replace(image, mesh=mirror, raised=raised, parked=mirrored(image.parked))
    numbers = SceneConfig() if config is None else config
    centres = drawn_centres(network, numbers.road_extension_m)
    surfaces = road_surfaces(network, centres, numbers)
    ground = ground_mesh(surfaces, road_markings(network, centres, surfaces, numbers), numbers)
    space = FreeSpace(surfaces)
    controls = junction_controls(network, space, numbers)
    lamps = street_lamps(surfaces, space, numbers)
    parked: tuple[ParkedVehicle, ...] = ()
    if numbers.parked_share:
        parked = parked_vehicles(surfaces, space, numbers, seed, random_stream(seed, "scene parked"))
    trees = street_trees(surfaces, space, numbers, random_stream(seed, "scene trees"))
    things = Mesh.joined()
    if numbers.clutter_per_100_m:  # clutter comes first, because houses would leave no place for most of it
        things = Mesh.joined(*clutter(surfaces, space, numbers, random_stream(seed, "scene clutter")))
    houses = street_buildings(surfaces, space, numbers, random_stream(seed, "scene buildings"))
    park = parkland(surfaces, space, numbers, random_stream(seed, "scene park"))
    rails = crash_barriers(surfaces, numbers)
    first, raised = len(ground), surfaces.raised
    shapely.prepare(raised)
    return StaticScene(
        mesh=Mesh.joined(ground, controls.mesh, lamps, trees, houses, park, rails, things),
        signal_lamps=tuple(
            replace(lamp, start=lamp.start + first, stop=lamp.stop + first) for lamp in controls.signal_lamps
        ),
        raised=raised,
        raised_m=numbers.kerb_height_m,
        parked=parked,
    )


KEPT: Final = 24
"""Number of files that are kept, those used most recently; a town's file has 5 MB."""
CODE: Final = ("base/numerics", "simulation/roads", "simulation/world", "sensing/meshes", "sensing/scene")
"""Folders of the library whose code builds the triangles."""
_PACKAGES: Final = ("numpy", "shapely", "mapbox-earcut")
_COLUMNS: Final = ("vertices_m", "triangles", "material", "colour_rgb")
"""The arrays of ``Mesh`` that a file holds."""
_UNREADABLE: Final = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    TypeError,
    zipfile.BadZipFile,
    shapely.errors.GEOSException,
)


def kept_scene(network: RoadNetwork, seed: int, config: SceneConfig | None = None) -> StaticScene:
    """``static_scene`` with a cache: it loads the file of an earlier call, or builds the scene and leaves a file.

    The file's name is a hash of all that makes the scene: the net, the seed, the numbers, the code and the packages
    that it calls. A file that is damaged is made again; where the folder cannot be written, nothing is left. A network
    that is not as ``parse_road_network`` made it is always built, and so are scenes with parked vehicles, whose sizes
    are those of a parameter file.
    """
    numbers = config or SceneConfig()
    if not network.net_sha256 or numbers.parked_share:
        return static_scene(network, seed, config)
    key = hashlib.sha256("\0".join((network.net_sha256, str(seed), repr(numbers), recipe())).encode()).hexdigest()
    file = default_cache_dir() / f"scene-{key[:32]}.npz"
    with suppress(*_UNREADABLE):
        scene = _read(file.read_bytes(), key)
        file.touch()
        return scene
    logging.getLogger("siren_ros").info("building the static scene; later calls have it from the cache")
    scene = static_scene(network, seed, config)
    with suppress(OSError, InputError):
        store_in_cache(file, _written(scene, key))
        used_last = sorted(file.parent.glob("scene-*.npz"), key=lambda one: one.stat().st_mtime_ns, reverse=True)
        for old in used_last[KEPT:]:
            old.unlink(missing_ok=True)
    return scene


@cache
def recipe() -> str:
    """What decides the result of a build: the source code, and the versions of the packages that it calls."""
    library = Path(__file__).parents[2]
    code = hashlib.sha256()
    for file in sorted(file for name in CODE for file in (library / name).rglob("*.py")):
        code.update(file.read_bytes())
    return "\0".join((code.hexdigest(), *map(version, _PACKAGES), shapely.geos_version_string))


def _written(scene: StaticScene, key: str) -> bytes:
    content = io.BytesIO()
    columns: dict[str, Any] = {name: getattr(scene.mesh, name) for name in _COLUMNS}
    head = {"key": key, "lamps": list(map(astuple, scene.signal_lamps)), "raised_m": scene.raised_m}
    raised = np.frombuffer(shapely.to_wkb(scene.raised), np.uint8)
    np.savez(content, head=np.array(json.dumps(head)), raised=raised, **columns)
    return content.getvalue()


def _read(content: bytes, key: str) -> StaticScene:
    with np.load(io.BytesIO(content)) as file:
        head = json.loads(str(file["head"]))
        if head["key"] != key:
            raise ValueError(head["key"])
        raised = shapely.from_wkb(file["raised"].tobytes())
        mesh = Mesh(**{name: file[name] for name in _COLUMNS})
    shapely.prepare(raised)
    lamps = tuple(
        SignalLamp(signal, link, LampColour(colour), start, stop) for signal, link, colour, start, stop in head["lamps"]
    )
    return StaticScene(mesh, lamps, raised, head["raised_m"])
