"""Simulates a recorded episode again from its own description and finds the first difference."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from siren_ros.generation.closed_loop import LoopStep, closed_loop
from siren_ros.generation.episode_setup import EpisodeRequest, set_up_episode
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorStates
from siren_ros.world.commands import AV_SOURCE
from siren_ros.world.errors import BagError


@dataclass(frozen=True)
class Difference:
    """The first place where two episodes part."""

    step: int
    actor_id: int
    """0 where the actors themselves differ."""
    field: str
    recorded: float
    repeated: float

    def __str__(self) -> str:
        who = f"actor {self.actor_id}" if self.actor_id else "the set of actors"
        return f"step {self.step}, {who}, {self.field}: recorded {self.recorded!r}, repeated {self.repeated!r}"


def request_of(record: EpisodeRecord) -> EpisodeRequest:
    """What the episode was made from.

    Raises:
        BagError: The description does not hold it.
    """
    stored = record.description.parameters.get("request")
    names = {field.name for field in fields(EpisodeRequest)}
    if not isinstance(stored, dict) or not set(stored) <= names or "template" not in stored:
        raise BagError(record.description.template, "a bag whose description holds the request of the episode")
    return EpisodeRequest(**stored)


def repeat_episode(record: EpisodeRecord) -> Difference | None:
    """Simulate the episode again, without its sensors, and compare every field of every actor at every step.

    An AV under test drives by its controller's recorded answers.

    Raises:
        BagError: The description does not hold what is needed, or the map is another one now.
        InputError: The template, map or preset that the episode used is not to be had here.
    """
    setup = set_up_episode(request_of(record))
    if setup.description.map_sha256 != record.description.map_sha256:
        raise BagError(
            record.description.map_name,
            f"the map that the episode was made on (SHA-256 {record.description.map_sha256})",
        )
    answers = record.commands.get(AV_SOURCE, ())
    return first_difference(record.states, closed_loop(setup, record.steps, answers=answers))


def first_difference(recorded: Iterable[ActorStates], repeated: Iterable[LoopStep]) -> Difference | None:
    """The first step, actor and field that are not the same to the last bit."""
    for before, again in zip(recorded, repeated, strict=True):
        difference = _difference(before, again.states)
        if difference is not None:
            return difference
    return None


def _difference(before: ActorStates, again: ActorStates) -> Difference | None:
    if not np.array_equal(before.actor_id, again.actor_id):
        return Difference(before.step, 0, "actor_id", float(len(before)), float(len(again)))
    for name in ACTOR_STATE_DTYPES:
        left, right = getattr(before, name), getattr(again, name)
        rows = np.flatnonzero(left != right)
        if rows.size:
            row = int(rows[0])
            return Difference(before.step, int(before.actor_id[row]), name, left[row].item(), right[row].item())
    return None
