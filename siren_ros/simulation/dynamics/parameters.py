"""Vehicle parameters of each actor class: read from ``params/vehicles/``, one YAML file per class."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import GRAVITY_MPS2
from siren_ros.base.params.input_files import FILES_ON_DISK, InputFile, InputFiles
from siren_ros.base.params.strict_yaml import StrictMapping, read_strict_yaml
from siren_ros.errors import InputError
from siren_ros.simulation.world.actors import PEOPLE_CLASSES, ActorClass


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

    def attainable_accel_mps2(self, speed_mps: float) -> float:
        """Largest acceleration on a level road at a speed, by traction, power, drag and rolling resistance."""
        drive = min(self.max_drive_accel_mps2, self.drive_power_w / (self.mass_kg * max(speed_mps, 1e-3)))
        drag = 0.5 * AIR_DENSITY_KGPM3 * self.drag_area_m2 * speed_mps**2 / self.mass_kg
        return drive - drag - self.rolling_resistance * GRAVITY_MPS2


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
    # Records of earlier episodes have no two-wheelers and no pedestrians.
    names = {kind: name for kind, name in names.items() if kind not in PEOPLE_CLASSES or files.has("vehicles", name)}
    return {kind: _parameters_in(files.read("vehicle", "vehicles", name)) for kind, name in names.items()}


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
