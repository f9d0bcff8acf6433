"""What a search has tried: the best so far, and how many tries are left."""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from siren_ros.calibration.parameters import Parameter
from siren_ros.numerics.arrays import Floats

Residuals = Callable[[Sequence[Mapping[str, float]]], Sequence[Floats]]
"""Vectors of several tries, which may be simulated at the same time. All have the same length, and the Euclidean norm
of one is the error of its try in metres."""
Told = Callable[[int, float], None]
"""Told the number of tries and the least error."""


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
        self.budget = 0
        """Tries at which the search ends."""
        self.count = 0
        self.best = np.full(len(parameters), 0.5)
        self.best_error_m = np.inf
        self.history_m: list[float] = []
        """Least error after each call."""

    @property
    def left(self) -> int:
        """Tries that are left."""
        return max(self.budget - self.count, 0)

    def __call__(self, tries: Iterable[Iterable[float]]) -> list[Floats]:
        """The residuals of several tries; those that were begun are finished.

        Raises:
            Spent: No tries are left.
        """
        if not self.left:
            raise Spent
        asked = [np.array([*shares][: len(self._parameters)]) for shares in tries]
        found = [np.asarray(one) for one in self._residuals([self.values(shares) for shares in asked])]
        self.count += len(found)
        errors = errors_m(found)
        least = int(np.argmin(errors))
        if errors[least] < self.best_error_m:
            self.best, self.best_error_m = asked[least], errors[least]
        self.history_m.append(self.best_error_m)
        self._told(self.count, self.best_error_m)
        return found

    def values(self, shares: Floats) -> dict[str, float]:
        """The parameters' values at shares of their ranges."""
        return {one.name: one.at(float(share)) for one, share in zip(self._parameters, shares, strict=True)}
