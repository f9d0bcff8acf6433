"""Fits parameters to trajectories by CMA-ES."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from siren_ros.calibration.parameters import Parameter
from siren_ros.calibration.simulate import FAILED_M
from siren_ros.errors import InputError
from siren_ros.numerics.random_streams import random_stream

START_STEP: Final = 0.25
"""First standard deviation, as a share of each range: the range is within two of them from its middle."""
EVALUATIONS_EACH: Final = 150
"""Tries for each parameter: one search to its end, and a second one with twice the population from elsewhere. An EMV's
error has valleys, in which one search ends too early."""
CLOSE_SHARE: Final = 2e-3
"""A search ends where all its standard deviations are below this share of the ranges."""

Errors = Callable[[Sequence[Mapping[str, float]]], Sequence[float]]
"""Errors in metres of several tries, which may run at the same time."""


@dataclass(frozen=True)
class Fitted:
    """What the search found."""

    values: Mapping[str, float]
    spread: Mapping[str, float]
    """Standard deviation of the search that found the values: how far one can move at about the same error."""
    error_m: float
    """With the values."""
    start_error_m: float
    """With the values that the search began with."""
    evaluations: int
    history_m: tuple[float, ...]
    """Least error after each generation."""


def fit(
    parameters: Sequence[Parameter],
    errors: Errors,
    evaluations: int,
    seed: int = 0,
    start: Mapping[str, float] | None = None,
    told: Callable[[int, float], None] = lambda _, __: None,
) -> Fitted:
    """The parameters with the least error that CMA-ES finds (N. Hansen, arXiv:1604.00772) in all its tries.

    Args:
        parameters: What is fitted, each within its range.
        errors: Of several tries.
        evaluations: At most so many tries; a generation that was begun is finished.
        seed: Of the search. The same seed and errors give the same result.
        start: Where the search begins; the middle of the range where a value is missing.
        told: Called after each generation with the number of tries and the least error.

    Raises:
        InputError: Too few evaluations, a start outside its range, the package is missing, or every try fails.
    """
    cma = _package()
    begin = np.array([_share(one, (start or {}).get(one.name)) for one in parameters])
    rng = random_stream(seed, "calibration/cma")
    options = {
        "bounds": [0.0, 1.0],
        "seed": np.nan,  # its own seeding would change numpy's global generator
        "randn": lambda *shape: rng.standard_normal(shape),
        "tolx": CLOSE_SHARE,
        "tolfun": 1e-4,
        "verbose": -9,
        "verb_log": 0,
        "signals_filename": "",
    }
    search = cma.CMAEvolutionStrategy(_padded(begin), START_STEP, options)
    if evaluations <= search.popsize:
        raise InputError("evaluations", evaluations, f"more than {search.popsize}, one generation")
    (start_error,) = errors([_values(parameters, begin)])
    best, best_error, tries, history, leading = begin, start_error, 1, [start_error], search
    stds = np.full(len(begin), START_STEP)
    while tries < evaluations:
        if search.stop():  # again from elsewhere with twice the population (IPOP; Auger and Hansen, CEC 2005)
            elsewhere = _padded(rng.uniform(size=len(begin)))
            search = cma.CMAEvolutionStrategy(elsewhere, START_STEP, {**options, "popsize": 2 * search.popsize})
        asked = search.ask()
        found = list(errors([_values(parameters, shares) for shares in asked]))
        search.tell(asked, found)
        tries += len(found)
        least = int(np.argmin(found))
        if found[least] < best_error:
            best, best_error, leading = np.asarray(asked[least]), float(found[least]), search
        if search is leading:
            stds = search.result.stds
        history.append(best_error)
        told(tries, best_error)
    if best_error >= FAILED_M:
        raise InputError("bags", "every try failed", "situations in which the EMV can be simulated")
    spread = dict(zip([one.name for one in parameters], stds, strict=False))
    return Fitted(
        _values(parameters, best),
        {one.name: float(spread[one.name]) * (one.high - one.low) for one in parameters},
        best_error,
        start_error,
        tries,
        tuple(history),
    )


def _padded(begin: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> list[float]:
    """CMA-ES works from two dimensions on; a single parameter gets a companion that says nothing."""
    return [*begin.tolist(), 0.5] if len(begin) == 1 else begin.tolist()


def _values(parameters: Sequence[Parameter], shares: Iterable[float]) -> dict[str, float]:
    return {one.name: one.at(float(share)) for one, share in zip(parameters, shares, strict=False)}


def _share(parameter: Parameter, value: float | None) -> float:
    if value is None:
        return 0.5
    if not parameter.low <= value <= parameter.high:
        raise InputError(parameter.name, value, f"{parameter.low:g} to {parameter.high:g}")
    return parameter.share_of(value)


def _package() -> Any:
    try:
        import cma  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise InputError("package", "cma", "./env --with calibration siren calibrate …") from error
    return cma
