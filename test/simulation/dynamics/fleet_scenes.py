"""What SUMO says of a fleet, and commands to it, written in one line."""

from collections.abc import Mapping, Sequence

import hand_made_record
import numpy as np

from siren_ros.simulation.dynamics.fleet import FleetState, step_fleet
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.world.actors import (
    ActorClass,
    ActorDescription,
    ActorStates,
    Event,
    EventKind,
    Lights,
    Mode,
    Owner,
    TrafficState,
)
from siren_ros.simulation.world.commands import COMMAND_DTYPES, VehicleCommands

PARAMETERS = load_vehicle_parameters()


def description(actor_id: int, kind: ActorClass = ActorClass.SEDAN) -> ActorDescription:
    vehicle = PARAMETERS[kind]
    return ActorDescription(
        actor_id, f"v{actor_id}", kind, vehicle.length_m, vehicle.width_m, vehicle.height_m, (200, 30, 30)
    )


def traffic_of(
    step: int,
    rows: Mapping[int, tuple[float, float, float, float]],
    spawned: Sequence[ActorDescription] = (),
    removed: Sequence[int] = (),
    lights: Mapping[int, Lights] | None = None,
    events: tuple[Event, ...] = (),
) -> TrafficState:
    """SUMO's rows by actor id: x, y, yaw, speed."""
    ids = sorted(rows)
    told = {"actor_id": ids, "lights": [(lights or {}).get(i, 0) for i in ids], "removed": removed}
    return hand_made_record.traffic_of(
        step, poses=[rows[i] for i in ids], spawned=tuple(spawned), events=events, **told
    )


def command_of(
    step: int,
    actor_id: int,
    owner: Owner = Owner.ROS,
    throttle: float = 0.0,
    brake: float = 0.0,
    steer: float = 0.0,
    mode: Mode = Mode.ROUTE_FOLLOW,
    lights: Lights = Lights.NONE,
    source: str = "emv_controller",
    events: tuple[Event, ...] = (),
) -> VehicleCommands:
    row = {"actor_id": actor_id, "owner": owner, "mode": mode, "lights": lights}
    row |= {"throttle": throttle, "brake": brake, "steer_rad": steer}
    columns = {name: np.array([row.get(name, 0)], dtype) for name, dtype in COMMAND_DTYPES.items()}
    return VehicleCommands(step=step, source=source, events=events, **columns)


def stacked(*commands: VehicleCommands) -> VehicleCommands:
    arrays = {name: np.concatenate([getattr(command, name) for command in commands]) for name in COMMAND_DTYPES}
    return VehicleCommands(step=commands[0].step, source=commands[0].source, events=(), **arrays)


def kinds(events: Sequence[Event]) -> list[EventKind]:
    return [event.kind for event in events]


def begun(*rows: tuple[float, float, float, float]) -> tuple[FleetState, ActorStates]:
    """Sedans with ids from 1 on that stand at these rows at step 0."""
    spawned = [description(i) for i in range(1, len(rows) + 1)]
    traffic = traffic_of(0, dict(enumerate(rows, start=1)), spawned)
    return step_fleet(FleetState.empty(PARAMETERS), traffic, ())[:2]


def started(count: int = 1, speed_mps: float = 10.0) -> tuple[FleetState, ActorStates]:
    return begun(*((0.0, 50.0 * i, 0.0, speed_mps) for i in range(1, count + 1)))
