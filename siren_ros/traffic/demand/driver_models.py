"""How drivers drive under SUMO: parameters per vehicle class, and one draw per driver."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.params.input_files import FILES_ON_DISK, InputFiles
from siren_ros.params.strict_yaml import StrictMapping
from siren_ros.scenario.presets import TruncatedNormal, read_distribution
from siren_ros.world.actors import ActorClass

CAR_FOLLOWING_MODELS: Final = ("IDM", "EIDM", "Krauss", "ACC")


@dataclass(frozen=True)
class ClassDriving:
    """What a vehicle class can do and its drivers use in traffic."""

    accel_mps2: float
    decel_mps2: float
    min_gap_m: float
    max_speed_mps: float


@dataclass(frozen=True)
class DriverPopulation:
    """Distributions and constants from which drivers are drawn."""

    car_following: str
    speed_factor: TruncatedNormal
    tau_s: TruncatedNormal
    max_lateral_speed_mps: float
    speed_gain_eagerness: float
    cooperation: float
    classes: Mapping[ActorClass, ClassDriving]

    def draw(self, actor_class: ActorClass, rng: np.random.Generator, speed_scale: float = 1.0) -> "DriverModel":
        """One driver of a vehicle of the given class; ``speed_scale`` scales the wished speed."""
        return DriverModel(
            car_following=self.car_following,
            speed_factor=self.speed_factor.draw(rng) * speed_scale,
            tau_s=self.tau_s.draw(rng),
            max_lateral_speed_mps=self.max_lateral_speed_mps,
            speed_gain_eagerness=self.speed_gain_eagerness,
            cooperation=self.cooperation,
            driving=self.classes[actor_class],
        )


@dataclass(frozen=True)
class DriverModel:
    """SUMO's parameters of one driver."""

    car_following: str
    speed_factor: float
    """Wished speed over the speed limit."""
    tau_s: float
    max_lateral_speed_mps: float
    speed_gain_eagerness: float
    cooperation: float
    driving: ClassDriving


def load_drivers(name_or_path: str = "urban", files: InputFiles = FILES_ON_DISK) -> DriverPopulation:
    """A population of drivers by its name in ``params/drivers`` or from a YAML file.

    Raises:
        InputError: unknown name, or a mistake in the file (names file and line).
    """
    top = files.read("drivers", "drivers", name_or_path).mapping()
    top.text("title")
    classes = top.mapping("classes")
    population = DriverPopulation(
        car_following=top.text("car_following", CAR_FOLLOWING_MODELS),
        speed_factor=read_distribution(top.mapping("speed_factor"), 0.1, 2.0),
        tau_s=read_distribution(top.mapping("tau_s"), 0.3, 5.0),
        max_lateral_speed_mps=top.number("max_lateral_speed_mps", 0.1, 3.0),
        speed_gain_eagerness=top.number("speed_gain_eagerness", 0.0, 10.0),
        cooperation=top.number("cooperation", 0.0, 1.0),
        classes={member: _class_driving(classes.mapping(member.name.lower())) for member in ActorClass},
    )
    classes.finish()
    top.finish()
    return population


def _class_driving(section: StrictMapping) -> ClassDriving:
    driving = ClassDriving(
        accel_mps2=section.number("accel_mps2", 0.2, 8.0),
        decel_mps2=section.number("decel_mps2", 0.5, 9.0),
        min_gap_m=section.number("min_gap_m", 0.5, 10.0),
        max_speed_mps=section.number("max_speed_mps", 5.0, 100.0),
    )
    section.finish()
    return driving
