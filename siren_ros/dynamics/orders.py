"""The controllers' commands merged into one row per actor: one owner per actor, contradictions refused."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.errors import EpisodeError
from siren_ros.numerics.arrays import Codes, Floats, Ids
from siren_ros.world.actors import NO_ACTOR, Lights, Mode, Owner, rows_of_ids
from siren_ros.world.commands import VehicleCommands
from siren_ros.world.traffic_state import TrafficState

_HAZARD_LIGHTS: Final = Lights.INDICATOR_LEFT | Lights.INDICATOR_RIGHT
_SUMO: Final = np.uint8(Owner.SUMO)
_NOMINAL: Final = np.uint8(Mode.NOMINAL)
"""numpy takes several times as long to fill an array with the member of an enumeration."""
_TAKEN_OVER: Final = ("owner", "throttle", "brake", "steer_rad", "mode", "lights")


@dataclass(frozen=True)
class Orders:
    """What is asked of every actor at one step; rows as in ``TrafficState``."""

    owner: Codes
    throttle: Floats
    brake: Floats
    steer_rad: Floats
    hand_brake: npt.NDArray[np.bool_]
    mode: Codes
    lights: Codes


def merge_commands(traffic: TrafficState, commands: Sequence[VehicleCommands]) -> Orders:
    """All controllers' commands on the rows of ``traffic``.

    Actors without a command belong to SUMO, are in mode NOMINAL and show SUMO's lights. Commands for actors
    that were removed at this step are void.

    Raises:
        EpisodeError: two commands for one actor, a command for an unknown actor, or one that is not finite.
    """
    n = len(traffic)
    pedals_and_steer = np.zeros(n), np.zeros(n), np.zeros(n)
    hand_brake, mode = np.zeros(n, dtype=bool), np.full(n, _NOMINAL)
    orders = Orders(np.full(n, _SUMO), *pedals_and_steer, hand_brake, mode, traffic.lights.copy())
    source_of = np.full(n, NO_ACTOR, np.intp)
    for number, command in enumerate(commands, start=1):
        if not len(command):
            continue
        rows = rows_of_ids(traffic.actor_id, command.actor_id)
        _check(traffic, commands, command, rows, source_of)
        known = rows >= 0
        if not known.all():
            rows = rows[known]
        source_of[rows] = number
        orders.hand_brake[rows] = command.hand_brake[known] != 0
        for name in _TAKEN_OVER:
            getattr(orders, name)[rows] = getattr(command, name)[known]
    return orders


def stopped_orders(orders: Orders, actor_id: Ids, stopped: Sequence[int], steer_rad: Floats) -> Orders:
    """Orders of which those for stopped actors are replaced: full brake, wheels at present angles, hazard lights."""
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
        lights=np.where(rows, orders.lights | np.uint8(_HAZARD_LIGHTS), orders.lights),
    )


def _check(
    traffic: TrafficState,
    commands: Sequence[VehicleCommands],
    command: VehicleCommands,
    rows: npt.NDArray[np.intp],
    source_of: npt.NDArray[np.intp],
) -> None:
    unknown = command.actor_id[rows < 0]
    if len(unknown) and not np.isin(unknown, traffic.removed).all():
        raise EpisodeError(f"{command.source} commands actors {unknown.tolist()}, unknown at step {traffic.step}")
    if len(frozenset(command.actor_id.tolist())) < len(command):
        raise EpisodeError(f"{command.source} commands an actor twice at step {traffic.step}")
    taken = source_of[rows[rows >= 0]]
    if taken.any():
        other = commands[int(taken.max()) - 1].source
        actor = int(command.actor_id[rows >= 0][np.argmax(taken > 0)])
        raise EpisodeError(f"{command.source} and {other} both command actor {actor} at step {traffic.step}")
    finite = np.isfinite(command.throttle + command.brake + command.steer_rad)
    if not finite.all():
        actor = int(command.actor_id[np.argmin(finite)])
        raise EpisodeError(f"{command.source} commands actor {actor} by values that are not finite")
