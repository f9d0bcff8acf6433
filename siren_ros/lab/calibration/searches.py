"""Searches for the least error: even places, CMA-ES and least squares, what they have tried, and the spread there."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import scipy

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.errors import InputError
from siren_ros.lab.calibration.parameters import Parameter
from siren_ros.lab.calibration.targets import WHOLE, Target, residuals_m

Residuals = Callable[[Sequence[Mapping[str, float]], float], Sequence[Floats]]
"""Vectors of several tries, which may be simulated at the same time, over the trajectories' first seconds. Over one
horizon all have the same length, and the Euclidean norm of one is the error of its try in metres."""
Tell = Callable[[int, float, float], None]
"""Takes the number of tries, the horizon and the least error there."""


def errors_m(residuals: Iterable[Floats]) -> list[float]:
    """The errors of tries by their residuals."""
    return [float(np.linalg.norm(apart)) for apart in residuals]


class Spent(Exception):  # noqa: N818 - the end of a search, and no error
    """No tries are left."""


class Tried:
    """Runs the tries of a search. Parameters are shares of their ranges, 0 to 1."""

    def __init__(self, parameters: Sequence[Parameter], residuals: Residuals, report: Tell) -> None:
        """Nothing has been tried."""
        self._parameters = parameters
        self._residuals = residuals
        self._report = report
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
        residuals = list(map(np.asarray, self._residuals([self.values(shares) for shares in asked], self.horizon_s)))
        self.count += len(residuals)
        errors = errors_m(residuals)
        least = int(np.argmin(errors))
        if errors[least] < self._at(self.horizon_s)[1]:
            self._best[self.horizon_s] = asked[least], errors[least]
        if self.horizon_s == WHOLE:
            self.history_m.append(self.best_error_m)
        self._report(self.count, self.horizon_s, self._at(self.horizon_s)[1])
        return residuals

    def values(self, shares: Floats) -> dict[str, float]:
        """The parameters' values at shares of their ranges."""
        return {each.name: each.at(float(share)) for each, share in zip(self._parameters, shares, strict=True)}


@contextmanager
def residuals_over(
    targets: Sequence[Target], jobs: int, report: Callable[[], None] = lambda: None
) -> Iterator[Residuals]:
    """The residuals of a try are those of all targets, so that its error is the root mean square over the targets.

    Every try of a target is a separate call. A horizon cuts all trajectories to their first seconds, and an episode
    ends with its trajectory. ``report`` is called after each simulated episode.
    """
    with ProcessPool(jobs) as pool:

        def residuals(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
            cut = [replace(target, trajectory=target.trajectory.until(horizon_s)) for target in targets]
            calls = [(target, dict(values)) for values in tries for target in cut]
            parts = [apart / np.sqrt(len(cut)) for apart in pool.map(residuals_m, calls, report)]
            return [np.concatenate(parts[first : first + len(cut)]) for first in range(0, len(parts), len(cut))]

        yield residuals


START_STEP: Final = 0.25
"""First standard deviation of the evolution, as a share of each range: two of them reach from its middle to its end."""
NEAR_SHARE: Final = 0.05
"""The evolution ends where all its standard deviations are below this share of the ranges …"""
EVOLUTION_EACH: Final = 15
"""… or after so many tries for each parameter, times its population's factor: it has found the valley by then, and
least squares finds the bottom in a tenth of the tries that an evolution needs to creep along the valley's floor."""
SLOPE_SHARE: Final = 0.01
"""Step of the differences that the slope is taken from, as a share of each range: the error is smooth at this scale,
while smaller steps see how a decision falls into one simulated step or the next."""
LEAST_STEP: Final = 0.02
"""Least first standard deviation."""
_TOLX_PART: Final = 0.2
_CLOSE: Final = 1e-4
_CLOSE_BEFORE: Final = 5e-3
_DESCENTS_BEFORE: Final = 8
"""Over horizons before the whole one: the next one moves the bottom in any case."""
_DESCENTS: Final = 25
_PULL_M: Final = 1e-4


@dataclass(frozen=True)
class Bottom:
    """Where least squares ends."""

    place: Floats
    error_m: float
    slopes: Floats
    """Of the residuals there, a column for each parameter."""


def spread_out(tried: Tried, dimensions: int, count: int) -> Floats:
    """Tries the middle of all ranges and more places spread evenly over them (Sobol); gives the best one.

    The number of places is a power of two less one.

    Raises:
        Spent: No tries are left.
    """
    places = scipy.stats.qmc.Sobol(dimensions, scramble=False).random(count + 1)[1:]
    return np.asarray(places[int(np.argmin(errors_m(tried(places))))])


def evolve(
    tried: Tried, begin: Floats, rng: np.random.Generator, times: int = 1, steps: Floats | None = None
) -> Floats:
    """CMA-ES (N. Hansen, arXiv:1604.00772); gives the best place that it has seen.

    ``begin`` is the mean of the first generation. The population is so many ``times`` as large as the method proposes.
    ``steps`` are the first standard deviations as shares of the ranges; None for ``START_STEP``.

    Raises:
        Spent: No tries are left.
    """
    search = evolution(begin, rng, times, steps)
    best, best_error = begin, np.inf
    while not search.stop():
        asked = search.ask()
        errors = errors_m(tried(asked))
        search.tell(asked, errors)
        least = int(np.argmin(errors))
        if errors[least] < best_error:
            best, best_error = np.asarray(asked[least])[: len(begin)], errors[least]
    return best


def evolution(begin: Floats, rng: np.random.Generator, times: int = 1, steps: Floats | None = None) -> Any:
    """The search of the package ``cma`` before its first generation, within the ranges; InputError without it."""
    try:
        import cma  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise InputError("package", "cma", "./env --with calibration siren calibrate …") from error
    first = np.full(len(begin), START_STEP) if steps is None else np.clip(steps, LEAST_STEP, START_STEP)
    # CMA-ES works from two dimensions on; a single parameter gets a companion that says nothing.
    mean, first = (begin, first) if len(begin) > 1 else (np.append(begin, 0.5), np.append(first, first))
    options = {
        "bounds": [0.0, 1.0],
        "seed": np.nan,  # its own seeding would change numpy's global generator
        "randn": lambda *shape: rng.standard_normal(shape),
        "CMA_stds": (first / START_STEP).tolist(),
        "tolx": min(NEAR_SHARE, _TOLX_PART * float(first.max())),
        "tolfun": _CLOSE,
        "maxfevals": times * EVOLUTION_EACH * len(begin),
        "verbose": -9,
        "verb_log": 0,
        "signals_filename": "",
    }
    search = cma.CMAEvolutionStrategy(mean.tolist(), START_STEP, options)
    if times == 1:
        return search
    return cma.CMAEvolutionStrategy(mean.tolist(), START_STEP, {**options, "popsize": times * search.popsize})


def descend(tried: Tried, begin: Floats) -> Bottom:
    """Goes down to the bottom by least squares (trust region, within the ranges).

    Where several parameters change the way nearly alike, the errors form a narrow valley. An evolution soon comes to
    its floor and then creeps along it; the residuals of all times say at once which way it falls.

    Raises:
        Spent: No tries are left.
    """
    seen: dict[bytes, Floats] = {}

    def at(place: Floats) -> Floats:
        key = place.tobytes()
        if key not in seen:
            (seen[key],) = tried([place])
        return seen[key]

    whole = tried.horizon_s == WHOLE
    close, descents = (_CLOSE, _DESCENTS) if whole else (_CLOSE_BEFORE, _DESCENTS_BEFORE)
    # A parameter that changes nothing stays where it is: a faint pull keeps the slopes independent.
    pull = _PULL_M * np.eye(len(begin))
    solution = scipy.optimize.least_squares(
        lambda place: np.concatenate((at(place), pull @ (place - begin))), begin,
        lambda place: np.concatenate((slope(tried, place, at(place)), pull)), bounds=(0.0, 1.0),
        xtol=close, ftol=close, gtol=None, max_nfev=descents,
    )  # fmt: skip
    return Bottom(solution.x, float(np.linalg.norm(at(solution.x))), solution.jac[: -len(begin)])


def slope(tried: Tried, place: Floats, residuals: Floats) -> Floats:
    """How the residuals change for each parameter's range; a column for each parameter."""
    steps = np.where(place > 0.5, -SLOPE_SHARE, SLOPE_SHARE)  # always within the ranges
    moved = tried(place + np.diag(steps))
    return np.stack([(other - residuals) / step for other, step in zip(moved, steps, strict=True)], axis=1)


GROWTH: Final = 0.1
"""A parameter may move as far as lets the error grow by this share."""
LEAST_ERROR_M: Final = 0.05
"""Errors are taken to be at least so large: no tracker knows an EMV's places better."""
STEP_SHARE: Final = 0.02
"""Step of the differences, as a share of each range."""


def tries_for(dimensions: int) -> int:
    """So many tries ``spread_shares`` makes."""
    return 2 * dimensions


def spread_shares(tried: Tried, place: Floats, error_m: float) -> Floats:
    """How far each parameter can move from a place until the error has grown by a tenth, as shares of the ranges.

    The other parameters follow so that the error grows as little as possible: with the slopes J of the residuals, the
    squared error grows by dᵀJᵀJd for a move d, and the farthest move of one parameter on such an ellipsoid is the root
    of the diagonal of (JᵀJ)⁻¹. A parameter on which the way does not depend gets 1, its whole range.
    """
    count = len(place)
    below, above = np.clip(place - STEP_SHARE, 0.0, 1.0), np.clip(place + STEP_SHARE, 0.0, 1.0)
    places = [np.where(np.arange(count) == number, side, place) for number in range(count) for side in (below, above)]
    residuals = np.array(tried(places))
    slopes = (residuals[1::2] - residuals[::2]) / (above - below)[:, None]
    return move_shares(slopes.T, error_m)


def move_shares(slopes: Floats, error_m: float) -> Floats:
    """The farthest moves on the ellipsoid of a tenth more error; ``slopes`` have a column for each parameter."""
    grown = ((1.0 + GROWTH) ** 2 - 1.0) * max(error_m, LEAST_ERROR_M) ** 2
    # A move over the whole range adds at least `grown`, so that no direction is without an end.
    inverse = np.linalg.inv(slopes.T @ slopes + grown * np.eye(slopes.shape[1]))
    return np.minimum(np.sqrt(grown * np.diag(inverse)), 1.0)
