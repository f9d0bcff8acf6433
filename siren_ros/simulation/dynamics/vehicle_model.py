"""Dynamic single-track (bicycle) model of many vehicles at once, stable from standstill to top speed.

The parameters of each actor class are read from ``params/vehicles/``, one YAML file per class. Actuators, tyres and
Newton's equations are a compiled loop over the vehicles.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Columns, Flags, Floats
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled, within
from siren_ros.base.numerics.units import GRAVITY_MPS2
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFile, InputFiles, StrictMapping, read_strict_yaml
from siren_ros.errors import InputError
from siren_ros.simulation.world.actors import PEOPLE_CLASSES, ActorClass, by_class


@dataclass(frozen=True)
class VehicleParameters:
    """Parameters of the vehicle model for one actor class. The YAML files name the sources."""

    length_m: float
    width_m: float
    height_m: float
    wheelbase_m: float
    front_overhang_m: float
    """Distance from the front bumper back to the front axle."""
    cg_to_front_axle_m: float
    cg_height_m: float
    mass_kg: float
    yaw_inertia_kgm2: float
    cornering_stiffness_front_npr: float
    """Cornering stiffness of the whole axle, in newtons per radian of slip angle."""
    cornering_stiffness_rear_npr: float
    friction_coefficient: float
    max_steer_rad: float
    """Largest road-wheel angle of the single-track model, to either side."""
    max_steer_rate_radps: float
    steer_lag_s: float
    drive_power_w: float
    """Peak power at the wheels."""
    max_drive_accel_mps2: float
    """Tractive force at full throttle divided by mass, if power does not limit it."""
    drive_front_share: float
    """Share of the tractive force at the front axle."""
    max_brake_decel_mps2: float
    hand_brake_decel_mps2: float
    """Deceleration that the hand brake causes; it acts on the rear axle."""
    throttle_lag_s: float
    brake_lag_s: float
    drag_area_m2: float
    """Drag coefficient times frontal area."""
    rolling_resistance: float

    @property
    def centre_ahead_of_cg_m(self) -> float:
        """Distance of the footprint's centre ahead of the centre of gravity (negative: behind)."""
        return self.front_overhang_m + self.cg_to_front_axle_m - self.length_m / 2.0

    @property
    def centre_ahead_of_rear_axle_m(self) -> float:
        """Distance of the footprint's centre ahead of the rear axle."""
        return self.front_overhang_m + self.wheelbase_m - self.length_m / 2.0

    @property
    def understeer_gradient_s2pm(self) -> float:
        """K in δ = L/R + K·a_y, in rad per m/s² (Gillespie 1992, eq. 6-15): load over stiffness, front minus rear."""
        rear_share = self.cg_to_front_axle_m / self.wheelbase_m
        front = self.mass_kg * (1.0 - rear_share) / self.cornering_stiffness_front_npr
        return front - self.mass_kg * rear_share / self.cornering_stiffness_rear_npr

    def curvature_rate_1pms(self, share: float) -> float:
        """Largest change rate of the path's curvature, 1/(m s), with a share of the steering rate."""
        return share * self.max_steer_rate_radps / self.wheelbase_m

    def sized(self, length_m: float, width_m: float, height_m: float) -> "VehicleParameters":
        """Parameters of a vehicle of another size: axles move with the length, the mass stays."""
        if (length_m, width_m, height_m) == (self.length_m, self.width_m, self.height_m):
            return self
        return _sized(self, length_m, width_m, height_m)


AIR_DENSITY_KGPM3: Final = 1.225
"""International standard atmosphere at sea level (ISO 2533)."""

_RANGES: Final[dict[str, tuple[float, float]]] = {
    "length_m": (1.5, 20.0),
    "width_m": (0.4, 3.0),
    "height_m": (1.0, 4.5),
    "wheelbase_m": (0.9, 12.0),
    "front_overhang_m": (0.2, 4.0),
    "cg_to_front_axle_m": (0.4, 8.0),
    "cg_height_m": (0.2, 2.5),
    "mass_kg": (60.0, 45_000.0),
    "yaw_inertia_kgm2": (5.0, 1_000_000.0),
    "cornering_stiffness_front_npr": (2_000.0, 2_000_000.0),
    "cornering_stiffness_rear_npr": (2_000.0, 2_000_000.0),
    "friction_coefficient": (0.05, 1.5),
    "max_steer_rad": (0.2, 1.2),
    "max_steer_rate_radps": (0.1, 2.0),
    "steer_lag_s": (0.01, 0.5),
    "drive_power_w": (200.0, 1_000_000.0),
    "max_drive_accel_mps2": (0.5, 12.0),
    "drive_front_share": (0.0, 1.0),
    "max_brake_decel_mps2": (2.0, 12.0),
    "hand_brake_decel_mps2": (0.5, 6.0),
    "throttle_lag_s": (0.01, 2.0),
    "brake_lag_s": (0.01, 1.0),
    "drag_area_m2": (0.1, 15.0),
    "rolling_resistance": (0.001, 0.05),
}


@lru_cache(maxsize=4096)
def _sized(own: VehicleParameters, length_m: float, width_m: float, height_m: float) -> VehicleParameters:
    longer = length_m / own.length_m
    return replace(
        own,
        length_m=length_m,
        width_m=width_m,
        height_m=height_m,
        wheelbase_m=longer * own.wheelbase_m,
        front_overhang_m=longer * own.front_overhang_m,
        cg_to_front_axle_m=longer * own.cg_to_front_axle_m,
        yaw_inertia_kgm2=longer**2 * own.yaw_inertia_kgm2,
    )


_WALKER_RANGES: Final = {
    "length_m": (0.2, 1.0),
    "width_m": (0.2, 1.0),
    "height_m": (0.5, 2.3),
    "mass_kg": (10.0, 200.0),
}


def load_vehicle_parameters(files: InputFiles = FILES_ON_DISK) -> Mapping[ActorClass, VehicleParameters]:
    """Parameters of every actor class from the files ``vehicles/<class>.yaml`` (``sedan``, ``fire_truck``, …).

    Raises:
        InputError: a file, key or value is missing, unknown, of the wrong type or out of range; names file,
            line, key, value and what is allowed.
    """
    names = {kind: kind.name.lower() for kind in ActorClass}
    # Records of earlier episodes have no two-wheelers, no pedestrians, and no classes that are newer than they are.
    newer = {kind for kind in ActorClass if kind in PEOPLE_CLASSES or kind.body is not kind}
    names = {kind: name for kind, name in names.items() if kind not in newer or files.has("vehicles", name)}
    return by_class({kind: _parameters_in(files.read("vehicle", "vehicles", name)) for kind, name in names.items()})


@lru_cache(maxsize=4 * len(ActorClass))
def _parameters_in(file: InputFile) -> VehicleParameters:
    return _parameters(file.mapping())


def read_vehicle_parameters(folder: Path) -> Mapping[ActorClass, VehicleParameters]:
    """Parameters from the files ``<class>.yaml`` of any folder."""
    return {kind: _parameters(read_strict_yaml(folder / f"{kind.name.lower()}.yaml")) for kind in ActorClass}


def _parameters(mapping: StrictMapping) -> VehicleParameters:
    if not mapping.has("wheelbase_m"):
        return _of_walker(mapping)
    parameters = VehicleParameters(**{name: mapping.number(name, *limits) for name, limits in _RANGES.items()})
    mapping.finish()
    space = parameters.length_m - parameters.front_overhang_m
    for name, most, text in (
        ("wheelbase_m", space, "length_m minus front_overhang_m"),
        ("cg_to_front_axle_m", parameters.wheelbase_m, "wheelbase_m"),
    ):
        value = getattr(parameters, name)
        if value >= most:
            raise InputError(mapping.where(name), value, f"less than {text} ({most:g})")
    return parameters


def _of_walker(mapping: StrictMapping) -> VehicleParameters:
    """Parameters of a pedestrian: body and mass; the vehicle model does not move pedestrians."""
    sizes = {name: mapping.number(name, *limits) for name, limits in _WALKER_RANGES.items()}
    mapping.finish()
    length_m, inertia = sizes["length_m"], sizes["mass_kg"] * (sizes["length_m"] ** 2 + sizes["width_m"] ** 2) / 12.0
    middle = {"wheelbase_m": length_m / 2.0, "front_overhang_m": length_m / 4.0, "cg_to_front_axle_m": length_m / 4.0}
    rest = {name: low for name, (low, _) in _RANGES.items() if name not in {*sizes, *middle}}
    return VehicleParameters(**{**rest, **sizes, **middle, "yaw_inertia_kgm2": inertia})


@dataclass(frozen=True)
class ParameterTable:
    """Parameters of a list of actors as a structure of arrays, each of shape ``(N,)``."""

    length_m: Floats
    width_m: Floats
    wheelbase_m: Floats
    cg_to_front_axle_m: Floats
    cg_to_rear_axle_m: Floats
    centre_ahead_of_cg_m: Floats
    centre_ahead_of_rear_axle_m: Floats
    cg_height_m: Floats
    mass_kg: Floats
    yaw_inertia_kgm2: Floats
    cornering_stiffness_front_npr: Floats
    cornering_stiffness_rear_npr: Floats
    understeer_gradient_s2pm: Floats
    friction_coefficient: Floats
    max_steer_rad: Floats
    max_steer_rate_radps: Floats
    steer_lag_s: Floats
    drive_power_w: Floats
    max_drive_accel_mps2: Floats
    drive_front_share: Floats
    max_brake_decel_mps2: Floats
    hand_brake_decel_mps2: Floats
    throttle_lag_s: Floats
    brake_lag_s: Floats
    drag_area_m2: Floats
    rolling_resistance: Floats

    @classmethod
    def of(cls, classes: Sequence[ActorClass], parameters: Mapping[ActorClass, VehicleParameters]) -> "ParameterTable":
        """The table whose row i holds the parameters of ``classes[i]``."""
        return cls.of_rows([parameters[kind] for kind in classes])

    @classmethod
    def of_rows(cls, rows: Sequence[VehicleParameters]) -> "ParameterTable":
        """The table with these rows."""
        names = [field.name for field in fields(cls) if field.name != "cg_to_rear_axle_m"]
        columns = {name: np.array([getattr(row, name) for row in rows], dtype=np.float64) for name in names}
        rear = columns["wheelbase_m"] - columns["cg_to_front_axle_m"]
        return cls(cg_to_rear_axle_m=rear, **columns)

    def __len__(self) -> int:
        return len(self.mass_kg)

    @cached_property
    def records(self) -> npt.NDArray[np.void]:
        """The table as one record per actor, shape ``(N,)``, for compiled loops."""
        names = [field.name for field in fields(self)]
        table = np.empty(len(self), np.dtype([(name, np.float64) for name in names]))
        for name in names:
            table[name] = getattr(self, name)
        return table


Record = Any
"""One vehicle's row of ``ParameterTable.records``."""
Records = npt.NDArray[np.void]
"""``ParameterTable.records``."""
FORWARD, LATERAL, YAW_RATE, ACCEL, LATERAL_ACCEL, STEER, THROTTLE, BRAKE = range(3, 11)
"""Rows of ``BodyState.columns`` after ``X``, ``Y`` and ``YAW``."""
ASKED_THROTTLE, ASKED_BRAKE, ASKED_STEER, ASKED_HAND_BRAKE, QUICKNESS, DRIVE_FACTOR = range(6)
"""Rows of ``Controls.columns``."""
_LONGITUDINAL_SHARE: Final = 0.95
"""Share of an axle's grip to which anti-lock brakes and traction control limit the longitudinal force."""
_REAR_BRAKE_SHARE: Final = 0.7
"""Share to which brake force distribution, which follows the axle loads, limits the rear axle."""
_LEAST_LOAD_MPS2: Final = 0.1
"""Least load of an axle: the vehicle's mass multiplied by this."""
_POWER_FROM_MPS: Final = 0.1
_FULL_PULL_MPS: Final = 0.1
"""Below this speed the lateral force of a steered and braked wheel decreases: static friction balances it at rest."""
_STILL: Final = 0.01
"""A stopped vehicle that drifts or turns slower than this (m/s, rad/s) stands still."""
_SLOWEST_MPS: Final = 1e-9
"""Keeps slip defined at standstill; far below any relevant speed."""


@compiled
def _lagged(wanted: float, present: float, elapsed_s: float, lag_s: float) -> float:
    """Pedal position after its first-order lag."""
    wanted = within(wanted, 0.0, 1.0)
    return wanted + (present - wanted) * np.exp(-elapsed_s / lag_s)


@compiled
def _axle_loads_n(vehicle: Record, accel_mps2: float) -> tuple[float, float]:
    """Normal forces of the front and the rear axle, shifted by the acceleration."""
    mass = vehicle.mass_kg
    shift = mass * accel_mps2 * vehicle.cg_height_m
    front = (mass * GRAVITY_MPS2 * vehicle.cg_to_rear_axle_m - shift) / vehicle.wheelbase_m
    rear = (mass * GRAVITY_MPS2 * vehicle.cg_to_front_axle_m + shift) / vehicle.wheelbase_m
    return max(front, _LEAST_LOAD_MPS2 * mass), max(rear, _LEAST_LOAD_MPS2 * mass)


@compiled
def _secant(stiffness: float, limit_n: float, slip: float, cos: float) -> float:
    """Force over slip of a Fiala tyre (secant stiffness), for an axle steered by an angle with that cosine."""
    z = stiffness * cos * cos / (3.0 * limit_n) * slip
    inner = min(z, 1.0)
    return stiffness * cos * cos * cos * (1.0 - inner + inner * inner / 3.0) / max(z, 1.0)


@compiled
def _newton(
    vehicle: Record,
    motion: tuple[float, float, float],
    tyres: tuple[float, float, float, float],
    steer_rad: float,
    resistance_n: float,
    h: float,
) -> tuple[float, float, float]:
    """Forward and lateral velocity and yaw rate one substep of ``h`` seconds later.

    Backward Euler of Newton's equations in v and ω, with U the speed that slip is measured by:
    ``m U (v⁺ − v)/h + m U u ω⁺ = Σ K (u tan δ − v⁺ − l ω⁺) + U F_left`` and
    ``I U (ω⁺ − ω)/h = Σ l K (u tan δ − v⁺ − l ω⁺) + U a F_left``, K the axles' secant stiffnesses, l = (a, −b).
    The tyre forces of that solution are cut to their limits before they act. Drag, rolling resistance and the brakes
    oppose the motion and never reverse it. ``motion`` holds the velocities and the yaw rate now, ``tyres`` what
    ``_tyre_forces_n`` returns.
    """
    u, v, w = motion
    front_tyre, rear_tyre, front_limit, rear_limit = tyres
    mass_rate, inertia_rate = vehicle.mass_kg / h, vehicle.yaw_inertia_kgm2 / h
    a, b = vehicle.cg_to_front_axle_m, -vehicle.cg_to_rear_axle_m
    cos, sin = np.cos(steer_rad), np.sin(steer_rad)
    tan = sin / cos
    along = front_tyre * cos + rear_tyre
    speed = np.sqrt(u * u + v * v + (a * w) ** 2) + _SLOWEST_MPS
    left = front_tyre * sin * within(u / _FULL_PULL_MPS, -1.0, 1.0)
    front = _secant(vehicle.cornering_stiffness_front_npr, front_limit, abs(u * tan - v - a * w) / speed, cos)
    rear = _secant(vehicle.cornering_stiffness_rear_npr, rear_limit, abs(v + b * w) / speed, 1.0)
    push = u * tan * front
    a11, a12 = speed * mass_rate + front + rear, speed * mass_rate * h * u + front * a + rear * b
    a21, a22 = front * a + rear * b, speed * inertia_rate + front * a * a + rear * b * b
    r1 = speed * (mass_rate * v + left) + push
    r2 = speed * (inertia_rate * w + a * left) + push * a
    determinant = a11 * a22 - a12 * a21
    v_free, w_free = (r1 * a22 - a12 * r2) / determinant, (a11 * r2 - a21 * r1) / determinant
    front_n = within(front * (u * tan - v_free - a * w_free) / speed, -front_limit * cos, front_limit * cos)
    rear_n = within(-rear * (v_free + b * w_free) / speed, -rear_limit, rear_limit)
    w = w + ((front_n + left) * a + rear_n * b) / inertia_rate
    v = v + (front_n + rear_n + left) / mass_rate - h * u * w
    u = u + (max(along, 0.0) - front_n * tan) / mass_rate + h * v * w
    return np.copysign(max(abs(u) - (resistance_n - min(along, 0.0)) / mass_rate, 0.0), u), v, w


@compiled
def _tyre_forces_n(
    vehicle: Record, loads_n: tuple[float, float], drive_n: float, braking_n: float, hand_n: float
) -> tuple[float, float, float, float]:
    """Longitudinal forces of the front and the rear axle, and the remaining lateral grip by the friction circle."""
    front_load, rear_load = loads_n
    rear_braking = braking_n * (_REAR_BRAKE_SHARE * rear_load / (front_load + rear_load))
    front = drive_n * vehicle.drive_front_share - (braking_n - rear_braking)
    rear = drive_n * (1.0 - vehicle.drive_front_share) - rear_braking - hand_n
    front_grip, rear_grip = vehicle.friction_coefficient * front_load, vehicle.friction_coefficient * rear_load
    front = within(front, -_LONGITUDINAL_SHARE * front_grip, _LONGITUDINAL_SHARE * front_grip)
    rear = within(rear, -_LONGITUDINAL_SHARE * rear_grip, _LONGITUDINAL_SHARE * rear_grip)
    return front, rear, np.sqrt(front_grip * front_grip - front * front), np.sqrt(rear_grip * rear_grip - rear * rear)


@compiled
def advance(
    before: Floats, controls: Floats, records: Records, walks: Flags, count: int, h: float, after: Floats
) -> None:
    """Move all vehicles by ``count`` substeps of ``h`` seconds; pedestrians do not move.

    ``before`` and the result, ``after``, are ``BodyState.columns``, shape ``(11, N)``; ``controls`` are
    ``Controls.columns``, shape ``(6, N)``, and ``records`` those of ``ParameterTable``.
    """
    for n in range(records.shape[0]):
        if walks[n]:
            continue
        vehicle = records[n]
        x_m, y_m, start_yaw = before[X, n], before[Y, n], before[YAW, n]
        u, v, w = before[FORWARD, n], before[LATERAL, n], before[YAW_RATE, n]
        steer, wanted_steer, quickness = before[STEER, n], controls[ASKED_STEER, n], controls[QUICKNESS, n]
        wanted_steer = within(wanted_steer, -vehicle.max_steer_rad, vehicle.max_steer_rad)
        share = -np.expm1(-h * quickness / vehicle.steer_lag_s)
        most = h * quickness * vehicle.max_steer_rate_radps
        mass = vehicle.mass_kg
        loads = _axle_loads_n(vehicle, before[ACCEL, n])
        power_n = vehicle.drive_power_w / max(u, _POWER_FROM_MPS)
        full_n = min(mass * vehicle.max_drive_accel_mps2, power_n) * controls[DRIVE_FACTOR, n]
        hand_n = controls[ASKED_HAND_BRAKE, n] * (mass * vehicle.hand_brake_decel_mps2)
        drag_n = 0.5 * AIR_DENSITY_KGPM3 * vehicle.drag_area_m2 * u * u
        resistance_n = drag_n + vehicle.rolling_resistance * GRAVITY_MPS2 * mass
        yaw, moved_x, moved_y, throttle, brake = start_yaw, 0.0, 0.0, before[THROTTLE, n], before[BRAKE, n]
        for i in range(count):
            elapsed = h * (i + 1) * quickness
            throttle = _lagged(controls[ASKED_THROTTLE, n], before[THROTTLE, n], elapsed, vehicle.throttle_lag_s)
            brake = _lagged(controls[ASKED_BRAKE, n], before[BRAKE, n], elapsed, vehicle.brake_lag_s)
            steer += within((wanted_steer - steer) * share, -most, most)
            braking_n = brake * (mass * vehicle.max_brake_decel_mps2)
            tyres = _tyre_forces_n(vehicle, loads, throttle * full_n, braking_n, hand_n)
            u, v, w = _newton(vehicle, (u, v, w), tyres, steer, resistance_n, h)
            if i == count - 1 and u == 0.0 and abs(v) < _STILL and abs(w) < _STILL:
                v = w = 0.0
            yaw += h * w
            middle, left = yaw - 0.5 * h * w, v + vehicle.centre_ahead_of_cg_m * w
            moved_x += u * np.cos(middle) - left * np.sin(middle)
            moved_y += u * np.sin(middle) + left * np.cos(middle)
        dt = count * h
        after[X, n], after[Y, n] = x_m + h * moved_x, y_m + h * moved_y
        after[YAW, n] = yaw - 2.0 * np.pi * np.rint(yaw / (2.0 * np.pi))
        after[FORWARD, n], after[LATERAL, n], after[YAW_RATE, n] = u, v, w
        after[ACCEL, n] = (u - before[FORWARD, n]) / dt - 0.5 * (before[LATERAL, n] * before[YAW_RATE, n] + v * w)
        after[LATERAL_ACCEL, n] = (v - before[LATERAL, n]) / dt + 0.5 * (
            before[FORWARD, n] * before[YAW_RATE, n] + u * w
        )
        after[STEER, n], after[THROTTLE, n], after[BRAKE, n] = steer, throttle, brake


SUBSTEP_S: Final = 0.01


@dataclass(frozen=True)
class BodyState(Columns):
    """Motion and actuators of N vehicles, arrays of shape ``(N,)``; positions are footprint centres, ``map`` frame."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    forward_mps: Floats
    """Velocity of the centre of gravity along the vehicle; negative only after a spin."""
    lateral_mps: Floats
    """Velocity of the centre of gravity to the left of the vehicle."""
    yaw_rate_radps: Floats
    accel_mps2: Floats
    """Acceleration of the centre of gravity along the vehicle, mean over the step."""
    lateral_accel_mps2: Floats
    """Acceleration of the centre of gravity to the left, mean over the step."""
    steer_rad: Floats
    throttle: Floats
    brake: Floats

    @classmethod
    def moving(cls, x_m: Floats, y_m: Floats, yaw_rad: Floats, speed_mps: Floats) -> "BodyState":
        """Vehicles that roll straight ahead, no pedal pressed."""
        zero = np.zeros(len(x_m))
        return cls(x_m, y_m, yaw_rad, speed_mps, *([zero] * 7))

    def velocity_mps(self, table: ParameterTable) -> tuple[Floats, Floats]:
        """Velocity of the footprint's centre in the ``map`` frame, x and y."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        left = self.lateral_mps + table.centre_ahead_of_cg_m * self.yaw_rate_radps
        return self.forward_mps * cos - left * sin, self.forward_mps * sin + left * cos


@dataclass(frozen=True)
class Controls(Columns):
    """Drivers' commands to the actuators in one step, arrays of shape ``(N,)``."""

    throttle: Floats
    """Throttle pedal, 0–1."""
    brake: Floats
    """Brake pedal, 0–1."""
    steer_rad: Floats
    hand_brake: npt.NDArray[np.bool_]
    quickness: Floats
    """Quickness of the actuators: 1 for a driver; more divides the lags and multiplies the steering rate's limit."""
    drive_factor: Floats
    """Drive factor: 1 for a driver; more increases full throttle, within the tyres' grip."""


def step_bodies(state: BodyState, controls: Controls, table: ParameterTable, dt_s: float) -> BodyState:
    """Vehicles one step later with constant controls; rows of ``table`` are those of ``state``.

    The step is cut into equal substeps of at most ``SUBSTEP_S``. Controls beyond the actuators' ranges saturate. A
    vehicle at rest without throttle stays where it is to the last bit; brakes never move a vehicle backwards.
    """
    count, after = substeps(dt_s), np.empty_like(state.columns)
    nobody = np.zeros(len(state), np.bool_)
    advance(state.columns, controls.columns, table.records, nobody, count, dt_s / count, after)
    return BodyState.of_columns(after)


def substeps(dt_s: float) -> int:
    """Number of equal substeps of a step."""
    return max(1, math.ceil(dt_s / SUBSTEP_S - 1e-9))
