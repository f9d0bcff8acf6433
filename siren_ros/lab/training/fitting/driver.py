"""Trains a driver for the civilian's seat that imitates the best of several drives of each episode.

In the first round experts drive, in later ones the driver itself too, also with manoeuvres that it would not choose:
what goes better than before is imitated (reward-ranked imitation).
"""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from itertools import cycle, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from siren_ros.base.params.network_file import write_network
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.errors import InputError
from siren_ros.lab.learning.imitation import EXPERTS, Layers, NetworkPolicy, Trajectory, best_of, roll_out
from siren_ros.lab.learning.options import EnvOptions
from siren_ros.lab.training.fitting.descent import Descent, exported
from siren_ros.lab.training.settings import DriverFit
from siren_ros.running.seat.drivers.learned import INPUT, OUTPUT
from siren_ros.running.seat.features import SIZE
from siren_ros.running.seat.manoeuvres import Manoeuvre

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
    fitted = exported(network, network, (torch.zeros(1, SIZE),), [INPUT], [OUTPUT], free)
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
    sizes, layers = (SIZE, *config.widths, len(Manoeuvre)), list[nn.Module]()
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
