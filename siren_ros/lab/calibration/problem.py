"""The problem of a fit: parameters of the drivers of EMVs, and target trajectories with their situations.

A situation is where a trajectory was driven. It is simulated with other parameters; the residuals compare both
trajectories, first over their first seconds, then over more and more, then over all.
"""

import csv
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final, Self

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S, steps_from_s
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFile, RecordedFiles, files_from_json
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, SirenError
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.episode_setup import EpisodeSetup, behaviour_world, set_up_episode
from siren_ros.running.generation.replay_check import request_of
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.scenario.driver_parameters import DRIVER_PARAMETERS, DriverParameter, DriverParameters
from siren_ros.simulation.scenario.episode import FILES_PARAMETER, EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.plan import TrafficPlan, with_emv_drivers

_OF_SUMO: Final = "sumo."
_OF_ROS: Final = "emv_driver."
TARGET_SPEED: Final = "emv.speed_mps"
"""The template's parameter that is fitted too."""


PARAMETERS: Final[Mapping[str, DriverParameter]] = {
    TARGET_SPEED: DriverParameter(TARGET_SPEED, "speed on a free way", None, 8.0, 20.0),
    **{name: known for name, known in DRIVER_PARAMETERS.items() if name.startswith((_OF_SUMO, _OF_ROS))},
}
"""Every parameter that can be fitted, by name. The ranges are those of driving that is physically sensible.

``sumo.…`` acts where SUMO drives the EMV (L0), the others where ROS does (L1 to L3).
"""

FORMER_NAMES: Final[Mapping[str, str]] = {
    "controller.target_speed_mps": TARGET_SPEED,
    "controller.accel_mps2": "emv_driver.driving.comfort_accel_mps2",
    "controller.lateral_accel_mps2": "emv_driver.driving.lateral_accel_mps2",
    "controller.headway_s": "emv_driver.approach.headway_s",
    "controller.approach_brake_mps2": "emv_driver.approach.brake_mps2",
    "controller.approach_gap_m": "emv_driver.approach.standstill_gap_m",
    "controller.red_light_speed_mps": "emv_driver.lines.speed_mps",
}
"""Names that commands of earlier versions have; they still work."""


def parameters_named(names: Sequence[str]) -> tuple[DriverParameter, ...]:
    """Parameters by name, in the given order; InputError for no name, an unknown name, or a repeated one."""
    names = [FORMER_NAMES.get(name, name) for name in names]
    for name in names:
        if name not in PARAMETERS:
            raise InputError("parameters", name, f"one or several of {', '.join(PARAMETERS)}")
    if not names or len(set(names)) < len(names):
        raise InputError("parameters", ",".join(names), "one or several names, each once")
    return tuple(PARAMETERS[name] for name in names)


def check_effect(parameters: Sequence[DriverParameter], levels: Collection[str]) -> None:
    """Refuse parameters without an effect: SUMO's if ROS drives the EMV at all levels, and vice versa.

    Raises:
        InputError: Names the parameter, and those that have an effect.
    """
    sumo_drives = EmergencyLevel.L0.name in levels
    ros_drives = any(level != EmergencyLevel.L0.name for level in levels)
    works = [name for name in PARAMETERS if (sumo_drives if name.startswith(_OF_SUMO) else ros_drives)]
    for parameter in parameters:
        if parameter.name not in works:
            allowed = f"at {', '.join(levels)} one or several of {', '.join(works)}"
            raise InputError("parameters", parameter.name, allowed)


def with_drivers(plan: TrafficPlan, values: Mapping[str, float]) -> TrafficPlan:
    """The plan with SUMO's parameters of all its EMVs."""
    of_sumo = {name: value for name, value in values.items() if name.startswith(_OF_SUMO)}
    return with_emv_drivers(plan, DriverParameters().with_values(of_sumo).sumo)


def with_world(world: BehaviourWorld, values: Mapping[str, float]) -> BehaviourWorld:
    """The controller's view with its parameters.

    Raises:
        InputError: Margins that do not fall.
    """
    config = world.config.with_values({name: value for name, value in values.items() if name.startswith(_OF_ROS)})
    speed_mps = values.get(TARGET_SPEED, world.speeds.emv_route_follow_mps)
    return replace(world, config=config, speeds=config.speeds(speed_mps))


_COLUMNS = ("time_s", "x_m", "y_m")


@dataclass(frozen=True)
class Trajectory:
    """Path of an EMV in the ``map`` frame with increasing times; shapes ``(T,)`` and ``(T, 2)``."""

    time_s: Floats
    xy_m: Floats

    @classmethod
    def of_record(cls, record: EpisodeRecord) -> Self:
        """Path of an episode's first EMV; InputError if the episode has none."""
        track = record.track(record.emv_ids[0]) if record.emv_ids else None
        if track is None or not len(track):
            raise InputError("bag", record.description.template, "an episode with an EMV")
        return cls(track.time_s, track.xy_m)

    @classmethod
    def read(cls, file: Path) -> Self:
        """Read a CSV file with the columns ``time_s``, ``x_m`` and ``y_m``; times count from the episode's start.

        Raises:
            InputError: No such file, columns or numbers, or times that do not rise.
        """
        try:
            with file.open(encoding="utf-8", newline="") as opened:
                rows = [[float(row[name]) for name in _COLUMNS] for row in csv.DictReader(opened)]
        except (OSError, KeyError, TypeError, ValueError) as error:
            allowed = f"a CSV file with the columns {', '.join(_COLUMNS)} ({error!r})"
            raise InputError("trajectory", str(file), allowed) from error
        values = np.array(rows, dtype=np.float64).reshape(-1, len(_COLUMNS))
        if len(values) < 2 or not np.isfinite(values).all() or not (np.diff(values[:, 0]) > 0.0).all():
            raise InputError("trajectory", str(file), "two or more rows of finite numbers with rising times")
        return cls(values[:, 0], values[:, 1:])

    @property
    def end_s(self) -> float:
        """Last time of the trajectory."""
        return float(self.time_s[-1])

    @property
    def length_s(self) -> float:
        """Duration from the first to the last time."""
        return float(self.time_s[-1] - self.time_s[0])

    def until(self, length_s: float) -> "Trajectory":
        """The trajectory's first seconds, with at least two places."""
        places = max(2, int(np.searchsorted(self.time_s, self.time_s[0] + length_s + 1e-9)))
        return Trajectory(self.time_s[:places], self.xy_m[:places])

    def residuals_m(self, other: "Trajectory") -> Floats:
        """Differences of x and y at this trajectory's times, divided by the root of their number, shape ``(2T,)``.

        The Euclidean norm is the root mean square of the distance: the error whose minimum is the most likely way where
        all places have the same noise. Times before the other one begins count nothing. Where the other one ends before
        this one, its last place counts: an EMV that left the map earlier is far ahead.

        Raises:
            InputError: The other one covers no time of this one.
        """
        there = self.time_s >= other.time_s[0] - 1e-9
        if not there.any():
            raise InputError("trajectory", f"from {self.time_s[0]:g} to {self.end_s:g} s", "times of the episode")
        apart = [np.interp(self.time_s, other.time_s, other.xy_m[:, axis]) - self.xy_m[:, axis] for axis in (0, 1)]
        return np.concatenate(apart) * np.tile(there, 2) / np.sqrt(there.sum())

    def distance_m(self, other: "Trajectory") -> float:
        """Root mean square distance, with the rules of ``residuals_m``."""
        return float(np.linalg.norm(self.residuals_m(other)))


FAILED_M = 1000.0
"""Error of a failed try, larger than that of any other."""


@dataclass(frozen=True)
class Situation:
    """Map, traffic and start of an EMV's drive."""

    request: EpisodeRequest
    """Request of the episode; its level decides who drives the EMV."""
    files: tuple[InputFile, ...] = ()
    """Parameter files of the original record; if empty, those of ``params``."""

    @classmethod
    def of_record(cls, record: EpisodeRecord) -> "Situation":
        """The situation of a recorded episode.

        Raises:
            BagError: The record does not say what it was made from.
            InputError: An AV under test takes part, whose controller is not here, or the map has changed.
        """
        request = replace(request_of(record), sensors="none", av_sensors="none", predictor="")
        if request.av:
            raise InputError("bag", record.description.template, "an episode without AV under test")
        situation = cls(request, tuple(files_from_json(record.description.parameters.get(FILES_PARAMETER, []))))
        now, then = situation.set_up().description.map_sha256, record.description.map_sha256
        if now != then:
            raise InputError("bag", record.description.map_name, f"the map that it was made on, {then[:12]}")
        return situation

    @lru_cache(maxsize=8)  # noqa: B019 - situations are few, and equal ones share an entry
    def set_up(self) -> EpisodeSetup:
        """Set up the episode before its first step; the result is cached in each process."""
        return set_up_episode(self.request, RecordedFiles(self.files) if self.files else FILES_ON_DISK)


@dataclass(frozen=True)
class Target:
    """A trajectory with its situation."""

    name: str
    situation: Situation
    trajectory: Trajectory


def driven(situation: Situation, values: Mapping[str, float], until_s: float) -> Trajectory:
    """Simulate how the EMV drives in a situation with some parameters; the others have their defaults.

    The try may end at the simulated time ``until_s``.

    Raises:
        SirenError: The situation cannot be set up, or the episode fails.
    """
    setup = situation.set_up()
    setup = replace(setup, plan=with_drivers(setup.plan, values))
    world = with_world(behaviour_world(setup.description, setup.compiled_map.read_bytes()), values)
    emv_id, times, places = setup.description.emv_ids[0], [], []
    for step in closed_loop(setup, steps_from_s(until_s) + 1, world=world):
        rows = np.flatnonzero(step.states.actor_id == emv_id)
        if len(rows):
            times.append(step.states.step * STEP_S)
            places.append((step.states.x_m[rows[0]], step.states.y_m[rows[0]]))
    return Trajectory(np.array(times), np.array(places, dtype=np.float64).reshape(-1, 2))


def residuals_m(target: Target, values: Mapping[str, float]) -> Floats:
    """Residuals between a target and the drive with some parameters; of norm ``FAILED_M`` if the drive fails."""
    count, way = 2 * len(target.trajectory.time_s), None
    with suppress(SirenError):
        way = driven(target.situation, values, target.trajectory.end_s)
    if way is not None and len(way.time_s):
        apart = target.trajectory.residuals_m(way)
        if np.linalg.norm(apart) < FAILED_M:
            return apart
    return np.full(count, FAILED_M / np.sqrt(count))


WHOLE: Final = float("inf")
"""Horizon of the whole trajectories."""
FIRST_S: Final = 6.0
HORIZON_GROWTH: Final = 1.5
"""Factor from one horizon to the next."""
HORIZON_LAST: Final = 1.2
"""A horizon that shortens the whole trajectory by less than this factor is left out."""


def horizons_of(targets: Sequence[Target]) -> tuple[float, ...]:
    """Horizons of the fit in increasing order; the last one is ``WHOLE``.

    The traffic answers the EMV, and the EMV the traffic: a small difference grows over time, and a decision that falls
    the other way ends in another place. So the error over a long time has many valleys, and over a short time few. The
    longest trajectory counts.
    """
    length_s = max(target.trajectory.length_s for target in targets)
    horizons, horizon_s = [], FIRST_S
    while horizon_s * HORIZON_LAST < length_s:
        horizons.append(horizon_s)
        horizon_s *= HORIZON_GROWTH
    return (*horizons, WHOLE)
