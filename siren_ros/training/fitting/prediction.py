"""The predictor's network and its fitting: the same samples, settings and seed give the same weights on one machine."""

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from siren_ros.errors import InputError, whole_file, writing
from siren_ros.evaluation.prediction.samples import FUTURE_POINTS, future_times_s
from siren_ros.evaluation.prediction.siren_model.siren_predictor import OUTPUTS, SHAPES, Features
from siren_ros.processes.interrupts import deferred_interrupts
from siren_ros.training.fitting.descent import Descent, exported
from siren_ros.training.prediction.samples import SampleStore
from siren_ros.training.settings import FitConfig, FittedNetwork

MODES: Final = 6
_SPEED_UNIT_MPS: Final = 3.0
"""Unit of the answers along the path: mean deviation from the present speed until each time."""
_SIDEWAYS_UNIT_MPS: Final = 0.7
"""The same across the path."""


@dataclass(frozen=True)
class NetworkSize:
    """Sizes of the layers."""

    target: int
    """Columns of the features."""
    neighbour: int
    path: int
    width: int = 64
    heads: int = 4
    layers: int = 2
    dropout: float = 0.05


class Attention(nn.Module):
    """Multi-head attention of some tokens over others, with a feed-forward part; normalised before each."""

    def __init__(self, width: int, heads: int, dropout: float) -> None:
        super().__init__()
        self.heads = heads
        self.before_query, self.before_source = nn.LayerNorm(width), nn.LayerNorm(width)
        self.query, self.key_value = nn.Linear(width, width), nn.Linear(width, 2 * width)
        self.merge = nn.Linear(width, width)
        self.forward_part = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )
        self.dropout = nn.Dropout(dropout)

    def forward(self, tokens: Tensor, source: Tensor, hidden: Tensor) -> Tensor:
        """Tokens ``(N, A, width)``, source ``(N, B, width)``; ``hidden`` is 0 or very negative, ``(N, B)``."""
        rows, wide = tokens.shape[1], tokens.shape[2] // self.heads
        query = self.query(self.before_query(tokens)).reshape(-1, rows, self.heads, wide).transpose(1, 2)
        both = (
            self.key_value(self.before_source(source))
            .reshape(-1, source.shape[1], 2, self.heads, wide)
            .permute(2, 0, 3, 1, 4)
        )
        scores = query @ both[0].transpose(-1, -2) * wide**-0.5 + hidden[:, None, None]
        seen = (torch.softmax(scores, dim=-1) @ both[1]).transpose(1, 2).reshape(-1, rows, self.heads * wide)
        tokens = tokens + self.dropout(self.merge(seen))
        return tokens + self.dropout(self.forward_part(tokens))


class PathNetwork(nn.Module):
    """Six hypotheses as motion along and across a mixture of the sample's paths and of its straight heading.

    Before training, every hypothesis keeps the present speed along the likeliest paths.
    """

    times_s: Tensor
    target_mean: Tensor
    target_std: Tensor
    neighbour_mean: Tensor
    neighbour_std: Tensor
    path_mean: Tensor
    path_std: Tensor

    def __init__(self, size: NetworkSize) -> None:
        super().__init__()
        self.size, width = size, size.width
        self.target_in = _encoder(size.target, width)
        self.neighbour_in = _encoder(size.neighbour, width)
        self.path_in = _encoder(size.path + 2 * len(_SHOWN_POINTS), width)
        self.heading = nn.Parameter(0.1 * torch.randn(1, 1, width))
        self.over_neighbours = nn.ModuleList(Attention(width, size.heads, size.dropout) for _ in range(size.layers))
        self.over_road = nn.ModuleList(Attention(width, size.heads, size.dropout) for _ in range(size.layers))
        self.modes = nn.Parameter(torch.randn(MODES, width))
        self.merge = nn.Sequential(nn.Linear(2 * width, 2 * width), nn.GELU(), nn.Linear(2 * width, width), nn.GELU())
        self.choose = nn.Linear(width, width)
        self.drive = nn.Sequential(nn.Linear(3 * width, 2 * width), nn.GELU(), nn.Linear(2 * width, 2 * FUTURE_POINTS))
        self.likely = nn.Sequential(nn.Linear(3 * width, width), nn.GELU(), nn.Linear(width, 1))
        nn.init.zeros_(self.drive[-1].weight)
        nn.init.zeros_(self.drive[-1].bias)
        self.register_buffer("times_s", torch.tensor(future_times_s(), dtype=torch.float32))
        for name, columns in (("target", size.target), ("neighbour", size.neighbour), ("path", size.path)):
            self.register_buffer(f"{name}_mean", torch.zeros(columns))
            self.register_buffer(f"{name}_std", torch.ones(columns))

    def forward(
        self,
        target: Tensor,
        speed_mps: Tensor,
        neighbours: Tensor,
        neighbour_there: Tensor,
        path_points_m: Tensor,
        path_spacing_m: Tensor,
        paths: Tensor,
        path_there: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Paths in the samples' frames, ``(N, MODES, FUTURE_POINTS, 2)`` in metres, and logits ``(N, MODES)``.

        The arguments are the fields of ``Features``.
        """
        vehicle = self.target_in((target - self.target_mean) / self.target_std)[:, None]
        others = self.neighbour_in((neighbours - self.neighbour_mean) / self.neighbour_std)
        road = self.path_in(torch.cat((_shapes(path_points_m), (paths - self.path_mean) / self.path_std), dim=-1))
        heading = self.heading.expand(target.shape[0], 1, -1)
        tokens = torch.cat((vehicle, heading, road), dim=1)
        hide_others = torch.cat((torch.zeros_like(speed_mps)[:, None], _hiding(neighbour_there)), dim=1)
        hide_road = torch.cat((torch.zeros_like(speed_mps)[:, None].expand(-1, 2), _hiding(path_there)), dim=1)
        for over_neighbours, over_road in zip(self.over_neighbours, self.over_road, strict=True):
            tokens = over_neighbours(tokens, torch.cat((tokens[:, :1], others), dim=1), hide_others)
            tokens = over_road(tokens, tokens, hide_road)
        return self._drive(tokens, hide_road[:, 1:], speed_mps, path_points_m, path_spacing_m)

    def _drive(
        self, tokens: Tensor, hidden: Tensor, speed_mps: Tensor, path_points_m: Tensor, path_spacing_m: Tensor
    ) -> tuple[Tensor, Tensor]:
        vehicle, ways = tokens[:, :1].expand(-1, MODES, -1), tokens[:, 1:]
        intent = self.merge(torch.cat((vehicle, self.modes.expand(tokens.shape[0], -1, -1)), dim=-1))
        scores = self.choose(intent) @ ways.transpose(-1, -2) * ways.shape[-1] ** -0.5
        share = torch.softmax(scores + hidden[:, None], dim=-1)
        context = torch.cat((vehicle, intent, share @ ways), dim=-1)
        answer = self.drive(context).reshape(-1, MODES, 2, FUTURE_POINTS)
        along = self.times_s * (speed_mps[:, None, None] + _SPEED_UNIT_MPS * answer[:, :, 0])
        across = self.times_s * _SIDEWAYS_UNIT_MPS * answer[:, :, 1]
        straight = torch.stack((along, across), dim=-1)
        on_paths = _on_paths(path_points_m, path_spacing_m, along, across)
        mixed = (share.transpose(1, 2)[:, 1:, :, None, None] * on_paths).sum(dim=1)
        return share[:, :, :1, None] * straight + mixed, self.likely(context)[..., 0]


def _encoder(columns: int, width: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(columns, 2 * width), nn.GELU(), nn.Linear(2 * width, width))


_SHOWN_POINTS: Final = (2, 5, 8, 11, 15, 19, 23, 27, 31)
_SHAPE_SCALE_M: Final = 30.0


def _shapes(points_m: Tensor) -> Tensor:
    """Some points of each path as columns."""
    shown = points_m[:, :, list(_SHOWN_POINTS)] / _SHAPE_SCALE_M
    return shown.reshape(-1, points_m.shape[1], 2 * len(_SHOWN_POINTS))


def _hiding(there: Tensor) -> Tensor:
    return (there.to(torch.float32) - 1.0) * 1e4


def _on_paths(points_m: Tensor, spacing_m: Tensor, along_m: Tensor, across_m: Tensor) -> Tensor:
    """Places along paths, moved sideways, ``(N, P, M, T, 2)``; straight on past both ends.

    Args:
        points_m: Points of the paths, ``(N, P, K, 2)``.
        spacing_m: Between consecutive points, ``(N,)``.
        along_m: Arc lengths, ``(N, M, T)``.
        across_m: Offsets to the left, ``(N, M, T)``.
    """
    paths, points = points_m.shape[1], points_m.shape[2]
    position = along_m / spacing_m[:, None, None]
    index = torch.clamp(torch.floor(position.detach()), 0, points - 2)
    within = (position - index)[:, None, ..., None]
    flat = index.to(torch.int64).reshape(-1, 1, MODES * FUTURE_POINTS, 1).expand(-1, paths, -1, 2)
    shape = (-1, paths, MODES, FUTURE_POINTS, 2)
    start = torch.gather(points_m, 2, flat).reshape(shape)
    delta = torch.gather(points_m, 2, flat + 1).reshape(shape) - start
    length = torch.sqrt((delta * delta).sum(dim=-1, keepdim=True) + 1e-6)
    normal = torch.stack((-delta[..., 1], delta[..., 0]), dim=-1) / length
    return start + within * delta + across_m[:, None, ..., None] * normal


_LEAST_STD: Final = 0.05
"""Columns that hardly vary are not blown up."""
_ROOT_EPSILON_M2: Final = 1e-4


@dataclass(frozen=True)
class EpochMeans:
    """Means over an epoch."""

    epoch: int
    loss: float
    ade_m: float
    """Of the hypothesis that the network calls the most probable."""
    min_ade_m: float
    """Of the nearest hypothesis."""
    seconds: float


@dataclass
class Fitting:
    """A training under way, or at its end."""

    network: PathNetwork
    """At the end the one to keep."""
    epoch: int = 0
    batch: int = 0
    """Batches of the epoch that are done."""
    sums: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Losses of the epoch."""
    processor_s: float = 0.0
    """Since the first step, over all programs that went on from a checkpoint."""


def fit(
    store: SampleStore, config: FitConfig, report: Callable[[EpochMeans], None], checkpoint: Path | None = None
) -> Fitting:
    """Trains a network, from its checkpoint where there is one; ``report`` is called after each epoch.

    The checkpoint is written after each epoch, and when the program is interrupted. A training that goes on from it
    gives the same weights as one that was not interrupted. At the end it is removed.

    Raises:
        InputError: The checkpoint is of other samples, settings or another seed, or none at all.
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
    except Exception as error:  # torch has no common class of its errors
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
    """The arguments of the network."""
    return [_tensor(getattr(features, field.name), device) for field in fields(Features)]


def _tensor(values: npt.NDArray[Any], device: torch.device | str) -> Tensor:
    return torch.from_numpy(values).to(device)


def _new_network(store: SampleStore, config: FitConfig) -> PathNetwork:
    features = store.features
    columns = (features.target.shape[1], features.neighbours.shape[2], features.paths.shape[2])
    network = PathNetwork(NetworkSize(*columns, width=config.width, layers=config.layers))
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
    """Probabilities in place of logits."""

    def __init__(self, network: PathNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        xy_m, logits = self.network(*features)
        return xy_m, torch.softmax(logits, dim=-1)


def export(network: PathNetwork) -> FittedNetwork:
    """The network with any number of samples; inputs are named like the fields of ``Features``."""
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
    """Fits a network and exports it; ``report`` is called with a line after each epoch."""

    def report_means(progress: EpochMeans) -> None:
        report(
            f"epoch {progress.epoch + 1}/{config.epochs}: loss {progress.loss:.3f}, ADE {progress.ade_m:.3f} m, "
            f"minADE6 {progress.min_ade_m:.3f} m, {progress.seconds:.0f} s"
        )

    run = fit(store, config, report_means, checkpoint)
    return replace(export(run.network), processor_s=run.processor_s)
