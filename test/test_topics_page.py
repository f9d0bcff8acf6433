"""What docs/topics.md and docs/av_programs.md say of topics and stamps, against the table that the nodes read."""

import re
from types import SimpleNamespace

import pytest
from rclpy.qos import DurabilityPolicy
from repository import REPOSITORY

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.sensor_messages.sensor_topics import SENSOR_MESSAGES
from siren_ros.running.ros.transport.endpoints import REPORT_DEPTH, STREAM_DEPTH, qos_of

PAGE, AV_PAGE = ((REPOSITORY / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("topics", "av_programs"))
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


@pytest.mark.parametrize("step", [0, 1, 19, 20, 21, 799, 71_999])
def test_the_step_follows_from_the_stamp_as_the_page_says(step: int) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", AV_PAGE, re.DOTALL)
    names: dict[str, object] = {}
    exec(code, names)  # noqa: S102 - the page's own function
    sec, nanosec = divmod(time_ns_of_step(step), 1_000_000_000)
    assert names["step_of"](SimpleNamespace(sec=sec, nanosec=nanosec)) == step  # type: ignore[operator] # a function


def test_the_topics_that_need_transient_local_are_the_latched_ones() -> None:
    (row,) = [line for line in AV_PAGE.splitlines() if "transient local" in line and line.startswith("|")]
    named = set(re.findall(r"`(/[a-z_/]+)`", row))
    latched = (topics.AV_ROUTE, topics.EPISODE, topics.MAP, topics.EPISODE_END, topics.TF_STATIC)
    assert named == {topic.name for topic in latched}
    assert all(topic.latched for topic in latched)
    assert not topics.AV_CONTROL.latched
