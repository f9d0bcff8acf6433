"""Runs an episode without ROS and writes its bag, with the same bytes as the recorder node."""

from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import starmap
from pathlib import Path
from typing import Any

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.base.tables.brief import Brief
from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import (
    to_actor_states,
    to_av_control,
    to_events,
    to_path,
    to_traffic_state,
    to_vehicle_commands,
)
from siren_ros.data.interfaces.episode_conversions import EpisodeClosing, to_episode_description
from siren_ros.data.interfaces.messages import make_message, stamp, typestore
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.bag_writer import BagOptions, BagSummary
from siren_ros.data.recording.recorder import EpisodeRecorder
from siren_ros.data.sensor_messages.mounted_suite import TrailingSensing, mounted_suites, setup_messages
from siren_ros.data.sensor_messages.sensor_topics import topics_of
from siren_ros.errors import EpisodeError, InputError
from siren_ros.running.generation.answer_times import AnswerTimes
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop, driven
from siren_ros.running.generation.episode_setup import EpisodeSetup
from siren_ros.scoring.judging.outcome import judge
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.traffic.demand.demand import av_way
from siren_ros.simulation.world.actors import ActorDescription
from siren_ros.simulation.world.commands import AvControl, Controls


@dataclass(frozen=True)
class RecordedEpisode(Brief):
    """Result of an episode, with its bag."""

    description: EpisodeDescription
    outcome: EpisodeOutcome
    bag: BagSummary | None
    """The bag; None if no step was finished, and there is no bag."""
    answers: AnswerTimes | None = None
    """Answer times of the program that drove the AV; None if none did."""

    def facts(self) -> dict[str, object]:
        """The episode, its end and its bag's place as plain values."""
        described, outcome, bag = self.description, self.outcome, self.bag
        return {
            **{name: getattr(described, name) for name in ("template", "level", "seed")},
            "map": described.map_name,
            "sensors": described.sensor_suite,
            "steps": outcome.steps,
            "end": outcome.end,
            "reason": outcome.reason,
            "interaction": outcome.predicate_holds,
            "bag": None if bag is None else bag.path,
            "size_bytes": 0 if bag is None else bag.size_bytes,
        }


Answer = Callable[[LoopStep], Controls]
"""Gives the answers of external drivers to a step."""


def record_episode(
    setup: EpisodeSetup,
    bag: Path,
    answer: Answer | None = None,
    *,
    overwrite: bool = False,
    on_step: Callable[[int], None] = lambda _: None,
) -> RecordedEpisode:
    """Run an episode to its end and write its bag.

    The bytes are those of ``cosim`` with the same request, and with the same answers of the AV under test. An episode
    that fails leaves a partial bag, as with ``cosim``; its outcome holds the reason.

    Args:
        setup: The episode; its suite of sensors measures too.
        bag: Folder of the bag to write.
        answer: Answers for the AV under test, which an episode with one needs, and for whoever else sits in a seat. It
            may raise ``EpisodeError``, which ends the episode.
        overwrite: Whether the bag replaces that of an earlier episode there, once it is complete.
        on_step: Called with each step that is recorded.

    Raises:
        InputError: The bag exists already or cannot be written; an AV under test without answers, a predictor or a
            detector, which take part.
        EpisodeError: The disk is full, or the folder is gone.
    """
    described = setup.description
    for name in ("predictor", "detector"):
        if program := getattr(described, name):
            raise InputError(name, program, f"an episode without {name}; one that takes part needs cosim")
    if setup.plan.av and answer is None:
        raise InputError("av", described.parameters.get("av"), "an episode without an AV under test; that needs cosim")
    latched = frozenset(topic.name for topic in topics.FIXED_TOPICS.values() if topic.latched)
    options = BagOptions(overwrite=overwrite)
    recorder = EpisodeRecorder(bag, typestore(), latched, judge, wire.decode, wire.content, options)
    recorder.on_step_recorded = on_step
    end, reason = EpisodeEnd.COMPLETE, ""
    try:
        recorder.expect(topics_of(described), bag)
        with closing(_messages(setup, answer or _nobody)) as messages:  # SUMO ends with the messages, in any case
            for topic, cdr in messages:
                recorder.take(topic, cdr)
    except EpisodeError as error:
        end, reason = EpisodeEnd.FAILED, str(error)
    except BaseException:  # also if the user interrupts it
        recorder.discard()
        raise
    outcome, summary, _ = recorder.close(EpisodeClosing(recorder.steps_recorded, end, reason))
    return RecordedEpisode(described, outcome, summary)


def _nobody(_: LoopStep) -> Controls:
    return {}


def _messages(setup: EpisodeSetup, answer: Answer) -> Generator[tuple[Topic, bytes], None, None]:
    """All messages of the episode, as the nodes would publish them."""
    described = setup.description
    yield _sent(topics.EPISODE, to_episode_description(described))
    yield _sent(topics.MAP, make_message(topics.MAP.type_name, data=setup.compiled_map.read_bytes().decode()))
    suites = list(mounted_suites(described, setup.network, lambda _: False, in_background=True))
    yield from starmap(_sent, setup_messages(suites))
    sensing = TrailingSensing(suites, trails=True)
    actors: dict[int, ActorDescription] = {}
    if setup.plan.av:
        yield _sent(topics.AV_ROUTE, to_path(av_way(setup.network, setup.plan)))
    loop = closed_loop(setup, setup.steps)
    for step, controls in driven(loop, answer):
        for control in controls.values():
            control.check()
        number = step.states.step
        contents: tuple[tuple[Topic, Any, Callable[[Any], Any]], ...] = (
            (topics.TRAFFIC, step.traffic, to_traffic_state),
            (topics.EMV_COMMANDS, step.commands[0], to_vehicle_commands),
            (topics.YIELD_COMMANDS, step.commands[1], to_vehicle_commands),
            (topics.ACTORS, step.states, to_actor_states),
            (topics.EVENTS, (number, step.state_hash, step.events), lambda content: to_events(*content)),
        )
        yield _sent(topics.CLOCK, make_message(topics.CLOCK.type_name, clock=stamp(time_ns_of_step(number))))
        for topic, content, write in contents:
            yield topic, wire.encode_content(topic, number, content, write)
        if setup.plan.av:
            control = controls.get(described.av_id, AvControl(number))
            yield _sent(topics.AV_CONTROL, to_av_control(replace(control, step=number)))
        actors.update({actor.actor_id: actor for actor in step.traffic.spawned})
        yield from starmap(_sent, sensing.step(step.states, actors, step.traffic.signals))
    yield from starmap(_sent, sensing.finish())


def _sent(topic: Topic, message: Any) -> tuple[Topic, bytes]:
    return topic, wire.encode(topic, message)
