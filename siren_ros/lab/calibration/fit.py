"""Fits parameters to trajectories: rounds of searches over a growing horizon, until two rounds agree."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, random_stream
from siren_ros.errors import InputError
from siren_ros.lab.calibration.searches import (
    Bottom,
    Residuals,
    Spent,
    Tell,
    Tried,
    descend,
    errors_m,
    evolution,
    evolve,
    move_shares,
    spread_out,
    spread_shares,
    tries_for,
)
from siren_ros.lab.calibration.targets import FAILED_M, WHOLE
from siren_ros.simulation.scenario.driver_parameters import DriverParameter

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
