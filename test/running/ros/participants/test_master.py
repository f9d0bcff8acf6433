from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import Phase, StepReport, to_av_control
from siren_ros.running.ros.participants.master import AvProxy
from siren_ros.simulation.world.commands import AV_SOURCE, AvControl


class Graph:
    """The part of a node that the proxy uses."""

    def __init__(self) -> None:
        self.publishers: list[str] = []
        self.hear: Callable[[bytes], None] = lambda _cdr: None

    def create_subscription(
        self, _type: Any, _name: str, callback: Callable[[bytes], None], *_qos: Any, raw: bool, event_callbacks: Any
    ) -> None:
        assert raw
        self.hear, self.matched = callback, event_callbacks.matched

    def count_publishers(self, name: str) -> int:
        assert name == topics.AV_CONTROL.name
        return len(self.publishers)

    def get_publishers_info_by_topic(self, _name: str) -> list[Any]:
        return [SimpleNamespace(node_name=name) for name in self.publishers]


@pytest.fixture(name="seen")
def _seen() -> SimpleNamespace:
    """A proxy with the graph that it sees, its reports, and what it has said."""
    graph, reports, said = Graph(), [], []
    proxy = AvProxy(graph, reports.append, lambda gone, what: said.append(f"{sorted(gone)}: {what}"), said.append)
    return SimpleNamespace(proxy=proxy, graph=graph, reports=reports, said=said)


def test_it_is_ready_once_when_somebody_publishes(seen: Any) -> None:
    seen.proxy.watch()
    assert (seen.reports, seen.proxy.called) == ([], AV_SOURCE)
    seen.graph.publishers = ["my_stack"]
    seen.proxy.watch()
    seen.proxy.watch()
    assert seen.reports == [StepReport(0, AV_SOURCE, Phase.READY)]
    assert seen.proxy.called == f"{AV_SOURCE} (node my_stack)"


def test_an_answer_is_the_report_of_its_step(seen: Any) -> None:
    seen.graph.publishers = ["my_stack"]
    seen.graph.hear(wire.encode(topics.AV_CONTROL, to_av_control(AvControl(7, 0.5))))
    seen.proxy.close(9)
    assert seen.reports == [StepReport(7, AV_SOURCE, Phase.STEP), StepReport(8, AV_SOURCE, Phase.FINAL)]


@pytest.mark.parametrize(
    ("cdr", "named"),
    [
        (wire.encode(topics.AV_CONTROL, to_av_control(AvControl(7, float("nan")))), "throttle nan"),
        (b"\x00\x01\x00\x00nonsense", "a message of 12 bytes"),
    ],
)
def test_what_cannot_be_used_is_an_error(seen: Any, cdr: bytes, named: str) -> None:
    assert seen.proxy.called == AV_SOURCE
    seen.graph.hear(cdr)
    (report,) = seen.reports
    assert report.error.startswith(topics.AV_CONTROL.name)
    assert named in report.error


def test_a_controller_that_leaves_has_departed_and_may_come_again(seen: Any) -> None:
    for _ in range(2):
        seen.graph.publishers = ["my_stack"]
        seen.proxy.watch()
        seen.graph.publishers = []
        seen.proxy.watch()
        seen.proxy.watch()
    assert seen.reports == [StepReport(0, AV_SOURCE, Phase.READY)] * 2
    assert seen.said == ["['av_controller']: its publisher of /av/control_cmd is gone"] * 2


def test_a_second_controller_is_refused_once_the_episode_has_begun(seen: Any) -> None:
    def matched(total: int, current: int) -> None:
        seen.graph.matched(SimpleNamespace(total_count=total, current_count=current))

    seen.graph.publishers = ["my_stack"]
    matched(1, 1)
    seen.graph.publishers = []
    matched(1, 0)
    seen.graph.publishers = ["my_stack"]
    matched(2, 1)
    seen.proxy.publishers.bind()
    assert not seen.said
    seen.graph.publishers = ["my_stack", "other"]
    matched(3, 2)
    (text,) = seen.said
    assert "/av/control_cmd: 1 publisher that this episode does not know (node other)" in text
