"""Searches for the smallest error: evenly spread places, CMA-ES and least squares; records tries and spread."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import scipy

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.errors import InputError
from siren_ros.lab.calibration.targets import WHOLE, Target, residuals_m
from siren_ros.simulation.scenario.driver_parameters import DriverParameter

Residuals = Callable[[Sequence[Mapping[str, float]], float], Sequence[Floats]]
"""Computes the residual vectors of several tries, which may run in parallel, over the trajectories' first seconds. Over
one horizon all have the same length; the norm of a vector is its try's error in metres."""
Tell = Callable[[int, float, float], None]
"""Receives the number of tries, the horizon, and the smallest error over it."""


def errors_m(residuals: Iterable[Floats]) -> list[float]:
    """Errors of tries from their residuals."""
    return [float(np.linalg.norm(apart)) for apart in residuals]


class Spent(Exception):  # noqa: N818 - the end of a search, and no error
    """Raised when no tries are left."""


class Tried:
    """Runs and records the tries of a search. Parameters are shares of their ranges, 0 to 1."""

    def __init__(self, parameters: Sequence[DriverParameter], residuals: Residuals, report: Tell) -> None:
        """Start without any try."""
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
        """Number of remaining tries."""
        return max(self.budget - self.count, 0)

    @property
    def best(self) -> Floats:
        """Place with the smallest error over the whole trajectories; the middle before the first try."""
        return self._at(WHOLE)[0]

    @property
    def best_error_m(self) -> float:
        """Error at ``best``; infinite before the first try."""
        return self._at(WHOLE)[1]

    @property
    def farthest(self) -> Floats:
        """Best place over the longest horizon below the whole one; the best of all if there is none."""
        return self._at(max((horizon for horizon in self._best if horizon != WHOLE), default=WHOLE))[0]

    def _at(self, horizon_s: float) -> tuple[Floats, float]:
        return self._best.get(horizon_s, (np.full(len(self._parameters), 0.5), np.inf))

    def __call__(self, tries: Iterable[Iterable[float]]) -> list[Floats]:
        """Compute residuals of several tries over the horizon; tries that have begun are completed.

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
        """Convert shares of the ranges to parameter values."""
        return {each.name: each.at(float(share)) for each, share in zip(self._parameters, shares, strict=True)}


@contextmanager
def residuals_over(
    targets: Sequence[Target], jobs: int, report: Callable[[], None] = lambda: None
) -> Iterator[Residuals]:
    """Make the residual function for several targets; a try's error is the root mean square over the targets.

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
"""First standard deviation of the evolution as a share of each range: twice it reaches from the middle to the end."""
NEAR_SHARE: Final = 0.05
"""The evolution ends when all its standard deviations are below this share of the ranges."""
EVOLUTION_EACH: Final = 15
"""Limit of the evolution: tries per parameter, times its population's factor. By then it has found the valley; least
squares finds the bottom in a tenth of the tries that an evolution needs along the valley."""
SLOPE_SHARE: Final = 0.01
"""Step of the differences that give the slope, as a share of each range. The error is smooth at this scale; smaller
steps react to decisions that move from one simulated step to the next."""
LEAST_STEP: Final = 0.02
"""Smallest first standard deviation."""
_TOLX_PART: Final = 0.2
_CLOSE: Final = 1e-4
_CLOSE_BEFORE: Final = 5e-3
_DESCENTS_BEFORE: Final = 8
"""Limit of descents over horizons before the whole one, because the next horizon moves the result anyway."""
_DESCENTS: Final = 25
_PULL_M: Final = 1e-4


@dataclass(frozen=True)
class Bottom:
    """Result of least squares."""

    place: Floats
    error_m: float
    slopes: Floats
    """Derivatives of the residuals, one column per parameter."""


def spread_out(tried: Tried, dimensions: int, count: int) -> Floats:
    """Try the middle of all ranges and places spread evenly over them (Sobol); returns the best.

    The number of places is a power of two less one.

    Raises:
        Spent: No tries are left.
    """
    places = scipy.stats.qmc.Sobol(dimensions, scramble=False).random(count + 1)[1:]
    return np.asarray(places[int(np.argmin(errors_m(tried(places))))])


def evolve(
    tried: Tried, begin: Floats, rng: np.random.Generator, times: int = 1, steps: Floats | None = None
) -> Floats:
    """Search with CMA-ES (N. Hansen, arXiv:1604.00772); returns the best place found.

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
    """The search of the package ``cma`` within the ranges, before its first generation; InputError if it is missing."""
    try:
        import cma  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise InputError("package", "cma", "./env --with calibration siren calibrate …") from error
    first = np.full(len(begin), START_STEP) if steps is None else np.clip(steps, LEAST_STEP, START_STEP)
    # CMA-ES needs two dimensions, so a single parameter gets a second one without effect.
    mean, first = (begin, first) if len(begin) > 1 else (np.append(begin, 0.5), np.append(first, first))
    options = {
        "bounds": [0.0, 1.0],
        "seed": np.nan,  # with a seed, cma would change numpy's global generator
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
    """Find the bottom by least squares (trust region, within the ranges).

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
    # A weak pull keeps parameters without effect where they are, and the slopes independent.
    pull = _PULL_M * np.eye(len(begin))
    solution = scipy.optimize.least_squares(
        lambda place: np.concatenate((at(place), pull @ (place - begin))), begin,
        lambda place: np.concatenate((slope(tried, place, at(place)), pull)), bounds=(0.0, 1.0),
        xtol=close, ftol=close, gtol=None, max_nfev=descents,
    )  # fmt: skip
    return Bottom(solution.x, float(np.linalg.norm(at(solution.x))), solution.jac[: -len(begin)])


def slope(tried: Tried, place: Floats, residuals: Floats) -> Floats:
    """Derivatives of the residuals over each parameter's range, one column per parameter."""
    steps = np.where(place > 0.5, -SLOPE_SHARE, SLOPE_SHARE)  # the step always stays in the range
    moved = tried(place + np.diag(steps))
    return np.stack([(other - residuals) / step for other, step in zip(moved, steps, strict=True)], axis=1)


GROWTH: Final = 0.1
"""Growth of the error that limits the spread of a parameter."""
LEAST_ERROR_M: Final = 0.05
"""Smallest error that is assumed, since no tracker measures an EMV's position better."""
STEP_SHARE: Final = 0.02
"""Step of the differences as a share of each range."""


def tries_for(dimensions: int) -> int:
    """Number of tries that ``spread_shares`` makes."""
    return 2 * dimensions


def spread_shares(tried: Tried, place: Floats, error_m: float) -> Floats:
    """How far each parameter can move until the error has grown by a tenth, as a share of its range.

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
    """Farthest moves within the ellipsoid of a tenth more error; ``slopes`` has one column per parameter."""
    grown = ((1.0 + GROWTH) ** 2 - 1.0) * max(error_m, LEAST_ERROR_M) ** 2
    # A move over a whole range adds at least `grown`, so that every direction is bounded.
    inverse = np.linalg.inv(slopes.T @ slopes + grown * np.eye(slopes.shape[1]))
    return np.minimum(np.sqrt(grown * np.diag(inverse)), 1.0)
