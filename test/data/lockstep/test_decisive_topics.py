"""What the receiving code does with messages of another program on each topic that an episode's course depends on."""

from collections.abc import Callable
from typing import Final

import pytest

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.episode_conversions import Phase, StepReport
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.lockstep import (
    MAX_STEPS_AHEAD,
    BeginStep,
    EndEpisode,
    Input,
    LockstepConfig,
    LockstepState,
    TickJoin,
    on_report,
    once,
    start_lockstep,
)
from siren_ros.data.recording.recorder import StepCollector
from siren_ros.errors import EpisodeError

NOW: Final = 4
"""Steps 0 to 3 are over; this one is under way."""
STATES: Final = (topics.CLOCK, topics.TRAFFIC, topics.EMV_COMMANDS, topics.YIELD_COMMANDS, topics.ACTORS)
DESCRIPTIONS: Final = (topics.EPISODE, topics.MAP)
Receive = Callable[[int, bytes], None]
ATTACKS: Final[dict[str, list[tuple[int, bytes]]]] = {
    "forged": [(NOW, b"forged"), (NOW, b"true")],
    "doubled": [(NOW, b"true"), (NOW, b"true")],
    "stale": [(NOW - 2, b"true")],
    "flooded": [(NOW + ahead, b"any") for ahead in range(10 * MAX_STEPS_AHEAD)],
}


def joined(topic: Topic) -> Receive:
    """By a node that acts on the topic at every step; a second input keeps the step open."""
    join = TickJoin((Input(topic), Input(topics.TF)))
    for step in range(NOW):
        for due in (topic, topics.TF):
            list(join.offer(due.name, step, b"true"))
    return lambda step, cdr: [*join.offer(topic.name, step, cdr)].clear()


def recorded(topic: Topic) -> Receive:
    """By the recorder, which waits for a second topic at every step."""
    other = topics.TF
    collector = StepCollector([topic, other])
    for step in range(NOW):
        for joined in (topic, other):
            if step % (joined.period_steps or NOW) == 0:
                collector.add(joined.name, step, b"true")
        list(collector.ready())
    return lambda step, cdr: collector.add(topic.name, step, cdr)


def told_once(topic: Topic) -> Receive:
    """By a node that takes a description once; it has one."""
    return lambda _step, _cdr: once(topic, b"true")


def stepping() -> tuple[LockstepConfig, LockstepState]:
    config = LockstepConfig(("sensor_sim", "recorder"), steps=100)
    state = start_lockstep(config, 0.0)
    for name in config.participants:
        state, _ = on_report(state, StepReport(0, name, Phase.READY), config, 0.0)
    for step in range(NOW):
        for name in config.participants:
            state, action = on_report(state, StepReport(step, name, Phase.STEP), config, 0.0)
            assert not isinstance(action, EndEpisode)
    return config, state


def reported(phase: Phase) -> Receive:
    """By the lockstep, as reports of a node."""
    config, first = stepping()
    state = [first]

    def receive(step: int, _cdr: bytes) -> None:
        state[0], action = on_report(state[0], StepReport(step, "sensor_sim", phase), config, 0.0)
        assert not isinstance(action, BeginStep), "the recorder has not reported"
        if isinstance(action, EndEpisode):
            raise EpisodeError(action.reason)

    return receive


def make_receivers(name: str) -> list[Receive]:
    """Everything that takes messages of a topic, at a step under way."""
    topic = next(topic for topic in topics.__dict__.values() if isinstance(topic, Topic) and topic.name == name)
    kinds: dict[Callable[[Topic], Receive], tuple[Topic, ...]] = {
        joined: (*STATES, topics.AV_CONTROL),
        recorded: (*STATES, *DESCRIPTIONS, topics.EVENTS, topics.SENSING, *topics.AV_TOPICS, topics.PREDICTIONS),
        told_once: (*DESCRIPTIONS, topics.OUTCOME),
        lambda _topic: reported(Phase.STEP): (topics.STEP_DONE,),
        lambda _topic: reported(Phase.FINAL): (topics.EPISODE_END,),  # a node that believes it closes, and says so
    }
    return [make(topic) for make, taken in kinds.items() if topic in taken]


@pytest.mark.parametrize("attack", ATTACKS)
@pytest.mark.parametrize("topic", sorted(topics.DECISIVE_TOPICS))
def test_another_programs_message_ends_the_episode(topic: str, attack: str) -> None:
    receivers = make_receivers(topic)
    assert receivers
    for receive in receivers:
        with pytest.raises(EpisodeError):
            [receive(step, cdr) for step, cdr in ATTACKS[attack]]
