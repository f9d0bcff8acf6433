"""One attempt at an episode of a study, inside its own process: set up, run, recorded, hashed."""

import gc
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.dynamics.fleet import FleetState
from siren_ros.dynamics.parameters import load_vehicle_parameters
from siren_ros.generation.episode_setup import present_versions, set_up_episode
from siren_ros.generation.recorded_episode import record_episode
from siren_ros.interfaces.messages import json_text, typestore
from siren_ros.numerics.units import STEP_S
from siren_ros.params.input_files import FILES_ON_DISK
from siren_ros.scenario.episode import EpisodeEnd, EpisodeRequest
from siren_ros.studies.study_folder import hashes_of_bag

_GARBAGE_AFTER: Final = 100_000
"""New objects between two runs of Python's garbage collector: a step makes thousands of objects and no cycles."""


@dataclass(frozen=True)
class Attempt:
    """What an attempt brought; plain values, for the way between processes."""

    complete: bool
    reason: str
    steps: int
    predicate_holds: bool | None
    measures: dict[str, float | int | str]
    bag_bytes: int
    mcap_sha256: str
    metadata_sha256: str
    map_sha256: str
    versions: dict[str, str]
    setup_s: float
    run_s: float
    cpu_s: float

    @property
    def simulated_s(self) -> float:
        """Simulated time of the recorded steps."""
        return self.steps * STEP_S


def attempt_episode(request: EpisodeRequest, bag: Path) -> Attempt:
    """Makes an episode and its bag.

    Raises:
        InputError: The episode cannot be made.
        EpisodeError: Its bag cannot be written.
    """
    gc.set_threshold(_GARBAGE_AFTER)
    began_s, cpu_s = time.perf_counter(), time.process_time()
    setup = set_up_episode(request)
    ready_s = time.perf_counter()
    recorded = record_episode(setup, bag)
    run_s = time.perf_counter() - ready_s
    outcome = recorded.outcome
    complete = outcome.end is EpisodeEnd.COMPLETE and recorded.bag is not None
    mcap_sha256, metadata_sha256 = hashes_of_bag(bag) if complete else ("", "")
    return Attempt(
        complete=complete,
        reason=outcome.reason,
        steps=outcome.steps,
        predicate_holds=outcome.predicate_holds,
        measures={name: _plain(value) for name, value in outcome.measures.items()},
        bag_bytes=recorded.bag.size_bytes if recorded.bag is not None else 0,
        mcap_sha256=mcap_sha256,
        metadata_sha256=metadata_sha256,
        map_sha256=setup.description.map_sha256,
        versions=dict(present_versions()),
        setup_s=ready_s - began_s,
        run_s=run_s,
        cpu_s=time.process_time() - cpu_s,
    )


def _plain(value: float | str) -> float | int | str:
    return value.item() if isinstance(value, np.generic) else value


def measures_text(attempt: Attempt) -> str:
    """The numbers of an attempt's outcome as JSON."""
    return json_text(attempt.measures)


def _load() -> None:
    """What every episode needs: loaded once in the fork server, whose children then have it."""
    typestore()
    FleetState.empty(load_vehicle_parameters(FILES_ON_DISK))


_load()
