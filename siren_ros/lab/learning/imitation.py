"""Imitation in the civilian's seat: several policies drive an episode, and the best trajectory is imitated."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.errors import SirenError
from siren_ros.lab.learning.environment import YieldEnv
from siren_ros.lab.learning.options import EnvOptions
from siren_ros.lab.learning.seat_state import SeatState
from siren_ros.reports.exam.grading import VIOLATED
from siren_ros.running.seat.manoeuvres import Manoeuvre

Layers = tuple[tuple[Floats32, Floats32], ...]
"""Layers of a network, first one first: matrices, shape ``(outputs, inputs)``, and offsets, with tanh between
layers."""
_IN_LINE_M: Final = 3.0
_IN_LINE_GAP_M: Final = 40.0
_HEARD_GAP_M: Final = 60.0


Policy = Callable[[npt.NDArray[Any], SeatState], int]
"""Chooses a manoeuvre from an observation of kind ``vector`` and its state."""


def keeps_lane(_observation: npt.NDArray[Any], _state: SeatState) -> int:
    """Expert that ignores sirens and follows its leader by the IDM."""
    return Manoeuvre.KEEP


def pulls_over(_observation: npt.NDArray[Any], state: SeatState) -> int:
    """Expert that pulls over while a siren approaches from behind in its lane."""
    return Manoeuvre.PULL_OVER if _comes(state, _IN_LINE_GAP_M, _IN_LINE_M) else Manoeuvre.KEEP


def goes_right(_observation: npt.NDArray[Any], state: SeatState) -> int:
    """Expert that changes to the right while a siren approaches from behind, and continues there."""
    return Manoeuvre.RIGHT if _comes(state, _HEARD_GAP_M) and _lane_on_the_right(state) else Manoeuvre.KEEP


def goes_right_or_pulls_over(observation: npt.NDArray[Any], state: SeatState) -> int:
    """Expert that changes to the right, and pulls over in the rightmost lane."""
    if _comes(state, _HEARD_GAP_M, _IN_LINE_M) and not _lane_on_the_right(state):
        return Manoeuvre.PULL_OVER
    return goes_right(observation, state)


def _comes(state: SeatState, gap_m: float, aside_m: float = np.inf) -> bool:
    return any(siren.behind and siren.gap_m < gap_m and abs(siren.left_m) < aside_m for siren in state.sight.sirens)


def _lane_on_the_right(state: SeatState) -> bool:
    """Whether there is a lane to the right of the own one."""
    sight = state.sight
    lanes, row = sight.way.lanes, sight.way.row(sight.s_m)
    return lanes.lane_at(row, sight.left_m) > lanes.rightmost(row)


EXPERTS: Final[Mapping[str, Policy]] = {
    "pulls-over": pulls_over,
    "goes-right": goes_right,
    "goes-right-or-pulls-over": goes_right_or_pulls_over,
    "keeps-lane": keeps_lane,
}
"""Rule-based drivers that can be imitated."""


def logits_of(layers: Layers, observations: npt.NDArray[Any]) -> Floats32:
    """Outputs of a network, shape ``(…, 5)``, for observations of shape ``(…, SIZE)``."""
    values = np.asarray(observations, np.float32)
    for number, (matrix, offset) in enumerate(layers):
        values = (np.tanh(values) if number else values) @ matrix.T + offset
    return values


@dataclass(frozen=True)
class NetworkPolicy:
    """A learning driver: it chooses the largest output, or sometimes tries other manoeuvres."""

    layers: Layers
    temperature: float
    """With 0 it takes the largest output; above, the outputs divided by it are logarithms of probabilities."""
    random: np.random.Generator

    def __call__(self, observation: npt.NDArray[Any], _state: SeatState) -> int:
        """Choose a manoeuvre."""
        logits = logits_of(self.layers, observation)
        if self.temperature > 0.0:
            logits = logits / np.float32(self.temperature) + self.random.gumbel(size=len(logits)).astype(np.float32)
        return int(np.argmax(logits))


@dataclass(frozen=True)
class Trajectory:
    """What a policy saw and did in an episode."""

    observations: Floats32
    """Observation at each decision, shape ``(N, SIZE)``."""
    actions: npt.NDArray[np.int64]
    """Chosen actions, shape ``(N,)``."""
    reward: float
    """Sum of the rewards."""
    violations: int
    """Number of violated clauses of the environment's rulebook, minor and major."""

    def score(self, violation: float) -> float:
        """Reward minus the cost of the violated clauses."""
        return self.reward - violation * self.violations


def roll_out(options: EnvOptions, seed: int, policy: Policy) -> Trajectory | None:
    """Trajectory of a policy in the episode of a seed; None if the seed gives no episode."""
    environment, seen, done, total, info = YieldEnv(**vars(options)), [], [], 0.0, dict[str, Any]()
    try:
        observation, _ = environment.reset(seed=seed)
        over = False
        while not over:
            action = policy(observation, environment.moment)
            seen.append(observation)
            done.append(action)
            observation, reward, terminated, truncated, info = environment.step(action)
            total, over = total + reward, terminated or truncated
    except SirenError:
        return None
    finally:
        environment.close()
    violations = sum(grade in VIOLATED for grade in info["clauses"].values())
    return Trajectory(np.array(seen, np.float32), np.array(done, np.int64), total, violations)


def best_of(
    trajectories: Sequence[Trajectory | None], violation: float, margin: float
) -> tuple[Trajectory, Floats] | None:
    """Choose the trajectory to imitate, and give the scores of all; None if one failed.

    Args:
        trajectories: The same episode with several drivers, those that are to be preferred first.
        violation: Reward that a violated clause costs.
        margin: A later one is better only where its score is greater by this.
    """
    there = [one for one in trajectories if one is not None]
    if len(there) < len(trajectories):
        return None
    scores = np.array([one.score(violation) for one in there])
    best = 0
    for number in range(1, len(scores)):
        if scores[number] > scores[best] + margin:
            best = number
    return there[best], scores
