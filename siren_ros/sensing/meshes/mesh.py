"""Data types of the 3-D scene: meshes of triangles with materials, vehicle shapes, and the static scene.

Poses and sizes of the vehicles' shapes at one step are a structure of arrays.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import IntEnum, StrEnum
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    NO_ACTOR,
    ActorClass,
    ActorDescription,
    ActorStates,
    rows_of_ids,
)


class Material(IntEnum):
    """Surface material of a triangle. It decides LiDAR reflectivity and camera shading."""

    GROUND = 0
    GRASS = 1
    ASPHALT = 2
    MARKING_WHITE = 3
    MARKING_YELLOW = 4
    KERB = 5
    SIDEWALK = 6
    MEDIAN = 7
    BUILDING_WALL = 8
    BUILDING_ROOF = 9
    BUILDING_GLASS = 10
    TREE_TRUNK = 11
    FOLIAGE = 12
    METAL_POLE = 13
    SIGNAL_HOUSING = 14
    SIGNAL_RED = 15
    """Lens of a signal's lamp; dark unless its ``SignalLamp`` is lit."""
    SIGNAL_YELLOW = 16
    SIGNAL_GREEN = 17
    STOP_SIGN = 18
    CAR_PAINT = 19
    """White in the mesh; multiplied with the actor's ``colour_rgb`` when drawn."""
    CAR_GLASS = 20
    TYRE = 21
    RIM = 22
    PLASTIC = 23
    HEAD_LAMP = 24
    BRAKE_LAMP = 25
    INDICATOR_LEFT_LAMP = 26
    INDICATOR_RIGHT_LAMP = 27
    BEACON_BLUE = 28
    BEACON_RED = 29
    LIVERY = 30
    """Retro-reflective markings of emergency vehicles."""
    PLATE = 31
    """Number plates: retro-reflective."""
    STREET_LAMP = 32
    """Luminaire of a street lamp."""
    FENCE = 33
    SHOULDER_ASPHALT = 34
    FLEET_PAINT = 35
    """Paint of emergency vehicles: keeps the mesh's colour, whatever the actor's ``colour_rgb``."""
    CLOTHING = 36
    """Clothes of riders and walkers; white in the mesh, as paint is, where the actor's ``colour_rgb`` colours them."""
    SKIN = 37


class SemanticClass(IntEnum):
    """Semantic segmentation labels, numbered as CARLA 0.9.14 and later number them (Cityscapes' classes first).

    Source: CARLA documentation, "Semantic segmentation camera", table of tags.
    """

    UNLABELED = 0
    ROAD = 1
    SIDEWALK = 2
    BUILDING = 3
    FENCE = 5
    POLE = 6
    TRAFFIC_LIGHT = 7
    TRAFFIC_SIGN = 8
    VEGETATION = 9
    TERRAIN = 10
    SKY = 11
    PEDESTRIAN = 12
    CAR = 14
    TRUCK = 15
    BUS = 16
    MOTORCYCLE = 18
    BICYCLE = 19
    ROAD_LINE = 24
    GROUND = 25


LENSES: Final = (Material.SIGNAL_RED, Material.SIGNAL_YELLOW, Material.SIGNAL_GREEN)
"""Materials of signal lamps."""
_STATIC_MATERIALS: Final = {
    SemanticClass.ROAD: (Material.ASPHALT, Material.SHOULDER_ASPHALT),
    SemanticClass.SIDEWALK: (Material.KERB, Material.SIDEWALK),
    SemanticClass.BUILDING: (Material.BUILDING_WALL, Material.BUILDING_ROOF, Material.BUILDING_GLASS),
    SemanticClass.FENCE: (Material.FENCE,),
    SemanticClass.POLE: (Material.METAL_POLE, Material.STREET_LAMP),
    SemanticClass.TRAFFIC_LIGHT: (Material.SIGNAL_HOUSING, *LENSES),
    SemanticClass.TRAFFIC_SIGN: (Material.STOP_SIGN,),
    SemanticClass.VEGETATION: (Material.TREE_TRUNK, Material.FOLIAGE),
    SemanticClass.TERRAIN: (Material.GRASS, Material.MEDIAN),
    SemanticClass.ROAD_LINE: (Material.MARKING_WHITE, Material.MARKING_YELLOW),
    SemanticClass.GROUND: (Material.GROUND,),
}

SEMANTIC_CLASS_OF_MATERIAL: Final = np.full(len(Material), SemanticClass.CAR, np.uint8)
"""Semantic class by material code; vehicle materials give CAR (see ``semantic_class_of_actor``)."""
for _class, _materials in _STATIC_MATERIALS.items():
    SEMANTIC_CLASS_OF_MATERIAL[list(_materials)] = _class
SEMANTIC_CLASS_OF_MATERIAL.setflags(write=False)

_ACTOR_CLASSES: Final = {
    ActorClass.BUS: SemanticClass.BUS,
    ActorClass.TRUCK: SemanticClass.TRUCK,
    ActorClass.MOTORCYCLE: SemanticClass.MOTORCYCLE,
    ActorClass.BICYCLE: SemanticClass.BICYCLE,
    ActorClass.PEDESTRIAN: SemanticClass.PEDESTRIAN,
}


def semantic_class_of_actor(actor_class: ActorClass) -> SemanticClass:
    """Semantic class of all triangles of a vehicle and its rider; CAR for classes without one of their own."""
    return _ACTOR_CLASSES.get(actor_class.body, SemanticClass.CAR)


class LampColour(StrEnum):
    """A lamp of a signal head, with the letters of SUMO's ``rugyGsoO`` alphabet that light it."""

    RED = "red"
    YELLOW = "yellow"
    GREEN = "green"

    @property
    def lit_by(self) -> str:
        """SUMO's signal letters for which the lamp is lit (``u`` is red with yellow, ``o`` blinks yellow)."""
        return {"red": "rus", "yellow": "yuo", "green": "gG"}[self.value]

    @property
    def material(self) -> Material:
        """Material of the lamp's lens."""
        return Material[f"SIGNAL_{self.name}"]


Vertices = Floats32
Triangles = npt.NDArray[np.uint32]
Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles over shared vertices. Seen from outside, a triangle's corners run counter-clockwise."""

    vertices_m: Vertices
    """Shape ``(V, 3)``."""
    triangles: Triangles
    """Rows of ``vertices_m``, shape ``(T, 3)``."""
    material: Bytes
    """``Material`` codes, shape ``(T,)``."""
    colour_rgb: Bytes
    """sRGB colour, shape ``(T, 3)``."""

    def __len__(self) -> int:
        return len(self.triangles)

    @classmethod
    def uniform(
        cls, vertices_m: npt.ArrayLike, triangles: npt.ArrayLike, material: Material, colour_rgb: tuple[int, int, int]
    ) -> "Mesh":
        """Triangles of one material and colour."""
        vertices = np.asarray(vertices_m, dtype=np.float32).reshape(-1, 3)
        corners = np.asarray(triangles, dtype=np.uint32).reshape(-1, 3)
        colours = np.tile(np.array(colour_rgb, dtype=np.uint8), (len(corners), 1))
        return cls(vertices, corners, np.full(len(corners), int(material), dtype=np.uint8), colours)

    @classmethod
    def joined(cls, *meshes: "Mesh") -> "Mesh":
        """All triangles of the meshes, in order."""
        parts = meshes or (cls.uniform((), (), Material.GROUND, (0, 0, 0)),)
        starts = np.cumsum([0] + [len(part.vertices_m) for part in parts[:-1]]).astype(np.uint32)
        return cls(
            np.concatenate([part.vertices_m for part in parts]),
            np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=True)]),
            np.concatenate([part.material for part in parts]),
            np.concatenate([part.colour_rgb for part in parts]),
        )

    def transformed(self, rotation: npt.ArrayLike, translation_m: npt.ArrayLike = (0.0, 0.0, 0.0)) -> "Mesh":
        """The mesh with every vertex ``v`` at ``rotation @ v + translation_m``.

        A matrix that mirrors (negative determinant) also turns the triangles around, so that normals stay outward.
        """
        matrix = np.asarray(rotation, dtype=np.float64)
        moved = self.vertices_m.astype(np.float64) @ matrix.T + np.asarray(translation_m, dtype=np.float64)
        corners = self.triangles if np.linalg.det(matrix) > 0 else self.triangles[:, ::-1].copy()
        return Mesh(moved.astype(np.float32), corners, self.material, self.colour_rgb)

    def translated(self, x_m: float, y_m: float, z_m: float) -> "Mesh":
        """The mesh moved, not turned."""
        moved = self.vertices_m.astype(np.float64) + np.array((x_m, y_m, z_m))
        return Mesh(moved.astype(np.float32), self.triangles, self.material, self.colour_rgb)

    @cached_property
    def normals(self) -> Floats32:
        """Unit outward normal of each triangle, shape ``(T, 3)``; zero where a triangle has no area."""
        a, b, c = (self.vertices_m[self.triangles[:, i]].astype(np.float64) for i in range(3))
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return (normal / np.where(length > 0, length, 1.0)).astype(np.float32)

    @cached_property
    def bounds_m(self) -> tuple[Floats32, Floats32]:
        """Lowest and highest coordinates, each of shape ``(3,)``; the mesh must not be empty."""
        return self.vertices_m.min(axis=0), self.vertices_m.max(axis=0)


@dataclass(frozen=True, eq=False)
class Wheel:
    """A wheel about its own hub: the axle is the y axis, the rim faces outward."""

    mesh: Mesh
    hub_m: tuple[float, float, float]
    """Centre of the hub in ``base_link``."""
    radius_m: float
    steered: bool


class Swing(IntEnum):
    """How a limb swings. The shader tells these codes from those of wheels (1, 2)."""

    WALKING_LEG = 3
    PEDALLING_LEG = 4
    ARM = 5


@dataclass(frozen=True, eq=False)
class Limb:
    """A leg or an arm. It swings about the y axis through its joint, with the distance that its owner has moved.

    Limbs on the left and on the right swing against each other.
    """

    mesh: Mesh
    """The limb around its joint, in the middle position."""
    joint_m: tuple[float, float, float]
    swing: Swing


@dataclass(frozen=True, eq=False)
class VehicleShape:
    """A vehicle in ``base_link``: x forward, y left, z up, origin at the footprint's centre on the ground.

    Body and wheels together fill exactly ``±length/2``, ``±width/2`` and ``0 … height``.
    """

    actor_class: ActorClass
    body: Mesh
    wheels: tuple[Wheel, ...]
    length_m: float
    width_m: float
    height_m: float
    limbs: tuple[Limb, ...] = ()

    @cached_property
    def parts(self) -> tuple[tuple[Mesh, tuple[float, float, float, float]], ...]:
        """The parts in ``base_link``: body, wheels straight ahead, limbs in their middle positions.

        Each part has its hub or joint, and a code of its motion: 0 moves with the body, 1 is a wheel, 2 a steered
        wheel, larger numbers are a ``Swing``.

        """
        wheels = ((w.mesh.translated(*w.hub_m), (*w.hub_m, 2.0 if w.steered else 1.0)) for w in self.wheels)
        limbs = ((limb.mesh.translated(*limb.joint_m), (*limb.joint_m, float(limb.swing))) for limb in self.limbs)
        return (self.body, (0.0, 0.0, 0.0, 0.0)), *wheels, *limbs

    @cached_property
    def at_rest(self) -> Mesh:
        """All parts joined to one mesh."""
        return Mesh.joined(*(mesh for mesh, _ in self.parts))


@dataclass(frozen=True)
class SignalLamp:
    """One lens of a signal head; its triangles are ``start`` to ``stop`` (exclusive) of the static scene's mesh."""

    signal_id: str
    link: int
    """Position of the signal's link in its state string."""
    colour: LampColour
    start: int
    stop: int

    def is_lit(self, state: str) -> bool:
        """Whether the lamp is lit in a state string of its signal; a string that is too short leaves it dark."""
        return self.link < len(state) and state[self.link] in self.colour.lit_by


@dataclass(frozen=True, eq=False)
class ParkedVehicle:
    """A vehicle that stays parked for the whole episode; its pose is that of ``base_link`` in the ``map`` frame."""

    actor: ActorDescription
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


@dataclass(frozen=True, eq=False)
class StaticScene:
    """Everything that does not move, in the ``map`` frame, with the triangles of the signal lamps."""

    mesh: Mesh
    signal_lamps: tuple[SignalLamp, ...]
    raised: BaseGeometry = field(default_factory=Polygon)
    """Area of sidewalks and medians, which are higher than the road."""
    raised_m: float = 0.0
    """Height of these areas above the road."""
    parked: tuple[ParkedVehicle, ...] = ()
    """Parked vehicles. They are not part of the mesh, because sensors treat them as actors."""

    def ground_m(self, x_m: Floats, y_m: Floats) -> Floats:
        """Height of the ground at some places."""
        return np.where(shapely.contains_xy(self.raised, x_m, y_m), self.raised_m, 0.0)


@dataclass(frozen=True)
class EgoVehicle:
    """The vehicle with the sensors. The sensors do not see it, but its lamps light the street."""

    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    lights: int


@dataclass(frozen=True, eq=False)
class VehiclePlacement:
    """Vehicles that can be seen, rows sorted by ``actor_id``; poses of ``base_link`` in the ``map`` frame.

    A shape is scaled per axis so that it fills its actor's described length, width and height exactly.
    """

    actor_id: npt.NDArray[np.uint32]
    actor_class: npt.NDArray[np.uint8]
    x_m: Floats
    y_m: Floats
    z_m: Floats
    yaw_rad: Floats
    vx_mps: Floats
    vy_mps: Floats
    yaw_rate_radps: Floats
    steer_rad: Floats
    lights: npt.NDArray[np.uint8]
    scale: Floats
    """Scale of the shape along each axis, shape ``(N, 3)``."""
    size_m: Floats
    """Length, width, height of each actor, shape ``(N, 3)``."""
    colour_rgb: npt.NDArray[np.uint8]
    """Colour of each actor, shape ``(N, 3)``."""
    ego: EgoVehicle | None = None

    def __len__(self) -> int:
        return len(self.actor_id)

    def distance_m(self, x_m: float, y_m: float) -> Floats:
        """Horizontal distance of each vehicle's centre from a point, shape ``(N,)``."""
        return np.hypot(self.x_m - x_m, self.y_m - y_m)


_OF_STATES: Final = tuple(field.name for field in fields(VehiclePlacement) if field.name in ACTOR_STATE_DTYPES)


class Catalogue:
    """Sizes, classes and colours of all actors as arrays, so that a step selects rows without a loop over actors."""

    def __init__(self, shapes: Mapping[ActorClass, VehicleShape]) -> None:
        """Store the shapes; an actor is added when it is first placed."""
        self._shapes = shapes
        self._actor_id = np.empty(0, np.uint32)
        self._add({}, np.empty(0, np.uint32))

    def place(
        self, states: ActorStates, descriptions: Mapping[int, ActorDescription], hidden_id: int = NO_ACTOR
    ) -> VehiclePlacement:
        """Place all actors of a step except ``hidden_id``, the vehicle with the sensors.

        The sensors may be inside its bodywork.
        """
        visible = states.select(np.flatnonzero(states.actor_id != hidden_id))
        rows = rows_of_ids(self._actor_id, visible.actor_id)
        if np.any(rows < 0):
            self._add(descriptions, visible.actor_id)
            rows = rows_of_ids(self._actor_id, visible.actor_id)
        return VehiclePlacement(
            **{name: getattr(visible, name) for name in _OF_STATES},
            actor_class=self._class[rows],
            scale=self._scale[rows],
            size_m=self._size[rows],
            colour_rgb=self._colour[rows],
            ego=_ego_vehicle(states, descriptions, hidden_id),
        )

    def _add(self, descriptions: Mapping[int, ActorDescription], actor_id: npt.NDArray[np.uint32]) -> None:
        """Store the descriptions of these actors and forget all others."""
        self._actor_id = actor_id
        actors = [descriptions[int(number)] for number in actor_id]
        shapes = [self._shapes[actor.actor_class] for actor in actors]
        self._class = np.array([int(a.actor_class) for a in actors], dtype=np.uint8)
        self._size = np.array([(a.length_m, a.width_m, a.height_m) for a in actors], dtype=np.float64).reshape(-1, 3)
        shape_size = np.array([(s.length_m, s.width_m, s.height_m) for s in shapes], dtype=np.float64).reshape(-1, 3)
        self._scale = self._size / shape_size
        self._colour = np.array([a.colour_rgb for a in actors], dtype=np.uint8).reshape(-1, 3)


def _ego_vehicle(states: ActorStates, descriptions: Mapping[int, ActorDescription], actor_id: int) -> EgoVehicle | None:
    """The vehicle with the sensors, found by its id; None if it is not among the states."""
    rows = np.flatnonzero(states.actor_id == actor_id)
    if len(rows) == 0:
        return None
    row = int(rows[0])
    x_m, y_m, yaw_rad = (float(values[row]) for values in (states.x_m, states.y_m, states.yaw_rad))
    return EgoVehicle(x_m, y_m, yaw_rad, descriptions[actor_id].length_m, int(states.lights[row]))
