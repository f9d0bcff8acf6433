"""How well the trajectories determine each parameter."""

from typing import Final

import numpy as np

from siren_ros.calibration.tried import Tried
from siren_ros.numerics.arrays import Floats

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

    Args:
        tried: What the search has tried.
        place: The parameters found.
        error_m: There.
    """
    count = len(place)
    below, above = np.clip(place - STEP_SHARE, 0.0, 1.0), np.clip(place + STEP_SHARE, 0.0, 1.0)
    places = [np.where(np.arange(count) == number, side, place) for number in range(count) for side in (below, above)]
    found = tried(places)
    slopes = [(found[2 * one + 1] - found[2 * one]) / (above[one] - below[one]) for one in range(count)]
    return move_shares(np.stack(slopes, axis=1), error_m)


def move_shares(slopes: Floats, error_m: float) -> Floats:
    """The farthest moves on the ellipsoid of a tenth more error; see ``spread_shares``.

    Args:
        slopes: Of the residuals, a column for each parameter.
        error_m: At the place.
    """
    grown = ((1.0 + GROWTH) ** 2 - 1.0) * max(error_m, LEAST_ERROR_M) ** 2
    # A move over the whole range adds at least `grown`, so that no direction is without an end.
    inverse = np.linalg.inv(slopes.T @ slopes + grown * np.eye(slopes.shape[1]))
    return np.minimum(np.sqrt(grown * np.diag(inverse)), 1.0)
