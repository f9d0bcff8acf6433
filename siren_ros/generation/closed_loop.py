"""The closed loop of an episode without ROS: the library calls of the node graph, in the same order.

It serves studies of behaviour that need neither topics nor sensors, and tests. Data that the nodes exchange over DDS
is passed directly; the states are the same.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

from siren_ros.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.behaviour.driving.step_view import BehaviourWorld
from siren_ros.behaviour.emv.controller import EmvState, step_emv
from siren_ros.dynamics.fleet import FleetState, step_fleet
from siren_ros.dynamics.parameters import load_vehicle_parameters
from siren_ros.generation.behaviour_setup import behaviour_world
from siren_ros.generation.episode_setup import EpisodeSetup
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.traffic.config import RESIDUAL_LIMIT_M
from siren_ros.traffic.observation import check_no_teleport, check_residual
from siren_ros.traffic.simulation import SumoSimulation
from siren_ros.world.actors import ActorDescription, ActorStates
from siren_ros.world.commands import AV_SOURCE, AvControl, VehicleCommands, av_commands
from siren_ros.world.traffic_state import Event, TrafficState, hash_state


@dataclass(frozen=True)
class LoopStep:
    """The messages of all nodes of the loop at one step."""

    traffic: TrafficState
    commands: tuple[VehicleCommands, ...]
    """Of the EMV controller and of the yield manager, and of the AV's controller where there is one."""
    states: ActorStates
    events: tuple[Event, ...]

    @property
    def state_hash(self) -> int:
        """Hash of the actor states and the signals, as the events of the step carry it."""
        return hash_state(self.states, self.traffic.signals)


def closed_loop(
    setup: EpisodeSetup,
    steps: int,
    residual_limit_m: float = RESIDUAL_LIMIT_M,
    answers: Sequence[VehicleCommands] = (),
    world: BehaviourWorld | None = None,
) -> Generator[LoopStep, None, None]:
    """Runs an episode's behaviour, dynamics and traffic step by step.

    Args:
        setup: The episode.
        steps: Number of steps.
        residual_limit_m: Distance between SUMO's and the simulated pose above which the episode fails.
        answers: Commands of the AV's controller, one for each step; without a command the AV rolls.
        world: What the controllers are given; None for what the episode's description says. With another one an
            episode is not the one that its description makes again.

    Raises:
        EpisodeError: As in the node graph: SUMO teleported a vehicle, or the residual passed its limit.
    """
    world = world or behaviour_world(setup.description, setup.compiled_map.read_bytes())
    vehicles = load_vehicle_parameters(setup.description.files)
    emv, civilians = EmvState(), YieldState()
    fleet = FleetState.empty(vehicles, left_hand=setup.network.left_hand)
    states: ActorStates | None = None
    with SumoSimulation(
        setup.compiled_map, setup.network, setup.plan, setup.level, seed=setup.description.seed
    ) as simulation:
        for step in range(steps):
            traffic = simulation.step(step, states)
            check_no_teleport(traffic)
            emv, emv_commands = step_emv(emv, traffic, world)
            civilians, yield_commands = step_yield(civilians, traffic, world)
            commands = (emv_commands, yield_commands, *_av_commands(setup, traffic, answers))
            fleet, states, events = step_fleet(fleet, traffic, commands)
            check_residual(states, residual_limit_m)
            yield LoopStep(traffic, commands, states, events)


def _av_commands(
    setup: EpisodeSetup, traffic: TrafficState, answers: Sequence[VehicleCommands]
) -> tuple[VehicleCommands, ...]:
    """The AV's command at a step: its controller's answer to the step before."""
    av_id, before = setup.description.av_id, traffic.step - 1
    if av_id not in traffic.actor_id:
        return ()
    if 0 <= before < len(answers):
        return (replace(answers[before], step=traffic.step),)
    return (av_commands(AvControl(before), traffic.step, av_id),)


def record_of(setup: EpisodeSetup, steps: list[LoopStep]) -> EpisodeRecord:
    """The record of these steps, as their bag would give it; for predicates and pictures."""
    actors: dict[int, ActorDescription] = {actor.actor_id: actor for step in steps for actor in step.traffic.spawned}
    commands: dict[str, list[VehicleCommands]] = {}
    for step in steps:
        for command in step.commands:
            if command.source != AV_SOURCE:
                commands.setdefault(command.source, []).append(command)
    return EpisodeRecord(
        description=setup.description,
        network=setup.network,
        map_xml=setup.compiled_map.read_bytes(),
        actors=dict(sorted(actors.items())),
        states=tuple(step.states for step in steps),
        traffic=tuple(step.traffic for step in steps),
        commands={source: tuple(rows) for source, rows in sorted(commands.items())},
        events=tuple(event for step in steps for event in step.events),
        outcome=None,
        complete=False,
        topics={},
        state_hashes={step.states.step: step.state_hash for step in steps},
    )
