"""Topics of a suite, and all topics of an episode in the order in which a step is recorded."""

from dataclasses import replace

from siren_ros.interfaces import topics
from siren_ros.interfaces.topics import Topic
from siren_ros.scenario.episode import EpisodeDescription
from siren_ros.sensor_messages.carrier import AV, EMV, Carrier
from siren_ros.sensors.suite.suite import EXPORTED_CAMERA, CameraSpec, SensorSuite, load_suite, period_steps
from siren_ros.world.actors import NO_ACTOR


def suite_topics(suite: SensorSuite, carrier: Carrier = EMV) -> tuple[Topic, ...]:
    """Topics of a suite's sensors, including images that are not recorded."""
    first = min((lidar.name for lidar in suite.lidars), default="")
    found = []
    for lidar in suite.lidars:
        topic = topics.LIDAR.of_sensor(lidar.name, period_steps(lidar.rate_hz))
        found.append(topic if lidar.name == first else topic.if_recorded(True))
    for camera in suite.cameras:
        period = period_steps(camera.rate_hz)
        found.extend(topic.of_sensor(camera.name, period) for topic in camera_topics(camera, suite))
    found.extend(topics.GNSS.of_sensor(one.name, period_steps(one.rate_hz)) for one in suite.gnss)
    found.extend(topics.IMU.of_sensor(one.name, period_steps(one.rate_hz)) for one in suite.imus)
    found.extend(topics.AUDIO.of_sensor(microphone.name, topics.EVERY_STEP) for microphone in suite.microphones)
    return tuple(topic.of_carrier(carrier.name) for topic in found)


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
    """All topics of an episode's bag; within a step they are stored in this order.

    Args:
        suite: Sensors of the first emergency vehicle.
        av_suite: Sensors of the AV under test; None in episodes without one.
    """
    every = (*topics.CORE_TOPICS, *topics.CARRIER_TOPICS, *suite_topics(suite))
    if av_suite is not None:
        every = (*every, *topics.AV_TOPICS, *topics.AV_CARRIER_TOPICS, *suite_topics(av_suite, AV))
    return tuple(topic for topic in every if topic.recorded)


def carriers_of(episode: EpisodeDescription) -> tuple[tuple[Carrier, int, SensorSuite], ...]:
    """The carriers of an episode: each with its actor id and its suite.

    Raises:
        InputError: A suite that cannot be loaded.
    """
    emv = (EMV, episode.emv_ids[0], load_suite(episode.sensor_suite, episode.files))
    if episode.av_id == NO_ACTOR:
        return (emv,)
    return emv, (AV, episode.av_id, load_suite(episode.av_sensor_suite, episode.files))


def topics_of(episode: EpisodeDescription) -> tuple[Topic, ...]:
    """All recorded topics of an episode; raises InputError as ``carriers_of``."""
    found = recorded_topics(*(suite for _, _, suite in carriers_of(episode)))
    if episode.detector:
        found = (*found, topics.DETECTIONS)
    if episode.predictor:
        found = (*found, replace(topics.PREDICTIONS, publisher=episode.predictor))
    return found
