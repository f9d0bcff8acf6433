"""Fits parameters to trajectories: rounds of searches over a growing horizon, until two rounds agree.

Searches for the smallest error are evenly spread places, CMA-ES and least squares. They record tries and spread.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import scipy

from siren_ros.base.numerics.arrays import Floats, random_stream
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.errors import InputError
from siren_ros.lab.calibration.problem import FAILED_M, WHOLE, Target, residuals_m
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


STEP_GROWTH: Final = 0.1
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
    grown = ((1.0 + STEP_GROWTH) ** 2 - 1.0) * max(error_m, LEAST_ERROR_M) ** 2
    # A move over a whole range adds at least `grown`, so that every direction is bounded.
    inverse = np.linalg.inv(slopes.T @ slopes + grown * np.eye(slopes.shape[1]))
    return np.minimum(np.sqrt(grown * np.diag(inverse)), 1.0)


AGREE_SHARE: Final = 0.02
"""Relative difference of errors below which two rounds agree."""
AGREE_M: Final = 0.01
"""Absolute difference of errors below which two rounds agree."""
SAME_PLACE: Final = 0.01
"""Two rounds over the same horizon that are nearer than this share of every range would continue equally; the second
one stops, unless the first one's error grew from there."""
GROWN_SHARE: Final = 0.25
"""Relative growth of the error between horizons that shows a changed decision in the simulation; it must also exceed
``GROWN_M``."""
GROWN_M: Final = 0.03
"""Absolute growth of the error between horizons that shows a changed decision; it must also exceed ``GROWN_SHARE``."""
OPEN_M: Final = 0.5
"""Error above which a round continues with an evolution. Its first steps are moves that raise such an error by a tenth,
so that it searches where the last horizon has left the parameters open."""


def search_rounds(tried: Tried, horizons: Sequence[float], places: int, rng: np.random.Generator) -> bool:
    """Run rounds until two agree on the smallest error over whole trajectories; False if the tries run out first.

    The first round begins at the best of some places that are spread over the ranges. Each further one begins with an
    evolution (CMA-ES) from a random place, with twice the population of the one before (IPOP; Auger and Hansen, CEC
    2005). A round goes down over the first horizon, then over the next, to the whole trajectories. The number of the
    first round's ``places`` is a power of two less one.
    """
    ways: list[list[Bottom]] = []
    dimensions, times = len(tried.best), 1
    try:
        tried.horizon_s = horizons[0]
        begin = spread_out(tried, dimensions, places)
        while not _agreed(ways):
            ways.append(_lengthen(tried, horizons, begin, ways, rng))
            tried.horizon_s = horizons[0]
            if not _agreed(ways):
                begin = evolve(tried, rng.uniform(size=dimensions), rng, times)
                times *= 2
    except Spent:
        return False
    return True


def _lengthen(
    tried: Tried, horizons: Sequence[float], begin: Floats, before: Sequence[Sequence[Bottom]], rng: np.random.Generator
) -> list[Bottom]:
    """Search over each horizon, from the result of the one before."""
    way: list[Bottom] = []
    for number, horizon_s in enumerate(horizons):
        tried.horizon_s = horizon_s
        bottom = descend(tried, way[-1].place if way else begin)
        if way and _grown(way[-1], bottom):
            steps = move_shares(way[-1].slopes, max(way[-1].error_m, OPEN_M))
            again = descend(tried, evolve(tried, way[-1].place, rng, steps=steps))
            bottom = min(bottom, again, key=lambda each: each.error_m)
        way.append(bottom)
        for other in before:
            if np.abs(other[number].place - bottom.place).max() < SAME_PLACE and not _grown(other[number], other[-1]):
                return [*way, *other[number + 1 :]]
    return way


def _grown(before: Bottom, after: Bottom) -> bool:
    return after.error_m > max(before.error_m * (1.0 + GROWN_SHARE), before.error_m + GROWN_M)


def _agreed(ways: Sequence[Sequence[Bottom]]) -> bool:
    ends = [way[-1].error_m for way in ways]
    close = max(min(ends) * (1.0 + AGREE_SHARE), min(ends) + AGREE_M) if ends else 0.0
    return sum(end <= close for end in ends) > 1


EVALUATIONS_EACH: Final = 100
"""Largest number of tries per parameter, enough for three complete rounds. Two rounds, which suffice if the error has
one valley, take 40 to 50 for each of three parameters."""
SPREAD_OUT_PART: Final = 8
"""The evenly spread places get at most this part (an eighth) of the tries."""
_ENDS: Final = 2
"""Tries outside the search: one in the middle of the ranges, and one at the end over the whole trajectories."""
UNDETERMINED_SHARE: Final = 0.1
"""A parameter whose spread is a larger share of its range is not determined by the trajectories."""


@dataclass(frozen=True)
class Fitted:
    """The result of a search."""

    values: Mapping[str, float]
    spread: Mapping[str, float]
    """How far each value can move, with the others adjusted, until the error has grown by a tenth."""
    undetermined: tuple[str, ...]
    """Parameters with a spread above ``UNDETERMINED_SHARE``."""
    error_m: float
    """Error with the fitted values."""
    start_error_m: float
    """Error in the middle of all ranges."""
    evaluations: int
    history_m: tuple[float, ...]
    """Smallest error over the whole trajectories, after each group of such tries."""
    agreed: bool
    """Whether two rounds from different places reached the same error before the tries ran out."""


def fit(
    parameters: Sequence[DriverParameter],
    residuals: Residuals,
    evaluations: int,
    seed: int = 0,
    report: Tell = lambda *_: None,
    horizons: Sequence[float] = (WHOLE,),
) -> Fitted:
    """Find the parameters with the smallest error, each in its range, with ``search_rounds``.

    The search ends where two rounds come to the least error, or after so many ``evaluations``; a group of tries is
    finished. The same seed and residuals give the same result. ``report`` is called after each group. ``horizons`` are
    as ``horizons_of`` gives them.

    Raises:
        InputError: Too few evaluations, the package is missing, or every try fails.
    """
    count, rng = len(parameters), random_stream(seed, "calibration/search")
    tried = Tried(parameters, residuals, report)
    least = evolution(tried.best, rng).popsize + tries_for(count) + _ENDS
    if evaluations <= least:
        raise InputError("evaluations", evaluations, f"more than {least}: one generation, and the spread")
    tried.budget = evaluations - tries_for(count) - 1
    (start_error,) = errors_m(tried([tried.best]))
    agreed = search_rounds(tried, horizons, 2 ** int(np.log2(max(evaluations / SPREAD_OUT_PART, 2.0))) - 1, rng)
    tried.horizon_s, tried.budget = WHOLE, tried.count + 2  # these two tries are always allowed
    if not agreed:
        tried([tried.farthest])
    if tried.best_error_m >= FAILED_M:
        raise InputError("bags", "every try failed", "situations in which the EMV can be simulated")
    shares = list(zip(parameters, spread_shares(tried, tried.best, tried.best_error_m), strict=True))
    return Fitted(
        values=tried.values(tried.best),
        spread={each.name: float(share) * (each.maximum - each.minimum) for each, share in shares},
        undetermined=tuple(each.name for each, share in shares if share > UNDETERMINED_SHARE),
        error_m=tried.best_error_m,
        start_error_m=start_error,
        evaluations=tried.count,
        history_m=tuple(tried.history_m),
        agreed=agreed,
    )
