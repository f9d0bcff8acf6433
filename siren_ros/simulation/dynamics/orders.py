"""Merges the controllers' commands into one row per actor; contradictions are errors."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, Rows
from siren_ros.base.numerics.compiled import compiled
from siren_ros.errors import EpisodeError
from siren_ros.simulation.world.actors import Lights, Mode, Owner, rows_of_ids
from siren_ros.simulation.world.commands import VehicleCommands
from siren_ros.simulation.world.traffic_state import TrafficState

_SUMO: Final = np.uint8(Owner.SUMO)
_NOMINAL: Final = np.uint8(Mode.NOMINAL)
"""A plain number, because numpy is several times slower with members of enumerations."""
_THROTTLE, _BRAKE, _STEER = range(3)
"""Rows of pedals."""
_OWNER, _MODE, _LIGHTS = range(3)
"""Rows of codes."""


class Orders(NamedTuple):
    """Commands for all actors at one step; rows as in ``TrafficState``."""

    owner: Codes
    throttle: Floats
    brake: Floats
    steer_rad: Floats
    hand_brake: npt.NDArray[np.bool_]
    mode: Codes
    lights: Codes


def merge_commands(traffic: TrafficState, commands: Sequence[VehicleCommands]) -> Orders:
    """Merge all controllers' commands on the rows of ``traffic``.

    Actors without a command belong to SUMO, are in mode NOMINAL and show SUMO's lights. Commands for actors
    that were removed at this step are void.

    Raises:
        EpisodeError: two commands for one actor, a command for an unknown actor, or one that is not finite.
    """
    n = len(traffic)
    pedals, codes, hand_brake = np.zeros((3, n)), np.zeros((3, n), np.uint8), np.zeros(n, np.bool_)
    codes[_OWNER], codes[_MODE], codes[_LIGHTS] = _SUMO, _NOMINAL, traffic.lights
    source_of = np.zeros(n, np.intp)
    for number, command in enumerate(commands, start=1):
        if not len(command):
            continue
        asked = command.throttle, command.brake, command.steer_rad
        told = command.hand_brake, command.owner, command.mode, command.lights
        ids = traffic.actor_id, traffic.removed, command.actor_id
        if not _take_over(number, ids, asked, told, pedals, codes, hand_brake, source_of):
            _check(traffic, commands, command, source_of)
    throttle, brake, steer_rad = pedals
    return Orders(codes[_OWNER], throttle, brake, steer_rad, hand_brake, codes[_MODE], codes[_LIGHTS])


@compiled
def _take_over(
    number: int,
    ids: tuple[Ids, Ids, Ids],
    asked: tuple[Floats, Floats, Floats],
    told: tuple[Codes, Codes, Codes, Codes],
    pedals: Floats,
    codes: Codes,
    hand_brake: Flags,
    source_of: Rows,
) -> bool:
    """Put one controller's commands on the rows of their actors; False if something is wrong."""
    (actor_id, removed, commanded), (throttle, brake, steer_rad), (hand, owner, mode, lights) = ids, asked, told
    for n in range(len(commanded)):
        if not np.isfinite(throttle[n] + brake[n] + steer_rad[n]):
            return False
        row = np.searchsorted(actor_id, commanded[n])
        if row == len(actor_id) or actor_id[row] != commanded[n]:
            if not (removed == commanded[n]).any() or (commanded[:n] == commanded[n]).any():
                return False
            continue
        if source_of[row] != 0:
            return False
        source_of[row] = number
        pedals[_THROTTLE, row], pedals[_BRAKE, row], pedals[_STEER, row] = throttle[n], brake[n], steer_rad[n]
        codes[_OWNER, row], codes[_MODE, row], codes[_LIGHTS, row] = owner[n], mode[n], lights[n]
        hand_brake[row] = hand[n] != 0
    return True


def stopped_orders(orders: Orders, actor_id: Ids, stopped: Sequence[int], steer_rad: Floats) -> Orders:
    """Orders in which stopped actors have full brake, unchanged steering angles and hazard lights."""
    rows = np.isin(actor_id, np.array(stopped, dtype=np.uint32)) if stopped else np.zeros(0, dtype=bool)
    if not rows.any():
        return orders
    return Orders(
        owner=np.where(rows, np.uint8(Owner.ROS), orders.owner),
        throttle=np.where(rows, 0.0, orders.throttle),
        brake=np.where(rows, 1.0, orders.brake),
        steer_rad=np.where(rows, steer_rad, orders.steer_rad),
        hand_brake=orders.hand_brake & ~rows,
        mode=np.where(rows, np.uint8(Mode.STOPPED), orders.mode),
        lights=np.where(rows, orders.lights | np.uint8(Lights.INDICATORS), orders.lights),
    )


def _check(
    traffic: TrafficState,
    commands: Sequence[VehicleCommands],
    command: VehicleCommands,
    source_of: npt.NDArray[np.intp],
) -> None:
    """Raise an error for a controller's wrong commands; ``source_of`` has the number of each actor's controller."""
    rows = rows_of_ids(traffic.actor_id, command.actor_id)
    unknown = command.actor_id[rows < 0]
    if len(unknown) and not np.isin(unknown, traffic.removed).all():
        raise EpisodeError(f"{command.source} commands actors {unknown.tolist()}, unknown at step {traffic.step}")
    if len(frozenset(command.actor_id.tolist())) < len(command):
        raise EpisodeError(f"{command.source} commands an actor twice at step {traffic.step}")
    finite = np.isfinite(command.throttle + command.brake + command.steer_rad)
    if not finite.all():
        actor = int(command.actor_id[np.argmin(finite)])
        raise EpisodeError(f"{command.source} commands actor {actor} by values that are not finite")
    own = next(number for number, other in enumerate(commands, start=1) if other is command)
    taken = np.where(source_of[rows] == own, 0, source_of[rows]) * (rows >= 0)
    other, actor = commands[int(taken.max()) - 1].source, int(command.actor_id[np.argmax(taken > 0)])
    raise EpisodeError(f"{command.source} and {other} both command actor {actor} at step {traffic.step}")
