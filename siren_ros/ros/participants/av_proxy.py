"""Takes part in the lockstep for the AV's controller, which does not know the lockstep's protocol."""

from collections.abc import Callable

from rclpy.node import Node

from siren_ros.errors import SirenError
from siren_ros.interfaces import topics
from siren_ros.interfaces.lockstep_reports import Phase, StepReport
from siren_ros.interfaces.programs.av_control import from_av_control
from siren_ros.ros.transport import wire
from siren_ros.ros.transport.endpoints import create_input
from siren_ros.ros.transport.publisher_watch import PublisherWatch
from siren_ros.world.commands import AV_SOURCE


class AvProxy:
    """Reports for the controller: ready when its publisher is there, a step done when its control command is."""

    def __init__(
        self,
        node: Node,
        report: Callable[[StepReport], None],
        depart: Callable[[frozenset[str], str], None],
        fail: Callable[[str], None],
    ) -> None:
        """Listen to the controller.

        Args:
            node: The master's node.
            report: Takes the reports.
            depart: Learns that the controller is gone, and what shows it.
            fail: Ends the episode because somebody else publishes too.
        """
        self._node = node
        self._report = report
        self._depart = depart
        self._ready = False
        self.publishers = PublisherWatch(node, topics.AV_CONTROL, fail)
        self.publishers.on_left = self.watch
        create_input(node, topics.AV_CONTROL, self._on_control, self.publishers)

    @property
    def called(self) -> str:
        """The controller with the name of its node, where that is known."""
        publishers = self._node.get_publishers_info_by_topic(topics.AV_CONTROL.name)
        names = sorted({publisher.node_name for publisher in publishers})
        return f"{AV_SOURCE} (node {', '.join(names)})" if names else AV_SOURCE

    def watch(self) -> None:
        """Look whether the controller is there."""
        there = bool(self._node.count_publishers(topics.AV_CONTROL.name))
        if there and not self._ready:
            self._report(StepReport(0, AV_SOURCE, Phase.READY))
        elif self._ready and not there:
            self._depart(frozenset({AV_SOURCE}), f"its publisher of {topics.AV_CONTROL.name} is gone")
        self._ready = there

    def bind(self) -> None:
        """From now on it is the only one."""
        self.publishers.bind()

    def close(self, steps: int) -> None:
        """The controller has nothing to close."""
        self._report(StepReport(max(steps - 1, 0), AV_SOURCE, Phase.FINAL))

    def _on_control(self, cdr: bytes) -> None:
        try:
            control = from_av_control(wire.decode(topics.AV_CONTROL, cdr))
            control.check()
        except SirenError as error:
            self._report(StepReport(0, AV_SOURCE, Phase.STEP, f"{topics.AV_CONTROL.name}: {error}"))
            return
        self._report(StepReport(control.step, AV_SOURCE, Phase.STEP))
