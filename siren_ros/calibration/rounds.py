"""A search over the lengthening horizon, again from other places until two of them come to the same error."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from siren_ros.calibration.searches import Bottom, descend, evolve, spread_out
from siren_ros.calibration.spread import move_shares
from siren_ros.calibration.tried import Spent, Tried
from siren_ros.numerics.arrays import Floats

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
    2005). A round goes down over the first horizon, then over the next, to the whole trajectories.

    Args:
        tried: What the search has tried.
        horizons: Rising, the last one the whole trajectories.
        places: Of the first round, a power of two less one.
        rng: Of the evolutions.
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
            bottom = min(bottom, again, key=lambda one: one.error_m)
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
