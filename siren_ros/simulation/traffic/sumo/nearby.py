"""Pedestrians and riders are kept near some points: others of a reserve enter there, those far away leave."""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Final, Generic, TypeAlias, TypeVar

import numpy as np

Point: TypeAlias = tuple[float, float]
Planned = TypeVar("Planned")


PEOPLE_WITHIN_M: Final = 180.0
"""Pedestrians, cyclists and motorcyclists that the demand asks for are within this of an EMV or the AV under test:
beyond the distances at which sensors tell them apart…"""
PEOPLE_MARGIN_M: Final = 15.0
"""…they enter nearer than that by this much, so that they stay for a while."""


def nearest_m(point: Point, others: Iterable[Point]) -> float:
    """Distance of a point to the nearest of some others; infinite where there are none."""
    return min((math.hypot(point[0] - x, point[1] - y) for x, y in others), default=math.inf)


class Reserve(Generic[Planned]):
    """Those who have not entered yet, in their order, each with a place of entry."""

    def __init__(self, planned: Sequence[Planned], places: Sequence[Point]) -> None:
        self._planned = planned
        self._places = np.array(places).reshape(-1, 2)
        self._waiting = np.ones(len(planned), np.bool_)

    def let_in(
        self, points: Collection[Point], least_m: float, most_m: float, enter: Callable[[Planned], bool]
    ) -> None:
        """Try to enter those whose nearest point is so far away; ``enter`` says whether somebody has entered."""
        if not points:
            return
        apart = self._places[:, None] - np.array([*points])
        nearest = np.hypot(apart[..., 0], apart[..., 1]).min(axis=1)
        for row in np.flatnonzero(self._waiting & (nearest >= least_m) & (nearest <= most_m)).tolist():
            self._waiting[row] = not enter(self._planned[row])
