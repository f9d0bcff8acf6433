"""A rollout: one episode in which drivers answer step by step, and its bag from their answers."""

import warnings
from collections.abc import Generator
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import ClassVar, Final, Self, cast

from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import EpisodeError
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop
from siren_ros.running.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.running.generation.recorded_episode import RecordedEpisode, record_episode
from siren_ros.simulation.roads.mirror_image import right_hand_image
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import ActorDescription, ActorStates
from siren_ros.simulation.world.commands import Controls
from siren_ros.simulation.world.mirror_image import mirror_image


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
    simulates its steps again from its answers.
    """

    _running: ClassVar["Rollout | None"] = None

    def __init__(self, request: EpisodeRequest) -> None:
        """Set the episode up and simulate its first step.

        Raises:
            InputError: The request cannot be used.
            EpisodeError: SUMO failed before the first step.
        """
        self.setup: EpisodeSetup = set_up_episode(request)
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
            self._loop = None
        if Rollout._running is self:
            Rollout._running = None

    def _begin(self) -> None:
        """Simulate from the first step through all given answers."""
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
