"""Actions of drivers: pedals and steering, or manoeuvres that the library carries out."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats32
from siren_ros.running.seat.gaps import is_free
from siren_ros.running.seat.sight import Sight
from siren_ros.running.seat.speeds import (
    emv_waits,
    indicators,
    speed_to_leader,
    speed_to_limit,
    speed_to_passing_emv,
    speed_to_red,
)
from siren_ros.running.seat.steering import steered
from siren_ros.simulation.dynamics.parameters import VehicleParameters
from siren_ros.simulation.world.actors import ActorClass, Lights, indicator_to
from siren_ros.simulation.world.commands import AvControl

HARDEST_DRIVE_MPS2: Final = 3.0
HARDEST_BRAKE_MPS2: Final = 8.0
ACROSS_MPS2: Final = 4.0
"""Lateral acceleration for a steering action of 1."""
LARGEST_STEER_RAD: Final = 0.5
"""Largest steering angle."""
_INDICATES: Final = 1.0 / 3.0
_SHOULDER_PACE_MPS: Final = 5.0
"""Speed of a vehicle that pulls over and has not reached the edge."""
_HARDEST_MPS2: Final = 3.0
"""Hardest braking, except for STOP."""
_EDGE_M: Final = 0.15
"""Distance kept to the edge of the road."""
_AT_EDGE_M: Final = 0.15
"""A vehicle within this distance of its position at the edge stops there."""
_THERE_M: Final = 0.4
"""A vehicle within this distance of its target offset has reached it."""


class Manoeuvre(IntEnum):
    """An action of the kind ``manoeuvre``."""

    KEEP = 0
    """Drive in the present lane."""
    LEFT = 1
    """Change to the next lane on the left, if there is one."""
    RIGHT = 2
    """Change to the next lane on the right, if there is one."""
    PULL_OVER = 3
    """Go to the edge of the road (from the leftmost of several lanes to the left edge, otherwise to the right) and stop
    there outside junctions; drive on slowly along the edge if an EMV cannot pass."""
    STOP = 4
    """Stop at the present offset."""


@dataclass(frozen=True)
class Aim:
    """Target of a driver after its last manoeuvre."""

    manoeuvre: Manoeuvre = Manoeuvre.KEEP
    lane: int = 0
    """Number of its lane, counted from the path's lane, positive to the left."""
    offset_m: float = 0.0
    """Offset at which it stops, for STOP."""


def aim_of(aim: Aim, manoeuvre: Manoeuvre, sight: Sight) -> Aim:
    """Target after a requested manoeuvre. A lane change is completed before the next one begins."""
    lanes, row = sight.way.lanes, sight.way.row(sight.s_m)
    lane = lanes.lane_there(row, aim.lane)
    if manoeuvre is Manoeuvre.STOP:
        return Aim(manoeuvre, lane, aim.offset_m if aim.manoeuvre is Manoeuvre.STOP else sight.left_m)
    if manoeuvre is Manoeuvre.PULL_OVER:
        present = lane if aim.manoeuvre is manoeuvre else lanes.lane_at(row, sight.left_m)
        return Aim(manoeuvre, lanes.leftmost(row) if lanes.is_leftmost(row, present) else lanes.rightmost(row))
    change = {Manoeuvre.LEFT: 1, Manoeuvre.RIGHT: -1}.get(manoeuvre, 0)
    if change and not sight.in_junction and abs(lanes.offset_m(row, lane) - sight.left_m) < _THERE_M:
        lane = lanes.lane_there(row, lane + change)
    return Aim(manoeuvre, lane)


def by_manoeuvre(aim: Aim, sight: Sight, emergency_mps: float | None = None) -> AvControl:
    """Pedals, steering and indicators for a target; it obeys the speed limit, its leader and red lines.

    It moves to the side where nobody is beside it or comes there.

    Args:
        aim: Where it goes.
        sight: The step.
        emergency_mps: The speed that an EMV means to have; red lines do not stop it. None for everybody else.
    """
    lanes, row = sight.way.lanes, sight.way.row(sight.s_m)
    offset_m, hardest_mps2 = lanes.offset_m(row, aim.lane), _HARDEST_MPS2
    if aim.manoeuvre is Manoeuvre.PULL_OVER:
        from_edge_m = 0.5 * sight.width_m + _EDGE_M
        offset_m = float(sight.way.right_m[row]) + from_edge_m
        if lanes.is_leftmost(row, aim.lane):
            offset_m = lanes.offset_m(row, aim.lane) + 0.5 * float(lanes.width_m[row]) - from_edge_m
    elif aim.manoeuvre is Manoeuvre.STOP:
        offset_m, hardest_mps2 = aim.offset_m, 6.0
    wanted = min(speed_to_limit(sight), speed_to_leader(sight, offset_m))
    wanted = min(wanted, speed_to_red(sight) if emergency_mps is None else emergency_mps)
    away_m = offset_m - sight.left_m
    if aim.manoeuvre is Manoeuvre.STOP:
        wanted = 0.0
    elif aim.manoeuvre is Manoeuvre.PULL_OVER and not sight.in_junction:
        stands = abs(away_m) < _AT_EDGE_M and not emv_waits(sight)
        wanted = min(wanted, speed_to_passing_emv(sight), 0.0 if stands else _SHOULDER_PACE_MPS)
    lights = indicators(sight)
    if abs(away_m) > _THERE_M and not sight.in_junction:
        lights = indicator_to(away_m)
    moved_m = offset_m if is_free(offset_m, sight) else sight.left_m
    return steered(sight, wanted, moved_m, lights, hardest_mps2)


def by_pedals(action: Floats32, sight: Sight, vehicles: Mapping[ActorClass, VehicleParameters]) -> AvControl:
    """Control for an action of kind ``continuous``: acceleration, steering and indicator, each from −1 to 1.

    An acceleration of 1 asks for 3 m/s², one of −1 for 8 m/s² of braking. A wheel of 1 turns left by the angle that
    gives 4 m/s² across at the present speed, at most 0.5 rad. An indicator above 1/3 is the left one, below −1/3 the
    right one.
    """
    push, wheel, indicator = (float(value) for value in np.clip(action, -1.0, 1.0))
    vehicle = vehicles[sight.body.actor_class]
    throttle = min(max(push, 0.0) * HARDEST_DRIVE_MPS2 / vehicle.max_drive_accel_mps2, 1.0)
    brake = min(max(-push, 0.0) * HARDEST_BRAKE_MPS2 / vehicle.max_brake_decel_mps2, 1.0)
    bend_1pm = ACROSS_MPS2 / max(sight.speed_mps, 1.0) ** 2
    steer = wheel * min(math.atan(vehicle.wheelbase_m * bend_1pm), LARGEST_STEER_RAD)
    lights = indicator_to(indicator) if abs(indicator) > _INDICATES else int(Lights.NONE)
    return AvControl(sight.step, throttle, brake, steer, lights)
