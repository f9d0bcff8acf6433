"""Fits parameters to trajectories: rounds of searches over a lengthening horizon, until two of them agree."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, random_stream
from siren_ros.errors import InputError
from siren_ros.lab.calibration.parameters import Parameter
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

AGREE_SHARE: Final = 0.02
"""Two rounds agree where their errors differ by less than this share …"""
AGREE_M: Final = 0.01
"""… or by less than this."""
SAME_PLACE: Final = 0.01
"""Two rounds that are nearer to each other than this share of every range, over one horizon, go on alike, unless the
error of the first one grew from there: then the second one may find what the first one did not."""
GROWN_SHARE: Final = 0.25
"""An error that grows by more than this share from one horizon to the next is a decision that falls another way …"""
GROWN_M: Final = 0.03
"""… where it also grows by more than this."""
OPEN_M: Final = 0.5
"""Error from which the evolution in the middle of a round begins: its first steps are the moves that let such an error
grow by a tenth, so that it looks where the horizon before has left the parameters open."""


def search_rounds(tried: Tried, horizons: Sequence[float], places: int, rng: np.random.Generator) -> bool:
    """Rounds until two of them agree on the least error over the whole trajectories; False where the tries are spent.

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
    """Goes down over each horizon from the bottom over the one before."""
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
"""Tries for each parameter, at most: three rounds to their ends. The first two, which are enough where the errors have
one valley, take 40 to 50 for each of three parameters."""
SPREAD_OUT_PART: Final = 8
"""At most an eighth of the tries goes to places that are spread over the ranges."""
_ENDS: Final = 2
"""One try in the middle of the ranges, and one at the end where the tries are spent, over the whole trajectories."""
UNDETERMINED_SHARE: Final = 0.1
"""Spread above which the trajectories do not determine a parameter, as a share of its range."""


@dataclass(frozen=True)
class Fitted:
    """The result of a search."""

    values: Mapping[str, float]
    spread: Mapping[str, float]
    """How far each value can move, the others following, until the error has grown by a tenth."""
    undetermined: tuple[str, ...]
    """Parameters with a spread above ``UNDETERMINED_SHARE``."""
    error_m: float
    """With the values."""
    start_error_m: float
    """In the middle of all ranges."""
    evaluations: int
    history_m: tuple[float, ...]
    """Least error over the whole trajectories, after each group of tries that were that long."""
    agreed: bool
    """Whether two rounds from different places came to the same error before the tries were spent."""


def fit(
    parameters: Sequence[Parameter],
    residuals: Residuals,
    evaluations: int,
    seed: int = 0,
    report: Tell = lambda *_: None,
    horizons: Sequence[float] = (WHOLE,),
) -> Fitted:
    """The parameters, each within its range, with the least error that ``search_rounds`` finds.

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
    tried.horizon_s, tried.budget = WHOLE, tried.count + 2  # these always get their tries
    if not agreed:
        tried([tried.farthest])
    if tried.best_error_m >= FAILED_M:
        raise InputError("bags", "every try failed", "situations in which the EMV can be simulated")
    shares = list(zip(parameters, spread_shares(tried, tried.best, tried.best_error_m), strict=True))
    return Fitted(
        values=tried.values(tried.best),
        spread={each.name: float(share) * (each.high - each.low) for each, share in shares},
        undetermined=tuple(each.name for each, share in shares if share > UNDETERMINED_SHARE),
        error_m=tried.best_error_m,
        start_error_m=start_error,
        evaluations=tried.count,
        history_m=tuple(tried.history_m),
        agreed=agreed,
    )
