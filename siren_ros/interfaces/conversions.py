"""The states, commands and events of a step as messages: paired functions ``to_X`` and ``from_X``, exact inverses.

``to_X(value)`` makes a message, ``from_X(message)`` reads one, from a topic or from a bag.
"""

from typing import Any

import numpy as np

from siren_ros.interfaces.messages import (
    as_arrays,
    as_sequences,
    checks_content,
    from_plain_fields,
    json_object,
    json_text,
    make_message,
    plain_fields,
    stamp,
)
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorDescription, ActorStates
from siren_ros.world.commands import COMMAND_DTYPES, VehicleCommands
from siren_ros.world.traffic_state import TRAFFIC_STATE_DTYPES, EmvAdvice, Event, SignalState, TrafficState


def to_event(event: Event) -> Any:
    """``siren_msgs/Event``."""
    detail = json_text(dict(event.detail))
    return make_message("siren_msgs/msg/Event", **plain_fields(event, "detail"), detail=detail)


@checks_content
def from_event(message: Any) -> Event:
    """Inverse of ``to_event``."""
    return from_plain_fields(Event, message, detail=json_object(message.detail))


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
    colour_rgb = np.array(actor.colour_rgb, dtype=np.uint8)
    return make_message("siren_msgs/msg/ActorDescription", **plain_fields(actor, "colour_rgb"), colour_rgb=colour_rgb)


@checks_content
def from_actor_description(message: Any) -> ActorDescription:
    """Inverse of ``to_actor_description``."""
    red, green, blue = (int(value) for value in message.colour_rgb)
    return from_plain_fields(ActorDescription, message, colour_rgb=(red, green, blue))


def to_signal_state(signal: SignalState) -> Any:
    """``siren_msgs/SignalState``."""
    return make_message("siren_msgs/msg/SignalState", **plain_fields(signal))


@checks_content
def from_signal_state(message: Any) -> SignalState:
    """Inverse of ``to_signal_state``."""
    return from_plain_fields(SignalState, message)


def to_emv_advice(advice: EmvAdvice) -> Any:
    """``siren_msgs/EmvAdvice``."""
    return make_message("siren_msgs/msg/EmvAdvice", **plain_fields(advice))


@checks_content
def from_emv_advice(message: Any) -> EmvAdvice:
    """Inverse of ``to_emv_advice``."""
    return from_plain_fields(EmvAdvice, message)


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
