"""One simulated try: an episode's situation with other parameters of the EMV."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from siren_ros.calibration.parameters import with_drivers, with_world
from siren_ros.calibration.trajectory import Trajectory
from siren_ros.errors import InputError, SirenError
from siren_ros.generation.behaviour_setup import behaviour_world
from siren_ros.generation.closed_loop import closed_loop
from siren_ros.generation.episode_setup import EpisodeSetup, set_up_episode
from siren_ros.generation.replay_check import request_of
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S, steps_from_s
from siren_ros.params.input_files import FILES_ON_DISK, InputFile, RecordedFiles, files_from_json
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.episode import FILES_PARAMETER
from siren_ros.scenario.request import EpisodeRequest

FAILED_M = 1000.0
"""Distance of a try that fails: farther than any that does not."""


@dataclass(frozen=True)
class Situation:
    """Map, traffic and start in which an EMV drives."""

    request: EpisodeRequest
    """Its level says who drives the EMV."""
    files: tuple[InputFile, ...] = ()
    """Parameter files of the record that it is from; empty: those of ``params``."""

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
        found = cls(request, tuple(files_from_json(record.description.parameters.get(FILES_PARAMETER, []))))
        now, then = found.set_up().description.map_sha256, record.description.map_sha256
        if now != then:
            raise InputError("bag", record.description.map_name, f"the map that it was made on, {then[:12]}")
        return found

    def set_up(self) -> EpisodeSetup:
        """The episode before its first step; made once in each process."""
        return _set_up(self.request, self.files)


@lru_cache(maxsize=8)
def _set_up(request: EpisodeRequest, files: tuple[InputFile, ...]) -> EpisodeSetup:
    return set_up_episode(request, RecordedFiles(files) if files else FILES_ON_DISK)


@dataclass(frozen=True)
class Target:
    """A trajectory with the situation in which it was driven."""

    name: str
    situation: Situation
    trajectory: Trajectory


def driven(situation: Situation, values: Mapping[str, float], until_s: float) -> Trajectory:
    """How the EMV drives in a situation with some parameters; the others have their defaults.

    Args:
        situation: Where it drives.
        values: By the names of the table of parameters.
        until_s: Simulated time at which the try may end.

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
    """Between the given trajectory and the one driven with some parameters; of norm ``FAILED_M`` where that fails."""
    failed = np.full(2 * len(target.trajectory.time_s), FAILED_M / np.sqrt(2 * len(target.trajectory.time_s)))
    try:
        found = driven(target.situation, values, target.trajectory.end_s)
    except SirenError:
        return failed
    if not len(found.time_s):
        return failed
    apart = target.trajectory.residuals_m(found)
    return apart if np.linalg.norm(apart) < FAILED_M else failed
