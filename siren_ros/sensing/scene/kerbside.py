"""What stands beside the roads: signal heads, stop signs, street lamps, and what a study adds for variety.

Variety is parked vehicles, street furniture and clutter. Everything stands off traffic's space, sidewalks and medians.
Parked vehicles are actors to the sensors, with labels; all else belongs to the static scene.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry import box as rectangle

from siren_ros.base.numerics.arrays import Floats, chances, drawn
from siren_ros.sensing.meshes.mesh import LampColour, Material, Mesh, ParkedVehicle, SignalLamp, StaticScene
from siren_ros.sensing.meshes.solids import Rgb, box, from_quads, frustum
from siren_ros.sensing.scene.surfaces import FreeSpace, SceneConfig, Surfaces, ring_samples, union
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.roads.road_network import Connection, Edge, Lane, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.scenario import VARIETY
from siren_ros.simulation.traffic.demand.road_users import draw_paint, varied_size
from siren_ros.simulation.world.actors import FIRST_PARKED_ID, ActorClass, ActorDescription

POLE_RGB: Final[Rgb] = (112, 116, 120)
HOUSING_RGB: Final[Rgb] = (30, 32, 34)
_LENS_RGB: Final[dict[LampColour, Rgb]] = {
    LampColour.RED: (92, 18, 16),
    LampColour.YELLOW: (96, 74, 14),
    LampColour.GREEN: (14, 80, 46),
}
_LENS_RADIUS_M: Final = 0.15
"""Radius of a lens: 300 mm diameter, the larger of the two standard sizes (EN 12368)."""
HEAD_HEIGHT_M: Final = 1.28
_LETTERS: Final = {
    "S": ("111", "100", "111", "001", "111"),
    "T": ("111", "010", "010", "010", "010"),
    "O": ("111", "101", "101", "101", "111"),
    "P": ("111", "101", "111", "100", "100"),
}


@dataclass(frozen=True, eq=False)
class SignalHead:
    """A signal head as a mesh, with the triangles of each lamp."""

    mesh: Mesh
    lamps: tuple[tuple[LampColour, int, int], ...]


def turned(mesh: Mesh, x_m: float, y_m: float, z_m: float, heading_rad: float) -> Mesh:
    """Turn a mesh so that its x axis points along a heading, then move it."""
    c, s = float(np.cos(heading_rad)), float(np.sin(heading_rad))
    return mesh.transformed(np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)]), (x_m, y_m, z_m))


def signal_head() -> SignalHead:
    """A head with three lamps that faces +x, its lower edge at z 0, red above yellow above green."""
    parts = [
        box((-0.2, -0.21, 0.0), (0.0, 0.21, HEAD_HEIGHT_M), Material.SIGNAL_HOUSING, HOUSING_RGB),
        box((-0.08, -0.36, -0.12), (-0.06, 0.36, HEAD_HEIGHT_M + 0.12), Material.SIGNAL_HOUSING, HOUSING_RGB),
    ]
    lamps = []
    angle = np.arange(10) * (2 * np.pi / 10)
    for row, colour in enumerate((LampColour.GREEN, LampColour.YELLOW, LampColour.RED)):
        z = 0.23 + 0.41 * row
        ring = np.column_stack((np.full(10, 0.012), _LENS_RADIUS_M * np.cos(angle), z + _LENS_RADIUS_M * np.sin(angle)))
        fan = [(0, k, k + 1) for k in range(1, 9)]
        parts.append(box((0.0, -0.17, z + 0.16), (0.2, 0.17, z + 0.18), Material.SIGNAL_HOUSING, HOUSING_RGB))
        start = sum(len(part) for part in parts)
        parts.append(Mesh.uniform(ring, fan, colour.material, _LENS_RGB[colour]))
        lamps.append((colour, start, start + len(fan)))
    return SignalHead(Mesh.joined(*parts), tuple(lamps))


def pole(x_m: float, y_m: float, height_m: float, radius_m: float = 0.07) -> Mesh:
    """An upright metal pole on the ground, slightly tapered."""
    return frustum((x_m, y_m, 0.0), height_m, (radius_m, 0.75 * radius_m), 7, Material.METAL_POLE, POLE_RGB)


def stop_sign() -> Mesh:
    """An octagonal sign that faces +x, its centre at the origin: red with a white rim and the word STOP."""
    angle = np.pi / 8 + np.arange(8) * (np.pi / 4)
    outline = np.column_stack((np.zeros(8), np.cos(angle), np.sin(angle)))
    fan = np.array([(0, k, k + 1) for k in range(1, 7)])
    back = [-0.012, 0.0, 0.0]
    parts = [
        Mesh.uniform(outline * 0.45, fan, Material.STOP_SIGN, (236, 236, 236)),
        Mesh.uniform(outline * 0.41 + (0.006, 0.0, 0.0), fan, Material.STOP_SIGN, (178, 20, 24)),
        Mesh.uniform(outline * 0.45 + back, fan[:, ::-1], Material.METAL_POLE, (140, 142, 144)),
    ]
    cell = 0.045
    for place, letter in enumerate("STOP"):
        left = -0.33 + place * 0.175
        for row, bits in enumerate(_LETTERS[letter]):
            for column, bit in enumerate(bits):
                if bit == "1":
                    y, z = left + column * cell, 0.11 - row * cell
                    quad = np.array(
                        [(0.012, y, z - cell), (0.012, y + cell, z - cell), (0.012, y + cell, z), (0.012, y, z)]
                    )
                    parts.append(from_quads([(quad, (Material.STOP_SIGN, (240, 240, 240)))]))
    return Mesh.joined(*parts)


def street_lamp(height_m: float) -> Mesh:
    """A street lamp at the origin whose arm reaches 1.8 m along +x."""
    arm = 1.8
    return Mesh.joined(
        frustum((0.0, 0.0, 0.0), height_m, (0.09, 0.05), 7, Material.METAL_POLE, POLE_RGB),
        box((0.0, -0.03, height_m - 0.05), (arm, 0.03, height_m), Material.METAL_POLE, POLE_RGB),
        box((arm - 0.6, -0.12, height_m - 0.13), (arm, 0.12, height_m - 0.05), Material.STREET_LAMP, (196, 198, 190)),
    )


def mast_arm(from_m: tuple[float, float], to_m: tuple[float, float], z_m: float) -> Mesh:
    """A horizontal arm of square section between two places at height ``z_m``."""
    dx, dy = to_m[0] - from_m[0], to_m[1] - from_m[1]
    length = float(np.hypot(dx, dy))
    beam = box((0.0, -0.06, -0.06), (length, 0.06, 0.06), Material.METAL_POLE, POLE_RGB)
    return turned(beam, from_m[0], from_m[1], z_m, float(np.arctan2(dy, dx)))


def clear_pole(
    space: FreeSpace, x_m: float, y_m: float, direction: tuple[float, float], reach_m: float, radius_m: float
) -> tuple[float, float] | None:
    """Find the nearest place from a point along a direction, within a reach. None if no place has the clear radius."""
    steps = np.arange(0.0, reach_m, 0.25)[:, None]
    return space.first_clear(np.array((x_m, y_m)) + steps * np.array(direction), radius_m)


_POST_HEAD_M: Final = 2.6
"""Height of the lower edge of a signal head on a post beside the road."""
_POST_RADIUS_M: Final = 0.5
"""Room around a post that carries a head or a sign at eye height."""
_MAST_RADIUS_M: Final = 0.25
_PREFERENCE: Final = "slrt"
"""A head that serves several movements shows the state of the first movement in this order."""


def junction_controls(network: RoadNetwork, space: FreeSpace, config: SceneConfig) -> StaticScene:
    """Signals and stop signs of a map: a post at the right of each approach, heads on a mast beyond the junction."""
    builder = _ControlsBuilder(network, space, config)
    for edge in network.edges:
        lanes = [network.lanes[i] for i in edge.lanes if network.lanes[i].kind is LaneKind.DRIVING]
        signalled = [(lane, link) for lane in lanes if (link := builder.shown_movement(lane)) is not None]
        if signalled:
            builder.add_near_post(edge, *signalled[0])
            builder.add_far_heads(signalled)
        elif any(c.must_stop for lane in lanes for c in network.connections_from.get(lane.index, ())):
            builder.add_stop_post(edge, lanes[0])
    return StaticScene(Mesh.joined(*builder.parts), tuple(builder.lamps))


class _ControlsBuilder:
    """Collects meshes in order, and which triangles of the joined mesh are lamps."""

    def __init__(self, network: RoadNetwork, space: FreeSpace, config: SceneConfig) -> None:
        self.parts: list[Mesh] = []
        self.lamps: list[SignalLamp] = []
        self._triangles = 0
        self._network = network
        self._space = space
        self._config = config

    def _add(self, mesh: Mesh) -> None:
        """Appends a mesh without lamps."""
        self.parts.append(mesh)
        self._triangles += len(mesh)

    def _add_head(
        self, link: Connection, place: tuple[float, float, float], heading_rad: float, ahead_m: float
    ) -> None:
        """Appends a signal head that shines along a heading, at a distance in front of a place."""
        head, (x_m, y_m, z_m) = signal_head(), place
        self.lamps += [
            SignalLamp(str(link.signal_id), link.signal_link, colour, self._triangles + start, self._triangles + stop)
            for colour, start, stop in head.lamps
        ]
        x_m, y_m = x_m + ahead_m * np.cos(heading_rad), y_m + ahead_m * np.sin(heading_rad)
        self._add(turned(head.mesh, float(x_m), float(y_m), z_m, heading_rad))

    def shown_movement(self, lane: Lane) -> Connection | None:
        """The signalled movement whose state a lane's head shows."""
        links = self._network.connections_from.get(lane.index, ())
        ranks = {direction: rank for rank, direction in enumerate(_PREFERENCE)}
        return min(
            (link for link in links if link.signal_id is not None and link.signal_link >= 0),
            key=lambda link: ranks.get(link.direction.lower(), len(ranks)),
            default=None,
        )

    def _right_post(self, edge: Edge, lane: Lane) -> tuple[float, float] | None:
        """Find a place for a post at the right of the end of an edge, as near to the lane and its end as possible."""
        outer = self._network.lanes[edge.lanes[0]]
        _, to_outer = outer.centre.project(lane.centre.at(lane.length_m))
        reach = lane.width_m + abs(float(to_outer)) + outer.width_m + 3.0
        back, aside = (grid.ravel() for grid in np.meshgrid((0.5, 2.0, 4.0, 7.0, 11.0), np.arange(0.0, reach, 0.25)))
        nearest = np.argsort(aside + 0.5 * back, kind="stable")
        s = np.maximum(lane.length_m - back[nearest], 0.0)
        return self._space.first_clear(lane.centre.offset_points(s, -aside[nearest]), _POST_RADIUS_M)

    def add_near_post(self, edge: Edge, lane: Lane, link: Connection) -> None:
        """Add a signal head in front of a post beside the approach."""
        place = self._right_post(edge, lane)
        if place is not None:
            heading = float(lane.centre.heading_rad(lane.length_m)) + np.pi
            self._add(pole(*place, _POST_HEAD_M + HEAD_HEIGHT_M))
            self._add_head(link, (*place, _POST_HEAD_M), heading, 0.26)

    def add_far_heads(self, signalled: Sequence[tuple[Lane, Connection]]) -> None:
        """Add heads for straight movements over the lanes beyond the junction, or on a post opposite the approach."""
        straight = [(self._network.lanes[link.to_lane], link) for _, link in signalled if link.direction == "s"]
        if not straight:
            self._add_opposite_post(*signalled[-1])
            return
        first, last = straight[0][0], straight[-1][0]
        heading = float(first.centre.heading_rad(0.0))
        right = (float(np.sin(heading)), -float(np.cos(heading)))
        for ahead in (1.0, 3.0, 6.0):
            x, y = first.centre.at(min(ahead, first.length_m))
            place = clear_pole(self._space, float(x), float(y), right, 14.0, _MAST_RADIUS_M)
            if place is None:
                continue
            arm_z = self._config.clearance_m + HEAD_HEIGHT_M + 0.4
            end_x, end_y = (float(value) for value in last.centre.offset_points(min(ahead, last.length_m), 0.3))
            self._add(pole(*place, arm_z + 0.2, 0.12))
            self._add(mast_arm(place, (end_x, end_y), arm_z))
            for lane, link in straight:
                on_arm = _on_line(place, (end_x, end_y), lane.centre.at(min(ahead, lane.length_m)))
                self._add_head(link, (*on_arm, self._config.clearance_m + 0.2), heading + np.pi, 0.27)
            return

    def _add_opposite_post(self, lane: Lane, link: Connection) -> None:
        x, y = lane.centre.at(lane.length_m)
        heading = float(lane.centre.heading_rad(lane.length_m))
        forward = (float(np.cos(heading)), float(np.sin(heading)))
        place = clear_pole(self._space, float(x), float(y), forward, 60.0, _POST_RADIUS_M)
        if place is not None:
            self._add(pole(*place, _POST_HEAD_M + 0.6 + HEAD_HEIGHT_M))
            self._add_head(link, (*place, _POST_HEAD_M + 0.6), heading + np.pi, 0.26)

    def add_stop_post(self, edge: Edge, lane: Lane) -> None:
        """Add a stop sign on a post beside the approach."""
        place = self._right_post(edge, lane)
        if place is not None:
            facing = float(lane.centre.heading_rad(lane.length_m)) + np.pi
            self._add(pole(*place, 2.75, 0.04))
            x, y = place[0] + 0.06 * np.cos(facing), place[1] + 0.06 * np.sin(facing)
            self._add(turned(stop_sign(), float(x), float(y), 2.3, facing))


def _on_line(start: tuple[float, float], end: tuple[float, float], point: Floats) -> tuple[float, float]:
    """Nearest place to a point on the line between two places."""
    a, b = np.array(start), np.array(end)
    along = float(np.dot(point - a, b - a) / np.dot(b - a, b - a))
    x, y = a + np.clip(along, 0.0, 1.0) * (b - a)
    return float(x), float(y)


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
