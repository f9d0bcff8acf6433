"""Exports recorded episodes for other simulators: OpenDRIVE, OpenSCENARIO, and ScenarioNet databases.

SUMO's netconvert converts the compiled net to the OpenDRIVE map. esmini reads OpenSCENARIO 1.2; a vehicle's reference
point there is the middle of its rear axle, on the ground. CARLA's ScenarioRunner reads 1.0 with CARLA's blueprints as
names; its reference point is the middle of the box. MetaDrive reads ScenarioNet's tracks, map
features and dynamic map states, Python and numpy objects. Format: https://github.com/metadriverse/metadrive,
``metadrive/scenario/scenario_description.py``.
"""

import pickle
import re
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np
import numpy.typing as npt
from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.data.datasets.files import FileWriter, child, document, link
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport, FilesExporter
from siren_ros.data.datasets.lane_graph import lane_graph
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.interfaces.carla import cast_of
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import FRAME_S, LOG_PERIOD_STEPS, Track, tracks_of
from siren_ros.simulation.roads.maps.map_formats import mirrored_net, mirrored_opendrive
from siren_ros.simulation.roads.maps.netconvert import run_netconvert
from siren_ros.simulation.roads.road_network import RoadNetwork, right_hand_image
from siren_ros.simulation.world.actors import TWO_WHEELED, ActorClass, ActorDescription, by_class

_HEADER: Final = {"revMajor": "1", "revMinor": "5", "date": "1970-01-01T00:00:00"}
_OBJECT: Final = {
    "dynamic": "no",
    "zOffset": "0",
    "validLength": "0",
    "orientation": "none",
    "pitch": "0",
    "roll": "0",
    "height": "0",
}
"""Attributes that OpenDRIVE 1.5 requires and netconvert leaves out: the object is static, upright and on the road."""


class OpenDriveExporter(FilesExporter):
    """Writes one file per map; episodes on the same map share it."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:  # noqa: ARG002 - the interface of all formats
        """Write the map."""
        files.write(f"{source.map_label}.xodr", opendrive_of(source))
        return EpisodeReport({"lanes": len(source.network.lanes)})


def opendrive_of(source: EpisodeSource) -> bytes:
    """The map as OpenDRIVE 1.5, in the ``map`` frame.

    netconvert names its files 1.4, but the outlines of objects and the header's offset that it writes came with 1.5.
    Raises MapError: netconvert cannot write it.
    """
    left_hand, net = source.network.left_hand, source.net_xml.encode()
    if left_hand:  # netconvert writes lanes as if traffic kept right
        net = mirrored_net(net)
    x_m, y_m = right_hand_image(source.network).sumo_offset_m
    with tempfile.TemporaryDirectory() as folder:
        net_path, output = Path(folder) / "map.net.xml", Path(folder) / "map.xodr"
        net_path.write_bytes(net)
        options = ["--sumo-net-file", str(net_path), "--opendrive-output", str(output)]
        # SUMO's coordinates are map coordinates plus the net's offset.
        moved = ["--offset.x", f"{-x_m:.6f}", "--offset.y", f"{-y_m:.6f}"]
        # Bends stay polygons. netconvert could fit curves, but these leave the lanes by up to 0.4 m.
        plain = ["--opendrive-output.straight-threshold", "180"]
        run_netconvert([*options, *moved, *plain], Path(folder) / "again.net.xml", source.description.map_name)
        drive = output.read_bytes()
        root = fromstring(mirrored_opendrive(drive) if left_hand else drive)
    for header in root.iter("header"):
        header.attrib.update(_HEADER)
    for thing in root.iter("object"):
        thing.attrib.update({**_OBJECT, **thing.attrib})
    return document(root)


REAR_AXLE: Final = 0.3
"""Distance of the rear axle behind the vehicle's centre, in vehicle lengths; the front axle is as far ahead."""
_CATEGORY: Final = by_class(
    {
        ActorClass.VAN: "van",
        ActorClass.TRUCK: "truck",
        ActorClass.BUS: "bus",
        ActorClass.MOTORCYCLE: "motorbike",
        ActorClass.BICYCLE: "bicycle",
    }
)
_ROLE: Final = by_class(
    {
        ActorClass.AMBULANCE: "ambulance",
        ActorClass.FIRE_TRUCK: "fire",
        ActorClass.POLICE: "police",
        ActorClass.BUS: "publicTransport",
    }
)
_WHEEL_M: Final = 0.65
_LIMITS: Final = {"maxSpeed": 70.0, "maxAcceleration": 10.0, "maxDeceleration": 10.0}
_MAJOR, _MINOR = 1, 2
RUNNER: Final = "scenario-runner"
"""The dialect of CARLA's ScenarioRunner: OpenSCENARIO 1.0, which has no roles, no ``greaterOrEqual``, no references to
trajectories. All entities have a place from the begin, because the runner spawns them there."""
_OF_CARLA: Final = re.compile(r"Town\d\d(HD)?(_Opt)?")
_APART_M, _HIGHER_M = 12.0, 20.0
"""Entities that begin nearer to each other than a bus is long wait one above the other, because CARLA refuses those
that touch; when they appear, they are put on the road."""
_DATE: Final = "1970-01-01T00:00:00"


def entity_name(actor: ActorDescription) -> str:
    """Entity name: ``Ego`` for the EMV, as ScenarioRunner and esmini call the main vehicle, otherwise the id."""
    return "Ego" if actor.is_emv and actor.actor_id == 1 else f"Vehicle{actor.actor_id}"


def add_vehicle(entities: Element, actor: ActorDescription, dialect: str = "") -> None:
    """Add an entity with its vehicle. A pedestrian's origin is its centre, as is that of all in ``RUNNER``."""
    entity = child(entities, "ScenarioObject", name=entity_name(actor))
    kind, runner = actor.actor_class, dialect == RUNNER
    blueprint = cast_of(actor)[0]
    if kind is ActorClass.PEDESTRIAN:
        names = {"name": "pedestrian", "model": blueprint if runner else "adult"}
        walker = child(entity, "Pedestrian", **names, pedestrianCategory="pedestrian", mass=75.0)
        box = child(walker, "BoundingBox")
        child(box, "Center", x=0.0, y=0.0, z=actor.height_m / 2.0)
        child(box, "Dimensions", length=actor.length_m, width=actor.width_m, height=actor.height_m)
        child(walker, "Properties")
        return
    category = _CATEGORY.get(kind, "car")
    since_1_2 = {} if runner else {"role": _ROLE.get(kind, "civil"), "mass": 1500.0}
    name = blueprint if runner else kind.name.lower()
    vehicle = child(entity, "Vehicle", name=name, vehicleCategory=category, **since_1_2)
    box = child(vehicle, "BoundingBox")
    axle_m = 0.0 if not runner else -REAR_AXLE * actor.length_m
    child(box, "Center", x=REAR_AXLE * actor.length_m + axle_m, y=0.0, z=actor.height_m / 2.0)
    child(box, "Dimensions", length=actor.length_m, width=actor.width_m, height=actor.height_m)
    child(vehicle, "Performance", **_LIMITS)
    axles = child(vehicle, "Axles")
    front_m = axle_m + 2.0 * REAR_AXLE * actor.length_m
    for name, place_m, steering in (("FrontAxle", front_m, 0.6), ("RearAxle", axle_m, 0.0)):
        wheels = {"maxSteering": steering, "wheelDiameter": _WHEEL_M, "trackWidth": 0.85 * actor.width_m}
        child(axles, name, **wheels, positionX=place_m, positionZ=_WHEEL_M / 2.0)
    properties = child(vehicle, "Properties")
    child(properties, "Property", name="type", value="ego_vehicle" if entity_name(actor) == "Ego" else "simulation")
    red, green, blue = actor.colour_rgb
    child(properties, "Property", name="color", value=f"{red},{green},{blue}")


class OpenScenarioExporter(FilesExporter):
    """Writes one file per episode, with its map."""

    def __init__(self, dialect: str) -> None:
        """``dialect`` is ``RUNNER``, or that of OpenSCENARIO 1.2."""
        self._dialect = dialect

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Write scenario and map; all tracks of the episode are in memory."""
        tracks = [track for track in tracks_of(source.record()) if len(track) > 1]
        drive = road = f"{source.map_label}.xodr"
        if self._dialect == RUNNER and _OF_CARLA.fullmatch(source.description.map_name):
            road = source.description.map_name  # with buildings, which CARLA does not build of a file
        template, level, seed = source.description.template, source.description.level.name, source.description.seed
        title = f"SIREN {template}, level {level}, seed {seed}"
        files.write(drive, opendrive_of(source))
        files.write(f"{episode_id}.xosc", document(scenario(tracks, road, title, self._dialect)))
        classes = Counter(track.actor.actor_class.name.lower() for track in tracks)
        return EpisodeReport({"scenarios": 1, "vehicles": len(tracks)}, dict(classes))


def scenario(tracks: Sequence[Track], road: str, description: str, dialect: str = "") -> Element:
    """The whole document, in OpenSCENARIO 1.2 or in ``RUNNER``."""
    root, runner = Element("OpenSCENARIO"), dialect == RUNNER
    about = {"date": _DATE, "author": "SIREN", "description": description}
    child(root, "FileHeader", revMajor=_MAJOR, revMinor=0 if runner else _MINOR, **about)
    child(root, "ParameterDeclarations")
    child(root, "CatalogLocations")
    child(root, "RoadNetwork/LogicFile", filepath=road)
    entities = child(root, "Entities")
    for track in tracks:
        add_vehicle(entities, track.actor, dialect)
    storyboard = child(root, "Storyboard")
    actions = child(storyboard, "Init/Actions")
    taken: list[Floats] = []
    for track in sorted(tracks, key=lambda each: int(each.frame[0])):
        if track.frame[0] == 0 or runner:
            place = rear_axle(track, dialect)[0]
            place[2] += _HIGHER_M * sum(float(np.hypot(*(place - other)[:2])) < _APART_M for other in taken) * runner
            taken += [place] if track.frame[0] else []
            private = child(actions, "Private", entityRef=entity_name(track.actor))
            _position(child(private, "PrivateAction/TeleportAction"), place)
            speed = child(private, "PrivateAction/LongitudinalAction/SpeedAction")
            child(speed, "SpeedActionDynamics", dynamicsShape="step", value=0.0, dynamicsDimension="time")
            child(speed, "SpeedActionTarget/AbsoluteTargetSpeed", value=track.speed_mps[0])
    act = child(child(storyboard, "Story", name="Recorded"), "Act", name="Recorded")
    last = max(int(track.frame[-1]) for track in tracks)
    for track in tracks:
        _add_group(act, track, dialect, removed=int(track.frame[-1]) < last)
    _time_trigger(child(act, "StartTrigger"), "start", 0.0)
    _time_trigger(child(storyboard, "StopTrigger"), "end", last * FRAME_S)
    for condition in root.iter("SimulationTimeCondition") if runner else ():
        condition.set("rule", "greaterThan")
    return root


def _add_group(act: Element, track: Track, dialect: str, *, removed: bool) -> None:
    """Add one vehicle's actions: it appears when first recorded, follows its trajectory, and disappears at its end."""
    name = entity_name(track.actor)
    group = child(act, "ManeuverGroup", maximumExecutionCount=1, name=f"{name}Group")
    child(child(group, "Actors", selectTriggeringEntities=False), "EntityRef", entityRef=name)
    maneuver = child(group, "Maneuver", name=f"{name}Maneuver")
    start_s = float(track.frame[0]) * FRAME_S
    if track.frame[0] > 0:
        action = _event(maneuver, f"{name}Added")
        if dialect == RUNNER:
            added = child(action, "PrivateAction/TeleportAction")
        else:
            added = child(child(action, "GlobalAction/EntityAction", entityRef=name), "AddEntityAction")
        _position(added, rear_axle(track, dialect)[0])
        _start_event_at(maneuver, start_s)
    _follow(_event(maneuver, f"{name}Follows"), track, name, dialect)
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


def rear_axle(track: Track, dialect: str = "") -> Floats:
    """x, y, z, heading of the reference point over the frames, shape ``(K, 4)``; in ``RUNNER`` that of the middle."""
    middle = dialect == RUNNER or track.actor.actor_class is ActorClass.PEDESTRIAN
    behind = 0.0 if middle else REAR_AXLE * track.actor.length_m
    x_m = track.x_m - behind * np.cos(track.yaw_rad)
    y_m = track.y_m - behind * np.sin(track.yaw_rad)
    return np.stack((x_m, y_m, track.z_m, track.yaw_rad), axis=-1)


def _position(parent: Element, place: Floats) -> None:
    x, y, z, heading = place.tolist()
    child(parent, "Position/WorldPosition", x=x, y=y, z=z, h=heading, p=0.0, r=0.0)


def _follow(action: Element, track: Track, name: str, dialect: str) -> None:
    follow = child(action, "PrivateAction/RoutingAction/FollowTrajectoryAction")
    path = "Trajectory" if dialect == RUNNER else "TrajectoryRef/Trajectory"
    trajectory = child(follow, path, name=f"{name}Trajectory", closed=False)
    line = child(trajectory, "Shape/Polyline")
    for frame, place in zip(track.frame.tolist(), rear_axle(track, dialect), strict=True):
        _position(child(line, "Vertex", time=float(frame) * FRAME_S), place)
    child(follow, "TimeReference/Timing", domainAbsoluteRelative="absolute", scale=1.0, offset=0.0)
    child(follow, "TrajectoryFollowingMode", followingMode="position")


SCENARIONET_VERSION: Final = "1.0"
VEHICLE: Final = "VEHICLE"
PEDESTRIAN: Final = "PEDESTRIAN"
CYCLIST: Final = "CYCLIST"
"""ScenarioNet's type for riders of two-wheelers."""
_LIGHT: Final = {
    "r": "LANE_STATE_STOP",
    "u": "LANE_STATE_STOP",
    "y": "LANE_STATE_CAUTION",
    "g": "LANE_STATE_GO",
    "s": "LANE_STATE_ARROW_GO",
    "o": "LANE_STATE_FLASHING_CAUTION",
}
"""ScenarioNet's state for each of SUMO's letters, in either case."""
_FILE: Final = "sd_siren_1.0_{}.pkl"
"""File name of a scenario. MetaDrive expects the prefix ``sd_`` and the scenario's id at the end."""
_SUMMARY: Final = "dataset_summary.pkl"
_MAPPING: Final = "dataset_mapping.pkl"
_PROTOCOL: Final = 4


def description(record: EpisodeRecord, tracks: Sequence[Track], scenario_id: str, emv_id: int) -> dict[str, Any]:
    """The scenario description; MetaDrive's agent drives the vehicle ``emv_id``."""
    length = max(int(track.frame[-1]) for track in tracks) + 1
    request = record.description
    return {
        "id": scenario_id,
        "version": SCENARIONET_VERSION,
        "length": length,
        "tracks": {str(track.actor.actor_id): _track(track, length) for track in tracks},
        "dynamic_map_states": _lights(record, length),
        "map_features": map_features(record.network),
        "metadata": {
            "dataset": "siren",
            "scenario_id": scenario_id,
            "coordinate": "right-handed",
            "metadrive_processed": False,
            "sdc_id": str(emv_id),
            "ts": np.arange(length) * FRAME_S,
            "sample_rate": FRAME_S,
            "map": request.map_name,
            "template": request.template,
            "level": request.level.name,
            "seed": request.seed,
        },
    }


def _track(track: Track, length: int) -> dict[str, Any]:
    """Arrays of a track over the whole scenario; 0 where the vehicle is not present."""

    def spread(values: npt.ArrayLike, dtype: type = np.float32) -> Any:
        column = np.asarray(values)
        whole: npt.NDArray[Any] = np.zeros((length, *column.shape[1:]), dtype=dtype)
        whole[track.frame] = column
        return whole

    actor, there = track.actor, np.ones(len(track))
    state = {
        "position": spread(np.stack((track.x_m, track.y_m, track.z_m), axis=-1)),
        "heading": spread(track.yaw_rad),
        "velocity": spread(np.stack((track.vx_mps, track.vy_mps), axis=-1)),
        "length": spread(there * actor.length_m),
        "width": spread(there * actor.width_m),
        "height": spread(there * actor.height_m),
        "valid": spread(there, np.bool_),
    }
    name = str(actor.actor_id)
    ridden, walks = actor.actor_class in TWO_WHEELED, actor.actor_class is ActorClass.PEDESTRIAN
    kind = PEDESTRIAN if walks else CYCLIST if ridden else VEHICLE
    metadata = {
        "type": kind,
        "track_length": length,
        "object_id": name,
        "class": actor.actor_class.name.lower(),
        "is_emv": actor.is_emv,
    }
    return {"type": kind, "state": state, "metadata": metadata}


def _lights(record: EpisodeRecord, length: int) -> dict[str, Any]:
    """States of the lights over time, one light per lane that a signal controls."""
    letters: dict[int, list[str]] = {}
    for traffic in record.traffic:
        frame, odd = divmod(traffic.step, LOG_PERIOD_STEPS)
        if odd or frame >= length:
            continue
        states = {signal.signal_id: signal.state for signal in traffic.signals}
        for connection in record.network.connections:
            state = states.get(str(connection.signal_id), "")
            if connection.signal_link < len(state) and connection.signal_link >= 0:
                seen = letters.setdefault(connection.from_lane, [""] * length)
                # A lane shows the most permissive state among its movements.
                seen[frame] = max(seen[frame], state[connection.signal_link].lower(), key="ouryg".find)
    lights = {}
    for lane, seen in letters.items():
        name, stop = str(lane), record.network.lanes[lane].centre.points[-1]
        lights[name] = {
            "type": "TRAFFIC_LIGHT",
            "state": {"object_state": [_LIGHT.get(letter, "LANE_STATE_UNKNOWN") for letter in seen]},
            "lane": name,
            "stop_point": np.array([*stop, 0.0], dtype=np.float32),
            "metadata": {"type": "TRAFFIC_LIGHT", "track_length": length, "object_id": name, "dataset": "siren"},
        }
    return lights


def map_features(network: RoadNetwork) -> dict[str, Any]:
    """Map features: lanes with their areas, the lines between and beside them, crossings."""
    graph = lane_graph(network)
    features: dict[str, Any] = {}
    for index, lane in graph.items():
        left, right = lane.left_neighbour, lane.right_neighbour
        features[str(index)] = {
            "type": "LANE_SURFACE_UNSTRUCTURE" if lane.in_junction else "LANE_SURFACE_STREET",
            "polyline": _with_height(lane.lane.centre.points),
            "polygon": lane.outline.astype(np.float32),
            "entry_lanes": [str(other) for other in lane.predecessors],
            "exit_lanes": [str(other) for other in lane.successors],
            "left_neighbor": [] if left is None else [str(left)],
            "right_neighbor": [] if right is None else [str(right)],
            "speed_limit_kmh": lane.lane.speed_limit_mps * 3.6,
        }
        if lane.in_junction:
            continue
        sides = [("left", left, lane.left), ("right", right, lane.right)]
        (inner, next_inner, inner_line), (outer, next_outer, outer_line) = sides[::-1] if lane.left_hand else sides
        drawn = "ROAD_LINE_SOLID_SINGLE_YELLOW" if next_inner is None else "ROAD_LINE_BROKEN_SINGLE_WHITE"
        features[f"{index}_{inner}"] = {"type": drawn, "polyline": _with_height(inner_line)}
        if next_outer is None:
            features[f"{index}_{outer}"] = {"type": "ROAD_EDGE_BOUNDARY", "polyline": _with_height(outer_line)}
    for number, outline in enumerate(network.crossings):
        features[f"crossing_{number}"] = {"type": "CROSSWALK", "polygon": outline.astype(np.float32)}
    return features


def _with_height(points: Points) -> npt.NDArray[np.float32]:
    return np.hstack((points, np.zeros((len(points), 1)))).astype(np.float32)


def summary_of(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """Entry of a scenario in the dataset's summary: plain numbers and text."""
    tracks = scenario["tracks"]
    objects = {}
    for name, track in tracks.items():
        valid = track["state"]["valid"]
        moved = float(np.hypot(*np.diff(track["state"]["position"][valid, :2], axis=0).T).sum())
        count = int(valid.sum())
        lengths = {"moving_distance": moved, "valid_length": count, "continuous_valid_length": count}
        objects[name] = {"type": track["type"], "object_id": name, "track_length": scenario["length"], **lengths}
    kinds = Counter(summary["type"] for summary in objects.values())
    moving = Counter(summary["type"] for summary in objects.values() if summary["moving_distance"] > 1.0)
    metadata = {key: value for key, value in scenario["metadata"].items() if key != "ts"}
    return {
        **metadata,
        "ts": scenario["metadata"]["ts"].tolist(),
        "object_summary": objects,
        "number_summary": {
            "num_objects": len(tracks),
            "object_types": [*kinds],
            "num_objects_each_type": dict(kinds),
            "num_moving_objects": moving.total(),
            "num_moving_objects_each_type": {kind: moving[kind] for kind in kinds},
            "num_traffic_lights": len(scenario["dynamic_map_states"]),
            "num_map_features": len(scenario["map_features"]),
            "map_height_diff": 0.0,
        },
    }


class ScenarioNetExporter:
    """Writes one pickled description per episode, and one database per split."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Write the description; all tracks of the episode are in memory."""
        record = source.record()
        tracks = [track for track in tracks_of(record) if len(track) > 1]
        scenario = description(record, tracks, episode_id, min(record.emv_ids))
        files.write(_FILE.format(episode_id), pickle.dumps(scenario, _PROTOCOL))
        files.write("summary.pkl", pickle.dumps(summary_of(scenario), _PROTOCOL))
        classes = Counter(track.actor.actor_class.name.lower() for track in tracks)
        return EpisodeReport({"scenarios": 1, "tracks": len(tracks)}, dict(classes))

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Write the summary and the mapping of each split."""
        for split in sorted({part.subset for part in parts}):
            summary: dict[str, Any] = {}
            for part in [part for part in parts if part.subset == split]:
                name = _FILE.format(part.episode_id)
                link(part.folder / name, folder / split / name)
                summary[name] = pickle.loads((part.folder / "summary.pkl").read_bytes())  # noqa: S301 - written by this export
            (folder / split / _SUMMARY).write_bytes(pickle.dumps(summary, _PROTOCOL))
            (folder / split / _MAPPING).write_bytes(pickle.dumps(dict.fromkeys(summary, ""), _PROTOCOL))
