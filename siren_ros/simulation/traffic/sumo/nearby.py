"""Keeps pedestrians and riders near some points: those far away leave, and others of a reserve enter."""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Final, Generic, TypeAlias, TypeVar

import numpy as np

Point: TypeAlias = tuple[float, float]
Planned = TypeVar("Planned")


PEOPLE_WITHIN_M: Final = 180.0
"""Distance of an EMV or the AV under test within which the demanded pedestrians, cyclists and motorcyclists are. At
larger distances sensors hardly tell them apart."""
PEOPLE_MARGIN_M: Final = 15.0
"""Length by which people enter nearer than that, so that they stay for a while."""


def nearest_m(point: Point, others: Iterable[Point]) -> float:
    """Distance of a point to the nearest of some others; infinite where there are none."""
    return min((math.hypot(point[0] - x, point[1] - y) for x, y in others), default=math.inf)


class Reserve(Generic[Planned]):
    """Planned people who have not entered yet, in their order, each with a place of entry."""

    def __init__(self, planned: Sequence[Planned], places: Sequence[Point]) -> None:
        self._planned = planned
        self._places = np.array(places).reshape(-1, 2)
        self._waiting = np.ones(len(planned), np.bool_)

    def let_in(
        self, points: Collection[Point], least_m: float, most_m: float, enter: Callable[[Planned], bool]
    ) -> None:
        """Tries to let in those whose distance to the nearest point is in a range.

        ``enter`` says whether it succeeded.
        """
        if not points:
            return
        apart = self._places[:, None] - np.array([*points])
        nearest = np.hypot(apart[..., 0], apart[..., 1]).min(axis=1)
        for row in np.flatnonzero(self._waiting & (nearest >= least_m) & (nearest <= most_m)).tolist():
            self._waiting[row] = not enter(self._planned[row])
