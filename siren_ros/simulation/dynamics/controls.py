"""What moves each actor at one step: a controller's command, or SUMO's pose, which it follows.

The controllers' commands are merged into one row per actor; contradictions are errors. Vehicles that SUMO drives are
controlled so that they follow SUMO's poses, with the same vehicle model as all others; the law runs for one vehicle
after the other in a compiled loop.

Pedestrians follow SUMO's pose without its jumps: SUMO's pedestrians change stripes and corners from one step to the
next, by up to a metre. People do so within a step or two. They keep SUMO's pace, so they do not lag behind.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Codes, Columns, Flags, Floats, Ids, Rows
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled, within, wrapped_rad
from siren_ros.base.numerics.units import GRAVITY_MPS2
from siren_ros.errors import EpisodeError
from siren_ros.simulation.dynamics.vehicle_model import (
    ACCEL,
    AIR_DENSITY_KGPM3,
    ASKED_BRAKE,
    ASKED_STEER,
    ASKED_THROTTLE,
    BRAKE,
    FORWARD,
    LATERAL,
    STEER,
    THROTTLE,
    YAW_RATE,
    BodyState,
    Controls,
    ParameterTable,
    Record,
    Records,
)
from siren_ros.simulation.world.actors import Lights, Mode, Owner, TrafficState, rows_of_ids
from siren_ros.simulation.world.commands import VehicleCommands

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


_SLOWEST_STEP_M: Final = 0.01
"""A centre that moved less than this in a step has no direction of motion."""
_SLOWEST_MPS: Final = 0.1
_LEAST_PACE: Final = 0.85
_MOST_PACE: Final = 1.1
"""Largest ratio of the centre's and the front bumper's speed that a vehicle can drive; above it SUMO's pose jumps."""
_STRAIGHT_PM: Final = 1e-3
"""Smaller curvatures, in 1/m, do not limit the speed."""
_FULL_LOCK_RAD: Final = 1.4
"""Larger than any steering angle, but below 90°, where the tangent ends."""
SPEED, SUMO_ACCEL = 3, 4
"""Rows of ``Reference.columns`` after ``X``, ``Y`` and ``YAW``."""
PACE, SMOOTH_ACCEL = 3, 4
"""Further columns, those of ``TrackerState.columns``."""
NEXT_YAW, NEXT_PACE, NEXT_ACCEL = range(3, 6)
"""Rows of what ``follow`` gives, after the pedals and the steering angle: the tracker's state then."""


class TrackerGains(NamedTuple):
    """Gains of the tracker."""

    lateral_per_s: float = 3.5
    """Stanley gain: rate of lateral correction. Above town speeds it is lower, because long vehicles respond late to
    steering."""
    lateral_soft_mps: float = 1.0
    """Speed added in the Stanley law, so that steering stays calm near standstill."""
    along_per_s: float = 2.0
    """Speed correction per metre of distance along the path."""
    along_most_mps: float = 3.0
    """Largest speed correction."""
    speed_time_s: float = 0.2
    """Time in which a speed difference is corrected."""
    quickness: float = 2.0
    """Factor on the quickness of pedals and steering compared with a driver, because SUMO's path is not known ahead."""
    drive_factor: float = 1.5
    """Factor on full throttle, because SUMO's acceleration ignores engine power."""
    pace_time_s: float = 0.2
    """Time constant of the ratio between the centre's speed and SUMO's front bumper speed."""
    accel_time_s: float = 0.2
    """Time constant of smoothing SUMO's acceleration before it is fed forward."""
    grip_share: float = 0.8
    """Share of the tyres' grip that steering and speed may use in a turn."""
    swerve_share: float = 0.4
    """Share of grip for steering up to town speeds, where SUMO's path can turn suddenly: drivers swerve with less than
    half of the grip."""
    town_mps: float = 14.0
    """Town speed, 50 km/h."""
    standing_mps: float = 0.05
    """Below this wanted speed the brake holds the vehicle."""
    holding_brake: float = 0.3


@compiled
def _quickest_turn_in(vehicle: Record, speed: float, curvature: float, grip: float) -> float:
    """Largest growth of curvature, 1/(m s), for which the centre of gravity stays within ``grip`` in m/s².

    Rolling without slip it has v² κ + v l_r dκ/dt: it goes aside already while the wheels are turning.
    """
    return max((grip - speed * speed * curvature) / (max(speed, _SLOWEST_MPS) * vehicle.cg_to_rear_axle_m), 0.0)


@compiled
def _steer(
    vehicle: Record,
    pose: tuple[float, float, float, float, float],
    goal: tuple[float, float, float, float],
    dt_s: float,
    gains: TrackerGains,
) -> tuple[float, float]:
    """Steering angle to command, and the resulting curvature.

    ``pose`` holds x, y, yaw, forward speed and road-wheel angle, ``goal`` x, y, yaw and curvature of the reference.
    """
    x_m, y_m, yaw, speed, present = pose
    goal_x, goal_y, goal_yaw, curvature = goal
    wheelbase = vehicle.wheelbase_m
    reach = wheelbase - vehicle.centre_ahead_of_rear_axle_m
    heading = goal_yaw + np.arctan(wheelbase * curvature)
    gap_x = goal_x - x_m + reach * (np.cos(goal_yaw) - np.cos(yaw))
    gap_y = goal_y - y_m + reach * (np.sin(goal_yaw) - np.sin(yaw))
    offset = gap_y * np.cos(heading) - gap_x * np.sin(heading)
    # No correction is quicker than the wheels turn to half of their lock: those of a bus would swing it to both sides.
    rate = min(gains.lateral_per_s, gains.quickness * vehicle.max_steer_rate_radps / (0.5 * vehicle.max_steer_rad))
    rate *= min(gains.town_mps / max(abs(speed), _SLOWEST_MPS), 1.0)
    correction = np.arctan2(rate * offset, abs(speed) + gains.lateral_soft_mps)
    share = gains.swerve_share if speed <= gains.town_mps else gains.grip_share
    grip = share * GRAVITY_MPS2 * vehicle.friction_coefficient
    tightest = min(np.tan(vehicle.max_steer_rad) / wheelbase, grip / max(speed * speed, _SLOWEST_MPS * _SLOWEST_MPS))
    turn = within(wrapped_rad(heading - yaw) + correction, -_FULL_LOCK_RAD, _FULL_LOCK_RAD)
    held, answer = np.tan(present) / wheelbase, -np.expm1(-dt_s * gains.quickness / vehicle.steer_lag_s)
    left = _quickest_turn_in(vehicle, speed, held, grip) * dt_s / answer
    right = _quickest_turn_in(vehicle, speed, -held, grip) * dt_s / answer
    steered = within(np.tan(turn) / wheelbase, max(-tightest, held - right), min(tightest, held + left))
    rear_share = vehicle.cg_to_rear_axle_m / wheelbase
    front_slip = vehicle.mass_kg * rear_share / vehicle.cornering_stiffness_front_npr * speed * speed * curvature
    return np.arctan(steered * wheelbase) + front_slip, steered


@compiled
def _before_lag(wanted: float, present: float, lag_s: float, dt_s: float) -> float:
    """Command whose mean response over a step, behind a first-order lag, is the wanted value; within 0–1."""
    kept = lag_s / dt_s * -np.expm1(-dt_s / lag_s)
    return within((within(wanted, 0.0, 1.0) - kept * present) / (1.0 - kept), 0.0, 1.0)


@compiled
def _pedals(
    vehicle: Record,
    motion: tuple[float, float, float],
    wanted_mps: float,
    accel_mps2: float,
    dt_s: float,
    gains: TrackerGains,
) -> tuple[float, float]:
    """Pedals that reach the wanted speed within ``speed_time_s`` while it changes; the brake holds a waiting vehicle.

    ``motion`` holds forward speed, throttle and brake; ``wanted_mps`` is the speed at the end of the step.
    """
    speed, throttle, brake = motion
    drag = 0.5 * AIR_DENSITY_KGPM3 * vehicle.drag_area_m2 / vehicle.mass_kg * speed * speed
    closing = (wanted_mps - accel_mps2 * dt_s - speed) / gains.speed_time_s
    push = accel_mps2 + closing + drag + vehicle.rolling_resistance * GRAVITY_MPS2
    drive = min(vehicle.max_drive_accel_mps2, vehicle.drive_power_w / (vehicle.mass_kg * max(speed, 0.1)))
    braking = _before_lag(-push / vehicle.max_brake_decel_mps2, brake, vehicle.brake_lag_s / gains.quickness, dt_s)
    if wanted_mps < gains.standing_mps:
        return 0.0, max(braking, gains.holding_brake)
    lag_s = vehicle.throttle_lag_s / gains.quickness
    return _before_lag(push / (gains.drive_factor * drive), throttle, lag_s, dt_s), braking


@compiled
def follow(
    bodies: Floats,
    tracker: Floats,
    reference: Floats,
    records: Records,
    walks: Flags,
    dt_s: float,
    gains: TrackerGains,
    out: Floats,
) -> None:
    """Controls of all vehicles for one step; pedestrians have none.

    They follow from the columns of ``BodyState``, ``TrackerState`` and ``Reference``. Result in ``out``, shape
    ``(6, N)``: the first three rows of ``Controls.columns``, then ``NEXT_YAW``, ``NEXT_PACE`` and ``NEXT_ACCEL``.
    """
    pace_share, accel_share = -np.expm1(-dt_s / gains.pace_time_s), -np.expm1(-dt_s / gains.accel_time_s)
    for n in range(records.shape[0]):
        if walks[n]:
            continue
        vehicle = records[n]
        x_m, y_m, yaw, speed = bodies[X, n], bodies[Y, n], bodies[YAW, n], bodies[FORWARD, n]
        last_x, last_y, last_yaw = tracker[X, n], tracker[Y, n], tracker[YAW, n]
        last_pace, last_accel = tracker[PACE, n], tracker[SMOOTH_ACCEL, n]
        dx, dy, sumo_mps = reference[X, n] - last_x, reference[Y, n] - last_y, reference[SPEED, n]
        moved = np.sqrt(dx * dx + dy * dy)
        pull = vehicle.centre_ahead_of_rear_axle_m
        course = np.arctan2(dy, dx) if moved > _SLOWEST_STEP_M else reference[YAW, n]
        most = np.arctan(pull / vehicle.wheelbase_m * np.tan(vehicle.max_steer_rad))
        swerve = within(wrapped_rad(course - last_yaw), -most, most)
        goal = last_x, last_y, last_yaw, np.tan(swerve) / pull
        steer, steered = _steer(vehicle, (x_m, y_m, yaw, speed, bodies[STEER, n]), goal, dt_s, gains)
        ratio = within(moved / (dt_s * max(sumo_mps, _SLOWEST_STEP_M / dt_s)), _LEAST_PACE, _MOST_PACE)
        pace = last_pace + (ratio - last_pace) * pace_share
        accel = last_accel + (reference[SUMO_ACCEL, n] - last_accel) * accel_share
        course = last_yaw + swerve
        gap = (last_x - x_m) * np.cos(course) + (last_y - y_m) * np.sin(course)
        correction = within(gains.along_per_s * gap, -gains.along_most_mps, gains.along_most_mps)
        grip = gains.grip_share * GRAVITY_MPS2 * vehicle.friction_coefficient
        fastest = np.sqrt(grip / max(abs(steered), _STRAIGHT_PM))
        wanted = min(max(pace * sumo_mps + correction, 0.0), fastest)
        motion = speed, bodies[THROTTLE, n], bodies[BRAKE, n]
        out[ASKED_THROTTLE, n], out[ASKED_BRAKE, n] = _pedals(vehicle, motion, wanted, accel, dt_s, gains)
        out[ASKED_STEER, n] = steer
        out[NEXT_YAW, n], out[NEXT_PACE, n], out[NEXT_ACCEL, n] = last_yaw + moved * np.sin(swerve) / pull, pace, accel


@dataclass(frozen=True)
class Reference(Columns):
    """SUMO's vehicles at one step, ``map`` frame; arrays of shape ``(N,)``; positions are footprint centres."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    speed_mps: Floats
    accel_mps2: Floats


@dataclass(frozen=True)
class TrackerState(Columns):
    """Reference of the last step: SUMO's centre, and the yaw of a car whose centre follows SUMO's path."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    pace: Floats
    """Speed of the centre divided by SUMO's (front bumper) speed; below 1 in turns."""
    accel_mps2: Floats
    """SUMO's acceleration, smoothed."""

    @classmethod
    def at(cls, x_m: Floats, y_m: Floats, yaw_rad: Floats) -> "TrackerState":
        """State of actors whose tracking begins, or begins again, at these poses."""
        return cls(x_m, y_m, yaw_rad, np.ones(len(x_m)), np.zeros(len(x_m)))


DEFAULT_GAINS: Final = TrackerGains()


def track(
    state: BodyState,
    tracker: TrackerState,
    reference: Reference,
    table: ParameterTable,
    dt_s: float,
    gains: TrackerGains = DEFAULT_GAINS,
) -> tuple[Controls, TrackerState]:
    """Controls for the step that ends with SUMO's vehicles at ``reference``, and the tracker's state then.

    ``state`` and ``tracker`` are of the step's start; rows of ``table`` are those of ``state``.
    """
    n = len(state)
    out = np.empty((6, n))
    walks = np.zeros(n, np.bool_)
    follow(state.columns, tracker.columns, reference.columns, table.records, walks, dt_s, gains, out)
    throttle, brake, steer, yaw, pace, accel = out
    controls = Controls(
        throttle=throttle,
        brake=brake,
        steer_rad=steer,
        hand_brake=np.zeros(n, dtype=bool),
        quickness=np.full(n, gains.quickness),
        drive_factor=np.full(n, gains.drive_factor),
    )
    return controls, TrackerState(reference.x_m, reference.y_m, yaw, pace, accel)


# These are no parameters: they only smooth jumps of SUMO's model.
_CATCH_UP_S: Final = 0.5
"""Time in which the distance from SUMO's position is corrected."""
_FASTER_MPS: Final = 0.8
"""Largest additional speed for this correction."""
_ACCEL_MPS2: Final = 2.5
"""Acceleration with which people start, stop and step aside (typical value of healthy adults)."""
_TURN_RADPS: Final = 4.0
_STEADY_MPS: Final = 0.4
"""Slower people have SUMO's heading; faster ones that of their motion."""


@compiled
def walk(bodies: Floats, sumo: Floats, walks: Flags, step_s: float, after: Floats) -> None:
    """Move pedestrians by one step: from ``bodies`` towards ``sumo`` into ``after``.

    Bodies are ``BodyState.columns``, and ``sumo`` is ``Reference.columns``.
    """
    for k in range(len(walks)):
        if not walks[k]:
            continue
        yaw, ahead, left = bodies[YAW, k], bodies[FORWARD, k], bodies[LATERAL, k]
        vx, vy = ahead * np.cos(yaw) - left * np.sin(yaw), ahead * np.sin(yaw) + left * np.cos(yaw)
        ux, uy = sumo[SPEED, k] * np.cos(sumo[YAW, k]), sumo[SPEED, k] * np.sin(sumo[YAW, k])
        wx = ux + (sumo[X, k] - step_s * ux - bodies[X, k]) / _CATCH_UP_S
        wy = uy + (sumo[Y, k] - step_s * uy - bodies[Y, k]) / _CATCH_UP_S
        scale = min(1.0, (sumo[SPEED, k] + _FASTER_MPS) / max(np.hypot(wx, wy), 1e-9))
        dx, dy = scale * wx - vx, scale * wy - vy
        part = min(1.0, _ACCEL_MPS2 * step_s / max(np.hypot(dx, dy), 1e-9))
        vx, vy = vx + part * dx, vy + part * dy
        facing = np.arctan2(vy, vx) if np.hypot(vx, vy) > _STEADY_MPS else sumo[YAW, k]
        turn = within(wrapped_rad(facing - yaw), -_TURN_RADPS * step_s, _TURN_RADPS * step_s)
        after[:, k] = 0.0
        after[X, k], after[Y, k] = bodies[X, k] + step_s * vx, bodies[Y, k] + step_s * vy
        after[YAW, k] = wrapped_rad(yaw + turn)
        cos, sin = np.cos(after[YAW, k]), np.sin(after[YAW, k])
        after[FORWARD, k], after[LATERAL, k] = vx * cos + vy * sin, vy * cos - vx * sin
        after[YAW_RATE, k] = turn / step_s
        after[ACCEL, k] = (after[FORWARD, k] - ahead) / step_s
