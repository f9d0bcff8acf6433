"""The three searches that a fit is made of: over the whole ranges, by evolution, and down the slope to the bottom."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from siren_ros.calibration.horizons import WHOLE
from siren_ros.calibration.tried import Tried, errors_m
from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Floats

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

    Args:
        tried: What the search has tried.
        dimensions: Number of parameters.
        count: Places, a power of two less one.

    Raises:
        Spent: No tries are left.
    """
    places = qmc.Sobol(dimensions, scramble=False).random(count + 1)[1:]
    return np.asarray(places[int(np.argmin(errors_m(tried(places))))])


def evolve(
    tried: Tried, begin: Floats, rng: np.random.Generator, times: int = 1, steps: Floats | None = None
) -> Floats:
    """CMA-ES (N. Hansen, arXiv:1604.00772) from a place; gives the best place that it has seen.

    Args:
        tried: What the search has tried.
        begin: The mean of the first generation.
        rng: Of its samples.
        times: The population is so many times as large as the method's own.
        steps: First standard deviation of each parameter, as a share of its range; None for ``START_STEP``.

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
    """The search of the package ``cma`` before its first generation, bounded to the ranges.

    Raises:
        InputError: The package is missing.
    """
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
    found = least_squares(
        lambda place: np.concatenate((at(place), pull @ (place - begin))), begin,
        lambda place: np.concatenate((slope(tried, place, at(place)), pull)), bounds=(0.0, 1.0),
        xtol=close, ftol=close, gtol=None, max_nfev=descents,
    )  # fmt: skip
    return Bottom(found.x, float(np.linalg.norm(at(found.x))), found.jac[: -len(begin)])


def slope(tried: Tried, place: Floats, residuals: Floats) -> Floats:
    """How the residuals change for each parameter's range; a column for each parameter."""
    steps = np.where(place > 0.5, -SLOPE_SHARE, SLOPE_SHARE)  # always within the ranges
    found = tried(place + np.diag(steps))
    return np.stack([(one - residuals) / step for one, step in zip(found, steps, strict=True)], axis=1)
