"""Simulates a recorded episode again from its own description and finds the first difference."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields

import numpy as np

from siren_ros.errors import BagError
from siren_ros.generation.closed_loop import LoopStep, closed_loop
from siren_ros.generation.episode_setup import set_up_episode
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorStates
from siren_ros.world.commands import AV_SOURCE
from siren_ros.world.state_hash import hash_state


@dataclass(frozen=True)
class Difference:
    """The first place where two episodes part."""

    step: int
    actor_id: int
    """0 where the actors themselves differ, or what is no actor's."""
    field: str
    recorded: float | int
    repeated: float | int

    def __str__(self) -> str:
        if self.field == "state_hash":
            return (
                f"step {self.step}, state_hash: recorded {int(self.recorded):016x}, repeated {int(self.repeated):016x}"
            )
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
    defaults = EpisodeRequest("")
    for name, value in stored.items():
        if type(value) is not type(getattr(defaults, name)):
            raise BagError(record.description.template, f"a request whose {name} is not {value!r}")
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
    repeated = closed_loop(setup, record.steps, answers=answers)
    return first_difference(record.states, repeated, record.state_hashes)


def first_difference(
    recorded: Iterable[ActorStates], repeated: Iterable[LoopStep], state_hashes: Mapping[int, int] | None = None
) -> Difference | None:
    """The first step, actor and field that are not the same to the last bit.

    Args:
        recorded: The states in the record.
        repeated: The steps of the repetition, as many.
        state_hashes: The recorded hashes by step, which also cover the traffic lights; None where there are none.
    """
    for before, again in zip(recorded, repeated, strict=True):
        difference = _difference(before, again.states)
        if difference is not None:
            return difference
        here = hash_state(again.states, again.traffic.signals)
        said = here if state_hashes is None else state_hashes.get(before.step, 0)
        if said != here:
            return Difference(before.step, 0, "state_hash", said, here)
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
