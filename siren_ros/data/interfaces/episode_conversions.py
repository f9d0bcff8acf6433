"""Paired conversions of the lockstep's reports and of an episode's description, end and outcome.

Only the wall time in StepDone is not simulated data.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces.cdr import CdrWriter, Layout, text, text_once
from siren_ros.data.interfaces.messages import (
    checks_content,
    from_plain_fields,
    json_object,
    json_text,
    make_message,
    plain_fields,
    sequence,
    stamp,
)
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.scenario.paper import EmergencyLevel


class Phase(IntEnum):
    """Part of the lockstep's protocol that a report belongs to."""

    READY = 0
    STEP = 1
    FINAL = 2
    COMPILING = 3
    """The participant is not done, because it compiles code; time limits start again."""


@dataclass(frozen=True)
class StepReport:
    """Content of ``StepDone``: one participant has finished a step."""

    step: int
    participant: str
    phase: Phase
    error: str = ""
    busy_s: float = 0.0
    """Wall time that the participant spent on the step; only the closing summary uses it."""


@dataclass(frozen=True)
class EpisodeClosing:
    """The message with which the master ends the episode."""

    steps: int
    end: EpisodeEnd
    reason: str


_STEP_DONE: Final = Layout("Q s B s d")


def to_step_done(report: StepReport) -> bytes:
    """Makes the message ``siren_msgs/StepDone`` as CDR."""
    writer = CdrWriter()
    names = text(report.participant), int(report.phase), text_once(report.error)
    writer.put(_STEP_DONE, report.step, *names, report.busy_s)
    return writer.cdr()


@checks_content
def from_step_done(message: Any) -> StepReport:
    """Reads the message that ``to_step_done`` makes."""
    return from_plain_fields(StepReport, message)


def to_episode_description(episode: EpisodeDescription) -> Any:
    """Makes the message ``siren_msgs/EpisodeDescription``."""
    return make_message(
        "siren_msgs/msg/EpisodeDescription",
        stamp=stamp(0),
        template_id=episode.template,
        level=int(episode.level),
        seed=episode.seed,
        map_name=episode.map_name,
        map_sha256=episode.map_sha256,
        duration_s=float(episode.duration_s),
        sensor_suite=episode.sensor_suite,
        preset=episode.preset,
        emv_ids=sequence(np.array(episode.emv_ids, dtype=np.uint32)),
        parameters=json_text(dict(episode.parameters)),
        versions=json_text(dict(episode.versions)),
        site=json_text(dict(episode.site)),
    )


@checks_content
def from_episode_description(message: Any) -> EpisodeDescription:
    """Reads the message that ``to_episode_description`` makes."""
    return EpisodeDescription(
        template=str(message.template_id),
        level=EmergencyLevel(int(message.level)),
        seed=int(message.seed),
        map_name=str(message.map_name),
        map_sha256=str(message.map_sha256),
        duration_s=float(message.duration_s),
        sensor_suite=str(message.sensor_suite),
        preset=str(message.preset),
        emv_ids=tuple(int(value) for value in message.emv_ids),
        parameters=json_object(message.parameters),
        versions=json_object(message.versions),
        site=json_object(message.site),
    )


def to_episode_end(closing: EpisodeClosing) -> Any:
    """Makes the message ``siren_msgs/EpisodeEnd``."""
    at = stamp(time_ns_of_step(max(closing.steps - 1, 0)))
    return make_message("siren_msgs/msg/EpisodeEnd", stamp=at, **plain_fields(closing))


@checks_content
def from_episode_end(message: Any) -> EpisodeClosing:
    """Reads the message that ``to_episode_end`` makes."""
    return from_plain_fields(EpisodeClosing, message)


def to_episode_outcome(outcome: EpisodeOutcome) -> Any:
    """Makes the message ``siren_msgs/EpisodeOutcome``."""
    return make_message(
        "siren_msgs/msg/EpisodeOutcome",
        stamp=stamp(time_ns_of_step(max(outcome.steps - 1, 0))),
        end=outcome.end.value,
        reason=outcome.reason,
        steps=outcome.steps,
        predicate=-1 if outcome.predicate_holds is None else int(outcome.predicate_holds),
        measures=json_text(dict(outcome.measures)),
    )


@checks_content
def from_episode_outcome(message: Any) -> EpisodeOutcome:
    """Reads the message that ``to_episode_outcome`` makes."""
    return EpisodeOutcome(
        end=EpisodeEnd(message.end),
        reason=str(message.reason),
        steps=int(message.steps),
        predicate_holds=None if int(message.predicate) < 0 else bool(message.predicate),
        measures=json_object(message.measures),
    )
