"""An episode without ROS: the closed loop of the library's calls, its record, and its bag.

The loop makes the calls of the node graph in the same order. Data that the nodes exchange over DDS is passed directly;
the states are the same. A recorded episode has a bag with the same bytes as that of the recorder node. Where a driver
answers, the wall time of its answers is measured.
"""

import re
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import starmap
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Brief
from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import (
    EpisodeClosing,
    to_actor_states,
    to_av_control,
    to_episode_description,
    to_events,
    to_path,
    to_traffic_state,
    to_vehicle_commands,
)
from siren_ros.data.interfaces.messages import make_message, stamp, typestore
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.bag_writer import BagOptions, BagSummary
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.recording.recorder import EpisodeRecorder
from siren_ros.data.sensor_messages.mounted_suite import TrailingSensing, mounted_suites, setup_messages
from siren_ros.data.sensor_messages.sensor_topics import topics_of
from siren_ros.errors import EpisodeError, InputError
from siren_ros.running.generation.episode_setup import EpisodeSetup, behaviour_world, set_up_episode
from siren_ros.scoring.judging.outcome import judge
from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.behaviour.emv.controller import EmvState, step_emv
from siren_ros.simulation.dynamics.fleet import FleetState, step_fleet
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome, EpisodeRequest
from siren_ros.simulation.scenario.sealing import told
from siren_ros.simulation.traffic.demand.av_way import av_way
from siren_ros.simulation.traffic.observation import check_no_teleport, check_residual
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.world.actors import (
    RESIDUAL_LIMIT_M,
    ActorDescription,
    ActorStates,
    Event,
    TrafficState,
    hash_state,
)
from siren_ros.simulation.world.commands import AV_SOURCE, AvControl, Controls, VehicleCommands, av_commands, with_seats

_LINE: Final = re.compile(
    r"answers of the AV's program after ([\d.]+) ms \(median\), ([\d.]+) ms \(95 %\), ([\d.]+) ms \(worst\)"
)


@dataclass(frozen=True)
class AnswerTimes:
    """Answer times of one episode in milliseconds of wall time."""

    median_ms: float
    p95_ms: float
    worst_ms: float

    @classmethod
    def of(cls, times_s: Sequence[float]) -> Self:
        """Compute them from the answers of an episode; at least one."""
        median, p95, worst = np.percentile(times_s, (50.0, 95.0, 100.0)) * 1000.0
        return cls(round(float(median), 1), round(float(p95), 1), round(float(worst), 1))

    @property
    def line(self) -> str:
        """The times as a line of an episode's summary."""
        told = f"{self.median_ms:.1f} ms (median), {self.p95_ms:.1f} ms (95 %), {self.worst_ms:.1f} ms (worst)"
        return f"answers of the AV's program after {told}"

    @classmethod
    def in_lines(cls, lines: Sequence[str]) -> Self | None:
        """Read the times from a summary; None if it has no such line."""
        found = [match for line in lines if (match := _LINE.search(line))]
        return cls(*map(float, found[-1].groups())) if found else None


@dataclass(frozen=True)
class LoopStep:
    """The messages of all nodes of the loop at one step."""

    traffic: TrafficState
    commands: tuple[VehicleCommands, ...]
    """Commands of the EMV controller and the yield manager, and of the AV's controller if there is one."""
    states: ActorStates
    events: tuple[Event, ...]

    @property
    def state_hash(self) -> int:
        """Hash of actor states and signals, as in the step's events."""
        return hash_state(self.states, self.traffic.signals)


def closed_loop(
    setup: EpisodeSetup,
    steps: int,
    residual_limit_m: float = RESIDUAL_LIMIT_M,
    world: BehaviourWorld | None = None,
) -> Generator[LoopStep, Controls | None, None]:
    """Run an episode's behaviour, dynamics and traffic step by step.

    It yields each step, and takes by ``send`` what the drivers in seats answer to it. The AV under test is always in a
    seat: without an answer it rolls. Every other actor is in one while it is among the answers; what the model's
    controllers ask of it is then left out.

    Args:
        setup: The episode.
        steps: Number of steps.
        residual_limit_m: Distance between SUMO's and the simulated pose above which the episode fails.
        world: What the controllers are given; None for what the episode's description says. With another one an
            episode is not the one that its description makes again.

    Raises:
        EpisodeError: As in the node graph: SUMO teleported a vehicle, or the residual passed its limit.
    """
    world = world or behaviour_world(setup.description, setup.compiled_map.read_bytes())
    vehicles = load_vehicle_parameters(setup.description.files)
    emv, civilians = EmvState(), YieldState()
    fleet = FleetState.empty(vehicles, left_hand=setup.network.left_hand)
    states: ActorStates | None = None
    controls: Controls = {}
    with SumoSimulation(
        setup.compiled_map, setup.network, setup.plan, setup.level, seed=setup.description.seed
    ) as simulation:
        for step in range(steps):
            traffic = simulation.step(step, states)
            check_no_teleport(traffic)
            emv, emv_commands = step_emv(emv, traffic, world)
            civilians, yield_commands = step_yield(civilians, traffic, world)
            commands = _with_seats((emv_commands, yield_commands), setup.description.av_id, traffic, controls)
            fleet, states, events = step_fleet(fleet, traffic, commands)
            check_residual(states, residual_limit_m)
            controls = (yield LoopStep(traffic, commands, states, events)) or {}


def driven(
    loop: Generator[LoopStep, Controls | None, None], answer: Callable[[LoopStep], Controls]
) -> Iterator[tuple[LoopStep, Controls]]:
    """Steps of a ``closed_loop`` with the drivers' answers to each."""
    with closing(loop):
        controls: Controls | None = None
        while True:
            try:
                step = loop.send(controls)
            except StopIteration:
                return
            controls = answer(step)
            yield step, controls


def _with_seats(
    commands: tuple[VehicleCommands, ...], av_id: int, traffic: TrafficState, controls: Controls
) -> tuple[VehicleCommands, ...]:
    """Commands of a step with those of external drivers, which are their answers to the previous step."""
    others = {one: control for one, control in controls.items() if one != av_id and one in traffic.actor_id}
    if others:
        emvs = {advice.actor_id for advice in traffic.emvs}
        sides = [{one: others[one] for one in others if (one in emvs) is wanted} for wanted in (True, False)]
        commands = tuple(with_seats(one, side, others) for one, side in zip(commands, sides, strict=True))
    if av_id not in traffic.actor_id:
        return commands
    return (*commands, av_commands(controls.get(av_id, AvControl(traffic.step - 1)), traffic.step, av_id))


def simulated(request: EpisodeRequest) -> EpisodeRecord:
    """Record of a request's episode, without sensors; EpisodeError if it failed, InputError as ``set_up_episode``."""
    setup = set_up_episode(request)
    return record_of(setup, list(closed_loop(setup, setup.steps)))


def record_of(setup: EpisodeSetup, steps: list[LoopStep]) -> EpisodeRecord:
    """Record of these steps, as from their bag; for predicates and pictures."""
    actors: dict[int, ActorDescription] = {actor.actor_id: actor for step in steps for actor in step.traffic.spawned}
    commands: dict[str, list[VehicleCommands]] = {}
    for step in steps:
        for command in step.commands:
            if command.source != AV_SOURCE:
                commands.setdefault(command.source, []).append(command)
    return EpisodeRecord(
        description=setup.description,
        network=setup.network,
        map_xml=setup.compiled_map.read_bytes(),
        actors=dict(sorted(actors.items())),
        states=tuple(step.states for step in steps),
        traffic=tuple(step.traffic for step in steps),
        commands={source: tuple(rows) for source, rows in sorted(commands.items())},
        events=tuple(event for step in steps for event in step.events),
        outcome=None,
        complete=False,
        topics={},
        state_hashes={step.states.step: step.state_hash for step in steps},
    )


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
    return record_messages(described, bag, _messages(setup, answer or _nobody), overwrite=overwrite, on_step=on_step)


def record_messages(
    described: EpisodeDescription,
    bag: Path,
    messages: Generator[tuple[Topic, bytes], None, None],
    *,
    overwrite: bool = False,
    on_step: Callable[[int], None] = lambda _: None,
) -> RecordedEpisode:
    """Write the bag of an episode from all its messages, which are closed in any case, and judge it.

    Arguments and errors are those of ``record_episode``.
    """
    latched = frozenset(topic.name for topic in topics.FIXED_TOPICS.values() if topic.latched)
    options = BagOptions(overwrite=overwrite)
    recorder = EpisodeRecorder(bag, typestore(), latched, judge, wire.decode, wire.content, options)
    recorder.on_step_recorded = on_step
    end, reason = EpisodeEnd.COMPLETE, ""
    try:
        recorder.expect(topics_of(described), bag)
        with closing(messages):  # SUMO ends with the messages, in any case
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
    yield _sent(topics.EPISODE, to_episode_description(told(described)))
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
