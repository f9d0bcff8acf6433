"""Decides the lockstep, without ROS: who has reported, when the next step begins, who is late.

Step k + 1 begins when every participant has reported step k. Nothing in the loop depends on trailing participants, so
their reports of step k − 1 suffice. The state machine is pure: reports and the wall time go in, actions come out.
A node's inputs are joined by step, so that the order of arrival cannot change what it computes.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from siren_ros.data.interfaces.conversions import Phase, StepReport
from siren_ros.data.interfaces.topics import EPISODE_END, STEP_DONE, Topic, upstream_of
from siren_ros.errors import EpisodeError
from siren_ros.simulation.scenario.episode import EpisodeEnd

STEP_TIMEOUT_S: Final = 20.0
"""Wall time for one step of a participant."""
START_TIMEOUT_S: Final = 120.0
"""Wall time until a participant is ready for the first step."""


class Stage(Enum):
    """Stage of an episode's run."""

    GATHERING = "gathering"
    STEPPING = "stepping"
    CLOSING = "closing"
    CLOSED = "closed"


@dataclass(frozen=True)
class LockstepConfig:
    """Participants, number of steps, and time limits (wall time) of an episode."""

    participants: tuple[str, ...]
    steps: int
    step_timeout_s: float = STEP_TIMEOUT_S
    start_timeout_s: float = START_TIMEOUT_S
    close_timeout_s: float = 60.0
    late_close_timeout_s: float = 2.0
    """Time limit to close for participants whose lateness ended the episode."""
    trailing: frozenset[str] = frozenset()
    """Participants that may still work on a step while the next one runs."""
    outside: tuple[str, ...] = ()
    """Participants that run in other programs."""
    display_names: Mapping[str, str] = field(default_factory=dict)
    """Names for errors, for participants whose own name does not tell which program they are."""

    def step_limit_s(self, step: int) -> float:
        """Wall time allowed for a step. At the first step programs may still compile code, as during their start."""
        return self.step_timeout_s if step else max(self.step_timeout_s, self.start_timeout_s)


class LockstepState(NamedTuple):
    """Progress of one episode. It is a tuple, because it changes with every report and a tuple is copied quickly."""

    stage: Stage = Stage.GATHERING
    step: int = -1
    """The current step; −1 before the first."""
    waiting: frozenset[str] = frozenset()
    owing: frozenset[str] = frozenset()
    """Trailing participants that have not yet reported the previous step."""
    since_s: float = 0.0
    """Wall time at which the current wait began."""
    end: EpisodeEnd = EpisodeEnd.COMPLETE
    reason: str = ""
    steps_closed: int = 0
    """Number of steps of the episode, known at its end."""
    late: frozenset[str] = frozenset()
    """Participants that had not reported when the episode ended; they may never answer."""
    busy_s: Mapping[str, float] = MappingProxyType({})
    """Wall time by participant, summed over the steps."""

    @property
    def late_step(self) -> int:
        """The earliest step that some participant has not finished."""
        return self.step - bool(self.owing)

    @property
    def steps_done(self) -> int:
        """Number of steps that every participant has finished."""
        if self.stage is Stage.GATHERING:
            return 0
        if self.stage is not Stage.STEPPING:
            return self.step + 1
        return self.step + 1 - bool(self.waiting) - bool(self.owing)


@dataclass(frozen=True)
class BeginStep:
    """Action: publish the clock of this step."""

    step: int


@dataclass(frozen=True)
class EndEpisode:
    """Action: tell all participants to close."""

    steps: int
    end: EpisodeEnd
    reason: str


Action = BeginStep | EndEpisode | None


def start_lockstep(config: LockstepConfig, now_s: float) -> LockstepState:
    """The state before any participant has reported."""
    return LockstepState(waiting=frozenset(config.participants), since_s=now_s)


def on_report(
    state: LockstepState, report: StepReport, config: LockstepConfig, now_s: float
) -> tuple[LockstepState, Action]:
    """Process one StepDone; returns the new state and what to do.

    A report that is not expected, such as a second one of the same step, ends the episode: one of the two came from
    another program. A COMPILING report restarts the participant's time limit.

    """
    if state.stage is Stage.CLOSED:
        return state, None
    if report.phase is Phase.COMPILING:
        awaited = state.stage is not Stage.CLOSING and report.participant in state.waiting | state.owing
        return state._replace(since_s=now_s) if awaited else state, None
    who = config.display_names.get(report.participant, report.participant)
    if state.stage is Stage.CLOSING:
        if report.phase is not Phase.FINAL or report.participant not in state.waiting:
            return state, None
    elif refusal := _refusal(state, report, config):
        return _close(state, EpisodeEnd.FAILED, f"{who}: {refusal}", config, now_s)
    owes = state.stage is Stage.STEPPING and report.participant in state.owing
    busy = {**state.busy_s, report.participant: state.busy_s.get(report.participant, 0.0) + report.busy_s}
    if owes:
        state = state._replace(owing=state.owing - {report.participant}, busy_s=busy)
    else:
        state = state._replace(waiting=state.waiting - {report.participant}, busy_s=busy)
    if report.error and not state.reason:
        state = state._replace(end=EpisodeEnd.FAILED, reason=f"{who}: {report.error}")
    return _all_reported(state, config, now_s) if _may_go_on(state, config) else (state, None)


def _refusal(state: LockstepState, report: StepReport, config: LockstepConfig) -> str:
    """Reason why a report must end the episode; empty if the lockstep expects the report."""
    if report.participant not in config.participants:
        return f"reports on {STEP_DONE.name}, but takes no part in this episode (parameter `external`)"
    if report.error:
        return report.error
    if report.phase is Phase.FINAL:
        return f"left the episode, which was not over; {EPISODE_END.name} came from another program"
    if report.phase is Phase.READY:
        unready = report.participant in state.waiting or report.participant in config.outside
        return "" if state.stage is Stage.GATHERING and unready else "reported twice that it is ready"
    return _step_refusal(state, report)


def _step_refusal(state: LockstepState, report: StepReport) -> str:
    owed = state.step - (report.participant in state.owing) + (report.participant not in state.waiting)
    if state.stage is Stage.GATHERING or report.step > min(owed, state.step):
        return f"reported step {report.step} before it was due"
    return f"reported step {report.step} twice" if report.step < owed else ""


def _may_go_on(state: LockstepState, config: LockstepConfig) -> bool:
    last = state.step + 1 >= config.steps
    trailing = config.trailing if state.stage is Stage.STEPPING and not last else frozenset()
    return not state.owing and not state.waiting - trailing


def _all_reported(state: LockstepState, config: LockstepConfig, now_s: float) -> tuple[LockstepState, Action]:
    if state.stage is Stage.CLOSING:
        return state._replace(stage=Stage.CLOSED), None
    if state.step + 1 >= config.steps:
        return _close(state, EpisodeEnd.COMPLETE, "", config, now_s)
    step, everybody = state.step + 1, frozenset(config.participants)
    owing = state.waiting if state.stage is Stage.STEPPING else frozenset()
    state = state._replace(stage=Stage.STEPPING, step=step, waiting=everybody, owing=owing, since_s=now_s)
    return state, BeginStep(step)


def on_time(
    state: LockstepState,
    config: LockstepConfig,
    now_s: float,
    absent: Callable[[], frozenset[str]] = frozenset,
) -> tuple[LockstepState, Action]:
    """Check the time limits; the error names a participant that does not answer.

    Args:
        state: The lockstep now.
        config: Participants and time limits.
        now_s: Wall time.
        absent: Gives the participants that have not even come; before step 0 all others wait for them.
    """
    limit_s = {
        Stage.GATHERING: config.start_timeout_s,
        Stage.STEPPING: config.step_limit_s(state.late_step),
        Stage.CLOSING: config.late_close_timeout_s if state.waiting <= state.late else config.close_timeout_s,
    }.get(state.stage)
    if limit_s is None or now_s - state.since_s < limit_s:
        return state, None
    gathering = state.stage is Stage.GATHERING
    late = state.waiting if state.stage is Stage.CLOSING else first_late(state.owing or state.waiting, gathering)
    late = (gathering and state.waiting & absent()) or late
    names = ", ".join(config.display_names.get(name, name) for name in sorted(late))
    if state.stage is Stage.CLOSING:
        reason = state.reason or f"{names}: did not close within {limit_s:g} s"
        return state._replace(stage=Stage.CLOSED, end=_end_with_fault(state), reason=reason), None
    what = "was not ready" if gathering else f"did not finish step {state.late_step}"
    return _close(state._replace(late=late), EpisodeEnd.FAILED, f"{names}: {what} within {limit_s:g} s", config, now_s)


def first_late(waiting: frozenset[str], gathering: bool) -> frozenset[str]:
    """Late participants that do not wait for another late one: for its messages or, before step 0, for its publisher.

    If each waits for another, it gives all of them.
    """
    return frozenset(name for name in waiting if not upstream_of(name, lagged=gathering) & waiting) or waiting


def on_interrupt(
    state: LockstepState, config: LockstepConfig, now_s: float, reason: str
) -> tuple[LockstepState, Action]:
    """Handle the user's request to stop."""
    if state.stage in {Stage.CLOSING, Stage.CLOSED}:
        return state, None
    return _close(state, EpisodeEnd.INTERRUPTED, reason, config, now_s)


def on_failure(
    state: LockstepState, config: LockstepConfig, now_s: float, reason: str, gone: frozenset[str] = frozenset()
) -> tuple[LockstepState, Action]:
    """Handle a failure outside the reports, such as a participant's process that exited.

    Args:
        state: The lockstep now.
        config: Participants and time limits.
        now_s: Wall time.
        reason: What failed, naming the participant.
        gone: Participants that have exited; the lockstep does not wait for them.
    """
    if state.stage is Stage.CLOSED:
        return state, None
    if state.stage is not Stage.CLOSING:
        closing, action = _close(state, EpisodeEnd.FAILED, reason, config, now_s)
        return closing._replace(waiting=closing.waiting - gone), action
    if not gone and state.end is EpisodeEnd.COMPLETE:
        return state._replace(end=EpisodeEnd.FAILED, reason=reason), None
    if not state.waiting & gone:
        return state, None
    waiting = state.waiting - gone
    stage = state.stage if waiting else Stage.CLOSED
    return state._replace(stage=stage, waiting=waiting, end=_end_with_fault(state), reason=state.reason or reason), None


def _end_with_fault(state: LockstepState) -> EpisodeEnd:
    """How an episode ends if a participant does not close: an interrupted episode stays interrupted."""
    return EpisodeEnd.FAILED if state.end is EpisodeEnd.COMPLETE else state.end


def on_closed(state: LockstepState, closed: frozenset[str]) -> LockstepState:
    """Note participants of a failed episode that have closed, even without a report.

    If another program floods the topic of reports, some reports are lost. A complete episode waits for all of them,
    because a report may carry an error.

    """
    if state.stage is not Stage.CLOSING or state.end is not EpisodeEnd.FAILED or not state.waiting & closed:
        return state
    waiting = state.waiting - closed
    return state._replace(waiting=waiting, stage=state.stage if waiting else Stage.CLOSED)


def on_departure(
    state: LockstepState, config: LockstepConfig, now_s: float, gone: frozenset[str], reason: str
) -> tuple[LockstepState, Action]:
    """Handle the end of another program that takes part. Before the first step it may come back.

    Args:
        state: The lockstep now.
        config: Participants and time limits.
        now_s: Wall time.
        gone: The participants that it was.
        reason: What ends the episode once that has begun, naming them.
    """
    if state.stage is Stage.GATHERING:
        return state._replace(waiting=state.waiting | gone), None
    return on_failure(state, config, now_s, reason, gone)


def _close(
    state: LockstepState, end: EpisodeEnd, reason: str, config: LockstepConfig, now_s: float
) -> tuple[LockstepState, Action]:
    steps = state.steps_done
    unready = state.waiting if state.stage is Stage.GATHERING else frozenset()
    closing = state._replace(
        stage=Stage.CLOSING,
        waiting=frozenset(config.participants),
        owing=frozenset(),
        since_s=now_s,
        end=end,
        reason=reason,
        steps_closed=steps,
        late=state.late | unready,
    )
    return closing, EndEpisode(steps, end, reason)


MAX_STEPS_AHEAD: Final = 64
"""Messages for a step farther ahead than this are refused: at most two steps run at once, so another program sent
it."""


@dataclass(frozen=True)
class Input:
    """A topic that a node needs before it acts on a step."""

    topic: Topic
    lag_steps: int = 0
    """With 1, step k needs the message of step k − 1, and step 0 needs none."""

    def needed_at(self, step: int) -> bool:
        """Whether this topic has a message for a step."""
        source = step - self.lag_steps
        return source >= 0 and source % self.topic.period_steps == 0


def once(topic: Topic, earlier: object) -> None:
    """Refuse a second message on a topic with a single message.

    Args:
        topic: Where a message has come.
        earlier: What came on it before; None where nothing did.

    Raises:
        EpisodeError: There was one before: another program publishes on the topic.
    """
    if earlier is not None:
        raise EpisodeError(f"{topic.name}: a second message, although it is published once")


class TickJoin:
    """Collects messages by step and hands out steps whose inputs are complete, in order."""

    def __init__(self, inputs: tuple[Input, ...]) -> None:
        self._inputs = {item.topic.name: item for item in inputs}
        self._waiting: dict[int, dict[str, Any]] = {}
        self.next_step = 0

    def add(self, inputs: tuple[Input, ...]) -> None:
        """Add topics to wait for; only before the first message."""
        self._inputs.update({item.topic.name: item for item in inputs})

    def offer(self, topic_name: str, message_step: int, message: Any) -> Iterator[tuple[int, dict[str, Any]]]:
        """Take a message; yield every step that is now complete, with its messages by topic name.

        Raises:
            EpisodeError: The message belongs to a step that was handed out already or cannot have begun, or came
                twice: the lockstep is broken, or another program publishes on the topic.
        """
        step = message_step + self._inputs[topic_name].lag_steps
        if step > self.next_step + MAX_STEPS_AHEAD:
            raise EpisodeError(f"{topic_name}: a message for step {message_step}, which has not begun")
        slot = self._waiting.setdefault(step, {})
        if step < self.next_step or topic_name in slot:
            raise EpisodeError(f"{topic_name}: a second message for step {message_step}")
        slot[topic_name] = message
        yield from self._complete()

    def _complete(self) -> Iterator[tuple[int, dict[str, Any]]]:
        while self._waiting and not self._lacking():
            messages = self._waiting.pop(self.next_step, {})
            self.next_step += 1
            yield self.next_step - 1, messages

    def missing(self) -> tuple[str, ...]:
        """Topics that the next step still waits for, sorted."""
        return tuple(sorted(self._lacking()))

    def _lacking(self) -> list[str]:
        have, step = self._waiting.get(self.next_step, {}), self.next_step
        return [name for name, item in self._inputs.items() if name not in have and item.needed_at(step)]
