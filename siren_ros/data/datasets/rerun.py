"""Exports recorded episodes as Rerun recordings, with the layout of the viewer."""

import uuid
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.datasets.files import FileWriter
from siren_ros.data.datasets.formats import EpisodeReport, FilesExporter
from siren_ros.data.datasets.lane_graph import lane_graph
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.interfaces.conversions import from_actor_states, from_events, from_traffic_state
from siren_ros.data.interfaces.measurements import from_compressed_image, from_point_cloud
from siren_ros.data.interfaces.topics import ACTORS, TRAFFIC
from siren_ros.data.interfaces.topics import EVENTS as EVENTS_TOPIC
from siren_ros.data.recording.bag_reader import BagMessage, damage_refused
from siren_ros.data.tracks import LOG_PERIOD_STEPS
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import ActorDescription, ActorStates, Mode

MAP_ROOT = "map"
EGO = "map/emv"
EVENTS = "events"
SPEED = "speed"
TIMELINE: Final = "episode"
_NAMESPACE: Final = uuid.UUID("5d0dd0a5-7f0b-4b7c-9d1b-0f5a5e3c2a11")
_POINT_STEP: Final = 2
"""The recording shows every second return of a sweep."""
_EMV_COLOUR: Final = (230, 30, 30)
_YIELDING_COLOUR: Final = (250, 170, 30)


def blueprint(cameras: Sequence[str]) -> Any:
    """Layout of the viewer: the 3-D scene, a grid of cameras, events and speed below."""
    scene = rrb.Spatial3DView(origin=MAP_ROOT, name="Scene")
    pictures = [rrb.Spatial2DView(origin=f"{EGO}/{name}", name=name) for name in cameras]
    events, speed = rrb.TextLogView(origin=EVENTS, name="Events"), rrb.TimeSeriesView(origin=SPEED, name="Speed")
    below = rrb.Horizontal(events, speed)
    above = rrb.Horizontal(scene, rrb.Grid(*pictures), column_shares=[3, 2]) if pictures else scene
    return rrb.Blueprint(
        rrb.Vertical(above, below, row_shares=[3, 1]),
        rrb.TimePanel(state="expanded"),
        rrb.SelectionPanel(state="collapsed"),
    )


class RerunExporter(FilesExporter):
    """Writes one ``.rrd`` file per episode; only one step is in memory."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Write the recording."""
        recording = rr.RecordingStream(
            "siren", recording_id=str(uuid.uuid5(_NAMESPACE, episode_id)), send_properties=False
        )
        recording.save(files.folder / f"{episode_id}.rrd", blueprint([camera.name for camera in source.cameras]))
        _log_map(recording, source.network)
        _log_sensors(recording, source)
        steps = _Steps(recording, source)
        pictures = {camera.topic for camera in source.cameras}
        clouds = {source.lidar.topic} if source.lidar else set()
        topics = {ACTORS.name, TRAFFIC.name, EVENTS_TOPIC.name, *pictures, *clouds}
        for step, held in source.messages_by_step(topics):
            steps.show(step, held)
            files.progress(step * STEP_S)
        recording.flush()
        recording.disconnect()
        return EpisodeReport({"recordings": 1, "steps": steps.count, "events": steps.events})


class _Steps:
    """Logs the steps of an episode to Rerun."""

    def __init__(self, recording: Any, source: EpisodeSource) -> None:
        self._recording = recording
        self._source = source
        self._actors: dict[int, ActorDescription] = {}
        self._path: list[tuple[float, float, float]] = []
        self.count = self.events = 0

    def show(self, step: int, held: Mapping[str, BagMessage]) -> None:
        """Logs one step."""
        recording, source = self._recording, self._source
        recording.set_time(TIMELINE, duration=step * STEP_S)
        with damage_refused(source.path):
            if TRAFFIC.name in held:
                spawned = from_traffic_state(held[TRAFFIC.name].read()).spawned
                self._actors.update({actor.actor_id: actor for actor in spawned})
            if ACTORS.name in held and step % LOG_PERIOD_STEPS == 0:
                self._show_actors(from_actor_states(held[ACTORS.name].read()))
            if EVENTS_TOPIC.name in held:
                self._show_events(held[EVENTS_TOPIC.name])
            if source.lidar is not None and source.lidar.topic in held and step % LOG_PERIOD_STEPS == 0:
                points = from_point_cloud(held[source.lidar.topic].read())[::_POINT_STEP]
                places = np.stack((points["x"], points["y"], points["z"]), axis=-1)
                recording.log(f"{EGO}/{source.lidar.name}", rr.Points3D(places, radii=0.04))
            for camera in source.cameras:
                if camera.topic in held:
                    jpeg = from_compressed_image(held[camera.topic].read())
                    image = rr.EncodedImage(contents=jpeg, media_type="image/jpeg")
                    recording.log(f"{EGO}/{camera.name}", image)

    def _show_actors(self, states: ActorStates) -> None:
        self.count += 1
        actors = [self._actors[actor_id] for actor_id in states.actor_id.tolist()]
        heights = np.array([actor.height_m for actor in actors])
        boxes = rr.Boxes3D(
            half_sizes=[[actor.length_m / 2, actor.width_m / 2, actor.height_m / 2] for actor in actors],
            centers=np.stack((states.x_m, states.y_m, states.z_m + heights / 2), axis=-1),
            rotation_axis_angles=[
                rr.RotationAxisAngle(axis=(0.0, 0.0, 1.0), angle=rr.Angle(rad=yaw)) for yaw in states.yaw_rad.tolist()
            ],
            colors=[_colour(actor, Mode(mode)) for actor, mode in zip(actors, states.mode.tolist(), strict=True)],
            labels=[f"{actor.actor_class.name.lower()} {actor.actor_id}" for actor in actors],
            show_labels=False,
        )
        self._recording.log(f"{MAP_ROOT}/vehicles", boxes)
        row = states.row_of(min(self._source.description.emv_ids, default=0))
        if row is None:
            return
        place = (float(states.x_m[row]), float(states.y_m[row]), float(states.z_m[row]))
        turned = rr.RotationAxisAngle(axis=(0.0, 0.0, 1.0), angle=rr.Angle(rad=float(states.yaw_rad[row])))
        self._recording.log(EGO, rr.Transform3D(translation=place, rotation=turned))
        self._recording.log(f"{SPEED}/emv", rr.Scalars(float(states.speed_mps[row])))
        self._path.append(place)
        recent = self._path[-2:]
        if len(recent) > 1:
            # The path is logged piece by piece: as a whole line at each step, the file would grow with the square of
            # time.
            self._recording.log(
                f"{MAP_ROOT}/path/{len(self._path):06d}", rr.LineStrips3D([recent], colors=_EMV_COLOUR, radii=0.15)
            )

    def _show_events(self, message: BagMessage) -> None:
        for event in from_events(message.read())[2]:
            details = ", ".join(f"{key} {value}" for key, value in event.detail.items())
            text = f"{event.kind.value}: vehicle {event.actor_id}" + (f" ({details})" if details else "")
            self._recording.log(EVENTS, rr.TextLog(text, level="WARN" if event.kind.value == "collision" else "INFO"))
            self.events += 1


def _colour(actor: ActorDescription, mode: Mode) -> tuple[int, int, int]:
    if actor.is_emv:
        return _EMV_COLOUR
    return _YIELDING_COLOUR if mode.is_yielding else actor.colour_rgb


def _log_map(recording: Any, network: RoadNetwork) -> None:
    recording.log(MAP_ROOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    graph = lane_graph(network)
    lines = [np.pad(line, ((0, 0), (0, 1))) for lane in graph.values() for line in (lane.left, lane.right)]
    recording.log(f"{MAP_ROOT}/lanes", rr.LineStrips3D(lines, colors=(120, 120, 120), radii=0.05), static=True)


def _log_sensors(recording: Any, source: EpisodeSource) -> None:
    for sensor in (*((source.lidar,) if source.lidar else ()), *source.cameras):
        mount = sensor.base_from_sensor
        pose = rr.Transform3D(translation=mount[:3, 3], mat3x3=mount[:3, :3])
        recording.log(f"{EGO}/{sensor.name}", pose, static=True)
    for camera in source.cameras:
        model = camera.model
        pinhole = rr.Pinhole(
            image_from_camera=model.matrix,
            resolution=[model.width, model.height],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=2.0,
        )
        recording.log(f"{EGO}/{camera.name}", pinhole, static=True)
