"""What a search has tried: the best so far, and how many tries are left."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from siren_ros.calibration.horizons import WHOLE
from siren_ros.calibration.parameters import Parameter
from siren_ros.numerics.arrays import Floats

Residuals = Callable[[Sequence[Mapping[str, float]], float], Sequence[Floats]]
"""Vectors of several tries, which may be simulated at the same time, over the trajectories' first seconds. Over one
horizon all have the same length, and the Euclidean norm of one is the error of its try in metres."""
Told = Callable[[int, float, float], None]
"""Told the number of tries, the horizon and the least error there."""


def errors_m(residuals: Iterable[Floats]) -> list[float]:
    """The errors of tries by their residuals."""
    return [float(np.linalg.norm(one)) for one in residuals]


class Spent(Exception):  # noqa: N818 - the end of a search, and no error
    """No tries are left."""


class Tried:
    """Runs the tries of a search. Parameters are shares of their ranges, 0 to 1."""

    def __init__(self, parameters: Sequence[Parameter], residuals: Residuals, told: Told) -> None:
        """Nothing has been tried."""
        self._parameters = parameters
        self._residuals = residuals
        self._told = told
        self._best: dict[float, tuple[Floats, float]] = {}
        self.budget = 0
        """Tries at which the search ends."""
        self.count = 0
        self.horizon_s = WHOLE
        """Of the next tries."""
        self.history_m: list[float] = []
        """Least error over the whole trajectories, after each call with the whole horizon."""

    @property
    def left(self) -> int:
        """Tries that are left."""
        return max(self.budget - self.count, 0)

    @property
    def best(self) -> Floats:
        """The place with the least error over the whole trajectories; the middle before the first try."""
        return self._at(WHOLE)[0]

    @property
    def best_error_m(self) -> float:
        """Its error; infinite before the first try."""
        return self._at(WHOLE)[1]

    @property
    def farthest(self) -> Floats:
        """The best place over the longest horizon short of the whole one; the best of all where there is none."""
        return self._at(max((horizon for horizon in self._best if horizon != WHOLE), default=WHOLE))[0]

    def _at(self, horizon_s: float) -> tuple[Floats, float]:
        return self._best.get(horizon_s, (np.full(len(self._parameters), 0.5), np.inf))

    def __call__(self, tries: Iterable[Iterable[float]]) -> list[Floats]:
        """The residuals of several tries over the horizon; those that were begun are finished.

        Raises:
            Spent: No tries are left.
        """
        if not self.left:
            raise Spent
        asked = [np.array([*shares][: len(self._parameters)]) for shares in tries]
        found = [np.asarray(one) for one in self._residuals([self.values(shares) for shares in asked], self.horizon_s)]
        self.count += len(found)
        errors = errors_m(found)
        least = int(np.argmin(errors))
        if errors[least] < self._at(self.horizon_s)[1]:
            self._best[self.horizon_s] = asked[least], errors[least]
        if self.horizon_s == WHOLE:
            self.history_m.append(self.best_error_m)
        self._told(self.count, self.horizon_s, self._at(self.horizon_s)[1])
        return found

    def values(self, shares: Floats) -> dict[str, float]:
        """The parameters' values at shares of their ranges."""
        return {one.name: one.at(float(share)) for one, share in zip(self._parameters, shares, strict=True)}
