"""The project's own message types: paired functions ``to_X`` and ``from_X``, exact inverses.

``to_X(value)`` makes a message, ``from_X(message)`` reads one, from a topic or from a bag. Only the wall time in
StepDone is not simulated data.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from siren_ros.interfaces.audio import from_audio
from siren_ros.interfaces.av_control import from_av_control
from siren_ros.interfaces.image_boxes import from_camera_truth
from siren_ros.interfaces.lockstep_reports import EpisodeClosing, Phase, StepReport
from siren_ros.interfaces.message_content import checks_content, json_object, json_text
from siren_ros.interfaces.messages import as_arrays, as_sequences, header, make_message, sequence, stamp
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome
from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorDescription, ActorStates
from siren_ros.world.commands import COMMAND_DTYPES, VehicleCommands
from siren_ros.world.events import Event, EventKind
from siren_ros.world.ground_truth import GROUND_TRUTH_DTYPES, GroundTruth
from siren_ros.world.traffic_state import TRAFFIC_STATE_DTYPES, EmvAdvice, SignalState, TrafficState


def to_event(event: Event) -> Any:
    """``siren_msgs/Event``."""
    return make_message(
        "siren_msgs/msg/Event",
        step=event.step,
        kind=event.kind.value,
        actor_id=event.actor_id,
        other_id=event.other_id,
        x_m=float(event.x_m),
        y_m=float(event.y_m),
        detail=json_text(dict(event.detail)),
    )


@checks_content
def from_event(message: Any) -> Event:
    """Inverse of ``to_event``."""
    return Event(
        step=int(message.step),
        kind=EventKind(message.kind),
        actor_id=int(message.actor_id),
        other_id=int(message.other_id),
        x_m=float(message.x_m),
        y_m=float(message.y_m),
        detail=json_object(message.detail),
    )


def _to_events(events: tuple[Event, ...]) -> list[Any]:
    return [to_event(event) for event in events]


def _from_events(messages: Any) -> tuple[Event, ...]:
    return tuple(from_event(message) for message in messages)


def to_events(step: int, state_hash: int, events: tuple[Event, ...]) -> Any:
    """``siren_msgs/Events`` of one step, with the hash of the world's state at it."""
    return make_message(
        "siren_msgs/msg/Events",
        stamp=stamp(time_ns_of_step(step)),
        step=step,
        state_hash=state_hash,
        events=_to_events(events),
    )


@checks_content
def from_events(message: Any) -> tuple[int, int, tuple[Event, ...]]:
    """Inverse of ``to_events``: the step, the hash of its state and its events."""
    return int(message.step), int(message.state_hash), _from_events(message.events)


def to_actor_description(actor: ActorDescription) -> Any:
    """``siren_msgs/ActorDescription``."""
    return make_message(
        "siren_msgs/msg/ActorDescription",
        actor_id=actor.actor_id,
        name=actor.name,
        actor_class=int(actor.actor_class),
        length_m=float(actor.length_m),
        width_m=float(actor.width_m),
        height_m=float(actor.height_m),
        colour_rgb=np.array(actor.colour_rgb, dtype=np.uint8),
        is_emv=actor.is_emv,
    )


@checks_content
def from_actor_description(message: Any) -> ActorDescription:
    """Inverse of ``to_actor_description``."""
    red, green, blue = (int(value) for value in message.colour_rgb)
    return ActorDescription(
        actor_id=int(message.actor_id),
        name=str(message.name),
        actor_class=ActorClass(int(message.actor_class)),
        length_m=float(message.length_m),
        width_m=float(message.width_m),
        height_m=float(message.height_m),
        colour_rgb=(red, green, blue),
        is_emv=bool(message.is_emv),
    )


def to_signal_state(signal: SignalState) -> Any:
    """``siren_msgs/SignalState``."""
    return make_message("siren_msgs/msg/SignalState", signal_id=signal.signal_id, state=signal.state)


@checks_content
def from_signal_state(message: Any) -> SignalState:
    """Inverse of ``to_signal_state``."""
    return SignalState(signal_id=str(message.signal_id), state=str(message.state))


def to_emv_advice(advice: EmvAdvice) -> Any:
    """``siren_msgs/EmvAdvice``."""
    return make_message(
        "siren_msgs/msg/EmvAdvice",
        actor_id=advice.actor_id,
        lane_change_intent=advice.lane_change_intent,
        leader_id=advice.leader_id,
        leader_gap_m=float(advice.leader_gap_m),
        speed_without_control_mps=float(advice.speed_without_control_mps),
        rescue_count=advice.rescue_count,
    )


@checks_content
def from_emv_advice(message: Any) -> EmvAdvice:
    """Inverse of ``to_emv_advice``."""
    return EmvAdvice(
        actor_id=int(message.actor_id),
        lane_change_intent=int(message.lane_change_intent),
        leader_id=int(message.leader_id),
        leader_gap_m=float(message.leader_gap_m),
        speed_without_control_mps=float(message.speed_without_control_mps),
        rescue_count=int(message.rescue_count),
    )


def to_traffic_state(traffic: TrafficState) -> Any:
    """``siren_msgs/TrafficState``."""
    return make_message(
        "siren_msgs/msg/TrafficState",
        stamp=stamp(time_ns_of_step(traffic.step)),
        step=traffic.step,
        spawned=[to_actor_description(actor) for actor in traffic.spawned],
        emvs=[to_emv_advice(advice) for advice in traffic.emvs],
        signals=[to_signal_state(signal) for signal in traffic.signals],
        events=_to_events(traffic.events),
        **as_sequences(traffic, list(TRAFFIC_STATE_DTYPES)),
    )


@checks_content
def from_traffic_state(message: Any) -> TrafficState:
    """Inverse of ``to_traffic_state``."""
    return TrafficState(
        step=int(message.step),
        spawned=tuple(from_actor_description(actor) for actor in message.spawned),
        emvs=tuple(from_emv_advice(advice) for advice in message.emvs),
        signals=tuple(from_signal_state(signal) for signal in message.signals),
        events=_from_events(message.events),
        **as_arrays(message, TRAFFIC_STATE_DTYPES),
    )


def to_vehicle_commands(commands: VehicleCommands) -> Any:
    """``siren_msgs/VehicleCommands``."""
    return make_message(
        "siren_msgs/msg/VehicleCommands",
        stamp=stamp(time_ns_of_step(commands.step)),
        step=commands.step,
        source=commands.source,
        events=_to_events(commands.events),
        **as_sequences(commands, list(COMMAND_DTYPES)),
    )


@checks_content
def from_vehicle_commands(message: Any) -> VehicleCommands:
    """Inverse of ``to_vehicle_commands``."""
    return VehicleCommands(
        step=int(message.step),
        source=str(message.source),
        events=_from_events(message.events),
        **as_arrays(message, COMMAND_DTYPES),
    )


def to_actor_states(states: ActorStates) -> Any:
    """``siren_msgs/ActorStates``."""
    return make_message(
        "siren_msgs/msg/ActorStates",
        stamp=stamp(time_ns_of_step(states.step)),
        step=states.step,
        **as_sequences(states, list(ACTOR_STATE_DTYPES)),
    )


@checks_content
def from_actor_states(message: Any) -> ActorStates:
    """Inverse of ``to_actor_states``."""
    return ActorStates(step=int(message.step), **as_arrays(message, ACTOR_STATE_DTYPES))


def to_ground_truth(truth: GroundTruth) -> Any:
    """``siren_msgs/GroundTruth``."""
    return make_message(
        "siren_msgs/msg/GroundTruth",
        header=header(time_ns_of_step(truth.step), truth.frame_id),
        step=truth.step,
        carrier_id=truth.carrier_id,
        **as_sequences(truth, list(GROUND_TRUTH_DTYPES)),
    )


@checks_content
def from_ground_truth(message: Any) -> GroundTruth:
    """Inverse of ``to_ground_truth``."""
    return GroundTruth(
        step=int(message.step),
        carrier_id=int(message.carrier_id),
        frame_id=str(message.header.frame_id),
        **as_arrays(message, GROUND_TRUTH_DTYPES),
    )


def to_step_done(report: StepReport) -> Any:
    """``siren_msgs/StepDone``."""
    return make_message(
        "siren_msgs/msg/StepDone",
        step=report.step,
        participant=report.participant,
        phase=int(report.phase),
        error=report.error,
        busy_s=float(report.busy_s),
    )


@checks_content
def from_step_done(message: Any) -> StepReport:
    """Inverse of ``to_step_done``."""
    return StepReport(
        step=int(message.step),
        participant=str(message.participant),
        phase=Phase(int(message.phase)),
        error=str(message.error),
        busy_s=float(message.busy_s),
    )


def to_episode_description(episode: EpisodeDescription) -> Any:
    """``siren_msgs/EpisodeDescription``."""
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
    """Inverse of ``to_episode_description``."""
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
    """``siren_msgs/EpisodeEnd``."""
    return make_message(
        "siren_msgs/msg/EpisodeEnd",
        stamp=stamp(time_ns_of_step(max(closing.steps - 1, 0))),
        steps=closing.steps,
        end=closing.end.value,
        reason=closing.reason,
    )


@checks_content
def from_episode_end(message: Any) -> EpisodeClosing:
    """Inverse of ``to_episode_end``."""
    return EpisodeClosing(steps=int(message.steps), end=EpisodeEnd(message.end), reason=str(message.reason))


def to_episode_outcome(outcome: EpisodeOutcome) -> Any:
    """``siren_msgs/EpisodeOutcome``."""
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
    """Inverse of ``to_episode_outcome``."""
    return EpisodeOutcome(
        end=EpisodeEnd(message.end),
        reason=str(message.reason),
        steps=int(message.steps),
        predicate_holds=None if int(message.predicate) < 0 else bool(message.predicate),
        measures=json_object(message.measures),
    )


READERS: dict[str, Callable[[Any], Any]] = {
    "siren_msgs/msg/Event": from_event,
    "siren_msgs/msg/Events": from_events,
    "siren_msgs/msg/ActorDescription": from_actor_description,
    "siren_msgs/msg/SignalState": from_signal_state,
    "siren_msgs/msg/EmvAdvice": from_emv_advice,
    "siren_msgs/msg/TrafficState": from_traffic_state,
    "siren_msgs/msg/VehicleCommands": from_vehicle_commands,
    "siren_msgs/msg/AvControl": from_av_control,
    "siren_msgs/msg/ActorStates": from_actor_states,
    "siren_msgs/msg/GroundTruth": from_ground_truth,
    "siren_msgs/msg/CameraTruth": from_camera_truth,
    "siren_msgs/msg/AudioChunk": from_audio,
    "siren_msgs/msg/StepDone": from_step_done,
    "siren_msgs/msg/EpisodeDescription": from_episode_description,
    "siren_msgs/msg/EpisodeEnd": from_episode_end,
    "siren_msgs/msg/EpisodeOutcome": from_episode_outcome,
}
"""The reading half of every pair, by message type."""
