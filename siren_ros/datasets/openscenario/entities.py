"""Vehicles of an OpenSCENARIO file. Its reference point is the middle of the rear axle, on the ground."""

from typing import Final
from xml.etree.ElementTree import Element

from siren_ros.datasets.sources.xml_text import child
from siren_ros.world.actors import ActorClass, ActorDescription

REAR_AXLE: Final = 0.3
"""How far the rear axle lies behind the middle, in vehicle lengths; the front axle as far ahead."""
_CATEGORY: Final = {
    ActorClass.VAN: "van",
    ActorClass.AMBULANCE: "van",
    ActorClass.TRUCK: "truck",
    ActorClass.FIRE_TRUCK: "truck",
    ActorClass.BUS: "bus",
}
_ROLE: Final = {
    ActorClass.AMBULANCE: "ambulance",
    ActorClass.FIRE_TRUCK: "fire",
    ActorClass.POLICE: "police",
    ActorClass.BUS: "publicTransport",
}
_WHEEL_M: Final = 0.65
_LIMITS: Final = {"maxSpeed": 70.0, "maxAcceleration": 10.0, "maxDeceleration": 10.0}


def entity_name(actor: ActorDescription) -> str:
    """``Ego`` for the EMV, as ScenarioRunner and esmini call the vehicle that matters, else its id."""
    return "Ego" if actor.is_emv and actor.actor_id == 1 else f"Vehicle{actor.actor_id}"


def add_vehicle(entities: Element, actor: ActorDescription) -> None:
    """Adds an entity with its vehicle."""
    made = child(entities, "ScenarioObject", name=entity_name(actor))
    kind = actor.actor_class
    vehicle = child(
        made,
        "Vehicle",
        name=kind.name.lower(),
        vehicleCategory=_CATEGORY.get(kind, "car"),
        role=_ROLE.get(kind, "civil"),
        mass=1500.0,
    )
    box = child(vehicle, "BoundingBox")
    child(box, "Center", x=REAR_AXLE * actor.length_m, y=0.0, z=actor.height_m / 2.0)
    child(box, "Dimensions", length=actor.length_m, width=actor.width_m, height=actor.height_m)
    child(vehicle, "Performance", **_LIMITS)
    axles = child(vehicle, "Axles")
    for name, place_m, steering in (("FrontAxle", 2.0 * REAR_AXLE * actor.length_m, 0.6), ("RearAxle", 0.0, 0.0)):
        child(
            axles,
            name,
            maxSteering=steering,
            wheelDiameter=_WHEEL_M,
            trackWidth=0.85 * actor.width_m,
            positionX=place_m,
            positionZ=_WHEEL_M / 2.0,
        )
    properties = child(vehicle, "Properties")
    child(properties, "Property", name="type", value="ego_vehicle" if entity_name(actor) == "Ego" else "simulation")
    red, green, blue = actor.colour_rgb
    child(properties, "Property", name="color", value=f"{red},{green},{blue}")
