"""Fits the network: the same frames, settings and seed give the same weights on the same machine."""

import math
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.pillars.pillars import Pillars
from siren_ros.training.detection.fit_config import DetectionFit, NetworkSize
from siren_ros.training.detection.fitting.losses import losses
from siren_ros.training.detection.fitting.network import PillarNetwork
from siren_ros.training.detection.frame_draws import FrameDraws
from siren_ros.training.detection.targets import Targets

_GRADIENT_MAX: Final = 10.0
_WARM_UP: Final = 0.03
_DECAY: Final = 0.5
"""The last share of the steps, in which the rate falls to 0: until then a run may be made longer."""


@dataclass(frozen=True)
class Progress:
    """Means since the last report."""

    step: int
    loss: float
    heat: float
    box: float
    named: float
    seconds: float


@dataclass(frozen=True)
class Fitted:
    """What a training ends with."""

    network: PillarNetwork
    processor_s: float
    """Processor time of all its steps."""
    plans: tuple[tuple[int, int, int], ...]
    """What the steps followed: from which step, of how many, on how many frames."""


@dataclass
class _Run:
    network: PillarNetwork
    average: PillarNetwork
    optimizer: torch.optim.Optimizer
    step: int = 0
    processor_s: float = 0.0
    """Since the first step, over all programs that went on from a checkpoint."""
    sums: list[Tensor] = field(default_factory=list)
    plans: list[tuple[int, int, int]] = field(default_factory=list)

    def state(self, digest: str) -> dict[str, Any]:
        return {
            "digest": digest,
            "step": self.step,
            "processor_s": self.processor_s,
            "plans": [list(plan) for plan in self.plans],
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        self.step, self.processor_s = int(state["step"]), float(state["processor_s"])
        self.plans = [(first, steps, frames) for first, steps, frames in state["plans"]]
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimizer.load_state_dict(state["optimizer"])


def fit(
    draws: FrameDraws,
    size: NetworkSize,
    config: DetectionFit,
    checkpoint: Path | None,
    told: Callable[[Progress], bool],
) -> Fitted | None:
    """Trains a network, from its checkpoint where there is one.

    More frames and another number of steps may be asked for than when the checkpoint was written.

    Args:
        draws: The frames.
        size: Of the network.
        config: Settings.
        checkpoint: File that the state is kept in; None keeps none.
        told: Called after every ``checkpoint_steps``; False stops the training there.

    Returns:
        The result; None where the training was stopped.

    Raises:
        InputError: The checkpoint is of another grid, size or seed, or no checkpoint at all.
    """
    run = _new_run(draws, size, config)
    digest = repr((draws.grid, draws.seed, draws.batch, size))
    if checkpoint is not None and checkpoint.exists():
        run.restore(_read(checkpoint, digest))
    if run.step < config.steps and (not run.plans or run.plans[-1][1:] != (config.steps, len(draws))):
        run.plans.append((run.step, config.steps, len(draws)))
    device, start = torch.device(config.device), time.monotonic()
    spent_s = run.processor_s - time.process_time()
    while run.step < config.steps:
        _train_step(run, draws.batch_of(run.step), config, device)
        run.step += 1
        if run.step % config.checkpoint_steps == 0 or run.step == config.steps:
            loss, heat, box, named = torch.stack(run.sums).mean(dim=0).tolist()
            run.sums.clear()
            run.processor_s = spent_s + time.process_time()
            if checkpoint is not None:
                _write(checkpoint, run.state(digest))
            goes_on = told(Progress(run.step, loss, heat, box, named, time.monotonic() - start))
            if not goes_on and run.step < config.steps:
                return None
    return Fitted(run.average.cpu().eval(), run.processor_s, tuple(run.plans))


def _new_run(draws: FrameDraws, size: NetworkSize, config: DetectionFit) -> _Run:
    torch.manual_seed(config.seed)
    network = PillarNetwork(draws.grid, size).to(config.device, memory_format=torch.channels_last)
    average = deepcopy(network)
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, betas=(0.9, 0.99)
    )
    return _Run(network, average, optimizer)


def _train_step(run: _Run, frames: list[tuple[Pillars, Targets]], config: DetectionFit, device: torch.device) -> None:
    for group in run.optimizer.param_groups:
        group["lr"] = config.learning_rate * rate_at(run.step / config.steps)
    run.network.train()
    points, cell = (part.to(device) for part in pillar_tensors([pillars for pillars, _ in frames], run.network))
    maps, boxes = _target_tensors([targets for _, targets in frames], device)
    with torch.autocast(device.type, torch.bfloat16, enabled=config.half):
        answer = run.network(points, cell, len(frames))
    parts = losses(answer, maps, boxes, config)
    run.optimizer.zero_grad()
    parts[0].backward()
    torch.nn.utils.clip_grad_norm_(run.network.parameters(), _GRADIENT_MAX)
    run.optimizer.step()
    _follow(run.average, run.network, min(config.averaging, (1.0 + run.step) / (10.0 + run.step)))
    run.sums.append(torch.stack([part.detach().cpu() for part in parts]))


def rate_at(share: float) -> float:
    """The learning rate after a share of the steps, over the highest: rises, stays, and falls as a cosine."""
    if share < _WARM_UP:
        return 0.1 + 0.9 * share / _WARM_UP
    fallen = max(0.0, (share - (1.0 - _DECAY)) / _DECAY)
    return 0.5 * (1.0 + math.cos(math.pi * fallen))


def pillar_tensors(frames: list[Pillars], network: PillarNetwork) -> tuple[Tensor, Tensor]:
    """The arguments of the network for some frames."""
    side = network.grid.cells**2
    cell = np.concatenate([pillars.cell + number * side for number, pillars in enumerate(frames)])
    return torch.from_numpy(np.concatenate([pillars.points for pillars in frames])), torch.from_numpy(cell)


def _target_tensors(
    targets: list[Targets], device: torch.device
) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor, Tensor, Tensor]]:
    side = targets[0].heat.size
    cell = np.concatenate([each.cell + number * side for number, each in enumerate(targets)])
    heat, counts = (np.stack([getattr(each, name) for each in targets]) for name in ("heat", "counts"))
    box, weight, label = (np.concatenate([getattr(each, name) for each in targets]) for name in _BOX_ARRAYS)
    maps = torch.from_numpy(heat).to(device), torch.from_numpy(counts).to(device)
    at_cells = (torch.from_numpy(values).to(device) for values in (cell, box, weight, label))
    first, second, third, fourth = at_cells
    return maps, (first, second, third, fourth)


_BOX_ARRAYS: Final = ("box", "weight", "label")


def _follow(average: PillarNetwork, network: PillarNetwork, kept: float) -> None:
    """Moves the running mean of the weights, and of the statistics of the normalisations."""
    own, others = average.state_dict(), network.state_dict()
    with torch.no_grad():
        for name, values in own.items():
            if values.is_floating_point():
                values.lerp_(others[name], 1.0 - kept)
            else:
                values.copy_(others[name])


def _write(path: Path, state: dict[str, Any]) -> None:
    unfinished = path.with_suffix(".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        torch.save(state, unfinished)
        unfinished.replace(path)
    except OSError as error:
        raise InputError("checkpoint", str(path), f"a place that can be written ({error.strerror})") from error


def _read(path: Path, digest: str) -> dict[str, Any]:
    try:
        state: dict[str, Any] = torch.load(path, weights_only=True, map_location="cpu")
    except Exception as error:  # torch has no common class of its errors
        raise InputError("checkpoint", str(path), f"a checkpoint of this training ({error})") from error
    if state.get("digest") != digest or "plans" not in state:
        raise InputError("checkpoint", str(path), "one of the same grid, size, seed and batch, or none")
    return state
