"""The topics that a suite brings, and all topics of an episode in the order in which a step is recorded."""

from siren_ros.interfaces import topics
from siren_ros.interfaces.topics import Topic
from siren_ros.sensors.suite import SensorSuite, period_steps

CARRIER_TOPICS = (topics.TF_STATIC, topics.TF, topics.ODOMETRY, topics.GROUND_TRUTH, topics.BOXES, topics.MARKERS)
"""What ``sensor_sim`` publishes with any suite, also an empty one."""


def suite_topics(suite: SensorSuite) -> tuple[Topic, ...]:
    """Topics of the sensors of a suite, images that nobody records included."""
    found: list[Topic] = []
    for lidar in suite.lidars:
        found.append(topics.LIDAR.of_sensor(lidar.name, period_steps(lidar.rate_hz)))
    for camera in suite.cameras:
        period = period_steps(camera.rate_hz)
        images = (topics.IMAGE_COMPRESSED, topics.CAMERA_INFO, topics.IMAGE)
        found.extend(topic.of_sensor(camera.name, period) for topic in images)
    return tuple(found)


def recorded_topics(suite: SensorSuite) -> tuple[Topic, ...]:
    """All topics of an episode's bag; within a step they are stored in this order."""
    every = (*topics.CORE_TOPICS, *CARRIER_TOPICS, *suite_topics(suite))
    return tuple(topic for topic in every if topic.recorded)
