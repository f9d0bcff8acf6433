"""The network: each picture with the two before it, then time, then the most severe moment."""

from typing import Final

import torch
from torch import Tensor, nn

from siren_ros.evaluation.risk.sequence.small_frames import HEIGHT, WIDTH

_STACK: Final = 3
_CHANNELS: Final = (12, 16, 24, 32)
_WIDTH: Final = 48


class FilmNetwork(nn.Module):
    """Two ordered questions about a film: is there a near-miss or worse, and is there a collision?"""

    def __init__(self) -> None:
        """Weights are drawn from torch's generator."""
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
        """Logits of each picture ``(N, 2, T)`` and of the film ``(N, 2)``.

        Args:
            frames: Grey values 0 … 255, shape ``(N, T, HEIGHT, WIDTH)``.
        """
        values = (frames.float() - 128.0) / 64.0
        first = torch.cat((values[:, :1], values[:, :1], values), dim=1)
        # A picture, and how it differs from the two before it: what comes nearer grows.
        stack = torch.stack((values, values - first[:, 1:-1], values - first[:, :-2]), dim=2)
        count, length = frames.shape[0], frames.shape[1]
        seen = self.pictures(stack.reshape(count * length, _STACK, HEIGHT, WIDTH))
        moments = self.moments(self.time(seen.reshape(count, length, _WIDTH).transpose(1, 2)))
        smooth = nn.functional.avg_pool1d(moments, 3, stride=1, padding=1, count_include_pad=False)
        return moments, smooth.amax(dim=2)
