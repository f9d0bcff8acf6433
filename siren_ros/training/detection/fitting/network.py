"""PointPillars' network with CenterPoint's head, small enough for a processor."""

from typing import Final

import torch
from torch import Tensor, nn

from siren_ros.evaluation.detection.metrics.named_classes import CLASS_NAMES
from siren_ros.evaluation.detection.pillars.grid import PillarGrid
from siren_ros.evaluation.detection.pillars.pillars import FEATURES
from siren_ros.training.detection.fit_config import NetworkSize
from siren_ros.training.detection.targets import BOX_CHANNELS

_PRIOR_LOGIT: Final = -4.0
"""Before training, a cell holds a vehicle with a probability of 2 %."""
_SPEED_SCALE_MPS: Final = 5.0


class PillarFeatures(nn.Module):
    """PointPillars' feature net: each point through one layer, the largest of each channel over the pillar.

    The largest comes before normalisation and rectifier, which are monotonic: the same family of functions, at a small
    part of the cost.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.layer = nn.Linear(len(FEATURES), width, bias=False)
        self.norm = nn.BatchNorm1d(width)

    def forward(self, points: Tensor) -> Tensor:
        """Pillars ``(P, N, 10)`` to features ``(P, width)``."""
        return torch.relu(self.norm(self.layer(points).max(dim=1).values.float()))


class PillarNetwork(nn.Module):
    """Pillars to a map of heat, boxes and classes."""

    def __init__(self, grid: PillarGrid, size: NetworkSize) -> None:
        super().__init__()
        self.grid, self.size = grid, size
        self.pillars = PillarFeatures(size.pillar)
        self.stem = _convolution(size.pillar, size.pillar, stride=2)
        widths = (size.pillar, *size.stages)
        self.stages = nn.ModuleList(
            nn.Sequential(
                _convolution(before, width, stride=2),
                *(_convolution(width, width) for _ in range(size.layers - 1)),
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
        """Logits of a vehicle ``(B, R, R)``, logits of the classes ``(B, C, R, R)``, boxes ``(B, 10, R, R)``.

        Args:
            points: As in ``Pillars``, those of all frames one after the other.
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
        nn.Conv2d(before, after, 3, stride=stride, padding=1, bias=False),
        nn.BatchNorm2d(after),
        nn.ReLU(inplace=True),
    )
