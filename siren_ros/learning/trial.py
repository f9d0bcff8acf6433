"""How drivers do in the civilian's seat on seeds: what the EMV loses, and which clauses are violated."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.exam.grading import Grade, examine
from siren_ros.exam.others import actor_in_seat
from siren_ros.exam.rulebook import load_rulebook
from siren_ros.generation.closed_loop import record_of
from siren_ros.learning.environment import YieldEnv
from siren_ros.learning.manoeuvres import Manoeuvre
from siren_ros.learning.moment import Moment
from siren_ros.learning.rollout import Rollout, Seat
from siren_ros.learning.task import Task
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord

Chooser = Callable[[npt.NDArray[Any], Moment], int]
"""Chooses a manoeuvre for an observation."""
_BAD: Final = (Grade.MINOR, Grade.MAJOR)
_HEARD_M: Final = 40.0
_IN_LINE_M: Final = 3.0


@dataclass(frozen=True)
class Outcome:
    """One episode with a driver."""

    seed: int
    delay_s: float
    """Time that the EMV lost against its own speed, over the whole episode."""
    violations: int
    """Clauses that the driver violated, minor and major."""
    contacts: int


def keeps_lane(_observation: npt.NDArray[Any], _moment: Moment) -> int:
    """A driver without any regard for sirens, behind its leader as by the IDM."""
    return Manoeuvre.KEEP


def makes_way(_observation: npt.NDArray[Any], moment: Moment) -> int:
    """A driver that pulls over while a siren comes from behind in its line."""
    comes = any(
        siren.behind and siren.gap_m < _HEARD_M and abs(siren.left_m) < _IN_LINE_M for siren in moment.sight.sirens
    )
    return Manoeuvre.PULL_OVER if comes else Manoeuvre.KEEP


def driven(task: Task, seed: int, choose: Chooser) -> Outcome:
    """An episode with a driver in the seat.

    Raises:
        InputError: The request cannot be used.
        EpisodeError: SUMO failed before the first step.
    """
    environment = YieldEnv(**vars(task))
    try:
        observation, _ = environment.reset(seed=seed)
        over = False
        while not over:
            observation, _, terminated, truncated, _ = environment.step(choose(observation, environment.moment))
            over = terminated or truncated
        return _outcome(environment.rollout, environment.moment.body.actor_id, task)
    finally:
        environment.close()


def of_the_model(task: Task, seed: int) -> Outcome:
    """The episode of the seed without an AV: the paper's driver drives the same vehicle.

    Raises:
        InputError: The request cannot be used.
        EpisodeError: The episode failed.
    """
    with Rollout(task.request(seed, with_av=False)) as rollout:
        while not rollout.over:
            rollout.advance({})
        return _outcome(rollout, actor_in_seat(record_of(rollout.setup, rollout.steps)), task)


def _outcome(rollout: Rollout, driver: int, task: Task) -> Outcome:
    record = record_of(rollout.setup, rollout.steps)
    sitting = examine(record, driver, load_rulebook(task.rulebook or "international"))
    wanted_mps = float(rollout.setup.description.template_values["emv.speed_mps"])
    contact = next(mark for mark in sitting.marks if mark.clause.monitor == "contact")
    return Outcome(
        rollout.request.seed,
        _delay_s(record, rollout.actor_of(Seat.EMV), wanted_mps, rollout.length),
        sum(mark.grade in _BAD for mark in sitting.marks),
        int(contact.grade in _BAD),
    )


def _delay_s(record: EpisodeRecord, emv_id: int, wanted_mps: float, length: int) -> float:
    """Time lost; the EMV of an episode that ends before its time is taken to stand for the rest."""
    speeds = record.track(emv_id).speed_mps
    lost = float(np.maximum(1.0 - speeds / wanted_mps, 0.0).sum())
    return STEP_S * (lost + length - len(record.states))


def means(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Means over episodes."""
    names = ("delay_s", "violations", "contacts")
    return {name: float(np.mean([getattr(one, name) for one in outcomes])) for name in names}
