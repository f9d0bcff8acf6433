"""Carriers of sensors with their frames and motion, the topics of a suite, and all recorded topics of an episode."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Matrix, random_stream
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.measurements import (
    Transform,
    quaternion_of_matrix,
    quaternion_of_yaw,
    to_audio,
    to_imu,
    to_nav_sat_fix,
)
from siren_ros.data.interfaces.topics import AV_CARRIER, EMV_CARRIER, Topic
from siren_ros.errors import EpisodeError
from siren_ros.sensing.microphone import MicrophoneSpec
from siren_ros.sensing.navigation import GnssSpec, ImuSpec, VehicleMotion
from siren_ros.sensing.specification import OPTICAL_FROM_BODY, CameraSpec, Mount, SensorSpec
from siren_ros.sensing.suite import EXPORTED_CAMERA, SensorSuite, load_suite
from siren_ros.simulation.scenario.episode import MAX_SEED, EpisodeDescription
from siren_ros.simulation.world.actors import NO_ACTOR, ActorStates
from siren_ros.simulation.world.carrier import BASE_FRAME, MAP_FRAME, ODOM_FRAME, STATION_FRAME, Odometry


@dataclass(frozen=True)
class Carrier:
    """A carrier of sensors: how its topics and frames are named."""

    name: str
    """First part of the names of its topics."""
    frame_prefix: str
    """First part of the names of its frames; it separates two carriers in one tree of frames."""

    def frame(self, name: str) -> str:
        """Name of a frame of this carrier."""
        return f"{self.frame_prefix}{name}"


EMV: Final = Carrier(EMV_CARRIER, "")
"""The first emergency vehicle; its frames have the plain names of REP 105."""
AV: Final = Carrier(AV_CARRIER, f"{AV_CARRIER}/")
"""The AV under test."""


def noise_seed(seed: int, carrier: Carrier) -> int:
    """Seed of the noise of a carrier's sensors: the episode's seed for the EMV, a derived one for the AV."""
    if carrier == EMV:
        return seed
    draws = random_stream(seed, f"sensors of {carrier.name}")
    return int(draws.integers(2**31)) if seed <= MAX_SEED else int.from_bytes(draws.bytes(32))


def row_of_carrier(states: ActorStates, carrier_id: int) -> int:
    """Row of the carrier in the states; EpisodeError if it has left the map."""
    row = states.row_of(carrier_id)
    if row is None:
        raise EpisodeError(f"the sensors' carrier, actor {carrier_id}, is not on the map at step {states.step}")
    return row


def motion_of(states: ActorStates, row: int) -> VehicleMotion:
    """Pose in ``map`` and velocity in ``base_link`` of an actor."""
    yaw_rad = float(states.yaw_rad[row])
    vx_mps, vy_mps = float(states.vx_mps[row]), float(states.vy_mps[row])
    cos, sin = float(np.cos(yaw_rad)), float(np.sin(yaw_rad))
    return VehicleMotion(
        x_m=float(states.x_m[row]),
        y_m=float(states.y_m[row]),
        z_m=float(states.z_m[row]),
        yaw_rad=yaw_rad,
        forward_mps=cos * vx_mps + sin * vy_mps,
        left_mps=cos * vy_mps - sin * vx_mps,
        yaw_rate_radps=float(states.yaw_rate_radps[row]),
    )


def frames_of(motion: VehicleMotion, odometry: Odometry, carrier: Carrier = EMV) -> tuple[Transform, Transform]:
    """``/tf`` of a carrier (REP 105): ``map`` to ``odom`` to ``base_link``.

    ``odom`` to ``base_link`` is the odometry. ``map`` to ``odom`` corrects its drift, as an exact localisation would,
    so that both together give the simulated pose.
    """
    turn_rad = motion.yaw_rad - odometry.yaw_rad
    cos, sin = float(np.cos(turn_rad)), float(np.sin(turn_rad))
    x_m = motion.x_m - (cos * odometry.x_m - sin * odometry.y_m)
    y_m = motion.y_m - (sin * odometry.x_m + cos * odometry.y_m)
    odom, base = carrier.frame(ODOM_FRAME), carrier.frame(BASE_FRAME)
    return (
        Transform(MAP_FRAME, odom, (x_m, y_m, motion.z_m), quaternion_of_yaw(turn_rad)),
        Transform(odom, base, (odometry.x_m, odometry.y_m, 0.0), quaternion_of_yaw(odometry.yaw_rad)),
    )


def optical_frame(camera: str) -> str:
    """Frame id of a camera's images (REP 103: z forward, x right, y down)."""
    return f"{camera}_optical_frame"


def static_transforms(
    suite: SensorSuite, carrier: Carrier = EMV, station: Mount | None = None
) -> tuple[Transform, ...]:
    """``/tf_static`` of a suite: ``base_link``, or the station's frame, to sensors and cameras' optical frames."""
    parent = carrier.frame(BASE_FRAME if station is None else STATION_FRAME)
    bodies = [_transform(parent, carrier.frame(name), mount.base_from_sensor) for name, mount in suite.mounts]
    if station is not None:
        bodies.insert(0, _transform(MAP_FRAME, parent, station.base_from_sensor))
    body_from_optical = np.eye(4)
    body_from_optical[:3, :3] = OPTICAL_FROM_BODY.T
    optical = [
        _transform(parent, carrier.frame(optical_frame(camera.name)), camera.mount.base_from_sensor @ body_from_optical)
        for camera in suite.cameras
    ]
    return (*bodies, *optical)


def _transform(parent: str, child: str, parent_from_child: Matrix) -> Transform:
    x_m, y_m, z_m = (float(value) for value in parent_from_child[:3, 3])
    return Transform(parent, child, (x_m, y_m, z_m), quaternion_of_matrix(parent_from_child[:3, :3]))


@dataclass(frozen=True)
class SensorMessages:
    """Topic and message of a sensor type."""

    topic: Topic
    to_message: Callable[[Any], Any]
    """Converts a measurement to its message."""


SENSOR_MESSAGES: Final[dict[type[SensorSpec], SensorMessages]] = {
    GnssSpec: SensorMessages(topics.GNSS, to_nav_sat_fix),
    ImuSpec: SensorMessages(topics.IMU, to_imu),
    MicrophoneSpec: SensorMessages(topics.AUDIO, to_audio),
}
"""Topics and messages by sensor type, except LiDARs and cameras, which have several topics or labels."""


def suite_topics(suite: SensorSuite, carrier: Carrier = EMV) -> tuple[Topic, ...]:
    """Topics of a suite's sensors, including images that are not recorded."""
    first = min((lidar.name for lidar in suite.lidars), default="")
    of_suite = []
    for lidar in suite.lidars:
        topic = topics.LIDAR.of_sensor(lidar.name, lidar.period_steps)
        of_suite.append(topic if lidar.name == first else topic.if_recorded(True))
    for camera in suite.cameras:
        of_suite.extend(topic.of_sensor(camera.name, camera.period_steps) for topic in camera_topics(camera, suite))
    of_suite.extend(SENSOR_MESSAGES[type(spec)].topic.of_sensor(spec.name, spec.period_steps) for spec in suite.others)
    return tuple(topic.of_carrier(carrier.name) for topic in of_suite)


def camera_topics(camera: CameraSpec, suite: SensorSuite) -> tuple[Topic, ...]:
    """Topics of a camera, with ``{sensor}`` in place of its name."""
    exported = camera.name == EXPORTED_CAMERA
    return (
        topics.IMAGE_COMPRESSED if exported else topics.IMAGE_COMPRESSED.if_recorded(True),
        topics.CAMERA_INFO,
        topics.IMAGE,
        topics.IMAGE_DEPTH.if_recorded(camera.depth),
        topics.IMAGE_SEMANTIC.if_recorded(camera.semantic),
        topics.IMAGE_INSTANCE.if_recorded(camera.instance),
        *((topics.IMAGE_TRUTH, topics.IMAGE_BOXES) if suite.labels else ()),
    )


def recorded_topics(suite: SensorSuite, av_suite: SensorSuite | None = None) -> tuple[Topic, ...]:
    """All topics of an episode's bag, in the order of a step's messages; ``av_suite`` is that of an AV under test."""
    of_episode = (*topics.CORE_TOPICS, *topics.CARRIER_TOPICS, *suite_topics(suite))
    if av_suite is not None:
        of_episode = (*of_episode, *topics.AV_TOPICS, *topics.AV_CARRIER_TOPICS, *suite_topics(av_suite, AV))
    return tuple(topic for topic in of_episode if topic.recorded)


def carriers_of(episode: EpisodeDescription) -> tuple[tuple[Carrier, int, SensorSuite], ...]:
    """The carriers of an episode, with actor id and suite each; InputError for a suite that cannot be loaded."""
    emv = (EMV, episode.emv_ids[0], load_suite(episode.sensor_suite, episode.files))
    if episode.av_id == NO_ACTOR:
        return (emv,)
    return emv, (AV, episode.av_id, load_suite(episode.av_sensor_suite, episode.files))


def topics_of(episode: EpisodeDescription) -> tuple[Topic, ...]:
    """All recorded topics of an episode; raises InputError as ``carriers_of``."""
    recorded = recorded_topics(*(suite for _, _, suite in carriers_of(episode)))
    if episode.detector:
        recorded = (*recorded, topics.DETECTIONS)
    if episode.predictor:
        recorded = (*recorded, replace(topics.PREDICTIONS, publisher=episode.predictor))
    return recorded
