"""SUMO's vehicle types of a plan, one per vehicle, as an additional file."""

from collections.abc import Iterable
from typing import Final
from xml.etree.ElementTree import Element, SubElement, tostring

from siren_ros.scenario.levels import LEVEL_POLICIES, EmergencyLevel
from siren_ros.traffic.demand.plan import PlannedVehicle
from siren_ros.traffic.sumo.config import TrafficConfig
from siren_ros.world.actors import ActorClass

_SHAPES: Final = {
    ActorClass.HATCHBACK: "passenger/hatchback",
    ActorClass.SEDAN: "passenger/sedan",
    ActorClass.ESTATE: "passenger/wagon",
    ActorClass.SUV: "passenger/van",
    ActorClass.VAN: "delivery",
    ActorClass.PICKUP: "passenger/van",
    ActorClass.BUS: "bus",
    ActorClass.TRUCK: "truck",
    ActorClass.AMBULANCE: "emergency",
    ActorClass.FIRE_TRUCK: "firebrigade",
    ActorClass.POLICE: "police",
}
_YELLOW_REACTION_S: Final = 1.0
"""``jmDriveAfterYellowTime`` of civilians: time in which a driver perceives yellow and reacts, the value with which
yellow times are computed (ITE, Traffic Engineering Handbook). Without it SUMO brakes at once, and as hard as it can."""
_WAITING_GAP_M: Final = 1.2
"""``jmStoplineGapMinor``: distance kept from the place at which a driver gives way, also inside a junction. With SUMO's
default of 0 the front of who waits reaches into the way of others, whose bodies are wider than their paths."""
_MIRRORS_M: Final = 0.4
"""Added to a civilian's width for SUMO: its mirrors, which bodies are measured without. SUMO lets vehicles pass each
other by widths alone, also where one stands at an angle to its lane."""
_RUNS_RED_S: Final = 1000.0
"""``jmDriveAfterRedTime``: red for this long is still driven over."""


def type_id(vehicle: PlannedVehicle) -> str:
    """Name of a vehicle's own type."""
    return f"type.{vehicle.name}"


def vehicle_types_xml(
    vehicles: Iterable[PlannedVehicle], level: EmergencyLevel, response_distance_m: float, config: TrafficConfig
) -> bytes:
    """The additional file with all types.

    Civilians are of SUMO's class ``passenger`` whatever their body, so that one set of lanes is open to
    all of them. At L0 an EMV has no privilege: it keeps to the speed limit as well.
    """
    root = Element("additional")
    for vehicle in vehicles:
        element = SubElement(root, "vType", _attributes(vehicle))
        if vehicle.is_emv and not LEVEL_POLICIES[level].privileged:
            element.set("speedFactor", f"{min(vehicle.driver.speed_factor, 1.0):.6g}")
        if vehicle.is_emv:
            _add_emv_parameters(element, level, response_distance_m, config)
    return tostring(root, encoding="utf-8", xml_declaration=True)


def _attributes(vehicle: PlannedVehicle) -> dict[str, str]:
    driver, driving = vehicle.driver, vehicle.driver.driving
    numbers = {
        "length": vehicle.length_m,
        "width": vehicle.width_m + (0.0 if vehicle.is_emv else _MIRRORS_M),
        "height": vehicle.height_m,
        "minGap": driving.min_gap_m,
        "accel": driving.accel_mps2,
        "decel": driving.decel_mps2,
        "maxSpeed": driving.max_speed_mps,
        "tau": driver.tau_s,
        "speedFactor": driver.speed_factor,
        "speedDev": 0.0,
        "maxSpeedLat": driver.max_lateral_speed_mps,
        # A vehicle moves sideways by driving: not at all when standing, by at most this share of its speed.
        "lcMaxSpeedLatStanding": 0.0,
        "lcMaxSpeedLatFactor": 0.3,
        "lcSpeedGain": driver.speed_gain_eagerness,
        "lcCooperative": driver.cooperation,
        "jmDriveAfterYellowTime": _YELLOW_REACTION_S,
        "jmStoplineGapMinor": _WAITING_GAP_M,
    }
    texts = {
        "id": type_id(vehicle),
        "vClass": "emergency" if vehicle.is_emv else "passenger",
        "guiShape": _SHAPES[vehicle.actor_class],
        "carFollowModel": driver.car_following,
        "laneChangeModel": "SL2015",
        "latAlignment": "center",
        "color": ",".join(str(part) for part in vehicle.colour_rgb),
    }
    return texts | {name: f"{value:.6g}" for name, value in numbers.items()}


def _add_emv_parameters(
    element: Element, level: EmergencyLevel, response_distance_m: float, config: TrafficConfig
) -> None:
    policy = LEVEL_POLICIES[level]
    if policy.privileged:
        element.set("jmDriveAfterRedTime", f"{_RUNS_RED_S:g}")
        element.set("jmDriveAfterYellowTime", f"{_RUNS_RED_S:g}")
        element.set("jmDriveRedSpeed", f"{config.red_light_speed_mps:g}")
    if policy.siren and level in config.bluelight_levels:
        SubElement(element, "param", {"key": "has.bluelight.device", "value": "true"})
        SubElement(element, "param", {"key": "device.bluelight.reactiondist", "value": f"{response_distance_m:g}"})
        # Who reacts, and after which delay, is drawn per driver; SUMO's own chance per second would come on top.
        for reach in ("near", "far"):
            SubElement(element, "param", {"key": f"device.bluelight.reaction-prob-{reach}", "value": "1"})
