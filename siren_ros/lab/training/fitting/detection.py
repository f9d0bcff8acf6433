"""The detector's network and its fitting; equal frames, settings and seed give equal weights on one machine."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from siren_ros.errors import InputError, whole_file, writing
from siren_ros.lab.training.detection.samples import BOX_CHANNELS, STRIDE, FrameDraws, Targets
from siren_ros.lab.training.fitting.descent import Descent, exported
from siren_ros.lab.training.settings import DetectionFit, FittedNetwork, NetworkSize
from siren_ros.scoring.evaluation.detection.boxes import CLASS_NAMES
from siren_ros.scoring.evaluation.detection.pillar_detector import FEATURES, INPUTS, OUTPUTS, PillarGrid, Pillars

_PRIOR_LOGIT: Final = -4.0
"""Initial logit: before training, a cell has a vehicle with a probability of 2 %."""
_SPEED_SCALE_MPS: Final = 5.0


class PillarFeatures(nn.Module):
    """PointPillars' feature net: one layer for each point, then the maximum of each channel over the pillar.

    The largest comes before normalisation and rectifier, which are monotonic: the same family of functions, at a small
    part of the cost.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.layer = nn.Linear(len(FEATURES), width, bias=False)
        self.norm = nn.BatchNorm1d(width)

    def forward(self, points: Tensor) -> Tensor:
        """Map pillars ``(P, N, 10)`` to features ``(P, width)``."""
        return torch.relu(self.norm(self.layer(points).max(dim=1).values.float()))


class PillarNetwork(nn.Module):
    """Maps pillars to a heat map, boxes and classes."""

    def __init__(self, grid: PillarGrid, size: NetworkSize) -> None:
        super().__init__()
        self.grid, self.size = grid, size
        self.pillars = PillarFeatures(size.pillar)
        self.stem = _convolution(size.pillar, size.pillar, stride=2)
        widths = (size.pillar, *size.stages)
        self.stages = nn.ModuleList(
            nn.Sequential(
                _convolution(before, width, stride=2), *(_convolution(width, width) for _ in range(size.layers - 1))
            )
            for before, width in zip(widths, size.stages, strict=False)
        )
        self.neck = nn.ModuleList(
            nn.Sequential(
                nn.ConvTranspose2d(width, size.neck, 2**level, stride=2**level, bias=False),
                nn.BatchNorm2d(size.neck),
                nn.ReLU(inplace=True),
            )
            for level, width in enumerate(size.stages)
        )
        self.shared = _convolution(size.neck * len(size.stages), size.head)
        self.heat = nn.Sequential(_convolution(size.head, size.head), nn.Conv2d(size.head, 1 + len(CLASS_NAMES), 1))
        self.box = nn.Sequential(_convolution(size.head, size.head), nn.Conv2d(size.head, len(BOX_CHANNELS), 1))
        last = self.heat[-1]
        nn.init.zeros_(last.bias)
        with torch.no_grad():
            last.bias[0] = _PRIOR_LOGIT

    def forward(self, points: Tensor, cell: Tensor, frames: int = 1) -> tuple[Tensor, Tensor, Tensor]:
        """Compute logits of vehicles ``(B, R, R)``, logits of classes ``(B, C, R, R)``, boxes ``(B, 10, R, R)``.

        Args:
            points: Points as in ``Pillars``, those of all frames one after the other.
            cell: Likewise, plus ``cells²`` for every frame before.
            frames: B, how many.
        """
        features = self.pillars(points)
        side = self.grid.cells
        canvas = features.new_zeros((frames * side * side, features.shape[1]))
        canvas = canvas.index_put((cell,), features)
        seen = self.stem(canvas.reshape(frames, side, side, -1).permute(0, 3, 1, 2))
        parts = []
        for stage, up in zip(self.stages, self.neck, strict=True):
            seen = stage(seen)
            parts.append(up(seen))
        shared = self.shared(torch.cat(parts, dim=1))
        heat, box = self.heat(shared).float(), self.box(shared).float()
        scale = box.new_tensor([1.0] * 8 + [_SPEED_SCALE_MPS] * 2)[None, :, None, None]
        return heat[:, 0], heat[:, 1:], box * scale


def _convolution(before: int, after: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, after, 3, stride=stride, padding=1, bias=False), nn.BatchNorm2d(after), nn.ReLU(inplace=True)
    )


_CHANNEL_WEIGHT: Final = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.2, 0.2)
"""Weights of box channels as in CenterPoint: velocities are larger numbers and get 0.2."""


def heat_loss(logit: Tensor, heat: Tensor, counts: Tensor) -> Tensor:
    """Focal loss of CornerNet for a heat map, divided by the number of vehicles.

    Arguments have the shape ``(B, R, R)``: the logit of a vehicle, and the fields of ``Targets``.
    """
    share = torch.sigmoid(logit)
    sure, unsure = torch.nn.functional.logsigmoid(logit), torch.nn.functional.logsigmoid(-logit)
    centre = (heat > 0.999).to(logit.dtype)
    hit = centre * (1.0 - share) ** 2 * sure
    alarm = (1.0 - centre) * (1.0 - heat) ** 4 * share**2 * unsure
    return -((hit + alarm) * counts).sum() / centre.sum().clamp(min=1.0)


def box_loss(answer: Tensor, box: Tensor, weight: Tensor) -> Tensor:
    """Absolute differences divided by the cells' weights; arguments of shapes ``(T, 10)``, ``(T, 10)``, ``(T,)``."""
    channels = answer.new_tensor(_CHANNEL_WEIGHT)
    return ((answer - box).abs() * channels * weight[:, None]).sum() / weight.sum().clamp(min=1.0)


def losses(
    answer: tuple[Tensor, Tensor, Tensor], targets: dict[str, Tensor], config: DetectionFit
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Total loss of the network's answer, and its parts: heat, boxes, classes.

    ``targets`` are those of all frames by the fields of ``Targets``: maps of shape ``(B, R, R)``, cells counted on over
    the frames.
    """
    logit, classes, boxes = answer
    cell, weight = targets["cell"], targets["weight"]
    heat = heat_loss(logit, targets["heat"], targets["counts"])
    at_cells = boxes.permute(0, 2, 3, 1).reshape(-1, boxes.shape[1])[cell]
    of_class = classes.permute(0, 2, 3, 1).reshape(-1, classes.shape[1])[cell]
    boxed = box_loss(at_cells, targets["box"], weight)
    surprise = torch.nn.functional.cross_entropy(of_class, targets["label"], reduction="none")
    named = (surprise * weight).sum() / weight.sum().clamp(min=1.0)
    return heat + config.box_weight * boxed + config.class_weight * named, heat, boxed, named


_CHECKPOINT_FORM: Final = 2


@dataclass(frozen=True)
class StepMeans:
    """Mean values since the last report."""

    step: int
    loss: float
    heat: float
    box: float
    named: float
    seconds: float


@dataclass
class Fitting:
    """State of a training."""

    network: PillarNetwork
    """The network; at the end the final one."""
    descent: Descent
    step: int = 0
    processor_s: float = 0.0
    """Processor time since the first step, over all runs that continued from a checkpoint."""
    sums: list[Tensor] = field(default_factory=list)
    """Losses since the last report."""
    plans: list[tuple[int, int, int]] = field(default_factory=list)
    """History of the steps: first step, planned number of steps, number of frames."""

    def state(self) -> dict[str, Any]:
        """State from which ``restore`` can continue."""
        plans = [list(plan) for plan in self.plans]
        return {"step": self.step, "processor_s": self.processor_s, "plans": plans, **self.descent.state()}

    def restore(self, state: dict[str, Any], steps: int) -> None:
        """Continue from a checkpoint to the given number of steps."""
        self.step, self.processor_s = int(state["step"]), float(state["processor_s"])
        self.plans = [(first, steps, frames) for first, steps, frames in state["plans"]]
        self.descent.go_on(state, min(self.step, steps))

    def train_step(self, frames: list[tuple[Pillars, Targets]], config: DetectionFit, device: torch.device) -> None:
        """Make one step on a batch."""
        self.network.train()
        points, cell = (part.to(device) for part in pillar_tensors([pillars for pillars, _ in frames], self.network))
        with torch.autocast(device.type, torch.bfloat16, enabled=config.half):
            answer = self.network(points, cell, len(frames))
        parts = losses(answer, _target_tensors([targets for _, targets in frames], device), config)
        self.descent.step(parts[0])
        self.step += 1
        self.sums.append(torch.stack([part.detach().cpu() for part in parts]))


def fit(
    draws: FrameDraws,
    size: NetworkSize,
    config: DetectionFit,
    checkpoint: Path | None,
    report: Callable[[StepMeans], bool],
) -> Fitting | None:
    """Train a network, from its checkpoint if there is one; None if the training was stopped.

    More frames and another number of steps may be asked for than when the checkpoint was written. ``report`` is called
    after every ``checkpoint_steps``; False stops the training there.

    Raises:
        InputError: The checkpoint is of another grid, size or seed, or no checkpoint at all.
    """
    torch.manual_seed(config.seed)
    network = PillarNetwork(draws.grid, size).to(config.device, memory_format=torch.channels_last)
    descent = Descent(
        network, config, config.steps, rising=0.1, gradient_max=10.0, averaging=config.averaging, betas=(0.9, 0.99)
    )
    run = Fitting(network, descent)
    digest = repr((_CHECKPOINT_FORM, draws.grid, draws.seed, draws.batch, size))
    if checkpoint is not None and checkpoint.exists():
        run.restore(_read(checkpoint, digest), config.steps)
    if run.step < config.steps and (not run.plans or run.plans[-1][1:] != (config.steps, len(draws))):
        run.plans.append((run.step, config.steps, len(draws)))
    device, start = torch.device(config.device), time.monotonic()
    spent_s = run.processor_s - time.process_time()
    while run.step < config.steps:
        run.train_step(draws.batch_of(run.step), config, device)
        if run.step % config.checkpoint_steps == 0 or run.step == config.steps:
            loss, heat, box, named = torch.stack(run.sums).mean(dim=0).tolist()
            run.sums.clear()
            run.processor_s = spent_s + time.process_time()
            if checkpoint is not None:
                with writing(checkpoint, "place", "checkpoint"):
                    checkpoint.parent.mkdir(parents=True, exist_ok=True)
                    with whole_file(checkpoint) as new:
                        torch.save({"digest": digest, **run.state()}, new)
            goes_on = report(StepMeans(run.step, loss, heat, box, named, time.monotonic() - start))
            if not goes_on and run.step < config.steps:
                return None
    run.network = descent.result()
    return run


def pillar_tensors(frames: list[Pillars], network: PillarNetwork) -> tuple[Tensor, Tensor]:
    """Network inputs for some frames."""
    side = network.grid.cells**2
    cell = np.concatenate([pillars.cell + number * side for number, pillars in enumerate(frames)])
    return torch.from_numpy(np.concatenate([pillars.points for pillars in frames])), torch.from_numpy(cell)


def _target_tensors(frames: list[Targets], device: torch.device) -> dict[str, Tensor]:
    arrays = {name: np.stack([getattr(targets, name) for targets in frames]) for name in ("heat", "counts")}
    for name in ("box", "weight", "label"):
        arrays[name] = np.concatenate([getattr(targets, name) for targets in frames])
    arrays["cell"] = np.concatenate(
        [targets.cell + number * targets.heat.size for number, targets in enumerate(frames)]
    )
    return {name: torch.from_numpy(values).to(device) for name, values in arrays.items()}


def _read(path: Path, digest: str) -> dict[str, Any]:
    try:
        state: dict[str, Any] = torch.load(path, weights_only=True, map_location="cpu")
    except Exception as error:  # torch's errors have no common class
        raise InputError("checkpoint", str(path), f"a checkpoint of this training ({error})") from error
    if state.get("digest") != digest or "plans" not in state:
        raise InputError("checkpoint", str(path), "one of the same grid, size, seed and batch, or none")
    return state


_MOST_BOXES: Final = 150


class BoxesOf(nn.Module):
    """The network with CenterPoint's decoding: cells that are local maxima of the heat map become boxes."""

    def __init__(self, network: PillarNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, points: Tensor, cell: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Convert one frame's pillars to the outputs of ``DetectorNetwork``."""
        logit, classes, box = self.network(points, cell)
        heat = torch.sigmoid(logit)
        highest = nn.functional.max_pool2d(heat[:, None], 3, stride=1, padding=1)[:, 0]
        peaks = torch.where(heat == highest, heat, torch.zeros_like(heat)).reshape(-1)
        rows = logit.shape[-1]
        score, place = torch.topk(peaks, min(_MOST_BOXES, rows * rows))
        values = box.reshape(box.shape[1], -1)[:, place].T
        share = torch.softmax(classes.reshape(classes.shape[1], -1)[:, place].T, dim=-1)
        grid = self.network.grid
        at = torch.stack((place % rows, torch.div(place, rows, rounding_mode="floor")), dim=-1)
        middle = (at.to(values.dtype) + 0.5) * (STRIDE * grid.cell_m) - grid.half_width_m
        centre = torch.cat((middle + values[:, :2], values[:, 2:3]), dim=-1)
        table = torch.cat((centre, torch.exp(values[:, 3:6]), values[:, 6:]), dim=-1)
        return table, score, share


def export(network: PillarNetwork, **figures: Any) -> FittedNetwork:
    """Export the network for one frame with any number of pillars; ``figures`` are further fields of the result."""
    grid, pillars = network.grid, 7
    cells = torch.arange(pillars, dtype=torch.int64) * 3 % grid.cells**2
    example, free = (torch.rand(pillars, grid.points, len(FEATURES)), cells), dict.fromkeys(INPUTS, "pillars")
    return exported(network, BoxesOf(network), example, INPUTS, OUTPUTS, free, **figures)


def fitted_detector(
    draws: FrameDraws, config: DetectionFit, threads: int, checkpoint: Path, report: Callable[[str], bool]
) -> FittedNetwork | None:
    """Fit a network and export it; None if ``report``, called with a line at each checkpoint, returned False."""
    torch.set_num_threads(threads)

    def report_means(progress: StepMeans) -> bool:
        return report(
            f"step {progress.step}/{config.steps}: loss {progress.loss:.3f} (heat {progress.heat:.3f}, "
            f"boxes {progress.box:.3f}, classes {progress.named:.3f}), {progress.seconds:.0f} s"
        )

    run = fit(draws, NetworkSize(), config, checkpoint, report_means)
    return None if run is None else export(run.network, processor_s=run.processor_s, plans=tuple(run.plans))
