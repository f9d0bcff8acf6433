"""The sequence model's network and its fitting; equal films, settings and seed give equal weights."""

import time
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from siren_ros.lab.training.fitting.descent import Descent, exported
from siren_ros.lab.training.risk import (
    CLIP_FRAMES,
    LabelledFilm,
    brightness,
    clip_of,
    drawn_first,
    films_with,
    operating_point,
    validation_clips,
)
from siren_ros.lab.training.settings import FilmFitConfig, FittedNetwork
from siren_ros.scoring.evaluation.risk.labels import RiskClass
from siren_ros.scoring.evaluation.risk.sequence_model import HEIGHT, INPUT, OUTPUT, WIDTH

_STACK: Final = 3
_CHANNELS: Final = (12, 16, 24, 32)
_WIDTH: Final = 48


class FilmNetwork(nn.Module):
    """Network for two ordered questions about a film: at least a near-miss? a collision?"""

    def __init__(self) -> None:
        """Make the network; torch's generator draws the weights."""
        super().__init__()
        layers: list[nn.Module] = []
        before, rows, columns = _STACK, HEIGHT, WIDTH
        for number, channels in enumerate(_CHANNELS):
            size = 5 if number == 0 else 3
            layers += [
                nn.Conv2d(before, channels, size, stride=2, padding=size // 2, bias=False),
                nn.BatchNorm2d(channels),
                nn.ReLU(),
            ]
            before, rows, columns = channels, (rows + 1) // 2, (columns + 1) // 2
        self.pictures = nn.Sequential(
            *layers, nn.Flatten(), nn.Dropout(0.2), nn.Linear(before * rows * columns, _WIDTH)
        )
        self.time = nn.Sequential(
            nn.ReLU(),
            nn.Conv1d(_WIDTH, _WIDTH, 5, padding=2),
            nn.ReLU(),
            nn.Conv1d(_WIDTH, _WIDTH, 5, padding=4, dilation=2),
            nn.ReLU(),
        )
        self.moments = nn.Conv1d(_WIDTH, 2, 1)

    def forward(self, frames: Tensor) -> tuple[Tensor, Tensor]:
        """Logits of pictures ``(N, 2, T)`` and films ``(N, 2)`` from grey values 0 … 255, ``(N, T, HEIGHT, WIDTH)``."""
        values = (frames.float() - 128.0) / 64.0
        first = torch.cat((values[:, :1], values[:, :1], values), dim=1)
        # Inputs are a picture and its differences to the two before it, because approaching vehicles grow.
        stack = torch.stack((values, values - first[:, 1:-1], values - first[:, :-2]), dim=2)
        count, length = frames.shape[0], frames.shape[1]
        seen = self.pictures(stack.reshape(count * length, _STACK, HEIGHT, WIDTH))
        moments = self.moments(self.time(seen.reshape(count, length, _WIDTH).transpose(1, 2)))
        smooth = nn.functional.avg_pool1d(moments, 3, stride=1, padding=1, count_include_pad=False)
        return moments, smooth.amax(dim=2)


_SHARES: Final = (0.4, 0.35, 0.25)
"""Share of training clips for each class."""


def fitted_film_network(
    train: Sequence[LabelledFilm],
    validation: Sequence[LabelledFilm],
    config: FilmFitConfig,
    report: Callable[[str], None],
) -> FittedNetwork:
    """Fit and export a network; 0.5 is the threshold of both probabilities.

    The validation films decide where the halves lie, and nothing else. ``report`` is called with a line after each
    epoch.
    """
    network = _fit(train, config, report)
    clips = validation_clips(validation, config.thresholds)
    with torch.no_grad():
        logits = torch.cat([network(torch.from_numpy(clip.frames[None]))[1] for clip in clips]).numpy()
    offset = operating_point(logits, np.array([clip.label for clip in clips], dtype=np.int64))
    example = torch.zeros((1, CLIP_FRAMES, HEIGHT, WIDTH), dtype=torch.uint8)
    return exported(network, _Answer(network, torch.from_numpy(offset)), (example,), [INPUT], [OUTPUT], {})


def _fit(films: Sequence[LabelledFilm], config: FilmFitConfig, report: Callable[[str], None]) -> FilmNetwork:
    torch.manual_seed(config.seed)
    torch.set_num_threads(1)
    network = FilmNetwork()
    descent = Descent(network, config, config.epochs * config.steps, rising=0.2, gradient_max=5.0)
    having = [films_with(films, risk) for risk in RiskClass]
    random, start = np.random.default_rng(config.seed), time.monotonic()
    for epoch in range(config.epochs):
        network.train()
        total = 0.0
        for _ in range(config.steps):
            frames, severity, label = _batch(having, config, random)
            moments, whole = network(frames)
            of_pictures = _focal(moments.transpose(1, 2).reshape(-1, 2), severity.reshape(-1), 0.0)
            loss = _focal(whole, label, config.focus) + config.frame_weight * of_pictures
            descent.step(loss)
            total += float(loss.detach())
        report(f"epoch {epoch + 1}/{config.epochs}: loss {total / config.steps:.3f}, {time.monotonic() - start:.0f} s")
    return network.eval()


def _batch(
    having: Sequence[Sequence[LabelledFilm]], config: FilmFitConfig, random: np.random.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Draw clips with a moment of a drawn class; ``having`` contains the films of each class."""
    shares = np.array([share if some else 0.0 for share, some in zip(_SHARES, having, strict=True)])
    frames, severity, label = [], [], []
    for risk in random.choice(len(RiskClass), config.batch, p=shares / shares.sum()):
        film = having[risk][int(random.integers(len(having[risk])))]
        first = drawn_first(film, RiskClass(risk), config.clip_frames, random)
        clip = clip_of(film, first, config.clip_frames, config.thresholds)
        pictures = brightness(clip.frames, random)
        if random.random() < 0.5:
            pictures = pictures[..., ::-1].copy()
        frames.append(torch.from_numpy(pictures))
        severity.append(torch.from_numpy(clip.severity))
        label.append(int(clip.label))
    return torch.stack(frames), torch.stack(severity), torch.tensor(label)


def _focal(logits: Tensor, severity: Tensor, focus: float) -> Tensor:
    """Focal losses of both questions for logits ``(N, 2)`` and classes ``(N,)``."""
    truth = torch.stack((severity >= RiskClass.NEAR_MISS, severity >= RiskClass.COLLISION), dim=1).float()
    loss = torch.nn.functional.binary_cross_entropy_with_logits(logits, truth, reduction="none")
    return ((1.0 - torch.exp(-loss)) ** focus * loss).sum(dim=1).mean()


class _Answer(torch.nn.Module):
    """Converts logits to probabilities, shifted so that 0.5 is the operating point."""

    def __init__(self, network: FilmNetwork, offset: Tensor) -> None:
        super().__init__()
        self.network = network
        self.register_buffer("offset", offset.float())

    def forward(self, frames: Tensor) -> Tensor:
        whole: Tensor = self.network(frames)[1]
        return torch.sigmoid(whole - self.offset)
