"""Memory of a process that runs episodes one after the other, as a worker of a data set's generation does."""

import gc
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.generation.closed_loop import closed_loop
from siren_ros.generation.episode_setup import plan_length, set_up_episode
from siren_ros.scenario.request import EpisodeRequest

FLAT_MB_PER_EPISODE: Final = 0.1
"""Growth below which memory counts as flat: 100 MB in a thousand episodes, far below what an episode needs."""
_PAGES_COLUMN: Final = 1


@dataclass(frozen=True)
class WorkerMemory:
    """Resident memory after each episode, in MB, and where the warm-up ends."""

    resident_mb: tuple[float, ...]
    warm_up: int

    @property
    def settled_mb(self) -> tuple[float, ...]:
        """After the warm-up."""
        return self.resident_mb[self.warm_up :]

    @property
    def slope_mb(self) -> float:
        """Growth per episode after the warm-up: the median of the slopes between all pairs (Theil and Sen).

        One episode with more vehicles than all before it lifts the level once; that is no leak.
        """
        values = np.array(self.settled_mb)
        first, second = np.triu_indices(len(values), 1)
        return float(np.median((values[second] - values[first]) / (second - first))) if len(first) else 0.0

    @property
    def flat(self) -> bool:
        """Whether it does not grow."""
        return self.slope_mb <= FLAT_MB_PER_EPISODE


def resident_mb() -> float:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[_PAGES_COLUMN])
    return pages * 4096 / 1e6


def measure_worker(requests: Sequence[EpisodeRequest], warm_up: int) -> WorkerMemory:
    """Run episodes one after the other in this process.

    Args:
        requests: The episodes.
        warm_up: So many are run before the memory counts.
    """
    found = []
    for request in requests:
        for _ in closed_loop(set_up_episode(request), plan_length(request)):
            pass
        gc.collect()
        found.append(resident_mb())
        print(f"  worker: {len(found)}/{len(requests)} episodes, {found[-1]:.1f} MB", file=sys.stderr, flush=True)
    return WorkerMemory(tuple(found), warm_up)
