"""Trains a driver for the civilian's seat that imitates the best of several drives of each episode.

In the first round experts drive, in later ones the driver itself too, also with manoeuvres that it would not choose:
what goes better than before is imitated (reward-ranked imitation).
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import cycle, islice, pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.base.params.plain_files import write_network
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.errors import InputError, SirenError
from siren_ros.lab.learning.environment import YieldEnv
from siren_ros.lab.learning.options import EnvOptions
from siren_ros.lab.learning.rollout import SeatState
from siren_ros.lab.training.fitting.descent import Descent, exported
from siren_ros.lab.training.settings import DriverFit
from siren_ros.reports.exam.grading import VIOLATED
from siren_ros.running.seat.drivers.learned import BY_RULE, IN_LINE_M, INPUT, OUTPUT, comes_from_behind
from siren_ros.running.seat.policy import VECTOR_SIZE, Manoeuvre

Layers = tuple[tuple[Floats32, Floats32], ...]
"""Layers of a network, first one first: matrices, shape ``(outputs, inputs)``, and offsets, with tanh between
layers."""
_HEARD_GAP_M: Final = 60.0


Policy = Callable[[npt.NDArray[Any], SeatState], int]
"""Chooses a manoeuvre from an observation of kind ``vector`` and its state."""


def keeps_lane(_observation: npt.NDArray[Any], _state: SeatState) -> int:
    """Expert that ignores sirens and follows its leader by the IDM."""
    return Manoeuvre.KEEP


def pulls_over(_observation: npt.NDArray[Any], state: SeatState) -> int:
    """Expert that is the exam's driver ``pulls-over``."""
    return BY_RULE.choose(state.sight)


def goes_right(_observation: npt.NDArray[Any], state: SeatState) -> int:
    """Expert that changes to the right while a siren approaches from behind, and continues there."""
    return (
        Manoeuvre.RIGHT
        if comes_from_behind(state.sight, _HEARD_GAP_M) and _lane_on_the_right(state)
        else Manoeuvre.KEEP
    )


def goes_right_or_pulls_over(observation: npt.NDArray[Any], state: SeatState) -> int:
    """Expert that changes to the right, and pulls over in the rightmost lane."""
    if comes_from_behind(state.sight, _HEARD_GAP_M, IN_LINE_M) and not _lane_on_the_right(state):
        return Manoeuvre.PULL_OVER
    return goes_right(observation, state)


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
    """Outputs of a network, shape ``(…, 5)``, for observations of shape ``(…, VECTOR_SIZE)``."""
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
    """Observation at each decision, shape ``(N, VECTOR_SIZE)``."""
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


Drive = tuple[EnvOptions, int, str, Layers, float]
"""A drive: the environment's options, the seed, the expert (or empty), the driver's network and its temperature."""


def trained_driver(path: Path, config: DriverFit, processes: int, report: Callable[[str], None]) -> Mapping[str, Any]:
    """Train a driver and write it with its card. Equal settings give equal weights on the same machine.

    Args:
        path: The ONNX file; its card is next to it.
        config: The settings.
        processes: How many episodes are driven at once.
        report: Takes lines about the progress.

    Returns:
        The card.

    Raises:
        InputError: An option cannot be used, or the folder cannot be written.
    """
    torch.set_num_threads(1)
    began_s, rounds = time.monotonic(), list[dict[str, float]]()
    cells, imitated, network = _cells(config), list[tuple[Trajectory, float]](), _network(config)
    with ProcessPool(processes) as pool:
        for number, count in enumerate(config.episodes):
            chosen = list(islice(cells, count))
            drives = [drive for cell in chosen for drive in _drives(*cell, network if number else None, config)]
            each = len(drives) // len(chosen)
            done = pool.map(drive, [(one,) for one in drives])
            found = [best_of(done[k : k + each], config.violation, config.margin) for k in range(0, len(done), each)]
            best = [one for one in found if one is not None]
            if not best:
                raise InputError("templates", ", ".join(config.templates), "templates of which an episode can be made")
            for trajectory, scores in best:
                gap = (trajectory.score(config.violation) - scores.mean()) / config.full_gap
                imitated.append((trajectory, float(np.clip(gap, config.least_weight, 1.0))))
            network = _imitating(imitated, config)
            means = np.mean([row for _, row in best], axis=0).tolist()
            names = [*EXPERTS, *(["pupil"] + ["tries"] * config.tries if number else [])]
            rounds.append({"episodes": len(best), "best": float(np.mean([row.max() for _, row in best]))})
            for name, score in zip(names, means, strict=True):
                rounds[-1][name] = max(score, rounds[-1].get(name, -np.inf))
            report(f"round {number + 1}: " + ", ".join(f"{key} {value:.2f}" for key, value in rounds[-1].items()))
    free = {INPUT: "episodes", OUTPUT: "episodes"}
    fitted = exported(network, network, (torch.zeros(1, VECTOR_SIZE),), [INPUT], [OUTPUT], free)
    task = asdict(EnvOptions(**config.task))
    minutes = (time.monotonic() - began_s) / 60.0
    card = fitted.card(config, kind="driver", task=task, minutes=minutes, processes=processes, rounds=rounds)
    write_network(path, fitted.onnx, card)
    return card


def drive(one: Drive) -> Trajectory | None:
    """Drive an episode; it runs in a process of the training."""
    options, seed, expert, layers, temperature = one
    tried = round(1000.0 * temperature)
    policy = EXPERTS[expert] if expert else NetworkPolicy(layers, temperature, np.random.default_rng((seed, tried)))
    return roll_out(options, seed, policy)


def _cells(config: DriverFit) -> Iterator[tuple[EnvOptions, int]]:
    """Endless sequence of episodes: by template and level, with the next seeds."""
    first, after = EnvOptions(**config.task).seeds
    seeds = cycle(range(first, after))
    for level in cycle(config.levels):
        for template in config.templates:
            yield EnvOptions(**{**config.task, "template": template, "level": level}), next(seeds)


def _drives(options: EnvOptions, seed: int, network: nn.Sequential | None, config: DriverFit) -> list[Drive]:
    """All drives of an episode, preferred ones first."""
    drives: list[Drive] = [(options, seed, expert, (), 0.0) for expert in EXPERTS]
    if network is not None:
        layers = tuple(
            (layer.weight.detach().numpy().copy(), layer.bias.detach().numpy().copy())
            for layer in network
            if isinstance(layer, nn.Linear)
        )
        drives.append((options, seed, "", layers, 0.0))
        drives += [(options, seed, "", layers, config.temperature * (1.0 + 0.25 * k)) for k in range(config.tries)]
    return drives


def _network(config: DriverFit) -> nn.Sequential:
    torch.manual_seed(config.seed)
    sizes, layers = (VECTOR_SIZE, *config.widths, len(Manoeuvre)), list[nn.Module]()
    for inputs, outputs in pairwise(sizes):
        layers += [nn.Linear(inputs, outputs), nn.Tanh()]
    return nn.Sequential(*layers[:-1])


def _imitating(imitated: list[tuple[Trajectory, float]], config: DriverFit) -> nn.Sequential:
    """Fit a network to the imitated decisions, weighted by episode; rare manoeuvres get more weight (square root)."""
    network = _network(config)
    observations = torch.as_tensor(np.concatenate([trajectory.observations for trajectory, _ in imitated]))
    actions = torch.as_tensor(np.concatenate([trajectory.actions for trajectory, _ in imitated]))
    of_episode = np.concatenate([np.full(len(trajectory.actions), weight) for trajectory, weight in imitated])
    weights = torch.as_tensor(of_episode, dtype=torch.float32)
    counts = torch.bincount(actions, minlength=len(Manoeuvre)).clamp(min=1).float()
    weights *= (len(actions) / counts).sqrt()[actions]
    loss_of = nn.CrossEntropyLoss(reduction="none")
    descent = Descent(network, config, config.passes, rising=0.1, gradient_max=1.0)
    loss: Tensor
    for _ in range(config.passes):
        loss = (weights * loss_of(network(observations), actions)).sum() / weights.sum()
        descent.step(loss)
    return network.eval()
