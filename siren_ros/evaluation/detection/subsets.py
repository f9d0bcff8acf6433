"""Parts of the labels (behaviour, distance, points, episodes), and the paper's order of the behaviour families."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Final, Self

import numpy as np

from siren_ros.evaluation.detection.boxes import Boxes, TruthBoxes
from siren_ros.evaluation.detection.frames import RANGE_M, Frames
from siren_ros.numerics.arrays import Flags, Floats
from siren_ros.world.actors import ActorClass, Mode

_HELD: Final = (Mode.YIELD_HOLD, Mode.STOPPED)
_YIELDING: Final = (*(mode for mode in Mode if mode.is_yielding and mode not in _HELD), Mode.REJOIN)
_DISTANCES_M: Final = (0.0, 15.0, 30.0, RANGE_M)
_POINTS: Final = (1.0, 5.0, 20.0, 100.0, np.inf)
_VISIBLE: Final = (0.0, 0.4, 0.6, 0.8, np.inf)


@dataclass(frozen=True)
class Subset:
    """Labels with something in common. A detector need not find others, and finding them is no false alarm."""

    group: str
    name: str
    labels: Callable[[Frames, TruthBoxes], Flags]
    detections: Callable[[Frames, Boxes], Flags] | None = None
    """Detections that can be false alarms of this subset; None for all."""


def _of_modes(name: str, modes: tuple[Mode, ...]) -> Subset:
    return Subset("behaviour", name, lambda _, truth: np.isin(truth.mode, modes))


def _of_distance(low_m: float, high_m: float) -> Subset:
    def within(frames: Frames, boxes: Boxes) -> Flags:
        away = frames.distance_m(boxes)
        return np.asarray((away >= low_m) & (away < high_m))

    return Subset("distance", f"{low_m:.0f}-{high_m:.0f} m", within, within)


def _of_points(low: float, high: float) -> Subset:
    name = f"{low:.0f} and more" if np.isinf(high) else f"{low:.0f} to {high - 1.0:.0f}"
    return Subset("LiDAR points", name, lambda _, truth: (truth.lidar_points >= low) & (truth.lidar_points < high))


def _of_visibility(low: float, high: float) -> Subset:
    name = f"{100.0 * low:.0f}-{min(100.0 * high, 100.0):.0f} %"
    return Subset("visible", name, lambda _, truth: (truth.visible >= low) & (truth.visible < high))


def subsets_of_episodes(frames: Frames) -> tuple[Subset, ...]:
    """Rows for the looks and for the suites of sensors, where there are several of them."""
    looks = np.array([episode.look for episode in frames.episodes])
    suites = np.array([episode.suite for episode in frames.episodes])
    return tuple(
        _of_episodes(group, kind, of_episode == kind)
        for group, of_episode in (("weather", looks), ("sensors", suites))
        for kind in sorted(set(of_episode.tolist()))
        if not (of_episode == kind).all()
    )


def _of_episodes(group: str, name: str, chosen: Flags) -> Subset:
    def within(frames: Frames, boxes: Boxes) -> Flags:
        return np.asarray(chosen[frames.episode[boxes.frame]])

    return Subset(group, name, within, within)


def _of_class(member: ActorClass) -> Subset:
    name = member.name.lower().replace("_", " ")
    return Subset("emergency vehicles", name, lambda _, truth: truth.actor_class == member)


SUBSETS: Final = (
    _of_modes("nominal", tuple(mode for mode in Mode if mode not in (*_HELD, *_YIELDING))),
    _of_modes("yielding", _YIELDING),
    _of_modes("held", _HELD),
    *(_of_distance(low, high) for low, high in pairwise(_DISTANCES_M)),
    *(_of_points(low, high) for low, high in pairwise(_POINTS)),
    *(_of_visibility(low, high) for low, high in pairwise(_VISIBLE)),
    *(_of_class(member) for member in (ActorClass.AMBULANCE, ActorClass.FIRE_TRUCK, ActorClass.POLICE)),
)
"""In the order of the tables."""


FAMILIES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {"clearance": ("S1", "S2"), "stop sign": ("S5", "S6"), "shoulder": ("S7",), "red light": ("S3", "S4")}
)
"""Templates of the paper's families, in its order of rising mAP."""


@dataclass(frozen=True)
class FamilyOrder:
    """Shares of draws in the paper's order; values are drawn about each family's mAP, as far as its episodes allow."""

    steps: Mapping[str, float]
    """A family is below the next one, by ``clearance < stop sign`` and so on."""
    whole: float
    """All are in the order at once; 1 in 24 by chance."""

    @classmethod
    def of(cls, families: Mapping[str, Floats]) -> Self | None:
        """From the mAP of each family in each draw, shape ``(R,)``; None where a family is missing."""
        if set(families) != set(FAMILIES):
            return None
        rises = {f"{low} < {high}": families[low] < families[high] for low, high in pairwise(FAMILIES)}
        steps = {name: float(rise.mean()) for name, rise in rises.items()}
        return cls(MappingProxyType(steps), float(np.all(list(rises.values()), axis=0).mean()))

    def sentence(self) -> str:
        """For a reader of the tables."""
        steps = ", ".join(f"{name} in {share:.0%}" for name, share in self.steps.items())
        return f"{steps} of the draws; the paper's whole order in {self.whole:.0%}, by chance 4%"
