"""nuScenes' categories, attributes and levels of visibility, and which of them our vehicles have.

Source: https://github.com/nutonomy/nuscenes-devkit, ``docs/instructions_nuscenes.md`` and ``docs/schema_nuscenes.md``.
"""

import hashlib
from typing import Any, Final

import numpy as np

from siren_ros.world.actors import EMERGENCY_CLASSES, ActorClass

CAR: Final = "vehicle.car"
EMERGENCY: Final = "vehicle.emergency"
"""Value of the option that gives emergency vehicles categories of their own."""
CATEGORY_OF_CLASS: Final = {
    ActorClass.HATCHBACK: "vehicle.car",
    ActorClass.SEDAN: "vehicle.car",
    ActorClass.ESTATE: "vehicle.car",
    ActorClass.SUV: "vehicle.car",
    ActorClass.VAN: "vehicle.car",
    ActorClass.PICKUP: "vehicle.car",
    ActorClass.BUS: "vehicle.bus.rigid",
    ActorClass.TRUCK: "vehicle.truck",
    ActorClass.AMBULANCE: "vehicle.emergency.ambulance",
    ActorClass.FIRE_TRUCK: "vehicle.emergency.fire_truck",
    ActorClass.POLICE: "vehicle.emergency.police",
}
"""nuScenes counts vans and pick-ups among cars, and has no fire trucks."""
ATTRIBUTES: Final = ("vehicle.moving", "vehicle.stopped", "vehicle.parked")
VISIBILITIES: Final = {"1": "v0-40", "2": "v40-60", "3": "v60-80", "4": "v80-100"}
_STOPPED_MPS: Final = 0.3


def category_of(actor_class: ActorClass, emergency: str, others: str = "nuscenes") -> str:
    """The category of a class; emergency vehicles are ``vehicle.car`` (the paper) unless they have their own.

    Args:
        actor_class: Of the vehicle.
        emergency: Category of emergency vehicles, or the head of their own ones.
        others: ``vehicle.car`` for all other vehicles, as in the paper, or nuScenes' own categories.
    """
    if actor_class in EMERGENCY_CLASSES and emergency != EMERGENCY:
        return CAR
    if actor_class not in EMERGENCY_CLASSES and others == CAR:
        return CAR
    return CATEGORY_OF_CLASS[actor_class]


def attribute_of(speed_mps: float) -> str:
    """Whether a vehicle moves; no recorded vehicle is parked."""
    return ATTRIBUTES[0] if speed_mps > _STOPPED_MPS else ATTRIBUTES[1]


def visibility_of(fraction: float) -> str:
    """Token of the level that a visible fraction lies in."""
    return str(1 + int(np.searchsorted([0.4, 0.6, 0.8], fraction, side="right")))


def token(*parts: object) -> str:
    """A token of 32 hexadecimal digits, the same for the same parts."""
    return hashlib.md5("/".join(map(str, parts)).encode(), usedforsecurity=False).hexdigest()


def fixed_tables() -> dict[str, list[dict[str, Any]]]:
    """The tables that are the same in every dataset."""
    names = sorted(set(CATEGORY_OF_CLASS.values()))
    return {
        "category": [
            {"token": token("category", name), "name": name, "description": f"{name}, simulated", "index": index}
            for index, name in enumerate(names, start=1)
        ],
        "attribute": [
            {"token": token("attribute", name), "name": name, "description": name.replace(".", " ")}
            for name in ATTRIBUTES
        ],
        "visibility": [
            {"token": key, "level": level, "description": f"visible fraction {level[1:]} %"}
            for key, level in VISIBILITIES.items()
        ],
    }
