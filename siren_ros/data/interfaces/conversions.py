"""States, commands, events, reports and descriptions as messages: paired functions, exact inverses of each other.

``to_X(value)`` makes a message, ``from_X(message)`` reads one, from a topic or from a bag. Only the wall time in
StepDone is not simulated data.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces.measurements import quaternion_of_yaw, to_pose
from siren_ros.data.interfaces.messages import (
    as_arrays,
    as_sequences,
    at_step,
    check_stamp,
    checks_content,
    from_plain_fields,
    header,
    json_object,
    json_text,
    make_message,
    plain_fields,
    plain_message,
    sequence,
    stamp,
)
from siren_ros.data.interfaces.wire import CdrWriter, Layout, text, text_once
from siren_ros.errors import EpisodeError
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    TRAFFIC_STATE_DTYPES,
    ActorDescription,
    ActorStates,
    EmvAdvice,
    Event,
    SignalState,
    TrafficState,
)
from siren_ros.simulation.world.carrier import MAP_FRAME, PredictedPaths
from siren_ros.simulation.world.commands import COMMAND_DTYPES, AvControl, VehicleCommands


def to_event(event: Event) -> Any:
    """Makes the message ``siren_msgs/Event``."""
    detail = json_text(dict(event.detail))
    return make_message("siren_msgs/msg/Event", **plain_fields(event, "detail"), detail=detail)


@checks_content
def from_event(message: Any) -> Event:
    """Reads the message that ``to_event`` makes."""
    return from_plain_fields(Event, message, detail=json_object(message.detail))


def _from_events(messages: Any) -> tuple[Event, ...]:
    return tuple(from_event(message) for message in messages)


def to_events(step: int, state_hash: int, events: tuple[Event, ...]) -> Any:
    """Makes the message ``siren_msgs/Events`` of one step, with the hash of the world's state at that step."""
    return make_message(
        "siren_msgs/msg/Events", **at_step(step), state_hash=state_hash, events=[to_event(event) for event in events]
    )


@checks_content
def from_events(message: Any) -> tuple[int, int, tuple[Event, ...]]:
    """Reads the message that ``to_events`` makes: the step, the hash of its state and its events."""
    return int(message.step), int(message.state_hash), _from_events(message.events)


def to_actor_description(actor: ActorDescription) -> Any:
    """Makes the message ``siren_msgs/ActorDescription``."""
    colour_rgb = np.array(actor.colour_rgb, dtype=np.uint8)
    return make_message("siren_msgs/msg/ActorDescription", **plain_fields(actor, "colour_rgb"), colour_rgb=colour_rgb)


@checks_content
def from_actor_description(message: Any) -> ActorDescription:
    """Reads the message that ``to_actor_description`` makes."""
    red, green, blue = (int(value) for value in message.colour_rgb)
    return from_plain_fields(ActorDescription, message, colour_rgb=(red, green, blue))


@checks_content
def from_signal_state(message: Any) -> SignalState:
    """Reads the message that ``plain_message`` makes."""
    return from_plain_fields(SignalState, message)


@checks_content
def from_emv_advice(message: Any) -> EmvAdvice:
    """Reads the message that ``plain_message`` makes."""
    return from_plain_fields(EmvAdvice, message)


def to_traffic_state(traffic: TrafficState) -> Any:
    """Makes the message ``siren_msgs/TrafficState``."""
    return make_message(
        "siren_msgs/msg/TrafficState",
        **at_step(traffic.step),
        spawned=[to_actor_description(actor) for actor in traffic.spawned],
        emvs=[plain_message(advice) for advice in traffic.emvs],
        signals=[plain_message(signal) for signal in traffic.signals],
        events=[to_event(event) for event in traffic.events],
        **as_sequences(traffic, TRAFFIC_STATE_DTYPES),
    )


@checks_content
def from_traffic_state(message: Any) -> TrafficState:
    """Reads the message that ``to_traffic_state`` makes."""
    return TrafficState(
        step=int(message.step),
        spawned=tuple(from_actor_description(actor) for actor in message.spawned),
        emvs=tuple(from_emv_advice(advice) for advice in message.emvs),
        signals=tuple(from_signal_state(signal) for signal in message.signals),
        events=_from_events(message.events),
        **as_arrays(message, TRAFFIC_STATE_DTYPES),
    )


def to_vehicle_commands(commands: VehicleCommands) -> Any:
    """Makes the message ``siren_msgs/VehicleCommands``."""
    return make_message(
        "siren_msgs/msg/VehicleCommands",
        **at_step(commands.step),
        source=commands.source,
        events=[to_event(event) for event in commands.events],
        **as_sequences(commands, COMMAND_DTYPES),
    )


@checks_content
def from_vehicle_commands(message: Any) -> VehicleCommands:
    """Reads the message that ``to_vehicle_commands`` makes."""
    return VehicleCommands(
        step=int(message.step),
        source=str(message.source),
        events=_from_events(message.events),
        **as_arrays(message, COMMAND_DTYPES),
    )


def to_actor_states(states: ActorStates) -> Any:
    """Makes the message ``siren_msgs/ActorStates``."""
    return make_message(
        "siren_msgs/msg/ActorStates", **at_step(states.step), **as_sequences(states, ACTOR_STATE_DTYPES)
    )


@checks_content
def from_actor_states(message: Any) -> ActorStates:
    """Reads the message that ``to_actor_states`` makes."""
    return ActorStates(step=int(message.step), **as_arrays(message, ACTOR_STATE_DTYPES))


def to_av_control(control: AvControl) -> Any:
    """Makes the message ``siren_msgs/AvControl``."""
    return make_message("siren_msgs/msg/AvControl", **plain_fields(control, "step"), **at_step(control.step))


@checks_content
def from_av_control(message: Any) -> AvControl:
    """Reads the message that ``to_av_control`` makes.

    EpisodeError where another program's stamp is not the time of the step.
    """
    control = from_plain_fields(AvControl, message)
    check_stamp(message.stamp, control.step)
    return control


def to_path(way: Polyline) -> Any:
    """Makes the message ``nav_msgs/Path`` of a route that is known before the first step; each pose points along it."""
    at_start = header(0, MAP_FRAME)
    headings = way.heading_rad(way.arc_m)
    return make_message(
        "nav_msgs/msg/Path",
        header=at_start,
        poses=[
            make_message(
                "geometry_msgs/msg/PoseStamped",
                header=at_start,
                pose=to_pose((x_m, y_m, 0.0), quaternion_of_yaw(float(heading))),
            )
            for (x_m, y_m), heading in zip(way.points.tolist(), headings, strict=True)
        ],
    )


def from_path(message: Any) -> Polyline:
    """Reads the message that ``to_path`` makes."""
    return Polyline.through([(pose.pose.position.x, pose.pose.position.y) for pose in message.poses])


def to_predicted_paths(paths: PredictedPaths) -> Any:
    """Makes the message ``siren_msgs/PredictedPaths``."""
    return make_message(
        "siren_msgs/msg/PredictedPaths",
        **at_step(paths.step),
        actor_id=sequence(paths.actor_id.astype(np.uint32)),
        probability=sequence(paths.probability.astype(np.float64)),
        x_m=sequence(paths.xy_m[..., 0].ravel()),
        y_m=sequence(paths.xy_m[..., 1].ravel()),
    )


@checks_content
def from_predicted_paths(message: Any) -> PredictedPaths:
    """Reads the message that ``to_predicted_paths`` makes; without paths their length is 0.

    Raises EpisodeError for another program's arrays that do not fit, or a stamp that is not the time of the step.
    """
    step = int(message.step)
    check_stamp(message.stamp, step)
    arrays = as_arrays(
        message, {"actor_id": np.uint32, "probability": np.float64, "x_m": np.float64, "y_m": np.float64}
    )
    count, numbers = len(arrays["actor_id"]), len(arrays["x_m"])
    fits = len(arrays["probability"]) == count and len(arrays["y_m"]) == numbers
    if not fits or (numbers % count if count else numbers):
        lengths = ", ".join(f"{len(values)} {name}" for name, values in arrays.items())
        raise EpisodeError(f"paths of step {step} with {lengths}")
    xy_m = np.stack((arrays["x_m"], arrays["y_m"]), axis=-1).reshape(count, numbers // count if count else 0, 2)
    return PredictedPaths(step, arrays["actor_id"], arrays["probability"], xy_m)


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
