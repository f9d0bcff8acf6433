"""Examines a CARLA server: what a user runs first, and what a report of a fault contains.

One actor of every class drives three steps on the server's own map, with a suite on the ambulance. What the server then
says of poses, boxes, lights and measurements stands next to what was asked, and next to our own LiDAR.
"""

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.data.interfaces.carla import actor_pose, blueprints, carla_lights
from siren_ros.data.interfaces.measurements import from_point_cloud
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.sensor_messages.mounted_suite import TrailingSensing
from siren_ros.running.carla.session import CALL_S, CarlaSession
from siren_ros.sensing.rig import SensorRig
from siren_ros.sensing.suite import load_suite
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorDescription, ActorStates, Lights

_STEPS: Final = 3
_SPACING_M: Final = 15.0
"""More than the length of the longest vehicle, so that no two touch."""
_NEAR_M, _NEAR_DEG = 0.001, 0.01
"""Within these a pose counts as the one that was asked for: CARLA sends single precision."""
_FLAT_RINGS: Final = 8
"""Rings from the lowest whose ranges are compared: on flat ground all their points are near."""


def examine(
    address: str, suite_name: str = "front", record: EpisodeRecord | None = None, timeout_s: float = CALL_S
) -> dict[str, Any]:
    """Everything about a server as plain values; ``verdict`` lists what is wrong, and is empty where nothing is.

    With a record, the map must be that of the episode, else the server's own map is compiled.

    Raises:
        InputError: No server, another version, another map, or no such suite.
        EpisodeError: The server refuses, is gone, or does not answer in time.
    """
    with CarlaSession(address, timeout_s) as session:
        network = _compiled(session) if record is None else record.network
        actors = {actor.actor_id: actor for actor in _one_of_each()}
        about = ("check", EmergencyLevel.L2, 0, session.map.name, "", 0.0, suite_name, "paper", (1,))
        episode = EpisodeDescription(*about)
        sensing = TrailingSensing(session.suites(episode, network, lambda _: False), trails=False)
        counts: dict[str, int] = {}
        clouds: dict[str, Any] = {}
        for step in range(_STEPS):
            states = _states(network, actors, step)
            for topic, message in session.messages(sensing, states, actors, ()):
                counts[topic.name] = counts.get(topic.name, 0) + 1
                clouds |= {topic.name: from_point_cloud(message)} if topic.name.endswith("/points") else {}
        boxes = {each.type_id: each.bounding_box.extent for each in session.things.values()}
        found: dict[str, Any] = {
            "client": session.client.get_client_version(),
            "server": session.client.get_server_version(),
            **session.account,
            "blueprints": {
                kind.name.lower(): sorted(rows.keys() & session.blueprint_names) for kind, rows in blueprints().items()
            },
            "boxes_m": {name: [round(2.0 * side, 3) for side in (box.x, box.y, box.z)] for name, box in boxes.items()},
            "poses": list(_poses(session, states, actors)),
            "messages": counts,
            "ranges_m": {name: _medians(points) for name, points in clouds.items()},
        }
    rig = SensorRig(load_suite(suite_name), network, 0)
    sweeps = rig.observe(states, actors, (), 1).sweeps
    found["our_ranges_m"] = {sweep.sensor: _medians(sweep.points) for sweep in sweeps}
    return {**found, "verdict": list(_verdict(found))}


def _compiled(session: CarlaSession) -> RoadNetwork:
    with tempfile.TemporaryDirectory() as folder:
        drive = Path(folder) / f"{Path(session.map.name).name or 'map'}.xodr"
        drive.write_text(session.map.to_opendrive(), encoding="utf-8")
        return parse_road_network(compile_map(drive, Path(folder)).read_bytes())


def _one_of_each() -> Iterator[ActorDescription]:
    """An actor of every class, the ambulance first: it carries the sensors."""
    sizes = load_vehicle_parameters()
    kinds = sorted(ActorClass, key=lambda kind: kind is not ActorClass.AMBULANCE)
    for actor_id, kind in enumerate(kinds, 1):
        size = sizes.get(kind)
        sides_m = (size.length_m, size.width_m, size.height_m) if size else (0.5, 0.5, 1.75)
        yield ActorDescription(actor_id, kind.name, kind, *sides_m, (200, 30, 30), kind.is_emergency)


def _states(network: RoadNetwork, actors: Mapping[int, ActorDescription], step: int) -> ActorStates:
    """The actors one behind the other on the longest lanes, half a metre further at each step, with all lights."""
    lanes = [lane for lane in network.lanes if lane.kind is LaneKind.DRIVING and not network.edges[lane.edge].internal]
    places: list[tuple[float, ...]] = []
    for line in sorted((lane.centre for lane in lanes), key=lambda line: -float(line.arc_m[-1])):
        along_m = np.arange(_SPACING_M / 2.0, float(line.arc_m[-1]) - _SPACING_M / 2.0, _SPACING_M) + 0.5 * step
        places += [(*line.at(np.array([at_m]))[0].tolist(), float(line.heading_rad(at_m))) for at_m in along_m.tolist()]
    count = min(len(actors), len(places))
    columns: dict[str, Any] = {name: np.zeros(count, dtype) for name, dtype in ACTOR_STATE_DTYPES.items()}
    columns["actor_id"] = np.array(sorted(actors)[:count], np.uint32)
    columns["x_m"], columns["y_m"], columns["yaw_rad"] = np.array(places[:count]).T
    columns["lights"][:] = int(Lights.BRAKE | Lights.INDICATORS | Lights.BEACON)
    return ActorStates(step, **columns)


def _poses(
    session: CarlaSession, states: ActorStates, actors: Mapping[int, ActorDescription]
) -> Iterator[dict[str, object]]:
    """For each actor how far it is from where it was asked to be, and its lights."""
    snapshot, lights = session.world.get_snapshot(), session.world.get_vehicles_light_states()
    for row, actor_id in enumerate(states.actor_id.tolist()):
        thing, kind = session.things[actor_id], actors[actor_id].actor_class
        place = snapshot.find(thing.id).get_transform()
        x, y, yaw = (float(values[row]) for values in (states.x_m, states.y_m, states.yaw_rad))
        asked = actor_pose(x, y, yaw, 0.0, *session.boxes[actor_id])
        yield {
            "actor": kind.name.lower(),
            "blueprint": thing.type_id,
            "away_m": float(np.hypot(place.location.x - asked[0], place.location.y - asked[1])),
            "turned_deg": float(abs(np.degrees(wrap_angle(np.radians(place.rotation.yaw - asked[4]))))),
            "height_m": float(place.location.z),
            "lights_asked": 0 if kind is ActorClass.PEDESTRIAN else carla_lights(int(states.lights[row])),
            "lights": int(lights.get(thing.id, 0)),
        }


def _medians(points: Any) -> list[float]:
    """Median range of each of the lowest rings, 0 for a ring without points."""
    distance = np.sqrt(sum(points[name].astype(np.float64) ** 2 for name in "xyz"))
    rings = [distance[points["ring"] == ring] for ring in range(_FLAT_RINGS)]
    return [round(float(np.median(ring)), 2) if len(ring) else 0.0 for ring in rings]


def _verdict(found: Mapping[str, Any]) -> Iterator[str]:
    for kind, name in found["replaced"].items():
        yield f"no blueprint of its own for {kind}: {name} stands for it"
    for pose in found["poses"]:
        if pose["away_m"] > _NEAR_M or pose["turned_deg"] > _NEAR_DEG:
            yield f"{pose['blueprint']} is {pose['away_m']:.3f} m, {pose['turned_deg']:.2f}° from its place"
        if pose["lights"] != pose["lights_asked"]:
            yield f"{pose['blueprint']} shows the lights {pose['lights']}, not {pose['lights_asked']}"


def lines_of(found: Mapping[str, Any]) -> Iterator[str]:
    """What ``examine`` found, as text."""
    lanes = found["map"]["lanes"]
    yield f"CARLA {found['server']}, client {found['client']}"
    yield f"map {found['map']['name']} (OpenDRIVE {found['map']['sha256'][:12]}…)"
    away = f"{lanes['median_m']:.3f} m (median), {lanes['share_m']:.3f} m (95 %)"
    yield f"  lanes at {lanes['places']:.0f} places are away from ours by {away}"
    yield f"  traffic lights that show our signals: {found['signals']}"
    for kind, names in found["blueprints"].items():
        yield f"{kind}: " + (", ".join(f"{name} {found['boxes_m'].get(name, '')}".strip() for name in names) or "none")
    worst = max(pose["away_m"] for pose in found["poses"])
    yield f"{len(found['poses'])} actors, at most {worst * 1000.0:.2f} mm from their places"
    yield from (f"  {name}: {count} messages" for name, count in sorted(found["messages"].items()))
    for key, whose in (("ranges_m", "CARLA's"), ("our_ranges_m", "our")):
        yield from (f"  {name}: {whose} ranges of the lowest rings {rows} m" for name, rows in found[key].items())
    yield from (f"WRONG: {line}" for line in found["verdict"])
    yield "this server can be used" if not found["verdict"] else "this server differs from what the bridge expects"
