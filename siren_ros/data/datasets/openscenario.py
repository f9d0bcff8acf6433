"""Exports recorded episodes as OpenSCENARIO 1.2, for esmini and CARLA's ScenarioRunner.

A vehicle's reference point is the middle of its rear axle, on the ground.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.data.datasets.files import FileWriter, child, document
from siren_ros.data.datasets.formats import EpisodeReport, FilesExporter
from siren_ros.data.datasets.opendrive import opendrive_of
from siren_ros.data.record.episode_source import EpisodeSource
from siren_ros.data.record.tracks import FRAME_S, Track, tracks_of
from siren_ros.simulation.world.actors import ActorClass, ActorDescription

REAR_AXLE: Final = 0.3
"""Distance of the rear axle behind the vehicle's centre, in vehicle lengths; the front axle is as far ahead."""
_CATEGORY: Final = {
    ActorClass.VAN: "van",
    ActorClass.AMBULANCE: "van",
    ActorClass.TRUCK: "truck",
    ActorClass.FIRE_TRUCK: "truck",
    ActorClass.BUS: "bus",
    ActorClass.MOTORCYCLE: "motorbike",
    ActorClass.BICYCLE: "bicycle",
}
_ROLE: Final = {
    ActorClass.AMBULANCE: "ambulance",
    ActorClass.FIRE_TRUCK: "fire",
    ActorClass.POLICE: "police",
    ActorClass.BUS: "publicTransport",
}
_WHEEL_M: Final = 0.65
_LIMITS: Final = {"maxSpeed": 70.0, "maxAcceleration": 10.0, "maxDeceleration": 10.0}
_MAJOR, _MINOR = 1, 2
_DATE: Final = "1970-01-01T00:00:00"


def entity_name(actor: ActorDescription) -> str:
    """Entity name: ``Ego`` for the EMV, as ScenarioRunner and esmini call the main vehicle, otherwise the id."""
    return "Ego" if actor.is_emv and actor.actor_id == 1 else f"Vehicle{actor.actor_id}"


def add_vehicle(entities: Element, actor: ActorDescription) -> None:
    """Add an entity with its vehicle. A pedestrian's origin is its centre."""
    entity = child(entities, "ScenarioObject", name=entity_name(actor))
    kind = actor.actor_class
    if kind is ActorClass.PEDESTRIAN:
        walker = child(
            entity, "Pedestrian", name="pedestrian", pedestrianCategory="pedestrian", mass=75.0, model="adult"
        )
        box = child(walker, "BoundingBox")
        child(box, "Center", x=0.0, y=0.0, z=actor.height_m / 2.0)
        child(box, "Dimensions", length=actor.length_m, width=actor.width_m, height=actor.height_m)
        child(walker, "Properties")
        return
    category, role = _CATEGORY.get(kind, "car"), _ROLE.get(kind, "civil")
    vehicle = child(entity, "Vehicle", name=kind.name.lower(), vehicleCategory=category, role=role, mass=1500.0)
    box = child(vehicle, "BoundingBox")
    child(box, "Center", x=REAR_AXLE * actor.length_m, y=0.0, z=actor.height_m / 2.0)
    child(box, "Dimensions", length=actor.length_m, width=actor.width_m, height=actor.height_m)
    child(vehicle, "Performance", **_LIMITS)
    axles = child(vehicle, "Axles")
    for name, place_m, steering in (("FrontAxle", 2.0 * REAR_AXLE * actor.length_m, 0.6), ("RearAxle", 0.0, 0.0)):
        wheels = {"maxSteering": steering, "wheelDiameter": _WHEEL_M, "trackWidth": 0.85 * actor.width_m}
        child(axles, name, **wheels, positionX=place_m, positionZ=_WHEEL_M / 2.0)
    properties = child(vehicle, "Properties")
    child(properties, "Property", name="type", value="ego_vehicle" if entity_name(actor) == "Ego" else "simulation")
    red, green, blue = actor.colour_rgb
    child(properties, "Property", name="color", value=f"{red},{green},{blue}")


class OpenScenarioExporter(FilesExporter):
    """Writes one file per episode, with its map."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Write scenario and map; all tracks of the episode are in memory."""
        tracks = [track for track in tracks_of(source.record()) if len(track) > 1]
        road = f"{source.map_label}.xodr"
        template, level, seed = source.description.template, source.description.level.name, source.description.seed
        title = f"SIREN {template}, level {level}, seed {seed}"
        files.write(road, opendrive_of(source))
        files.write(f"{episode_id}.xosc", document(scenario(tracks, road, title)))
        classes = Counter(track.actor.actor_class.name.lower() for track in tracks)
        return EpisodeReport({"scenarios": 1, "vehicles": len(tracks)}, dict(classes))


def scenario(tracks: Sequence[Track], road: str, description: str) -> Element:
    """The whole document."""
    root = Element("OpenSCENARIO")
    child(root, "FileHeader", revMajor=_MAJOR, revMinor=_MINOR, date=_DATE, author="SIREN", description=description)
    child(root, "ParameterDeclarations")
    child(root, "CatalogLocations")
    child(root, "RoadNetwork/LogicFile", filepath=road)
    entities = child(root, "Entities")
    for track in tracks:
        add_vehicle(entities, track.actor)
    storyboard = child(root, "Storyboard")
    actions = child(storyboard, "Init/Actions")
    for track in tracks:
        if track.frame[0] == 0:
            private = child(actions, "Private", entityRef=entity_name(track.actor))
            _position(child(private, "PrivateAction/TeleportAction"), rear_axle(track)[0])
            speed = child(private, "PrivateAction/LongitudinalAction/SpeedAction")
            child(speed, "SpeedActionDynamics", dynamicsShape="step", value=0.0, dynamicsDimension="time")
            child(speed, "SpeedActionTarget/AbsoluteTargetSpeed", value=track.speed_mps[0])
    act = child(child(storyboard, "Story", name="Recorded"), "Act", name="Recorded")
    last = max(int(track.frame[-1]) for track in tracks)
    for track in tracks:
        _add_group(act, track, removed=int(track.frame[-1]) < last)
    _time_trigger(child(act, "StartTrigger"), "start", 0.0)
    _time_trigger(child(storyboard, "StopTrigger"), "end", last * FRAME_S)
    return root


def _add_group(act: Element, track: Track, *, removed: bool) -> None:
    """Add one vehicle's actions: it appears when first recorded, follows its trajectory, and disappears at its end."""
    name = entity_name(track.actor)
    group = child(act, "ManeuverGroup", maximumExecutionCount=1, name=f"{name}Group")
    child(child(group, "Actors", selectTriggeringEntities=False), "EntityRef", entityRef=name)
    maneuver = child(group, "Maneuver", name=f"{name}Maneuver")
    start_s = float(track.frame[0]) * FRAME_S
    if track.frame[0] > 0:
        entity = child(_event(maneuver, f"{name}Added"), "GlobalAction/EntityAction", entityRef=name)
        _position(child(entity, "AddEntityAction"), rear_axle(track)[0])
        _start_event_at(maneuver, start_s)
    _follow(_event(maneuver, f"{name}Follows"), track, name)
    _start_event_at(maneuver, start_s)
    if removed:
        entity = child(_event(maneuver, f"{name}Removed"), "GlobalAction/EntityAction", entityRef=name)
        child(entity, "DeleteEntityAction")
        _start_event_at(maneuver, (float(track.frame[-1]) + 1.0) * FRAME_S)


def _event(maneuver: Element, name: str) -> Element:
    """Begin an event and return its action for the caller to fill; the trigger follows it in the file."""
    event = child(maneuver, "Event", name=name, priority="parallel", maximumExecutionCount=1)
    return child(event, "Action", name=f"{name}Action")


def _start_event_at(maneuver: Element, start_s: float) -> None:
    event = maneuver[-1]
    _time_trigger(child(event, "StartTrigger"), event.attrib["name"], start_s)


def _time_trigger(trigger: Element, name: str, time_s: float) -> None:
    condition = child(trigger, "ConditionGroup/Condition", name=f"{name}At", delay=0.0, conditionEdge="none")
    child(condition, "ByValueCondition/SimulationTimeCondition", value=time_s, rule="greaterOrEqual")


def rear_axle(track: Track) -> Floats:
    """x, y, z, heading of the reference point over the frames, shape ``(K, 4)``."""
    behind = 0.0 if track.actor.actor_class is ActorClass.PEDESTRIAN else REAR_AXLE * track.actor.length_m
    x_m = track.x_m - behind * np.cos(track.yaw_rad)
    y_m = track.y_m - behind * np.sin(track.yaw_rad)
    return np.stack((x_m, y_m, track.z_m, track.yaw_rad), axis=-1)


def _position(parent: Element, place: Floats) -> None:
    x, y, z, heading = place.tolist()
    child(parent, "Position/WorldPosition", x=x, y=y, z=z, h=heading, p=0.0, r=0.0)


def _follow(action: Element, track: Track, name: str) -> None:
    follow = child(action, "PrivateAction/RoutingAction/FollowTrajectoryAction")
    trajectory = child(follow, "TrajectoryRef/Trajectory", name=f"{name}Trajectory", closed=False)
    line = child(trajectory, "Shape/Polyline")
    for frame, place in zip(track.frame.tolist(), rear_axle(track), strict=True):
        _position(child(line, "Vertex", time=float(frame) * FRAME_S), place)
    child(follow, "TimeReference/Timing", domainAbsoluteRelative="absolute", scale=1.0, offset=0.0)
    child(follow, "TrajectoryFollowingMode", followingMode="position")
