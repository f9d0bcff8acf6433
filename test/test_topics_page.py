"""docs/topics.md against the table that the nodes read."""

import re

from rclpy.qos import DurabilityPolicy
from repository import REPOSITORY

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.sensor_messages.sensor_topics import SENSOR_MESSAGES
from siren_ros.running.ros.transport.endpoints import REPORT_DEPTH, STREAM_DEPTH, qos_of

PAGE = (REPOSITORY / "docs" / "topics.md").read_text(encoding="utf-8")
ROWS = {
    cells[0].strip("`"): cells[1:]
    for line in PAGE.splitlines()
    if line.startswith("|`/") and len(cells := [cell.strip() for cell in line.strip("|").split("|")]) == 6
}
TABLE = {
    topic.name.replace("{sensor}", "SENSOR"): topic
    for topic in (
        *(value for value in vars(topics).values() if isinstance(value, Topic)),
        *topics.AV_CARRIER_TOPICS,
        *(entry.topic for entry in SENSOR_MESSAGES.values()),
    )
}


def test_the_page_has_every_topic_and_no_other() -> None:
    assert set(ROWS) == set(TABLE)


def test_the_page_says_the_quality_of_service() -> None:
    assert qos_of(topics.MAP).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert qos_of(topics.MAP).depth == 1
    assert re.search(r"\|once\|transient local.*\|the last message\|", PAGE)
    assert qos_of(topics.ACTORS).durability == DurabilityPolicy.VOLATILE
    assert f"|any other|volatile|the last {STREAM_DEPTH} messages|" in PAGE
    assert f"|`{topics.STEP_DONE.name}`|volatile|the last {REPORT_DEPTH} messages|" in PAGE
