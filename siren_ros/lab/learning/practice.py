"""Practice in the civilian's seat: episodes that teachers and pupils drive, of which the best ones are imitated."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.errors import SirenError
from siren_ros.lab.learning.environment import YieldEnv
from siren_ros.lab.learning.moment import Moment
from siren_ros.lab.learning.task import Task
from siren_ros.reports.exam.grading import VIOLATED
from siren_ros.running.seat.manoeuvres import Manoeuvre

Layers = tuple[tuple[Floats32, Floats32], ...]
"""Matrices, shape ``(outputs, inputs)``, and offsets of a network, the first layer first; tanh is between layers."""
_IN_LINE_M: Final = 3.0
_IN_LINE_GAP_M: Final = 40.0
_HEARD_GAP_M: Final = 60.0


Chooser = Callable[[npt.NDArray[Any], Moment], int]
"""Chooses the manoeuvre for an observation of the kind ``vector``, and the moment that it shows."""


def keeps_lane(_observation: npt.NDArray[Any], _moment: Moment) -> int:
    """A driver without any regard for sirens, behind its leader as by the IDM."""
    return Manoeuvre.KEEP


def pulls_over(_observation: npt.NDArray[Any], moment: Moment) -> int:
    """A driver that pulls over while a siren comes from behind in its line."""
    return Manoeuvre.PULL_OVER if _comes(moment, _IN_LINE_GAP_M, _IN_LINE_M) else Manoeuvre.KEEP


def goes_right(_observation: npt.NDArray[Any], moment: Moment) -> int:
    """A driver that goes to the lanes on the right while a siren comes from behind, and drives on there."""
    return Manoeuvre.RIGHT if _comes(moment, _HEARD_GAP_M) and _lane_on_the_right(moment) else Manoeuvre.KEEP


def goes_right_or_pulls_over(observation: npt.NDArray[Any], moment: Moment) -> int:
    """A driver that goes to the right, and in the rightmost lane pulls over."""
    if _comes(moment, _HEARD_GAP_M, _IN_LINE_M) and not _lane_on_the_right(moment):
        return Manoeuvre.PULL_OVER
    return goes_right(observation, moment)


def _comes(moment: Moment, gap_m: float, aside_m: float = np.inf) -> bool:
    return any(siren.behind and siren.gap_m < gap_m and abs(siren.left_m) < aside_m for siren in moment.sight.sirens)


def _lane_on_the_right(moment: Moment) -> bool:
    """Whether there is one beside the lane that the own centre is in."""
    sight = moment.sight
    lanes, row = sight.way.lanes, sight.way.row(sight.s_m)
    return lanes.lane_at(row, sight.left_m) > lanes.rightmost(row)


TEACHERS: Final[Mapping[str, Chooser]] = {
    "pulls-over": pulls_over,
    "goes-right": goes_right,
    "goes-right-or-pulls-over": goes_right_or_pulls_over,
    "keeps-lane": keeps_lane,
}
"""Rules that a driver can imitate."""


def logits_of(layers: Layers, observations: npt.NDArray[Any]) -> Floats32:
    """The outputs of a network, shape ``(…, 5)``, for observations of shape ``(…, SIZE)``."""
    values = np.asarray(observations, np.float32)
    for number, (matrix, offset) in enumerate(layers):
        values = (np.tanh(values) if number else values) @ matrix.T + offset
    return values


@dataclass(frozen=True)
class Pupil:
    """A driver that learns: it chooses the greatest output, or tries others too."""

    layers: Layers
    temperature: float
    """0: the greatest output. Above: the outputs, divided by it, are the logarithms of probabilities."""
    random: np.random.Generator

    def __call__(self, observation: npt.NDArray[Any], _moment: Moment) -> int:
        """A chooser."""
        logits = logits_of(self.layers, observation)
        if self.temperature > 0.0:
            logits = logits / np.float32(self.temperature) + self.random.gumbel(size=len(logits)).astype(np.float32)
        return int(np.argmax(logits))


@dataclass(frozen=True)
class Practice:
    """An episode that a driver has driven."""

    observations: Floats32
    """At each decision, shape ``(N, SIZE)``."""
    actions: npt.NDArray[np.int64]
    """Shape ``(N,)``."""
    reward: float
    """Sum of the rewards."""
    violations: int
    """Clauses of the task's rulebook that it violated, minor and major."""

    def score(self, violation: float) -> float:
        """The reward less what each violated clause costs."""
        return self.reward - violation * self.violations


def practised(task: Task, seed: int, choose: Chooser) -> Practice | None:
    """An episode with a driver in the seat; None where the seed gives none."""
    environment, seen, done, total, info = YieldEnv(**vars(task)), [], [], 0.0, dict[str, Any]()
    try:
        observation, _ = environment.reset(seed=seed)
        over = False
        while not over:
            action = choose(observation, environment.moment)
            seen.append(observation)
            done.append(action)
            observation, reward, terminated, truncated, info = environment.step(action)
            total, over = total + reward, terminated or truncated
    except SirenError:
        return None
    finally:
        environment.close()
    violations = sum(grade in VIOLATED for grade in info["clauses"].values())
    return Practice(np.array(seen, np.float32), np.array(done, np.int64), total, violations)


def best_of(practices: Sequence[Practice | None], violation: float, margin: float) -> tuple[Practice, Floats] | None:
    """The episode to imitate, and the scores of all; None where one of them failed.

    Args:
        practices: The same episode with several drivers, those that are to be preferred first.
        violation: Reward that a violated clause costs.
        margin: A later one is better only where its score is greater by this.
    """
    there = [one for one in practices if one is not None]
    if len(there) < len(practices):
        return None
    scores = np.array([one.score(violation) for one in there])
    best = 0
    for number in range(1, len(scores)):
        if scores[number] > scores[best] + margin:
            best = number
    return there[best], scores
