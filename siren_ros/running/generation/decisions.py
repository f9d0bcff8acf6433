"""Computes the drivers' decisions of a recorded episode again: which mechanism limited whom, and why."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EpisodeError
from siren_ros.running.generation.behaviour_setup import behaviour_world
from siren_ros.running.generation.replay_check import first_mismatch
from siren_ros.simulation.behaviour.civilians.yield_manager import SOURCE as YIELD_SOURCE
from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.behaviour.driving.free_space import SpeedLimit
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import MECHANISMS
from siren_ros.simulation.behaviour.emv.controller import SOURCE as EMV_SOURCE
from siren_ros.simulation.behaviour.emv.controller import EmvState, step_emv
from siren_ros.simulation.behaviour.guards import GuardState, civilian_guards, emv_guards
from siren_ros.simulation.world.actors import Mode, Owner
from siren_ros.simulation.world.commands import VehicleCommands

_SOURCES: Final = (EMV_SOURCE, YIELD_SOURCE)


@dataclass(frozen=True)
class Decision:
    """Why an EMV or a yielding civilian acted as it did at a step."""

    mode: Mode
    target_mps: float
    """Target speed of its mode; NaN if SUMO drives."""
    limits: Mapping[str, SpeedLimit]
    """Speed limits by mechanism (``MECHANISMS``), without those that limit nothing; empty if SUMO drives."""
    guards: tuple[GuardState, ...]


def decisions_of(record: EpisodeRecord) -> Iterator[tuple[int, Mapping[int, Decision]]]:
    """Each step with its decisions by actor.

    Raises:
        EpisodeError: The record does not hold its template's values, or the present code decides otherwise than the
            record says: another version made the episode.
    """
    if not record.description.template_values:
        raise EpisodeError("the record does not hold the values of its template")
    world = behaviour_world(record.description, record.map_xml)
    recorded = {
        source: {commands.step: commands for commands in record.commands.get(source, ())} for source in _SOURCES
    }
    emvs, civilians = EmvState(), YieldState()
    for traffic in record.traffic:
        emvs, emv_commands = step_emv(emvs, traffic, world)
        civilians, yield_commands = step_yield(civilians, traffic, world)
        modes: dict[int, tuple[Mode, Owner]] = {}
        for commands in (emv_commands, yield_commands):
            _check(commands, recorded[commands.source])
            rows = zip(commands.actor_id.tolist(), commands.mode.tolist(), commands.owner.tolist(), strict=True)
            modes |= {actor_id: (Mode(mode), Owner(owner)) for actor_id, mode, owner in rows}
        decided = {}
        for actor_id, (mode, owner) in modes.items():
            unit = emvs.units.get(actor_id)
            if unit is not None:
                navigator, guards = unit.navigator, emv_guards(unit, traffic.step, world)
            elif actor_id in civilians.units:
                civilian = civilians.units[actor_id]
                navigator, guards = civilian.navigator, civilian_guards(civilian, traffic.step, world)
            else:
                continue
            decided[actor_id] = _decision(mode, navigator if owner is Owner.ROS else NavigatorState(), guards)
        yield traffic.step, decided


def _decision(mode: Mode, navigator: NavigatorState, guards: tuple[GuardState, ...]) -> Decision:
    allowed = zip(MECHANISMS, navigator.limits, strict=False)
    limits = {mechanism.name: limit for mechanism, limit in allowed if limit.speed_mps < math.inf}
    return Decision(mode, navigator.target_mps if navigator.limits else math.nan, limits, guards)


def _check(decided: VehicleCommands, recorded: Mapping[int, VehicleCommands]) -> None:
    """Compare with the recorded commands of the step, if the bag has them."""
    before = recorded.get(decided.step)
    if before is None:
        return
    difference = first_mismatch(before, replace(decided, events=before.events))  # events have a topic of their own
    if difference is not None:
        raise EpisodeError(
            f"the present version decides otherwise at step {decided.step}: {difference.name} of {decided.source} "
            f"was {difference.recorded}, is {difference.repeated}"
        )
