"""Residuals of several sets of parameters over all targets, in processes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from siren_ros.calibration.simulate import Target, residuals_m
from siren_ros.calibration.tried import Residuals
from siren_ros.datasets.exporting.worker_pool import worker_pool
from siren_ros.numerics.arrays import Floats


@contextmanager
def residuals_over(
    targets: Sequence[Target], jobs: int, told: Callable[[], None] = lambda: None
) -> Iterator[Residuals]:
    """The residuals of a try are those of all targets, so that its error is the root mean square over the targets.

    Every try and target is a call of its own. A horizon cuts all trajectories to their first seconds, and an episode
    ends with its trajectory.

    Args:
        targets: At least one.
        jobs: Processes.
        told: Called after each simulated episode.
    """
    with worker_pool(jobs, lambda _: None) as pool:

        def residuals(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
            cut = [replace(target, trajectory=target.trajectory.until(horizon_s)) for target in targets]
            calls = [(target, dict(values)) for values in tries for target in cut]
            found: dict[int, Floats] = {}
            for number, apart in pool(residuals_m, calls):
                found[number] = apart / np.sqrt(len(targets))
                told()
            each = len(targets)
            return [np.concatenate([found[one * each + other] for other in range(each)]) for one in range(len(tries))]

        yield residuals
