"""The lockstep's master: publishes the clock, collects StepDone, ends the episode.

For the AV's controller, which does not know the lockstep's protocol, a proxy takes part.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Final

from rclpy.node import Node

from siren_ros.base.numerics.units import STEP_S, time_ns_of_step
from siren_ros.data import lockstep
from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import (
    EpisodeClosing,
    Phase,
    StepReport,
    from_av_control,
    from_step_done,
    to_episode_end,
)
from siren_ros.data.interfaces.messages import make_message, stamp
from siren_ros.data.lockstep import BeginStep, EndEpisode, LockstepConfig, LockstepState, Stage
from siren_ros.errors import SirenError, shown_text
from siren_ros.running.ros.participants.watchdog import ANNOUNCE_S, working_s
from siren_ros.running.ros.transport.endpoints import PublisherWatch, create_input, create_output, create_wall_timer
from siren_ros.simulation.scenario.episode import EpisodeEnd
from siren_ros.simulation.world.commands import AV_SOURCE

_NAMELESS: Final = "_NODE_NAME_UNKNOWN_"
"""ROS's name of a node whose publisher is known before its name, or that has none, such as a program without ROS."""
_NAME_WATCHES: Final = 20
"""Watches, 0.1 s apart, after which a controller without a name is ready, too."""


class AvProxy:
    """Reports for the AV's controller: ready when its publisher exists, a step done when its command arrives."""

    def __init__(
        self,
        node: Node,
        report: Callable[[StepReport], None],
        depart: Callable[[frozenset[str], str], None],
        fail: Callable[[str], None],
    ) -> None:
        """Subscribe to the controller.

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
        self._watched_nameless = 0
        self.publishers = PublisherWatch(node, topics.AV_CONTROL, fail)
        self.publishers.on_left = self.watch
        create_input(node, topics.AV_CONTROL, self._on_control, self.publishers)

    @property
    def called(self) -> str:
        """Text that names the controller, with the name of its node if known."""
        names = ", ".join(sorted(self._names() - {_NAMELESS}))
        return f"{AV_SOURCE} (node {names})" if names else AV_SOURCE

    def _names(self) -> set[str]:
        return {info.node_name for info in self._node.get_publishers_info_by_topic(topics.AV_CONTROL.name)}

    def watch(self) -> None:
        """Check whether the controller is present; it is ready when its name is known, so that errors can give it."""
        there = bool(self._node.count_publishers(topics.AV_CONTROL.name))
        if there and not self._ready and _NAMELESS in self._names() and self._watched_nameless < _NAME_WATCHES:
            self._watched_nameless += 1
            return
        if there and not self._ready:
            self._report(StepReport(0, AV_SOURCE, Phase.READY))
        elif self._ready and not there:
            self._depart(frozenset({AV_SOURCE}), f"its publisher of {topics.AV_CONTROL.name} is gone")
        self._ready = there

    def close(self, steps: int) -> None:
        """Do nothing, because the controller has nothing to close."""
        self._report(StepReport(max(steps - 1, 0), AV_SOURCE, Phase.FINAL))

    def _on_control(self, cdr: bytes) -> None:
        try:
            control = from_av_control(wire.decode(topics.AV_CONTROL, cdr))
            control.check()
        except SirenError as error:
            self._report(StepReport(0, AV_SOURCE, Phase.STEP, f"{topics.AV_CONTROL.name}: {error}"))
            return
        self._report(StepReport(control.step, AV_SOURCE, Phase.STEP))


WATCH_S = 0.1
HEARD_S: Final = 3.0 * ANNOUNCE_S
_TELL_THE_AV: Final = frozenset({"vehicle_dynamics", "sensor_sim"})
"""Participants through which the AV's controller receives the data of a step."""


class LockstepMaster:
    """Controls one episode through publishers and subscriptions of a node."""

    def __init__(self, node: Node, config: LockstepConfig, realtime_factor: float = 0.0, settle_s: float = 0.0) -> None:
        """Create the publishers and subscriptions of the lockstep.

        Args:
            node: The node that speaks for the master.
            config: Participants, steps and time limits.
            realtime_factor: Simulated seconds per wall second at most; 0 for no limit.
            settle_s: Wall time between the last report READY and the first step. Our own nodes report READY when
                their subscribers are connected; other programs may report it earlier, and need this time.
        """
        self.config = config
        self.state: LockstepState = lockstep.start_lockstep(config, working_s())
        self.on_step_begun: Callable[[int], None] = lambda _step: None
        self.on_ending: Callable[[], None] = lambda: None
        """Called before everybody is told that the episode is over."""
        self.on_closed: Callable[[], None] = lambda: None
        """Called when the episode is ``closed``; may be called again."""
        self._pace_s = STEP_S / realtime_factor if realtime_factor > 0 else 0.0
        self._settle_s = settle_s
        self._next_wall_s = 0.0
        self._clock = create_output(node, topics.CLOCK)
        self._end = create_output(node, topics.EPISODE_END)
        nodes = [name for name in config.participants if name not in config.outside]
        outside = [name for name in config.outside if name != AV_SOURCE]
        self._reporters = PublisherWatch(node, topics.STEP_DONE, self.fail, nodes, len(outside))
        self._reporters.on_left = self._on_reporter_left
        create_input(node, topics.STEP_DONE, self._on_report, self._reporters)
        create_wall_timer(node, WATCH_S, self._on_watch)
        self._pacer = create_wall_timer(node, 0.001, self._on_pace) if self._pace_s or settle_s else None
        self._held: BeginStep | None = None
        self.answer_s: list[float] = []
        """Wall time from the states of each step to the answer of the AV's controller."""
        self._told_s = 0.0
        self._compiling_s = -HEARD_S
        self._av_proxy = (
            AvProxy(node, self._take, self._take_departure, self.fail) if AV_SOURCE in config.participants else None
        )

    def begin(self) -> None:
        """Start the time limits. Before that, this process prepares its participants one after the other."""
        if self.state.stage is Stage.GATHERING:
            self.state = self.state._replace(since_s=working_s())

    @property
    def closed(self) -> bool:
        """Whether the episode is over and every participant has closed or is no longer waited for."""
        return self.state.stage is Stage.CLOSED

    def interrupt(self, reason: str) -> None:
        """End the episode at the user's request."""
        self._advance(lockstep.on_interrupt(self.state, self.config, working_s(), reason))

    def fail(self, reason: str, gone: Iterable[str] = ()) -> None:
        """End the episode for a reason outside all reports; ``gone`` are participants that have ended."""
        self._advance(lockstep.on_failure(self.state, self.config, working_s(), reason, frozenset(gone)))

    def learn_closed(self, names: Iterable[str]) -> None:
        """Note participants that were seen to close; in a failed episode the master does not wait for their reports."""
        self.state = lockstep.on_closed(self.state, frozenset(names))

    @contextmanager
    def failing_on_error(self) -> Iterator[None]:
        """Context in which an unreadable message ends the episode, as in participants."""
        try:
            yield
        except SirenError as error:
            self.fail(str(error))

    def _on_reporter_left(self) -> None:
        """Handle the end of another program without a report; processes of our own nodes are watched elsewhere."""
        left = self._reporters.departed()
        outside = {name for name in self.config.outside if name != AV_SOURCE}
        gone = frozenset(outside & left or (outside if left - set(self.config.participants) else ()))
        if gone:
            self._take_departure(gone, f"its publisher of {topics.STEP_DONE.name} is gone")

    def _take_departure(self, gone: frozenset[str], what: str) -> None:
        names = ", ".join(self.config.display_names.get(name, name) for name in sorted(gone))
        self._advance(lockstep.on_departure(self.state, self.config, working_s(), gone, f"{names}: {what}"))

    def _on_report(self, cdr: bytes) -> None:
        with self.failing_on_error():
            report = wire.content(from_step_done, wire.decode(topics.STEP_DONE, cdr))
            name, error = shown_text(report.participant), shown_text(report.error)
            if (name, error) != (report.participant, report.error):
                report = replace(report, participant=name, error=error)
            self._take(report)

    @property
    def hears_of_compiling(self) -> bool:
        """Whether a participant in another process is compiling loops."""
        return time.monotonic() - self._compiling_s < HEARD_S

    def _take(self, report: StepReport) -> None:
        if report.phase is Phase.COMPILING:
            self._compiling_s = time.monotonic()
        if report.phase is Phase.STEP:
            report = self._timed(report)
        state, action = lockstep.on_report(self.state, report, self.config, working_s())
        ends = isinstance(action, EndEpisode) and action.end is EpisodeEnd.FAILED
        proxy = self._av_proxy if report.participant == AV_SOURCE else None
        publishers = self._reporters if proxy is None else proxy.publishers
        if ends and (stranger := publishers.stranger()):
            self.fail(stranger)
        else:
            self._advance((state, action))

    def _timed(self, report: StepReport) -> StepReport:
        """The report; for the AV's controller, with its answer time."""
        now_s = time.monotonic()
        if report.participant in _TELL_THE_AV:
            self._told_s = now_s
        if report.participant != AV_SOURCE or report.error:
            return report
        self.answer_s.append(now_s - self._told_s)
        return replace(report, busy_s=self.answer_s[-1])

    def _on_watch(self) -> None:
        if self._av_proxy is not None:
            if self.state.stage is Stage.GATHERING:
                self.config = replace(self.config, display_names={AV_SOURCE: self._av_proxy.called})
            self._av_proxy.watch()
        self._advance(lockstep.on_time(self.state, self.config, working_s(), self._absent))

    def _absent(self) -> frozenset[str]:
        """Participants of the platform without a publisher of reports."""
        return frozenset(self.config.participants) - frozenset(self.config.outside) - self._reporters.present()

    def _on_pace(self) -> None:
        if self._held is not None and time.monotonic() >= self._next_wall_s:
            action, self._held = self._held, None
            self._begin(action)
            if self._pacer is not None and not self._pace_s:
                self._pacer.cancel()

    def _advance(self, result: tuple[LockstepState, lockstep.Action]) -> None:
        self.state, action = result
        if self.closed:
            self.on_closed()
        if isinstance(action, BeginStep):
            if action.step == 0:
                self._next_wall_s = time.monotonic() + self._settle_s
            if time.monotonic() < self._next_wall_s:
                self._held = action
            else:
                self._begin(action)
        elif isinstance(action, EndEpisode):
            self._held = None
            self.on_ending()
            closing = EpisodeClosing(action.steps, action.end, action.reason)
            self._end.publish(wire.encode(topics.EPISODE_END, to_episode_end(closing)))
            if self._av_proxy is not None:
                self._av_proxy.close(action.steps)

    def _begin(self, action: BeginStep) -> None:
        if action.step == 0:  # from now on no further program may report or drive
            self._reporters.bind()
            if self._av_proxy is not None:
                self._av_proxy.publishers.bind()
            if self.state.stage is not Stage.STEPPING:
                return
        self._told_s = time.monotonic()
        self._next_wall_s = max(self._next_wall_s + self._pace_s, self._told_s - self._pace_s)
        self.on_step_begun(action.step)
        clock = make_message(topics.CLOCK.type_name, clock=stamp(time_ns_of_step(action.step)))
        self._clock.publish(wire.encode(topics.CLOCK, clock))
