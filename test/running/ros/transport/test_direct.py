"""Messages go from node to node while only nodes of the process listen; the executor keeps its turn."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from siren_ros.data.interfaces.topics import ACTORS
from siren_ros.running.ros.transport.direct import AT_ONCE, DirectDelivery


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
