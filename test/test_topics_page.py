"""docs/topics.md against the table that the nodes read."""

import re
from dataclasses import replace

import pytest
from rclpy.qos import DurabilityPolicy
from repository import REPOSITORY

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.sensor_messages.sensor_topics import SENSOR_MESSAGES, camera_topics
from siren_ros.running.ros.transport.endpoints import REPORT_DEPTH, STREAM_DEPTH, qos_of
from siren_ros.sensing.suite import load_suite

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
PUBLISHERS = {
    topics.STEP_DONE.name: "every participant",
    topics.AV_CONTROL.name: "**your controller**",
    topics.PREDICTIONS.name: "**your predictor**",
}


def test_the_page_has_every_topic_and_no_other() -> None:
    assert set(ROWS) == set(TABLE)


@pytest.mark.parametrize("name", TABLE)
def test_a_row_says_what_the_table_says(name: str) -> None:
    topic = TABLE[name]
    content, type_name, publisher, rate, _ = ROWS[name]
    assert type_name.strip("`") == topic.type_name.replace("/msg/", "/")
    assert publisher == PUBLISHERS.get(name, f"`{topic.publisher}`")
    assert rate == ("once" if topic.latched else f"{20 // topic.period_steps} Hz")
    assert content


def test_the_page_says_what_the_bag_holds() -> None:
    suite = load_suite("full")
    camera = replace(suite.cameras[0], depth=False, semantic=False, instance=False)
    all_images = replace(camera, depth=True, semantic=True, instance=True)
    without = {topic.name for topic in camera_topics(camera, replace(suite, labels=False)) if topic.recorded}
    asked_for = {topic.name for topic in camera_topics(all_images, replace(suite, labels=True)) if topic.recorded}
    said = {name: cells[4] for name, cells in ROWS.items()}
    optional = {name.replace("{sensor}", "SENSOR") for name in asked_for - without}
    assert {name for name, words in said.items() if words == "if the suite says so"} == optional
    assert {name for name, words in said.items() if words == "yes"} == {
        name for name, topic in TABLE.items() if topic.recorded
    } - optional


def test_the_page_says_the_quality_of_service() -> None:
    assert qos_of(topics.MAP).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert qos_of(topics.MAP).depth == 1
    assert re.search(r"\|once\|transient local.*\|the last message\|", PAGE)
    assert qos_of(topics.ACTORS).durability == DurabilityPolicy.VOLATILE
    assert f"|any other|volatile|the last {STREAM_DEPTH} messages|" in PAGE
    assert f"|`{topics.STEP_DONE.name}`|volatile|the last {REPORT_DEPTH} messages|" in PAGE
