"""Publishers that a run does not know, messages within a process, and steps that are copied for programs that watch."""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from dds_domains import own_domain
from hypothesis import given
from hypothesis import strategies as st
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces.topics import ACTORS, AV_CONTROL, EPISODE, EVENTS, STEP_DONE, TRAFFIC, Topic
from siren_ros.running.ros.transport.endpoints import (
    AT_ONCE,
    EARLY_PERIODS,
    PERIOD_S,
    DirectDelivery,
    PublisherWatch,
    StepCopies,
    create_input,
    create_output,
    direct,
    happens,
)

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


@pytest.mark.parametrize("second", ["stranger", "sumo_bridge"])
def test_a_second_publisher_is_named_also_under_the_name_of_ours(graph: Graph, second: str) -> None:
    graph.watch(EPISODE)
    graph.meets(graph.publish_on(EPISODE, "sumo_bridge"))
    assert graph.told == []
    graph.meets(graph.publish_on(EPISODE, second))
    assert graph.text.startswith(f"/siren/episode: 1 publisher that this episode does not know (node {second})")
    assert "ROS_DOMAIN_ID" in graph.text


def test_one_that_came_and_left_before_ours_is_counted_too(graph: Graph) -> None:
    graph.watch(EPISODE)
    graph.meets(graph.publish_on(EPISODE, "stranger"))
    graph.spin_until(lambda: graph.listener.count_publishers(EPISODE.name))  # discovery has two directions
    graph.spin_until(lambda: False, QUIET_S)
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


class Executor:
    """Runs tasks when it is told to."""

    def __init__(self) -> None:
        self.tasks: list[Callable[[], None]] = []

    def create_task(self, task: Callable[[], None]) -> None:
        self.tasks.append(task)

    def run_one(self) -> None:
        self.tasks.pop(0)()


class Process:
    """Two nodes that listen, on one executor."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, bytes]] = []
        self.executor = Executor()
        self.subscribers = 2
        self.direct = DirectDelivery()
        nodes: list[Any] = [SimpleNamespace(subscriptions=[self.listens(name)]) for name in ("a", "b")]
        nodes[0].subscriptions.append(SimpleNamespace(raw=False, topic_name="/of_objects", callback=None))
        self.direct.start(self.executor, nodes)

    def listens(self, name: str) -> Any:
        return SimpleNamespace(
            raw=True, topic_name=ACTORS.name, callback=lambda cdr: self.heard.append((name, cdr))
        )  # fmt: skip

    def count(self) -> int:
        return self.subscribers

    def publish(self, cdr: bytes, topic: str = ACTORS.name) -> bool:
        return self.direct.take(topic, cdr, self.count)


@pytest.fixture(name="process")
def _process() -> Process:
    return Process()


def test_every_subscriber_gets_the_bytes_in_order_and_not_within_publish(process: Process) -> None:
    assert process.publish(b"1")
    assert process.publish(b"2")
    assert process.heard == []
    process.executor.run_one()
    assert process.heard == [("a", b"1"), ("b", b"1"), ("a", b"2"), ("b", b"2")]
    assert process.executor.tasks == []


def test_dds_brings_what_nobody_here_takes_as_bytes(process: Process) -> None:
    assert not process.publish(b"1", "/of_objects")
    assert not process.publish(b"1", "/other")
    assert not process.publish(b"1", "")
    assert process.executor.tasks == []


def test_dds_brings_everything_while_another_program_listens(process: Process) -> None:
    taken = []
    for process.subscribers in (2, 3, 3, 2, 1, 2):
        taken.append(process.publish(b"1"))
    assert taken == [True, False, False, True, False, True]


def test_the_executor_has_its_turn_between_many_messages(process: Process) -> None:
    for number in range(AT_ONCE):
        process.publish(bytes([number]))
    assert len(process.executor.tasks) == 1
    process.executor.run_one()
    assert len(process.heard) == AT_ONCE
    assert len(process.executor.tasks) == 1
    process.executor.run_one()
    assert [cdr[0] for _, cdr in process.heard] == [number for number in range(AT_ONCE) for _ in range(2)]
    assert process.executor.tasks == []


def test_after_the_end_what_waits_is_still_handed_over(process: Process) -> None:
    process.publish(b"1")
    process.direct.stop()
    assert not process.publish(b"2")
    process.executor.run_one()
    assert process.heard == [("a", b"1"), ("b", b"1")]


def test_an_error_of_a_receiver_is_the_executors_and_the_others_get_theirs(process: Process) -> None:
    def fail(_cdr: bytes) -> None:
        raise ValueError("broken")

    broken: Any = SimpleNamespace(subscriptions=[SimpleNamespace(raw=True, topic_name=ACTORS.name, callback=fail)])
    well: Any = SimpleNamespace(subscriptions=[process.listens("c")])
    process.direct.start(process.executor, [broken, well])
    assert process.publish(b"1")
    with pytest.raises(ValueError, match="broken"):
        process.executor.run_one()
    process.executor.run_one()
    assert process.heard == [("c", b"1")]


def test_a_new_episode_begins_with_nothing_of_the_one_before(process: Process) -> None:
    process.publish(b"1")
    process.executor.tasks.clear()
    process.direct.start(process.executor, [])
    assert not process.publish(b"2")
    process.direct.start(process.executor, [SimpleNamespace(subscriptions=[process.listens(name)]) for name in "de"])  # type: ignore[misc]
    process.publish(b"3")
    process.executor.run_one()
    assert process.heard == [("d", b"3"), ("e", b"3")]


TOPICS = ("traffic", "actors", "events")
Sent = list[tuple[int, str]]


class Stream:
    """Steps of three topics that go through the choice."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.sent: Sent = []
        self.copies = StepCopies(clock_s=lambda: self.now_s)

    def step(self, number: int, happening: str = "") -> None:
        for topic in TOPICS:
            self.copies.take(number, topic == happening, lambda topic=topic: self.sent.append((number, topic)))

    def run(self, times_s: Sequence[float], happening: dict[int, str] | None = None) -> list[int]:
        """The steps that are copied, each of them whole."""
        for number, self.now_s in enumerate(times_s):
            self.step(number, (happening or {}).get(number, ""))
        steps = [number for number, _ in self.sent[:: len(TOPICS)]]
        assert self.sent == [(number, topic) for number in steps for topic in TOPICS]
        return steps


def test_a_fast_episode_has_a_copied_step_every_period() -> None:
    """At twelve times real time and 240 steps a second."""
    times_s = np.arange(2400) * STEP_S / 12.0
    steps = Stream().run(times_s.tolist())
    apart_s = np.diff(times_s[steps])[EARLY_PERIODS + 1 :]
    assert apart_s == pytest.approx(PERIOD_S, abs=STEP_S / 12.0 + 1e-9)
    assert len(steps) == pytest.approx(times_s[-1] / PERIOD_S, abs=EARLY_PERIODS + 1)
    assert 1.0 / apart_s.max() >= 10.0


@pytest.mark.parametrize("pace", [1.0, 0.5])
def test_at_real_time_and_slower_all_steps_are_copied(pace: float) -> None:
    """Each step is up to 45 ms later than its time, and once the program halts for a second."""
    late_s = np.random.default_rng(0).uniform(0.0, 0.045, 400)
    times_s = np.arange(400) * STEP_S / pace + late_s
    times_s[200:] += 1.0
    times_s[200:203] = times_s[200]
    assert Stream().run(np.sort(times_s).tolist()) == list(range(400))


@pytest.mark.parametrize("topic", TOPICS)
def test_a_step_in_which_something_happens_is_copied_whole(topic: str) -> None:
    times_s = (np.arange(100) * 1e-3).tolist()
    assert 47 not in Stream().run(times_s)
    assert 47 in Stream().run(times_s, {47: topic})


def test_the_last_step_is_copied_once() -> None:
    stream = Stream()
    assert 99 not in stream.run((np.arange(100) * 1e-3).tolist())
    for _ in range(2):
        stream.copies.send_held()
    assert [number for number, _ in stream.sent].count(99) == len(TOPICS)
    assert stream.sent[-1] == (99, TOPICS[-1])


@given(
    st.lists(st.floats(0.0, 0.2), min_size=1, max_size=80),
    st.dictionaries(st.integers(0, 79), st.sampled_from(TOPICS)),
)
def test_whatever_the_times_nothing_that_happens_is_lost_and_order_stays(
    waits_s: list[float], happening: dict[int, str]
) -> None:
    steps = Stream().run(np.cumsum(waits_s).tolist(), happening)
    assert steps == sorted(set(steps))
    assert {number for number in happening if number < len(waits_s)} <= set(steps)


def traffic(spawned: tuple[int, ...] = (), signals: tuple[str, ...] = ("r",)) -> Any:
    return SimpleNamespace(spawned=spawned, signals=signals)


def test_events_new_actors_and_signals_that_change_are_happenings() -> None:
    assert happens(EVENTS.name, (3, 0, ("contact",)), (2, 0, ()))
    assert not happens(EVENTS.name, (3, 0, ()), (2, 0, ("contact",)))
    assert happens(TRAFFIC.name, traffic(), None)
    assert happens(TRAFFIC.name, traffic(spawned=(7,)), traffic())
    assert happens(TRAFFIC.name, traffic(signals=("g",)), traffic())
    assert not happens(TRAFFIC.name, traffic(), traffic(spawned=(7,)))
    assert not happens(ACTORS.name, None, None)
