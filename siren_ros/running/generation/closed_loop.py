"""The closed loop of an episode without ROS: the library calls of the node graph, in the same order.

It serves studies of behaviour that need neither topics nor sensors, and tests. Data that the nodes exchange over DDS
is passed directly; the states are the same.
"""

from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.running.generation.behaviour_setup import behaviour_world
from siren_ros.running.generation.episode_setup import EpisodeSetup
from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.behaviour.emv.controller import EmvState, step_emv
from siren_ros.simulation.dynamics.fleet import FleetState, step_fleet
from siren_ros.simulation.dynamics.parameters import load_vehicle_parameters
from siren_ros.simulation.traffic.observation import check_no_teleport, check_residual
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.world.actors import RESIDUAL_LIMIT_M, ActorDescription, ActorStates
from siren_ros.simulation.world.commands import AV_SOURCE, AvControl, Controls, VehicleCommands, av_commands, with_seats
from siren_ros.simulation.world.traffic_state import Event, TrafficState, hash_state


@dataclass(frozen=True)
class LoopStep:
    """The messages of all nodes of the loop at one step."""

    traffic: TrafficState
    commands: tuple[VehicleCommands, ...]
    """Commands of the EMV controller and the yield manager, and of the AV's controller if there is one."""
    states: ActorStates
    events: tuple[Event, ...]

    @property
    def state_hash(self) -> int:
        """Hash of actor states and signals, as in the step's events."""
        return hash_state(self.states, self.traffic.signals)


def closed_loop(
    setup: EpisodeSetup,
    steps: int,
    residual_limit_m: float = RESIDUAL_LIMIT_M,
    world: BehaviourWorld | None = None,
) -> Generator[LoopStep, Controls | None, None]:
    """Run an episode's behaviour, dynamics and traffic step by step.

    It yields each step, and takes by ``send`` what the drivers in seats answer to it. The AV under test is always in a
    seat: without an answer it rolls. Every other actor is in one while it is among the answers; what the model's
    controllers ask of it is then left out.

    Args:
        setup: The episode.
        steps: Number of steps.
        residual_limit_m: Distance between SUMO's and the simulated pose above which the episode fails.
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
    controls: Controls = {}
    with SumoSimulation(
        setup.compiled_map, setup.network, setup.plan, setup.level, seed=setup.description.seed
    ) as simulation:
        for step in range(steps):
            traffic = simulation.step(step, states)
            check_no_teleport(traffic)
            emv, emv_commands = step_emv(emv, traffic, world)
            civilians, yield_commands = step_yield(civilians, traffic, world)
            commands = _with_seats((emv_commands, yield_commands), setup.description.av_id, traffic, controls)
            fleet, states, events = step_fleet(fleet, traffic, commands)
            check_residual(states, residual_limit_m)
            controls = (yield LoopStep(traffic, commands, states, events)) or {}


def driven(
    loop: Generator[LoopStep, Controls | None, None], answer: Callable[[LoopStep], Controls]
) -> Iterator[tuple[LoopStep, Controls]]:
    """Steps of a ``closed_loop`` with the drivers' answers to each."""
    with closing(loop):
        controls: Controls | None = None
        while True:
            try:
                step = loop.send(controls)
            except StopIteration:
                return
            controls = answer(step)
            yield step, controls


def _with_seats(
    commands: tuple[VehicleCommands, ...], av_id: int, traffic: TrafficState, controls: Controls
) -> tuple[VehicleCommands, ...]:
    """Commands of a step with those of external drivers, which are their answers to the previous step."""
    others = {one: control for one, control in controls.items() if one != av_id and one in traffic.actor_id}
    if others:
        emvs = {advice.actor_id for advice in traffic.emvs}
        sides = [{one: others[one] for one in others if (one in emvs) is wanted} for wanted in (True, False)]
        commands = tuple(with_seats(one, side, others) for one, side in zip(commands, sides, strict=True))
    if av_id not in traffic.actor_id:
        return commands
    return (*commands, av_commands(controls.get(av_id, AvControl(traffic.step - 1)), traffic.step, av_id))


def record_of(setup: EpisodeSetup, steps: list[LoopStep]) -> EpisodeRecord:
    """Record of these steps, as from their bag; for predicates and pictures."""
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
