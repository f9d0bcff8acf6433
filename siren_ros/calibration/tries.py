"""Errors of several sets of parameters over all targets, in processes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import cast

import numpy as np

from siren_ros.calibration.fit import Errors
from siren_ros.calibration.simulate import Target, error_m
from siren_ros.datasets.exporting.worker_pool import worker_pool


@contextmanager
def errors_over(targets: Sequence[Target], jobs: int, told: Callable[[], None] = lambda: None) -> Iterator[Errors]:
    """The error of a try is the mean over the targets; every try and target is a call of its own.

    Args:
        targets: At least one.
        jobs: Processes.
        told: Called after each simulated episode.
    """
    with worker_pool(jobs, lambda _: None) as pool:

        def errors(tries: Sequence[Mapping[str, float]]) -> list[float]:
            calls = [(target, dict(values)) for values in tries for target in targets]
            found = np.zeros(len(calls))
            for number, error in pool(error_m, calls):
                found[number] = error
                told()
            return cast("list[float]", found.reshape(len(tries), len(targets)).mean(axis=1).tolist())

        yield errors
