"""What a learned policy gets and what it chooses: observations of kind ``vector``, manoeuvres, pedals and steering.

An observation has own vehicle, road, EMV and neighbours as numbers. Every value is divided by its scale and cut to
[−1, 1]. Places and speeds are in the own frame: x ahead, y left. The library carries the manoeuvres out.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Floats32, Rows
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.running.seat.control import (
    emv_waits,
    indicators,
    is_free,
    speed_to_leader,
    speed_to_limit,
    speed_to_passing_emv,
    speed_to_red,
    steered,
)
from siren_ros.running.seat.sight import Sight
from siren_ros.simulation.dynamics.vehicle_model import VehicleParameters
from siren_ros.simulation.world.actors import ActorClass, Lights, indicator_to
from siren_ros.simulation.world.commands import AvControl

NEIGHBOURS: Final = 8
_NEAR_M: Final = 80.0
"""Range of neighbours."""
_BENDS_M: Final = (10.0, 20.0, 40.0)
"""Distances ahead at which the path's heading is measured."""


@dataclass(frozen=True)
class Feature:
    """One element of the vector."""

    name: str
    meaning: str
    scale: float
    """Value that is scaled to 1."""
    unit: str = ""


OWN: Final = (
    Feature("speed", "own speed", 25.0, "m/s"),
    Feature("acceleration", "along the vehicle", 8.0, "m/s²"),
    Feature("wheel", "angle of the road wheels, left positive", 0.6, "rad"),
    Feature("offset", "of the own centre from the way, left positive", 8.0, "m"),
    Feature("heading", "own heading from the way's", math.pi, "rad"),
    Feature("indicator_left", "1 while it is on", 1.0),
    Feature("indicator_right", "1 while it is on", 1.0),
    Feature("lanes_left", "number of lanes to the left of the way", 4.0),
    Feature("lanes_right", "number of lanes to the right of the way", 4.0),
    Feature("right_edge", "from the own centre to the right edge of the road", 10.0, "m"),
    Feature("limit", "speed limit", 25.0, "m/s"),
    Feature("in_junction", "1 in a junction", 1.0),
    Feature("red", "from the own front to the next red line; 1 without one", 60.0, "m"),
    Feature("line", "from the own front to the next line of a junction; 1 without one", 60.0, "m"),
    *(
        Feature(f"bend_{at:g}", f"heading of the way in {at:g} m, from its heading here", math.pi, "rad")
        for at in _BENDS_M
    ),
    Feature("rest", "way that is left", 500.0, "m"),
)
EMV: Final = (
    Feature("emv_here", "1 where there is another emergency vehicle", 1.0),
    Feature("emv_siren", "1 while its siren sounds", 1.0),
    Feature("emv_x", "place of the nearest one, those with a siren first", 100.0, "m"),
    Feature("emv_y", "the same", 20.0, "m"),
    Feature("emv_speed", "its speed", 25.0, "m/s"),
    Feature("emv_cos", "cosine of its heading from the own one", 1.0),
    Feature("emv_sin", "sine of that", 1.0),
    Feature("emv_behind", "1 where it comes from behind on this road and has not passed", 1.0),
)
NEIGHBOUR: Final = (
    Feature("here", "1 where there is a neighbour number k, the nearest first", 1.0),
    Feature("x", "place of its centre", 80.0, "m"),
    Feature("y", "the same", 20.0, "m"),
    Feature("vx", "its velocity less the own one", 25.0, "m/s"),
    Feature("vy", "the same", 25.0, "m/s"),
    Feature("cos", "cosine of its heading from the own one", 1.0),
    Feature("sin", "sine of that", 1.0),
    Feature("length", "its length", 20.0, "m"),
    Feature("width", "its width", 4.0, "m"),
    Feature("brakes", "1 while its brake light is on", 1.0),
)
VECTOR_SIZE: Final = len(OWN) + len(EMV) + NEIGHBOURS * len(NEIGHBOUR)
_OWN_SCALES: Final = np.array([feature.scale for feature in OWN])
_EMV_SCALES: Final = np.array([feature.scale for feature in EMV])
_NEIGHBOUR_SCALES: Final = np.array([feature.scale for feature in NEIGHBOUR])


def features_of(sight: Sight) -> Floats32:
    """Vector of a step, shape ``(VECTOR_SIZE,)``, with values in [−1, 1]."""
    states, row = sight.states, sight.row
    yaw = float(states.yaw_rad[row])
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx, dy = states.x_m - states.x_m[row], states.y_m - states.y_m[row]
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    distance = np.hypot(dx, dy)
    distance[row] = np.inf
    is_emv = np.array([sight.bodies[actor_id].is_emv for actor_id in states.actor_id.tolist()])
    vector = np.zeros(VECTOR_SIZE)
    vector[: len(OWN)] = _own(sight) / _OWN_SCALES
    others = np.isfinite(distance)
    emvs = np.flatnonzero(is_emv & others)
    if len(emvs):
        silent = (states.lights[emvs] & int(Lights.SIREN)) == 0
        nearest = int(emvs[np.lexsort((distance[emvs], silent))[0]])
        place = float(ahead[nearest]), float(left[nearest])
        vector[len(OWN) : len(OWN) + len(EMV)] = _emv(sight, nearest, place, yaw) / _EMV_SCALES
        others[nearest] = False
    near = np.flatnonzero(others & (distance < _NEAR_M))
    near = near[np.argsort(distance[near], kind="stable")][:NEIGHBOURS]
    if len(near):
        block = _neighbours(sight, near, (ahead, left), (cos, sin)) / _NEIGHBOUR_SCALES
        vector[len(OWN) + len(EMV) :][: block.size] = block.ravel()
    return np.clip(np.where(np.isfinite(vector), vector, 1.0), -1.0, 1.0).astype(np.float32)


def _own(sight: Sight) -> Floats:
    states, row = sight.states, sight.row
    way, at = sight.way, sight.way.row(sight.s_m)
    lights = int(states.lights[row])
    here = float(way.curve.heading_rad(sight.s_m))
    bends = wrap_angle(way.curve.heading_rad(np.array([sight.s_m + ahead for ahead in _BENDS_M])) - here)
    return np.array(
        [
            sight.speed_mps,
            states.accel_mps2[row],
            states.steer_rad[row],
            sight.left_m,
            sight.turn_rad,
            bool(lights & Lights.INDICATOR_LEFT),
            bool(lights & Lights.INDICATOR_RIGHT),
            way.lanes.left[at],
            way.lanes.right[at],
            sight.left_m - way.right_m[at],
            way.limit_mps[at],
            sight.in_junction,
            sight.red_m,
            line_ahead_m(sight),
            *bends.tolist(),
            way.curve.length_m - sight.s_m,
        ]
    )


def line_ahead_m(sight: Sight) -> float:
    """Distance from the own front to the next stop line or junction on the path; infinite if there is none."""
    front = sight.s_m + 0.5 * sight.length_m
    return min((line.at_m - front for line in sight.way.lines if line.at_m > front), default=math.inf)


def _emv(sight: Sight, emv: int, place: tuple[float, float], yaw: float) -> Floats:
    states, turned = sight.states, float(sight.states.yaw_rad[emv]) - yaw
    emv_id = int(states.actor_id[emv])
    behind = any(siren.behind for siren in sight.sirens if siren.actor_id == emv_id)
    siren, speed = bool(states.lights[emv] & Lights.SIREN), math.hypot(states.vx_mps[emv], states.vy_mps[emv])
    return np.array([1.0, siren, *place, speed, math.cos(turned), math.sin(turned), behind])


def _neighbours(sight: Sight, rows: Rows, places: tuple[Floats, Floats], direction: tuple[float, float]) -> Floats:
    """Features of some vehicles and people, shape ``(N, len(NEIGHBOUR))``."""
    states, own, (cos, sin) = sight.states, sight.row, direction
    vx, vy = states.vx_mps[rows] - states.vx_mps[own], states.vy_mps[rows] - states.vy_mps[own]
    turned = states.yaw_rad[rows] - states.yaw_rad[own]
    bodies = [sight.bodies[actor_id] for actor_id in states.actor_id[rows].tolist()]
    return np.stack(
        (
            np.ones(len(rows)),
            places[0][rows],
            places[1][rows],
            vx * cos + vy * sin,
            vy * cos - vx * sin,
            np.cos(turned),
            np.sin(turned),
            np.array([body.length_m for body in bodies]),
            np.array([body.width_m for body in bodies]),
            (states.lights[rows] & int(Lights.BRAKE)) != 0,
        ),
        axis=-1,
    )


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
