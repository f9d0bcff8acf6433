"""A publisher that a run does not know is noticed by the subscription that it reaches."""

import time
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import pytest
import rclpy
from dds_domains import own_domain
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node

from siren_ros.data.interfaces.topics import ACTORS, AV_CONTROL, EPISODE, STEP_DONE, Topic
from siren_ros.running.ros.transport.direct import direct
from siren_ros.running.ros.transport.endpoints import PublisherWatch, create_input, create_output

PATIENCE_S = 20.0
QUIET_S = 0.3


@cache
def _domain() -> int:
    """One for all tests here: a test ends its nodes before the next one begins."""
    return own_domain()


class Graph:
    """Nodes of several programs in one process, each with its own DDS participant."""

    def __init__(self) -> None:
        self.domain = _domain()
        self.contexts: dict[str, Context] = {}
        self.nodes: dict[str, Node] = {}
        self.told: list[str] = []
        self.left = 0
        self.listener = self.node("listener")
        self.executor = EventsExecutor(context=self.contexts["listener"])
        self.executor.add_node(self.listener)

    def node(self, name: str) -> Node:
        context = self.contexts[name] = Context()
        rclpy.init(context=context, domain_id=self.domain)
        self.nodes[name] = Node(name, context=context)
        return self.nodes[name]

    def publish_on(self, topic: Topic, name: str) -> Any:
        return create_output(self.nodes.get(name) or self.node(name), topic)

    def end(self, name: str) -> None:
        self.nodes.pop(name).destroy_node()
        rclpy.shutdown(context=self.contexts.pop(name))

    def watch(self, topic: Topic, **known: Any) -> PublisherWatch:
        watch = PublisherWatch(self.listener, topic, self.told.append, **known)
        watch.on_left = self._on_left
        create_input(self.listener, topic, lambda _cdr: None, watch)
        return watch

    def _on_left(self) -> None:
        self.left += 1

    def spin_until(self, condition: Callable[[], object], limit_s: float = PATIENCE_S) -> None:
        until_s = time.monotonic() + limit_s
        while not condition() and time.monotonic() < until_s:
            self.executor.spin_once(timeout_sec=0.02)

    @property
    def text(self) -> str:
        """The one text that is told, once it is there."""
        self.spin_until(lambda: self.told)
        (text,) = self.told
        return text

    def meets(self, publisher: Any) -> None:
        """Until a publisher and the listener know each other, and a little longer."""
        self.spin_until(publisher.get_subscription_count)
        assert publisher.get_subscription_count()
        self.spin_until(lambda: False, QUIET_S)


@pytest.fixture(name="graph")
def _graph() -> Iterator[Graph]:
    graph = Graph()
    yield graph
    graph.executor.shutdown()
    for name in tuple(graph.nodes):
        graph.end(name)


def test_a_second_publisher_is_named(graph: Graph) -> None:
    graph.watch(EPISODE)
    graph.meets(graph.publish_on(EPISODE, "sumo_bridge"))
    assert graph.told == []
    graph.meets(graph.publish_on(EPISODE, "stranger"))
    assert graph.text.startswith("/siren/episode: 1 publisher that this episode does not know (node stranger)")
    assert "ROS_DOMAIN_ID" in graph.text


def test_one_that_takes_the_name_of_ours_is_counted(graph: Graph) -> None:
    graph.watch(EPISODE)
    graph.meets(graph.publish_on(EPISODE, "sumo_bridge"))
    graph.meets(graph.publish_on(EPISODE, "sumo_bridge"))
    assert "(node sumo_bridge)" in graph.text


def test_one_that_came_and_left_before_ours_is_counted_too(graph: Graph) -> None:
    graph.watch(EPISODE)
    graph.meets(graph.publish_on(EPISODE, "stranger"))
    graph.end("stranger")
    graph.spin_until(lambda: graph.left)
    assert graph.told == []
    graph.meets(graph.publish_on(EPISODE, "sumo_bridge"))
    assert "1 publisher that" in graph.text


def test_another_programs_publisher_may_come_twice_until_it_is_bound(graph: Graph) -> None:
    watch = graph.watch(AV_CONTROL)
    for _ in range(2):
        graph.meets(graph.publish_on(AV_CONTROL, "av_policy"))
        graph.end("av_policy")
    graph.spin_until(lambda: graph.left == 2)
    graph.meets(graph.publish_on(AV_CONTROL, "av_policy"))
    watch.bind()
    assert graph.told == []
    graph.meets(graph.publish_on(AV_CONTROL, "stranger"))
    assert "(node stranger)" in graph.text


def test_one_that_is_met_after_the_watch_was_bound_is_the_one_that_is_known(graph: Graph) -> None:
    watch = graph.watch(AV_CONTROL)
    watch.bind()
    graph.meets(graph.publish_on(AV_CONTROL, "av_policy"))
    assert graph.told == []
    graph.meets(graph.publish_on(AV_CONTROL, "stranger"))
    assert graph.text


def test_two_of_other_programs_are_one_too_many_when_they_are_bound(graph: Graph) -> None:
    watch = graph.watch(AV_CONTROL)
    for name in ("av_policy", "stranger"):
        graph.meets(graph.publish_on(AV_CONTROL, name))
    assert graph.told == []
    watch.bind()
    assert "(node av_policy, node stranger)" in graph.text


def test_each_participant_has_one_publisher_of_reports_and_one_that_is_gone_is_known(graph: Graph) -> None:
    watch = graph.watch(STEP_DONE, nodes=("recorder",), others=1)
    for name in ("recorder", "my_stack"):
        graph.meets(graph.publish_on(STEP_DONE, name))
    watch.bind()
    assert graph.told == []
    assert watch.departed() == frozenset()
    graph.end("my_stack")
    graph.spin_until(lambda: graph.left)
    assert (graph.left, watch.departed(), graph.told) == (1, {"my_stack"}, [])
    graph.meets(graph.publish_on(STEP_DONE, "my_stack"))
    assert graph.text, "it is bound: a second one under its name is not it"


def test_a_new_listener_gets_all_that_is_published_after_it_was_met(graph: Graph) -> None:
    """Before that the nodes of the process hand messages to one another; theirs lacks none and gets none twice."""
    here: list[bytes] = []
    there: list[bytes] = []
    output = graph.publish_on(ACTORS, "listener")
    create_input(graph.listener, ACTORS, here.append)
    graph.meets(output)
    direct.start(graph.executor, [graph.listener])
    sent: list[bytes] = []

    def publish() -> None:
        sent.append(b"\0\1\0\0" + len(sent).to_bytes(4, "little"))
        output.publish(sent[-1])
        graph.spin_until(lambda: len(here) == len(sent))

    try:
        for _ in range(3):
            publish()
        recorder = graph.node("recorder")
        executor = EventsExecutor(context=graph.contexts["recorder"])
        executor.add_node(recorder)
        create_input(recorder, ACTORS, there.append)
        graph.spin_until(lambda: output.get_subscription_count() == 2)
        for _ in range(3):
            publish()
        until_s = time.monotonic() + PATIENCE_S
        while len(there) < 3 and time.monotonic() < until_s:
            executor.spin_once(timeout_sec=0.02)
        executor.shutdown()
    finally:
        direct.stop()
    assert here == sent
    assert there == sent[3:]
