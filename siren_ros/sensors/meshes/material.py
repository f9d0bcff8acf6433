"""What surfaces are made of: one byte per triangle, and the semantic class that each material belongs to."""

from enum import IntEnum, StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.world.actors import ActorClass


class Material(IntEnum):
    """Surface material of a triangle. LiDAR reflectivity and camera shading key on it."""

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
    CAR = 14
    TRUCK = 15
    BUS = 16
    ROAD_LINE = 24
    GROUND = 25


_STATIC_CLASSES: Final[dict[Material, SemanticClass]] = {
    Material.GROUND: SemanticClass.GROUND,
    Material.GRASS: SemanticClass.TERRAIN,
    Material.ASPHALT: SemanticClass.ROAD,
    Material.SHOULDER_ASPHALT: SemanticClass.ROAD,
    Material.MARKING_WHITE: SemanticClass.ROAD_LINE,
    Material.MARKING_YELLOW: SemanticClass.ROAD_LINE,
    Material.KERB: SemanticClass.SIDEWALK,
    Material.SIDEWALK: SemanticClass.SIDEWALK,
    Material.MEDIAN: SemanticClass.TERRAIN,
    Material.BUILDING_WALL: SemanticClass.BUILDING,
    Material.BUILDING_ROOF: SemanticClass.BUILDING,
    Material.BUILDING_GLASS: SemanticClass.BUILDING,
    Material.TREE_TRUNK: SemanticClass.VEGETATION,
    Material.FOLIAGE: SemanticClass.VEGETATION,
    Material.METAL_POLE: SemanticClass.POLE,
    Material.SIGNAL_HOUSING: SemanticClass.TRAFFIC_LIGHT,
    Material.SIGNAL_RED: SemanticClass.TRAFFIC_LIGHT,
    Material.SIGNAL_YELLOW: SemanticClass.TRAFFIC_LIGHT,
    Material.SIGNAL_GREEN: SemanticClass.TRAFFIC_LIGHT,
    Material.STOP_SIGN: SemanticClass.TRAFFIC_SIGN,
    Material.STREET_LAMP: SemanticClass.POLE,
    Material.FENCE: SemanticClass.FENCE,
}

SEMANTIC_CLASS_OF_MATERIAL: Final[npt.NDArray[np.uint8]] = np.array(
    [_STATIC_CLASSES.get(material, SemanticClass.CAR) for material in Material], dtype=np.uint8
)
"""Semantic class by material code; the materials of vehicles give CAR (see ``semantic_class_of_actor``)."""
SEMANTIC_CLASS_OF_MATERIAL.setflags(write=False)

_ACTOR_CLASSES: Final = {
    ActorClass.BUS: SemanticClass.BUS,
    ActorClass.TRUCK: SemanticClass.TRUCK,
    ActorClass.FIRE_TRUCK: SemanticClass.TRUCK,
}


def semantic_class_of_actor(actor_class: ActorClass) -> SemanticClass:
    """Semantic class of every triangle of a vehicle: BUS and TRUCK for those, otherwise CAR."""
    return _ACTOR_CLASSES.get(actor_class, SemanticClass.CAR)


class LampColour(StrEnum):
    """A lamp of a signal head, with the letters of SUMO's ``rugyGsoO`` alphabet that light it."""

    RED = "red"
    YELLOW = "yellow"
    GREEN = "green"

    @property
    def lit_by(self) -> str:
        """SUMO signal letters in which the lamp shines (``u`` is red with yellow, ``o`` blinks yellow)."""
        return {"red": "rus", "yellow": "yuo", "green": "gG"}[self.value]

    @property
    def material(self) -> Material:
        """Material of the lamp's lens."""
        return {
            "red": Material.SIGNAL_RED,
            "yellow": Material.SIGNAL_YELLOW,
            "green": Material.SIGNAL_GREEN,
        }[self.value]
