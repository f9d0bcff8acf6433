"""Fits the network: the same samples, settings and seed give the same weights on the same machine."""

import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from siren_ros.evaluation.prediction.siren_model.features import Features
from siren_ros.training.fit_config import FitConfig
from siren_ros.training.fitting.network import NetworkSize, PathNetwork
from siren_ros.training.sample_store import SampleStore

_LEAST_STD: Final = 0.05
"""Columns that hardly vary are not blown up."""
_GRADIENT_MAX: Final = 5.0
_ROOT_EPSILON_M2: Final = 1e-4


@dataclass(frozen=True)
class Progress:
    """Means over an epoch."""

    epoch: int
    loss: float
    ade_m: float
    """Of the hypothesis that the network calls the most probable."""
    min_ade_m: float
    """Of the nearest hypothesis."""
    seconds: float


def fit(store: SampleStore, config: FitConfig, told: Callable[[Progress], None]) -> PathNetwork:
    """Trains a network from scratch.

    Args:
        store: The samples.
        config: Settings.
        told: Called after each epoch.
    """
    torch.manual_seed(config.seed)
    device = torch.device(config.device)
    network = _new_network(store, config).to(device)
    average = torch.optim.swa_utils.AveragedModel(
        network, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(config.averaging)
    )
    optimizer = torch.optim.AdamW(network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    size = min(config.batch, len(store))
    batches = len(store) // size
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, config.learning_rate, total_steps=config.epochs * batches, pct_start=0.1
    )
    order = np.random.default_rng(config.seed)
    start = time.monotonic()
    for epoch in range(config.epochs):
        network.train()
        shuffled = order.permutation(len(store))
        sums = torch.zeros(3, device=device)
        for number in range(batches):
            rows = np.sort(shuffled[number * size : (number + 1) * size])
            parts = losses(network(*tensors(store.batch(rows), device)), _tensor(store.truth_m[rows], device), config)
            optimizer.zero_grad()
            parts[0].backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), _GRADIENT_MAX)
            optimizer.step()
            schedule.step()
            average.update_parameters(network)
            sums += torch.stack([part.detach() for part in parts])
        loss, ade, least = (sums / batches).tolist()
        told(Progress(epoch, loss, ade, least, time.monotonic() - start))
    fitted: PathNetwork = average.module
    return fitted.cpu().eval()


def losses(answer: tuple[Tensor, Tensor], truth_m: Tensor, config: FitConfig) -> tuple[Tensor, Tensor, Tensor]:
    """The loss, and the ADE of the most probable and of the nearest hypothesis.

    The nearest hypothesis is drawn to the truth (the others slightly, so that none is left behind), the probabilities
    to the nearest hypothesis, and the most probable hypothesis to the truth: alone it has to be a good guess.

    Args:
        answer: Paths ``(N, MODES, FUTURE_POINTS, 2)`` and logits ``(N, MODES)``.
        truth_m: Shape ``(N, FUTURE_POINTS, 2)``.
        config: Settings.
    """
    xy_m, logits = answer
    miss = xy_m - truth_m[:, None]
    ade = torch.sqrt((miss * miss).sum(dim=-1) + _ROOT_EPSILON_M2).mean(dim=-1)
    nearest, likeliest = ade.detach().argmin(dim=1), logits.detach().argmax(dim=1)
    least = ade.gather(1, nearest[:, None]).mean()
    first = ade.gather(1, likeliest[:, None]).mean()
    surprise = torch.nn.functional.cross_entropy(logits, nearest)
    spread = config.share_of_all
    loss = (1.0 - spread) * least + spread * ade.mean() + config.first_weight * first
    return loss + config.probability_weight * surprise, first, least


def tensors(features: Features, device: torch.device | str = "cpu") -> list[Tensor]:
    """The arguments of the network."""
    return [_tensor(getattr(features, field.name), device) for field in fields(Features)]


def _tensor(values: npt.NDArray[Any], device: torch.device | str) -> Tensor:
    return torch.from_numpy(values).to(device)


def _new_network(store: SampleStore, config: FitConfig) -> PathNetwork:
    features = store.features
    size = NetworkSize(
        target=features.target.shape[1],
        neighbour=features.neighbours.shape[2],
        path=features.paths.shape[2],
        width=config.width,
        layers=config.layers,
    )
    network = PathNetwork(size)
    for name, values in (
        ("target", features.target),
        ("neighbour", features.neighbours[features.neighbour_there]),
        ("path", features.paths[features.path_there]),
    ):
        if len(values) == 0:
            continue
        columns = values.astype(np.float32)
        getattr(network, f"{name}_mean").copy_(torch.from_numpy(columns.mean(axis=0)))
        getattr(network, f"{name}_std").copy_(torch.from_numpy(np.maximum(columns.std(axis=0), _LEAST_STD)))
    return network
