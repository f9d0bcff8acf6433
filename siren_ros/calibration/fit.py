"""Fits parameters to trajectories: even places and evolution find the valley, least squares its bottom."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.calibration.horizons import WHOLE
from siren_ros.calibration.parameters import Parameter
from siren_ros.calibration.rounds import search_rounds
from siren_ros.calibration.searches import evolution
from siren_ros.calibration.simulate import FAILED_M
from siren_ros.calibration.spread import spread_shares, tries_for
from siren_ros.calibration.tried import Residuals, Told, Tried, errors_m
from siren_ros.errors import InputError
from siren_ros.numerics.random_streams import random_stream

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
    """What the search found."""

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
    told: Told = lambda *_: None,
    horizons: Sequence[float] = (WHOLE,),
) -> Fitted:
    """The parameters with the least error that is found.

    ``search_rounds`` says how. The search ends where two rounds come to the least error, or where the tries are spent.

    Args:
        parameters: What is fitted, each within its range.
        residuals: Of several tries.
        evaluations: At most so many tries; a group that was begun is finished.
        seed: Of the search. The same seed and residuals give the same result.
        told: Called after each group of tries.
        horizons: Lengths of the trajectories' beginnings that are fitted one after the other, the last one ``WHOLE``.

    Raises:
        InputError: Too few evaluations, the package is missing, or every try fails.
    """
    count, rng = len(parameters), random_stream(seed, "calibration/search")
    tried = Tried(parameters, residuals, told)
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
    shares = spread_shares(tried, tried.best, tried.best_error_m)
    return Fitted(
        tried.values(tried.best),
        {one.name: float(share) * (one.high - one.low) for one, share in zip(parameters, shares, strict=True)},
        tuple(one.name for one, share in zip(parameters, shares, strict=True) if share > UNDETERMINED_SHARE),
        tried.best_error_m,
        start_error,
        tried.count,
        tuple(tried.history_m),
        agreed,
    )
