"""A rollout: one episode in which drivers answer step by step, the state of a seat at a step, and the bag.

Observations and rewards come from the state of a seat.
"""

import warnings
from collections.abc import Generator
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import ClassVar, Final, Self, cast

from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.lab.learning.snapshot import Snapshot, run_of
from siren_ros.running.generation.closed_loop import LoopStep, RecordedEpisode, closed_loop, record_episode
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.running.seat.sight import Sight, Way, sight_of
from siren_ros.simulation.roads.road_network import mirror_image, right_hand_image
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.traffic.demand.av_way import av_way, way_of
from siren_ros.simulation.world.actors import ActorDescription, ActorStates, EventKind
from siren_ros.simulation.world.commands import Controls


class Seat(StrEnum):
    """Vehicle whose driver is replaced."""

    CIVILIAN = "civilian"
    """The AV under test: the civilian that the EMV must pass."""
    EMV = "emv"
    """The first emergency vehicle."""


_TAKES_TURNS: Final = (
    "two environments of one process take turns with SUMO, of which a process has one: at each turn the episode is "
    "simulated again up to its present step; AsyncVectorEnv and SubprocVecEnv give each a process of its own"
)


class Rollout:
    """One episode that is simulated step by step with the drivers' answers.

    A process has one SUMO. A rollout that begins takes it from another one, which takes it back when it goes on: it
    simulates its steps again from its answers. A rollout of a snapshot has a process of its own.
    """

    _running: ClassVar["Rollout | None"] = None

    def __init__(self, request: EpisodeRequest, snapshot: Snapshot | None = None) -> None:
        """Set the episode up and simulate its first step, or begin a run of its snapshot.

        Raises:
            InputError: The request cannot be used.
            EpisodeError: SUMO failed before the first step.
        """
        self.setup: EpisodeSetup = snapshot[0] if snapshot else set_up_episode(request)
        self._snapshot = snapshot
        self.request = request
        self.network = right_hand_image(self.setup.network)
        self.actors: dict[int, ActorDescription] = {}
        """All who were there, by id."""
        self.steps: list[LoopStep] = []
        self._answers: list[Controls] = []
        """To each step but the last."""
        self._loop: Generator[LoopStep, Controls | None, None] | None = None
        self._failed = False
        self.taken = False
        """Whether another rollout has taken SUMO."""
        self._begin()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def over(self) -> bool:
        """Whether the episode's time is over."""
        return len(self.steps) == self.setup.steps

    @property
    def states(self) -> ActorStates:
        """States of the current step from the drivers' view; left-hand traffic is mirrored."""
        states = self.steps[-1].states
        return mirror_image(states) if self.setup.network.left_hand else states

    def actor_of(self, seat: Seat) -> int:
        """Id of the actor in a seat."""
        described = self.setup.description
        return described.av_id if seat is Seat.CIVILIAN else described.emv_ids[0]

    def advance(self, controls: Controls) -> None:
        """Simulate the next step with answers to the current one, given in the drivers' (mirrored) view.

        Raises:
            EpisodeError: An answer cannot be used, the episode failed, or its time is over.
        """
        if self.over:
            raise EpisodeError(f"the episode is over after {self.setup.steps} steps")
        if self.setup.network.left_hand:
            controls = {actor_id: mirror_image(control) for actor_id, control in controls.items()}
        for control in controls.values():
            control.check()
        if self._failed:
            raise EpisodeError("the episode has failed before")
        if self._loop is None:
            if self.taken:
                warnings.warn(_TAKES_TURNS, stacklevel=2)
            self._begin()
        self._take(self._next(controls))
        self._answers.append(dict(controls))

    def save(self, bag: Path) -> RecordedEpisode:
        """Simulate the rollout again and write its bag, which ends with the rollout's last step.

        The bag's request has the rollout's duration where it ended before the episode's time. ``siren replay --check``
        repeats the bag from the answers in it.

        Raises:
            InputError: The bag exists already or cannot be written.
            EpisodeError: The disk is full.
        """
        setup = self.setup
        if not self.over:
            setup = set_up_episode(replace(self.request, duration_s=len(self.steps) * STEP_S))
        self._free_sumo()
        answers = dict(enumerate(self._answers))
        return record_episode(setup, bag, lambda step: answers.get(step.states.step, {}))

    def close(self) -> None:
        """End SUMO; a second call has no effect."""
        if self._loop is not None:
            self._loop.close()
            self._loop = self._snapshot = None
        if Rollout._running is self:
            Rollout._running = None

    def _begin(self) -> None:
        """Simulate from the first step through all given answers."""
        if self._snapshot is not None:
            self._loop = run_of(self._snapshot)
        else:
            if Rollout._running is not None:
                Rollout._running.taken = True
            self._free_sumo()
            self.taken = False
            self._loop = closed_loop(self.setup, self.setup.steps)
            Rollout._running = self
        first = self._next(None)
        if not self.steps:
            self._take(first)
        for answer in self._answers:
            self._next(answer)

    def _next(self, controls: Controls | None) -> LoopStep:
        loop = cast("Generator[LoopStep, Controls | None, None]", self._loop)
        try:
            return loop.send(controls)
        except EpisodeError:
            self._failed = True
            self.close()
            raise

    def _take(self, step: LoopStep) -> None:
        self.actors.update({actor.actor_id: actor for actor in step.traffic.spawned})
        self.steps.append(step)

    @staticmethod
    def _free_sumo() -> None:
        if Rollout._running is not None:
            Rollout._running.close()


@dataclass(frozen=True)
class SeatState:
    """What a driver sees at a step, and what has happened since the step before; left-hand traffic is mirrored."""

    sight: Sight
    before: Sight
    """The view one step before; at the first step the same view."""
    emv_id: int
    """Id of the first emergency vehicle."""
    emv_wanted_mps: float
    """Speed of the emergency vehicle if no other vehicle were in its way."""
    contact: bool
    """Whether the own vehicle touched another actor at this step."""
    red_lines: int
    """Number of red stop lines that the own front crossed at this step."""

    @property
    def emv_row(self) -> int | None:
        """Row of the first emergency vehicle; None if it is not on the map."""
        return self.sight.states.row_of(self.emv_id)


class SeatView:
    """The view of one driver on a rollout, step by step."""

    def __init__(self, rollout: Rollout, seat: Seat) -> None:
        """Find the path of the seat's vehicle.

        Raises:
            InputError: The episode has nobody in the seat, or its route cannot be driven from its first lane.
        """
        setup, network = rollout.setup, rollout.network
        curve = av_way(network, setup.plan) if seat is Seat.CIVILIAN else way_of(network, setup.plan.emvs[0])
        self.actor_id = rollout.actor_of(seat)
        self.way = Way.of(network, curve)
        self._rollout = rollout
        self._emv_id = rollout.actor_of(Seat.EMV)
        self._emv_wanted_mps = float(setup.description.template_values["emv.speed_mps"])
        self._last: SeatState | None = None

    def look(self) -> SeatState | None:
        """State at the rollout's current step; None if the vehicle has left the map."""
        step, states = self._rollout.steps[-1], self._rollout.states
        if states.row_of(self.actor_id) is None:
            return None
        at_m = 0.0 if self._last is None else self._last.sight.s_m
        sight = sight_of(states, step.traffic.signals, self._rollout.actors, self.actor_id, self.way, at_m)
        before = sight if self._last is None else self._last.sight
        touched = any(
            event.kind is EventKind.COLLISION and self.actor_id in {event.actor_id, event.other_id}
            for event in step.events
        )
        colours = {signal.signal_id: signal.state for signal in step.traffic.signals}
        crossed = [
            line.connection
            for line in self.way.lines
            if before.s_m < line.at_m - 0.5 * sight.length_m <= sight.s_m
            and line.connection.letter_in(colours.get(line.connection.signal_id or "", "")) in {"r", "R"}
        ]
        self._last = SeatState(sight, before, self._emv_id, self._emv_wanted_mps, touched, len(crossed))
        return self._last
