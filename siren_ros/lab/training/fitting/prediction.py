"""The predictor's network and its fitting; equal samples, settings and seed give equal weights on one machine."""

import hashlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from siren_ros.base.processes.interrupts import deferred_interrupts
from siren_ros.errors import InputError, whole_file, writing
from siren_ros.lab.training.fitting.descent import Descent, exported
from siren_ros.lab.training.fitting.networks import LstmNetwork, NetworkSize, PathNetwork, TransformerNetwork
from siren_ros.lab.training.prediction.samples import SampleStore
from siren_ros.lab.training.settings import FitConfig, FittedNetwork
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import OUTPUTS, SHAPES, Features

_LEAST_STD: Final = 0.05
"""Smallest spread for normalisation, so that nearly constant columns are not amplified."""
_ROOT_EPSILON_M2: Final = 1e-4


@dataclass(frozen=True)
class EpochMeans:
    """Mean values of an epoch."""

    epoch: int
    loss: float
    ade_m: float
    """ADE of the hypothesis with the highest probability."""
    min_ade_m: float
    """ADE of the nearest hypothesis."""
    seconds: float


@dataclass
class Fitting:
    """State of a training."""

    network: Any
    """A network of ``NETWORKS``; at the end the final one."""
    epoch: int = 0
    batch: int = 0
    """Number of completed batches of the epoch."""
    sums: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Sums of losses in the epoch."""
    processor_s: float = 0.0
    """Processor time since the first step, over all runs that continued from a checkpoint."""


def fit(
    store: SampleStore, config: FitConfig, report: Callable[[EpochMeans], None], checkpoint: Path | None = None
) -> Fitting:
    """Train a network, from its checkpoint if there is one; ``report`` is called after each epoch.

    The checkpoint is written after each epoch, and when the program is interrupted. A training that goes on from it
    gives the same weights as one that was not interrupted. At the end it is removed.

    Raises:
        InputError: The checkpoint is of other samples, settings or another seed, or none at all.
        KeyboardInterrupt: SIGINT or SIGTERM came.
    """
    torch.manual_seed(config.seed)
    device = torch.device(config.device)
    network = _new_network(store, config).to(device)
    size = min(config.batch, len(store))
    batches = len(store) // size
    descent = Descent(
        network, config, config.epochs * batches, rising=0.1, gradient_max=5.0, averaging=config.averaging
    )
    run, digest = Fitting(network), _digest(store, config)
    if checkpoint is not None and checkpoint.exists():
        _restore(run, descent, _read(checkpoint, digest), batches)
    order, start = np.random.default_rng(config.seed), time.monotonic()
    spent_s = run.processor_s - time.process_time()
    for _ in range(run.epoch):
        order.permutation(len(store))
    with deferred_interrupts() as interrupted:
        while run.epoch < config.epochs and not interrupted():
            network.train()
            shuffled = order.permutation(len(store))
            while run.batch < batches and not interrupted():
                rows = np.sort(shuffled[run.batch * size : (run.batch + 1) * size])
                parts = losses(
                    network(*tensors(store.batch(rows), device)), _tensor(store.truth_m[rows], device), config
                )
                descent.step(parts[0])
                run.batch += 1
                run.sums = [total + float(part.detach()) for total, part in zip(run.sums, parts, strict=True)]
            if run.batch == batches:
                loss, ade, least = (total / batches for total in run.sums)
                report(EpochMeans(run.epoch, loss, ade, least, time.monotonic() - start))
                run.epoch, run.batch, run.sums = run.epoch + 1, 0, [0.0, 0.0, 0.0]
            run.processor_s = spent_s + time.process_time()
            if checkpoint is not None:
                _write(checkpoint, digest, run, descent)
    if run.epoch < config.epochs:
        raise KeyboardInterrupt  # the training has not finished, however the program handles the signal
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    run.network = descent.result()
    return run


def _digest(store: SampleStore, config: FitConfig) -> str:
    samples = hashlib.sha256(store.truth_m.tobytes() + store.features.target.tobytes()).hexdigest()
    return repr((samples, config))


def _write(checkpoint: Path, digest: str, run: Fitting, descent: Descent) -> None:
    numbers = {"epoch": run.epoch, "batch": run.batch, "sums": run.sums, "processor_s": run.processor_s}
    with writing(checkpoint, "place", "checkpoint"):
        checkpoint.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(checkpoint) as new:
            torch.save({"digest": digest, **numbers, "random": torch.get_rng_state(), **descent.state()}, new)


def _read(checkpoint: Path, digest: str) -> dict[str, Any]:
    try:
        state: dict[str, Any] = torch.load(checkpoint, weights_only=True, map_location="cpu")
    except Exception as error:  # torch's errors have no common class
        raise InputError("checkpoint", str(checkpoint), f"a checkpoint of this training ({error})") from error
    if state.get("digest") != digest:
        raise InputError("checkpoint", str(checkpoint), "one of the same samples, settings and seed, or none")
    return state


def _restore(run: Fitting, descent: Descent, state: dict[str, Any], batches: int) -> None:
    run.epoch, run.batch, run.sums = state["epoch"], state["batch"], state["sums"]
    run.processor_s = state["processor_s"]
    descent.go_on(state, run.epoch * batches + run.batch)
    torch.set_rng_state(state["random"])


def losses(answer: tuple[Tensor, Tensor], truth_m: Tensor, config: FitConfig) -> tuple[Tensor, Tensor, Tensor]:
    """The loss, and the ADE of the most probable and of the nearest hypothesis.

    The nearest hypothesis is drawn to the truth (the others slightly, so that none is left behind), the probabilities
    to the nearest hypothesis, and the most probable hypothesis to the truth: alone it has to be a good guess.

    ``answer`` has paths ``(N, MODES, FUTURE_POINTS, 2)`` and logits ``(N, MODES)``; ``truth_m`` has the shape
    ``(N, FUTURE_POINTS, 2)``.
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
    """Arguments of the network as tensors."""
    return [_tensor(getattr(features, field.name), device) for field in fields(Features)]


def _tensor(values: npt.NDArray[Any], device: torch.device | str) -> Tensor:
    return torch.from_numpy(values).to(device)


NETWORKS: Final[Mapping[str, Callable[[NetworkSize], Any]]] = {
    "paths": PathNetwork,
    "lstm": LstmNetwork,
    "transformer": TransformerNetwork,
}
"""Networks by the names of ``ARCHITECTURES``; all have the inputs and outputs of ``PathNetwork``."""


def _new_network(store: SampleStore, config: FitConfig) -> Any:
    features = store.features
    columns = (features.target.shape[1], features.neighbours.shape[2], features.paths.shape[2])
    network = NETWORKS[config.architecture](NetworkSize(*columns, width=config.width, layers=config.layers))
    for name, values in (
        ("target", features.target),
        ("neighbour", features.neighbours[features.neighbour_there]),
        ("path", features.paths[features.path_there]),
    ):
        if len(values):
            single = values.astype(np.float32)
            getattr(network, f"{name}_mean").copy_(torch.from_numpy(single.mean(axis=0)))
            getattr(network, f"{name}_std").copy_(torch.from_numpy(np.maximum(single.std(axis=0), _LEAST_STD)))
    return network


class _Answer(nn.Module):
    """Converts logits to probabilities for the exported network."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, *features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        xy_m, logits = self.network(*features)
        return xy_m, torch.softmax(logits, dim=-1)


def export(network: Any) -> FittedNetwork:
    """Export the network for any number of samples; inputs have the names of the fields of ``Features``."""
    samples, size = 2, network.size
    shapes = {
        "target": (samples, size.target),
        "speed_mps": (samples,),
        "neighbours": (samples, SHAPES["neighbours"], size.neighbour),
        "neighbour_there": (samples, SHAPES["neighbours"]),
        "path_points_m": (samples, SHAPES["paths"], SHAPES["path_points"], 2),
        "path_spacing_m": (samples,),
        "paths": (samples, SHAPES["paths"], size.path),
        "path_there": (samples, SHAPES["paths"]),
    }
    names = [field.name for field in fields(Features)]
    kinds = {name: torch.bool if name.endswith("_there") else torch.float32 for name in names}
    example = tuple(torch.ones(shapes[name], dtype=kind) for name, kind in kinds.items())
    return exported(network, _Answer(network), example, names, OUTPUTS, dict.fromkeys([*names, *OUTPUTS], "samples"))


def fitted_network(
    store: SampleStore, config: FitConfig, checkpoint: Path, report: Callable[[str], None]
) -> FittedNetwork:
    """Fit a network and export it; ``report`` is called with a line after each epoch."""

    def report_means(progress: EpochMeans) -> None:
        report(
            f"epoch {progress.epoch + 1}/{config.epochs}: loss {progress.loss:.3f}, ADE {progress.ade_m:.3f} m, "
            f"minADE6 {progress.min_ade_m:.3f} m, {progress.seconds:.0f} s"
        )

    run = fit(store, config, report_means, checkpoint)
    return replace(export(run.network), processor_s=run.processor_s)
